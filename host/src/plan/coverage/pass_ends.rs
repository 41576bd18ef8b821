//! Ends of passes: cut back where others cover the ground anyway, and passes that add next to
//! nothing left out.
//!
//! Runs are laid up to the joint where they meet another bead, so that nothing stays open there.
//! What an end covers alone and what it covers again is counted on a raster; the end goes back to
//! where both together are best.
//!
//! In: passes, their bounds (mm). Out: the passes with shorter ends, and which of them are too
//! small to be printed by themselves (mm² against the aperture's). Leaves out: closed passes, which
//! have no ends.

use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::Box2;
use crate::plan::coverage::raster::{CELL_SHARE, Raster};
use crate::plan::pass::sweep::{poses, poses_between};
use crate::plan::pass::{LayerPass, bounds_of};
use std::cell::Cell;

/// Longest stretch cut off an end, and what is looked at beyond it, against the major semi-axis.
const CUT_SHARE_MAX: f64 = 6.0;
const BEYOND_SHARE: f64 = 3.0;
/// What covering a place again costs against leaving it open.
const AGAIN_WEIGHT: f64 = 0.6;
/// Least area that a pass covers alone, against the aperture's: an interruption of flow for less is
/// not worth it, and a gap-fill move may still fill it.
const ALONE_SHARE_MIN: f64 = 1.0;
/// The same once the passes are joined: what is left by itself then has its own retraction.
const SMALL_SHARE_MIN: f64 = 12.0;
/// Ground of a small pass that may stay open, against the aperture's area: with more it is printed
/// after all.
const OPEN_SHARE_MAX: f64 = 0.5;
/// A pass that covers this share of its ground alone stays, however small: nothing else is near.
const APART_SHARE: f64 = 0.9;
/// Apertures whose centres are farther apart share no ground, against their reach: 2 and rounding.
const NEAR_SHARE: f64 = 2.1;
/// Least placements of a pass.
const PLACEMENTS_MIN: usize = 2;

/// Cuts the ends of open passes back and drops passes that cover next to nothing alone. `bounds`
/// holds all passes.
pub fn fit_ends(passes: &mut Vec<LayerPass>, aperture: &Aperture, bounds: &Box2) {
    let Some(mut raster) = fine_raster(passes, bounds, aperture) else {
        return;
    };
    for pass in passes.iter_mut().filter(|pass| !pass.closed) {
        for _ in 0..2 {
            raster.cut_end(pass);
            pass.placements.reverse();
        }
    }
    passes.retain(|pass| !raster.drop_idle(pass, ALONE_SHARE_MIN, Some(APART_SHARE)));
}

/// Which passes cover less alone than an interruption of flow is worth, now that it is known which
/// ones join others: gap-fill moves may fill their ground. The longest is never among them.
pub fn small_ones(passes: &[LayerPass], aperture: &Aperture) -> Vec<bool> {
    let mut is_small = vec![false; passes.len()];
    let longest = (0..passes.len()).max_by(|&p, &q| {
        let length_mm = |pass: usize| passes[pass].length_mm();
        length_mm(p).total_cmp(&length_mm(q))
    });
    let (Some(longest), true) = (longest, passes.len() > 1) else {
        return is_small;
    };
    let Some(mut raster) = fine_raster(passes, &bounds_of(passes, aperture), aperture) else {
        return is_small;
    };
    for (number, pass) in passes.iter().enumerate() {
        is_small[number] = number != longest && raster.drop_idle(pass, SMALL_SHARE_MIN, None);
    }
    is_small
}

/// Takes those small ones back whose ground the gap-fill moves of `filled` left open after all;
/// whether there are any.
pub fn take_back_open(
    is_small: &mut [bool],
    passes: &[LayerPass],
    filled: &[LayerPass],
    aperture: &Aperture,
) -> bool {
    if !is_small.contains(&true) {
        return false;
    }
    let Some(mut raster) = fine_raster(filled, &bounds_of(passes, aperture), aperture) else {
        return false;
    };
    let open_max = OPEN_SHARE_MAX * aperture.area_mm2() / raster.cell_area_mm2();
    let mut is_any = false;
    for (pass, is_small) in passes.iter().zip(is_small).filter(|p| *p.1) {
        let mut open = 0;
        raster.for_cells_once(poses(pass, aperture), |count| {
            open += u32::from(*count == 0);
        });
        *is_small = f64::from(open) <= open_max;
        is_any |= !*is_small;
    }
    is_any
}

/// The raster of all passes, if it is fine enough for the aperture: else the ends stay as they are.
fn fine_raster(passes: &[LayerPass], bounds: &Box2, aperture: &Aperture) -> Option<Raster> {
    let raster = Raster::of_passes(passes, bounds, aperture, CELL_SHARE);
    raster.is_fine().then_some(raster)
}

impl Raster {
    /// Takes a pass off the counts if it covers less alone than this share of the aperture's area,
    /// and than `apart_share` of its own ground; whether it did.
    fn drop_idle(&mut self, pass: &LayerPass, alone_share: f64, apart_share: Option<f64>) -> bool {
        let aperture = *self.aperture();
        let cells_min = alone_share * aperture.area_mm2() / self.cell_area_mm2();
        let (alone, mut all) = (Cell::new(0), 0);
        // As soon as it covers enough alone, the rest does not matter.
        let poses_asked = poses(pass, &aperture).take_while(|_| f64::from(alone.get()) < cells_min);
        self.for_cells_once(poses_asked, |count| {
            alone.set(alone.get() + u32::from(*count == 1));
            all += 1;
        });
        let least = apart_share.map_or(cells_min, |share| cells_min.min(share * f64::from(all)));
        let is_idle = f64::from(alone.get()) < least;
        if is_idle {
            self.for_cells_once(poses(pass, &aperture), |count| *count -= 1);
        }
        is_idle
    }

    /// Cuts the pass's last placements off as far as that is for the better.
    fn cut_end(&mut self, pass: &mut LayerPass) {
        let count = pass.placements.len();
        let aperture = *self.aperture();
        let [window, beyond] = self.window(pass);
        // From the inside outwards: what the kept part covers is not freed by any cut.
        self.begin_walk();
        let mut freed = vec![0.0; window + 1];
        for back in (0..=beyond).rev() {
            let number = count - 1 - back;
            let at = pass.placements[number].at;
            let next = pass.placements.get(number + 1).map(|p| p.at);
            let between = next.map(|next| poses_between(&aperture, at, next));
            // A pose between two placements goes with the outer one.
            let own = std::iter::once((back + 1, at));
            let shared = between.into_iter().flatten().map(|at| (back, at));
            for (cut, at) in own.chain(shared) {
                self.for_cells_new(std::iter::once(at), |count| {
                    if cut <= window {
                        freed[cut] += if *count > 1 { AGAIN_WEIGHT } else { -1.0 };
                    }
                });
            }
        }
        let (mut best, mut sum, mut cut) = (0.0, 0.0, 0);
        for (back, gain) in freed.iter().enumerate() {
            sum += gain;
            if sum > best {
                (best, cut) = (sum, back);
            }
        }
        if cut > 0 {
            let tail = LayerPass {
                placements: pass.placements[count - cut - 1..].to_vec(),
                ..pass.clone()
            };
            pass.placements.truncate(count - cut);
            // What only the tail covered is covered by one pass less.
            let centers: Vec<Point2> = tail.placements.iter().map(|p| p.at.center).collect();
            let near = Box2::of(&centers).grown(NEAR_SHARE * aperture.reach_mm());
            let is_near = |at: &Configuration| near.contains(at.center);
            self.for_cells_once(poses(pass, &aperture).filter(is_near), |_| {});
            self.for_cells_new(poses(&tail, &aperture), |count| *count -= 1);
        }
    }

    /// Numbers of placements that may be cut off the end, and that are looked at.
    fn window(&self, pass: &LayerPass) -> [usize; 2] {
        let placements = &pass.placements;
        let count = placements.len();
        let a = self.aperture().major_mm();
        let (mut length_mm, mut window, mut beyond) = (0.0, 0, 0);
        for back in 1..count {
            let (p, q) = (placements[count - back].at, placements[count - back - 1].at);
            length_mm += (q.center - p.center).norm();
            if length_mm <= CUT_SHARE_MAX * a {
                window = back;
            }
            beyond = back;
            if length_mm > (CUT_SHARE_MAX + BEYOND_SHARE) * a {
                break;
            }
        }
        [window.min(count.saturating_sub(PLACEMENTS_MIN)), beyond]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;
    use crate::geometry::test_shapes::ELLIPSE as APERTURE;
    use crate::plan::pass::test_passes::run;

    fn bounds() -> Box2 {
        Box2::of(&[Point2::new(-6.0, -6.0), Point2::new(6.0, 6.0)])
    }

    /// Goal: a stem that was laid into a bar goes back to the bar's edge, the bar stays, and so
    /// does a stem that ends before it. Method: a bar of half-width 0.6 mm along x; the tip of the
    /// stem's aperture (b = 0.2 mm) belongs about at its edge.
    #[test]
    fn a_stem_ends_at_the_bar_that_it_meets() {
        let bar = run([-5.0, 0.0], [5.0, 0.0]);
        let mut passes = vec![bar.clone(), run([0.0, 5.0], [0.0, 0.0])];
        fit_ends(&mut passes, &APERTURE, &bounds());
        assert_eq!(passes[0], bar);
        let low = |pass: &LayerPass| {
            let ys = pass.placements.iter().map(|p| p.at.center.y);
            ys.fold(f64::INFINITY, f64::min)
        };
        let end = low(&passes[1]);
        assert!((0.6..=0.8).contains(&end), "{end}");
        let mut apart = vec![bar, run([0.0, 5.0], [0.0, 0.9])];
        fit_ends(&mut apart, &APERTURE, &bounds());
        assert_eq!(apart[1].placements.len(), 42);
    }

    /// Goal: what stands alone stays, however small. Method: a run of two placements.
    #[test]
    fn a_small_pass_alone_stays() {
        let mut passes = vec![run([0.0, 0.0], [0.1, 0.0])];
        fit_ends(&mut passes, &APERTURE, &bounds());
        assert_eq!(passes[0].placements.len(), 2);
    }

    /// Goal: a pass over ground that another one covers is left out, one that is needed is not.
    /// Method: the same run twice, the second a little longer.
    #[test]
    fn what_adds_nothing_is_left_out() {
        let mut passes = vec![run([-5.0, 0.0], [5.0, 0.0]), run([-5.0, 0.0], [5.1, 0.0])];
        fit_ends(&mut passes, &APERTURE, &bounds());
        assert_eq!(passes.len(), 1);
        let centers = passes[0].placements.iter().map(|p| p.at.center.x);
        let reach = centers.fold([0.0f64; 2], |[low, high], x| [low.min(x), high.max(x)]);
        assert!(reach[0] < -4.9 && reach[1] > 4.9, "{reach:?}");
    }

    /// Goal: once all are joined, a short pass is left to gap-fill moves, as long as something else
    /// is printed; what they leave open is taken back. Method: a bar, and a run of 0.2 mm that
    /// begins under it or 3 mm away; what is printed instead covers both, or is the bar alone.
    #[test]
    fn a_stump_is_left_to_gap_fill() {
        let bar = run([-5.0, 0.0], [5.0, 0.0]);
        let stump = run([0.0, 0.3], [0.0, 0.5]);
        assert_eq!(small_ones(std::slice::from_ref(&stump), &APERTURE), [false]);
        for stump in [stump, run([0.0, 3.6], [0.0, 3.8])] {
            let passes = [stump.clone(), bar.clone()];
            let mut is_small = small_ones(&passes, &APERTURE);
            assert_eq!(is_small, [true, false]);
            assert!(!take_back_open(&mut is_small, &passes, &passes, &APERTURE));
            assert_eq!(is_small, [true, false]);
            let apart = stump.placements[0].at.center.y > 3.0;
            let is_open = take_back_open(&mut is_small, &passes, &passes[1..], &APERTURE);
            assert_eq!((is_open, is_small[0]), (apart, !apart));
        }
    }
}

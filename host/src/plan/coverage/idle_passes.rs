//! Removes passes that alone cover almost no area.
//!
//! Beads extend up to the junction where they meet another bead, so that nothing stays uncovered there; some
//! overlap others from end to end. The area that only one pass covers is counted on a raster.
//!
//! In: passes, their bounds (mm). Out: the passes that are needed (mm² against the aperture's area).

use crate::geometry::aperture::Aperture;
use crate::geometry::polygon::Box2;
use crate::plan::coverage::raster::{CELL_SHARE, Raster};
use crate::plan::pass::LayerPass;
use crate::plan::pass::sweep::poses;
use std::cell::Cell;

/// Least area that a pass covers alone, against the aperture's: an interruption of flow for less is not worth it.
const ALONE_SHARE_MIN: f64 = 1.0;
/// A pass that alone covers this share of its area is kept, however small: nothing else is near.
const APART_SHARE: f64 = 0.9;

/// Drops passes that alone cover almost no area. `bounds` contains all passes. If the raster is too coarse for the
/// aperture all are kept.
pub fn drop_idle(passes: &mut Vec<LayerPass>, aperture: &Aperture, bounds: &Box2) {
    let mut raster = Raster::of_passes(passes, bounds, aperture, CELL_SHARE);
    if raster.is_fine() {
        passes.retain(|pass| !raster.is_idle(pass));
    }
}

impl Raster {
    /// Takes a pass off the counts if it covers little alone; whether it did.
    fn is_idle(&mut self, pass: &LayerPass) -> bool {
        let aperture = *self.aperture();
        let cells_min = ALONE_SHARE_MIN * aperture.area_mm2() / self.cell_area_mm2();
        let (alone, mut all) = (Cell::new(0), 0);
        // As soon as it covers enough alone, the rest does not matter.
        let poses_asked = poses(pass, &aperture).take_while(|_| f64::from(alone.get()) < cells_min);
        self.for_cells_once(poses_asked, |count| {
            alone.set(alone.get() + u32::from(*count == 1));
            all += 1;
        });
        let is_idle = f64::from(alone.get()) < cells_min.min(APART_SHARE * f64::from(all));
        if is_idle {
            self.for_cells_once(poses(pass, &aperture), |count| *count -= 1);
        }
        is_idle
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

    /// Goal: what stands alone stays, however small. Method: a run of two placements.
    #[test]
    fn a_small_pass_alone_stays() {
        let mut passes = vec![run([0.0, 0.0], [0.1, 0.0])];
        drop_idle(&mut passes, &APERTURE, &bounds());
        assert_eq!(passes[0].placements.len(), 2);
    }

    /// Goal: a pass over ground that another one covers is left out, one that is needed is not.
    /// Method: the same run twice, the second a little longer.
    #[test]
    fn what_adds_nothing_is_left_out() {
        let mut passes = vec![run([-5.0, 0.0], [5.0, 0.0]), run([-5.0, 0.0], [5.1, 0.0])];
        drop_idle(&mut passes, &APERTURE, &bounds());
        assert_eq!(passes.len(), 1);
        let centers = passes[0].placements.iter().map(|p| p.at.center.x);
        let reach = centers.fold([0.0f64; 2], |[low, high], x| [low.min(x), high.max(x)]);
        assert!(reach[0] < -4.9 && reach[1] > 4.9, "{reach:?}");
    }
}

//! The share of the advancing front that meets uncovered area.
//!
//! In: the passes of one layer that may touch each other, in printing order, as poses no farther
//! apart than [`pose_step_mm`]. Out: for each pass the share of its first placement, and of each
//! step, that is on uncovered area. A raster records the area covered by all passes; for each step
//! the newly covered cells are divided by the cells that it adds to the previous pose, so that a
//! front that meets no covered area has the share 1 exactly, however coarse the raster is. Not
//! covered: area outside the region (no pose leaves it by more than the tolerance).

use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::place_scale::ScaleField;
use crate::plan::coverage::raster::{Advance, SKEW_RAD, newly_covered};

/// Most cells of the raster. Those of 0.1 b tell the share of a front of 2b to 5 %, of any mm of a bead
/// to 0.3 %; a larger layer gets larger ones, which its longer passes average out.
const CELLS_MAX: usize = 50_000_000;
/// Step between poses against the minor semi-axis: the sharpest end of an ellipse of 3 : 1 leaves
/// scallops of 1.5 % of b, which the adjacent bead is assumed to fill.
const STEP_SHARE: f64 = 0.2;

/// Newly covered area of one pass, as shares of its area.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FreshShares {
    /// Of the aperture at the first pose.
    pub start: f64,
    /// Of the front of each step.
    pub steps: Vec<f64>,
}

impl FreshShares {
    /// Nothing was covered before, for this many poses.
    pub fn all(poses: usize) -> FreshShares {
        FreshShares {
            start: 1.0,
            steps: vec![1.0; poses.saturating_sub(1)],
        }
    }
}

/// Longest step between the poses of a pass, mm, and turn times the major semi-axis.
pub fn pose_step_mm(aperture: &Aperture) -> f64 {
    STEP_SHARE * aperture.minor_mm()
}

/// The newly covered area of each pass, in printing order; `scale` if the plane is the chart of a curved
/// surface.
pub fn fresh_shares(
    passes: &[Vec<Configuration>],
    aperture: &Aperture,
    scale: Option<&ScaleField>,
) -> Vec<FreshShares> {
    let (placed, sizes): (Vec<Configuration>, Vec<f64>) = match scale {
        None => (passes.iter().flatten().map(on_raster).collect(), Vec::new()),
        Some(scale) => {
            let major_mm = aperture.major_mm();
            let poses = passes.iter().flatten();
            let on_ground = poses.map(|pose| {
                let (center, size) = scale.tool_at(*pose, major_mm);
                (on_raster(&Configuration { center, ..*pose }), size)
            });
            on_ground.unzip()
        }
    };
    let mut starts = vec![false; placed.len()];
    let mut begin = 0;
    for pass in passes {
        if !pass.is_empty() {
            starts[begin] = true;
        }
        begin += pass.len();
    }
    let counts = newly_covered(&placed, &starts, aperture, &sizes, CELLS_MAX);
    let mut begin = 0;
    passes
        .iter()
        .map(|pass| {
            let own = &counts[begin..begin + pass.len()];
            begin += pass.len();
            shares(own)
        })
        .collect()
}

fn on_raster(pose: &Configuration) -> Configuration {
    let (sin, cos) = SKEW_RAD.sin_cos();
    let Point2 { coords: at } = pose.center;
    Configuration {
        center: Point2::new(at.x * cos - at.y * sin, at.x * sin + at.y * cos),
        heading_rad: pose.heading_rad + SKEW_RAD,
    }
}

/// The whole, if it covers nothing.
fn fresh_share(advance: &Advance) -> f64 {
    match advance.cells {
        0 => 1.0,
        cells => f64::from(advance.fresh) / f64::from(cells),
    }
}

/// Fewest cells of which a share is computed.
const CELLS_MIN: u32 = 200;

/// Shares from counts. A step that covers few cells has the share of the steps around it.
fn shares(counts: &[Advance]) -> FreshShares {
    let Some((first, steps)) = counts.split_first() else {
        return FreshShares::default();
    };
    let mut sums = vec![Advance::default()];
    for step in steps {
        let sum = sums[sums.len() - 1];
        sums.push(Advance {
            cells: sum.cells + step.cells,
            fresh: sum.fresh + step.fresh,
        });
    }
    let of_step = |step: usize| {
        let mut reach = 0;
        loop {
            let from = step.saturating_sub(reach);
            let to = (step + reach + 1).min(steps.len());
            let about = Advance {
                cells: sums[to].cells - sums[from].cells,
                fresh: sums[to].fresh - sums[from].fresh,
            };
            if about.cells >= CELLS_MIN || to - from == steps.len() {
                return fresh_share(&about);
            }
            reach = 2 * reach + 1;
        }
    };
    FreshShares {
        start: fresh_share(first),
        steps: (0..steps.len()).map(of_step).collect(),
    }
}

#[cfg(test)]
mod tests {
    //! Goal: ground counts once, whoever covers it first. Method: poses of the ellipse of 1.2 x
    //! 0.4 mm in the cases that have a closed form; the cells are 0.02 mm.
    use super::*;
    use crate::geometry::test_shapes::ELLIPSE;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn line(
        from: [f64; 2],
        to: [f64; 2],
        headings_rad: [f64; 2],
        count: u32,
    ) -> Vec<Configuration> {
        (0..=count)
            .map(|i| {
                let t = f64::from(i) / f64::from(count);
                Configuration {
                    center: Point2::from([0, 1].map(|c| from[c] + (to[c] - from[c]) * t)),
                    heading_rad: headings_rad[0] + (headings_rad[1] - headings_rad[0]) * t,
                }
            })
            .collect()
    }

    /// Sum of the shares of a line's equal steps, as a length.
    fn fresh_mm(found: &FreshShares, step_mm: f64) -> f64 {
        found.steps.iter().sum::<f64>() * step_mm
    }

    #[test]
    fn a_bead_on_fresh_ground_is_all_fresh() {
        let pass = line([0.0, 0.0], [5.0, 1.0], [FRAC_PI_2, 0.3], 250);
        let found = fresh_shares(&[pass], &ELLIPSE, None);
        assert_eq!(found[0].start, 1.0);
        let share = fresh_mm(&found[0], 1.0) / 250.0;
        // The ellipse that turns takes in a little behind itself again.
        assert!(share > 0.99, "{share}");
    }

    #[test]
    fn the_same_bead_again_deposits_nothing() {
        let pass = line([0.0, 0.0], [5.0, 0.0], [FRAC_PI_2; 2], 200);
        let found = fresh_shares(&[pass.clone(), pass], &ELLIPSE, None);
        assert_eq!(found[0].steps, vec![1.0; 200]);
        assert_eq!((found[1].start, fresh_mm(&found[1], 0.025)), (0.0, 0.0));
    }

    #[test]
    fn a_bead_beside_another_deposits_what_is_left() {
        let pass = |y: f64| line([0.0, y], [5.0, y], [FRAC_PI_2; 2], 200);
        let found = fresh_shares(&[pass(0.0), pass(0.9)], &ELLIPSE, None);
        // 0.3 of 1.2 mm lie on the first one.
        let middle: f64 = found[1].steps[50..150].iter().sum::<f64>() / 100.0;
        assert!((middle - 0.75).abs() < 0.005, "{middle}");
    }

    #[test]
    fn a_bead_across_another_leaves_out_the_crossing() {
        let first = line([0.0, 0.0], [5.0, 0.0], [FRAC_PI_2; 2], 200);
        let second = line([2.5, -2.5], [2.5, 2.5], [0.0; 2], 200);
        let found = fresh_shares(&[first, second], &ELLIPSE, None);
        let fresh = fresh_mm(&found[1], 0.025);
        assert!((fresh - 3.8).abs() < 0.02, "{fresh}");
    }

    /// After half a turn on the spot the circle about the ellipse is covered.
    #[test]
    fn a_turn_on_the_spot_deposits_its_circle_once() {
        let pass = line([0.0; 2], [0.0; 2], [0.0, 3.0 * PI], 720);
        let found = fresh_shares(&[pass], &ELLIPSE, None);
        let half: f64 = found[0].steps[..240].iter().sum::<f64>();
        let rest: f64 = found[0].steps[250..].iter().sum::<f64>();
        // Each step's front is the turn times a² - b².
        let laid_mm2 = half * (PI / 240.0) * (0.36 - 0.04);
        let expected_mm2 = PI * (0.36 - 0.12);
        assert!((laid_mm2 / expected_mm2 - 1.0).abs() < 0.02, "{laid_mm2}");
        assert!(rest < 0.5, "{rest}");
    }
}

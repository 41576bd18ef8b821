//! Headings on a surface: turned from those of the plan so that every bead is as wide as the slope
//! requires.
//!
//! In: along a pass the planned headings and the required bead widths (mm, rad, as the tool sees them). Out:
//! the difference of each heading from the plan's. Measured along the surface, the beads of a plan are
//! farther apart where they run across the slope; a nozzle that is not round compensates that by turning. Of
//! the turns in steps of `STEP_RAD` dynamic programming chooses those that leave the least area uncovered or
//! covered twice, turning weighed as in the plane ([`crate::plan::headings::profile::turn_weight_mm4`]).

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use std::f64::consts::FRAC_PI_2;

/// Turns that are tried, to either side of the plan's heading.
const STATES_ASIDE: usize = 60;
const STATES: usize = 2 * STATES_ASIDE + 1;
/// From one to the next.
const STEP_RAD: f64 = FRAC_PI_2 / STATES_ASIDE as f64;
/// Most of them from one place to the next.
const REACH: usize = 8;
/// Times that the steps are averaged with their neighbours.
const AVERAGINGS: usize = 4;

/// A point of a pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bead {
    /// Heading of the plan.
    pub heading_rad: f64,
    /// Direction of the travel as the tool sees it.
    pub travel_rad: f64,
    /// Half the width that is wanted.
    pub extent_mm: f64,
    /// From the place before.
    pub step_mm: f64,
}

/// For each point the turn of the heading.
pub fn turns_rad(beads: &[Bead], aperture: &Aperture, turn_weight_mm4: f64) -> Vec<f64> {
    if aperture.is_round() || beads.is_empty() {
        return vec![0.0; beads.len()];
    }
    let mut turns = cheapest(beads, aperture, turn_weight_mm4);
    for _ in 0..AVERAGINGS {
        let before = turns.clone();
        for (index, own) in before.iter().enumerate() {
            let beside = [index.checked_sub(1), Some(index + 1)]
                .map(|place| place.and_then(|place| before.get(place)).unwrap_or(own));
            turns[index] = 0.5 * own + 0.25 * (beside[0] + beside[1]);
        }
    }
    turns
}

fn turn_rad(state: usize) -> f64 {
    (state as f64 - STATES_ASIDE as f64) * STEP_RAD
}

/// Area that is open or covered twice per length, mm.
fn amiss_mm(bead: &Bead, turn_rad: f64, aperture: &Aperture) -> f64 {
    let (sin, cos) = bead.travel_rad.sin_cos();
    let across = Vector2::new(-sin, cos);
    let extent_mm = aperture.extent_mm(bead.heading_rad + turn_rad, across);
    2.0 * (extent_mm - bead.extent_mm).abs()
}

fn cheapest(beads: &[Bead], aperture: &Aperture, turn_weight_mm4: f64) -> Vec<f64> {
    let mut costs = [0.0; STATES];
    let mut from: Vec<[u8; STATES]> = Vec::with_capacity(beads.len());
    let mut before: Option<&Bead> = None;
    for bead in beads {
        let mut next = [f64::INFINITY; STATES];
        let mut came = [0; STATES];
        let step_mm = bead.step_mm.max(1e-3);
        let planned_rad = before.map_or(0.0, |before| bead.heading_rad - before.heading_rad);
        // The price of a turn depends on how many states it skips alone.
        let prices: [f64; 2 * REACH + 1] = std::array::from_fn(|skip| {
            let turned_rad = planned_rad + (skip as f64 - REACH as f64) * STEP_RAD;
            turn_weight_mm4 * turned_rad * turned_rad / step_mm
        });
        for state in 0..STATES {
            let [low, high] = [state.saturating_sub(REACH), (state + REACH).min(STATES - 1)];
            for other in low..=high {
                let cost = costs[other] + prices[state + REACH - other];
                // The first of equals, from the middle: staying is tried before turning.
                if cost < next[state] - 1e-12 {
                    (next[state], came[state]) = (cost, other as u8);
                }
            }
            next[state] += bead.step_mm * amiss_mm(bead, turn_rad(state), aperture);
        }
        (costs, before) = (next, Some(bead));
        from.push(came);
    }
    let mut state = 0;
    for other in 1..STATES {
        if costs[other] < costs[state] - 1e-9 {
            state = other;
        }
    }
    let mut turns = vec![0.0; beads.len()];
    for (turn, came) in turns.iter_mut().zip(&from).rev() {
        *turn = turn_rad(state);
        state = usize::from(came[state]);
    }
    turns
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::ELLIPSE;

    fn bead(extent_mm: f64) -> Bead {
        Bead {
            heading_rad: FRAC_PI_2,
            travel_rad: 0.0,
            extent_mm,
            step_mm: 0.2,
        }
    }

    fn extent_mm(turn_rad: f64) -> f64 {
        ELLIPSE.extent_mm(FRAC_PI_2 + turn_rad, Vector2::new(0.0, 1.0))
    }

    /// Goal: beads come out as wide as asked, and the heading turns evenly between two widths. Method: a
    /// straight pass whose width goes from narrow to wide.
    #[test]
    fn beads_become_as_wide_as_asked() {
        let beads: Vec<Bead> = (0..200)
            .map(|i| bead(0.25 + 0.3 * f64::from(i) / 199.0))
            .collect();
        let turns = turns_rad(&beads, &ELLIPSE, 0.08);
        for (bead, turn) in beads.iter().zip(&turns) {
            assert!(
                (extent_mm(*turn) - bead.extent_mm).abs() < 0.02,
                "{bead:?} {turn}"
            );
        }
        let steps = turns.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(steps.fold(0.0, f64::max) < 0.05);
    }

    /// Goal: in a corner the nozzle does not whirl. Method: the travel turns at once, the plan's heading not.
    #[test]
    fn a_corner_does_not_whirl_the_nozzle() {
        let beads: Vec<Bead> = (0..100)
            .map(|i| Bead {
                heading_rad: 0.25 * FRAC_PI_2 * 2.0,
                travel_rad: if i < 50 { 0.0 } else { FRAC_PI_2 },
                ..bead(0.45)
            })
            .collect();
        let turns = turns_rad(&beads, &ELLIPSE, 0.08);
        let turned: f64 = turns.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        assert!(turned < 0.1, "{turned}");
    }

    #[test]
    fn a_round_nozzle_stays() {
        let round = Aperture::Ellipse {
            major_mm: 0.3,
            minor_mm: 0.3,
        };
        assert_eq!(turns_rad(&[bead(0.3); 9], &round, 0.08), [0.0; 9]);
    }
}

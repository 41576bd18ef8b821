//! Paths of the aperture from one placement to another inside the walls.
//!
//! In: two placements (mm, rad), the largest turn (rad), the walls. Out: placements in between at
//! steps of 0.6 b and 0.2 rad, none deeper in a wall than the allowed cut; empty if nothing fits.
//! Not covered: paths with more than one corner.

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::EdgeIndex;
use crate::plan::headings::profile::slide_inside;
use crate::plan::pass::sweep::turn_to;

/// Step of a connection, mm relative to b and rad.
const STEP_SHARE: f64 = 0.6;
const STEP_RAD: f64 = 0.2;
/// A connection may cut the wall by this share of the aperture; the finished curve is pushed off.
pub const CUT_SHARE: f64 = 1e-3;
/// Slides of one pose of a connection, and the largest slide, relative to b.
pub const SLIDES: usize = 4;
const SLIDE_SHARE: f64 = 0.8;

/// Timing of a connection: the shares of the move and of the turn that are done at a share of its
/// length.
type Shape = fn(f64) -> [f64; 2];

const BOTH: Shape = |t| [t, t];
const TURN_FIRST: Shape = |t| [(2.0 * t - 1.0).max(0.0), (2.0 * t).min(1.0)];
const MOVE_FIRST: Shape = |t| [(2.0 * t).min(1.0), (2.0 * t - 1.0).max(0.0)];

/// A straight connection inside the walls, without its start: with the shorter turn, or else in the
/// other direction, of no more than `turn_max_rad`; it turns while it moves, before or after it.
pub fn connection(
    from: Configuration,
    to: Configuration,
    turn_max_rad: f64,
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Option<Vec<Configuration>> {
    let turn = turn_to(aperture, from.heading_rad, to.heading_rad);
    let turns = [turn, turn - aperture.period_rad().copysign(turn)];
    let turns = turns.into_iter().filter(|turn| turn.abs() <= turn_max_rad);
    let mut ways = turns.flat_map(|turn| {
        let shapes = [BOTH, TURN_FIRST, MOVE_FIRST].into_iter();
        shapes.map(move |shape| shaped(from, to, turn, shape, aperture))
    });
    ways.find_map(|mut way| {
        // The end is where a bead begins, however deep that one cuts.
        let end = way.pop()?;
        let mut way = inside_connection(way, aperture, walls)?;
        way.push(end);
        Some(way)
    })
}

/// Lateral offset of a bent connection from the middle of the straight one, relative to b, the
/// least first.
const BESIDE_SHARES: [f64; 9] = [0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0, -4.0];

/// A connection like [`connection`], or else two of them in sequence that meet where there is room:
/// around a corner of the walls, or for a turn that is too large or too wide for one. Each of them
/// turns by `turn_max_rad` at most.
pub fn bent_connection(
    from: Configuration,
    to: Configuration,
    turn_max_rad: f64,
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Option<Vec<Configuration>> {
    let way = |from, to| connection(from, to, turn_max_rad, aperture, walls);
    let through = |bend| {
        let bend = slide_inside(bend, aperture, walls, SLIDES, CUT_SHARE)?;
        let mut first = way(from, bend)?;
        // The first connection may have slid its end, and has turned it in either direction.
        first.extend(way(*first.last()?, to)?);
        Some(first)
    };
    way(from, to).or_else(|| bends(from, to, aperture).find_map(through))
}

/// Where a connection may bend: at an offset from the middle of the straight one, turned half way,
/// not yet, already, or half way in the other direction.
fn bends(
    from: Configuration,
    to: Configuration,
    aperture: &Aperture,
) -> impl Iterator<Item = Configuration> {
    let turn = turn_to(aperture, from.heading_rad, to.heading_rad);
    let other = turn - aperture.period_rad().copysign(turn);
    let delta = to.center - from.center;
    let beside = Vector2::new(-delta.y, delta.x).try_normalize(1e-9);
    let beside = beside.unwrap_or(Vector2::zeros()) * aperture.minor_mm();
    let places = BESIDE_SHARES.into_iter();
    places.flat_map(move |share| {
        let turns = [0.5 * turn, 0.0, turn, 0.5 * other].into_iter();
        turns.map(move |turned| Configuration {
            center: from.center + delta * 0.5 + beside * share,
            heading_rad: from.heading_rad + turned,
        })
    })
}

/// The straight connection, without its start, in steps that begin and end small.
pub fn eased(from: Configuration, to: Configuration, aperture: &Aperture) -> Vec<Configuration> {
    let turn = turn_to(aperture, from.heading_rad, to.heading_rad);
    shaped(from, to, turn, BOTH, aperture)
}

fn shaped(
    from: Configuration,
    to: Configuration,
    turn_rad: f64,
    shape: Shape,
    aperture: &Aperture,
) -> Vec<Configuration> {
    let delta = to.center - from.center;
    let [moves, turns] = [
        delta.norm() / (STEP_SHARE * aperture.minor_mm()),
        turn_rad.abs() / STEP_RAD,
    ];
    // What is not done at the same time takes the steps of both.
    let [half, _] = shape(0.5);
    let count = if half == 0.5 {
        moves.max(turns)
    } else {
        2.0 * moves.max(turns)
    };
    let steps = count.ceil().max(2.0) as usize;
    let eased = |t: f64| 0.5 - 0.5 * (std::f64::consts::PI * t).cos();
    (1..=steps)
        .map(|step| {
            let [moved, turned] = shape(eased(step as f64 / steps as f64));
            Configuration {
                center: from.center + delta * moved,
                heading_rad: from.heading_rad + turn_rad * turned,
            }
        })
        .collect()
}

/// The connection, slid off the walls where it cuts them; `None` if that does not help, or if the
/// slide is so long that the connection would be broken.
pub fn inside_connection(
    way: Vec<Configuration>,
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Option<Vec<Configuration>> {
    let slide_max_mm = SLIDE_SHARE * aperture.minor_mm();
    way.into_iter()
        .map(|at| {
            let slid = slide_inside(at, aperture, walls, SLIDES, CUT_SHARE)?;
            ((slid.center - at.center).norm() <= slide_max_mm).then_some(slid)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;
    use crate::geometry::clearance::is_inside;
    use crate::geometry::test_shapes::{ELLIPSE as APERTURE, walls};

    fn at(x: f64, heading_rad: f64) -> Configuration {
        Configuration {
            center: Point2::new(x, 0.0),
            heading_rad,
        }
    }

    fn assert_free(way: &[Configuration], to: Configuration, walls: &EdgeIndex, slack: f64) {
        for pose in way {
            assert!(is_inside(&APERTURE, *pose, walls, slack), "{pose:?}");
        }
        let end = way[way.len() - 1];
        assert!((end.center - to.center).norm() < 1e-9);
        let turns = (end.heading_rad - to.heading_rad) / APERTURE.period_rad();
        assert!((turns - turns.round()).abs() < 1e-9);
    }

    /// Goal: a way around a corner bends, without a jump. Method: an angle of two corridors 0.9 mm
    /// wide, the aperture along either.
    #[test]
    fn a_way_bends_around_a_corner() {
        let corner = [
            [-3.0, -0.45],
            [0.45, -0.45],
            [0.45, 3.0],
            [-0.45, 3.0],
            [-0.45, 0.45],
            [-3.0, 0.45],
        ];
        let walls = walls(&[&corner]);
        let from = at(-1.0, 0.0);
        let to = Configuration {
            center: Point2::new(0.0, 1.0),
            heading_rad: std::f64::consts::FRAC_PI_2,
        };
        assert!(connection(from, to, 2.0, &APERTURE, &walls).is_none());
        let way = bent_connection(from, to, 2.0, &APERTURE, &walls).expect("a way");
        // Its poses are slid until they touch the corner.
        assert_free(&way, to, &walls, -CUT_SHARE);
        // A step of the eased way at its fastest, and what a pose may be slid.
        let step_mm = (0.5 * std::f64::consts::PI * STEP_SHARE + SLIDE_SHARE) * 0.2;
        let mut last = from;
        for pose in way {
            assert!((pose.center - last.center).norm() < step_mm, "{pose:?}");
            assert!(
                (pose.heading_rad - last.heading_rad).abs() < 0.35,
                "{pose:?}"
            );
            last = pose;
        }
    }

    /// Goal: a way ends at the very placement that it leads to, though that one cuts the walls a
    /// little and there is no room to slide it. Method: a wedge, to where 1 % of the aperture is
    /// too much.
    #[test]
    fn a_way_ends_where_a_bead_begins() {
        let walls = walls(&[&[[-2.0, -0.65], [2.0, -0.05], [2.0, 0.05], [-2.0, 0.65]]]);
        let to = at(0.886, 0.0);
        assert!(!is_inside(&APERTURE, to, &walls, -5e-3));
        assert!(slide_inside(to, &APERTURE, &walls, SLIDES, CUT_SHARE).is_none());
        let way = connection(at(-0.6, 0.0), to, 2.0, &APERTURE, &walls).expect("a way");
        let [before @ .., end] = &way[..] else {
            panic!("no end");
        };
        assert_eq!(*end, to);
        for pose in before {
            assert!(is_inside(&APERTURE, *pose, &walls, -CUT_SHARE), "{pose:?}");
        }
    }

    /// Goal: where the shorter turn passes across the walls the longer one is taken, if it may be.
    /// Method: a corridor 1 mm wide, in which 0.94 rad of heading fits; from 0.9 to -0.9 rad the
    /// shorter turn leads over 90°.
    #[test]
    fn the_longer_turn_is_taken_where_the_shorter_one_cuts() {
        let walls = walls(&[&[[-5.0, -0.5], [5.0, -0.5], [5.0, 0.5], [-5.0, 0.5]]]);
        let (from, to) = (at(0.0, 0.9), at(1.0, -0.9));
        assert!(inside_connection(eased(from, to, &APERTURE), &APERTURE, &walls).is_none());
        let way = connection(from, to, 2.0, &APERTURE, &walls).expect("a way");
        assert_free(&way, to, &walls, 2e-3);
        assert!(connection(from, to, 1.6, &APERTURE, &walls).is_none());
    }

    /// Goal: out of a room into a slot the aperture turns first, the other way moves first. Method:
    /// a room 1.4 mm high and a slot of 0.5 mm, across in the one and along in the other.
    #[test]
    fn turns_are_made_where_there_is_room() {
        let walls = walls(&[&[
            [-1.5, -0.7],
            [0.7, -0.7],
            [0.7, -0.25],
            [4.0, -0.25],
            [4.0, 0.25],
            [0.7, 0.25],
            [0.7, 0.7],
            [-1.5, 0.7],
        ]]);
        let (room, slot) = (at(0.0, std::f64::consts::FRAC_PI_2), at(1.6, 0.0));
        for (from, to) in [(room, slot), (slot, room)] {
            assert!(inside_connection(eased(from, to, &APERTURE), &APERTURE, &walls).is_none());
            let way = connection(from, to, 2.0, &APERTURE, &walls).expect("a way");
            assert_free(&way, to, &walls, 2e-3);
        }
    }
}

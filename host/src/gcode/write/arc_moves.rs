//! The motion of a move -> straight moves and arcs of the XY plane, arcs where they are fewer.
//!
//! In: the channels at every servo tick. Out: [`MoveEnd`]s. On an arc all other axes go evenly with its length:
//! unrolled (the length along it for x, the distance from it for y), a pose lies beside an arc as it lies beside a
//! straight move, within the same tolerances. The centre is the least-squares one on the perpendicular bisector of
//! the two ends, so that an arc begins and ends where the path does. Leaves out what a controller's own chords
//! are beside the arc.

use super::lines::{LineTolerances, beside, farthest, line_end, turns_evenly};
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_X, CHANNEL_Y, CHANNELS,
};
use std::f64::consts::{PI, TAU};

/// Poses that are looked at between two ends, before all of them are.
const LOOKS_MAX: usize = 128;
/// Radii: below, a corner that controllers cut; above, digits of single precision.
const RADIUS_MM: [f64; 2] = [0.05, 500.0];
/// Shorter ones are a chord to controllers anyway.
const LENGTH_MIN_MM: f64 = 0.1;
/// Longest turn of one arc: start and end stay well apart.
const SWEEP_MAX_RAD: f64 = 1.5 * PI;
/// Headings and tilts that stay within this stand still.
const STANDS_RAD: f64 = 1e-6;

/// An arc of the XY plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc {
    /// Its centre.
    pub centre_mm: [f64; 2],
    /// Its radius.
    pub radius_mm: f64,
    /// How far it turns, counter-clockwise above 0.
    pub sweep_rad: f64,
}

/// The end of a move that begins where the one before it ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoveEnd {
    /// Tick of its last pose.
    pub tick: usize,
    /// Along which arc; `None` is straight.
    pub arc: Option<Arc>,
}

impl Arc {
    /// Its length in the plane.
    pub fn length_mm(&self) -> f64 {
        self.radius_mm * self.sweep_rad.abs()
    }

    /// A pose with the length along the arc and the distance from it in the places of x and y.
    fn unrolled(&self, pose: &[f64; CHANNELS], begin_rad: f64) -> [f64; CHANNELS] {
        let arm = [
            pose[CHANNEL_X] - self.centre_mm[0],
            pose[CHANNEL_Y] - self.centre_mm[1],
        ];
        let turned_rad = self.sweep_rad.signum() * (arm[1].atan2(arm[0]) - begin_rad);
        // The turn that is nearest to the arc's middle.
        let middle_rad = 0.5 * self.sweep_rad.abs();
        let off_rad = (turned_rad - middle_rad + PI).rem_euclid(TAU) - PI;
        let mut unrolled = *pose;
        unrolled[CHANNEL_X] = self.radius_mm * (middle_rad + off_rad);
        unrolled[CHANNEL_Y] = arm[0].hypot(arm[1]) - self.radius_mm;
        unrolled
    }
}

/// Moves of the poses of every tick; `turning` where headings may turn along arcs.
pub fn moves_with_arcs(
    poses: &[[f64; CHANNELS]],
    tolerances: &LineTolerances,
    turning: bool,
) -> Vec<MoveEnd> {
    let last = poses.len().saturating_sub(1);
    let mut moves = Vec::new();
    let (mut from, mut line_known) = (0, None);
    while from < last {
        let line = line_known
            .take()
            .unwrap_or_else(|| line_end(poses, from, tolerances));
        if line == last {
            moves.push(MoveEnd {
                tick: line,
                arc: None,
            });
            break;
        }
        // An arc is taken in place of two straight moves or more.
        let second = line_end(poses, line, tolerances);
        let fits =
            |to: usize, looks: usize| fitted_arc(poses, [from, to], tolerances, turning, looks);
        let to = farthest(from, line, last, |to| fits(to, LOOKS_MAX).is_some());
        let arc = (to >= second).then(|| fits(to, usize::MAX)).flatten();
        let tick = if arc.is_some() { to } else { line };
        moves.push(MoveEnd { tick, arc });
        line_known = arc.is_none().then_some(second);
        from = tick;
    }
    moves
}

/// The arc from a pose to another that all poses between them lie beside within the tolerances.
fn fitted_arc(
    poses: &[[f64; CHANNELS]],
    [from, to]: [usize; 2],
    tolerances: &LineTolerances,
    turning: bool,
    looks_max: usize,
) -> Option<Arc> {
    let (a, b) = (&poses[from], &poses[to]);
    let turned = |channel: usize| (b[channel] - a[channel]).abs();
    let stands = |channel: usize| turned(channel) <= STANDS_RAD;
    // What reads an arc takes its heading evenly from number to number.
    let turns = |pose: &[f64; CHANNELS]| (pose[CHANNEL_HEADING] / TAU).floor();
    if !(stands(CHANNEL_TILT_X) && stands(CHANNEL_TILT_Y))
        || !(turning || stands(CHANNEL_HEADING))
        || tolerances.wrapped && turns(a) != turns(b)
        || !turns_evenly(&poses[from..=to], &tolerances.even)
    {
        return None;
    }
    let between = to - from;
    let looks = between.saturating_sub(1).min(looks_max);
    let looked = (1..=looks).map(|k| &poses[from + (k * between) / (looks + 1)]);
    let arc = arc_through(a, b, looked.clone())?;
    let arm = [
        a[CHANNEL_X] - arc.centre_mm[0],
        a[CHANNEL_Y] - arc.centre_mm[1],
    ];
    let begin_rad = arm[1].atan2(arm[0]);
    let ends = [a, b].map(|pose| arc.unrolled(pose, begin_rad));
    let [first, last] = &ends;
    let is_beside = |pose: &[f64; CHANNELS]| {
        beside(&arc.unrolled(pose, begin_rad), first, last, tolerances) <= 1.0
    };
    looked.clone().all(is_beside).then_some(arc)
}

/// The arc through two poses that is nearest to those between them.
fn arc_through<'a>(
    a: &[f64; CHANNELS],
    b: &[f64; CHANNELS],
    between: impl Iterator<Item = &'a [f64; CHANNELS]>,
) -> Option<Arc> {
    let chord = [b[CHANNEL_X] - a[CHANNEL_X], b[CHANNEL_Y] - a[CHANNEL_Y]];
    let chord_mm = chord[0].hypot(chord[1]);
    if chord_mm < 0.5 * LENGTH_MIN_MM {
        return None;
    }
    let middle = [0, 1].map(|i| 0.5 * (a[CHANNEL_X + i] + b[CHANNEL_X + i]));
    let normal = [-chord[1] / chord_mm, chord[0] / chord_mm];
    // Of a centre at middle + t normal: |q - middle|² - (chord/2)² = 2 t (q - middle) normal.
    let (mut top, mut bottom, mut side) = (0.0, 0.0, 0.0);
    for pose in between {
        let off = [pose[CHANNEL_X] - middle[0], pose[CHANNEL_Y] - middle[1]];
        let across = off[0] * normal[0] + off[1] * normal[1];
        let excess = off[0] * off[0] + off[1] * off[1] - 0.25 * chord_mm * chord_mm;
        top += excess * across;
        bottom += 2.0 * across * across;
        side += across;
    }
    let aside_mm = top / bottom;
    let radius_mm = aside_mm.hypot(0.5 * chord_mm);
    if !(RADIUS_MM[0]..=RADIUS_MM[1]).contains(&radius_mm) {
        return None;
    }
    let centre_mm = [0, 1].map(|i| middle[i] + aside_mm * normal[i]);
    let angle = |pose: &[f64; CHANNELS]| {
        (pose[CHANNEL_Y] - centre_mm[1]).atan2(pose[CHANNEL_X] - centre_mm[0])
    };
    // What passes its chord on the right turns to the left.
    let sign = if side < 0.0 { 1.0 } else { -1.0 };
    let sweep_rad = (sign * (angle(b) - angle(a))).rem_euclid(TAU);
    let arc = Arc {
        centre_mm,
        radius_mm,
        sweep_rad: sign * sweep_rad,
    };
    (sweep_rad <= SWEEP_MAX_RAD && arc.length_mm() >= LENGTH_MIN_MM).then_some(arc)
}

#[cfg(test)]
mod tests {
    //! Goal: what lies on an arc is one, what does not is not. Method: circles, helices and spirals in closed form.
    use super::*;
    use crate::gcode::write::lines::EvenHeading;

    const TOLERANCES: LineTolerances = LineTolerances {
        tip_mm: 0.002,
        turn_rad: 3e-4,
        wrapped: false,
        volume_mm3: 0.002,
        even: EvenHeading::ANY,
        long_ticks: usize::MAX,
    };

    fn along(pose: impl Fn(f64) -> [f64; CHANNELS]) -> Vec<[f64; CHANNELS]> {
        // From rest to rest.
        let eased = |i: u32| 0.5 - 0.5 * (PI * f64::from(i) / 3000.0).cos();
        (0..=3000).map(|i| pose(eased(i))).collect()
    }

    fn circle(radius_mm: f64, sweep_rad: f64, wobble_rad: f64) -> Vec<[f64; CHANNELS]> {
        along(|t| {
            let angle = 0.3 + sweep_rad * t;
            let heading = sweep_rad * t + wobble_rad * (40.0 * t).sin();
            [
                90.0 + radius_mm * angle.cos(),
                70.0 + radius_mm * angle.sin(),
                0.2 + 0.1 * t,
                0.0,
                0.0,
                heading,
                3.0 * t,
            ]
        })
    }

    #[test]
    fn circles_are_one_arc() {
        for (radius_mm, sweep_rad) in [(5.0, 2.0), (5.0, -2.0), (0.3, 4.6), (80.0, -0.4)] {
            let poses = circle(radius_mm, sweep_rad, 0.0);
            let moves = moves_with_arcs(&poses, &TOLERANCES, true);
            assert_eq!(moves.len(), 1, "{radius_mm} {sweep_rad}: {moves:?}");
            let arc = moves[0].arc.expect("an arc");
            assert!((arc.radius_mm / radius_mm - 1.0).abs() < 1e-6);
            assert!((arc.sweep_rad / sweep_rad - 1.0).abs() < 1e-6);
            assert!((arc.centre_mm[0] - 90.0).abs() < 1e-4);
            // A controller that turns nothing along an arc has straight moves.
            let straight = moves_with_arcs(&poses, &TOLERANCES, false);
            assert!(straight.len() > 5 && straight.iter().all(|end| end.arc.is_none()));
        }
        // One turn and more is several.
        let moves = moves_with_arcs(&circle(5.0, 7.0, 0.0), &TOLERANCES, true);
        assert_eq!(moves.len(), 2, "{moves:?}");
    }

    #[test]
    fn what_turns_unevenly_is_no_long_arc() {
        let poses = circle(5.0, 2.0, 0.02);
        let moves = moves_with_arcs(&poses, &TOLERANCES, true);
        assert!(moves.len() > 4, "{}", moves.len());
        let mut from = 0;
        for end in &moves {
            if end.arc.is_some() {
                let all = fitted_arc(&poses, [from, end.tick], &TOLERANCES, true, usize::MAX);
                assert_eq!(all, end.arc);
            }
            from = end.tick;
        }
        assert_eq!(from, 3000);
        // Within one turn, no arc goes through its end.
        let wrapped = LineTolerances {
            wrapped: true,
            ..TOLERANCES
        };
        let mut poses = circle(5.0, 2.0, 0.0);
        poses
            .iter_mut()
            .for_each(|pose| pose[CHANNEL_HEADING] -= 1.0);
        let mut from = 0;
        let moves = moves_with_arcs(&poses, &wrapped, true);
        assert!(moves.len() > 1);
        for end in moves {
            let headings = [from, end.tick].map(|tick| poses[tick][CHANNEL_HEADING] < 0.0);
            assert!(end.arc.is_none() || headings[0] == headings[1]);
            from = end.tick;
        }
    }

    #[test]
    fn straight_ways_and_spirals() {
        let straight = along(|t| [50.0 * t, 3.0 * t, 0.2, 0.0, 0.0, t, t]);
        let moves = moves_with_arcs(&straight, &TOLERANCES, true);
        assert_eq!(
            moves,
            [MoveEnd {
                tick: 3000,
                arc: None
            }]
        );
        // Along a spiral arcs are fewer than straight moves by far.
        let spiral = along(|t| {
            let (angle, reach) = (6.0 * t, 4.0 + 2.0 * t);
            [
                reach * angle.cos(),
                reach * angle.sin(),
                0.2,
                0.0,
                0.0,
                0.0,
                t,
            ]
        });
        let moves = moves_with_arcs(&spiral, &TOLERANCES, false);
        let lines = super::super::lines::move_ends(&spiral, &TOLERANCES);
        assert!(
            4 * moves.len() < lines.len(),
            "{} {}",
            moves.len(),
            lines.len()
        );
    }
}

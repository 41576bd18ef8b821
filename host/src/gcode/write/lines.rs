//! The motion of a move -> straight moves within a tolerance.
//!
//! In: the channels at every servo tick. Out: ends of moves in which all axes go evenly, as far apart as
//! the tolerances allow, by which ticks. Between two ends every tick's pose lies beside the move by no more
//! than the tolerances, the place along the move taken where both are nearest. Leaves out what the controller
//! makes of it: its own acceleration and corners.

use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_VOLUME, CHANNELS};
use std::f64::consts::PI;

/// An axis that goes the shorter way goes less than half a turn.
const WRAPPED_TURN_MAX_RAD: f64 = 0.95 * PI;
/// Poses that are looked at between two ends.
const LOOKS_MAX: usize = 48;

/// How far poses may lie beside a move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineTolerances {
    /// Tip, mm.
    pub tip_mm: f64,
    /// Heading and tilt, rad.
    pub turn_rad: f64,
    /// Headings are written within one turn, for axes that go the shorter way.
    pub wrapped: bool,
    /// Deposited volume, mm³.
    pub volume_mm3: f64,
    /// How evenly the heading turns.
    pub even: EvenHeading,
    /// Straight moves of more ticks than this are not longer than `LONGEST_MM`: what reads the file has a place of the
    /// motion so often, and chords lie beside it.
    pub long_ticks: usize,
}

/// Longest straight move that also takes long, mm (fitted on the examples: with 8 and 25 ms a job that is read again lies
/// within 4 µm of itself, with 10 within 5.1, with moves as long as they may be within 10, for 1 % more moves).
const LONGEST_MM: f64 = 8.0;

/// How evenly the heading turns within a move, whose mean rate is all that a controller is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvenHeading {
    /// By how much the turn of a tick may change, rad.
    pub change_rad: f64,
    /// Moves of so many ticks may turn as they do.
    pub ticks_min: usize,
}

impl EvenHeading {
    /// Any.
    pub const ANY: EvenHeading = EvenHeading {
        change_rad: f64::INFINITY,
        ticks_min: 0,
    };
}

/// Ticks at which moves end, of the poses of every tick; the first move begins at 0.
pub fn move_ends(poses: &[[f64; CHANNELS]], tolerances: &LineTolerances) -> Vec<usize> {
    let last = poses.len().saturating_sub(1);
    let mut ends = Vec::new();
    let mut from = 0;
    while from < last {
        from = line_end(poses, from, tolerances);
        ends.push(from);
    }
    ends
}

/// The tick at which the straight move from a tick ends.
pub(super) fn line_end(
    poses: &[[f64; CHANNELS]],
    from: usize,
    tolerances: &LineTolerances,
) -> usize {
    let last = poses.len().saturating_sub(1);
    farthest(from, from + 1, last, |to| {
        is_straight(poses, from, to, tolerances)
    })
}

/// The farthest good tick up to `last`, `good` being one: farther by doubling, then by halving.
pub(super) fn farthest(
    from: usize,
    mut good: usize,
    last: usize,
    is_good: impl Fn(usize) -> bool,
) -> usize {
    let mut step = 2 * (good - from);
    let mut bad = loop {
        let to = from + step;
        if to >= last {
            if is_good(last) {
                good = last;
            }
            break last;
        }
        if !is_good(to) {
            break to;
        }
        good = to;
        step *= 2;
    };
    while good < last && bad > good + 1 {
        let middle = good + (bad - good) / 2;
        match is_good(middle) {
            true => good = middle,
            false => bad = middle,
        }
    }
    good
}

fn is_straight(
    poses: &[[f64; CHANNELS]],
    from: usize,
    to: usize,
    tolerances: &LineTolerances,
) -> bool {
    let between = to - from;
    let turned_rad = (poses[to][CHANNEL_HEADING] - poses[from][CHANNEL_HEADING]).abs();
    if tolerances.wrapped && turned_rad > WRAPPED_TURN_MAX_RAD && between > 1 {
        return false;
    }
    let way_mm: [f64; 3] = std::array::from_fn(|c| poses[to][c] - poses[from][c]);
    let length_mm = way_mm.iter().map(|part| part * part).sum::<f64>().sqrt();
    let is_long = between > tolerances.long_ticks && length_mm > LONGEST_MM;
    if is_long || !turns_evenly(&poses[from..=to], &tolerances.even) {
        return false;
    }
    let looks = between.saturating_sub(1).min(LOOKS_MAX);
    (1..=looks).all(|k| {
        let at = from + (k * between) / (looks + 1);
        beside(&poses[at], &poses[from], &poses[to], tolerances) <= 1.0
    })
}

/// True where the heading turns evenly enough for one move through these poses.
pub(super) fn turns_evenly(poses: &[[f64; CHANNELS]], even: &EvenHeading) -> bool {
    if poses.len() <= even.ticks_min + 1 || even.change_rad == f64::INFINITY {
        return true;
    }
    let pairs = poses.windows(2);
    let turns = pairs.map(|pair| pair[1][CHANNEL_HEADING] - pair[0][CHANNEL_HEADING]);
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for turn in turns {
        (least, most) = (turn.min(least), turn.max(most));
    }
    most - least <= even.change_rad
}

/// How far a pose lies beside a move, against the tolerances.
pub fn beside(
    pose: &[f64; CHANNELS],
    from: &[f64; CHANNELS],
    to: &[f64; CHANNELS],
    tolerances: &LineTolerances,
) -> f64 {
    let unit = |channel: usize| match channel {
        CHANNEL_VOLUME => tolerances.volume_mm3,
        CHANNEL_TILT_X..=CHANNEL_HEADING => tolerances.turn_rad,
        _ => tolerances.tip_mm,
    };
    let way: [f64; CHANNELS] = std::array::from_fn(|c| (to[c] - from[c]) / unit(c));
    let off: [f64; CHANNELS] = std::array::from_fn(|c| (pose[c] - from[c]) / unit(c));
    // Along the tip and the turns: the volume only follows.
    let geometry = 0..CHANNEL_VOLUME;
    let dot = |a: &[f64; CHANNELS], b: &[f64; CHANNELS]| -> f64 {
        geometry.clone().map(|c| a[c] * b[c]).sum()
    };
    let share = (dot(&off, &way) / dot(&way, &way).max(1e-12)).clamp(0.0, 1.0);
    let left: [f64; CHANNELS] = std::array::from_fn(|c| off[c] - share * way[c]);
    let tip = (left[0] * left[0] + left[1] * left[1] + left[2] * left[2]).sqrt();
    let turn = left[CHANNEL_TILT_X..=CHANNEL_HEADING]
        .iter()
        .fold(0.0, |most: f64, c| most.max(c.abs()));
    tip.max(turn).max(left[CHANNEL_VOLUME].abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: no pose lies farther beside its move than allowed, and straight ways are one. Method: a
    /// straight way and a circle on which the heading turns.
    #[test]
    fn moves_keep_their_tolerance() {
        let tolerances = LineTolerances {
            tip_mm: 0.002,
            turn_rad: 3e-4,
            wrapped: false,
            volume_mm3: 0.01,
            even: EvenHeading::ANY,
            long_ticks: usize::MAX,
        };
        let straight: Vec<[f64; CHANNELS]> = (0..1000)
            .map(|i| f64::from(i) * 1e-3)
            .map(|t| [9.0 * t * t, t * t, 0.2, 0.0, 0.0, 0.5 * t * t, t * t])
            .collect();
        assert_eq!(move_ends(&straight, &tolerances), [999]);
        let circle: Vec<[f64; CHANNELS]> = (0..4000)
            .map(|i| f64::from(i) * 1e-3)
            .map(|t| {
                [
                    5.0 * t.cos(),
                    5.0 * t.sin(),
                    0.2,
                    0.0,
                    0.0,
                    t + 0.2 * t.sin(),
                    0.5 * t,
                ]
            })
            .collect();
        let ends = move_ends(&circle, &tolerances);
        let mut from = 0;
        for to in &ends {
            for pose in &circle[from..*to] {
                assert!(beside(pose, &circle[from], &circle[*to], &tolerances) <= 1.02);
            }
            from = *to;
        }
        // The chord of an arc of 5 mm with 2 µm is 0.28 mm.
        assert!((60..110).contains(&ends.len()), "{}", ends.len());
    }

    /// Goal: a move ends where the heading's rate has changed by as much as is allowed. Method: a straight way on which the
    /// heading speeds up evenly with the tip, so that one move is within all lengths.
    #[test]
    fn moves_end_where_the_heading_rate_has_changed() {
        let tolerances = LineTolerances {
            tip_mm: 0.002,
            turn_rad: 3e-4,
            wrapped: false,
            volume_mm3: 0.01,
            even: EvenHeading {
                change_rad: 1.005e-4,
                ticks_min: 8,
            },
            long_ticks: usize::MAX,
        };
        // Each tick turns by 10⁻⁶ rad more than the one before: 101 ticks a move.
        let poses: Vec<[f64; CHANNELS]> = (0..=1000)
            .map(|i| 0.5e-6 * f64::from(i * i))
            .map(|turn| [3.0 * turn, 0.0, 0.2, 0.0, 0.0, turn, 0.0])
            .collect();
        let ends = move_ends(&poses, &tolerances);
        let lengths = ends.windows(2).map(|pair| pair[1] - pair[0]);
        assert_eq!(ends[0], 101);
        assert!(
            lengths.clone().count() > 7 && lengths.clone().all(|ticks| ticks <= 101),
            "{ends:?}"
        );
        let any = LineTolerances {
            even: EvenHeading::ANY,
            ..tolerances
        };
        assert_eq!(move_ends(&poses, &any), [1000]);
    }

    /// Goal: fast straight ways have a place each [`LONGEST_MM`], slow ones are one move. Method: 95 mm evenly, in 950 ticks.
    #[test]
    fn long_moves_end_soon() {
        let of = |long_ticks| LineTolerances {
            tip_mm: 0.002,
            turn_rad: 3e-4,
            wrapped: false,
            volume_mm3: 0.01,
            even: EvenHeading::ANY,
            long_ticks,
        };
        let poses: Vec<[f64; CHANNELS]> = (0..=950)
            .map(|i| [0.1 * f64::from(i), 0.0, 0.2, 0.0, 0.0, 0.0, 0.0])
            .collect();
        let ends = move_ends(&poses, &of(50));
        assert_eq!(ends.len(), 12, "{ends:?}");
        assert_eq!(move_ends(&poses, &of(950)), [950]);
    }
}

//! Local stretching of a finished motion in time.
//!
//! In: u at servo ticks and the pieces beyond a limit. Out: the same path, slower around them. With
//! a slowness f >= 1 (time takes f times as long) speeds fall by f and accelerations by f², plus a
//! change of speed by f' where f rises and falls: the flanks are raised cosines, wider each round,
//! so that this stays below the gain. In the limit everything slows equally. Every slowed stretch
//! takes a whole number of ticks more, so the motion after it is shifted by whole ticks and fits
//! exactly as before: a change in one place adds no noise in another.

use super::check::{Piece, TICKS_AT_ONCE};
use rayon::prelude::*;

/// Flank of the first round: twice the time in which the heading builds up its acceleration.
const FLANK_TICKS: f64 = 45.0;
/// Growth of the flank from round to round.
const FLANK_GROWTH: f64 = 1.25;
/// Slowing beyond the required ratio, per round: knots are moved to whole ticks, which changes the
/// fit by about that much.
const MARGIN_PER_ROUND: f64 = 0.002;

/// Slowness f of every tick interval in `round` (from 0) for the intervals beyond a limit.
pub fn slowness(ticks: usize, pieces: &[Piece], round: usize) -> Vec<f64> {
    let mut slowness = vec![1.0f64; ticks];
    let flank_ticks = FLANK_TICKS * FLANK_GROWTH.powi(round as i32);
    let margin = 1.0 + MARGIN_PER_ROUND * (round + 1) as f64;
    for piece in pieces {
        let (speed, acceleration) = piece.slowing();
        let amount = speed.max(acceleration.sqrt()).max(1.0) * margin - 1.0;
        let from = (piece.start_tick - flank_ticks).floor().max(0.0) as usize;
        let to = ((piece.end_tick + flank_ticks).ceil().max(0.0) as usize).min(ticks);
        for (tick, value) in slowness.iter_mut().enumerate().take(to).skip(from) {
            let middle = tick as f64 + 0.5;
            let away = (piece.start_tick - middle).max(middle - piece.end_tick);
            let share = (away / flank_ticks).clamp(0.0, 1.0);
            let bump = 0.5 + 0.5 * (std::f64::consts::PI * share).cos();
            *value = value.max(1.0 + amount * bump);
        }
    }
    to_whole_ticks(&mut slowness);
    slowness
}

/// Raises every run of slowed ticks so that it takes a whole number of ticks more.
fn to_whole_ticks(slowness: &mut [f64]) {
    for run in slowness.chunk_by_mut(|a, b| (*a > 1.0) == (*b > 1.0)) {
        let added: f64 = run.iter().map(|f| f - 1.0).sum();
        if added > 0.0 {
            let factor = added.ceil() / added;
            for value in run {
                *value = 1.0 + (*value - 1.0) * factor;
            }
        }
    }
}

/// The motion with every tick interval stretched by its slowness, on whole ticks again.
pub fn stretched(u_at_tick: &[f64], slowness: &[f64]) -> Vec<f64> {
    let last = u_at_tick.len() - 1;
    let at = |tick: isize| u_at_tick[tick.clamp(0, last as isize) as usize];
    let mut ends = Vec::with_capacity(slowness.len());
    let mut end = 0.0f64;
    for factor in slowness {
        end += factor;
        // Sums of whole runs are whole but for rounding, which must not move what follows. (Most
        // are whole already, and `round` is a call on plain x86-64.)
        let is_whole = end as u64 as f64 == end;
        if *factor == 1.0 && !is_whole && (end - end.round()).abs() < 1e-6 {
            end = end.round();
        }
        ends.push(end);
    }
    let ticks = end.round().max(1.0) as usize;
    let mut stretched = vec![0.0; ticks + 1];
    let chunks = stretched.par_chunks_mut(TICKS_AT_ONCE).enumerate();
    chunks.for_each(|(chunk, stretched)| {
        let first = chunk * TICKS_AT_ONCE;
        let mut interval = ends.partition_point(|&end| end <= first as f64);
        interval = interval.min(ends.len() - 1);
        for (tick, u) in (first..).zip(stretched) {
            let wanted = tick as f64;
            while interval + 1 < ends.len() && ends[interval] <= wanted {
                interval += 1;
            }
            let before = ends[interval] - slowness[interval];
            let s = ((wanted - before) / slowness[interval]).clamp(0.0, 1.0);
            let i = interval as isize;
            *u = match s {
                0.0 => at(i),
                _ => catmull_rom([at(i - 1), at(i), at(i + 1), at(i + 2)], s),
            };
        }
    });
    stretched
}

/// Cubic through the two middle values with central slopes; kept between them, so that the path
/// never runs back.
pub fn catmull_rom(p: [f64; 4], s: f64) -> f64 {
    // Differences from the first middle value keep the digits where u is large.
    let [a, b, c] = [p[0] - p[1], p[2] - p[1], p[3] - p[1]];
    let (m0, m1) = (0.5 * (b - a), 0.5 * c);
    let (s2, s3) = (s * s, s * s * s);
    let offset = (s3 - 2.0 * s2 + s) * m0 + (3.0 * s2 - 2.0 * s3) * b + (s3 - s2) * m1;
    p[1] + offset.clamp(0.0, b.max(0.0))
}

#[cfg(test)]
mod tests {
    //! Goal: what is not slowed stays bit for bit, what is slowed slows by the amount asked, the
    //! path never runs back.
    use super::super::check::Ratios;
    use super::*;

    fn law() -> Vec<f64> {
        // A smooth start and stop over 2000 ticks.
        (0..=2000)
            .map(|k| {
                let x = f64::from(k) / 2000.0;
                100.0 * x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
            })
            .collect()
    }

    fn violation(start_tick: f64, end_tick: f64, speed: f64, acceleration: f64) -> Piece {
        Piece {
            start_tick,
            end_tick,
            ratios: Ratios {
                speed,
                acceleration,
                jerk: 0.0,
            },
        }
    }

    #[test]
    fn elsewhere_the_motion_stays_bit_for_bit() {
        let before = law();
        let pieces = [violation(400.0, 410.0, 0.9, 1.03)];
        let slowness = slowness(2000, &pieces, 0);
        let after = stretched(&before, &slowness);
        let added = after.len() - before.len();
        assert!((1..10).contains(&added), "{added}");
        assert_eq!(before[..300], after[..300]);
        assert_eq!(before[520..], after[520 + added..]);
        assert!(after.windows(2).all(|pair| pair[1] >= pair[0]));
    }

    #[test]
    fn the_place_slows_by_what_its_ratio_asks() {
        let before = law();
        let pieces = [violation(800.0, 1200.0, 1.10, 1.0)];
        let slowness = slowness(2000, &pieces, 3);
        let after = stretched(&before, &slowness);
        let fastest = |law: &[f64]| law.windows(2).map(|p| p[1] - p[0]).fold(0.0, f64::max);
        let factor = fastest(&before) / fastest(&after);
        assert!(factor > 1.10 && factor < 1.14, "{factor}");
        assert_eq!(after[after.len() - 1], 100.0);
    }

    #[test]
    fn nothing_beyond_a_limit_changes_nothing() {
        let before = law();
        assert_eq!(stretched(&before, &slowness(2000, &[], 2)), before);
    }
}

//! Local stretching of a finished motion in time.
//!
//! In: u at servo ticks and the pieces beyond a limit. Out: the same path, run slower around them.
//! With a slowness f >= 1 (time takes f times as long) speeds fall by f and accelerations by f²,
//! plus a change of speed by f' where f rises and falls: the flanks are raised cosines, wider each
//! round, so that this stays below what is gained. In the limit everything slows alike.

use super::check::{Piece, RATIO_MAX};

/// Flank of the first round: about the time in which a head stops.
const FLANK_TICKS: f64 = 80.0;
/// Growth of the flank from round to round.
const FLANK_GROWTH: f64 = 1.5;
/// Slowing beyond what the ratio asks, per round: knots are moved to whole ticks, which changes
/// the fit by about that much.
const MARGIN_PER_ROUND: f64 = 0.002;

/// Slowness f of every tick interval in `round` (from 0).
pub fn slowness(ticks: usize, pieces: &[Piece], round: usize) -> Vec<f64> {
    let mut slowness = vec![1.0f64; ticks];
    let flank_ticks = FLANK_TICKS * FLANK_GROWTH.powi(round as i32);
    let margin = 1.0 + MARGIN_PER_ROUND * (round + 1) as f64;
    for piece in pieces.iter().filter(|piece| !piece.is_kept()) {
        let by_speed = piece.ratios.speed;
        let by_acceleration = piece.ratios.acceleration.sqrt();
        let amount = by_speed.max(by_acceleration).max(RATIO_MAX) * margin - 1.0;
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
    slowness
}

/// The motion with every tick interval stretched by its slowness, on whole ticks again.
pub fn stretched(u_at_tick: &[f64], slowness: &[f64]) -> Vec<f64> {
    let last = u_at_tick.len() - 1;
    let at = |tick: isize| u_at_tick[tick.clamp(0, last as isize) as usize];
    let total: f64 = slowness.iter().sum();
    let ticks = total.ceil().max(1.0);
    let scale = total / ticks;
    let (mut interval, mut before) = (0, 0.0);
    (0..=ticks as usize)
        .map(|tick| {
            let wanted = tick as f64 * scale;
            while interval + 1 < slowness.len() && before + slowness[interval] < wanted {
                before += slowness[interval];
                interval += 1;
            }
            let s = ((wanted - before) / slowness[interval]).clamp(0.0, 1.0);
            let i = interval as isize;
            catmull_rom([at(i - 1), at(i), at(i + 1), at(i + 2)], s)
        })
        .collect()
}

/// Cubic through the two middle values with central slopes; kept between them, so that the path
/// never runs back.
fn catmull_rom(p: [f64; 4], s: f64) -> f64 {
    // Differences from the first middle value keep the digits where u is large.
    let [a, b, c] = [p[0] - p[1], p[2] - p[1], p[3] - p[1]];
    let (m0, m1) = (0.5 * (b - a), 0.5 * c);
    let (s2, s3) = (s * s, s * s * s);
    let offset = (s3 - 2.0 * s2 + s) * m0 + (3.0 * s2 - 2.0 * s3) * b + (s3 - s2) * m1;
    p[1] + offset.clamp(0.0, b.max(0.0))
}

//! The best profile over bins of heading, exactly: dynamic programming (Viterbi) along the run.
//!
//! In: for each contact the cost of each bin (mm²), the cost of a turn between neighbours. Out: a
//! bin for each contact, and unwrapped headings (rad). Source: A. Viterbi (1967); R. Bellman
//! (1957). Not covered: headings between bins (`refine`).

/// Largest turn from one contact to the next, bins.
const TURN_BINS_MAX: usize = 12;

/// Best bin of each contact; `steps` are the slacks for turning between two of them
/// ([`super::turn_slacks_per_mm`]), `start` fixes the first and last bin of a closed run.
pub fn viterbi(
    costs: &[Vec<f32>],
    steps: &[f64],
    bin_rad: f64,
    start: Option<usize>,
) -> Vec<usize> {
    let bins = costs[0].len();
    let reach = TURN_BINS_MAX.min(bins / 2);
    let mut from: Vec<Vec<u16>> = Vec::with_capacity(costs.len());
    let mut total: Vec<f32> = costs[0].clone();
    if let Some(s) = start {
        for (bin, value) in total.iter_mut().enumerate() {
            if bin != s {
                *value = f32::INFINITY;
            }
        }
    }
    from.push(vec![0; bins]);
    for i in 1..costs.len() {
        let (next, best) = viterbi_step(&total, &costs[i], steps[i - 1], bin_rad, reach);
        total = next;
        from.push(best);
    }
    let last = match start {
        Some(s) if costs.len() > 1 => {
            let (closing, best) = viterbi_step(
                &total,
                &vec![0.0; bins],
                steps[costs.len() - 1],
                bin_rad,
                reach,
            );
            if closing[s].is_finite() {
                best[s] as usize
            } else {
                argmin(&total)
            }
        }
        _ => argmin(&total),
    };
    let mut chosen = vec![last; costs.len()];
    for i in (1..costs.len()).rev() {
        chosen[i - 1] = from[i][chosen[i]] as usize;
    }
    chosen
}

fn viterbi_step(
    total: &[f32],
    costs: &[f32],
    slack_per_mm: f64,
    bin_rad: f64,
    reach: usize,
) -> (Vec<f32>, Vec<u16>) {
    let bins = total.len();
    // Counted from the least, so that f32 does not drown small differences on long runs.
    let least = total.iter().copied().fold(f32::INFINITY, f32::min);
    // Once around and on by the reach at both ends: turns need no test for the end of the circle.
    let around: Vec<f32> = total[bins - reach..]
        .iter()
        .chain(total)
        .chain(&total[..reach])
        .map(|total| total - least)
        .collect();
    let mut next = vec![f32::INFINITY; bins];
    // The best turn, in bins beyond the largest one back.
    let mut best = vec![0u16; bins];
    for n in 0..=reach {
        let cost = ((n as f64 * bin_rad).powi(2) / slack_per_mm) as f32;
        for from in [reach + n, reach - n] {
            let others = &around[from..from + bins];
            for ((next, best), other) in next.iter_mut().zip(&mut best).zip(others) {
                let found = other + cost;
                let is_less = found < *next;
                *next = if is_less { found } else { *next };
                *best = if is_less { from as u16 } else { *best };
            }
        }
    }
    for (bin, (best, (next, cost))) in best.iter_mut().zip(next.iter_mut().zip(costs)).enumerate() {
        // Where nothing was found, bin 0 as good as any.
        *best = if next.is_finite() {
            ((bin + *best as usize + bins - reach) % bins) as u16
        } else {
            0
        };
        *next += cost;
    }
    (next, best)
}

/// The bin in which a closed run should start: it follows one and a half laps and uses the middle.
pub fn closed_start(costs: &[Vec<f32>], steps: &[f64], bin_rad: f64) -> Option<usize> {
    let count = costs.len();
    let tail = (count / 2).min(400);
    let order: Vec<usize> = (count - tail..count)
        .chain(0..(tail + 1).min(count))
        .collect();
    let lap: Vec<Vec<f32>> = order.iter().map(|&i| costs[i].clone()).collect();
    let lap_steps: Vec<f64> = order.iter().map(|&i| steps[i]).collect();
    let chosen = viterbi(&lap, &lap_steps, bin_rad, None);
    chosen.get(tail).copied()
}

fn argmin(values: &[f32]) -> usize {
    (0..values.len()).fold(0, |best, i| if values[i] < values[best] { i } else { best })
}

/// Bins to unwrapped angles, each step in the shorter direction.
pub fn unwrap_bins(chosen: &[usize], bins: usize, bin_rad: f64) -> Vec<f64> {
    let mut headings = Vec::with_capacity(chosen.len());
    let mut last = chosen[0] as i64;
    let bins = bins as i64;
    for &bin in chosen {
        let mut delta = (bin as i64 - last).rem_euclid(bins);
        if delta > bins / 2 {
            delta -= bins;
        }
        last += delta;
        headings.push(last as f64 * bin_rad);
    }
    headings
}

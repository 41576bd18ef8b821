//! Speeds of blocks with which a controller takes as long as the job.
//!
//! In: blocks from rest to rest with the job's seconds, blends and corners. Out: their speeds. A controller goes a block at the
//! speed that it is told and speeds up or slows down beside it; told the mean speed of each, it would lose time at every
//! change. So the run is followed as controllers do (the speed at a corner by the circle of the blend, and what can be reached
//! from rest to rest with the plan's acceleration, forward and backward), and each speed raised by what its block lasts too
//! long, at most to the greatest that the job has there. Not covered: jerk, joints.

use super::walk::Block;

/// Rounds: what a block gains moves to its neighbours.
const ROUNDS: usize = 6;

/// Sets the speeds of blocks from rest to rest.
pub(super) fn pace(blocks: &mut [Block], acceleration_mm_s2: f64) {
    for _ in 0..ROUNDS {
        let lasting = lasting_s(blocks, acceleration_mm_s2);
        for (block, lasts_s) in blocks.iter_mut().zip(lasting) {
            let raised = block.speed_mm_s * lasts_s / block.seconds;
            let mean_mm_s = block.length_mm / block.seconds;
            block.speed_mm_s = raised.min(block.peak_mm_s).max(mean_mm_s);
        }
    }
    let lasting = lasting_s(blocks, acceleration_mm_s2);
    for (block, lasts_s) in blocks.iter_mut().zip(lasting) {
        block.lasts_s = lasts_s;
    }
}

/// How long the blocks last with their speeds, s.
fn lasting_s(blocks: &[Block], acceleration_mm_s2: f64) -> Vec<f64> {
    let mut entry = 0.0;
    let corners = corner_speeds(blocks, acceleration_mm_s2);
    let lasting = blocks.iter().zip(corners).map(|(block, exit)| {
        let ends = [std::mem::replace(&mut entry, exit), exit];
        seconds(block, ends, acceleration_mm_s2)
    });
    lasting.collect()
}

/// The speed at the end of each block.
fn corner_speeds(blocks: &[Block], acceleration_mm_s2: f64) -> Vec<f64> {
    let reached = |speed: f64, block: &Block| {
        (speed * speed + 2.0 * acceleration_mm_s2 * block.length_mm).sqrt()
    };
    let mut speeds: Vec<f64> = (blocks.windows(2))
        .map(|pair| {
            let [block, next] = [&pair[0], &pair[1]];
            if block.is_turn() || next.is_turn() || block.blend_mm <= 0.0 {
                return 0.0;
            }
            let radius_mm = block.blend_mm / (0.5 * block.corner_rad).tan().max(1e-9);
            let round = (acceleration_mm_s2 * radius_mm).sqrt();
            round.min(block.speed_mm_s).min(next.speed_mm_s)
        })
        .chain([0.0])
        .collect();
    for number in (1..blocks.len()).rev() {
        speeds[number - 1] = speeds[number - 1].min(reached(speeds[number], &blocks[number]));
    }
    let mut entry = 0.0;
    for (speed, block) in speeds.iter_mut().zip(blocks) {
        *speed = speed.min(reached(entry, block));
        entry = *speed;
    }
    speeds
}

/// Time of a block between two speeds.
fn seconds(block: &Block, [entry, exit]: [f64; 2], acceleration_mm_s2: f64) -> f64 {
    if block.is_turn() {
        return block.seconds;
    }
    let squares = 0.5 * (entry * entry + exit * exit);
    let meeting = (squares + acceleration_mm_s2 * block.length_mm).sqrt();
    let peak = meeting.min(block.speed_mm_s).max(entry).max(exit);
    let ramps_mm = (peak * peak - squares) / acceleration_mm_s2;
    let ramps_s = (2.0 * peak - entry - exit) / acceleration_mm_s2;
    ramps_s + (block.length_mm - ramps_mm).max(0.0) / peak
}

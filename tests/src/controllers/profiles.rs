//! Straight moves with one acceleration each -> their speeds: the look-ahead that all but machine tools share.
//!
//! In: [`Block`]s from rest to rest. Out: [`Profile`]s: each block enters as fast as its junction, the blocks before it
//! (accelerating) and those after it in the buffer (braking to rest at its end) allow, and has a trapezoid between.

use super::AXES;

/// A move.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// In the controller's measure of this move.
    pub length: f64,
    /// Of each axis for a unit of length.
    pub direction: [f64; AXES],
    /// Most of the length a second.
    pub speed_max: f64,
    /// Of the length.
    pub acceleration: f64,
    /// Fastest start by its junction.
    pub entry_max: f64,
    /// What limits that.
    pub entry_by: &'static str,
}

/// Speeds along a block's length.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Profile {
    /// At its start.
    pub entry: f64,
    /// At its fastest.
    pub peak: f64,
    /// At its end.
    pub exit: f64,
    /// It lasts so long.
    pub seconds: f64,
}

/// Profiles of blocks of which `buffer` are known ahead.
pub fn look_ahead(blocks: &[Block], buffer: usize) -> Vec<Profile> {
    let reach = |speed: f64, block: &Block| {
        (speed * speed + 2.0 * block.acceleration * block.length).sqrt()
    };
    // Fastest entries that still brake to rest at the end of what is known when the block is entered.
    let entry_known = |i: usize| {
        let known = &blocks[i..(i + buffer).min(blocks.len())];
        known
            .iter()
            .rev()
            .fold(0.0, |exit, block| reach(exit, block).min(block.entry_max))
    };
    let mut entries: Vec<f64> = match buffer >= blocks.len() {
        false => (0..blocks.len()).map(entry_known).collect(),
        true => {
            let back = blocks.iter().rev().scan(0.0, |exit, block| {
                *exit = reach(*exit, block).min(block.entry_max);
                Some(*exit)
            });
            let mut entries: Vec<f64> = back.collect();
            entries.reverse();
            entries
        }
    };
    entries.push(0.0);
    let mut speed = 0.0f64;
    let mut profiles = Vec::new();
    for (block, next) in blocks.iter().zip(&entries[1..]) {
        let exit = reach(speed, block).min(*next);
        profiles.push(trapezoid(block, speed, exit));
        speed = exit;
    }
    profiles
}

/// The trapezoid between two speeds.
pub fn trapezoid(block: &Block, entry: f64, exit: f64) -> Profile {
    let meeting = (0.5 * (entry * entry + exit * exit) + block.acceleration * block.length).sqrt();
    let peak = meeting.min(block.speed_max).max(entry).max(exit);
    let up = (peak * peak - entry * entry) / (2.0 * block.acceleration);
    let down = (peak * peak - exit * exit) / (2.0 * block.acceleration);
    let cruise = (block.length - up - down).max(0.0);
    let seconds = (2.0 * peak - entry - exit) / block.acceleration + cruise / peak;
    Profile {
        entry,
        peak,
        exit,
        seconds,
    }
}

/// Most of rising times in half a second, a second.
pub fn most_a_second(times_s: &[f64]) -> f64 {
    const WINDOW_S: f64 = 0.5;
    let mut from = 0;
    let mut most = 0;
    for (to, time_s) in times_s.iter().enumerate() {
        while times_s[from] < time_s - WINDOW_S {
            from += 1;
        }
        most = most.max(to + 1 - from);
    }
    most as f64 / WINDOW_S
}

#[cfg(test)]
mod tests {
    //! Goal: times of one, two and many moves by hand.
    use super::*;

    fn block(length: f64, speed_max: f64, entry_max: f64) -> Block {
        let mut direction = [0.0; AXES];
        direction[0] = 1.0;
        Block {
            length,
            direction,
            speed_max,
            acceleration: 1000.0,
            entry_max,
            entry_by: "junction",
        }
    }

    #[test]
    fn trapezoids_by_hand() {
        // 10 mm at 50 mm/s and 1000 mm/s²: 0.05 s up and 1.25 mm, as much down, 7.5 mm in 0.15 s.
        let one = look_ahead(&[block(10.0, 50.0, 0.0)], 16);
        assert!((one[0].seconds - 0.25).abs() < 1e-12, "{one:?}");
        // 1 mm does not reach it: peak sqrt(1000) mm/s, 2 sqrt(1 / 1000) s.
        let short = look_ahead(&[block(1.0, 50.0, 0.0)], 16);
        assert!((short[0].peak - 1000.0f64.sqrt()).abs() < 1e-9);
        assert!((short[0].seconds - 2.0 * 1e-3f64.sqrt()).abs() < 1e-12);
        // Ten pieces of it, free at their ends, are the same move; with two blocks known they brake early.
        let pieces = vec![block(0.1, 50.0, 50.0); 10];
        let total = |buffer| {
            look_ahead(&pieces, buffer)
                .iter()
                .map(|p| p.seconds)
                .sum::<f64>()
        };
        assert!((total(16) - short[0].seconds).abs() < 1e-9);
        // Two known: 20 mm/s at the ends of the middle ones, sqrt(500) in them; 0.02 s up to 20 mm/s and down.
        let by_hand = 0.04 + 6.0 * 2.0 * (500.0f64.sqrt() - 20.0) / 1000.0;
        assert!((total(2) - by_hand).abs() < 1e-9, "{} {by_hand}", total(2));
    }

    #[test]
    fn corners_slow_down() {
        // Two moves of 10 mm with 10 mm/s between: each 0.05 + 0.04 s of change, 2 * 1.25 - 0.05 mm of way.
        let corner = [block(10.0, 50.0, 0.0), block(10.0, 50.0, 10.0)];
        let total: f64 = look_ahead(&corner, 16).iter().map(|p| p.seconds).sum();
        let each = 0.05 + 0.04 + (10.0 - 1.25 - 1.2) / 50.0;
        assert!((total - 2.0 * each).abs() < 1e-12, "{total}");
    }
}

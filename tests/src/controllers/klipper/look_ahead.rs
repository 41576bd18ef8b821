//! Klipper's look-ahead: junctions, and speeds between rests.
//!
//! In: moves with their limits. Out: profiles. Speeds are squared in between, as Klipper keeps them.

use super::super::profiles::{Block, Profile, trapezoid};
use super::super::{EXTRUDER, Planned};

/// A move as Klipper's look-ahead has it.
#[derive(Clone, Debug)]
pub(super) struct Move {
    pub(super) planned: Planned,
    pub(super) kinematic: bool,
    /// Corner velocities of further axes where it begins.
    pub(super) start_max2: f64,
    pub(super) cruise_accel: f64,
}

impl Move {
    /// The fastest start behind another move, squared.
    pub(super) fn join(&mut self, before: &Move, deviation: f64, corners: &[(usize, f64)]) {
        if !self.kinematic || !before.kinematic {
            return;
        }
        let (own, other) = (&self.planned.block, &before.planned.block);
        let mut limits = vec![("speed", own.speed_max.min(other.speed_max).powi(2))];
        for (axis, corner) in corners {
            let step = (own.direction[*axis] - other.direction[*axis]).abs();
            let name = if *axis == EXTRUDER {
                "extruder's corner"
            } else {
                "heading's corner"
            };
            if step > 0.0 {
                limits.push((name, (corner / step).powi(2)));
            }
        }
        let dot: f64 = (0..3).map(|i| own.direction[i] * other.direction[i]).sum();
        let half_sin = (0.5 * (1.0 + dot)).max(0.0).sqrt();
        let half_cos = (0.5 * (1.0 - dot)).max(0.0).sqrt();
        if half_sin < 1.0 && half_cos > 0.0 {
            let radius = deviation * half_sin / (1.0 - half_sin);
            let quarter_tan = 0.25 * half_sin / half_cos;
            let centripetal = |block: &Block| 2.0 * block.length * block.acceleration * quarter_tan;
            limits.push((
                "square corner",
                radius * own.acceleration.min(other.acceleration),
            ));
            limits.push(("centripetal", centripetal(own).min(centripetal(other))));
        }
        let least = limits.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
        let (by, start_max2) = least.expect("the speed is one");
        self.start_max2 = start_max2;
        self.planned.block.entry_by = by;
        self.planned.block.entry_max = start_max2.sqrt();
    }
}

/// Klipper's look-ahead over moves from rest to rest, backwards and forwards.
pub(super) fn flushed(moves: &[Move]) -> Vec<Profile> {
    // Fastest starts by what comes before, as `calc_junction` has them.
    let (mut start2, mut smooth2) = (Vec::new(), Vec::new());
    let change2 = |of: &Move| 2.0 * of.planned.block.length * of.planned.block.acceleration;
    let smooth_change2 =
        |of: &Move| change2(of).min(2.0 * of.planned.block.length * of.cruise_accel);
    for (i, of) in moves.iter().enumerate() {
        let [reached2, smooth_reached2]: [f64; 2] = match i.checked_sub(1) {
            None => [0.0; 2],
            Some(k) => [
                start2[k] + change2(&moves[k]),
                smooth2[k] + smooth_change2(&moves[k]),
            ],
        };
        start2.push(reached2.min(of.start_max2));
        smooth2.push(smooth_reached2.min(start2[i]));
    }
    let (mut next2, mut next_smooth2, mut peak2) = (0.0f64, 0.0f64, 0.0f64);
    let mut pending = 0;
    let mut planned = vec![(0.0, None, 0.0); moves.len()];
    for (i, of) in moves.iter().enumerate().rev() {
        let reachable2 = next2 + change2(of);
        let entry2 = start2[i].min(reachable2);
        let reach_smooth2 = next_smooth2 + smooth_change2(of);
        let entry_smooth2 = smooth2[i].min(reach_smooth2);
        let mut cruise2 = None;
        pending += 1;
        if entry_smooth2 < reach_smooth2 {
            if entry_smooth2 + smooth_change2(of) > next_smooth2 || pending > 1 {
                peak2 = 0.5 * (entry_smooth2 + reach_smooth2);
            }
            let cruise = 0.5 * (entry2 + reachable2);
            cruise2 = Some(cruise.min(of.planned.block.speed_max.powi(2)).min(peak2));
            pending = 0;
        }
        planned[i] = (entry2, cruise2, next2);
        (next2, next_smooth2) = (entry2, entry_smooth2);
    }
    let mut before2 = 0.0f64;
    let profile = |(of, (entry2, cruise2, exit2)): (&Move, &(f64, Option<f64>, f64))| {
        // What cannot accelerate goes on as fast as the move before it cruised.
        let cruise2 = cruise2.unwrap_or(before2.min(*entry2));
        before2 = cruise2;
        let block = Block {
            speed_max: cruise2.sqrt(),
            ..of.planned.block.clone()
        };
        trapezoid(
            &block,
            entry2.min(cruise2).sqrt(),
            exit2.min(cruise2).sqrt(),
        )
    };
    moves.iter().zip(&planned).map(profile).collect()
}

//! Heights of beads that no comment tells.
//!
//! In: passes with their layers, mm. Out: heights of their legs: from the highest level below that earlier
//! layers of the same object have, the bed at first; of a vase, whose one pass climbs, from the turn below.
//! Leaves out what lies below a single place: a bridge is as high as its layer.

use super::LAYER_MM;
use crate::gcode::GcodePass;
use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};

/// Heights of a layer that are believed, mm.
const HEIGHTS_MM: [f64; 2] = [0.01, 10.0];
/// A pass that climbs goes round so often.
const TURNS_MIN: f64 = 1.5;

fn top_mm(pass: &GcodePass) -> f64 {
    let heights = pass.points.iter().map(|point| point.tip_mm[2]);
    heights.fold(f64::NEG_INFINITY, f64::max)
}

fn um(mm: f64) -> i64 {
    (mm * 1e3).round() as i64
}

/// Adds heights; returns how many layers begin within passes that climb.
pub fn add_heights(passes: &mut [GcodePass]) -> u32 {
    let mut levels_um: BTreeSet<i64> = BTreeSet::new();
    let mut below_mm = f64::NEG_INFINITY;
    let mut turns = 0;
    for of_layer in passes.chunk_by_mut(|a, b| a.layer == b.layer) {
        let tops_mm: Vec<f64> = of_layer.iter().map(top_mm).collect();
        let layer_top_mm = tops_mm.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if layer_top_mm < below_mm - LAYER_MM {
            // The next object begins at the bed.
            levels_um.clear();
        }
        for (pass, top_mm) in of_layer.iter_mut().zip(&tops_mm) {
            if let Some(climb) = climb_mm(pass) {
                turns += climb.turns;
                for (leg, height_mm) in pass.legs.iter_mut().zip(climb.heights_mm) {
                    leg.height_mm = leg.height_mm.or(believed(height_mm));
                }
                continue;
            }
            let lower = levels_um.range(..um(*top_mm - LAYER_MM)).next_back();
            let lower_mm = lower.map_or(0.0, |um| *um as f64 / 1e3);
            let height_mm = believed(top_mm - lower_mm);
            for leg in &mut pass.legs {
                leg.height_mm = leg.height_mm.or(height_mm);
            }
        }
        levels_um.extend(tops_mm.iter().map(|mm| um(*mm)));
        below_mm = layer_top_mm;
    }
    turns
}

fn believed(height_mm: f64) -> Option<f64> {
    let is_believed = (HEIGHTS_MM[0]..=HEIGHTS_MM[1]).contains(&height_mm);
    is_believed.then_some((height_mm * 1e6).round() / 1e6)
}

struct Climb {
    turns: u32,
    /// Of each leg.
    heights_mm: Vec<f64>,
}

/// A pass that goes round and up, by the turn below each leg; `None` for all others.
fn climb_mm(pass: &GcodePass) -> Option<Climb> {
    let points = &pass.points;
    let z_mm: Vec<f64> = points.iter().map(|point| point.tip_mm[2]).collect();
    let (first, last) = (z_mm.first()?, z_mm.last()?);
    let climbs = z_mm.windows(2).all(|pair| pair[1] >= pair[0] - LAYER_MM);
    if !climbs || last - first < 2.0 * LAYER_MM {
        return None;
    }
    let count = points.len() as f64;
    let middle = [0, 1].map(|c: usize| points.iter().map(|p| p.tip_mm[c]).sum::<f64>() / count);
    // Angle about the middle, counted on.
    let mut angles_rad = vec![0.0];
    let bearing = |i: usize| {
        let tip_mm = points[i].tip_mm;
        f64::atan2(tip_mm[1] - middle[1], tip_mm[0] - middle[0])
    };
    for i in 1..points.len() {
        let turn_rad = (bearing(i) - bearing(i - 1) + PI).rem_euclid(TAU) - PI;
        angles_rad.push(angles_rad[i - 1] + turn_rad);
    }
    let turns = angles_rad.last()?.abs() / TAU;
    if turns < TURNS_MIN {
        return None;
    }
    let mean_mm = (last - first) / turns;
    let mut below = 0;
    let mut heights_mm = Vec::with_capacity(pass.legs.len());
    for i in 1..points.len() {
        let wanted_rad = angles_rad[i].abs() - TAU;
        while below + 1 < i && angles_rad[below + 1].abs() <= wanted_rad {
            below += 1;
        }
        heights_mm.push(match wanted_rad >= 0.0 {
            true => z_mm[i] - height_at(&angles_rad, &z_mm, below, wanted_rad),
            false => mean_mm,
        });
    }
    Some(Climb {
        turns: (turns.ceil() as u32).saturating_sub(1),
        heights_mm,
    })
}

/// Height of the path where it has come round so far, between two of its points.
fn height_at(angles_rad: &[f64], z_mm: &[f64], below: usize, wanted_rad: f64) -> f64 {
    let [from, to] = [below, below + 1].map(|i| angles_rad[i].abs());
    let share = ((wanted_rad - from) / (to - from).max(1e-12)).clamp(0.0, 1.0);
    z_mm[below] + share * (z_mm[below + 1] - z_mm[below])
}

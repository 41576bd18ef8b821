//! What the beads laid so far really cover, as the outer wall of the next channel.
//!
//! A bead misses the inner wall of its channel where it cannot be wide enough (the way across a
//! corner is longer) or where its heading lags. If the next channel started from the level curve
//! all the same, that miss would stay as a gap or an overlap. So its wall is moved onto the edge of
//! what was swept, while its own inner wall stays the level curve: errors are handed on once and
//! corrected, never piled up, and the jitter of one bead is not amplified by the next.

use super::contacts::{Contact, resampled};
use super::heading_profile::Placement;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::Ring;
use crate::geometry::{Point2, Vector2};
use std::collections::HashMap;

/// Step between interpolated poses, mm against the minor semi-axis: the scallop left on the
/// sharpest end of an ellipse of 3 : 1 is then below 1 % of b.
const POSE_STEP: f64 = 0.15;
/// Largest turn between interpolated poses, rad.
const POSE_TURN_RAD: f64 = 0.05;
/// Most poses put between two placements.
const POSES_MAX: usize = 64;
/// How far a wall moves out where the bead before fell short, against the major semi-axis.
const OUT_SHARE: f64 = 0.8;
/// How far it moves in where that bead reached too far.
const IN_SHARE: f64 = 0.8;
/// A chord whose middle lies further in than this (times b) belongs to a bead of the other side.
const OWN_SIDE_SHARE: f64 = 0.25;
/// Path to each side of a contact whose poses belong to the same bead, against a.
const OWN_SHARE: f64 = 2.5;
/// Rounds of [1 2 1] / 4 over the shifts and over the moved wall.
const SHIFT_ROUNDS: usize = 2;

/// The apertures of all beads laid so far, hashed by place.
#[derive(Clone, Debug)]
pub struct Laid {
    aperture: Aperture,
    cell_mm: f64,
    cells: HashMap<(i32, i32), Vec<Pose>>,
}

/// A pose of the sweep, with the run and the place in it that it comes from.
#[derive(Clone, Copy, Debug)]
struct Pose {
    at: Configuration,
    run: u32,
    index: u32,
}

impl Laid {
    /// Nothing laid yet.
    pub fn new(aperture: &Aperture) -> Laid {
        Laid {
            aperture: *aperture,
            cell_mm: aperture.reach_mm(),
            cells: HashMap::new(),
        }
    }

    fn cell_of(&self, p: Point2) -> (i32, i32) {
        // Saturating casts: coordinates far off the grid share a cell, which is slow, not wrong.
        (
            (p.x / self.cell_mm).floor() as i32,
            (p.y / self.cell_mm).floor() as i32,
        )
    }

    fn push(&mut self, at: Configuration, run: u32, index: usize) {
        let pose = Pose {
            at,
            run,
            index: index as u32,
        };
        self.cells
            .entry(self.cell_of(at.center))
            .or_default()
            .push(pose);
    }

    /// Adds run number `run`, with poses between its placements so dense that their union is the
    /// sweep.
    pub fn add(&mut self, run: u32, placements: &[Placement], closed: bool) {
        let count = placements.len();
        for i in 0..count {
            let own = placements[i].at;
            self.push(own, run, i);
            let next = match i + 1 {
                n if n < count => placements[n].at,
                _ if closed => placements[0].at,
                _ => continue,
            };
            for at in poses_between(&self.aperture, own, next) {
                self.push(at, run, i);
            }
        }
    }

    /// Visits the chords that the poses near `p` cut from the line along `normal`: least and
    /// largest distance along it, mm.
    fn for_chords(&self, p: Point2, normal: Vector2, mut visit: impl FnMut(&Pose, [f64; 2])) {
        let (column, row) = self.cell_of(p);
        for (dr, dc) in (-2..=2).flat_map(|dr| (-2..=2).map(move |dc| (dr, dc))) {
            for pose in self
                .cells
                .get(&(column + dc, row + dr))
                .into_iter()
                .flatten()
            {
                let offset = p - pose.at.center;
                if let Some(chord) = self.aperture.chord_mm(pose.at.heading_rad, offset, normal) {
                    visit(pose, chord);
                }
            }
        }
    }

    /// How far along `normal` from `p` the beads on the outer side reach, mm; `None` where none
    /// meets the line.
    pub fn edge_mm(&self, p: Point2, normal: Vector2) -> Option<f64> {
        let own_side = OWN_SIDE_SHARE * self.aperture.minor_mm();
        let mut edge: Option<f64> = None;
        self.for_chords(p, normal, |_, [from, to]| {
            if 0.5 * (from + to) < own_side && from < own_side {
                edge = Some(edge.map_or(to, |e| e.max(to)));
            }
        });
        edge
    }

    /// The gap (negative: overlap) along the contact's normal between the bead of run `run` around
    /// placement `index` of `count` and whatever lies on the other side of it; `None` where either
    /// is missing.
    pub fn facing_gap_mm(
        &self,
        contact: &Contact,
        run: u32,
        index: usize,
        count: usize,
        closed: bool,
    ) -> Option<f64> {
        let reach = OWN_SHARE * self.aperture.major_mm() / contact.length_mm.max(0.01);
        let mut own: Option<f64> = None;
        let mut others: Vec<[f64; 2]> = Vec::new();
        self.for_chords(contact.point, contact.normal, |pose, chord| {
            let is_own = pose.run == run && {
                let apart = (pose.index as usize).abs_diff(index);
                let around = if closed {
                    count - apart.min(count)
                } else {
                    count
                };
                apart.min(around) as f64 <= reach
            };
            if is_own {
                own = Some(own.map_or(chord[1], |e: f64| e.max(chord[1])));
            } else {
                others.push(chord);
            }
        });
        let own = own?;
        others
            .into_iter()
            .filter(|c| 0.5 * (c[0] + c[1]) > 0.7 * own && c[0] > 0.0)
            .map(|c| c[0] - own)
            .min_by(f64::total_cmp)
    }

    /// The level curve moved onto the edge of what was laid; at most `OUT_SHARE` and `IN_SHARE` of
    /// the aperture away.
    pub fn moved_wall(&self, ring: &Ring, step_mm: f64) -> Ring {
        let points = &ring.points;
        let count = points.len();
        if count < 8 {
            return ring.clone();
        }
        let a = self.aperture.major_mm();
        let normals: Vec<Vector2> = (0..count)
            .map(|i| {
                let along = points[(i + 2) % count] - points[(i + count - 2) % count];
                Vector2::new(-along.y, along.x)
                    .try_normalize(1e-12)
                    .unwrap_or(Vector2::zeros())
            })
            .collect();
        let mut shifts: Vec<f64> = (0..count)
            .map(|i| {
                self.edge_mm(points[i], normals[i])
                    .unwrap_or(-OUT_SHARE * a)
                    .clamp(-OUT_SHARE * a, IN_SHARE * a)
            })
            .collect();
        for _ in 0..SHIFT_ROUNDS {
            shifts = (0..count)
                .map(|i| {
                    (shifts[(i + count - 1) % count] + 2.0 * shifts[i] + shifts[(i + 1) % count])
                        / 4.0
                })
                .collect();
        }
        let moved = Ring {
            points: (0..count)
                .map(|i| points[i] + normals[i] * shifts[i])
                .collect(),
        };
        resampled(&moved, step_mm, SHIFT_ROUNDS)
    }
}

/// Poses between two placements, both left out, so dense that their union is the sweep.
pub fn poses_between(
    aperture: &Aperture,
    from: Configuration,
    to: Configuration,
) -> impl Iterator<Item = Configuration> + use<> {
    let turn = turn_to(aperture, from.heading_rad, to.heading_rad);
    let delta = to.center - from.center;
    let pieces = (delta.norm() / (POSE_STEP * aperture.minor_mm()))
        .max(turn.abs() / POSE_TURN_RAD)
        .ceil()
        .clamp(1.0, POSES_MAX as f64) as usize;
    (1..pieces).map(move |piece| {
        let t = piece as f64 / pieces as f64;
        Configuration {
            center: from.center + delta * t,
            heading_rad: from.heading_rad + turn * t,
        }
    })
}

/// The turn from one heading to the next: the shorter way round for a symmetric aperture.
pub fn turn_to(aperture: &Aperture, from_rad: f64, to_rad: f64) -> f64 {
    if aperture.is_round() {
        return 0.0;
    }
    aperture.wrapped_rad(to_rad - from_rad)
}

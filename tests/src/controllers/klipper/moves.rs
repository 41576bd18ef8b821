//! Klipper's moves: how long, how fast, and whether they are taken at all.
//!
//! In: where X Y Z E and the registered steppers go. Out: moves for the look-ahead, each within what the toolhead, Z, the
//! extruder and the steppers allow.

use super::super::profiles::Block;
use super::super::{AXES, EXTRUDER, HEADING, Planned};
use super::Klipper;
use super::look_ahead::Move;
use std::f64::consts::PI;

/// Acceleration of moves that no X Y Z is in, before an axis limits it.
const ACCELERATION_FREE: f64 = 99_999_999.9;
/// Shorter is no move of X Y Z, mm.
const LENGTH_MIN_MM: f64 = 1e-9;

impl Klipper {
    /// Axis of a registered stepper among those of the models: A B C by its letter, else the heading's.
    pub(super) fn axis(letter: Option<char>) -> usize {
        match letter {
            Some('A' | 'U') => 3,
            Some('B' | 'V') => 4,
            _ => HEADING,
        }
    }

    pub(super) fn add(&mut self, to: [f64; 4], turns: &[f64]) -> Result<(), String> {
        let mut way = [0.0; AXES];
        for (axis, (to, from)) in to.iter().zip(&self.position).enumerate() {
            way[if axis == 3 { EXTRUDER } else { axis }] = to - from;
        }
        for (index, to) in self.registered.iter().zip(turns) {
            let stepper = &self.steppers[*index];
            way[Self::axis(stepper.axis)] = to - stepper.position;
        }
        let [velocity, acceleration, ..] = self.velocity_limits;
        let straight = way[..3].iter().map(|d| d * d).sum::<f64>().sqrt();
        let kinematic = straight >= LENGTH_MIN_MM;
        let (length, speed, mut accel) = match kinematic {
            true => (straight, self.speed_mm_s.min(velocity), acceleration),
            false => {
                way[..3].fill(0.0);
                let farthest = way.iter().fold(0.0f64, |most, d| most.max(d.abs()));
                (farthest, self.speed_mm_s, ACCELERATION_FREE)
            }
        };
        if length == 0.0 {
            return Ok(());
        }
        let mut speed_max = speed;
        let mut limit = |share: f64, [speed, acceleration]: [f64; 2]| {
            speed_max = speed_max.min(speed / share.abs());
            accel = accel.min(acceleration / share.abs());
        };
        let direction = way.map(|d| d / length);
        if kinematic && way[2] != 0.0 {
            limit(direction[2], self.config.z_max);
        }
        self.check_extrusion(&way, &direction, &mut limit)?;
        for index in &self.registered {
            let stepper = &self.steppers[*index];
            let share = direction[Self::axis(stepper.axis)];
            if share != 0.0 {
                limit(share, stepper.limits);
                if !kinematic && stepper.accel > 0.0 {
                    limit(share, [f64::INFINITY, stepper.accel]);
                }
            }
        }
        self.position = to;
        for (index, to) in self.registered.clone().iter().zip(turns) {
            self.steppers[*index].position = *to;
        }
        let block = Block {
            length,
            direction,
            speed_max,
            acceleration: accel,
            entry_max: 0.0,
            entry_by: "rest",
        };
        self.push(block, kinematic);
        Ok(())
    }

    fn check_extrusion(
        &self,
        way: &[f64; AXES],
        direction: &[f64; AXES],
        limit: &mut impl FnMut(f64, [f64; 2]),
    ) -> Result<(), String> {
        let (pushed, share) = (way[EXTRUDER], direction[EXTRUDER]);
        if pushed == 0.0 {
            return Ok(());
        }
        if self.celsius[0] < 170.0 {
            return Err("Extrude below minimum temp".to_string());
        }
        let config = &self.config;
        let filament_mm2 = 0.25 * PI * config.filament_mm * config.filament_mm;
        let ratio_max = config.cross_section_max_mm2 / filament_mm2;
        if (way[0] == 0.0 && way[1] == 0.0) || share < 0.0 {
            if pushed.abs() > config.extrude_only_mm {
                return Err("Extrude only move too long".to_string());
            }
            limit(share, config.extrude_only_max);
        } else if share > ratio_max && pushed > 0.4 * ratio_max {
            return Err(format!(
                "Move exceeds maximum extrusion ({share} of {ratio_max})"
            ));
        }
        Ok(())
    }

    fn push(&mut self, block: Block, kinematic: bool) {
        let mut corners = [(EXTRUDER, self.config.extruder_corner_mm_s)].to_vec();
        corners.extend(self.registered.iter().map(|i| {
            let stepper = &self.steppers[*i];
            (Self::axis(stepper.axis), stepper.corner)
        }));
        let mut place = [0.0; 6];
        place[..3].copy_from_slice(&self.position[..3]);
        // A stepper that is not registered stands where it is.
        for (index, stepper) in self.steppers.iter().enumerate() {
            let of_index = [HEADING, 3, 4][index.min(2)];
            let axis = stepper
                .axis
                .map_or(of_index, |letter| Self::axis(Some(letter)));
            place[axis] = stepper.position;
        }
        let cruise_accel = self.velocity_limits[1] * (1.0 - self.velocity_limits[3]);
        let deviation =
            self.velocity_limits[2].powi(2) * (2.0f64.sqrt() - 1.0) / self.velocity_limits[1];
        let mut added = Move {
            planned: Planned {
                block,
                places: vec![place],
                of_job: self.of_job,
                rest_s: None,
            },
            kinematic,
            start_max2: 0.0,
            cruise_accel,
        };
        if let Some(before) = self.moves.last().filter(|of| of.planned.rest_s.is_none()) {
            added.join(before, deviation, &corners);
        }
        self.moves.push(added);
    }
}

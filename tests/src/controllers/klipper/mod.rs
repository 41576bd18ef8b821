//! A model of Klipper: its G-code state, `manual_stepper` as an axis, look-ahead with square corners.
//!
//! Source: Klipper's docs/Kinematics.md, Config_Reference.md and G-Codes.md, behaviour of klippy's toolhead,
//! `manual_stepper`, `extruder`, `gcode_move` and `firmware_retraction` of August 2026. F is the speed of X Y Z where
//! they move, else of the axis that goes farthest; other axes follow. Junctions: the deviation of
//! `square_corner_velocity` in X Y Z, and the instantaneous corner velocity of each further axis; a move of further
//! axes alone begins and ends at rest. `minimum_cruise_ratio` bounds peaks between short ramps. Leaves out drip moves
//! and what only homing needs.

mod look_ahead;
mod moves;
#[cfg(test)]
mod tests;

use super::words::{Words, words};
use super::{JobBounds, Planned, Printed};
use look_ahead::{Move, flushed};
use std::f64::consts::PI;

/// What stands in printer.cfg.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// `max_velocity`, mm/s.
    pub velocity_max_mm_s: f64,
    /// `max_accel`, mm/s².
    pub acceleration_max_mm_s2: f64,
    /// `square_corner_velocity`, mm/s.
    pub square_corner_mm_s: f64,
    /// `minimum_cruise_ratio`.
    pub cruise_ratio_min: f64,
    /// `max_z_velocity`, `max_z_accel`.
    pub z_max: [f64; 2],
    /// `instantaneous_corner_velocity` of the extruder, mm/s.
    pub extruder_corner_mm_s: f64,
    /// `max_extrude_only_velocity`, `max_extrude_only_accel`.
    pub extrude_only_max: [f64; 2],
    /// `max_extrude_only_distance`, mm.
    pub extrude_only_mm: f64,
    /// `max_extrude_cross_section`, mm².
    pub cross_section_max_mm2: f64,
    /// `filament_diameter`, mm.
    pub filament_mm: f64,
    /// Names of `manual_stepper` sections, with `velocity` and `accel`.
    pub steppers: Vec<(String, [f64; 2])>,
}

impl Default for Config {
    /// As Klipper has them where a section says nothing, with a machine of 250 mm/s and 3000 mm/s².
    fn default() -> Config {
        let filament_mm2 = 0.25 * PI * 1.75 * 1.75;
        let ratio = 4.0 * 0.4 * 0.4 / filament_mm2;
        Config {
            velocity_max_mm_s: 250.0,
            acceleration_max_mm_s2: 3000.0,
            square_corner_mm_s: 5.0,
            cruise_ratio_min: 0.5,
            z_max: [20.0, 200.0],
            extruder_corner_mm_s: 1.0,
            extrude_only_max: [250.0 * ratio, 3000.0 * ratio],
            extrude_only_mm: 50.0,
            cross_section_max_mm2: 4.0 * 0.4 * 0.4,
            filament_mm: 1.75,
            steppers: ["heading", "tilt_a", "tilt_b"]
                .map(|name| (name.to_string(), [1000.0, 20_000.0]))
                .to_vec(),
        }
    }
}

/// A `manual_stepper`.
#[derive(Clone, Debug, Default)]
struct Stepper {
    name: String,
    accel: f64,
    position: f64,
    /// Its letter, and the position at which G-code counts from 0.
    axis: Option<char>,
    corner: f64,
    limits: [f64; 2],
}

/// A printer that runs Klipper, from print to print.
#[derive(Clone, Debug)]
pub struct Klipper {
    config: Config,
    steppers: Vec<Stepper>,
    /// Registered steppers in the order of their registration.
    registered: Vec<usize>,
    /// X Y Z E of the machine, and where G-code counts from.
    position: [f64; 4],
    base: [f64; 4],
    absolute: [bool; 2],
    speed_mm_s: f64,
    velocity_limits: [f64; 4],
    /// Length, speed, extra, speed; in mm and mm/s.
    retraction: [f64; 4],
    retracted: bool,
    celsius: [f64; 2],
    fan: f64,
    moves: Vec<Move>,
    of_job: bool,
}

impl Klipper {
    /// Powered up and configured.
    pub fn new(config: Config) -> Klipper {
        let stepper = |(name, [_, accel]): &(String, [f64; 2])| Stepper {
            name: name.clone(),
            accel: *accel,
            ..Stepper::default()
        };
        Klipper {
            steppers: config.steppers.iter().map(stepper).collect(),
            velocity_limits: [
                config.velocity_max_mm_s,
                config.acceleration_max_mm_s2,
                config.square_corner_mm_s,
                config.cruise_ratio_min,
            ],
            config,
            registered: Vec::new(),
            position: [0.0; 4],
            base: [0.0; 4],
            absolute: [true; 2],
            speed_mm_s: 25.0,
            retraction: [0.0, 20.0, 0.0, 10.0],
            retracted: false,
            celsius: [0.0; 2],
            fan: 0.0,
            moves: Vec::new(),
            of_job: false,
        }
    }

    /// Prints a text.
    ///
    /// # Errors
    /// What Klipper says, with the line.
    pub fn print(&mut self, text: &str) -> Result<Printed, String> {
        let before = (self.velocity_limits, self.retraction, self.absolute);
        self.moves.clear();
        let mut bounds = JobBounds::default();
        for (index, line) in text.lines().enumerate() {
            self.of_job = bounds.is_job(line);
            let said = |error: String| format!("line {}: {error}: {line}", index + 1);
            if let Some(words) = words(line).map_err(said)? {
                self.command(&words).map_err(said)?;
            }
        }
        self.rest(0.0);
        let moves: Vec<Planned> = self.moves.iter().map(|of| of.planned.clone()).collect();
        let printed = Printed::of_moves(&moves, |range| flushed(&self.moves[range]));
        Ok(printed.of_text(text, self.left(before)))
    }

    fn left(&self, before: ([f64; 4], [f64; 4], [bool; 2])) -> Vec<String> {
        let mut left = Vec::new();
        let axes = self.registered.iter().map(|i| &self.steppers[*i]);
        left.extend(axes.map(|of| format!("{} is still registered", of.name)));
        // The next print takes a heading where it stands for its zero; tilts are counted on.
        let headings = self.steppers.iter().filter(|of| of.name == "heading");
        let turns = headings.map(|of| (of, of.position / 360.0));
        let off = turns.filter(|(_, turns)| (turns - turns.round()).abs() > 1e-9);
        left.extend(off.map(|(of, turns)| format!("{} stands at {turns} turns", of.name)));
        if self.velocity_limits != before.0 {
            left.push(format!("velocity limits {:?}", self.velocity_limits));
        }
        if self.absolute != [true; 2] && self.absolute != before.2 {
            left.push(format!("X, E absolute: {:?}", self.absolute));
        }
        let hot = self.celsius.iter().filter(|celsius| **celsius > 0.0);
        left.extend(hot.map(|celsius| format!("a heater at {celsius}")));
        if self.fan > 0.0 {
            left.push("the fan".to_string());
        }
        left
    }

    fn command(&mut self, words: &Words) -> Result<(), String> {
        if !words.keys.is_empty() || words.letters.is_empty() {
            return self.extended(words);
        }
        let (letter, code) = words.letters[0];
        match (letter, code as u32) {
            ('G', 0 | 1) => return self.go(words),
            ('G', 10) => return self.retract(true),
            ('G', 11) => return self.retract(false),
            ('G', 20) => return Err("Machine does not support G20 (inches) command".to_string()),
            ('G', 4) => self.rest(words.number('P').unwrap_or(0.0) * 1e-3),
            ('G', 28) => {
                self.rest(0.0);
                self.position[..3].fill(0.0);
                self.base[..3].fill(0.0);
            }
            ('G', 90 | 91) => self.absolute[0] = code == 90.0,
            ('G', 92) => self.set_base(words),
            ('M', 82 | 83) => self.absolute[1] = code == 82.0,
            ('M', 104 | 109) => self.celsius[0] = words.number('S').unwrap_or(0.0),
            ('M', 140 | 190) => self.celsius[1] = words.number('S').unwrap_or(0.0),
            ('M', 106) => self.fan = words.number('S').unwrap_or(255.0),
            ('M', 107) => self.fan = 0.0,
            ('M', 400) => self.rest(0.0),
            ('G', 21) | ('M', 73 | 105) => {}
            _ => return Err("Unknown command".to_string()),
        }
        Ok(())
    }

    /// Of G92 only X Y Z E are axes.
    fn set_base(&mut self, words: &Words) {
        let given = ['X', 'Y', 'Z', 'E'].map(|letter| words.number(letter));
        for (axis, given) in given.into_iter().enumerate() {
            if let Some(place) = given {
                self.base[axis] = self.position[axis] - place;
            }
        }
        if given == [None; 4] {
            self.base = self.position;
        }
    }

    fn extended(&mut self, words: &Words) -> Result<(), String> {
        let set = |to: &mut f64, key: &str| *to = words.key(key).unwrap_or(*to);
        match words.name.as_str() {
            "MANUAL_STEPPER" => self.manual_stepper(words),
            "SET_RETRACTION" => {
                set(&mut self.retraction[0], "RETRACT_LENGTH");
                set(&mut self.retraction[1], "RETRACT_SPEED");
                set(&mut self.retraction[2], "UNRETRACT_EXTRA_LENGTH");
                set(&mut self.retraction[3], "UNRETRACT_SPEED");
                // Klipper takes it for unretracted from here on.
                self.retracted = false;
                Ok(())
            }
            "SET_VELOCITY_LIMIT" => {
                set(&mut self.velocity_limits[0], "VELOCITY");
                set(&mut self.velocity_limits[1], "ACCEL");
                set(&mut self.velocity_limits[2], "SQUARE_CORNER_VELOCITY");
                set(&mut self.velocity_limits[3], "MINIMUM_CRUISE_RATIO");
                Ok(())
            }
            name => Err(format!("Unknown command {name}")),
        }
    }

    fn manual_stepper(&mut self, words: &Words) -> Result<(), String> {
        let name = words.keys.get("STEPPER").ok_or("missing STEPPER")?;
        let index = self.steppers.iter().position(|of| of.name == *name);
        let index = index.ok_or(format!("The value '{name}' is not valid for STEPPER"))?;
        let letter = words.keys.get("GCODE_AXIS").map(|text| text.to_uppercase());
        let stepper = &mut self.steppers[index];
        let Some(letter) = letter else {
            if stepper.axis.is_some() {
                return Err("Must unregister from gcode axis first".to_string());
            }
            if let Some(place) = words.key("SET_POSITION") {
                stepper.position = place;
                self.rest(0.0);
            }
            return Ok(());
        };
        if stepper.axis.is_some() {
            if !letter.is_empty() {
                return Err("Must unregister axis first".to_string());
            }
            stepper.axis = None;
            self.registered.retain(|of| *of != index);
            self.rest(0.0);
            return Ok(());
        }
        let Some(letter) = letter.chars().next() else {
            return Ok(());
        };
        if "XYZEFN".contains(letter) {
            return Err("Not a valid GCODE_AXIS".to_string());
        }
        if self
            .registered
            .iter()
            .any(|i| self.steppers[*i].axis == Some(letter))
        {
            return Err(format!("Axis '{letter}' already registered"));
        }
        let stepper = &mut self.steppers[index];
        stepper.axis = Some(letter);
        stepper.corner = words.key("INSTANTANEOUS_CORNER_VELOCITY").unwrap_or(1.0);
        let limits = ["LIMIT_VELOCITY", "LIMIT_ACCEL"];
        stepper.limits = limits.map(|key| words.key(key).unwrap_or(999_999.9));
        self.registered.push(index);
        self.rest(0.0);
        Ok(())
    }

    /// The look-ahead is flushed: what comes begins at rest.
    fn rest(&mut self, seconds: f64) {
        if let Some(last) = self.moves.last_mut() {
            *last.planned.rest_s.get_or_insert(0.0) += seconds;
        }
    }

    fn retract(&mut self, back: bool) -> Result<(), String> {
        if self.retracted == back {
            return Ok(());
        }
        self.retracted = back;
        let [length, speed, extra, prime_speed] = self.retraction;
        let (by, speed) = match back {
            true => (-length, speed),
            false => (length + extra, prime_speed),
        };
        let speed_before = self.speed_mm_s;
        // `%d` of mm/min.
        self.speed_mm_s = (60.0 * speed).floor() / 60.0;
        let mut to = self.position;
        to[3] += by;
        let turns: Vec<f64> = self
            .registered
            .iter()
            .map(|i| self.steppers[*i].position)
            .collect();
        self.add(to, &turns)?;
        self.speed_mm_s = speed_before;
        Ok(())
    }

    fn go(&mut self, words: &Words) -> Result<(), String> {
        let mut to = self.position;
        for (axis, letter) in ['X', 'Y', 'Z', 'E'].into_iter().enumerate() {
            if let Some(number) = words.number(letter) {
                let is_absolute = self.absolute[0] && (axis < 3 || self.absolute[1]);
                to[axis] = number
                    + if is_absolute {
                        self.base[axis]
                    } else {
                        self.position[axis]
                    };
            }
        }
        let mut turns = Vec::new();
        for index in &self.registered {
            let stepper = &self.steppers[*index];
            let number = stepper.axis.and_then(|letter| words.number(letter));
            let from = if self.absolute[0] {
                0.0
            } else {
                stepper.position
            };
            turns.push(number.map_or(stepper.position, |number| from + number));
        }
        if let Some(feed) = words.number('F') {
            if feed <= 0.0 {
                return Err("Invalid speed".to_string());
            }
            self.speed_mm_s = feed / 60.0;
        }
        self.add(to, &turns)
    }
}

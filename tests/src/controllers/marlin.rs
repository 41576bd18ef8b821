//! A model of Marlin 2.1 with rotational axes: its planner with classic jerk or junction deviation.
//!
//! Source: marlinfw.org, Configuration (jerk, junction deviation, accelerations, software endstops), G-code pages, and the
//! behaviour of `planner.cpp` and `motion.cpp` of 2.1. F is the speed of X Y Z where one moves, of the rotational axes
//! where those alone do. Classic jerk bounds the change of each axis' speed at a junction; junction deviation takes the
//! angle between moves in all axes at once, millimetres and degrees alike. Moves of fewer than six steps (as it
//! comes) are put off to the next. The buffer holds 16 blocks. Software endstops bound what a homed axis is told.
//! Leaves out linear advance, and the jerk with which a first move begins.

use super::profiles::Block;
use super::state::{Rules, State, Way};
use super::{AXES, EXTRUDER, HEADING, Printed, linear_first, moves_of, within};
use std::f64::consts::FRAC_PI_4;

/// `BLOCK_BUFFER_SIZE`.
const BUFFER: usize = 16;
/// `MAX_CMD_SIZE`.
const LINE_MAX: usize = 96;

/// What Configuration.h says; axes are X Y Z A B C E.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// `DEFAULT_AXIS_STEPS_PER_UNIT`.
    pub steps: [f64; AXES],
    /// `DEFAULT_MAX_FEEDRATE`, a second.
    pub speed_max: [f64; AXES],
    /// `DEFAULT_MAX_ACCELERATION`.
    pub acceleration_max: [f64; AXES],
    /// `DEFAULT_ACCELERATION`, `DEFAULT_RETRACT_ACCELERATION`, `DEFAULT_TRAVEL_ACCELERATION`.
    pub accelerations: [f64; 3],
    /// `DEFAULT_XJERK` and so on with `CLASSIC_JERK`.
    pub jerk: Option<[f64; AXES]>,
    /// `JUNCTION_DEVIATION_MM` without.
    pub deviation_mm: f64,
    /// `MIN_STEPS_PER_SEGMENT`.
    pub steps_min: f64,
    /// Software endstops of the heading, degrees.
    pub heading_deg: Option<[f64; 2]>,
}

/// A printer that runs Marlin, from print to print.
#[derive(Clone, Debug)]
pub struct Marlin {
    config: Config,
    state: State,
}

impl Marlin {
    /// Powered up and configured.
    pub fn new(config: Config) -> Marlin {
        let state = State::new(Rules {
            letters: ['X', 'Y', 'Z', 'A', 'B', 'C', 'E'],
            machine_tool: false,
            arcs: true,
            codes: &[],
        });
        Marlin { config, state }
    }

    /// Prints a text.
    ///
    /// # Errors
    /// What it refuses, with the line.
    pub fn print(&mut self, text: &str) -> Result<Printed, String> {
        let config = &self.config;
        let mut put_off = [0.0; AXES];
        let moves = moves_of(text, &mut self.state, LINE_MAX, |state, way, before| {
            let mut way = way.clone();
            way.by = std::array::from_fn(|axis| way.by[axis] + put_off[axis]);
            if put_off.iter().any(|by| *by != 0.0) {
                way.length_mm = way.by[..3].iter().map(|d| d * d).sum::<f64>().sqrt();
            }
            config.check(state, &way)?;
            let steps = way
                .by
                .iter()
                .zip(&config.steps)
                .map(|(by, steps)| (by * steps).abs());
            if steps.fold(0.0, f64::max).round() < config.steps_min {
                put_off = way.by;
                return Ok(None);
            }
            put_off = [0.0; AXES];
            Ok(Some(config.block(state, &way, before)))
        })?;
        let mut left = self.state.left();
        left.extend(self.state.left_accelerations(&config.acceleration_max));
        Ok(Printed::looked_ahead(&moves, BUFFER).of_text(text, left))
    }
}

impl Config {
    fn check(&self, state: &State, way: &Way) -> Result<(), String> {
        // G92 shifts the workspace: endstops are where the machine's own coordinate has them.
        if let Some([least, most]) = self.heading_deg
            && !(least..=most).contains(&way.to[HEADING])
        {
            return Err(format!("the heading is cut at {least}:{most}"));
        }
        match way.by[EXTRUDER] != 0.0 && state.celsius[0] < 170.0 {
            true => Err("cold extrusion is prevented".to_string()),
            false => Ok(()),
        }
    }

    fn block(&self, state: &State, way: &Way, before: Option<&Block>) -> Block {
        let accelerations = state.accelerations(&self.acceleration_max);
        let length = linear_first(way);
        let direction = way.by.map(|d| d / length);
        let goes = way.by[..EXTRUDER].iter().any(|by| *by != 0.0);
        let [print, retract, travel] = self.accelerations;
        let acceleration = match (goes, way.by[EXTRUDER] != 0.0) {
            (false, _) => retract,
            (true, true) => print.min(within(&direction, &accelerations)),
            (true, false) => travel.min(within(&direction, &accelerations)),
        };
        let mut block = Block {
            length,
            direction,
            speed_max: (state.feed / 60.0).min(within(&direction, &self.speed_max)),
            acceleration,
            entry_max: 0.0,
            entry_by: "rest",
        };
        if let Some(before) = before {
            (block.entry_max, block.entry_by) = match &self.jerk {
                Some(jerk) => classic(jerk, before, &block),
                None => self.deviation(before, &block),
            };
        }
        block
    }

    /// Junction deviation over all axes at once.
    fn deviation(&self, before: &Block, block: &Block) -> (f64, &'static str) {
        let unit = |block: &Block| match block.direction[EXTRUDER] > 0.0 {
            true => normal(&block.direction),
            false => block.direction,
        };
        let [from, to] = [unit(before), unit(block)];
        let cos = -from.iter().zip(&to).map(|(a, b)| a * b).sum::<f64>();
        let speed = before.speed_max.min(block.speed_max);
        if cos > 0.999_999 {
            return (0.0, "reversal");
        }
        let across = normal(&std::array::from_fn(|axis| to[axis] - from[axis]));
        let acceleration = block
            .acceleration
            .min(within(&across, &self.acceleration_max));
        let cos = cos.max(-0.999_999);
        let half_sin = (0.5 * (1.0 - cos)).sqrt();
        let mut speed2 = acceleration * self.deviation_mm * half_sin / (1.0 - half_sin);
        if block.length < 1.0 && cos < -FRAC_PI_4.cos() {
            // JD_HANDLE_SMALL_SEGMENTS: a circle by the angle that is left.
            speed2 = speed2.min(block.length * acceleration / (-cos).acos());
        }
        match speed2.sqrt() < speed {
            true => (speed2.sqrt(), "junction deviation"),
            false => (speed, "speed"),
        }
    }
}

fn normal(vector: &[f64; AXES]) -> [f64; AXES] {
    let length = vector.iter().map(|d| d * d).sum::<f64>().sqrt();
    vector.map(|d| d / length.max(1e-12))
}

/// The change of each axis' speed within its jerk.
fn classic(jerk: &[f64; AXES], before: &Block, block: &Block) -> (f64, &'static str) {
    let speed = before.speed_max.min(block.speed_max);
    let mut least = (speed, "speed");
    for (axis, &jerk) in jerk.iter().enumerate() {
        let change = (before.direction[axis] - block.direction[axis]).abs();
        if change * least.0 > jerk {
            let by = if axis == HEADING {
                "heading's jerk"
            } else {
                "jerk"
            };
            least = (jerk / change, by);
        }
    }
    least
}

#[cfg(test)]
mod tests {
    //! Goal: both rules of corners as Marlin's pages have them, and what endstops do. Method: by hand.
    use super::*;

    fn config() -> Config {
        Config {
            steps: [80.0, 80.0, 400.0, 10.0, 10.0, 26.667, 400.0],
            speed_max: [250.0, 250.0, 20.0, 120.0, 120.0, 1000.0, 50.0],
            acceleration_max: [1000.0, 1000.0, 200.0, 1500.0, 1500.0, 20_000.0, 1000.0],
            accelerations: [1000.0; 3],
            jerk: Some([10.0, 10.0, 0.3, 1.0, 1.0, 100.0, 5.0]),
            deviation_mm: 0.013,
            steps_min: 6.0,
            heading_deg: None,
        }
    }

    fn printed(config: Config, lines: &str) -> Result<Printed, String> {
        Marlin::new(config).print(&format!("M83\nM109 S210\nG0 F3000\n{lines}"))
    }

    #[test]
    fn classic_jerk_is_of_each_axis() {
        // From rest, 10 mm/s at the corner, to rest.
        let corner = printed(config(), "G1 X10 E.1 F3000\nG1 Y10 E.1").expect("printed");
        let each = 0.05 + 0.04 + (10.0 - 1.25 - 1.2) / 50.0;
        assert!(
            (corner.seconds - 2.0 * each).abs() < 1e-9,
            "{}",
            corner.seconds
        );
    }

    #[test]
    fn junction_deviation_is_of_all_axes() {
        // A right angle: v² = a d s / (1 - s) with s = sin 45°, the acceleration across it 1000 sqrt 2.
        let lines = "G1 X10 F3000\nG1 Y10\nG1 E1 F600";
        let none = Config {
            jerk: None,
            ..config()
        };
        let corner = printed(none.clone(), lines).expect("printed");
        let s = 0.5f64.sqrt();
        let speed = (1000.0 * 0.013 * s / (1.0 - s)).sqrt();
        let step = corner.peaks[0].step;
        assert!((step - speed).abs() < 1e-9, "{step} {speed}");
        // With the extruder, 10 and 30 degrees for 10 mm are an angle of 26.6°.
        let turned = printed(none, "G1 X10 C10 E.01 F3000\nG1 X20 C40 E.01").expect("printed");
        assert_eq!(turned.slowed_by["junction deviation"], 1);
    }

    #[test]
    fn endstops_cut_a_heading_that_winds() {
        let bounded = Config {
            heading_deg: Some([0.0, 360.0]),
            ..config()
        };
        let cut = printed(bounded.clone(), "G1 C361 F6000").expect_err("cut");
        assert!(cut.contains("0:360"), "{cut}");
        // G92 only shifts what is said.
        let mut printer = Marlin::new(bounded);
        assert!(printer.print("G1 C300 F6000\nG92 C0\nG1 C90").is_err());
        // Five steps wait for the next move.
        let few = printed(config(), "G1 X.06 F600\nG1 X1\nG1 E1 F600").expect("printed");
        assert_eq!(few.moves, 2);
    }
}

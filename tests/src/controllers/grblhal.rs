//! A model of grblHAL: its planner with junction deviation over all axes.
//!
//! Source: grblHAL's wiki (settings $11, $110 and on, $120 and on, $376) and the behaviour of `planner.c`, `gcode.c` of
//! 2025. A move's length is that of all its axes, millimetres and degrees alike; by G93 it lasts as long as requested, if
//! no axis is too slow. Junctions: the deviation $11 of the angle between moves in all axes, by the acceleration that
//! the axes have across it. Letters are those of the build: X Y Z A B C, U V. Leaves out jerk-limited builds.

use super::profiles::Block;
use super::state::{Rules, State, Way};
use super::{AXES, Printed, moves_of, within};

/// `BLOCK_BUFFER_SIZE`, and characters of a line.
const BUFFER: usize = 35;
const LINE_MAX: usize = 256;

/// Settings; axes are X Y Z A B C U.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Letters of the build for the axes; a blank is none.
    pub letters: [char; AXES],
    /// $11, mm.
    pub deviation_mm: f64,
    /// $110 and on, mm/min or degrees/min.
    pub speed_max_min: [f64; AXES],
    /// $120 and on.
    pub acceleration_max: [f64; AXES],
}

/// A controller that runs grblHAL, from print to print.
#[derive(Clone, Debug)]
pub struct GrblHal {
    config: Config,
    state: State,
}

impl GrblHal {
    /// Powered up and configured.
    pub fn new(config: Config) -> GrblHal {
        let state = State::new(Rules {
            letters: config.letters,
            machine_tool: true,
            arcs: false,
            codes: &[],
        });
        GrblHal { config, state }
    }

    /// Prints a text.
    ///
    /// # Errors
    /// What it refuses, with the line.
    pub fn print(&mut self, text: &str) -> Result<Printed, String> {
        let config = &self.config;
        let known = config.letters;
        for (index, line) in text.lines().enumerate() {
            let code = line.split(';').next().unwrap_or("");
            let axis = code
                .chars()
                .find(|c| "ABCUVW".contains(*c) && !known.contains(c));
            if let (Some(letter), true) = (axis, code.starts_with('G')) {
                return Err(format!("line {}: no axis {letter}: {line}", index + 1));
            }
        }
        let moves = moves_of(text, &mut self.state, LINE_MAX, |state, way, before| {
            Ok(config.block(state, way, before))
        })?;
        Ok(Printed::looked_ahead(&moves, BUFFER).of_text(text, self.state.left()))
    }
}

impl Config {
    fn block(&self, state: &State, way: &Way, before: Option<&Block>) -> Option<Block> {
        let length = way.by.iter().map(|d| d * d).sum::<f64>().sqrt();
        if length == 0.0 {
            return None;
        }
        let direction = way.by.map(|d| d / length);
        let fastest = within(&direction, &self.speed_max_min) / 60.0;
        let requested = match (way.rapid, way.seconds) {
            (true, _) => fastest,
            (false, Some(seconds)) => length / seconds,
            (false, None) => state.feed / 60.0,
        };
        let mut block = Block {
            length,
            direction,
            speed_max: requested.min(fastest),
            acceleration: within(&direction, &self.acceleration_max),
            entry_max: 0.0,
            entry_by: "rest",
        };
        if let Some(before) = before {
            (block.entry_max, block.entry_by) = self.junction(before, &block);
        }
        Some(block)
    }

    fn junction(&self, before: &Block, block: &Block) -> (f64, &'static str) {
        let (from, to) = (&before.direction, &block.direction);
        let cos = -from.iter().zip(to).map(|(a, b)| a * b).sum::<f64>();
        let speed = before.speed_max.min(block.speed_max);
        if cos > 0.999_999 {
            return (0.0, "reversal");
        }
        if cos < -0.999_999 {
            return (speed, "speed");
        }
        let change: [f64; AXES] = std::array::from_fn(|axis| to[axis] - from[axis]);
        let length = change.iter().map(|d| d * d).sum::<f64>().sqrt();
        let acceleration = within(&change.map(|d| d / length), &self.acceleration_max);
        let half_sin = (0.5 * (1.0 - cos)).sqrt();
        let corner = (acceleration * self.deviation_mm * half_sin / (1.0 - half_sin)).sqrt();
        match corner < speed {
            true => (corner, "junction deviation"),
            false => (speed, "speed"),
        }
    }
}

#[cfg(test)]
mod tests {
    //! Goal: corners and inverse time as grblHAL has them. Method: by hand.
    use super::*;

    fn config() -> Config {
        Config {
            letters: ['X', 'Y', 'Z', 'A', 'B', 'C', 'U'],
            deviation_mm: 0.01,
            speed_max_min: [15_000.0, 15_000.0, 1200.0, 7200.0, 7200.0, 60_000.0, 3000.0],
            acceleration_max: [1000.0, 1000.0, 200.0, 1500.0, 1500.0, 20_000.0, 1000.0],
        }
    }

    #[test]
    fn inverse_time_is_of_all_axes() {
        // 30 mm and 40 degrees are 50 of length in half a second: 100 a second, by 1000 / 0.6 of acceleration.
        let text = "G0 F3000\nG93\nG1 X30 C40 F120\nG94\nM2";
        let printed = GrblHal::new(config()).print(text).expect("printed");
        let (speed, acceleration) = (100.0, 1000.0 / 0.6);
        let by_hand = 50.0 / speed + speed / acceleration;
        assert!(
            (printed.seconds - by_hand).abs() < 1e-9,
            "{} {by_hand}",
            printed.seconds
        );
        assert_eq!(
            printed.left,
            ["the heading stands at 0.1111111111111111 turns"]
        );
    }

    #[test]
    fn a_corner_has_the_deviation_of_its_angle() {
        // A right angle: across it the axes have 1000 sqrt 2.
        let text = "G94\nG1 X10 F3000\nG1 Y10\n";
        let printed = GrblHal::new(config()).print(text).expect("printed");
        let s = 0.5f64.sqrt();
        let speed = (1000.0 * 2.0f64.sqrt() * 0.01 * s / (1.0 - s)).sqrt();
        assert!((printed.peaks[1].step - speed).abs() < 1e-9);
        // A build of five axes has no U.
        let five = Config {
            letters: ['X', 'Y', 'Z', 'A', 'B', ' ', ' '],
            ..config()
        };
        let refused = GrblHal::new(five).print("G1 U1 F60").expect_err("no U");
        assert!(refused.contains("no axis U"), "{refused}");
    }
}

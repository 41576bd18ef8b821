//! A model of RepRapFirmware 3: its look-ahead with jerk for each axis.
//!
//! Source: docs.duet3d.com, G-code dictionary (M201, M203, M204, M566, M584, M208) and the behaviour of `DDA.cpp` and
//! `DDARing.cpp` of 3.5. F is the speed of the linear axes where one moves, of the rotary axes where those alone do.
//! A junction's speed is bounded by each axis' jerk (M566) for the change of its share of the speed; with the standing
//! jerk policy (M566 P0) a move that prints and one that does not have rest between. No move is slower than 0.5 mm/s.
//! Leaves out bed compensation and what a Duet does when it is short of moves.

use super::profiles::Block;
use super::state::{Rules, State, Way};
use super::words::words;
use super::{AXES, EXTRUDER, HEADING, Printed, linear_first, moves_of, within};

/// Moves that the ring holds.
const BUFFER: usize = 40;
/// Slowest move.
const SPEED_MIN_MM_S: f64 = 0.5;
/// Characters of a line.
const LINE_MAX: usize = 256;

/// What config.g says, as its axes: mm/min or degrees/min, and a second squared.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// M203.
    pub speed_max_min: [f64; AXES],
    /// M201.
    pub acceleration_max: [f64; AXES],
    /// M566.
    pub jerk_min: [f64; AXES],
    /// M208 of the heading; others are not checked.
    pub heading_deg: [f64; 2],
}

impl Config {
    /// Reads the lines of a config.g: M201, M203, M208 and M566 of the axes X Y Z A B C E.
    ///
    /// # Errors
    /// A line that has no words.
    pub fn read(text: &str) -> Result<Config, String> {
        // As a Duet comes: M201 500, M203 6000 and M566 600 a minute for most axes.
        let mut config = Config {
            speed_max_min: [6000.0; AXES],
            acceleration_max: [500.0; AXES],
            jerk_min: [600.0; AXES],
            heading_deg: [0.0, 360.0],
        };
        for line in text.lines() {
            let code = line.split_whitespace().next().unwrap_or("");
            let to = match code {
                "M201" => &mut config.acceleration_max,
                "M203" => &mut config.speed_max_min,
                "M566" => &mut config.jerk_min,
                "M208" => {
                    let range = line
                        .split('C')
                        .nth(1)
                        .and_then(|range| range.split_once(':'));
                    if let Some((least, most)) = range {
                        let number =
                            |text: &str| text.trim().parse::<f64>().map_err(|e| e.to_string());
                        config.heading_deg = [number(least)?, number(most)?];
                    }
                    continue;
                }
                _ => continue,
            };
            let Some(words) = words(line)? else { continue };
            for (axis, letter) in "XYZABCE".chars().enumerate() {
                to[axis] = words.number(letter).unwrap_or(to[axis]);
            }
        }
        Ok(config)
    }
}

/// A Duet, from print to print.
#[derive(Clone, Debug)]
pub struct RepRapFirmware {
    config: Config,
    state: State,
}

impl RepRapFirmware {
    /// Powered up and configured.
    pub fn new(config: Config) -> RepRapFirmware {
        let state = State::new(Rules {
            letters: ['X', 'Y', 'Z', 'A', 'B', 'C', 'E'],
            machine_tool: false,
            arcs: true,
            codes: &["M116"],
        });
        RepRapFirmware { config, state }
    }

    /// Prints a text.
    ///
    /// # Errors
    /// What it refuses, with the line.
    pub fn print(&mut self, text: &str) -> Result<Printed, String> {
        let config = &self.config;
        let moves = moves_of(text, &mut self.state, LINE_MAX, |state, way, before| {
            config.check(state, way)?;
            let Some(mut block) = config.block(state, way) else {
                return Ok(None);
            };
            if let Some(before) = before {
                (block.entry_max, block.entry_by) = config.junction(before, &block);
            }
            Ok(Some(block))
        })?;
        let mut left = self.state.left();
        left.extend(self.state.left_accelerations(&config.acceleration_max));
        Ok(Printed::looked_ahead(&moves, BUFFER).of_text(text, left))
    }
}

impl Config {
    fn check(&self, state: &State, way: &Way) -> Result<(), String> {
        let [least, most] = self.heading_deg;
        // G92 sets the machine's own coordinate here.
        let heading = way.to[HEADING] - state.offset[HEADING];
        if !(least..=most).contains(&heading) {
            return Err(format!("C{heading} is beyond M208's {least}:{most}"));
        }
        match way.by[EXTRUDER] != 0.0 && state.celsius[0] < 160.0 {
            true => Err("the hot end is cold".to_string()),
            false => Ok(()),
        }
    }

    fn block(&self, state: &State, way: &Way) -> Option<Block> {
        let length = linear_first(way);
        if length == 0.0 {
            return None;
        }
        let direction = way.by.map(|d| d / length);
        let requested = (state.feed / 60.0).max(SPEED_MIN_MM_S);
        let speed_max = requested.min(within(&direction, &self.speed_max_min) / 60.0);
        Some(Block {
            length,
            direction,
            speed_max,
            acceleration: within(&direction, &state.accelerations(&self.acceleration_max)),
            entry_max: 0.0,
            entry_by: "rest",
        })
    }

    /// The fastest pass from a block to the next.
    fn junction(&self, before: &Block, block: &Block) -> (f64, &'static str) {
        let goes = |block: &Block| block.direction[0] != 0.0 || block.direction[1] != 0.0;
        let prints = |block: &Block| goes(block) && block.direction[EXTRUDER] > 0.0;
        if goes(before) != goes(block) || prints(before) != prints(block) {
            return (0.0, "print and travel");
        }
        let mut least = (before.speed_max.min(block.speed_max), "speed");
        for axis in 0..AXES {
            let change = (before.direction[axis] - block.direction[axis]).abs();
            let jerk = self.jerk_min[axis] / 60.0;
            if change * least.0 > jerk {
                let by = match axis {
                    HEADING => "heading's jerk",
                    EXTRUDER => "extruder's jerk",
                    _ => "jerk",
                };
                least = (jerk / change, by);
            }
        }
        least
    }
}

#[cfg(test)]
mod tests {
    //! Goal: M203, M201 and M566 as the dictionary has them. Method: lines whose times are worked out by hand.
    use super::*;

    const CONFIG: &str = "M201 X1000 Y1000 Z100 C20000 E1000\nM203 X15000 Y15000 Z1200 C60000 E6000\n\
                          M566 X600 Y600 Z60 C600 E600\nM208 C-36000:36000\n";

    fn printed(lines: &str) -> Result<Printed, String> {
        let mut duet = RepRapFirmware::new(Config::read(CONFIG)?);
        duet.print(&format!("G28\nM83\nM109 S210\nG0 F3000\n{lines}"))
    }

    #[test]
    fn a_corner_has_each_axis_jerk() {
        // From X to Y both change by the whole speed: 10 mm/s at the corner, 50 mm/s on the legs of 10 mm.
        let corner = printed("G1 X10 E0.1 F3000\nG1 Y10 E0.1").expect("printed");
        let each = 0.05 + 0.04 + (10.0 - 1.25 - 1.2) / 50.0;
        assert!((corner.seconds - 2.0 * each).abs() < 1e-9, "{corner:?}");
    }

    #[test]
    fn a_heading_steps_by_its_jerk() {
        // 10 mm with 10 degrees, then with 30: M566 C600 is 10 degrees/s, so 5 mm/s.
        let turned = printed("G1 X10 C10 E.1 F3000\nG1 X20 C40 E.1").expect("printed");
        assert_eq!(turned.slowed_by["heading's jerk"], 1);
        assert!((turned.peaks[HEADING].step - 10.0).abs() < 1e-9);
        // Headings alone: F is degrees a minute.
        let alone = printed("G1 C360 F36000").expect("printed");
        let turn = 360.0 / 600.0 + 600.0 / 20000.0;
        assert!((alone.seconds - turn).abs() < 1e-9, "{alone:?}");
        assert!(printed("G1 C36001").expect_err("beyond").contains("M208"));
    }

    #[test]
    fn accelerations_hold_from_their_line_on() {
        // 10 mm with 100 degrees, there and back: 1000 / 10 mm/s² of the heading's, then the 1000 of X. C600 has 0.5 mm/s
        // where it turns back.
        let text = "M201 C1000\nG1 X10 C100 E1 F600\nM201 C20000\nG1 X0 C0 E1";
        let each = |acceleration: f64| {
            19.5 / acceleration + (10.0 - (200.0 - 0.25) / (2.0 * acceleration)) / 10.0
        };
        let printed = printed(text).expect("printed");
        let by_hand = each(100.0) + each(1000.0);
        assert!(
            (printed.seconds - by_hand).abs() < 1e-9,
            "{} {by_hand}",
            printed.seconds
        );
        let is_left = |text: &String| text.starts_with("M201");
        assert!(!printed.left.iter().any(is_left), "{:?}", printed.left);
        let mut duet = RepRapFirmware::new(Config::read(CONFIG).expect("a configuration"));
        let left = duet.print("M201 C1000").expect("printed").left;
        assert_eq!(left, ["M201 C1000"]);
    }

    #[test]
    fn prints_and_travels_have_rest_between() {
        let two = printed("G1 X10 F3000\nG1 X20 E0.1").expect("printed");
        assert_eq!(two.slowed_by["print and travel"], 1);
    }
}

//! What a line leaves behind: places, offsets and modes of the controllers that speak RS274's dialects.
//!
//! In: the words of a line. Out: a [`Way`] where something moves. What differs between controllers is in [`Rules`];
//! what one does not know is an error. Source: RepRapFirmware's and Marlin's G-code pages, NIST IR 6556, LinuxCNC's and
//! grblHAL's G-code pages.

use super::words::Words;
use super::{AXES, EXTRUDER, HEADING};
use std::f64::consts::TAU;

/// How a controller reads.
#[derive(Clone, Debug, PartialEq)]
pub struct Rules {
    /// Letters of X Y Z, A B C and the extruder.
    pub letters: [char; AXES],
    /// A machine tool: many codes a line, inverse time, outputs, an extruder as any other axis.
    pub machine_tool: bool,
    /// G2 and G3 are known, with all axes evenly along them.
    pub arcs: bool,
    /// Heater codes beside those that all printers have.
    pub codes: &'static [&'static str],
}

/// A move as a line orders it.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// Of each axis.
    pub by: [f64; AXES],
    /// Its end on the machine.
    pub to: [f64; AXES],
    /// Length of X Y Z, along the arc where it is one.
    pub length_mm: f64,
    /// Centre from the start in X Y, sweep in rad.
    pub arc: Option<([f64; 2], f64)>,
    /// G0.
    pub rapid: bool,
    /// F of inverse time: it lasts so long.
    pub seconds: Option<f64>,
}

/// What stays from line to line and from print to print.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// How it reads.
    pub rules: Rules,
    /// On the machine.
    pub position: [f64; AXES],
    /// Position of the machine less that of the text.
    pub offset: [f64; AXES],
    relative: bool,
    extruder_relative: bool,
    inverse_time: bool,
    /// G20: mm of a unit.
    unit_mm: f64,
    /// Feed, a minute.
    pub feed: f64,
    code: u32,
    /// Heaters by their numbers, °C; the fan.
    pub celsius: [f64; 4],
    /// What M201 said of the axes, where the controller has it: a second squared.
    pub acceleration: [Option<f64>; AXES],
}

impl State {
    /// Powered up.
    pub fn new(rules: Rules) -> State {
        State {
            rules,
            position: [0.0; AXES],
            offset: [0.0; AXES],
            relative: false,
            extruder_relative: false,
            inverse_time: false,
            unit_mm: 1.0,
            feed: 1500.0,
            code: 0,
            celsius: [0.0; 4],
            acceleration: [None; AXES],
        }
    }

    /// Accelerations of the axes by M201, else by the configuration.
    pub fn accelerations(&self, configured: &[f64; AXES]) -> [f64; AXES] {
        std::array::from_fn(|axis| self.acceleration[axis].unwrap_or(configured[axis]))
    }

    /// What a print leaves of M201 other than it is configured.
    pub fn left_accelerations(&self, configured: &[f64; AXES]) -> Vec<String> {
        let now = self.accelerations(configured);
        let axes = self.rules.letters.iter().zip(now).zip(configured);
        let changed = axes.filter(|((_, now), was)| now != *was);
        changed
            .map(|((letter, now), _)| format!("M201 {letter}{now}"))
            .collect()
    }

    /// What is not as a print should leave it.
    pub fn left(&self) -> Vec<String> {
        let mut left = Vec::new();
        let mut note = |is: bool, text: String| left.extend(is.then_some(text));
        note(self.relative, "distances are relative".to_string());
        note(self.extruder_relative, "E is relative".to_string());
        let shifted = self.rules.machine_tool && self.offset != [0.0; AXES];
        note(shifted, "offsets of G92".to_string());
        note(self.inverse_time, "feed is inverse time".to_string());
        let turns = self.position[HEADING] / 360.0;
        let off = (turns - turns.round()).abs() > 1e-6;
        note(off, format!("the heading stands at {turns} turns"));
        for (heater, celsius) in self.celsius.iter().enumerate() {
            note(*celsius > 0.0, format!("output {heater} at {celsius}"));
        }
        left
    }

    /// A line's codes, then its move.
    ///
    /// # Errors
    /// What is not known.
    pub fn line(&mut self, words: &Words) -> Result<Option<Way>, String> {
        let mut moves = words
            .letters
            .iter()
            .all(|(letter, _)| !"GM".contains(*letter));
        for code in words.codes('G') {
            moves |= self.g_code(code, words)?;
        }
        for code in words.codes('M') {
            self.m_code(code, words)?;
        }
        let names = |letter: &char| words.number(*letter).is_some();
        match moves && self.rules.letters.iter().any(names) {
            true => self.way(words).map(Some),
            false => Ok(None),
        }
    }

    fn g_code(&mut self, code: f64, words: &Words) -> Result<bool, String> {
        let tools = self.rules.machine_tool;
        match ((10.0 * code).round() as u32, tools) {
            (0 | 10, _) => self.code = code as u32,
            (20 | 30, _) if self.rules.arcs => self.code = code as u32,
            (40, _) => {}
            (200 | 210, _) => {
                self.unit_mm = if code == 20.0 { 25.4 } else { 1.0 };
                return Ok(false);
            }
            (170, _) | (911 | 400 | 490 | 800 | 640, true) => return Ok(false),
            (900 | 910, _) => {
                self.relative = code == 91.0;
                return Ok(false);
            }
            (930 | 940, true) => {
                self.inverse_time = code == 93.0;
                return Ok(false);
            }
            (280, false) => {
                self.position[..3].fill(0.0);
                self.offset[..3].fill(0.0);
                return Ok(false);
            }
            (920, _) => {
                for axis in 0..AXES {
                    if let Some(number) = words.number(self.rules.letters[axis]) {
                        self.offset[axis] = self.position[axis] - number;
                    }
                }
                return Ok(false);
            }
            (921, true) => {
                self.offset = [0.0; AXES];
                return Ok(false);
            }
            _ => return Err(format!("G{code} is not known")),
        }
        Ok(true)
    }

    fn m_code(&mut self, code: f64, words: &Words) -> Result<(), String> {
        let name = format!("M{code}");
        let number = |letter: char| words.number(letter).unwrap_or(0.0);
        match (name.as_str(), self.rules.machine_tool) {
            ("M82" | "M83", false) => self.extruder_relative = code == 83.0,
            ("M104" | "M109", false) => self.celsius[0] = number('S'),
            ("M140" | "M190", false) => self.celsius[1] = number('S'),
            ("M106", false) => self.celsius[2] = number('S'),
            ("M107", false) => self.celsius[2] = 0.0,
            ("M73" | "M400", false) | ("M66", true) => {}
            ("M67" | "M68", true) => {
                let output = number('E') as usize;
                *self.celsius.get_mut(output).ok_or("no such output")? = number('Q');
            }
            // The end of a program: absolute, units a minute, G54, spindle off; offsets of G92 stay.
            ("M2", true) => (self.relative, self.inverse_time) = (false, false),
            ("M201", false) => {
                for axis in 0..AXES {
                    let said = words.number(self.rules.letters[axis]);
                    self.acceleration[axis] = said.or(self.acceleration[axis]);
                }
            }
            (name, _) if self.rules.codes.contains(&name) => {}
            _ => return Err(format!("{name} is not known")),
        }
        Ok(())
    }

    fn way(&mut self, words: &Words) -> Result<Way, String> {
        let from = self.position;
        let mut to = from;
        for axis in 0..AXES {
            let Some(number) = words.number(self.rules.letters[axis]) else {
                continue;
            };
            let turns = (3..EXTRUDER).contains(&axis);
            let number = number * if turns { 1.0 } else { self.unit_mm };
            let extruder = axis == EXTRUDER && !self.rules.machine_tool;
            let relative = self.relative || extruder && self.extruder_relative;
            to[axis] = number
                + if relative {
                    from[axis]
                } else {
                    self.offset[axis]
                };
        }
        let rapid = self.code == 0;
        let feed = words.number('F');
        if let Some(feed) = feed.filter(|_| !self.inverse_time) {
            self.feed = feed * self.unit_mm;
        }
        let inverse = self.inverse_time && !(rapid && self.rules.machine_tool);
        if inverse && feed.is_none() {
            return Err("inverse time without F".to_string());
        }
        let arc = (self.code > 1).then(|| arc(&from, &to, words, self.code == 2));
        let by: [f64; AXES] = std::array::from_fn(|axis| to[axis] - from[axis]);
        let plane_mm = match &arc {
            Some((centre, sweep)) => centre[0].hypot(centre[1]) * sweep.abs(),
            None => by[0].hypot(by[1]),
        };
        self.position = to;
        Ok(Way {
            by,
            to,
            length_mm: plane_mm.hypot(by[2]),
            arc,
            rapid,
            seconds: feed.filter(|_| inverse).map(|feed| 60.0 / feed),
        })
    }
}

/// Centre from the start, and sweep: less than a whole turn, where the ends differ.
fn arc(from: &[f64; AXES], to: &[f64; AXES], words: &Words, clockwise: bool) -> ([f64; 2], f64) {
    let centre = ['I', 'J'].map(|letter| words.number(letter).unwrap_or(0.0));
    let angle = |x: f64, y: f64| y.atan2(x);
    let begin = angle(-centre[0], -centre[1]);
    let end = angle(to[0] - from[0] - centre[0], to[1] - from[1] - centre[1]);
    let turn = (end - begin).rem_euclid(TAU);
    (centre, if clockwise { turn - TAU } else { turn })
}

impl Way {
    /// Places along it, an arc in chords.
    pub fn places(&self) -> Vec<[f64; 6]> {
        const CHORD_RAD: f64 = 0.02;
        let from: [f64; 6] = std::array::from_fn(|axis| self.to[axis] - self.by[axis]);
        let chords = self
            .arc
            .map_or(1.0, |(_, sweep)| (sweep.abs() / CHORD_RAD).ceil());
        let place = |k: u32| {
            let share = f64::from(k) / chords;
            let mut place: [f64; 6] =
                std::array::from_fn(|axis| from[axis] + share * self.by[axis]);
            if let Some((centre, sweep)) = self.arc {
                let (sin, cos) = (share * sweep).sin_cos();
                let [x, y] = centre.map(|part| -part);
                place[0] = from[0] + centre[0] + cos * x - sin * y;
                place[1] = from[1] + centre[1] + sin * x + cos * y;
            }
            place
        };
        (1..=chords as u32).map(place).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::words::words;
    use super::*;

    /// Goal: modes and offsets as RS274 has them. Method: lines with what they leave.
    #[test]
    fn lines_leave_their_modes() {
        let mut state = State::new(Rules {
            letters: ['X', 'Y', 'Z', 'A', 'B', 'C', 'U'],
            machine_tool: true,
            arcs: true,
            codes: &[],
        });
        let mut run = |text: &str| state.line(&words(text).expect("words").expect("a line"));
        assert_eq!(run("G21 G90 G91.1 G17 G40 G49 G80"), Ok(None));
        run("G0 C90").expect("a move");
        run("G92 C0 U5").expect("an offset");
        assert!(run("G93").is_ok() && run("G1 C10").is_err());
        let way = run("G1 C10 U6 F120").expect("a line").expect("a move");
        assert_eq!(
            (way.to[HEADING], way.by[EXTRUDER], way.seconds),
            (100.0, 1.0, Some(0.5))
        );
        // A quarter of a circle of 2 mm about X0 Y2.
        let way = run("G3 X2 Y2 I0 J2 F60").expect("a line").expect("an arc");
        assert!(
            (way.length_mm - std::f64::consts::PI).abs() < 1e-9,
            "{way:?}"
        );
        let last = way.places().pop().expect("a place");
        assert!((last[0] - 2.0).abs() < 1e-9 && (last[1] - 2.0).abs() < 1e-9);
        assert_eq!(state.left().len(), 3, "{:?}", state.left());
    }
}

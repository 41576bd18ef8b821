//! Lines in order -> steps of the head: what a controller's modes make of them.
//!
//! In: the text. Out: [`Steps`]: places (mm, degrees) in one frame, filament, speeds (mm/s), with the
//! line of each. Modes: units (G20, G21), distances (G90, G91, M82, M83), planes (G17 to G19), arc
//! centres (G90.1, G91.1), feed (G93, G94), offsets (G92), filament (M200, M221), speed (M220), firmware
//! retraction (G10, G11, M207, M208; M227 and M228 as prime and retract). What else a line says is not done
//! and told with its number. Source: RS274/NGC 3 (NIST IR 6556), Marlin's and Klipper's command lists.

use super::arcs::{ArcWords, arc_chords, bezier_chords};
use super::comments::{Comments, Hint};
use super::error::GcodeError;
use super::words::{Line, Word, read_line, shortened};
use super::{ANGLE_MAX_DEG, MOVES_MAX, PLACE_MAX_MM};
use std::collections::BTreeMap;

/// Fastest feed that is taken, mm/min.
const FEED_MAX_MM_MIN: f64 = 1e7;
/// Farthest that E goes in a file, mm or mm³.
const EXTRUDER_MAX: f64 = 1e9;
/// Feed before the first F, mm/min, as Marlin has it.
const FEED_DEFAULT_MM_MIN: f64 = 1500.0;
/// Letters of the axes, in the order of a place.
const AXES: [u8; 6] = *b"XYZABC";

/// What a step does to the melt beside what it extrudes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Firmware {
    /// Nothing.
    None,
    /// Firmware retraction, mm of filament where M207 says it.
    Retract(Option<f64>),
    /// Its end.
    Prime(Option<f64>),
}

/// One straight step; a curve is many.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Line from 1.
    pub line: usize,
    /// Where it goes: X, Y, Z mm, A, B, C degrees.
    pub to: [f64; 6],
    /// What goes through the extruder, mm of filament, or mm³ where `volumetric`.
    pub extruded: f64,
    /// The unit of that.
    pub volumetric: bool,
    /// Tip speed, mm/s.
    pub speed_mm_s: f64,
    /// G0.
    pub rapid: bool,
    /// Number of what comments say of it.
    pub hint: usize,
    /// Firmware retraction.
    pub firmware: Firmware,
}

/// A file's steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Steps {
    /// Steps in order.
    pub steps: Vec<Step>,
    /// What comments say; steps have the numbers.
    pub hints: Vec<Hint>,
    /// All that comments say of the whole.
    pub comments: Comments,
    /// Some move names the extruder.
    pub extrudes: bool,
    /// Some move names A or B; C.
    pub turns: [bool; 2],
    /// Temperatures and fans, with their lines.
    pub carried: Vec<String>,
    /// What is not done: first line and times.
    pub undone: BTreeMap<String, (usize, usize)>,
    /// Lines that were read.
    pub lines: usize,
}

/// The motion in force.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    Line { rapid: bool },
    Arc { clockwise: bool },
    Bezier,
}

struct Interpreter {
    found: Steps,
    at: [f64; 6],
    offset: [f64; 6],
    e: f64,
    unit_mm: f64,
    relative: bool,
    e_relative: bool,
    centres_absolute: bool,
    plane: [usize; 3],
    inverse_time: bool,
    feed_mm_min: f64,
    motion: Option<Motion>,
    bezier_mm: [f64; 2],
    volumetric: bool,
    speed_factor: f64,
    flow_factor: f64,
    retract_mm: [Option<f64>; 2],
    tool: Option<u32>,
    has_printed: bool,
    ended: bool,
}

/// Reads all lines.
///
/// # Errors
/// [`GcodeError`], the first.
pub fn steps(text: &str) -> Result<Steps, GcodeError> {
    let mut interpreter = Interpreter::new();
    for (index, text) in text.lines().enumerate() {
        let number = index + 1;
        interpreter.found.lines = number;
        let line = read_line(text, number)?;
        let before = interpreter.found.comments.hint;
        for comment in &line.comments {
            interpreter.found.comments.read(comment);
        }
        let hint = interpreter.found.comments.hint;
        if hint != before {
            interpreter.found.hints.push(hint);
        }
        // Settings at the end of a file are comments.
        if !interpreter.ended {
            interpreter.line(&line, number)?;
        }
    }
    Ok(interpreter.found)
}

/// A code in tenths: G92.1 is 921.
fn tenths(word: &Word) -> i64 {
    let value = word.value.unwrap_or(-1.0);
    (value * 10.0).round().clamp(-1e6, 1e6) as i64
}

fn code_name(word: &Word) -> String {
    match word.value {
        Some(value) => format!("{}{value}", char::from(word.letter)),
        None => char::from(word.letter).to_string(),
    }
}

impl Interpreter {
    fn new() -> Interpreter {
        Interpreter {
            found: Steps {
                hints: vec![Hint::default()],
                ..Steps::default()
            },
            at: [0.0; 6],
            offset: [0.0; 6],
            e: 0.0,
            unit_mm: 1.0,
            relative: false,
            e_relative: false,
            centres_absolute: false,
            plane: [0, 1, 2],
            inverse_time: false,
            feed_mm_min: FEED_DEFAULT_MM_MIN,
            motion: None,
            bezier_mm: [0.0; 2],
            volumetric: false,
            speed_factor: 1.0,
            flow_factor: 1.0,
            retract_mm: [None; 2],
            tool: None,
            has_printed: false,
            ended: false,
        }
    }

    fn undone(&mut self, what: String, line: usize) {
        let entry = self.found.undone.entry(what).or_insert((line, 0));
        entry.1 += 1;
    }

    fn line(&mut self, line: &Line, number: usize) -> Result<(), GcodeError> {
        if let Some(command) = line.command {
            let name: String = command
                .split(|c: char| c.is_whitespace() || c == '"')
                .next()
                .map(shortened)
                .unwrap_or_default();
            self.undone(name, number);
            return Ok(());
        }
        let mut motion: Option<(Motion, String)> = None;
        let mut is_taken = false;
        let mut in_machine = false;
        for word in &line.words {
            match word.letter {
                b'G' => {
                    let code = tenths(word);
                    if let Some(next) = motion_of(code) {
                        let name = code_name(word);
                        if let Some((_, first)) = &motion {
                            let first = first.clone();
                            let second = name;
                            let line = number;
                            return Err(GcodeError::TwoMotions {
                                line,
                                first,
                                second,
                            });
                        }
                        motion = Some((next, name));
                    } else if code == 530 {
                        in_machine = true;
                    } else {
                        is_taken |= self.g_code(code, word, line, number)?;
                    }
                }
                b'M' => {
                    self.m_code(word, line, number)?;
                    is_taken = true;
                }
                b'T' => {
                    self.tool_change(word, number)?;
                    is_taken = true;
                }
                _ => {}
            }
        }
        if let Some((motion, _)) = motion {
            self.motion = Some(motion);
        } else if is_taken {
            return Ok(());
        }
        let extruder = self.extruder();
        let is_motion = |word: &Word| AXES.contains(&word.letter) || word.letter == extruder;
        if line.words.iter().any(is_motion) {
            return self.go(line, number, in_machine);
        }
        // A feed alone.
        self.feed(line, number)?;
        Ok(())
    }

    fn extruder(&self) -> u8 {
        self.found.comments.extruder.unwrap_or(b'E')
    }

    /// Modes and codes that are no motion; true where they take the line's axis words.
    fn g_code(
        &mut self,
        code: i64,
        word: &Word,
        line: &Line,
        number: usize,
    ) -> Result<bool, GcodeError> {
        let not_read = |remedy: &'static str| GcodeError::NotRead {
            line: number,
            code: code_name(word),
            remedy,
        };
        match code {
            170 => self.plane = [0, 1, 2],
            180 => self.plane = [2, 0, 1],
            190 => self.plane = [1, 2, 0],
            200 => self.unit_mm = 25.4,
            210 => self.unit_mm = 1.0,
            900 | 910 => {
                self.relative = code == 910;
                if self.found.comments.modes_of_e {
                    self.e_relative = self.relative;
                }
            }
            901 => self.centres_absolute = true,
            911 => self.centres_absolute = false,
            930 => self.inverse_time = true,
            940 => self.inverse_time = false,
            920 => {
                self.set_position(line, number)?;
                return Ok(true);
            }
            921 | 922 => self.offset = [0.0; 6],
            280 => {
                self.home(line);
                return Ok(true);
            }
            100 | 110 if line.words.iter().any(|word| word.letter == b'L') => {
                return Err(not_read(
                    "coordinate systems are not kept: write places of one system (G54)",
                ));
            }
            100 => self.firmware(Firmware::Retract(self.retract_mm[0]), number)?,
            110 => self.firmware(Firmware::Prime(self.retract_mm[1]), number)?,
            // Path control, cancelled offsets, the first coordinate system: as it is.
            400 | 490 | 540 | 610 | 611 | 640 | 690 | 800 | 970 | 980 | 990 => {}
            410 | 420 => {
                return Err(not_read(
                    "offset by the tool's radius: let the post-processor compute it",
                ));
            }
            550..=599 => {
                return Err(not_read(
                    "write all places in the first coordinate system (G54)",
                ));
            }
            730 | 760 | 810..=899 => {
                return Err(not_read("let the post-processor write its moves out"));
            }
            51..=53 | 331 | 950 | 960 => {
                return Err(not_read("write it as G1, G2, G3 or G5, with G94 or G93"));
            }
            _ => {
                self.undone(code_name(word), number);
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn m_code(&mut self, word: &Word, line: &Line, number: usize) -> Result<(), GcodeError> {
        match tenths(word) {
            820 => self.e_relative = false,
            830 => self.e_relative = true,
            20 | 300 => self.ended = true,
            1040 | 1060 | 1070 | 1090 | 1400 | 1410 | 1900 | 1910 => {
                let parameters: Vec<String> = line.words.iter().map(code_name).collect();
                self.found
                    .carried
                    .push(format!("line {number} {}", parameters.join(" ")));
            }
            2000 => self.filament(line, number)?,
            2070 => self.retract_mm[0] = self.length(line, b'S', number)?.map(f64::abs),
            2080 => {
                let more_mm = self.length(line, b'S', number)?.unwrap_or(0.0);
                self.retract_mm[1] = self.retract_mm[0].map(|mm| (mm + more_mm).max(0.0));
            }
            2200 | 2210 => {
                let Some(percent) = value(line, b'S', number)? else {
                    return Ok(());
                };
                if !(1.0..=1000.0).contains(&percent) {
                    let (letter, most) = ('S', 1000.0);
                    return Err(GcodeError::Beyond {
                        line: number,
                        letter,
                        value: percent,
                        most,
                    });
                }
                match tenths(word) {
                    2200 => self.speed_factor = percent / 100.0,
                    _ => self.flow_factor = percent / 100.0,
                }
            }
            1010 => self.firmware(Firmware::Prime(self.retract_mm[1]), number)?,
            1030 => self.firmware(Firmware::Retract(self.retract_mm[0]), number)?,
            2270 if line.words.len() == 1 => self.firmware(Firmware::Prime(None), number)?,
            2280 if line.words.len() == 1 => self.firmware(Firmware::Retract(None), number)?,
            _ => self.undone(code_name(word), number),
        }
        Ok(())
    }

    /// M200: E in mm³ with a diameter, in mm with 0.
    fn filament(&mut self, line: &Line, number: usize) -> Result<(), GcodeError> {
        let diameter_mm = value(line, b'D', number)?;
        let is_on = value(line, b'S', number)?.map(|on| on != 0.0);
        match diameter_mm {
            Some(diameter_mm) if diameter_mm != 0.0 => {
                if !(super::FILAMENT_MM[0]..=super::FILAMENT_MM[1]).contains(&diameter_mm) {
                    return Err(GcodeError::Filament {
                        line: number,
                        diameter_mm,
                    });
                }
                self.found.comments.filament_mm = Some(diameter_mm);
                self.volumetric = is_on.unwrap_or(true);
            }
            Some(_) => self.volumetric = false,
            None => self.volumetric = is_on.unwrap_or(self.volumetric),
        }
        Ok(())
    }

    fn tool_change(&mut self, word: &Word, number: usize) -> Result<(), GcodeError> {
        // "T-1", "T?": no tool, which one.
        let Some(tool) = word.value.filter(|tool| *tool >= 0.0) else {
            return Ok(());
        };
        let tool = tool.min(1e6) as u32;
        match self.tool {
            Some(before) if before != tool && self.has_printed => Err(GcodeError::SecondTool {
                line: number,
                tool,
                before,
            }),
            _ => {
                self.tool = Some(tool);
                Ok(())
            }
        }
    }

    /// G92.
    fn set_position(&mut self, line: &Line, number: usize) -> Result<(), GcodeError> {
        let extruder = self.extruder();
        if let Some(e) = self.length(line, extruder, number)? {
            self.e = e;
        }
        for (axis, letter) in AXES.into_iter().enumerate() {
            if let Some(place) = self.place(line, letter, number)? {
                self.offset[axis] = self.at[axis] - place;
            }
        }
        Ok(())
    }

    /// G28: the head is at the machine's zero.
    fn home(&mut self, line: &Line) {
        let named = |letter: u8| line.words.iter().any(|word| word.letter == letter);
        let all = !AXES.iter().any(|letter| named(*letter));
        for (axis, letter) in AXES.into_iter().enumerate() {
            if all || named(letter) {
                self.at[axis] = 0.0;
                self.offset[axis] = 0.0;
            }
        }
    }

    fn length(&self, line: &Line, letter: u8, number: usize) -> Result<Option<f64>, GcodeError> {
        let given = value(line, letter, number)?.map(|value| value * self.unit_mm);
        bounded(given, letter, number, EXTRUDER_MAX)
    }

    /// An axis' word in mm or degrees.
    fn place(&self, line: &Line, letter: u8, number: usize) -> Result<Option<f64>, GcodeError> {
        let is_linear = matches!(letter, b'X' | b'Y' | b'Z');
        let scale = if is_linear { self.unit_mm } else { 1.0 };
        let given = value(line, letter, number)?.map(|value| value * scale);
        let most = if is_linear {
            PLACE_MAX_MM
        } else {
            ANGLE_MAX_DEG
        };
        bounded(given, letter, number, most)
    }

    /// The line's F; true where there is one.
    fn feed(&mut self, line: &Line, number: usize) -> Result<bool, GcodeError> {
        let Some(feed) = value(line, b'F', number)? else {
            return Ok(false);
        };
        if !(feed > 0.0 && feed.is_finite()) {
            return Err(GcodeError::Feed {
                line: number,
                value: feed,
            });
        }
        let scale = if self.inverse_time { 1.0 } else { self.unit_mm };
        bounded(Some(feed * scale), b'F', number, FEED_MAX_MM_MIN)?;
        self.feed_mm_min = feed * scale;
        Ok(true)
    }

    fn firmware(&mut self, firmware: Firmware, line: usize) -> Result<(), GcodeError> {
        self.push(self.at, 0.0, self.feed_mm_min / 60.0, false, firmware, line)
    }

    fn push(
        &mut self,
        to: [f64; 6],
        extruded: f64,
        speed_mm_s: f64,
        rapid: bool,
        firmware: Firmware,
        line: usize,
    ) -> Result<(), GcodeError> {
        if self.found.steps.len() >= MOVES_MAX {
            return Err(GcodeError::TooMany { line });
        }
        self.found.steps.push(Step {
            line,
            to,
            extruded,
            volumetric: self.volumetric,
            speed_mm_s,
            rapid,
            hint: self.found.hints.len() - 1,
            firmware,
        });
        self.has_printed |= extruded > 0.0;
        self.at = to;
        Ok(())
    }

    /// A motion: to the line's place, by the motion in force.
    fn go(&mut self, line: &Line, number: usize, in_machine: bool) -> Result<(), GcodeError> {
        let motion = self.motion.ok_or(GcodeError::NoMotion { line: number })?;
        let rapid = motion == Motion::Line { rapid: true };
        let has_feed = self.feed(line, number)?;
        if self.inverse_time && !rapid && !has_feed {
            return Err(GcodeError::NoInverseTime { line: number });
        }
        let mut to = self.at;
        for (axis, letter) in AXES.into_iter().enumerate() {
            let Some(place) = self.place(line, letter, number)? else {
                continue;
            };
            if axis >= 3 {
                self.found.turns[usize::from(axis == 5)] = true;
            }
            to[axis] = match (self.relative, in_machine) {
                (_, true) => place,
                (true, _) => self.at[axis] + place,
                (false, _) => self.offset[axis] + place,
            };
            let most = if axis < 3 {
                PLACE_MAX_MM
            } else {
                ANGLE_MAX_DEG
            };
            bounded(Some(to[axis]), letter, number, most)?;
        }
        let extruder = self.extruder();
        let mut extruded = 0.0;
        if let Some(e) = self.length(line, extruder, number)? {
            extruded = if self.e_relative { e } else { e - self.e };
            self.e += extruded;
            bounded(Some(self.e), extruder, number, EXTRUDER_MAX)?;
            self.found.extrudes = true;
        }
        extruded *= self.flow_factor;
        let places = match motion {
            Motion::Line { .. } => Vec::new(),
            Motion::Arc { clockwise } => self.arc(line, to, clockwise, number)?,
            Motion::Bezier => self.bezier(line, to, number)?,
        };
        self.along(&places, to, extruded, rapid, number)
    }

    /// Along the places of a curve in its plane, everything else evenly; straight without them.
    fn along(
        &mut self,
        places: &[[f64; 2]],
        to: [f64; 6],
        extruded: f64,
        rapid: bool,
        number: usize,
    ) -> Result<(), GcodeError> {
        let from = self.at;
        let mut way = vec![from];
        let count = places.len();
        for (k, place) in places.iter().enumerate().take(count.saturating_sub(1)) {
            let share = (k + 1) as f64 / count as f64;
            let mut at: [f64; 6] =
                std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]));
            at[self.plane[0]] = place[0];
            at[self.plane[1]] = place[1];
            way.push(at);
        }
        way.push(to);
        let length = |range: std::ops::Range<usize>| -> f64 {
            way.windows(2)
                .map(|pair| {
                    range
                        .clone()
                        .map(|axis| (pair[1][axis] - pair[0][axis]).powi(2))
                        .sum::<f64>()
                        .sqrt()
                })
                .sum()
        };
        // The feed is the tip's; of the rotary axes where the tip stands.
        let (tip_mm, turned_deg) = (length(0..3), length(3..6));
        let speed = match self.inverse_time && !rapid {
            true => (if tip_mm > 0.0 { tip_mm } else { turned_deg }) * self.feed_mm_min / 60.0,
            false => self.feed_mm_min / 60.0,
        };
        let speed_mm_s = (speed * self.speed_factor).max(1e-6);
        for pair in way.windows(2) {
            let leg: f64 = (0..3)
                .map(|axis| (pair[1][axis] - pair[0][axis]).powi(2))
                .sum::<f64>()
                .sqrt();
            let share = match tip_mm > 0.0 {
                true => leg / tip_mm,
                false => 1.0 / (way.len() - 1) as f64,
            };
            self.push(
                pair[1],
                extruded * share,
                speed_mm_s,
                rapid,
                Firmware::None,
                number,
            )?;
        }
        Ok(())
    }

    fn arc(
        &self,
        line: &Line,
        to: [f64; 6],
        clockwise: bool,
        number: usize,
    ) -> Result<Vec<[f64; 2]>, GcodeError> {
        let [u, v, _] = self.plane;
        let mut centre = [0.0; 2];
        let mut is_given = false;
        for (slot, axis) in [u, v].into_iter().enumerate() {
            let letter = b"IJK"[axis];
            if let Some(given) = self.length(line, letter, number)? {
                is_given = true;
                centre[slot] = match self.centres_absolute {
                    true => self.offset[axis] + given - self.at[axis],
                    false => given,
                };
            } else if self.centres_absolute {
                centre[slot] = -self.at[axis] + self.offset[axis];
            }
        }
        let words = ArcWords {
            clockwise,
            centre_mm: is_given.then_some(centre),
            radius_mm: self.length(line, b'R', number)?,
            turns: value(line, b'P', number)?,
        };
        arc_chords([self.at[u], self.at[v]], [to[u], to[v]], &words, number)
    }

    fn bezier(
        &mut self,
        line: &Line,
        to: [f64; 6],
        number: usize,
    ) -> Result<Vec<[f64; 2]>, GcodeError> {
        let bad = |problem: &str| GcodeError::Arc {
            line: number,
            problem: problem.to_string(),
        };
        if self.plane != [0, 1, 2] {
            return Err(bad("(G5) lies in the XY plane: write G17 before it"));
        }
        let first = [
            self.length(line, b'I', number)?,
            self.length(line, b'J', number)?,
        ];
        let second = [
            self.length(line, b'P', number)?,
            self.length(line, b'Q', number)?,
        ];
        let ([Some(p), Some(q)], [i, j]) = (second, first) else {
            return Err(bad(
                "(G5) needs P and Q, its second control point from its end",
            ));
        };
        // Without I and J it goes on as the one before it ended.
        let [i, j] = match (i, j) {
            (Some(i), Some(j)) => [i, j],
            (None, None) => self.bezier_mm,
            _ => return Err(bad("(G5) needs both I and J, or neither")),
        };
        self.bezier_mm = [-p, -q];
        let from = [self.at[0], self.at[1]];
        let end = [to[0], to[1]];
        Ok(bezier_chords([
            from,
            [from[0] + i, from[1] + j],
            [end[0] + p, end[1] + q],
            end,
        ]))
    }
}

fn motion_of(tenths: i64) -> Option<Motion> {
    match tenths {
        0 => Some(Motion::Line { rapid: true }),
        10 => Some(Motion::Line { rapid: false }),
        20 => Some(Motion::Arc { clockwise: true }),
        30 => Some(Motion::Arc { clockwise: false }),
        50 => Some(Motion::Bezier),
        _ => None,
    }
}

/// A word's number.
fn value(line: &Line, letter: u8, number: usize) -> Result<Option<f64>, GcodeError> {
    let word = line.words.iter().find(|word| word.letter == letter);
    match word {
        None => Ok(None),
        Some(Word {
            value: Some(value), ..
        }) => Ok(Some(*value)),
        Some(Word { value: None, .. }) => Err(GcodeError::Number {
            line: number,
            letter: char::from(letter),
            text: String::new(),
        }),
    }
}

fn bounded(
    given: Option<f64>,
    letter: u8,
    line: usize,
    most: f64,
) -> Result<Option<f64>, GcodeError> {
    match given {
        Some(value) if !value.is_finite() || value.abs() > most => Err(GcodeError::Beyond {
            line,
            letter: char::from(letter),
            value,
            most,
        }),
        given => Ok(given),
    }
}

//! Lines in order -> steps of the head: what a controller's modes make of them.
//!
//! In: the text. Out: [`Steps`]: places (mm, degrees) in one frame, filament, speeds (mm/s), with the
//! line of each. Modes: units (G20, G21), distances (G90, G91, M82, M83), planes (G17 to G19), arc
//! centres (G90.1, G91.1), feed (G93, G94), offsets (G92), filament (M200, M221), speed (M220), firmware
//! retraction (G10, G11, M207, M208; M227 and M228 as prime and retract). Heaters and fans are orders among the
//! steps. What else a line says is not done and told with its number. Source: RS274/NGC 3 (NIST IR 6556),
//! Marlin's and Klipper's command lists.

mod codes;
mod heat;
mod klipper;
mod moves;
mod state;
mod turned;
mod undeclared;

use crate::gcode::error;
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;
pub use heat::HeatStep;

use super::axes::{At, FileAxes, SLOTS};
use super::comments::{Comments, Hint};
use super::extrusion::{Counted, Taken};
use super::flavour::Flavour;
use super::words::{Line, Word, lines, read_line, shortened};
use super::{GcodeOptions, MOVES_MAX};
use heat::Targets;
use state::Saved;
use std::collections::BTreeMap;
use std::sync::Arc;
use undeclared::Winding;

/// Fastest feed that is taken, mm/min.
const FEED_MAX_MM_MIN: f64 = 1e7;
/// Farthest that E goes in a file, mm or mm³.
const EXTRUDER_MAX: f64 = 1e9;
/// Feed before the first F, mm/min, as Marlin has it.
const FEED_DEFAULT_MM_MIN: f64 = 1500.0;
/// Straight moves that curves may come to: so many, and for each byte read so many more. An arc of 1 m has
/// 25 for each byte of its line.
const CURVE_MOVES_MIN: usize = 200_000;
const CURVE_MOVES_A_BYTE: usize = 40;
/// Way of the turns that arcs make beside their own (P), mm: so far, and for each byte read so much more. A bore of
/// 20 mm with ten turns has 600 mm in a line of 30 bytes.
const TURNS_MIN_MM: f64 = 2000.0;
const TURNS_MM_A_BYTE: f64 = 50.0;

/// What a step does to the material beside what it extrudes.
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
    /// Where it goes: X, Y, Z mm, A, B, C degrees, as [`super::Place`] has them.
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
    /// The tool tilts (some move names A or B); headings are told (C).
    pub turns: [bool; 2],
    /// Where the first move begins, as `to` of a step.
    pub start: [f64; 6],
    /// Orders of heaters and fans.
    pub heat: Vec<HeatStep>,
    /// Lines that say what no job does, by their numbers.
    pub left: Vec<HeatStep<usize>>,
    /// Those that no job has, with their lines.
    pub carried: Vec<String>,
    /// What was taken from the words of macros.
    pub macros: Vec<String>,
    /// What is not done: first line and times.
    pub undone: BTreeMap<String, (usize, usize)>,
    /// Lines that were read.
    pub lines: usize,
    /// What tells how E is meant.
    pub counted: Counted,
    /// Where another tool than the first moves by a feed: it matters where nothing extrudes.
    pub second_tool: Option<Refusal>,
    /// How C turns while the tip moves, where nothing says what it is.
    winding: Winding,
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
    /// The axes of the machine that the file was written for, where they are declared.
    axes: Option<Arc<FileAxes>>,
    /// Letters of the tilts and the heading of a head that tilts, where they are.
    head_letters: Option<[u8; 3]>,
    at: At,
    offset: At,
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
    /// G10, or G11, came last.
    retracted: Option<bool>,
    /// Offsets of G92 before G92.2.
    suspended: Option<At>,
    flavour: Flavour,
    /// M82 or M83 was given, or a setting says the same.
    e_is_said: bool,
    /// States to come back to: of Klipper by their names, and a stack.
    saved: Saved,
    targets: Targets,
    tool: Option<u32>,
    /// The tool whose beads were printed; line of the last change.
    printing_tool: Option<u32>,
    changed: Option<usize>,
    /// The tool of the last M6; that of the first feed without extrusion.
    cutter: Option<u32>,
    cutting_tool: Option<u32>,
    /// Spindle or laser: on or off since M3, M4 or M5, and its S.
    tool_on: Option<bool>,
    power: Option<f64>,
    /// Straight moves that curves may still come to.
    curve_moves_left: usize,
    /// Way that further turns of arcs may still have.
    turns_mm_left: f64,
    ended: bool,
}

/// Reads all lines, as `flavour` has them, E as `taken`.
///
/// # Errors
/// [`Refusal`], the first.
pub fn steps(
    text: &str,
    flavour: Flavour,
    taken: &Taken,
    is_said: bool,
    options: &GcodeOptions,
) -> Result<Steps, Refusal> {
    let mut interpreter = Interpreter {
        axes: options.axes.clone(),
        head_letters: options.head_letters,
        flavour,
        e_relative: taken.relative,
        volumetric: taken.volumetric,
        e_is_said: is_said,
        ..Interpreter::new()
    };
    interpreter.begin();
    for (index, text) in lines(text).enumerate() {
        let number = index + 1;
        interpreter.found.lines = number;
        interpreter.curve_moves_left += CURVE_MOVES_A_BYTE * text.len();
        interpreter.turns_mm_left += TURNS_MM_A_BYTE * text.len() as f64;
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
    interpreter.ask_winding()?;
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
            axes: None,
            head_letters: None,
            at: [0.0; SLOTS],
            offset: [0.0; SLOTS],
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
            retracted: None,
            suspended: None,
            flavour: Flavour::Unknown,
            e_is_said: false,
            saved: Saved::default(),
            targets: Targets::default(),
            tool: None,
            printing_tool: None,
            changed: None,
            cutter: None,
            cutting_tool: None,
            tool_on: None,
            power: None,
            curve_moves_left: CURVE_MOVES_MIN,
            turns_mm_left: TURNS_MIN_MM,
            ended: false,
        }
    }

    fn undone(&mut self, what: String, line: usize) {
        let entry = self.found.undone.entry(what).or_insert((line, 0));
        entry.1 += 1;
        self.left(line);
    }

    /// A line that says what no job does.
    fn left(&mut self, line: usize) {
        if self.found.left.last().is_none_or(|last| last.line < line) {
            let step = self.found.steps.len();
            let order = line;
            self.found.left.push(HeatStep { line, step, order });
        }
    }

    /// A command with a text or with parameters of any kind.
    fn text(&mut self, command: &str, number: usize) -> Result<(), Refusal> {
        let name: String = command
            .split(|c: char| c.is_whitespace() || c == '"')
            .next()
            .map(shortened)
            .unwrap_or_default();
        match name.as_str() {
            _ if self.extended(&name, command, number)? => {}
            // Waiting and progress: nothing to do.
            "M400" | "M73" | "M105" => {}
            // The second one ends a program.
            "%" => self.ended = !self.found.steps.is_empty(),
            _ if codes::is_curve(&name) => {
                return Err(codes::no_corners(name, number));
            }
            _ if codes::is_computed(&name, command) => {
                return Err(error::computed(number));
            }
            _ => {
                self.start_macro(&name, command, number)?;
                self.undone(name, number);
            }
        }
        Ok(())
    }

    fn line(&mut self, line: &Line, number: usize) -> Result<(), Refusal> {
        if let Some(command) = line.command {
            return self.text(command, number);
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
                            return Err(refusal!(
                                "line {line}: two motions in one line ({first} and {second}): \
                                 divide it"
                            ));
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
                    // Axes beside a spindle, a coolant, a pause are those of the motion in force.
                    is_taken |= !(0..100).contains(&tenths(word));
                }
                // Beside another code T is its parameter; M6 changes to it.
                b'T' if line.words.iter().all(is_beside_tool) => {
                    self.tool_change(word, number);
                    is_taken = true;
                }
                _ => {}
            }
        }
        if line.words.iter().any(is_tool_change) {
            self.cutter = self.tool;
        }
        if let Some((motion, _)) = motion {
            self.motion = Some(motion);
        } else if is_taken {
            return Ok(());
        }
        let extruder = self.extruder();
        let axes = self.axes();
        // A full circle names its centre alone.
        let is_circle = matches!(self.motion, Some(Motion::Arc { .. }));
        let is_motion = |word: &Word| {
            axes.contains(&word.letter)
                || word.letter == extruder
                || is_circle && matches!(word.letter, b'I' | b'J' | b'K')
        };
        self.set_power(line, number)?;
        if line.words.iter().any(is_motion) {
            return self.go(line, number, in_machine);
        }
        // A feed alone; F0 keeps the one before.
        match value(line, b'F', number)? {
            Some(0.0) => self.undone("F0".to_string(), number),
            _ => {
                self.feed(line, number)?;
            }
        }
        Ok(())
    }

    fn length(&self, line: &Line, letter: u8, number: usize) -> Result<Option<f64>, Refusal> {
        let given = value(line, letter, number)?.map(|value| value * self.unit_mm);
        bounded(given, letter, number, EXTRUDER_MAX)
    }

    /// The line's F; true where there is one.
    fn feed(&mut self, line: &Line, number: usize) -> Result<bool, Refusal> {
        let Some(feed) = value(line, b'F', number)? else {
            return Ok(false);
        };
        // Marlin keeps its feed.
        if feed == 0.0 && self.flavour == Flavour::Marlin && !self.inverse_time {
            return Ok(false);
        }
        if !(feed > 0.0 && feed.is_finite()) {
            return Err(refusal!(
                "line {number}: F{} is no feed rate; it must be above 0",
                Short(feed)
            ));
        }
        let scale = if self.inverse_time { 1.0 } else { self.unit_mm };
        bounded(Some(feed * scale), b'F', number, FEED_MAX_MM_MIN)?;
        self.feed_mm_min = feed * scale;
        Ok(true)
    }

    fn firmware(&mut self, firmware: Firmware, line: usize) -> Result<(), Refusal> {
        self.push(self.at, 0.0, self.feed_mm_min / 60.0, false, firmware, line)
    }

    fn push(
        &mut self,
        to: At,
        extruded: f64,
        speed_mm_s: f64,
        rapid: bool,
        firmware: Firmware,
        line: usize,
    ) -> Result<(), Refusal> {
        if self.found.steps.len() >= MOVES_MAX {
            return Err(refusal!(
                "line {line}: more than {MOVES_MAX} moves: print it in parts, or slice it more \
                 coarsely"
            ));
        }
        let place = self.place_of(&to, rapid);
        self.found.steps.push(Step {
            line,
            to: place,
            extruded,
            volumetric: self.volumetric,
            speed_mm_s,
            rapid,
            hint: self.found.hints.len() - 1,
            firmware,
        });
        if extruded > 0.0 {
            self.prints(to != self.at)?;
        } else if !rapid && to != self.at {
            self.cuts();
        }
        self.at = to;
        Ok(())
    }
}

/// True for words that a tool change may have beside it.
fn is_beside_tool(word: &Word) -> bool {
    match word.letter {
        b'M' => is_tool_change(word),
        b'G' => motion_of(tenths(word)).is_some(),
        _ => true,
    }
}

fn is_tool_change(word: &Word) -> bool {
    word.letter == b'M' && tenths(word) == 60
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
fn value(line: &Line, letter: u8, number: usize) -> Result<Option<f64>, Refusal> {
    let word = line.words.iter().find(|word| word.letter == letter);
    match word {
        None => Ok(None),
        Some(Word {
            value: Some(value), ..
        }) => Ok(Some(*value)),
        Some(Word { value: None, .. }) => Err(error::number(number, char::from(letter), "")),
    }
}

fn bounded(given: Option<f64>, letter: u8, line: usize, most: f64) -> Result<Option<f64>, Refusal> {
    match given {
        Some(value) if !value.is_finite() || value.abs() > most => {
            Err(error::beyond(line, char::from(letter), value, most))
        }
        given => Ok(given),
    }
}

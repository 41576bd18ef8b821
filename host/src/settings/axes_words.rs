//! The words of `--axes`: which letter of a file is which axis of the machine that it was written for.
//!
//! ```text
//! A=table:x,C=table:z:at=10/0/-5,coordinates=pivot
//! -B=head:y:at=0/0/42:zero=90,U=heading,coordinates=tip,feed=tip
//! stepper_b=table:x,stepper_a=table:z,coordinates=pivot
//! machine:their-machine.toml,letters=X/Y/Z/B/C/H
//! ```
//! In: the text. Out: [`AxesWords`] (mm, rad). Axes of a side come in order from the base outwards, as in a machine
//! file; angles count by the right hand, of what turns: the head, or the table. What could be meant in two ways is
//! refused with the question that is to be answered. Leaves out files: `machine:` names one that others read.

use crate::text::refusal::{Refusal, refusal};

/// Rotary axes that a file has beside its heading, at most: two point a nozzle anywhere.
const ROTARY_MAX: usize = 2;
/// Farthest point on an axis, and farthest shift, mm.
const FAR_MM: f64 = 100_000.0;
/// Most that a nozzle leans by itself, degrees.
const LEAN_MAX_DEG: f64 = 89.0;
/// What each of X, Y, Z turns about.
const PRINCIPAL: [(&str, [f64; 3]); 3] = [
    ("x", [1.0, 0.0, 0.0]),
    ("y", [0.0, 1.0, 0.0]),
    ("z", [0.0, 0.0, 1.0]),
];

/// What X, Y and Z are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coordinates {
    /// The tip in the part's frame.
    Tip,
    /// The machine's linear axes: where the tip is with the axes of the head at 0.
    Pivot,
}

/// The length that F is a minute's share of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeedOf {
    /// The tip's on the part.
    Tip,
    /// That of X, Y and Z as the file has them; of moves without them the degrees.
    Xyz,
    /// The root of the squares of all axes, degrees as millimetres.
    All,
}

/// Side and line of a rotary axis.
#[derive(Clone, Debug, PartialEq)]
pub struct RotaryWord {
    /// Its letter, or the name of a manual stepper.
    pub name: String,
    /// It turns the part; otherwise the head.
    pub on_table: bool,
    /// Unit vector.
    pub axis: [f64; 3],
    /// A point on it.
    pub at_mm: Option<[f64; 3]>,
    /// Its angle where the file says 0.
    pub zero_rad: f64,
}

/// The nozzle's own turn.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadingWord {
    /// Its letter, or the name of a manual stepper.
    pub name: String,
    /// It counts the other way.
    pub negated: bool,
    /// The heading where the file says 0.
    pub zero_rad: f64,
}

/// The machine of a machine file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MachineWord {
    /// That which is planned for.
    Own,
    /// That of a file.
    File(String),
}

/// What the words say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AxesWords {
    /// The words themselves.
    pub text: String,
    /// Rotary axes in order.
    pub rotary: Vec<RotaryWord>,
    /// Turns the nozzle about its own axis; `None` leaves the heading free.
    pub heading: Option<HeadingWord>,
    /// What X, Y and Z are.
    pub coordinates: Option<Coordinates>,
    /// What F measures.
    pub feed: Option<FeedOf>,
    /// Added to X, Y and Z.
    pub shift_mm: [f64; 3],
    /// How far the nozzle leans from Z towards X.
    pub lean_rad: f64,
    /// The extruder's letter.
    pub extruder: Option<u8>,
    /// The axes are the joints of this machine.
    pub machine: Option<MachineWord>,
    /// Letters of its joints.
    pub letters: Option<Vec<u8>>,
}

impl AxesWords {
    /// Reads them.
    ///
    /// # Errors
    /// A `Refusal`, the first.
    pub fn parse(text: &str) -> Result<AxesWords, Refusal> {
        let mut words = AxesWords {
            text: text.trim().to_string(),
            ..AxesWords::default()
        };
        let mut names: Vec<String> = Vec::new();
        for term in text.split(',').map(str::trim) {
            let name = term.split(['=', ':']).next().unwrap_or(term).trim();
            let name = name.trim_start_matches('-').to_ascii_lowercase();
            if names.contains(&name) {
                return Err(twice(&name));
            }
            names.push(name);
            words.take(term)?;
        }
        words.check()?;
        Ok(words)
    }

    fn take(&mut self, term: &str) -> Result<(), Refusal> {
        let none = || no_term(term);
        if let Some(rest) = term.strip_prefix("machine") {
            self.machine = Some(match rest.strip_prefix(':').map(str::trim) {
                Some(file) if !file.is_empty() => MachineWord::File(file.to_string()),
                None if rest.is_empty() => MachineWord::Own,
                _ => return Err(none()),
            });
            return Ok(());
        }
        let (name, value) = term.split_once('=').ok_or_else(none)?;
        let (name, value) = (name.trim(), value.trim());
        match name {
            "coordinates" => {
                self.coordinates = Some(match value {
                    "tip" => Coordinates::Tip,
                    "pivot" => Coordinates::Pivot,
                    _ => return Err(none()),
                });
            }
            "feed" => {
                self.feed = Some(match value {
                    "tip" => FeedOf::Tip,
                    "xyz" => FeedOf::Xyz,
                    "all" => FeedOf::All,
                    _ => return Err(none()),
                });
            }
            "shift" => self.shift_mm = three(term, value, "three numbers of mm, as 0/0/-42")?,
            "lean" => self.lean_rad = lean_rad(term, value)?,
            "extruder" => self.extruder = Some(letter(value).ok_or_else(none)?),
            "letters" => {
                let letters = value.split('/').map(|text| letter(text.trim()));
                self.letters = Some(letters.collect::<Option<_>>().ok_or_else(none)?);
            }
            _ => self.axis(term, name, value)?,
        }
        Ok(())
    }

    /// `LETTER=head:AXIS`, `LETTER=table:AXIS` or `LETTER=heading`.
    fn axis(&mut self, term: &str, name: &str, value: &str) -> Result<(), Refusal> {
        let none = || no_term(term);
        let (negated, name) = match name.strip_prefix('-') {
            Some(name) => (true, name),
            None => (false, name),
        };
        let name = axis_name(name).ok_or_else(none)?;
        let mut parts = value.split(':').map(str::trim);
        let side = parts.next().unwrap_or_default();
        if side == "heading" {
            let mut zero_rad = 0.0;
            for part in parts {
                let zero = part.strip_prefix("zero=").ok_or_else(none)?;
                zero_rad = degrees(term, zero)?;
            }
            if self.heading.is_some() {
                let name = "the heading".to_string();
                return Err(twice(&name));
            }
            self.heading = Some(HeadingWord {
                name,
                negated,
                zero_rad,
            });
            return Ok(());
        }
        let on_table = match side {
            "table" => true,
            "head" => false,
            _ => return Err(none()),
        };
        let mut axis = direction(term, parts.next().ok_or_else(none)?)?;
        if negated {
            axis = axis.map(|share| -share);
        }
        let (mut at_mm, mut zero_rad) = (None, 0.0);
        for part in parts {
            match part.split_once('=') {
                Some(("at", text)) => {
                    at_mm = Some(three(term, text, "three numbers of mm, as 0/0/42")?);
                }
                Some(("zero", text)) => zero_rad = degrees(term, text)?,
                _ => return Err(none()),
            }
        }
        self.rotary.push(RotaryWord {
            name,
            on_table,
            axis,
            at_mm,
            zero_rad,
        });
        Ok(())
    }

    /// What could be meant in two ways, and what contradicts itself.
    fn check(&self) -> Result<(), Refusal> {
        let count = self.rotary.len();
        if count > ROTARY_MAX {
            return Err(refusal!(
                "{count} rotary axes beside the heading: two in head and table point a nozzle anywhere, and more than two \
                 are not read; write the file's poses as waypoints"
            ));
        }
        let odds = |problem: &str| Err(refusal!("{problem}"));
        let has_own = count > 0 || self.heading.is_some();
        match &self.machine {
            Some(_) if has_own || self.lean_rad != 0.0 => {
                return odds(
                    "machine: says all axes, and others stand beside it: leave one of them out",
                );
            }
            None if self.letters.is_some() => {
                return odds("letters= goes with machine:FILE: it names the letters of its joints");
            }
            _ => {}
        }
        let Some(first) = self.rotary.first() else {
            return Ok(());
        };
        if self.coordinates.is_none() {
            let name = first.name.clone();
            return Err(refusal!(
                "are X, Y and Z the tip's place in the part's frame (TCP, RTCP, G43.4, as if the part stood still), or the \
                 machine's linear axes, which move along as {name} turns? Say coordinates=tip or coordinates=pivot"
            ));
        }
        let is_open = |axis: &&RotaryWord| !axis.on_table && axis.at_mm.is_none();
        if self.coordinates == Some(Coordinates::Pivot)
            && let Some(axis) = self.rotary.iter().find(is_open)
        {
            let name = &axis.name;
            return Err(refusal!(
                "where does {name}'s axis pass the nozzle's tip? Say it with a point on it, counted from the tip with all \
                 rotary axes at 0, as in {name}=head:...:at=0/0/42; at=0/0/0 passes through the tip"
            ));
        }
        Ok(())
    }
}

/// A letter as G-code has it, or the name of a manual stepper as it is.
fn axis_name(text: &str) -> Option<String> {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    if text.is_empty() || !text.chars().all(is_name) {
        return None;
    }
    match text.len() {
        1 => letter(text).map(|letter| char::from(letter).to_string()),
        _ => Some(text.to_string()),
    }
}

/// Letters that no line has for something else.
fn letter(text: &str) -> Option<u8> {
    let [letter] = <[u8; 1]>::try_from(text.as_bytes()).ok()?;
    let letter = letter.to_ascii_uppercase();
    b"ABCDEHJUVWXYZ".contains(&letter).then_some(letter)
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|n: &f64| n.is_finite())
}

fn degrees(term: &str, text: &str) -> Result<f64, Refusal> {
    let given = number(text).filter(|degrees| degrees.abs() <= 360.0);
    given
        .map(f64::to_radians)
        .ok_or_else(|| wrong(term, text, "an angle of -360 to 360 degrees"))
}

fn lean_rad(term: &str, text: &str) -> Result<f64, Refusal> {
    let given = number(text).filter(|degrees| degrees.abs() <= LEAN_MAX_DEG);
    given
        .map(f64::to_radians)
        .ok_or_else(|| wrong(term, text, "an angle of -89 to 89 degrees"))
}

fn three(term: &str, text: &str, wanted: &str) -> Result<[f64; 3], Refusal> {
    let numbers: Option<Vec<f64>> = text.split('/').map(number).collect();
    let three = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    three
        .filter(|three| three.iter().all(|number| number.abs() <= FAR_MM))
        .ok_or_else(|| wrong(term, text, wanted))
}

/// `x`, `-y`, `0/1/1`: a unit vector.
fn direction(term: &str, text: &str) -> Result<[f64; 3], Refusal> {
    let (sign, plain) = match text.strip_prefix('-') {
        Some(plain) => (-1.0, plain),
        None => (1.0, text),
    };
    let named = PRINCIPAL.iter().find(|(name, _)| *name == plain);
    if let Some((_, axis)) = named {
        return Ok(axis.map(|share| sign * share));
    }
    let wanted = "a direction: x, y, z, -z or three numbers as 0/1/1";
    let axis = three(term, text, wanted)?;
    let length = axis.iter().map(|share| share * share).sum::<f64>().sqrt();
    match length > 1e-9 {
        true => Ok(axis.map(|share| share / length)),
        false => Err(wrong(term, text, wanted)),
    }
}

fn no_term(term: &str) -> Refusal {
    refusal!(
        "'{}' is no term of axes: write LETTER=head:AXIS or LETTER=table:AXIS (x, y, z, -z, or a direction as \
         0/1/1; :at=X/Y/Z is a point on it, :zero=DEG its angle at 0), LETTER=heading, coordinates=tip or pivot, \
         feed=tip, xyz or all, shift=X/Y/Z, lean=DEG, extruder=LETTER, machine:FILE",
        short(term)
    )
}

fn twice(name: &str) -> Refusal {
    refusal!("{name} is given twice: each letter and each word once")
}

fn wrong(term: &str, text: &str, wanted: &str) -> Refusal {
    let (term, text) = (short(term), short(text));
    refusal!("'{term}': '{text}' is not {wanted}")
}

fn short(text: &str) -> String {
    text.chars().take(60).collect()
}

impl FeedOf {
    /// As notes say it.
    pub fn text(self) -> &'static str {
        match self {
            FeedOf::Tip => "the speed of the tip on the part (feed=tip)",
            FeedOf::Xyz => "the speed of X, Y and Z, of other moves degrees a minute (feed=xyz)",
            FeedOf::All => "the speed of all axes together, degrees as millimetres (feed=all)",
        }
    }
}

#[cfg(test)]
#[path = "axes_words_tests.rs"]
mod tests;

//! Words of Sinumerik blocks, the modal state that they set, and the motions of blocks.
//!
//! In: blocks without their comments. Out: their [`Word`]s, the state after them, and [`Motion`]s. Source: blocks and
//! block components, feed control (FGROUP), path action and special motion commands in Siemens, "NC programming",
//! programming manual 12/2019 (6FC5398-2EP40-0BA0), with the G commands as delivered (G1, G60, G71, G90, G94, G500);
//! machine data 22420: without FGROUP, F is for the geometry axes. Not covered: what SOFT and OTOL do to the motion,
//! other forms of C than absolute positions, FGREF, FL, arithmetic, addresses like `X1=10`, `/`.

use super::super::joints::turn_z;
use super::super::{Motion, Target, Way};

/// The axes in their order; the last is rotary.
const AXES: [&str; 4] = ["X", "Y", "Z", "C"];
/// The rotary axis.
const C: usize = 3;
/// Without FGROUP, F is for the geometry axes.
const GEOMETRY_AXES: [bool; 4] = [true, true, true, false];
/// Ways shorter than this are none, mm or degrees.
const SAME: f64 = 1e-9;
/// How near the tip passes a corner at the least where the path goes on, mm.
const BLEND_MIN_MM: f64 = 0.001;

/// Modal state: X, Y and Z, mm, as far as they are known; C, degrees, 0 until the program moves it; F, mm/min or
/// degrees/min; axes of FGROUP, where it is programmed; G642, else G60; ATOL of X, Y and Z, and CTOL; G54 to G57; the tool's
/// cutting edge.
#[derive(Clone, Debug, Default)]
pub struct State {
    position_mm: [Option<f64>; 3],
    turn_deg: f64,
    pub(super) feed: Option<f64>,
    group: Option<[bool; 4]>,
    is_smoothed: bool,
    tolerances_mm: [Option<f64>; 4],
    frame: Option<String>,
    pub(super) tool: String,
}

/// Index of an axis.
pub fn axis_of(name: &str) -> Result<usize, String> {
    let found = AXES.iter().position(|axis| axis.eq_ignore_ascii_case(name));
    found.ok_or_else(|| format!("there is no axis {name}"))
}

impl State {
    /// Applies a modal G command; returns its G group, of which a block can have one.
    pub fn g_command(&mut self, number: &str) -> Result<u8, String> {
        Ok(match number {
            "1" | "01" => 1,
            "60" | "642" => {
                self.is_smoothed = number == "642";
                10
            }
            "71" => 13,
            "90" => 14,
            "94" => 15,
            "54" | "55" | "56" | "57" => {
                self.frame = Some(format!("G{number}"));
                8
            }
            _ => return Err(format!("G{number} is not covered here")),
        })
    }

    /// FGROUP: the axes in its parentheses, or without any the geometry axes.
    pub fn set_group(&mut self, axes: &str) -> Result<(), String> {
        let mut group = [false; 4];
        for name in axes.split(',').filter(|_| !axes.is_empty()) {
            group[axis_of(name.trim())?] = true;
        }
        self.group = Some(group).filter(|_| !axes.is_empty());
        Ok(())
    }

    /// CTOL, OTOL and, with their axis, ATOL. A negative tolerance deletes it.
    pub fn set_tolerance(
        &mut self,
        name: &str,
        axis: Option<&str>,
        value: f64,
    ) -> Result<(), String> {
        let tolerance = (value >= 0.0).then_some(value);
        match (name, axis) {
            ("CTOL", None) => self.tolerances_mm[C] = tolerance,
            ("OTOL", None) => {}
            ("ATOL", Some(axis)) => match axis_of(axis)? {
                C => {}
                axis => self.tolerances_mm[axis] = tolerance,
            },
            _ => return Err(format!("{name} is not written so")),
        }
        Ok(())
    }

    /// Motion of a block to these positions of axes; `is_exact_stop` is G9. None as long as the program has not named all of
    /// X, Y and Z: where the tip then goes depends on where it was.
    pub fn motion(
        &mut self,
        axes: &[(usize, f64)],
        is_exact_stop: bool,
        (file, line): (&str, usize),
    ) -> Result<Option<Motion>, String> {
        let (before_mm, before_deg) = (self.position_mm, self.turn_deg);
        for &(axis, value) in axes {
            match self.position_mm.get_mut(axis) {
                Some(position_mm) => *position_mm = Some(value),
                None => self.turn_deg = value,
            }
        }
        let [Some(x), Some(y), Some(z)] = self.position_mm else {
            return Ok(None);
        };
        let way = match before_mm {
            [Some(from_x), Some(from_y), Some(from_z)] => {
                let turn_deg = self.turn_deg - before_deg;
                Some([x - from_x, y - from_y, z - from_z, turn_deg])
            }
            _ => None,
        };
        let (speed_mm_s, turn_speed_deg_s) = self.speeds(way)?;
        let target = Target::Pose {
            tip_mm: [x, y, z],
            rotation: turn_z(self.turn_deg.to_radians()).rotation,
            external: vec![self.turn_deg],
            configuration: None,
        };
        Ok(Some(Motion {
            speed_mm_s,
            turn_speed_deg_s,
            blend_mm: if is_exact_stop { 0.0 } else { self.blend_mm()? },
            tool: self.tool.clone(),
            frame: self.frame.clone().unwrap_or("G500".to_owned()),
            ..Motion::new(file, line, target, Way::Line)
        }))
    }

    /// Speeds of the tip, mm/s, and of C, degrees/s, in a block that moves the axes by `way`, mm and degrees; the way
    /// is not known where the axes' positions before it are not. What nothing bounds is infinite.
    fn speeds(&self, way: Option<[f64; 4]>) -> Result<(f64, f64), String> {
        let f = self.feed.ok_or("there is no feed F")? / 60.0;
        let group = self.group.unwrap_or(GEOMETRY_AXES);
        let is_plain = group == GEOMETRY_AXES;
        let Some(way) = way else {
            let known = is_plain.then_some((f, f64::INFINITY));
            return known.ok_or("the feed needs the positions before the block".into());
        };
        // A degree of C counts as a millimetre.
        let length = |axes: [bool; 4]| {
            let ways = (0..AXES.len())
                .filter(|&axis| axes[axis])
                .map(|axis| way[axis] * way[axis]);
            ways.sum::<f64>().sqrt()
        };
        let (tip_mm, turn_deg) = (length(GEOMETRY_AXES), way[C].abs());
        if tip_mm <= SAME && turn_deg > SAME {
            // F of C alone is in degrees/min.
            return Ok((f64::INFINITY, f));
        }
        if is_plain || tip_mm <= SAME {
            return Ok((f, f64::INFINITY));
        }
        let seconds = length(group) / f;
        if seconds * f <= SAME {
            return Err("the block moves no axis of FGROUP".to_owned());
        }
        let is_path_axis = group[C] && turn_deg > SAME;
        let turn_deg_s = if is_path_axis {
            turn_deg / seconds
        } else {
            f64::INFINITY
        };
        Ok((tip_mm / seconds, turn_deg_s))
    }

    fn blend_mm(&self) -> Result<f64, String> {
        if !self.is_smoothed {
            return Ok(0.0);
        }
        let least_mm = self.tolerances_mm.into_iter().flatten().reduce(f64::min);
        let least_mm = least_mm.ok_or("G642 needs CTOL or ATOL here")?;
        Ok(least_mm.max(BLEND_MIN_MM))
    }
}

/// A word of a block: its address or name in capitals, as the language does not distinguish them (`"` for a text that
/// stands alone); what is in `[...]`; what is in `(...)`, or the text; the value after the address or after `=`, as it is
/// written and as a number.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Word {
    pub(super) name: String,
    pub(super) index: Option<String>,
    pub(super) arguments: Option<String>,
    pub(super) number: String,
    pub(super) value: Option<f64>,
}

/// Reads a block without its comment into words.
pub fn words(code: &str) -> Result<Vec<Word>, String> {
    let mut words = Vec::new();
    let mut rest = code.trim();
    while !rest.is_empty() {
        words.push(word(&mut rest)?);
        rest = rest.trim_start();
    }
    Ok(words)
}

/// The first word of a text, which is taken from it.
fn word(rest: &mut &str) -> Result<Word, String> {
    let mut word = Word::default();
    let first = rest.chars().next().unwrap_or(' ');
    if first == '"' {
        word.name = first.into();
        word.arguments = Some(bracketed(rest, '"')?);
        return Ok(word);
    }
    if !first.is_ascii_alphabetic() && first != '$' {
        return Err(format!("`{first}` is not covered here"));
    }
    // A blank is permitted after F.
    let after = if first.eq_ignore_ascii_case(&'F') {
        rest[1..].trim_start()
    } else {
        &rest[1..]
    };
    let is_number = |c: char| c.is_ascii_digit() || ".+-".contains(c);
    if first != '$' && after.starts_with(is_number) {
        word.name = first.to_ascii_uppercase().into();
        *rest = after;
        let signs = usize::from(rest.starts_with(['+', '-']));
        let length = rest[signs..].find(|c: char| !c.is_ascii_digit() && c != '.');
        take_number(
            rest,
            length.map_or(rest.len(), |length| signs + length),
            &mut word,
        )?;
        if rest.starts_with(['=', '_', '[', '(']) {
            return Err(format!("the address {first}{} is not covered", word.number));
        }
        return Ok(word);
    }
    let length = rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_' && c != '$');
    let (name, after) = rest.split_at(length.unwrap_or(rest.len()));
    word.name = name.to_ascii_uppercase();
    *rest = after;
    if rest.starts_with('[') {
        word.index = Some(bracketed(rest, ']')?);
    }
    if rest.trim_start().starts_with('(') {
        *rest = rest.trim_start();
        word.arguments = Some(bracketed(rest, ')')?);
    }
    if let Some(value) = rest.trim_start().strip_prefix('=') {
        *rest = value.trim_start();
        let length = rest.find([' ', '\t']).unwrap_or(rest.len());
        take_number(rest, length, &mut word)?;
    }
    Ok(word)
}

/// Takes a plain number of so many bytes as the value of a word.
fn take_number(rest: &mut &str, length: usize, word: &mut Word) -> Result<(), String> {
    let (number, after) = rest.split_at(length);
    let is_plain = number.bytes().all(|byte| b"0123456789.+-".contains(&byte));
    let value = number.parse().ok().filter(|_| is_plain);
    word.value = Some(value.ok_or_else(|| format!("`{number}` is no plain number"))?);
    word.number = number.to_owned();
    *rest = after;
    Ok(())
}

/// What is in the brackets or quotes that begin here.
fn bracketed(rest: &mut &str, close: char) -> Result<String, String> {
    let mut quoted = false;
    let end = rest.char_indices().skip(1).find(|&(_, character)| {
        let found = character == close && !quoted;
        quoted ^= character == '"';
        found
    });
    let (end, _) = end.ok_or_else(|| format!("`{close}` is missing"))?;
    let inside = rest[1..end].trim().to_owned();
    *rest = &rest[end + 1..];
    Ok(inside)
}

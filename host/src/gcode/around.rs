//! A sliced file around its beads: what stands before the first layer and behind the last bead, and lines between them that
//! no job carries out.
//!
//! In: the text and its program. Out: [`Around`]: blocks as [`super::write`] takes them, with the state of the extruder that
//! they need, and the program without the beads of the start block. What a plan says itself is left out: times, filament,
//! progress, limits of the controller's axes.
use super::extrusion::Taken;
use super::words::{lines, number_in};
use super::{BeadKind, GcodeOptions, GcodeProgram, HeatPlace, PlacedOrder, interpreter};
use crate::gcode::flavour::declared;
use crate::text::refusal::{Refusal, refusal};

/// Comments that say anew what the plan has changed, and codes of progress.
const SAID_ANEW: [&str; 9] = [
    "; estimated printing time",
    "; estimated first layer printing time",
    "; filament used",
    "; total filament used",
    "; total layers count",
    ";TIME",
    ";Filament used",
    ";LAYER_COUNT",
    "M73",
];
/// Codes that stay out of the job's moves: they set what the moves are planned with, or move the head.
const OF_MOTION: [&str; 13] = [
    "G0",
    "G1",
    "G2",
    "G3",
    "G28",
    "G29",
    "M201",
    "M203",
    "M204",
    "M205",
    "M220",
    "M221",
    "SET_VELOCITY_LIMIT",
];

/// A file around its beads.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Around {
    /// Before the first layer, and behind the last bead; braces are doubled.
    pub blocks: [String; 2],
    /// What the start block leaves retracted, mm of filament.
    pub retracted_mm: f64,
    /// All lines of the file, for those that stand between its beads.
    lines: Vec<String>,
}

/// Takes the blocks of a text and leaves the rest in its program.
///
/// # Errors
/// [`Refusal`] where nothing follows the last bead.
pub fn around(text: &str, program: &mut GcodeProgram) -> Result<Around, Refusal> {
    let lines: Vec<String> = lines(text).map(str::to_string).collect();
    let legs = || program.passes.iter().flat_map(|pass| &pass.legs);
    let last = legs().map(|leg| leg.line).max().unwrap_or(0);
    let of_part = legs().find(|leg| leg.kind != BeadKind::Unknown);
    let of_part = of_part.map_or(0, |leg| leg.line.saturating_sub(1));
    let begins = lines[..of_part].iter().position(|line| is_layer_mark(line));
    let begin = begins.unwrap_or(of_part);
    check_end(&lines, last)?;
    program.keep_between(begin, last);
    let kept = |line: &&String| {
        !SAID_ANEW
            .iter()
            .any(|said| line.trim_start().starts_with(said))
    };
    let block = |lines: &[String]| -> String {
        let kept = lines.iter().filter(kept);
        kept.map(|line| line.replace('{', "{{").replace('}', "}}") + "\n")
            .collect()
    };
    let start = &lines[..begin];
    Ok(Around {
        blocks: [
            block(start) + "M220 S100\nM221 S100\n",
            extruder_at(&lines[..last]) + &block(&lines[last..]),
        ],
        retracted_mm: retracted_mm(&start.join("\n"))?,
        lines,
    })
}

impl Around {
    /// The text of lines by their numbers, of those that may stand between the moves; and how many may not.
    pub fn between(&self, numbers: &[(u64, usize)]) -> (Vec<(u64, String)>, usize) {
        let line = |(tick, number): &(u64, usize)| {
            let line = self.lines.get(number.checked_sub(1)?)?.trim();
            let code = line.split([' ', ';']).next().unwrap_or_default();
            let is_said = SAID_ANEW.iter().chain(&OF_MOTION).any(|of| *of == code);
            (!is_said).then(|| (*tick, line.to_string()))
        };
        let lines: Vec<(u64, String)> = numbers.iter().filter_map(line).collect();
        let left = numbers.len() - lines.len();
        (lines, left)
    }
}

impl GcodeProgram {
    /// Leaves what stands behind the first `begin` lines and up to line `end`.
    fn keep_between(&mut self, begin: usize, end: usize) {
        let is_before = |line: usize| line <= begin;
        let passes = self.passes.iter();
        let of_start = passes.take_while(|pass| pass.legs.iter().all(|leg| is_before(leg.line)));
        let count = of_start.count();
        self.passes.drain(..count);
        let moved = |place: HeatPlace| place.of_pass(|pass| pass.saturating_sub(count));
        fn kept<T>(
            orders: &mut Vec<PlacedOrder<T>>,
            lines: [usize; 2],
            moved: impl Fn(HeatPlace) -> HeatPlace,
        ) {
            orders.retain(|order| order.line > lines[0] && order.line <= lines[1]);
            orders
                .iter_mut()
                .for_each(|order| order.place = moved(order.place));
        }
        kept(&mut self.heat, [begin, end], moved);
        kept(&mut self.left, [begin, end], moved);
    }
}

/// Begins a layer.
fn is_layer_mark(line: &str) -> bool {
    let Some(comment) = line.trim_start().strip_prefix(';') else {
        return false;
    };
    let comment = comment.trim();
    comment == "LAYER_CHANGE" || comment == "CHANGE_LAYER" || comment.starts_with("LAYER:")
}

/// Refuses a file that ends with a bead: its slicer's end has commands.
fn check_end(lines: &[String], last: usize) -> Result<(), Refusal> {
    let is_command = |line: &String| {
        let line = line.trim_start();
        let is_move = ["G0", "G1", "G2", "G3"]
            .iter()
            .any(|code| line.starts_with(code));
        !line.is_empty() && !is_move && !line.starts_with(";TYPE") && !line.starts_with(";WIDTH")
    };
    match lines[last..].iter().any(is_command) {
        true => Ok(()),
        false => Err(refusal!(
            "line {last}: the file ends with a bead, and no line of its slicer's end follows: \
             it was cut short; slice it again"
        )),
    }
}

/// The extruder's mode behind these lines, and its position where it is absolute.
fn extruder_at(lines: &[String]) -> String {
    let code = |line: &String| {
        line.split([' ', ';'])
            .next()
            .unwrap_or_default()
            .to_string()
    };
    let mode = lines
        .iter()
        .rev()
        .map(code)
        .find(|code| code == "M82" || code == "M83");
    if mode.as_deref() == Some("M83") {
        return "M83\n".to_string();
    }
    let e_mm = lines.iter().rev().find_map(|line| {
        let words = line.split(';').next().unwrap_or_default();
        let word = words
            .split_whitespace()
            .find_map(|word| word.strip_prefix('E'))?;
        number_in(word).map(|(number, _)| number)
    });
    format!("M82\nG92 E{:.5}\n", e_mm.unwrap_or(0.0))
}

/// What a text leaves retracted.
fn retracted_mm(text: &str) -> Result<f64, Refusal> {
    let declared = declared(text);
    let taken = Taken {
        relative: declared.e_relative.unwrap_or(false),
        ..Taken::default()
    };
    let options = GcodeOptions::default();
    let steps = interpreter::steps(text, declared.flavour, &taken, false, &options)?;
    let left = steps
        .steps
        .iter()
        .fold(0.0, |left: f64, step| (left - step.extruded).max(0.0));
    Ok(left)
}

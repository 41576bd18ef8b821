//! A start block of the user's own, read back as the controller runs it.
//!
//! In: a job, its options. Out: nothing, or the line of the block behind which the controller would not do what the job
//! does. Headway's reader goes through the head of the text, up to `HEAD_BYTES`, with the block and without one; behind
//! both the tip, the heading and what is extruded are to be the same. Leaves out what macros of the controller do, and
//! the rest of the text: it goes on as it began.

use super::ends::SETUP_MARK;
use super::{JobText, WriteError, WriteOptions, write_gcode};
use crate::gcode::GcodeOptions;
use crate::gcode::extrusion::Taken;
use crate::gcode::flavour::declared;
use crate::gcode::interpreter::{self, Step};

/// How much of the text is read, beside the block itself.
const HEAD_BYTES: usize = 128 * 1024;
/// Numbers that are the same: places, mm and degrees, and filament, mm.
const SAME: f64 = 1e-6;

/// Checks a start block of the user's own; others are right.
///
/// # Errors
/// [`WriteError`]: what [`write_gcode`] refuses, and [`WriteError::Block`].
pub fn check_start(job: &JobText, options: &WriteOptions) -> Result<(), WriteError> {
    let Some(block) = &options.blocks[0] else {
        return Ok(());
    };
    let wanted = steps_behind("", job, options)?.unwrap_or_default();
    let lines: Vec<&str> = block.lines().collect();
    let problem = |count: usize| -> Result<Option<String>, WriteError> {
        let block = lines[..count].join("\n");
        Ok(match steps_behind(&block, job, options)? {
            Ok(steps) => difference(&wanted, &steps),
            Err(unread) => Some(unread),
        })
    };
    let Some(mut found) = problem(lines.len())? else {
        return Ok(());
    };
    // The line before which all is well and behind which it is not.
    let (mut good, mut bad) = (0, lines.len());
    while bad > good + 1 {
        let middle = good + (bad - good) / 2;
        match problem(middle)? {
            Some(problem) => (bad, found) = (middle, problem),
            None => good = middle,
        }
    }
    Err(WriteError::Block {
        line: bad,
        text: lines[bad - 1].trim().chars().take(60).collect(),
        problem: found,
    })
}

/// What the reader makes of the job's first moves behind a block, or why it does not read the block.
fn steps_behind(
    block: &str,
    job: &JobText,
    options: &WriteOptions,
) -> Result<Result<Vec<Step>, String>, WriteError> {
    let options = WriteOptions {
        blocks: [Some(block.to_string()), None],
        ..options.clone()
    };
    let mut head = vec![0; HEAD_BYTES + block.len()];
    let mut room = head.as_mut_slice();
    match write_gcode(&mut room, job, &options) {
        // It is full.
        Ok(_) | Err(WriteError::Io(_)) => {}
        Err(error) => return Err(error),
    }
    let left = room.len();
    head.truncate(head.len() - left);
    let whole = head.iter().rposition(|byte| *byte == b'\n');
    head.truncate(whole.unwrap_or(0));
    let text = String::from_utf8_lossy(&head);
    // A turn back and the end block are no moves of the job.
    let text = text.split("\n;end of the job").next().unwrap_or_default();
    let setup = text.lines().position(|line| line == SETUP_MARK);
    let flavour = declared(text).flavour;
    let all = interpreter::steps(
        text,
        flavour,
        &Taken::default(),
        false,
        &GcodeOptions::default(),
    );
    Ok(match all {
        Ok(all) => {
            let behind = |step: &Step| setup.is_some_and(|setup| step.line > setup);
            Ok(all.steps.into_iter().filter(behind).collect())
        }
        // Its line is that of the whole text.
        Err(error) => {
            let text = error.to_string();
            let what = text.split_once(": ").filter(|_| text.starts_with("line "));
            Err(what.map_or(text.clone(), |(_, what)| what.to_string()))
        }
    })
}

/// What is not the same, the heading's zero being wherever it stands.
fn difference(wanted: &[Step], found: &[Step]) -> Option<String> {
    let turned = |steps: &[Step]| steps.first().map_or(0.0, |step| step.to[5]);
    let zero_deg = turned(found) - turned(wanted);
    for (wanted, found) in wanted.iter().zip(found) {
        let mut off: [f64; 6] = std::array::from_fn(|axis| found.to[axis] - wanted.to[axis]);
        off[5] -= zero_deg;
        if let Some(axis) = (0..6).find(|axis| off[*axis].abs() > SAME) {
            let name = ["X", "Y", "Z", "A", "B", "the heading"][axis];
            let unit = if axis < 3 { "mm" } else { "degrees" };
            let off = off[axis];
            return Some(format!(
                "{name} would be {off:.3} {unit} beside the job's path behind it"
            ));
        }
        if found.volumetric != wanted.volumetric {
            return Some("the extruder would take mm for mm³ behind it".to_string());
        }
        if (found.extruded - wanted.extruded).abs() > SAME {
            let share = found.extruded / wanted.extruded;
            return Some(format!(
                "{share:.3} times the job's filament would be extruded behind it"
            ));
        }
    }
    (found.len() != wanted.len()).then(|| "moves of the job would be missing behind it".to_string())
}

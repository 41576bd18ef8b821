//! Blocks -> procedures: a layer each, or parts of a long one.

use super::walk::{Block, Place, Run, Walk};
use crate::job::MotionState;

/// Most blocks of a procedure.
const BLOCKS_MAX: usize = 2000;

/// A step of a procedure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// A straight way; else a rest.
    pub block: Option<Block>,
    /// How long it takes, s.
    pub seconds: f64,
    /// What the pump's output is set to at its end.
    pub output: Option<f64>,
}

/// Some of a layer's blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct Procedure {
    /// Layer, from 1.
    pub layer: u32,
    /// Part of it, from 1.
    pub part: u32,
    /// What it does.
    pub steps: Vec<Step>,
    /// Time, s.
    pub seconds: f64,
    /// What is laid, mm³.
    pub volume_mm3: f64,
    /// What the pump's output is where it begins.
    pub output_before: f64,
}

impl Procedure {
    /// Its name among the program's: `layer_3`, `layer_3_2`.
    pub fn name(&self) -> String {
        match self.part {
            1 => format!("layer_{}", self.layer),
            part => format!("layer_{}_{part}", self.layer),
        }
    }

    /// A line for the operator.
    pub fn title(&self, layers: u32) -> String {
        format!(
            "layer {} of {layers}: {:.1} s, {:.1} mm3",
            self.layer, self.seconds, self.volume_mm3
        )
    }

    /// Makes its last block end at rest; true where it did not.
    pub fn stops_at_end(&mut self) -> bool {
        let last = self.steps.last_mut().and_then(|step| step.block.as_mut());
        match last.filter(|block| block.blend_mm > 0.0) {
            Some(block) => {
                block.blend_mm = 0.0;
                true
            }
            None => false,
        }
    }
}

/// The procedures of a job.
pub fn procedures(walk: &Walk) -> Vec<Procedure> {
    let mut made: Vec<Procedure> = Vec::new();
    let mut output = 0.0;
    for run in &walk.runs {
        let layer = run.layer + 1;
        for step in steps_of(run) {
            let is_on = |last: &Procedure| last.layer == layer && last.steps.len() < BLOCKS_MAX;
            if !made.last().is_some_and(is_on) {
                let earlier = made.iter().rev().find(|of| of.layer == layer);
                let part = earlier.map_or(1, |of| of.part + 1);
                made.push(Procedure {
                    layer,
                    part,
                    steps: Vec::new(),
                    seconds: 0.0,
                    volume_mm3: 0.0,
                    output_before: output,
                });
            }
            if let Some(last) = made.last_mut() {
                last.seconds += step.seconds;
                if run.state == MotionState::Print {
                    last.volume_mm3 += step.block.map_or(0.0, |block| block.volume_mm3);
                }
                last.steps.push(step);
            }
            output = step.output.unwrap_or(output);
        }
    }
    made
}

/// Where procedures end; `None` where they only rest.
pub(super) fn end_of<'a>(
    procedures: impl DoubleEndedIterator<Item = &'a Procedure>,
) -> Option<Place> {
    let steps = |procedure: &'a Procedure| procedure.steps.iter().rev();
    let last = procedures.rev().flat_map(steps).find_map(|step| step.block);
    last.map(|block| block.to)
}

fn steps_of(run: &Run) -> impl Iterator<Item = Step> {
    let rests = run.rests.iter().map(|&(seconds, output)| Step {
        block: None,
        seconds,
        output,
    });
    let blocks = run.blocks.iter().map(|block| Step {
        block: Some(*block),
        seconds: block.seconds,
        output: block.output,
    });
    blocks.chain(rests)
}

//! What is known of a job's passes beside their motion: which kind of bead each is, which line of a file it follows.
//!
//! In: a plan's curves, the kinds of a part's passes, or the passes of a slicer's file. Out: a closure that
//! says both of every point of the path, in order.

use crate::gcode::{BeadKind, GcodePass, Leg, Place};
use crate::job::{Mark, MotionState};
use crate::layer_uses::Use;
use crate::report::layer_path::{PathPoint, What};
use nalgebra::Vector3;

/// Legs behind the last one that a point is looked for on: a corner takes few of them at once.
const LEGS_AHEAD: usize = 64;

/// Of a job.
#[derive(Clone, Debug, Default)]
pub(super) enum PassFacts {
    /// Nothing: the job came from a file of ours.
    #[default]
    Unknown,
    /// By the number of the pass.
    Kinds(Vec<Use>),
    /// Of a slicer's file.
    File(FilePasses),
}

/// Passes of a file, and which of them each pass of the job follows.
#[derive(Clone, Debug)]
pub(super) struct FilePasses {
    pub passes: Vec<GcodePass>,
    pub of_job: Vec<usize>,
}

impl PassFacts {
    /// What lines are numbered by.
    pub(super) fn line_name(&self) -> &'static str {
        match self {
            PassFacts::File(_) => "Line of the file",
            PassFacts::Unknown | PassFacts::Kinds(_) => "Segment",
        }
    }

    /// What the head does from a point on, and its line.
    pub(super) fn follow(&self) -> impl FnMut(&Mark, &PathPoint) -> (What, u32) + '_ {
        let mut at = (usize::MAX, 0);
        move |mark, point| match self {
            PassFacts::File(file) => file.at(mark, point, &mut at),
            _ => (
                What::of(mark.state, self.bead(mark.pass)),
                point.segment as u32 + 1,
            ),
        }
    }

    fn bead(&self, pass: Option<u32>) -> What {
        let PassFacts::Kinds(kinds) = self else {
            return What::Bead;
        };
        let used = pass.and_then(|pass| kinds.get(pass as usize));
        match used {
            Some(Use::Walls) => What::Wall,
            Some(Use::Solid) => What::Solid,
            Some(Use::Sparse) => What::Sparse,
            Some(Use::Bridge) => What::Bridge,
            Some(Use::Skirt) => What::Skirt,
            Some(Use::Travel | Use::Standing) | None => What::Bead,
        }
    }
}

impl FilePasses {
    /// The leg that a point lies on; `at` is the pass and leg of the point before.
    fn at(&self, mark: &Mark, point: &PathPoint, at: &mut (usize, usize)) -> (What, u32) {
        let number = mark.pass.and_then(|pass| self.of_job.get(pass as usize));
        let pass = number.and_then(|&number| Some((number, self.passes.get(number)?)));
        let Some((number, pass)) = pass.filter(|_| mark.state == MotionState::Print) else {
            // On the way to the next pass: the line that goes there.
            let next = self.passes.get(at.0.wrapping_add(1));
            let leg = next.and_then(|pass| pass.travel_legs.last());
            return (
                What::of(mark.state, What::Bead),
                leg.map_or(0, |leg| leg.line as u32),
            );
        };
        if at.0 != number {
            *at = (number, 0);
        }
        let legs = pass.points.windows(2).zip(&pass.legs).enumerate();
        let near = legs.skip(at.1).take(LEGS_AHEAD);
        let nearest = near.map(|(k, (ends, leg))| (distance_mm(point, ends), k, leg));
        let nearest = nearest.min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, leg_number, leg)) = nearest else {
            return (What::Bead, 0);
        };
        at.1 = leg_number;
        (what(leg), leg.line as u32)
    }
}

/// How far a point is from a leg.
fn distance_mm(point: &PathPoint, ends: &[Place]) -> f64 {
    let [from, to] = [0, 1].map(|k| Vector3::from(ends[k].tip_mm));
    let (p, way) = (Vector3::from(point.tip_mm) - from, to - from);
    let share = p.dot(&way) / way.norm_squared().max(1e-12);
    (p - way * share.clamp(0.0, 1.0)).norm()
}

fn what(leg: &Leg) -> What {
    match leg.kind {
        BeadKind::Wall => What::Wall,
        BeadKind::Solid => What::Solid,
        BeadKind::Sparse => What::Sparse,
        BeadKind::Bridge => What::Bridge,
        BeadKind::Skirt => What::Skirt,
        BeadKind::Support => What::Support,
        BeadKind::Unknown => What::Bead,
    }
}

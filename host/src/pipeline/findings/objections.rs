//! Objections to a job: collisions, joints outside their ranges, faults of a board.
//!
//! In: a plan, the faults that a board would latch in the finished job, the reasons for widening a joint's range.
//! Out: [`Objection`]s, one line each, which are the first lines of a report. Not covered: which of them the user
//! allows; the command handles that.

use super::run_notes;
use crate::drive::device_check::{Refusal, Refused};
use crate::job::transform::PartTransform;
use crate::pipeline::Plan;
use crate::plan::judge::touches::Touches;
use crate::settings::drivers::motor_names;
use crate::settings::{Settings, joint_names};
use headway_protocol::message::FaultCause;

/// Kind of an objection, by the name under which it may be allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectionKind {
    /// Nozzle or head collides with the table, the print or the surface.
    Touches,
    /// A joint leaves its range.
    Range,
    /// A board would stop the job with a fault; not to be allowed.
    Fault,
    /// A layer takes too long; refuses the job only on request.
    LayerTime,
    /// An option is not kept; refuses the job only on request.
    Options,
    /// Layers are too high for the narrowest bead; refuses the job only on request.
    LayerHeight,
    /// The flow is more than the hot end melts; refuses the job only on request.
    Melt,
    /// A layer has an area that lies on nothing; refuses the job only on request.
    Floating,
    /// The ratio of outside to inside of a bead in a curve is too large; refuses the job only on request.
    Curves,
}

/// Why a job is not good.
#[derive(Clone, Debug, PartialEq)]
pub struct Objection {
    /// Its kind.
    pub kind: ObjectionKind,
    /// The fault and its place, one line.
    pub text: String,
}

impl ObjectionKind {
    /// As options and figures spell it.
    pub fn name(self) -> &'static str {
        match self {
            ObjectionKind::Touches => "touches",
            ObjectionKind::Range => "range",
            ObjectionKind::Fault => "fault",
            ObjectionKind::LayerTime => "layer-time",
            ObjectionKind::Curves => "curves",
            ObjectionKind::Options => "options",
            ObjectionKind::Floating => "floating",
            ObjectionKind::LayerHeight => "layer-height",
            ObjectionKind::Melt => "melt",
        }
    }

    /// True for objections that refuse a job unless the user allows them.
    pub fn can_be_allowed(self) -> bool {
        matches!(self, ObjectionKind::Touches | ObjectionKind::Range)
    }
}

impl Objection {
    /// Of a board that would not run the finished job to its end.
    pub fn of_board(refused: &Refused, transform: &PartTransform, settings: &Settings) -> Self {
        let [x, y, z] = transform.to_input(refused.at_mm);
        let motor = motor_name(&refused.refusal, settings);
        Objection {
            kind: ObjectionKind::Fault,
            text: format!(
                "FAULT: a board would stop this job after {:.2} s, with the tip near ({x:.3}, {y:.3}, {z:.3}): \
                 {}{motor}",
                refused.time_s, refused.refusal
            ),
        }
    }

    /// For a simulation that did not reach its end.
    pub fn of_run(problem: &str) -> Self {
        Objection {
            kind: ObjectionKind::Fault,
            text: format!("FAULT: {problem}"),
        }
    }

    /// For collisions of nozzle and head, if any.
    pub fn of_touches(touches: &Touches, transform: &PartTransform) -> Option<Self> {
        run_notes::touches(touches, transform).map(|text| Objection {
            kind: ObjectionKind::Touches,
            text,
        })
    }

    /// For a joint that leaves its range; `place` gives distance and place.
    pub fn of_range(place: &str) -> Self {
        Objection {
            kind: ObjectionKind::Range,
            text: format!("RANGE: {place}; a board with this machine stops there"),
        }
    }
}

/// Touches of the head.
pub(super) fn of_plan(plan: &Plan) -> Vec<Objection> {
    let touches = plan.touches.as_ref();
    let touches = touches.and_then(|touches| Objection::of_touches(touches, &plan.transform));
    touches.into_iter().collect()
}

/// Which motor a fault names by its number.
fn motor_name(refusal: &Refusal, settings: &Settings) -> String {
    let Refusal::Fault(fault) = refusal else {
        return String::new();
    };
    let of_motor = matches!(
        fault.cause,
        FaultCause::Limit | FaultCause::SoftLimit | FaultCause::StepRate
    );
    let names = joint_names(&settings.machine.kinematics);
    let motor = usize::from(fault.index);
    match names.get(motor) {
        _ if !of_motor => String::new(),
        Some(name) if motor < settings.machine.joints.len() => {
            format!(" (motor {motor} is joint {name})")
        }
        _ if motor == settings.machine.joints.len() => {
            format!(" (motor {motor} is the extruder)")
        }
        _ => {
            let names = motor_names(&settings.machine);
            let name = names.get(motor).copied().unwrap_or("none");
            format!(" (motor {motor} is {name})")
        }
    }
}

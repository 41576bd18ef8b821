//! Motions, outputs and the other commands of URScript: calls to steps.
//!
//! In: a call and the names it can see. Out: the steps that it adds to the run. Source: movej, movel, movep,
//! set_standard_analog_out, set_standard_digital_out and their states, sleep and textmsg after "The URScript Programming
//! Language", Universal Robots, versions 3.2 (2016) and SW 5.x/10.x (HTML script manual); PolyScope manual, "Blend parameters":
//! blends cannot overlap, and what follows a blended waypoint in the program runs when the robot enters the blend. Not
//! covered: accelerations.

use super::super::{Motion, Step, Target, Way};
use super::parser::{Call, Expression, LineProblem};
use super::{Run, Value};

/// The name of the robot's own frame, in which targets without a feature are.
const BASE: &str = "base";
/// Two blends overlap when they share more than this, mm.
const OVERLAP_TOLERANCE_MM: f64 = 1e-6;

/// Where a motion leads and how far its blend reaches, for the check of overlaps.
pub struct Waypoint {
    line: usize,
    position_mm: Option<[f64; 3]>,
    blend_mm: f64,
}

impl Run<'_> {
    /// Runs a call of a function of the language.
    pub(super) fn command(&mut self, call: &Call, line: usize, scope: usize) -> Result<(), String> {
        match call.name.as_str() {
            "movej" | "movel" | "movep" => self.motion(call, line, scope)?,
            "set_standard_analog_out" | "set_standard_digital_out" => {
                self.output(call, line, scope)?
            }
            "set_runstate_standard_analog_output_to_value"
            | "set_runstate_standard_digital_output_to_value" => self.run_state(call, scope)?,
            "sleep" => {
                let [time] = bind(call, ["t"], 1)?;
                let seconds = self.number(time.ok_or("t")?, scope)?;
                if seconds < 0.0 {
                    return Err("a negative time".to_owned());
                }
                self.open_blend_mm = 0.0;
                self.steps.push(Step::Wait { seconds });
            }
            "textmsg" => {
                let mut text = String::new();
                for part in bind(call, ["s1", "s2"], 1)?.into_iter().flatten() {
                    match self.value(part, scope)? {
                        Value::Text(part) => text.push_str(&part),
                        Value::Number(number) => text.push_str(&number.to_string()),
                        _ => return Err("a text or a number is needed here".to_owned()),
                    }
                }
                self.steps.push(Step::Note { text });
            }
            name => return Err(format!("the function {name} is not covered here")),
        }
        Ok(())
    }

    /// What an output is while no program runs: of the states the one that is low then.
    fn run_state(&mut self, call: &Call, scope: usize) -> Result<(), String> {
        let kind = if call.name.contains("digital") {
            "digital_out"
        } else {
            "analog_out"
        };
        let [number, state] = bind(call, ["outputId", "state"], 2)?;
        let number = self.number(number.ok_or("outputId")?, scope)?;
        let state = self.number(state.ok_or("state")?, scope)?;
        if state != 1.0 {
            return Err(format!("the state {state} is not covered here"));
        }
        let text = format!("{kind}[{number}] is low while no program runs");
        self.steps.push(Step::Note { text });
        Ok(())
    }

    fn output(&mut self, call: &Call, line: usize, scope: usize) -> Result<(), String> {
        let is_digital = call.name == "set_standard_digital_out";
        let (level, kind, last) = if is_digital {
            ("b", "digital_out", 7.0)
        } else {
            ("f", "analog_out", 1.0)
        };
        let [number, value] = bind(call, ["n", level], 2)?;
        let number = self.number(number.ok_or("n")?, scope)?;
        if number.fract() != 0.0 || !(0.0..=last).contains(&number) {
            return Err(format!("there is no {kind}[{number}]"));
        }
        let value = match self.value(value.ok_or("value")?, scope)? {
            Value::Truth(truth) if is_digital => f64::from(u8::from(truth)),
            Value::Number(share) if !is_digital && (0.0..=1.0).contains(&share) => share,
            _ => return Err(format!("not a value of {kind}")),
        };
        self.steps.push(Step::Output {
            file: self.file.to_owned(),
            line,
            name: format!("{kind}[{number}]"),
            value,
            before_end_mm: self.open_blend_mm,
            delay_s: 0.0,
        });
        Ok(())
    }

    fn motion(&mut self, call: &Call, line: usize, scope: usize) -> Result<(), String> {
        let is_joints = call.name == "movej";
        let first = if is_joints { "q" } else { "pose" };
        let [target, a, v, t, r] = if call.name == "movep" {
            let [pose, a, v, r] = bind(call, [first, "a", "v", "r"], 1)?;
            [pose, a, v, None, r]
        } else {
            bind(call, [first, "a", "v", "t", "r"], 1)?
        };
        let number = |given: Option<&Expression>, default| {
            given.map_or(Ok(default), |given| self.number(given, scope))
        };
        let a = number(a, if is_joints { 1.4 } else { 1.2 })?;
        let v = number(v, if is_joints { 1.05 } else { 0.25 })?;
        let (t, blend_mm) = (number(t, 0.0)?, number(r, 0.0)? * 1e3);
        if a <= 0.0 || v <= 0.0 || t < 0.0 || blend_mm < 0.0 {
            return Err("a or v is not positive, or t or r is negative".to_owned());
        }
        let v = if t > 0.0 { f64::INFINITY } else { v };
        let target = self.value(target.ok_or("a target is missing")?, scope)?;
        let (target, frame, position_mm) = target_of(target)?;
        self.open_blend_mm = blend_mm;
        self.waypoints.push(Waypoint {
            line,
            position_mm,
            blend_mm,
        });
        let (way, speed_mm_s, turn_speed_deg_s) = if is_joints {
            (Way::Joints, f64::INFINITY, v.to_degrees())
        } else {
            (Way::Line, v * 1e3, f64::INFINITY)
        };
        self.steps.push(Step::Move(Motion {
            speed_mm_s,
            turn_speed_deg_s,
            blend_mm,
            seconds: (t > 0.0).then_some(t),
            frame,
            ..Motion::new(self.file, line, target, way)
        }));
        Ok(())
    }
}

/// The target, the name of its frame, and its place in the robot's frame, mm, where that is known.
fn target_of(value: Value) -> Result<(Target, String, Option<[f64; 3]>), String> {
    let external = Vec::new();
    match value {
        Value::List(joints) if joints.len() == 6 => {
            let degrees = joints.into_iter().map(f64::to_degrees).collect();
            Ok((Target::Joints { degrees, external }, BASE.to_owned(), None))
        }
        Value::Pose(placement, feature) => {
            let (frame, local) = feature.unwrap_or((BASE.to_owned(), placement));
            let target = Target::Pose {
                tip_mm: local.origin_mm,
                rotation: local.rotation,
                external,
                configuration: None,
            };
            Ok((target, frame, Some(placement.origin_mm)))
        }
        _ => Err("a target is a pose or a list of six joint angles".to_owned()),
    }
}

/// The arguments of a call in the order of the parameters `names`, of which the first `required` must be there.
pub(super) fn bind<'c, const N: usize>(
    call: &'c Call,
    names: [&str; N],
    required: usize,
) -> Result<[Option<&'c Expression>; N], String> {
    let mut bound = [None; N];
    let function = &call.name;
    for (index, (given, value)) in call.arguments.iter().enumerate() {
        let at = match given {
            None => Some(index).filter(|&index| index < N),
            Some(given) => names.iter().position(|name| name == given),
        };
        let at =
            at.ok_or_else(|| format!("{function} has no parameter for {given:?} {value:?}"))?;
        if bound[at].replace(value).is_some() {
            return Err(format!("{function} has {} twice", names[at]));
        }
    }
    match bound[..required].iter().position(Option::is_none) {
        Some(missing) => Err(format!("{function} needs {}", names[missing])),
        None => Ok(bound),
    }
}

/// The controller skips a waypoint whose blend overlaps with that of its neighbour; here that is an error.
pub(super) fn check_blends(waypoints: &[Waypoint]) -> Result<(), LineProblem> {
    for pair in waypoints.windows(2) {
        let (Some(from_mm), Some(to_mm)) = (pair[0].position_mm, pair[1].position_mm) else {
            continue;
        };
        let squares = (0..3).map(|k| (to_mm[k] - from_mm[k]).powi(2));
        let distance_mm = squares.sum::<f64>().sqrt();
        let blends_mm = [pair[0].blend_mm, pair[1].blend_mm];
        if blends_mm[0] + blends_mm[1] > distance_mm + OVERLAP_TOLERANCE_MM {
            let problem =
                format!("blends of {blends_mm:.3?} mm overlap within {distance_mm:.3} mm");
            return Err((pair[1].line, problem));
        }
    }
    Ok(())
}

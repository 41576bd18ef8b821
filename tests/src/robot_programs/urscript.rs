//! URScript programs of Universal Robots, read as the script manual defines them.
//!
//! In: the file of a program and the features of the installation. Out: [`Step`]s, mm, degrees and seconds. Source:
//! "The URScript Programming Language", Universal Robots, versions 3.2 (2016) and SW 5.x/10.x (HTML script manual). Not
//! covered: movec, set_tcp, conditions, loops, threads, accelerations. A blend next to a
//! target in joint angles is not checked for overlap, as its place is not known without the kinematics.

mod commands;
mod parser;

use std::collections::HashMap;
use std::rc::Rc;

use super::joints::{Frame, chain, shift};
use super::{ProgramError, SourceFile, Step};
use commands::{Waypoint, bind, check_blends};
use parser::{Action, Call, Expression, Function, LineProblem, Statement};

const DEPTH_MAX: usize = 64;

/// Runs the program in the file `main`. `features` are the frames of the installation that the program may name: name
/// and pose, m and rotation vector, rad. The statements of the file run in their order; a file that calls nothing
/// itself runs its function `main`, or else its last one.
///
/// A motion to `pose_trans(feature, pose)` has the feature's name as `frame` and `pose` as its target; other targets
/// are in the frame `base`. The tool has no name. For `movej`, `turn_speed_deg_s` is the speed of the leading joint and
/// `share` is 1. A time `t` takes the place of the speeds, which then are infinite. The level of an analog output stays
/// the share of its range, 0 to 1.
pub fn run_urscript(
    files: &[SourceFile],
    main: &str,
    features: &[(&str, [f64; 6])],
) -> Result<Vec<Step>, ProgramError> {
    let fail = |(line, problem)| ProgramError::new(main, line, problem);
    let file = files.iter().find(|file| file.name == main);
    let file = file.ok_or_else(|| fail((0, "there is no such file".to_owned())))?;
    let statements = parser::read(&file.text).map_err(fail)?;
    let features = features.iter().map(|&(name, pose)| (name, placement(pose)));
    let mut run = Run {
        file: main,
        features: features.collect(),
        scopes: vec![Names::default()],
        has_called: false,
        open_blend_mm: 0.0,
        waypoints: Vec::new(),
        steps: Vec::new(),
    };
    run.body(&statements, 0).map_err(fail)?;
    if !run.has_called {
        let defined = |(line, action): &Statement| match action {
            Action::Define(name, _) => Some((*line, name.clone())),
            _ => None,
        };
        let last = statements.iter().rev().find_map(defined);
        let (line, last) = last.ok_or_else(|| fail((1, "the program calls nothing".to_owned())))?;
        let has_main = run.scopes[0].functions.contains_key("main");
        let start = if has_main { "main" } else { &last };
        run.call_function(start, &[], line, 0).map_err(fail)?;
    }
    check_blends(&run.waypoints).map_err(fail)?;
    Ok(run.steps)
}

#[derive(Clone, Debug)]
enum Value {
    Number(f64),
    Text(String),
    Truth(bool),
    List(Vec<f64>),
    /// A pose in the robot's frame; and where it begins with a feature, that and the pose in it.
    Pose(Frame, Option<(String, Frame)>),
}

#[derive(Default)]
struct Names {
    parent: Option<usize>,
    values: HashMap<String, Value>,
    functions: HashMap<String, Rc<Function>>,
}

struct Run<'a> {
    file: &'a str,
    features: HashMap<&'a str, Frame>,
    scopes: Vec<Names>,
    has_called: bool,
    /// Blend of the last motion, while nothing has waited for its end.
    open_blend_mm: f64,
    waypoints: Vec<Waypoint>,
    steps: Vec<Step>,
}

impl Run<'_> {
    fn body(&mut self, statements: &[Statement], scope: usize) -> Result<(), LineProblem> {
        for &(line, ref action) in statements {
            match action {
                Action::Comment(text) => {
                    let start = text.get(..5);
                    if start.is_some_and(|start| start.eq_ignore_ascii_case("layer")) {
                        self.steps.push(Step::Note { text: text.clone() });
                    }
                }
                Action::Assign(name, value) => {
                    let value = self.value(value, scope);
                    let value = value.map_err(|problem| (line, problem))?;
                    let holds = |&at: &usize| self.scopes[at].values.contains_key(name);
                    let nearest = self.outwards(scope).find(holds).unwrap_or(scope);
                    self.scopes[nearest].values.insert(name.clone(), value);
                }
                Action::Global(name, value) => {
                    let value = self.value(value, scope);
                    let value = value.map_err(|problem| (line, problem))?;
                    self.scopes[0].values.insert(name.clone(), value);
                }
                Action::Define(name, function) => {
                    let functions = &mut self.scopes[scope].functions;
                    functions.insert(name.clone(), Rc::clone(function));
                }
                Action::Call(call) => {
                    self.has_called = true;
                    if self.function(&call.name, scope).is_none() {
                        let done = self.command(call, line, scope);
                        done.map_err(|problem| (line, problem))?;
                    } else {
                        let given = call.arguments.iter().map(|(name, value)| match name {
                            Some(name) => Err(format!("{name} is given by its name")),
                            None => self.value(value, scope),
                        });
                        let given: Result<Vec<Value>, String> = given.collect();
                        let given = given.map_err(|problem| (line, problem))?;
                        self.call_function(&call.name, &given, line, scope)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn outwards(&self, scope: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(scope), |&inner| self.scopes[inner].parent)
    }

    fn function(&self, name: &str, scope: usize) -> Option<(usize, Rc<Function>)> {
        let defined = |scope: usize| self.scopes[scope].functions.get(name).map(Rc::clone);
        self.outwards(scope)
            .find_map(|scope| Some((scope, defined(scope)?)))
    }

    fn call_function(
        &mut self,
        name: &str,
        given: &[Value],
        line: usize,
        scope: usize,
    ) -> Result<(), LineProblem> {
        let found = self.function(name, scope);
        let found = found.filter(|_| self.scopes.len() <= DEPTH_MAX);
        let problem = || (line, format!("{name} is not there, or called too deep"));
        let (parent, function) = found.ok_or_else(problem)?;
        if function.parameters.len() != given.len() {
            let count = function.parameters.len();
            return Err((line, format!("{name} has {count} parameters")));
        }
        let values = function
            .parameters
            .iter()
            .cloned()
            .zip(given.iter().cloned());
        self.scopes.push(Names {
            parent: Some(parent),
            values: values.collect(),
            ..Names::default()
        });
        self.body(&function.body, self.scopes.len() - 1)?;
        self.scopes.pop();
        Ok(())
    }

    fn value(&self, expression: &Expression, scope: usize) -> Result<Value, String> {
        Ok(match expression {
            Expression::Number(number) => Value::Number(*number),
            Expression::Text(text) => Value::Text(text.clone()),
            Expression::Truth(truth) => Value::Truth(*truth),
            Expression::List(parts) => Value::List(self.numbers(parts, scope)?),
            Expression::Pose(parts) => {
                let parts = self.numbers(parts, scope)?.try_into();
                let parts: [f64; 6] = parts.map_err(|_| "a pose has six numbers")?;
                Value::Pose(placement(parts), None)
            }
            Expression::Binary(sign, left, right) => {
                let (left, right) = (self.number(left, scope)?, self.number(right, scope)?);
                Value::Number(match sign {
                    '+' => left + right,
                    '-' => left - right,
                    '*' => left * right,
                    _ if right == 0.0 => return Err("a division by zero".to_owned()),
                    _ => left / right,
                })
            }
            Expression::Name(name) => {
                let value = |at: usize| self.scopes[at].values.get(name);
                if let Some(value) = self.outwards(scope).find_map(value) {
                    return Ok(value.clone());
                }
                let feature = self.features.get(name.as_str());
                let feature = feature.ok_or_else(|| format!("there is no {name}"))?;
                Value::Pose(*feature, Some((name.clone(), shift([0.0; 3]))))
            }
            Expression::Call(call) => self.pose_trans(call, scope)?,
        })
    }

    fn number(&self, expression: &Expression, scope: usize) -> Result<f64, String> {
        match self.value(expression, scope)? {
            Value::Number(number) => Ok(number),
            _ => Err("a number is needed here".to_owned()),
        }
    }

    fn numbers(&self, expressions: &[Expression], scope: usize) -> Result<Vec<f64>, String> {
        let numbers = expressions.iter().map(|part| self.number(part, scope));
        numbers.collect()
    }

    fn pose_trans(&self, call: &Call, scope: usize) -> Result<Value, String> {
        if call.name != "pose_trans" {
            return Err(format!("the function {} is not covered here", call.name));
        }
        let [from, to] = bind(call, ["p_from", "p_from_to"], 2)?;
        let from = self.value(from.ok_or("p_from")?, scope)?;
        let to = self.value(to.ok_or("p_from_to")?, scope)?;
        let (Value::Pose(from, feature), Value::Pose(to, _)) = (from, to) else {
            return Err("pose_trans needs two poses".to_owned());
        };
        let feature = feature.map(|(name, local)| (name, chain(&local, &to)));
        Ok(Value::Pose(chain(&from, &to), feature))
    }
}

/// A pose of position, m, and rotation vector, rad: the turn by the vector's length about its direction.
fn placement([x, y, z, rx, ry, rz]: [f64; 6]) -> Frame {
    let mut frame = shift([x, y, z].map(|part| part * 1e3));
    let angle = (rx * rx + ry * ry + rz * rz).sqrt();
    if angle > 0.0 {
        let axis = [rx, ry, rz].map(|part| part / angle);
        let [a, b, c] = axis.map(|part| part * angle.sin());
        let skew = [[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]];
        let rest = 1.0 - angle.cos();
        for (i, row) in frame.rotation.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = *entry * angle.cos() + axis[i] * axis[j] * rest + skew[i][j];
            }
        }
    }
    frame
}

#[cfg(test)]
mod tests {
    use super::super::shown;
    use super::*;

    fn run(text: &str) -> Result<Vec<Step>, ProgramError> {
        let file = SourceFile {
            name: "part.script".to_owned(),
            text: text.to_owned(),
        };
        run_urscript(
            &[file],
            "part.script",
            &[("table", [0.5, 0.0, 0.1, 0.0, 0.0, 1.5])],
        )
    }

    /// Goal: a program means what the manual says. Method: its movej (module motion) with the joints "base at 0,
    /// shoulder 90, elbow -90, wrist 1 180, wrist 2 -90, wrist 3 90 degrees"; pose_trans(p[.2,.5,.1,1.57,0,0],
    /// p[.2,.5,.6,1.57,0,0]), which it says returns p[0.4,-0.0996,0.60048,3.14,0.0,0.0], at the default of 0.25 m/s; a
    /// feature as the frame of a motion; functions, variables and outputs, one of them where a blend begins.
    #[test]
    fn examples_of_the_manual() {
        let text = "def part():\n  speed = 0.1\n  def layer_1():\n    # layer 1\n    speed = 2*0.1-0.1+0.1\n    \
             set_standard_analog_out(1, 0.5)\n  end\n  movej([0,1.57,-1.57,3.14,-1.57,1.57], a=1.4, v=1.05, t=0, r=0)\n  \
             movel(pose_trans(p[.2,.5,.1,1.57,0,0], p[.2,.5,.6,1.57,0,0]))\n  layer_1()\n  \
             movep(pose_trans(table, p[0.1,0.2,0.3,0,0,0]), v=speed, r=0.004)\n  set_standard_digital_out(3, True)\n  \
             sleep(0.5)\n  movel(p[0.2,0,0,0,0,0], 1, 0.5, 3, 0.01)\n  textmsg(\"done # \", 1)\nend\n";
        let expected = "\
             part.script:8 Joints [inf, 60.16, 1.00, 0.00] (\"\", \"base\", None) Joints { degrees: [0.0, 90.0, \
             -90.0, 179.9, -90.0, 90.0], external: [] \
             }\n\
             part.script:9 Line [250.00, inf, 1.00, 0.00] (\"\", \"base\", None) [400.0, -99.6, 600.5] [[1.0, 0.0, \
             0.0], [0.0, -0.0, -1.0]] [] \
             None\n\
             Note { text: \"layer 1\" }\n\
             Output { file: \"part.script\", line: 6, name: \"analog_out[1]\", value: 0.50, before_end_mm: 0.00, \
             delay_s: 0.00 }\n\
             part.script:11 Line [200.00, inf, 1.00, 4.00] (\"\", \"table\", None) [100.0, 200.0, 300.0] [[1.0, 0.0, \
             0.0], [0.0, 0.0, 1.0]] [] \
             None\n\
             Output { file: \"part.script\", line: 12, name: \"digital_out[3]\", value: 1.00, before_end_mm: 4.00, \
             delay_s: 0.00 }\n\
             Wait { seconds: 0.50 }\n\
             part.script:14 Line [inf, inf, 1.00, 10.00] (\"\", \"base\", Some(3.0)) [200.0, 0.0, 0.0] [[1.0, 0.0, \
             0.0], [0.0, 0.0, 1.0]] [] \
             None\n\
             Note { text: \"done # 1\" }\n";
        assert_eq!(shown(&run(text).expect("a program")), expected);
    }

    /// Goal: what the manual does not allow or is not covered is refused with its line. Method: one such line each,
    /// blends that overlap by 1 mm among them.
    #[test]
    fn refusals() {
        let start = "movel(p[0,0,0,0,0,0], r=0.01)\n";
        for line in "movec(p[0,0,0,0,0,0], p[0,0,0,0,0,0])|set_tcp(p[0,0,0,0,0,0])|\
             set_standard_analog_out(2, 0.5)|set_standard_analog_out(0, 1.5)|\
             set_standard_digital_out(0, 1)|movel([0, 0])|movel(p[0,0,0,0,0,0], v=0)|\
             movel(p[0.02,0,0,0,0,0], r=0.011)|movep(p[1,0,0,0,0,0], t=2)|\
             movel(p[1,0,0,0,0,0], 1, 1, 0, 0, 0)|x = unknown|x = 1e-3|x = [1, 2|x = \"a|x = 3 4|\
             x = a & b|sleep(-1)|if x:|end|def f(1):|def f():"
            .split('|')
        {
            let error = run(&(start.to_owned() + line)).expect_err(line);
            assert_eq!(error.line, 2, "{line}: {error}");
        }
        assert!(run(&(start.to_owned() + "movel(p[0.02,0,0,0,0,0], r=0.01)")).is_ok());
    }
}

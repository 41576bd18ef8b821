//! RAPID's instructions: motions, outputs, waiting, settings, loading.
//!
//! In: an instruction's name and arguments. Out: steps. Source: the instructions' chapters after ABB's "RAPID
//! Instructions, Functions and Data types" (3HAC050917), not held against the manual's own text. Not covered: arguments
//! that the tables below do not have.

use super::super::{Motion, Step, Target, Way};
use super::Machine;
use super::data::{Sight, text, zone_mm};
use super::syntax::{Arguments, Declaration, Expression};

/// Whether an instruction (lower case) is covered.
pub fn is_instruction(name: &str) -> bool {
    const NAMES: &str = "moveabsj movel triggl triggio triggequip setao setdo waittime tpwrite confl singarea load unload";
    NAMES.split(' ').any(|known| known == name)
}

/// An instruction: what it sees, its line, its name in lower case, its arguments.
pub struct Call<'a> {
    pub(super) sight: Sight<'a>,
    pub(super) line: usize,
    pub(super) name: String,
    pub(super) arguments: &'a Arguments,
}

/// What triggdata hold: the output of a motion in a line of a file.
pub type Trigger = Box<dyn Fn(&str, usize) -> Step>;

impl<'a> Machine<'a> {
    /// Does an instruction that is covered.
    pub fn instruction(&mut self, call: &Call<'a>) -> Result<(), String> {
        let (sight, arguments) = (&call.sight, call.arguments);
        let required = &arguments.required;
        match call.name.as_str() {
            "moveabsj" | "movel" => self.motion(call)?,
            "triggl" => self.trigger_motion(call)?,
            "triggio" => self.trigger_io(call)?,
            "triggequip" => self.trigger_equip(call)?,
            "setao" | "setdo" => {
                arguments.check(2, &[])?;
                let value = match call.name.as_str() {
                    "setdo" => digital(sight, &required[1])?,
                    _ => sight.number(&required[1])?,
                };
                let name = sight.controllers(&required[0])?;
                let output = Step::output(sight.file, call.line, name, value);
                self.steps.push(output);
            }
            "waittime" => {
                arguments.check(1, &[])?;
                let seconds = not_negative(sight.number(&required[0])?)?;
                self.steps.push(Step::Wait { seconds });
            }
            "tpwrite" => {
                arguments.check(1, &[])?;
                let text = text(&required[0])?;
                self.steps.push(Step::Note { text });
            }
            "confl" | "singarea" => {
                let switches = [("on", 0, false), ("off", 0, false)];
                let allowed = usize::from(call.name == "singarea")..;
                arguments.check(0, &switches[allowed])?;
                if arguments.optional.len() != 1 {
                    return Err("one switch is needed".into());
                }
            }
            _ => self.file_instruction(call.name == "unload", arguments)?,
        }
        Ok(())
    }

    fn motion(&mut self, call: &Call<'a>) -> Result<(), String> {
        let (sight, arguments) = (&call.sight, call.arguments);
        arguments.check(4, &[("v", 2, true), ("z", 3, true), ("wobj", 4, true)])?;
        let (target, way) = if call.name == "moveabsj" {
            (sight.jointtarget(&arguments.required[0])?, Way::Joints)
        } else {
            (sight.robtarget(&arguments.required[0])?, Way::Line)
        };
        let mut motion = planned(call, target, way)?;
        if let Some(zone) = arguments.value("z") {
            let zone_mm = sight.number(zone)?;
            if motion.blend_mm == 0.0 || zone_mm <= 0.0 {
                return Err("\\Z sizes the zone of a fly-by point".into());
            }
            motion.blend_mm = zone_mm;
        }
        self.steps.push(Step::Move(motion));
        Ok(())
    }

    fn trigger_motion(&mut self, call: &Call<'a>) -> Result<(), String> {
        let (sight, arguments) = (&call.sight, call.arguments);
        arguments.check(5, &[("wobj", 5, true)])?;
        let target = sight.robtarget(&arguments.required[0])?;
        let motion = planned(call, target, Way::Line)?;
        self.steps.push(Step::Move(motion));
        let data = std::ptr::from_ref(trigger_data(sight, &arguments.required[2])?);
        let trigger = self.triggers.get(&data).ok_or("the trigger is not set")?;
        self.steps.push(trigger(sight.file, call.line));
        Ok(())
    }

    /// TriggIO: mm before the end point, or with \Time seconds before it.
    fn trigger_io(&mut self, call: &Call<'a>) -> Result<(), String> {
        let (sight, arguments) = (&call.sight, call.arguments);
        let allowed = [("dop", 2, true), ("aop", 2, true), ("time", 2, false)];
        arguments.check(3, &allowed)?;
        let before = not_negative(sight.number(&arguments.required[1])?)?;
        if arguments.has("time") {
            self.set_trigger(call, 0.0, -before)
        } else {
            self.set_trigger(call, before, 0.0)
        }
    }

    /// TriggEquip: mm before the end point, and the lag of the equipment by which the output comes earlier.
    fn trigger_equip(&mut self, call: &Call<'a>) -> Result<(), String> {
        let (sight, arguments) = (&call.sight, call.arguments);
        arguments.check(4, &[("dop", 3, true), ("aop", 3, true)])?;
        let before_mm = not_negative(sight.number(&arguments.required[1])?)?;
        let lag_s = sight.number(&arguments.required[2])?;
        self.set_trigger(call, before_mm, -lag_s)
    }

    /// Keeps a trigger that is set so many mm before the end; its value is the last required argument.
    fn set_trigger(&mut self, call: &Call<'a>, before: f64, delay_s: f64) -> Result<(), String> {
        let (sight, arguments) = (&call.sight, call.arguments);
        let value = &arguments.required[arguments.required.len() - 1];
        let (signal, value) = match (arguments.value("dop"), arguments.value("aop")) {
            (Some(signal), None) => (signal, digital(sight, value)?),
            (None, Some(signal)) => (signal, sight.number(value)?),
            _ => return Err("either \\DOp or \\AOp is needed".into()),
        };
        let name = sight.controllers(signal)?;
        // A time of 0 is written without a sign.
        let delay_s = delay_s + 0.0;
        let trigger: Trigger = Box::new(move |file, line| Step::Output {
            file: file.into(),
            line,
            name: name.clone(),
            value,
            before_end_mm: before,
            delay_s,
        });
        let data = trigger_data(sight, &arguments.required[0])?;
        self.triggers.insert(std::ptr::from_ref(data), trigger);
        Ok(())
    }

    /// Load and UnLoad: a path, and a file where the path is only a folder.
    fn file_instruction(&mut self, unloads: bool, arguments: &Arguments) -> Result<(), String> {
        let file = [("file", 1, true)];
        let dynamic = [("dynamic", 0, false)];
        let allowed = [&file[..], &dynamic[..usize::from(!unloads)]].concat();
        arguments.check(1, &allowed)?;
        let mut path = text(&arguments.required[0])?;
        if let Some(file) = arguments.value("file") {
            path = format!("{}/{}", path.trim_end_matches('/'), text(file)?);
        }
        if unloads {
            self.unload_file(&path)
        } else if arguments.has("dynamic") {
            self.load_file(&path)
        } else {
            Err("Load without \\Dynamic is not covered".into())
        }
    }
}

/// A motion whose speed is the second, whose zone and tool are the last arguments.
fn planned(call: &Call, target: Target, way: Way) -> Result<Motion, String> {
    let (sight, arguments) = (&call.sight, call.arguments);
    let required = &arguments.required;
    let last = required.len() - 1;
    let (mut speed_mm_s, turn_speed_deg_s) = sight.speeds(&required[1])?;
    if let Some(speed) = arguments.value("v") {
        speed_mm_s = sight.number(speed)?;
        if speed_mm_s <= 0.0 {
            return Err(format!("{speed_mm_s} is not above 0"));
        }
    }
    let frame = arguments.value("wobj").map(|name| sight.controllers(name));
    Ok(Motion {
        speed_mm_s,
        turn_speed_deg_s,
        blend_mm: zone_mm(&required[last - 1])?,
        tool: sight.controllers(&required[last])?,
        frame: frame.unwrap_or(Ok("wobj0".into()))?,
        ..Motion::new(sight.file, call.line, target, way)
    })
}

fn not_negative(value: f64) -> Result<f64, String> {
    let found = (value >= 0.0).then_some(value);
    found.ok_or_else(|| format!("{value} is below 0"))
}

fn digital(sight: &Sight, expression: &Expression) -> Result<f64, String> {
    match expression {
        Expression::Name(name) if name.eq_ignore_ascii_case("high") => Ok(1.0),
        Expression::Name(name) if name.eq_ignore_ascii_case("low") => Ok(0.0),
        _ => match sight.number(expression)? {
            value if value == 0.0 || value == 1.0 => Ok(value),
            value => Err(format!("{value} is neither 0 nor 1")),
        },
    }
}

fn trigger_data<'a>(sight: &Sight<'a>, expression: &Expression) -> Result<&'a Declaration, String> {
    let data = match expression {
        Expression::Name(name) => sight.declaration(name),
        _ => None,
    };
    let data = data.filter(|data| data.is_trigger);
    data.ok_or_else(|| format!("{expression:?} is no triggdata"))
}

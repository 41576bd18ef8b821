//! KRL's motions, the switching that is bound to them, and what they keep: components of positions, system variables.
//!
//! In: statements PTP, LIN, TRIGGER, assignments. Out: steps in mm and degrees. Source: motion programming, TRIGGER,
//! AXIS, E6AXIS, FRAME and E6POS, $VEL.CP in m/s, $VEL.ORI1 and $VEL.ORI2 in degrees/s, $APO.CDIS in mm after "KUKA
//! System Software 8.3, Operating and Programming Instructions for System Integrators" and "Expert Programming" (KSS
//! 5.2, BAS.SRC), not held against the manuals' own text: A, B, C turn about Z, Y', X''; components that a motion
//! leaves out keep their values. Not covered: PTP to a pose or approximated, C_VEL, C_ORI, S, T, E2 to E6.

use super::super::tokens::Cursor;
use super::super::{Motion, Step, Target, Way};
use super::{Frame, Machine};

/// To what a trigger is bound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    Start,
    End,
    Path,
}

/// A trigger that waits for its motion: its place, line and output.
pub type Trigger = (Place, usize, Step);

impl Machine {
    /// PTP with axes.
    pub fn ptp(&mut self, frame: &Frame, words: &mut Cursor) -> Result<(), String> {
        let mut kept = self.kept;
        let target = kept.target(words, |words| self.number(frame, words))?;
        words.end()?;
        if matches!(target, Target::Pose { .. }) {
            return Err("PTP to a pose is not covered".into());
        }
        let mut motion = self.motion(frame, target, Way::Joints);
        motion.share = self.settings.share.ok_or("the axes' speed is not set")?;
        self.kept = kept;
        self.moved = true;
        self.go(motion)
    }

    /// LIN position [C_DIS].
    pub fn lin(&mut self, frame: &Frame, words: &mut Cursor) -> Result<(), String> {
        let mut kept = self.kept;
        let target = kept.target(words, |words| self.number(frame, words))?;
        let blends = words.takes_word("C_DIS");
        words.end()?;
        if !self.moved {
            return Err("the first motion is a PTP".into());
        }
        if matches!(target, Target::Joints { .. }) {
            return Err("a motion on a path leads to a pose".into());
        }
        let settings = &self.settings;
        if settings.tool.is_none() || settings.base.is_none() {
            return Err("$TOOL or $BASE is not set".into());
        }
        let mut motion = self.motion(frame, target, Way::Line);
        motion.speed_mm_s = settings.path_speed_mm_s.ok_or("$VEL.CP is not set")?;
        motion.turn_speed_deg_s = settings.turn_speed_deg_s();
        if blends {
            motion.blend_mm = settings.distance_mm.ok_or("$APO.CDIS is not set")?;
        }
        self.kept = kept;
        self.go(motion)
    }

    fn motion(&self, frame: &Frame, target: Target, way: Way) -> Motion {
        Motion {
            tool: self.settings.tool.clone().unwrap_or_default(),
            frame: self.settings.base.clone().unwrap_or_default(),
            ..Motion::new(&frame.source.file, frame.line, target, way)
        }
    }

    /// TRIGGER WHEN DISTANCE=0|1 or PATH=mm DELAY=ms DO output.
    pub fn trigger(&mut self, frame: &Frame, words: &mut Cursor) -> Result<(), String> {
        words.keyword("WHEN")?;
        let on_path = words.takes_word("PATH");
        if !on_path {
            words.keyword("DISTANCE")?;
        }
        words.mark('=')?;
        let (place, after_mm) = match self.number(frame, words)? {
            after_mm if on_path => (Place::Path, after_mm),
            0.0 => (Place::Start, 0.0),
            1.0 => (Place::End, 0.0),
            other => return Err(format!("DISTANCE is 0 or 1, not {other}")),
        };
        words.keyword("DELAY")?;
        words.mark('=')?;
        let delay_s = self.number(frame, words)? / 1000.0;
        words.keyword("DO")?;
        let (name, value) = self.output_value(frame, words)?;
        words.end()?;
        let output = Step::Output {
            file: frame.source.file.clone(),
            line: frame.line,
            name,
            value,
            // A distance of 0 is written without a sign.
            before_end_mm: 0.0 - after_mm,
            delay_s,
        };
        self.triggers.push((place, frame.line, output));
        Ok(())
    }

    /// A motion and the triggers that are bound to it.
    fn go(&mut self, motion: Motion) -> Result<(), String> {
        let triggers = std::mem::take(&mut self.triggers);
        let is_joints = motion.way == Way::Joints;
        if is_joints && triggers.iter().any(|trigger| trigger.0 == Place::Path) {
            return Err("a trigger with PATH needs a motion on a path".into());
        }
        let (before, after): (Vec<_>, Vec<_>) = triggers
            .into_iter()
            .partition(|trigger| trigger.0 == Place::Start);
        self.steps
            .extend(before.into_iter().map(|trigger| trigger.2));
        self.steps.push(Step::Move(motion));
        self.steps
            .extend(after.into_iter().map(|trigger| trigger.2));
        Ok(())
    }
}

/// Components in the order in which they are kept here.
const COMPONENTS: [&str; 13] = [
    "X", "Y", "Z", "A", "B", "C", "E1", "A1", "A2", "A3", "A4", "A5", "A6",
];
/// Where E1 is, after the pose and before the axes.
const EXTERNAL: usize = 6;

/// The components at which the arm is, as far as the program says: mm, degrees.
#[derive(Clone, Copy, Debug, Default)]
pub struct Kept([Option<f64>; 13]);

impl Kept {
    /// Another frame or tool: the numbers of the pose are no longer those of the place.
    pub fn forget_pose(&mut self) {
        self.0[..EXTERNAL].fill(None);
    }

    /// The target of a motion to `{X 1,Y 2}`; what it leaves out stays. `number` reads a component's value.
    pub fn target(
        &mut self,
        words: &mut Cursor,
        number: impl Fn(&mut Cursor) -> Result<f64, String>,
    ) -> Result<Target, String> {
        let mut given = [None; 13];
        words.mark('{')?;
        loop {
            let name = words.name("")?;
            let at = COMPONENTS.iter().position(|other| *other == name);
            let at = at.ok_or_else(|| format!("{name} is not covered as a component"))?;
            if given[at].replace(number(words)?).is_some() {
                return Err(format!("{name} is given twice"));
            }
            if words.takes('}') {
                break;
            }
            words.mark(',')?;
        }
        let is_given = |part: &[Option<f64>]| part.iter().any(Option::is_some);
        let axes = is_given(&given[EXTERNAL + 1..]);
        if axes == is_given(&given[..EXTERNAL]) {
            return Err("either a pose or axes are given".into());
        }
        let mut all = self.0;
        for (value, given) in all.iter_mut().zip(given) {
            *value = given.or(*value);
        }
        let needed = if axes { EXTERNAL + 1..13 } else { 0..EXTERNAL };
        let mut main = [0.0; 6];
        for (value, at) in main.iter_mut().zip(needed) {
            *value = all[at].ok_or_else(|| format!("{} is not known", COMPONENTS[at]))?;
        }
        let external = all[EXTERNAL].into_iter().collect();
        *self = Kept(all);
        if axes {
            self.forget_pose();
            let degrees = main.into();
            return Ok(Target::Joints { degrees, external });
        }
        self.0[EXTERNAL + 1..].fill(None);
        let [x, y, z, angles @ ..] = main;
        Ok(Target::Pose {
            tip_mm: [x, y, z],
            rotation: rotation_of_abc(angles),
            external,
            configuration: None,
        })
    }
}

/// Rows of the rotation by A about Z, B about the new Y, C about the new X; degrees.
fn rotation_of_abc(angles_deg: [f64; 3]) -> [[f64; 3]; 3] {
    let [(sa, ca), (sb, cb), (sc, cc)] = angles_deg.map(|angle| angle.to_radians().sin_cos());
    [
        [ca * cb, ca * sb * sc - sa * cc, ca * sb * cc + sa * sc],
        [sa * cb, sa * sb * sc + ca * cc, sa * sb * cc - ca * sc],
        [-sb, cb * sc, cb * cc],
    ]
}

/// Tools and bases of the controller by their numbers, 0 is none.
const TOOLS: f64 = 16.0;
const BASES: f64 = 32.0;

/// What the motions use, as far as it is set: speed on the path, mm/s; speeds of swivelling and of turning about the tool's
/// direction, degrees/s; share of the axes' greatest speeds; distance of C_DIS, mm; numbers of the tool and the base.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    path_speed_mm_s: Option<f64>,
    turn_speeds_deg_s: [Option<f64>; 2],
    share: Option<f64>,
    distance_mm: Option<f64>,
    pub(super) tool: Option<String>,
    pub(super) base: Option<String>,
}

impl Settings {
    /// A command of BAS. INITMOV: axes at their full speed, no tool, the world as base; speeds on the path have no
    /// value that a program could rely on.
    pub fn basic(&mut self, command: &str, value: f64) -> Result<(), String> {
        match command {
            "INITMOV" => {
                *self = Settings {
                    share: Some(1.0),
                    tool: Some("0".into()),
                    base: Some("0".into()),
                    ..Settings::default()
                };
            }
            "VEL_PTP" => self.share = Some(within(value, 1.0, 100.0)? / 100.0),
            _ => return Err(format!("BAS(#{command}) is not covered")),
        }
        Ok(())
    }

    /// `variable = value` from the value on; `number` reads a number.
    pub fn assign(
        &mut self,
        variable: &str,
        words: &mut Cursor,
        number: impl Fn(&mut Cursor) -> Result<f64, String>,
    ) -> Result<(), String> {
        const ANY: f64 = f64::MAX;
        const MORE: f64 = f64::MIN_POSITIVE;
        let numbered = |words: &mut Cursor, field: &str, most: f64| {
            let world = field == "BASE_DATA" && words.takes_word("$WORLD");
            if world || words.takes_word("$NULLFRAME") {
                return Ok(Some("0".into()));
            }
            words.keyword(field)?;
            words.mark('[')?;
            let index = integer(number(words)?, 1.0, most)?;
            words.mark(']').map(|()| Some(index))
        };
        match variable {
            "$TOOL" => self.tool = numbered(words, "TOOL_DATA", TOOLS)?,
            "$BASE" => self.base = numbered(words, "BASE_DATA", BASES)?,
            "$ORI_TYPE" => words.mark('#').and_then(|()| words.keyword("VAR"))?,
            "$VEL.CP" => self.path_speed_mm_s = Some(1e3 * within(number(words)?, MORE, ANY)?),
            "$VEL.ORI1" | "$VEL.ORI2" => {
                let speed = within(number(words)?, MORE, ANY)?;
                self.turn_speeds_deg_s[usize::from(variable == "$VEL.ORI2")] = Some(speed);
            }
            "$ACC.CP" => drop(within(number(words)?, MORE, ANY)?),
            "$APO.CDIS" => self.distance_mm = Some(within(number(words)?, 0.0, ANY)?),
            "$ADVANCE" => drop(integer(number(words)?, 0.0, 5.0)?),
            _ => return Err(format!("{variable} is not covered")),
        }
        words.end()
    }

    /// Speed of the tool's turning, degrees/s: the slower of both, infinite where the program sets none.
    pub fn turn_speed_deg_s(&self) -> f64 {
        let speeds = self.turn_speeds_deg_s.iter().flatten();
        speeds.copied().fold(f64::INFINITY, f64::min)
    }
}

fn within(value: f64, low: f64, high: f64) -> Result<f64, String> {
    let found = (low..=high).contains(&value).then_some(value);
    found.ok_or_else(|| format!("{value} is not from {low} to {high}"))
}

fn integer(value: f64, low: f64, high: f64) -> Result<String, String> {
    let value = within(value, low, high)?;
    let found = (value.fract() == 0.0).then(|| value.to_string());
    found.ok_or_else(|| format!("{value} is no integer"))
}

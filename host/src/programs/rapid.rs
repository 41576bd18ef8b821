//! RAPID: a module with a procedure for each layer; further modules are loaded one after the other.
//!
//! In: procedures. Out: `name.mod` with the procedure that starts, `name_1.mod` and so on where one module would be too
//! large; with a pump `name_pump.mod`, whose routine the controller calls when it stops. Source: ABB, Technical reference
//! manual RAPID Instructions, Functions and Data types (3HAC050917): MoveL with `\V` (mm/s) and `\Z` (mm), speeddata,
//! zonedata, confdata, Load and UnLoad, TriggIO and TriggL, SetAO and SetDO.

use super::configuration::{AXES, quadrants};
use super::procedures::Procedure;
use super::procedures::Step;
use super::text::{WRITTEN_BY, checked_name, digits, program_name, rounded_down, short};
use super::walk::{Block, Place, Walk};
use super::{Language, Program, ProgramFile, ProgramJob, ProgramOptions};
use super::{arm_of, in_files, stops_note};
use crate::settings::pump::PumpKind;
use crate::text::refusal::Refusal;
use headway_firmware::configuration::Arm;
use nalgebra::UnitQuaternion;

/// An external axis that is not there.
const NONE: &str = "9E9";
const EXTERNAL: usize = 6;
/// Digits of a quaternion: 0.0001°.
const QUATERNION_DIGITS: usize = 7;
/// Digits of the pump's output.
const OUTPUT_DIGITS: usize = 4;
/// Turning speed that binds nothing, degrees/s: that of v100.
const TURN_FREE_DEG_S: u32 = 500;
/// Speed to the start, mm/s and degrees/s.
const START_SPEEDS: &str = "[50,20,50,20]";

struct Rapid<'a> {
    arm: &'a Arm,
    /// `tool\WObj:=frame`.
    frames: String,
    digits: usize,
    layers: u32,
    name: &'a str,
    /// Signal of the pump, and whether it is on or off only.
    pump: Option<(&'a str, bool)>,
}

/// The program's files.
pub(super) fn program(
    job: &ProgramJob,
    options: &ProgramOptions,
    walk: &Walk,
    procedures: Vec<Procedure>,
) -> Result<Program, Refusal> {
    let rule = "a name of RAPID has letters, digits and underscores, at most 32";
    let tool = checked_name(options.tool.as_ref(), "hw_nozzle", "--tool", 32, rule)?;
    let work_object = options.work_object.as_ref();
    let frame = checked_name(work_object, "hw_bed", "--work-object", 32, rule)?;
    let name = program_name(options)?;
    let signal = job.pump.map(|pump| {
        let signal = checked_name(Some(&pump.output), "", "pump.output", 32, rule)?;
        Ok((signal, pump.kind == PumpKind::Digital))
    });
    let rapid = Rapid {
        arm: arm_of(job.machine, Language::Rapid)?,
        frames: format!("{tool}\\WObj:={frame}"),
        digits: digits(options),
        layers: walk.layers,
        name,
        pump: signal.transpose()?,
    };
    let (parts, stops) = in_files(procedures, options, |of| rapid.procedure(of));
    let is_one = parts.len() == 1;
    let mut main = rapid.head([tool, frame], options) + &rapid.begin(&walk.start);
    let mut files = Vec::new();
    let mut behind = String::new();
    for (number, part) in (1..).zip(&parts) {
        let module = format!("{name}_{number}");
        if !is_one {
            main += &format!("    Load \\Dynamic, \"HOME:\" \\File:=\"{module}.mod\";\n");
        }
        for (procedure, _) in part {
            main += &match is_one {
                true => format!("    {};\n", rapid.name_of(procedure)),
                false => format!("    %\"{}\"%;\n", rapid.name_of(procedure)),
            };
        }
        let texts = part.iter().map(|(_, text)| text.as_str());
        if is_one {
            behind.extend(texts);
        } else {
            main += &format!("    UnLoad \"HOME:\" \\File:=\"{module}.mod\";\n");
            let body: String = texts.collect();
            files.push(ProgramFile {
                name: format!("{module}.mod"),
                text: format!("MODULE {module}\n  ! {WRITTEN_BY}\n{body}ENDMODULE\n"),
            });
        }
    }
    main += &format!("{}  ENDPROC\n{behind}ENDMODULE\n", rapid.set(0.0));
    let name = format!("{}.{}", options.name, Language::Rapid.ending());
    files.insert(0, ProgramFile { name, text: main });
    let mut notes = vec![format!(
        "tool {tool} and work object {frame} are those of the controller: z out of the nozzle and x along its long side; the \
         machine file's coordinates"
    )];
    notes.extend(stops_note(stops));
    if rapid.pump.is_some() {
        let (file, note) = rapid.stop();
        files.push(file);
        notes.push(note);
    }
    if !is_one {
        notes.push("the further files go into HOME: of the controller".to_string());
    }
    Ok(Program {
        files,
        notes,
        ..Program::default()
    })
}

impl Rapid<'_> {
    /// What the main procedure does before its layers.
    fn begin(&self, start: &Place) -> String {
        let name = self.name;
        let trigger = match self.pump {
            Some(_) => format!("  VAR triggdata {name}_change;\n"),
            None => String::new(),
        };
        format!(
            "{trigger}  PROC {name}_main()\n    ConfL\\On;\n    SingArea\\Off;\n{}    MoveAbsJ [[{}],[{}]],{START_SPEEDS},fine,{};\n",
            self.set(0.0),
            self.angles(start),
            self.external(start),
            self.frames
        )
    }

    /// The module with the event routine, and how the controller comes to it.
    fn stop(&self) -> (ProgramFile, String) {
        let module = format!("{}_pump", self.name);
        let note = format!(
            "load {module}.mod beside the program and make {module}_off the event routine of STOP, QSTOP and RESET: without it \
             the pump runs on where the robot stops"
        );
        let text = format!(
            "MODULE {module}\n  ! {WRITTEN_BY}\n  PROC {module}_off()\n{}  ENDPROC\nENDMODULE\n",
            self.set(0.0)
        );
        let name = format!("{module}.mod");
        (ProgramFile { name, text }, note)
    }

    fn head(&self, [tool, frame]: [&str; 2], options: &ProgramOptions) -> String {
        let [x, y, z] = self.arm.base.origin_mm.map(|mm| short(mm, 3));
        format!(
            "MODULE {}\n  ! {WRITTEN_BY}: {} layers, within {} mm of the job\n  ! tool {tool}: z out of the nozzle, x along its long \
             side\n  ! work object {frame}: the robot's base stands at [{x}, {y}, {z}] mm in it\n",
            self.name,
            self.layers,
            short(options.tolerance_mm, 4)
        )
    }

    /// Procedures of a module that is loaded share their names with all that are.
    fn name_of(&self, procedure: &Procedure) -> String {
        format!("{}_{}", self.name, procedure.name())
    }

    fn procedure(&self, of: &Procedure) -> String {
        let (name, title) = (self.name_of(of), of.title(self.layers));
        let mut text = format!("  PROC {name}()\n    ! {title}\n");
        for step in &of.steps {
            text += &self.step(step);
        }
        text + "  ENDPROC\n"
    }

    fn step(&self, step: &Step) -> String {
        let set = step.output.map(|value| self.set(value)).unwrap_or_default();
        match (&step.block, step.output) {
            (Some(block), Some(value)) if block.blend_mm > 0.0 => self.change(block, value),
            (Some(block), _) => self.block(block) + &set,
            (None, _) => format!("WaitTime {};\n{set}", short(step.seconds, 3)),
        }
    }

    /// Sets the pump's output where the program is.
    fn set(&self, value: f64) -> String {
        match self.pump {
            Some((signal, true)) => format!("SetDO {signal},{value};\n"),
            Some((signal, false)) => format!("SetAO {signal},{};\n", short(value, OUTPUT_DIGITS)),
            None => String::new(),
        }
    }

    /// A block in whose blend the pump's output changes.
    fn change(&self, block: &Block, value: f64) -> String {
        let (signal, argument) = match self.pump {
            Some((signal, true)) => (signal, "DOp"),
            Some((signal, false)) => (signal, "AOp"),
            None => return self.block(block),
        };
        let (name, value) = (self.name, short(value, OUTPUT_DIGITS));
        let zone_mm = short(rounded_down(block.blend_mm, 2).max(0.01), 2);
        let speed = match block.is_turn() {
            true => self.turn_speed(block),
            false => format!(
                "[{},{TURN_FREE_DEG_S},{TURN_FREE_DEG_S},{TURN_FREE_DEG_S}]",
                short(block.speed_mm_s, 3)
            ),
        };
        format!(
            "TriggIO {name}_change,0\\{argument}:={signal},{value};\nTriggL {},{speed},{name}_change,\
             [FALSE,{zone_mm},{zone_mm},{zone_mm},1,{zone_mm},1],{};\n",
            self.target(block),
            self.frames
        )
    }

    fn turn_speed(&self, block: &Block) -> String {
        let turn_deg_s = short(block.turn_deg_s(), 3);
        let speed_mm_s = short(block.speed_mm_s.max(1.0), 2);
        format!("[{speed_mm_s},{turn_deg_s},{speed_mm_s},{turn_deg_s}]")
    }

    fn block(&self, block: &Block) -> String {
        let speed = match block.is_turn() {
            true => self.turn_speed(block),
            false => format!("v100\\V:={}", short(block.speed_mm_s, 3)),
        };
        let zone = match rounded_down(block.blend_mm, 2) {
            blend_mm if blend_mm >= 0.01 => format!("z1\\Z:={}", short(blend_mm, 2)),
            _ if block.blend_mm > 0.0 => "z1\\Z:=0.01".to_string(),
            _ => "fine".to_string(),
        };
        format!(
            "MoveL {},{speed},{zone},{};\n",
            self.target(block),
            self.frames
        )
    }

    fn target(&self, block: &Block) -> String {
        let tip = block.to.tip_mm.map(|mm| short(mm, self.digits)).join(",");
        let q = UnitQuaternion::from_rotation_matrix(&block.to.tool);
        let q = [q.w, q.i, q.j, q.k]
            .map(|part| short(part, QUATERNION_DIGITS))
            .join(",");
        let cf = quadrants(self.arm, &block.to.joints)
            .map(|number| number.to_string())
            .join(",");
        format!("[[{tip}],[{q}],[{cf}],[{}]]", self.external(&block.to))
    }

    fn angles(&self, of: &Place) -> String {
        let angles = of.joints[..AXES]
            .iter()
            .map(|rad| short(rad.to_degrees(), 4));
        angles.collect::<Vec<_>>().join(",")
    }

    /// The nozzle's own joint is the first external axis.
    fn external(&self, of: &Place) -> String {
        let mut axes = [const { String::new() }; EXTERNAL];
        axes.fill(NONE.to_string());
        if self.arm.nozzle {
            axes[0] = short(of.joints[AXES].to_degrees(), 4);
        }
        axes.join(",")
    }
}

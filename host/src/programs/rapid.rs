//! RAPID: a module with a procedure for each layer; further modules are loaded one after the other.
//!
//! In: procedures. Out: `name.mod` with the procedure that starts, `name_1.mod` and so on where one module would be too
//! large. Source: ABB, Technical reference manual RAPID Instructions, Functions and Data types (3HAC050917): MoveL with
//! `\V` (mm/s) and `\Z` (mm), speeddata, confdata, Load and UnLoad.

use super::configuration::{AXES, quadrants};
use super::procedures::Procedure;
use super::text::{WRITTEN_BY, checked_name, digits, program_name, rounded_down, short};
use super::walk::{Block, Place, Walk};
use super::{Language, Program, ProgramError, ProgramFile, ProgramJob, ProgramOptions};
use super::{arm_of, in_files, stops_note};
use headway_firmware::configuration::Arm;
use nalgebra::UnitQuaternion;

/// An external axis that is not there.
const NONE: &str = "9E9";
const EXTERNAL: usize = 6;
/// Digits of a quaternion: 0.0001°.
const QUATERNION_DIGITS: usize = 7;
/// Speed to the start, mm/s and degrees/s.
const START_SPEEDS: &str = "[50,20,50,20]";

struct Rapid<'a> {
    arm: &'a Arm,
    /// `tool\WObj:=frame`.
    frames: String,
    digits: usize,
    layers: u32,
    name: &'a str,
}

/// The program's files.
pub(super) fn program(
    job: &ProgramJob,
    options: &ProgramOptions,
    walk: &Walk,
    procedures: Vec<Procedure>,
) -> Result<Program, ProgramError> {
    let rule = "a name of RAPID has letters, digits and underscores, at most 32";
    let tool = checked_name(options.tool.as_ref(), "hw_nozzle", "--tool", 32, rule)?;
    let work_object = options.work_object.as_ref();
    let frame = checked_name(work_object, "hw_bed", "--work-object", 32, rule)?;
    let name = program_name(options)?;
    let rapid = Rapid {
        arm: arm_of(job.machine, Language::Rapid)?,
        frames: format!("{tool}\\WObj:={frame}"),
        digits: digits(options),
        layers: walk.layers,
        name,
    };
    let (parts, stops) = in_files(procedures, options, |of| rapid.procedure(of));
    let is_one = parts.len() == 1;
    let mut main = rapid.head(tool, frame, options);
    main += &format!("  PROC {name}_main()\n    ConfL\\On;\n    SingArea\\Off;\n");
    main += &format!(
        "    MoveAbsJ [[{}],[{}]],{START_SPEEDS},fine,{};\n",
        rapid.angles(&walk.start),
        rapid.external(&walk.start),
        rapid.frames
    );
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
    main += &format!("  ENDPROC\n{behind}ENDMODULE\n");
    files.insert(
        0,
        ProgramFile {
            name: format!("{}.{}", options.name, Language::Rapid.ending()),
            text: main,
        },
    );
    let mut notes = vec![format!(
        "tool {tool} and work object {frame} are those of the controller: z out of the nozzle and x along its long side; the \
         machine file's coordinates"
    )];
    notes.extend(stops_note(stops));
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
    fn head(&self, tool: &str, frame: &str, options: &ProgramOptions) -> String {
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
            text += &match &step.block {
                Some(block) => self.block(block),
                None => format!("WaitTime {};\n", short(step.seconds, 3)),
            };
        }
        text + "  ENDPROC\n"
    }

    fn block(&self, block: &Block) -> String {
        let speed = match block.is_turn() {
            true => {
                let turn_deg_s = short(block.turn_deg_s(), 3);
                format!(
                    "[{0},{1},{0},{1}]",
                    short(block.speed_mm_s.max(1.0), 2),
                    turn_deg_s
                )
            }
            false => format!("v100\\V:={}", short(block.speed_mm_s, 3)),
        };
        let zone = match rounded_down(block.blend_mm, 2) {
            blend_mm if blend_mm >= 0.01 => format!("z1\\Z:={}", short(blend_mm, 2)),
            _ if block.blend_mm > 0.0 => "z1\\Z:=0.01".to_string(),
            _ => "fine".to_string(),
        };
        let tip = block.to.tip_mm.map(|mm| short(mm, self.digits)).join(",");
        let q = UnitQuaternion::from_rotation_matrix(&block.to.tool);
        let q = [q.w, q.i, q.j, q.k]
            .map(|part| short(part, QUATERNION_DIGITS))
            .join(",");
        let cf = quadrants(self.arm, &block.to.joints)
            .map(|number| number.to_string())
            .join(",");
        format!(
            "MoveL [[{tip}],[{q}],[{cf}],[{}]],{speed},{zone},{};\n",
            self.external(&block.to),
            self.frames
        )
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

//! URScript: a function for each layer in one file; a part too large is several programs.
//!
//! In: procedures. Out: `name.script`, and `name_2.script` and so on, which are run one after the other. Source: Universal
//! Robots, The URScript Programming Language: movep and movel with a (m/s²), v (m/s) or t (s), r (m), pose_trans. Blocks that
//! only turn are told their time. Outputs by set_standard_analog_out, set_standard_digital_out, and what they are while no
//! program runs. A UR's own joints are no `arm6`: their ranges and speeds are the controller's to keep.

use super::procedures::{Procedure, end_of};
use super::text::{WRITTEN_BY, checked_name, digits, program_name, rounded_down, short};
use super::walk::{Block, Place, Walk};
use super::{Language, Program, ProgramFile, ProgramJob, ProgramOptions};
use super::{OutputNumber, in_files, output_number, stops_note};
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::Kinematics;
use headway_firmware::kinematics::joint_channels;
use headway_protocol::units::CHANNEL_HEADING;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Digits of rotation vectors, rad: 0.005°.
const ROTATION_DIGITS: usize = 4;

/// The work object where none is named.
const OWN_FRAME: &str = "hw_bed";

struct UrScript {
    frame: String,
    digits: usize,
    layers: u32,
    acceleration_m_s2: String,
    pump: Option<OutputNumber>,
}

/// The program's files.
pub(super) fn program(
    job: &ProgramJob,
    options: &ProgramOptions,
    walk: &Walk,
    procedures: Vec<Procedure>,
) -> Result<Program, Refusal> {
    let ur = UrScript::of(job, options, walk)?;
    let name = program_name(options)?;
    let (parts, stops) = in_files(procedures, options, |of| ur.procedure(of));
    let count = parts.len();
    let mut files = Vec::new();
    let mut start = walk.start;
    for (number, part) in (1..).zip(&parts) {
        let program = match number {
            1 => name.to_string(),
            _ => format!("{name}_{number}"),
        };
        let mut text = format!(
            "def {program}():\n  # {WRITTEN_BY}: part {number} of {count}, {} layers in all\n  # the active TCP: z out of the nozzle, x along \
             its long side\n",
            walk.layers
        );
        if options.work_object.is_none() {
            text += &format!("  global {OWN_FRAME} = {}\n", bed(&job.machine.kinematics));
        }
        text += &ur.blended();
        text.extend(part.iter().map(|(_, text)| text.as_str()));
        text += &ur.off_while_stopped();
        text += &format!("  movej({}, a=0.5, v=0.3)\n", ur.pose(&start));
        text += &ur.set(part.first().map_or(0.0, |of| of.0.output_before));
        for (procedure, _) in part {
            text += &format!("  {}()\n", procedure.name());
        }
        text += &ur.set(0.0);
        text += &format!("end\n{program}()\n");
        files.push(ProgramFile {
            name: format!("{program}.{}", Language::UrScript.ending()),
            text,
        });
        start = end_of(part.iter().map(|(procedure, _)| procedure)).unwrap_or(start);
    }
    let mut notes = Vec::from([
        "the joints of a UR were not planned: its wrist is none of the machine files' kinds; try the program dry".to_string(),
    ]);
    notes.extend(stops_note(stops));
    if count > 1 {
        notes.push(format!("{count} programs, to be run one after the other"));
    }
    Ok(Program {
        files,
        notes,
        ..Program::default()
    })
}

/// The machine's coordinates in those of the robot's base.
fn bed(kinematics: &Kinematics) -> String {
    let Kinematics::Arm6 { arm, .. } = kinematics else {
        return "p[0,0,0,0,0,0]".to_string();
    };
    let rows = arm.base.rotation;
    let to_machine = Matrix3::from_fn(|row, column| rows[row][column]);
    let to_base = Rotation3::from_matrix_unchecked(to_machine.transpose());
    let origin = to_base * -Vector3::from(arm.base.origin_mm);
    pose([origin.x, origin.y, origin.z], &to_base, 7)
}

fn pose(tip_mm: [f64; 3], rotation: &Rotation3<f64>, digits: usize) -> String {
    format!("p[{}]", numbers(tip_mm, rotation, digits))
}

/// The six numbers of a pose.
fn numbers(tip_mm: [f64; 3], rotation: &Rotation3<f64>, digits: usize) -> String {
    let [x, y, z] = tip_mm.map(|mm| short(1e-3 * mm, digits));
    let turn = UnitQuaternion::from_rotation_matrix(rotation).scaled_axis();
    let [rx, ry, rz] = [turn.x, turn.y, turn.z].map(|rad| short(rad, ROTATION_DIGITS));
    format!("{x},{y},{z},{rx},{ry},{rz}")
}

impl UrScript {
    fn of(job: &ProgramJob, options: &ProgramOptions, walk: &Walk) -> Result<UrScript, Refusal> {
        let kinematics = &job.machine.kinematics;
        let is_arm = matches!(kinematics, Kinematics::Arm6 { .. });
        let has_nozzle = joint_channels(kinematics).contains(&Some(CHANNEL_HEADING));
        if is_arm && has_nozzle {
            return Err(refusal!(
                "{language} is for arms that turn the nozzle by their wrist (without \
                 [joints.h]): a UR has no external axis; the job's machine is another: plan it \
                 with a machine file of that kind",
                language = Language::UrScript.name()
            ));
        }
        let rule = "a feature of the installation: letters, digits and underscores, at most 32";
        if let Some(tool) = &options.tool {
            return Err(refusal!(
                "--tool {tool}: a UR's tool is the TCP that is active in the installation"
            ));
        }
        Ok(UrScript {
            frame: checked_name(
                options.work_object.as_ref(),
                OWN_FRAME,
                "--work-object",
                32,
                rule,
            )?
            .to_string(),
            digits: digits(options) + 3,
            layers: walk.layers,
            acceleration_m_s2: short(1e-3 * job.tip_acceleration_mm_s2, 3),
            pump: output_number(
                job,
                [0..=1, 0..=7],
                (walk.output_max, 1.0),
                "the number of a standard output: 0 or 1 of the analog ones, 0 to 7 of the digital ones",
            )?,
        })
    }

    fn pose(&self, of: &Place) -> String {
        format!(
            "pose_trans({},{})",
            self.frame,
            pose(of.tip_mm, &of.tool, self.digits)
        )
    }

    /// A function for most of the blocks: half of the text.
    fn blended(&self) -> String {
        format!(
            "  def hw(x,y,z,rx,ry,rz,v,r):\n    movep(pose_trans({},p[x,y,z,rx,ry,rz]),{},v,r)\n  end\n",
            self.frame, self.acceleration_m_s2
        )
    }

    fn procedure(&self, of: &Procedure) -> String {
        let mut text = format!("  def {}():\n    # {}\n", of.name(), of.title(self.layers));
        for step in &of.steps {
            text += &match &step.block {
                Some(block) => self.block(block),
                None => format!("sleep({})\n", short(step.seconds, 3)),
            };
            text += &step.output.map(|value| self.set(value)).unwrap_or_default();
        }
        text + "  end\n"
    }

    /// Sets the pump's output; after a blended block where the blend begins.
    fn set(&self, value: f64) -> String {
        match &self.pump {
            Some(of) if of.is_digital => {
                let state = if value > 0.0 { "True" } else { "False" };
                format!("set_standard_digital_out({},{state})\n", of.number)
            }
            Some(of) => format!(
                "set_standard_analog_out({},{})\n",
                of.number,
                short(value, 5)
            ),
            None => String::new(),
        }
    }

    /// The output is at its least while no program runs.
    fn off_while_stopped(&self) -> String {
        let Some(OutputNumber { number, is_digital }) = &self.pump else {
            return String::new();
        };
        let kind = if *is_digital { "digital" } else { "analog" };
        format!("  set_runstate_standard_{kind}_output_to_value({number},1)\n")
    }

    fn block(&self, block: &Block) -> String {
        let (pose, a) = (self.pose(&block.to), &self.acceleration_m_s2);
        let blend_m = 1e-3 * rounded_down(block.blend_mm, 2);
        let v = short(1e-3 * rounded_down(block.speed_mm_s, 4), 7);
        match (block.is_turn(), blend_m > 0.0) {
            (true, _) => format!("movel({pose},t={})\n", short(block.seconds, 4)),
            (false, true) => {
                let place = numbers(block.to.tip_mm, &block.to.tool, self.digits);
                format!("hw({place},{v},{})\n", short(blend_m, 7))
            }
            (false, false) => format!("movel({pose},a={a},v={v})\n"),
        }
    }
}

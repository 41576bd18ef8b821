//! KRL: a module of a main program and a local one for each layer; a part too large is several programs.
//!
//! In: procedures. Out: `name.src` and `name.dat`, and `name_2` and so on, which are run one after the other: a KRC keeps all
//! programs in memory; with a pump `name_stop.sub`, which the submit interpreter calls. Source: KUKA System Software 8.x,
//! Operating and Programming Instructions for System Integrators: LIN with C_DIS and $APO.CDIS (mm), $VEL.CP (m/s), $VEL.ORI1
//! and $VEL.ORI2 (degrees/s), $ADVANCE, BAS, TRIGGER WHEN DISTANCE, $ANOUT and $OUT, $STOPMESS and $PRO_STATE1.

use super::configuration::{AXES, status_and_turn};
use super::procedures::{Procedure, end_of};
use super::text::{WRITTEN_BY, checked_number, digits, program_name, rounded_down, short};
use super::walk::{Block, Place, Walk};
use super::{Language, Program, ProgramFile, ProgramJob, ProgramOptions};
use super::{OutputNumber, arm_of, in_files, output_number, stops_note};
use crate::text::refusal::Refusal;
use headway_firmware::configuration::Arm;

/// Digits of angles in degrees.
const ANGLE_DIGITS: usize = 4;
/// A speed or a blend is written again where it differs by more than this share.
const SAME: f64 = 0.005;
/// Turning speeds that bind nothing, degrees/s.
const TURN_FREE_DEG_S: f64 = 400.0;
/// Speed to the start, per cent.
const START_PCT: u32 = 10;

struct Krl<'a> {
    arm: &'a Arm,
    digits: usize,
    layers: u32,
    acceleration_m_s2: f64,
    tool: u32,
    base: u32,
    pump: Option<OutputNumber>,
}

/// What the text so far has set.
#[derive(Default)]
struct Set {
    speed_m_s: f64,
    turn_deg_s: f64,
    blend_mm: f64,
}

/// The program's files.
pub(super) fn program(
    job: &ProgramJob,
    options: &ProgramOptions,
    walk: &Walk,
    procedures: Vec<Procedure>,
) -> Result<Program, Refusal> {
    let krl = Krl::of(job, options, walk)?;
    let name = program_name(options)?;
    let (parts, stops) = in_files(procedures, options, |of| krl.procedure(of));
    let count = parts.len();
    let mut files = Vec::new();
    let mut start = walk.start;
    for (number, part) in (1..).zip(&parts) {
        let module = match number {
            1 => name.to_string(),
            _ => format!("{name}_{number}"),
        };
        let mut text = krl.head(&module, &start, [number, count]);
        let output = part.first().map_or(0.0, |of| of.0.output_before);
        text += &krl.set(output);
        for (procedure, _) in part {
            text += &format!("{}( )\n", procedure.name());
        }
        text += &krl.set(0.0);
        text += "END\n";
        text.extend(part.iter().map(|(_, text)| text.as_str()));
        files.push(ProgramFile {
            name: format!("{module}.src"),
            text,
        });
        files.push(ProgramFile {
            name: format!("{module}.dat"),
            text: format!("DEFDAT {module}\n; {WRITTEN_BY}\nENDDAT\n"),
        });
        start = end_of(part.iter().map(|(procedure, _)| procedure)).unwrap_or(start);
    }
    let mut notes = vec![format!(
        "TOOL_DATA[{}] has z out of the nozzle and x along its long side; BASE_DATA[{}] is the machine file's coordinates",
        krl.tool, krl.base
    )];
    notes.extend(stops_note(stops));
    if krl.pump.is_some() {
        let (file, note) = krl.stop(name);
        files.push(file);
        notes.push(note);
    }
    if count > 1 {
        notes.push(format!(
            "{count} programs, to be selected one after the other"
        ));
    }
    Ok(Program {
        files,
        notes,
        ..Program::default()
    })
}

impl Krl<'_> {
    fn of<'a>(
        job: &ProgramJob<'a>,
        options: &ProgramOptions,
        walk: &Walk,
    ) -> Result<Krl<'a>, Refusal> {
        Ok(Krl {
            arm: arm_of(job.machine, Language::Krl)?,
            digits: digits(options),
            layers: walk.layers,
            acceleration_m_s2: 1e-3 * job.tip_acceleration_mm_s2,
            tool: checked_number(
                &options.tool,
                1,
                "--tool",
                1..=16,
                "the number of TOOL_DATA, 1 to 16",
            )?,
            base: checked_number(
                &options.work_object,
                1,
                "--work-object",
                1..=32,
                "the number of BASE_DATA, 1 to 32",
            )?,
            pump: output_number(
                job,
                [1..=32, 1..=4096],
                (walk.output_max, 1.0),
                "the number of $ANOUT, 1 to 32, or of $OUT, 1 to 4096",
            )?,
        })
    }

    /// What the submit interpreter calls, and how it comes to that.
    fn stop(&self, name: &str) -> (ProgramFile, String) {
        let module = format!("{name}_stop");
        let note = format!(
            "call {module}( ) in the loop of SPS.SUB: without it the pump runs on where the robot stops"
        );
        let text = format!(
            "&ACCESS RVO\nDEF {module}( )\n; {WRITTEN_BY}\nIF $STOPMESS OR ($PRO_STATE1<>#P_ACTIVE) THEN\n{}ENDIF\nEND\n",
            self.set(0.0)
        );
        let name = format!("{module}.sub");
        (ProgramFile { name, text }, note)
    }

    fn head(&self, module: &str, start: &Place, [number, count]: [usize; 2]) -> String {
        let angles = (1..).zip(&start.joints[..AXES]);
        let mut axes: Vec<String> = angles
            .map(|(axis, rad)| format!("A{axis} {}", short(rad.to_degrees(), ANGLE_DIGITS)))
            .collect();
        axes.extend(self.external(start));
        let [status, turn] = status_and_turn(self.arm, &start.joints);
        let [x, y, z] = self.arm.base.origin_mm.map(|mm| short(mm, 3));
        format!(
            "&ACCESS RVO\nDEF {module}( )\n; {WRITTEN_BY}: part {number} of {count}, {} layers in all\n; the robot's base stands at {x}, {y}, \
             {z} mm in base {}\nBAS(#INITMOV,0)\n$TOOL=TOOL_DATA[{}]\n$BASE=BASE_DATA[{}]\n$ORI_TYPE=#VAR\n$ADVANCE=5\n\
             $ACC.CP={}\nBAS(#VEL_PTP,{START_PCT})\n; S {status}, T {turn}\nPTP {{{}}}\n",
            self.layers,
            self.base,
            self.tool,
            self.base,
            short(self.acceleration_m_s2, 3),
            axes.join(",")
        )
    }

    fn procedure(&self, of: &Procedure) -> String {
        let mut text = format!("DEF {}( )\n; {}\n", of.name(), of.title(self.layers));
        let mut set = Set::default();
        for step in &of.steps {
            match (&step.block, step.output) {
                (Some(block), output) => {
                    let change = output.and_then(|value| self.assignment(value));
                    if let Some(change) = change {
                        text += &format!("TRIGGER WHEN DISTANCE=1 DELAY=0 DO {change}\n");
                    }
                    self.block(block, &mut set, &mut text);
                }
                (None, output) => {
                    text += &format!("WAIT SEC {}\n", short(step.seconds, 3));
                    text += &output.map(|value| self.set(value)).unwrap_or_default();
                }
            }
        }
        text + "END\n"
    }

    /// What gives the pump's output a value.
    fn assignment(&self, value: f64) -> Option<String> {
        let OutputNumber { number, is_digital } = self.pump.as_ref()?;
        Some(match (is_digital, value > 0.0) {
            (true, true) => format!("$OUT[{number}]=TRUE"),
            (true, false) => format!("$OUT[{number}]=FALSE"),
            (false, _) => format!("$ANOUT[{number}]={}", short(value, 5)),
        })
    }

    fn set(&self, value: f64) -> String {
        let assignment = self.assignment(value);
        assignment.map_or(String::new(), |text| text + "\n")
    }

    fn block(&self, block: &Block, set: &mut Set, text: &mut String) {
        let differs = |now: f64, before: f64| (now - before).abs() > SAME * before.abs();
        let speed_m_s = 1e-3 * block.speed_mm_s;
        let turn_deg_s = match block.is_turn() {
            true => block.turn_deg_s(),
            false => TURN_FREE_DEG_S,
        };
        if !block.is_turn() && differs(speed_m_s, set.speed_m_s) {
            *text += &format!("$VEL.CP={}\n", short(speed_m_s, 6));
            set.speed_m_s = speed_m_s;
        }
        if differs(turn_deg_s, set.turn_deg_s) {
            let rounded = short(turn_deg_s, 3);
            *text += &format!("$VEL.ORI1={rounded}\n$VEL.ORI2={rounded}\n");
            set.turn_deg_s = turn_deg_s;
        }
        let blend_mm = rounded_down(block.blend_mm, 1);
        if blend_mm > 0.0 && differs(blend_mm, set.blend_mm) {
            *text += &format!("$APO.CDIS={}\n", short(blend_mm, 6));
            set.blend_mm = blend_mm;
        }
        let [x, y, z] = block.to.tip_mm.map(|mm| short(mm, self.digits));
        let (c, b, a) = block.to.tool.euler_angles();
        let [a, b, c] = [a, b, c].map(|rad| short(rad.to_degrees(), ANGLE_DIGITS));
        let external: String = self
            .external(&block.to)
            .map(|e| format!(",{e}"))
            .unwrap_or_default();
        let blended = if blend_mm > 0.0 { " C_DIS" } else { "" };
        *text += &format!("LIN {{X {x},Y {y},Z {z},A {a},B {b},C {c}{external}}}{blended}\n");
    }

    /// The nozzle's own joint is the first external axis.
    fn external(&self, of: &Place) -> Option<String> {
        let angle = || short(of.joints[AXES].to_degrees(), ANGLE_DIGITS);
        self.arm.nozzle.then(|| format!("E1 {}", angle()))
    }
}

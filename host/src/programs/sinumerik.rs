//! Sinumerik G-code of a gantry with a heading axis: X Y Z and C, counted over turns.
//!
//! In: procedures. Out: `name.mpf` with subprograms for the layers, called by EXTCALL where it is too large. Source: Siemens,
//! SINUMERIK 840D sl Programming Manual Fundamentals and Job planning: FGROUP, G642 with CTOL and OTOL, G9, G4, SOFT;
//! Synchronized actions: IDS, WHENEVER, WHEN. A pump is off wherever the path stands, by a static action, and is set as soon as
//! it moves.

use super::procedures::Procedure;
use super::text::{WRITTEN_BY, checked_number, digits, program_name, rounded_down, short};
use super::walk::{Block, Place, Run, Walk};
use super::{Language, Program, ProgramFile, ProgramJob, ProgramOptions};
use super::{OutputNumber, in_files, output_number, stops_note};
use crate::gcode::write::is_tilting;
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::Kinematics;

/// Share of the tolerance that CTOL has: as large a rounding as the speeds need; with more, blocks are left too early for
/// theirs to be reached.
const CONTOUR_SHARE: f64 = 0.15;
/// Digits of C, degrees.
const HEADING_DIGITS: usize = 4;
/// OTOL: what is promised of the heading, degrees.
const HEADING_DEG: f64 = 0.05;
/// Digits of F that count.
const FEED_DIGITS: i32 = 4;
/// Feed to the start, mm/min.
const START_MM_MIN: u32 = 1000;

struct Sinumerik {
    /// Number of the frame: 54 for G54.
    frame: u32,
    digits: usize,
    layers: u32,
    pump: Option<OutputNumber>,
}

/// What the text so far has set.
#[derive(Default)]
struct Set {
    words: [String; 4],
    feed: f64,
    /// The pump's output.
    output: f64,
    /// True where it is to be set with the next motion: it changes, or the path stood.
    is_due: bool,
}

/// The program's files.
pub(super) fn program(
    job: &ProgramJob,
    options: &ProgramOptions,
    walk: &Walk,
    procedures: Vec<Procedure>,
) -> Result<Program, Refusal> {
    let nc = Sinumerik::of(job, options, walk)?;
    let name = program_name(options)?;
    let (parts, stops) = in_files(procedures, options, |of| nc.procedure(of));
    let is_one = parts.len() == 1;
    let mut main = format!(
        "; {WRITTEN_BY}: {} layers\nG90 G71 G94 G{} D0\nFGROUP(X,Y,Z)\nG642 CTOL={} OTOL={HEADING_DEG}\nSOFT\n{}",
        walk.layers,
        nc.frame,
        short(CONTOUR_SHARE * options.tolerance_mm, 4),
        nc.off_at_rest() + &nc.approach(&walk.start)
    );
    let mut files = Vec::new();
    for (number, part) in (1..).zip(parts) {
        let body: String = part.into_iter().map(|(_, text)| text).collect();
        if is_one {
            main += &body;
            continue;
        }
        let file = format!("{name}_{number}.SPF");
        main += &format!("EXTCALL \"{file}\"\n");
        files.push(ProgramFile {
            name: file,
            text: format!("; {WRITTEN_BY}\n{body}M17\n"),
        });
    }
    main += "M30\n";
    files.insert(
        0,
        ProgramFile {
            name: format!("{}.{}", options.name, Language::Sinumerik.ending()),
            text: main,
        },
    );
    let mut notes = vec![format!(
        "G{} is the machine file's coordinates, C = 0 is the nozzle's long side along X; C counts turns and is no modulo axis",
        nc.frame
    )];
    notes.extend(stops_note(stops));
    let pumps_at_rest = |run: &Run| {
        run.rests
            .iter()
            .any(|rest| rest.1.is_some_and(|value| value > 0.0))
    };
    if walk.runs.iter().any(pumps_at_rest) {
        notes.push(
            "this controller's pump is off while the head rests: it starts with the motion there; set flow.pump_start_mm and \
             flow.prime_mm3 to 0 and use pump.start_lead_s, which is spent on the way"
                .to_string(),
        );
    }
    Ok(Program {
        files,
        notes,
        ..Program::default()
    })
}

impl Sinumerik {
    fn of(job: &ProgramJob, options: &ProgramOptions, walk: &Walk) -> Result<Sinumerik, Refusal> {
        if job.machine.kinematics != Kinematics::Planar || is_tilting(job.stream) {
            return Err(refusal!(
                "{language} is for gantries that stay upright, with X, Y, Z and C (kinematics = \
                 \"planar\"); the job's machine is another: plan it with a machine file of that \
                 kind",
                language = Language::Sinumerik.name()
            ));
        }
        if let Some(tool) = &options.tool {
            return Err(refusal!(
                "--tool {tool}: the tool of a Sinumerik is the one that is active"
            ));
        }
        Ok(Sinumerik {
            frame: checked_number(
                &options.work_object,
                54,
                "--work-object",
                54..=57,
                "the number of the frame, 54 to 57 (G54 to G57)",
            )?,
            digits: digits(options),
            layers: walk.layers,
            pump: output_number(
                job,
                [1..=8, 1..=40],
                (walk.output_max, f64::INFINITY),
                "the number of $A_OUTA, 1 to 8, or of $A_OUT, 1 to 40",
            )?,
        })
    }

    fn words(&self, of: &Place) -> [String; 4] {
        let [x, y, z] = of.tip_mm.map(|mm| short(mm, self.digits));
        let c = short(of.heading_rad.to_degrees(), HEADING_DIGITS);
        [
            format!("X{x}"),
            format!("Y{y}"),
            format!("Z{z}"),
            format!("C{c}"),
        ]
    }

    /// The output's name, and a value of it.
    fn output(&self, value: f64) -> Option<String> {
        let OutputNumber { number, is_digital } = self.pump.as_ref()?;
        Some(match is_digital {
            true => format!("$A_OUT[{number}]={value}"),
            false => format!("$A_OUTA[{number}]={}", short(value, 4)),
        })
    }

    /// The pump's output gets a value as soon as the next block moves; off it is set at once.
    fn change(&self, value: f64) -> String {
        let Some(output) = self.output(value) else {
            return String::new();
        };
        let when = if value > 0.0 { "$AC_VACTW>0" } else { "TRUE" };
        format!("WHEN {when} DO {output}\n")
    }

    /// Static: also in other modes, and after the program.
    fn off_at_rest(&self) -> String {
        let output = self.output(0.0);
        output.map_or(String::new(), |output| {
            format!("IDS=1 WHENEVER $AC_VACTW==0 DO {output}\n")
        })
    }

    /// Z alone first: the head stands anywhere.
    fn approach(&self, start: &Place) -> String {
        let [x, y, z, c] = self.words(start);
        format!("G1 {z} F{START_MM_MIN}\nG9 {x} {y} {c}\n")
    }

    fn procedure(&self, of: &Procedure) -> String {
        let mut text = format!("; {}\n", of.title(self.layers));
        let mut set = Set {
            output: of.output_before,
            is_due: true,
            ..Set::default()
        };
        for step in &of.steps {
            match &step.block {
                Some(block) => self.block(block, &mut set, &mut text),
                None => text += &format!("G4 F{}\n", short(step.seconds, 3)),
            }
            let stands = step.block.is_none_or(|block| block.blend_mm <= 0.0);
            set.is_due |= stands || step.output.is_some();
            set.output = step.output.unwrap_or(set.output);
        }
        text
    }

    fn block(&self, block: &Block, set: &mut Set, text: &mut String) {
        let words = self.words(&block.to);
        let changed = words
            .iter()
            .zip(&set.words)
            .filter(|(now, before)| now != before);
        let changed: Vec<&str> = changed.map(|(now, _)| now.as_str()).collect();
        if changed.is_empty() {
            return;
        }
        // Millimetres a minute; of C alone degrees a minute.
        let feed = match changed.as_slice() {
            [only] if only.starts_with('C') => 60.0 * block.turn_deg_s(),
            _ => 60.0 * block.speed_mm_s,
        };
        let feed = rounded_down(feed, FEED_DIGITS);
        if std::mem::take(&mut set.is_due) {
            *text += &self.change(set.output);
        }
        let stops = if block.blend_mm > 0.0 { "" } else { " G9" };
        *text += &format!("G1{stops} {}", changed.join(" "));
        if feed != set.feed {
            *text += &format!(" F{}", short(feed, 4));
        }
        text.push('\n');
        set.words = words;
        set.feed = feed;
    }
}

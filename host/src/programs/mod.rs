//! A job as a program of a robot's or a gantry's controller: RAPID, KRL, URScript, Sinumerik G-code.
//!
//! ```text
//! SegmentStream --walk--> Run (blocks, rest to rest) --procedures--> Procedure --rapid, krl, urscript, sinumerik--> files
//! (servo ticks)           (mm, s, joints)
//! ```
//! In: a finished stream in machine coordinates and its machine. Out: texts of files. Points lie as far apart as a tolerance
//! at the tip and at the nozzle's end allows, never at even times; each block goes at the mean speed that the job has there,
//! so that the controller's own limits need not bind; corners are blended by as much as the tolerance allows, and the
//! program rests where the job rests. Tool and work object are named: they are calibrated on the controller. The tool's z
//! points out of the nozzle, its x along the nozzle's long side; the work object is the machine's coordinates. A pump that
//! the machine file has is switched ahead of its flow, and by a routine of the controller's own where it stops. Not covered:
//! heaters, pumps as external axes.

mod configuration;
mod krl;
mod pace;
pub mod procedures;
pub mod pump;
mod rapid;
mod sinumerik;
pub mod text;
mod urscript;
pub mod walk;

use crate::job::SegmentStream;
use crate::settings::Settings;
use crate::settings::pump::{PumpKind, PumpOutput};
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::{Kinematics, MachineConfiguration};
use procedures::{Procedure, procedures};
use pump::OutputChanges;
use std::ops::RangeInclusive;
use walk::{Tolerances, Walk};

/// Controllers' languages; the texts are the command's help.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    /// ABB.
    Rapid,
    /// KUKA.
    Krl,
    /// Universal Robots.
    UrScript,
    /// Siemens Sinumerik 840D, with a heading axis C.
    Sinumerik,
}

impl Language {
    /// All of them.
    pub const ALL: [Language; 4] = [
        Language::Rapid,
        Language::Krl,
        Language::UrScript,
        Language::Sinumerik,
    ];

    /// For messages.
    pub fn name(self) -> &'static str {
        match self {
            Language::Rapid => "RAPID",
            Language::Krl => "KRL",
            Language::UrScript => "URScript",
            Language::Sinumerik => "Sinumerik",
        }
    }

    /// As options call it.
    pub fn option(self) -> &'static str {
        match self {
            Language::Rapid => "rapid",
            Language::Krl => "krl",
            Language::UrScript => "urscript",
            Language::Sinumerik => "sinumerik",
        }
    }

    /// The ending of its main file.
    pub fn ending(self) -> &'static str {
        match self {
            Language::Rapid => "mod",
            Language::Krl => "src",
            Language::UrScript => "script",
            Language::Sinumerik => "mpf",
        }
    }

    /// Program memory that is assumed where nothing is given, kB: what a KRC4 has beside its own files; the others take more.
    fn kb_max(self) -> u32 {
        match self {
            Language::Krl => 4000,
            _ => 10_000,
        }
    }
}

/// How a program is written.
#[derive(Clone, Debug, PartialEq)]
pub struct ProgramOptions {
    /// Language.
    pub language: Language,
    /// Name of the program: that of its main file, without the ending.
    pub name: String,
    /// How far the tip and the nozzle's end may be from the job's, mm.
    pub tolerance_mm: f64,
    /// From the nozzle's axis to its end, mm.
    pub reach_mm: f64,
    /// Name or number of the tool on the controller; `None` is the language's.
    pub tool: Option<String>,
    /// Name or number of the work object, base or frame; `None` is the language's.
    pub work_object: Option<String>,
    /// Largest file, kB; `None` is the language's.
    pub kb_max: Option<u32>,
}

/// Tolerance where none is given: of the narrow bead.
const TOLERANCE_SHARE: f64 = 0.02;

impl ProgramOptions {
    /// What is written where nothing else is asked for.
    pub fn of_settings(language: Language, name: &str, settings: &Settings) -> ProgramOptions {
        let bead_mm = 2.0 * settings.aperture.minor_mm();
        ProgramOptions {
            language,
            name: name.to_string(),
            tolerance_mm: TOLERANCE_SHARE * bead_mm,
            reach_mm: settings.aperture.major_mm(),
            tool: None,
            work_object: None,
            kb_max: None,
        }
    }
}

/// A job to be written.
#[derive(Clone, Copy, Debug)]
pub struct ProgramJob<'a> {
    /// The motion, machine coordinates.
    pub stream: &'a SegmentStream,
    /// Its machine.
    pub machine: &'a MachineConfiguration,
    /// Tip acceleration of the plan, mm/s².
    pub tip_acceleration_mm_s2: f64,
    /// The pump that the program switches; `None` leaves it alone.
    pub pump: Option<&'a PumpOutput>,
}

/// A file of a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProgramFile {
    /// Name with its ending.
    pub name: String,
    /// Its text.
    pub text: String,
}

/// A program.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Program {
    /// Its files, the main one first.
    pub files: Vec<ProgramFile>,
    /// Points.
    pub points: usize,
    /// Most of them in half a second, a second.
    pub points_a_second: f64,
    /// Duration of the job, s.
    pub duration_s: f64,
    /// What its user has to know.
    pub notes: Vec<String>,
}

/// Points a second up to which controllers blend without stopping: interpolation cycles of 4 to 12 ms, several a block.
const POINTS_A_SECOND_TOLD: f64 = 40.0;
/// Accepted tolerances, mm.
const TOLERANCES_MM: [f64; 2] = [1e-3, 20.0];
/// Accepted sizes, kB.
const KB_LEAST: u32 = 16;

/// Writes a job as a program.
///
/// # Errors
/// [`Refusal`].
pub fn write_program(job: &ProgramJob, options: &ProgramOptions) -> Result<Program, Refusal> {
    let [least_mm, most_mm] = TOLERANCES_MM;
    if !(least_mm..=most_mm).contains(&options.tolerance_mm) {
        return Err(refusal!(
            "--tolerance {given}: give 0.001 to 20 mm",
            given = options.tolerance_mm
        ));
    }
    if options.kb_max.is_some_and(|kb| kb < KB_LEAST) {
        return Err(refusal!(
            "--max-kb {given}: give at least 16",
            given = options.kb_max.map_or(0.0, f64::from)
        ));
    }
    let tolerances = Tolerances::of(options);
    let mut changes = OutputChanges::default();
    let mut walk = Walk::of(job, &tolerances, &changes)?;
    if let Some(pump) = job.pump {
        let servo_hz = f64::from(job.stream.machine(job.machine).servo_hz);
        changes = OutputChanges::of(job.stream, servo_hz, pump, &walk.clock());
        walk = Walk::of(job, &tolerances, &changes)?;
    }
    let procedures = procedures(&walk);
    let mut program = match options.language {
        Language::Rapid => rapid::program(job, options, &walk, procedures)?,
        Language::Krl => krl::program(job, options, &walk, procedures)?,
        Language::UrScript => urscript::program(job, options, &walk, procedures)?,
        Language::Sinumerik => sinumerik::program(job, options, &walk, procedures)?,
    };
    program.points = walk.points();
    program.points_a_second = walk.points_a_second();
    program.duration_s = walk.duration_s;
    program.notes.extend(changes.notes);
    if job.pump.is_none() {
        program.notes.push(
            "the program sets no output: give the machine file a [pump], or start and stop it by hand"
                .to_string(),
        );
    }
    if program.points_a_second > POINTS_A_SECOND_TOLD {
        program.notes.push(format!(
            "up to {:.0} points a second: a controller that looks few blocks ahead slows down or stops there; allow more \
             with --tolerance, or plan with a lower --speed",
            program.points_a_second
        ));
    }
    Ok(program)
}

/// Groups procedures by files of at most the greatest size, and marks the last block before another file as a stop.
fn in_files(
    mut procedures: Vec<Procedure>,
    options: &ProgramOptions,
    text_of: impl Fn(&Procedure) -> String,
) -> (Vec<Vec<(Procedure, String)>>, usize) {
    let kb_max = options.kb_max.unwrap_or(options.language.kb_max()) as usize;
    // What a file has beside its procedures fits into the rest.
    let bytes_max = kb_max * 1000 * 19 / 20;
    let mut texts: Vec<String> = procedures.iter().map(&text_of).collect();
    let mut ends = Vec::new();
    let mut bytes = 0;
    for (number, text) in texts.iter().enumerate() {
        if bytes > 0 && bytes + text.len() > bytes_max {
            ends.push(number);
            bytes = 0;
        }
        bytes += text.len();
    }
    let mut stops = 0;
    for end in &ends {
        let before = &mut procedures[end - 1];
        stops += usize::from(before.stops_at_end());
        texts[end - 1] = text_of(before);
    }
    let mut files: Vec<Vec<(Procedure, String)>> = vec![Vec::new()];
    for (number, both) in procedures.into_iter().zip(texts).enumerate() {
        if ends.contains(&number) {
            files.push(Vec::new());
        }
        if let Some(last) = files.last_mut() {
            last.push(both);
        }
    }
    (files, stops)
}

/// An output that a controller counts.
struct OutputNumber {
    number: u32,
    is_digital: bool,
}

/// The pump's, where it is one of those that are known and its greatest value is within its range.
fn output_number(
    job: &ProgramJob,
    [analog, digital]: [RangeInclusive<u32>; 2],
    (value, value_max): (f64, f64),
    rule: &'static str,
) -> Result<Option<OutputNumber>, Refusal> {
    let Some(pump) = job.pump else {
        return Ok(None);
    };
    let is_digital = pump.kind == PumpKind::Digital;
    let known = if is_digital { digital } else { analog };
    let given = Some(pump.output.clone());
    let number = text::checked_number(&given, 0, "pump.output", known, rule)?;
    if value > value_max {
        return Err(refusal!(
            "pump.mm3_s_per_unit: the output's greatest value {value}: it is above the output's \
             range; set rate_max_mm3_s, or a pump with a larger scale"
        ));
    }
    Ok(Some(OutputNumber { number, is_digital }))
}

/// The arm of a machine that a language of arms is for.
fn arm_of(
    machine: &MachineConfiguration,
    language: Language,
) -> Result<&headway_firmware::configuration::Arm, Refusal> {
    match &machine.kinematics {
        Kinematics::Arm6 { arm, .. } => Ok(arm),
        _ => Err(refusal!(
            "{language} is for arms of six joints (kinematics = \"arm6\"); the job's machine is \
             another: plan it with a machine file of that kind",
            language = language.name()
        )),
    }
}

fn stops_note(stops: usize) -> Option<String> {
    (stops > 0).then(|| {
        format!(
            "the head rests at {stops} places within passes, where another file begins: give more with --max-kb if the \
             controller has the memory"
        )
    })
}

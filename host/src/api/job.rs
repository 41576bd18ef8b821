//! A planned job: its contents, and what can be made from it.
//!
//! In: what [`super::plan`] made, or the bytes of a job file. Out: poses, figures, tables, G-code, the file's
//! bytes, a simulated run, the page that draws it.

use super::joints::{JobJoint, JobJoints};
use super::{Error, JobPose};
use crate::drive::dry_run::dry_run;
use crate::drive::laid_beads::laid_beads;
use crate::drive::link::LinkSpec;
use crate::drive::simulator::SimulatorSetup;
use crate::gcode::write::dialect::Dialect;
use crate::gcode::write::limits::AxisLimits;
use crate::gcode::write::{JobText, WriteOptions, filament_mm2, is_tilting, write_gcode};
use crate::job::SegmentStream;
use crate::job::file::{self, JobFile};
use crate::joint_export::samples;
use crate::joint_export::tables::JointTable;
use crate::joint_export::trajectory::{TrajectoryFormat, joint_names_of, write_trajectory};
use crate::pipeline::findings::laid::laid_figures;
use crate::pipeline::findings::settled_verdict::settle;
use crate::pipeline::findings::simulated::{outcome, simulation_figures};
use crate::pipeline::page::page_of;
use crate::pipeline::pass_facts::PassFacts;
use crate::pipeline::planned::Planned;
use crate::programs::{Language, ProgramJob, ProgramOptions, write_program};
use crate::report::figures::Figures;
use crate::report::job_texts::{NAME_TEXT, SETTINGS_TEXT};
use crate::report::pose_table;
use crate::scan::layer::Layer;
use crate::scan::{self, Measured, Scale};
use crate::settings::extruder_model::ExtruderModel;
use crate::settings::{Settings, machine_file};
use crate::text::refusal::Refusal;
use std::io::{BufRead, Cursor, Write};

/// A planned job.
#[derive(Clone, Debug)]
pub struct Job {
    bytes: Vec<u8>,
    pub(super) file: JobFile,
    pub(super) stream: SegmentStream,
    settings: Settings,
    figures: Figures,
    notes: Vec<String>,
}

/// Result of a simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    figures: Figures,
    outcome: Result<(), String>,
}

impl Job {
    /// Reads a job file.
    ///
    /// # Errors
    /// [`Error::Job`] if any byte of it has changed, with the place.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Job, Error> {
        let job_error = |error: String| Error::Job(error);
        let file = file::read(&mut Cursor::new(bytes.as_slice()));
        let file = file.map_err(|error| job_error(error.to_string()))?;
        let stream = file
            .stream()
            .map_err(|error| job_error(error.to_string()))?;
        let header = &file.header;
        let text = header.texts.get(SETTINGS_TEXT);
        let settings = text.and_then(|text| machine_file::from_job_toml(text).ok());
        let settings = Settings {
            machine: header.machine.clone(),
            machine_name: header.machine_name.clone(),
            ..settings.unwrap_or_default()
        };
        let figures = serde_json::from_str(&header.figures_json).unwrap_or_default();
        Ok(Job {
            figures: with_verdict(figures, &file, &settings),
            notes: Vec::new(),
            bytes,
            stream,
            settings,
            file,
        })
    }

    /// A job just planned: read back, so that the caller gets exactly the file's contents.
    pub(super) fn planned(
        bytes: Vec<u8>,
        figures: Figures,
        notes: Vec<String>,
    ) -> Result<Job, Error> {
        let job = Job::from_bytes(bytes)?;
        Ok(Job {
            figures: with_verdict(figures, &job.file, &job.settings),
            notes,
            ..job
        })
    }

    /// Name of the part.
    pub fn name(&self) -> &str {
        let name = self.file.header.texts.get(NAME_TEXT);
        name.map_or("part", String::as_str)
    }

    /// Notes for the user, one line each; none for a job from a file.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The job file, byte for byte as the command writes it.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The figures as one JSON object, with the keys of `headway plan --json`.
    pub fn figures_json(&self) -> String {
        self.figures.to_json()
    }

    /// A figure by its key, where it is a number.
    pub fn figure(&self, key: &str) -> Option<f64> {
        number(&self.figures, key)
    }

    /// Its duration.
    pub fn duration_s(&self) -> f64 {
        pose_table::duration_ticks(&self.stream) as f64 / self.servo_hz()
    }

    /// Its poses at even steps of time, from its start to its end.
    ///
    /// # Errors
    /// [`Error::Job`] if the step is invalid, or gives more than 40 million poses.
    pub fn poses(&self, every_s: f64) -> Result<impl Iterator<Item = JobPose> + '_, Error> {
        let servo_hz = self.servo_hz();
        let every_ticks = self.checked_step_s(every_s)? * servo_hz;
        let (transform, aperture) = (&self.file.header.transform, &self.settings.aperture);
        let samples = pose_table::samples(&self.stream, servo_hz, every_ticks);
        Ok(samples.map(move |sample| JobPose::of(&sample, transform, aperture)))
    }

    /// Writes its poses as CSV, with the columns of `headway export --to csv`.
    ///
    /// # Errors
    /// As for [`Job::poses`], and if it cannot be written.
    pub fn write_csv(&self, mut out: impl Write, every_s: f64) -> Result<(), Error> {
        let every_ms = 1e3 * self.checked_step_s(every_s)?;
        let transform = &self.file.header.transform;
        let servo_hz = self.servo_hz();
        pose_table::write_csv(&mut out, &self.stream, servo_hz, every_ms, transform)
            .map_err(|error| Error::Job(format!("the table cannot be written: {error}")))
    }

    /// Its joints in order, as the machine file names them.
    pub fn joints(&self) -> Vec<JobJoint> {
        let machine = &self.file.header.machine;
        let joints = samples::names(machine).into_iter().zip(&machine.joints);
        joints
            .map(|(name, joint)| JobJoint::of(&name, joint))
            .collect()
    }

    /// The joints at even steps of time and at its end: positions, rates, accelerations, motor steps.
    ///
    /// # Errors
    /// As for [`Job::poses`]; an item is an error if the machine has no joints for a pose.
    pub fn joint_poses(
        &self,
        every_s: f64,
    ) -> Result<impl Iterator<Item = Result<JobJoints, Error>> + '_, Error> {
        let every_ticks = self.checked_step_s(every_s)? * self.servo_hz();
        let machine = &self.file.header.machine;
        let samples = samples::joint_samples(&self.stream, machine, every_ticks);
        let joints = machine.joints.len();
        Ok(samples.map(move |sample| match sample {
            Ok(sample) => Ok(JobJoints::of(&sample, joints)),
            Err(error) => Err(Error::Job(error.to_string())),
        }))
    }

    /// Writes its joints as CSV, with the columns of `headway export --to csv --joints`.
    ///
    /// # Errors
    /// As for [`Job::joint_poses`], and if it cannot be written.
    pub fn write_joints_csv(&self, mut out: impl Write, every_s: f64) -> Result<(), Error> {
        let table = self.joint_table(every_s)?;
        let written = table.write_csv(&mut out);
        written.map_err(|error| Error::Job(format!("the table cannot be written: {error}")))
    }

    /// Writes its joints as a `JointTrajectory` message of ROS 2, rad and m, as YAML or as JSON, with these
    /// names of the joints in the machine's order, or the machine file's.
    ///
    /// # Errors
    /// As for [`Job::joint_poses`], and if there are too few or too many names, or invalid ones.
    pub fn write_trajectory(
        &self,
        mut out: impl Write,
        every_s: f64,
        joint_names: Option<&[String]>,
        is_yaml: bool,
    ) -> Result<(), Error> {
        let table = self.joint_table(every_s)?;
        let names = joint_names_of(&table, joint_names);
        let names = names.map_err(|error| Error::Job(error.to_string()))?;
        let format = match is_yaml {
            true => TrajectoryFormat::Yaml,
            false => TrajectoryFormat::Json,
        };
        let written = write_trajectory(&mut out, &table, &names, format);
        written.map_err(|error| Error::Job(format!("the trajectory cannot be written: {error}")))
    }

    fn joint_table(&self, every_s: f64) -> Result<JointTable<'_>, Error> {
        let header = &self.file.header;
        Ok(JointTable {
            name: self.name(),
            machine_name: &header.machine_name,
            stream: &self.stream,
            machine: &header.machine,
            offset_mm: header.transform.offset_mm,
            every_ms: 1e3 * self.checked_step_s(every_s)?,
        })
    }

    /// It as a program of `rapid`, `krl`, `urscript` or `sinumerik`: names and texts of its files, the main one first, with the
    /// defaults of `headway export`. The program's name has letters, digits and underscores, at most 16.
    ///
    /// # Errors
    /// [`Error::Job`] for another language or name, or if the machine is none of its kind.
    pub fn program(&self, language: &str, name: &str) -> Result<Vec<(String, String)>, Error> {
        let known = Language::ALL.into_iter().find(|of| of.option() == language);
        let language = known.ok_or_else(|| {
            let names = Language::ALL.map(Language::option).join(", ");
            let language: String = language.chars().take(40).collect();
            Error::Job(format!(
                "{language} is no known language: give one of {names}"
            ))
        })?;
        let job = ProgramJob {
            stream: &self.stream,
            machine: &self.file.header.machine,
            tip_acceleration_mm_s2: self.settings.tip_acceleration_mm_s2,
            pump: self.settings.pump.as_ref(),
        };
        let options = ProgramOptions::of_settings(language, name, &self.settings);
        let program =
            write_program(&job, &options).map_err(|error| Error::Job(error.to_string()))?;
        let files = program.files.into_iter().map(|file| (file.name, file.text));
        Ok(files.collect())
    }

    /// Writes it as G-code for `klipper`, `reprapfirmware`, `linuxcnc`, `grblhal` or `marlin`, with the
    /// defaults of `headway export --to gcode`.
    ///
    /// # Errors
    /// [`Error::Job`] for another dialect, or if it cannot be written.
    pub fn write_gcode(&self, out: impl Write, dialect: &str) -> Result<(), Error> {
        let known = Dialect::ALL.into_iter().find(|of| of.name() == dialect);
        let dialect = known.ok_or_else(|| {
            let names = Dialect::ALL.map(Dialect::name).join(", ");
            let dialect: String = dialect.chars().take(40).collect();
            Error::Job(format!(
                "{dialect} is no known dialect: give one of {names}"
            ))
        })?;
        let text = JobText {
            name: self.name(),
            machine: &self.file.header.machine_name,
            stream: &self.stream,
            servo_hz: self.servo_hz(),
            heat: &self.file.header.heat(),
        };
        let mut options = WriteOptions::of_dialect(dialect).with_settings(&self.settings);
        let filament_mm2 = filament_mm2(options.filament_mm);
        options.limits = AxisLimits::of_machine(&self.settings.machine, filament_mm2);
        let kinds = PassFacts::of_job(&self.file.header);
        options.types = kinds.slicer_words(&self.stream.marks);
        match self.settings.gcode_letters {
            Some(letters) => options.turns = letters,
            None if is_tilting(&self.stream) => {
                return Err(Error::Job(
                    "the head tilts: name the axes of a controller that knows its tip in the machine file, \
                     [gcode] letters = \"A,B,C\""
                        .to_string(),
                ));
            }
            None => {}
        }
        let written = write_gcode(out, &text, &options);
        written
            .map(|_| ())
            .map_err(|error| Error::Job(error.to_string()))
    }

    /// The page of `headway view` as one HTML text that asks for nothing else: it draws, plays and plots the job. As
    /// from its file: what only planning knows (ground left out, places out of reach) is not on it.
    pub fn page(&self) -> String {
        let name = self.name().to_string();
        let of_file = Planned::of_job(&self.file.header, self.stream.clone(), name);
        page_of(Planned {
            figures: self.figures.clone(),
            notes: self.notes.clone(),
            ..of_file
        })
    }

    /// Streams it over a simulated line to the firmware library and compares every step with the plan.
    /// `link` are the line's faults as in `headway simulate --link` (none: an empty text), `seed` fixes
    /// every random choice.
    ///
    /// # Errors
    /// [`Error::Job`] if the link's text is invalid; a fault during the simulation is in the
    /// result.
    pub fn simulate(&self, link: &str, seed: u64) -> Result<Simulation, Error> {
        self.run(link, seed, None)
    }

    /// As [`Job::simulate`], with what a material lays of it: the text of a file of `headway simulate --material`.
    ///
    /// # Errors
    /// As for [`Job::simulate`], and for an invalid text.
    pub fn simulate_material(
        &self,
        link: &str,
        seed: u64,
        material: &str,
    ) -> Result<Simulation, Error> {
        let model = ExtruderModel::from_toml(material);
        let model = model.map_err(|error| Error::Job(format!("the material: {error}")))?;
        self.run(link, seed, Some(&model))
    }

    fn run(
        &self,
        link: &str,
        seed: u64,
        model: Option<&ExtruderModel>,
    ) -> Result<Simulation, Error> {
        let job_error = |error: String| Error::Job(error);
        let link = match link {
            "" => LinkSpec::default(),
            text => text
                .parse()
                .map_err(|error: crate::text::refusal::Refusal| job_error(error.to_string()))?,
        };
        let setup = SimulatorSetup {
            link,
            seed,
            commands: Vec::new(),
        };
        let run = dry_run(&self.stream, &self.settings, &setup, |_| {});
        let run = run.map_err(|error| job_error(error.to_string()))?;
        let transform = &self.file.header.transform;
        let figures = simulation_figures(&run, &self.stream, transform, &self.settings);
        let mut figures = self.figures.clone().merged_with(&figures);
        if let Some(model) = model {
            let motion = &run.simulation.motion;
            let beads = laid_beads(&self.stream, &self.settings, motion, model, transform);
            figures = figures.merged_with(&laid_figures(&beads));
        }
        Ok(Simulation {
            figures: with_verdict(figures, &self.file, &self.settings),
            outcome: outcome(&run),
        })
    }

    /// What a scan of a layer (counted from 0; none: the last) tells of the machine: CSV, XYZ, PLY or a height map.
    ///
    /// # Errors
    /// [`Error::Job`] that says what the scan or the layer lacks.
    pub fn measure(
        &self,
        scan: impl BufRead,
        scale: &Scale,
        layer: Option<u32>,
    ) -> Result<Measured, Error> {
        let job_error = |error: Refusal| Error::Job(error.to_string());
        let (aperture, transform) = (&self.settings.aperture, &self.file.header.transform);
        let layer = layer.unwrap_or(self.stream.layers().saturating_sub(1));
        let layer = Layer::of(&self.stream, self.servo_hz(), transform, aperture, layer);
        let layer = layer.map_err(job_error)?;
        scan::read(scan, scale, &layer, &self.settings).map_err(job_error)
    }

    pub(super) fn servo_hz(&self) -> f64 {
        f64::from(self.file.header.machine.servo_hz)
    }

    fn checked_step_s(&self, every_s: f64) -> Result<f64, Error> {
        let problem = match every_s > 0.0 && every_s.is_finite() {
            false => "give a time greater than 0".to_string(),
            true if self.duration_s() / every_s > pose_table::ROWS_MAX => format!(
                "{:.1} s of motion make more than {:.0} rows; give a longer time",
                self.duration_s(),
                pose_table::ROWS_MAX
            ),
            true => return Ok(every_s),
        };
        Err(Error::Job(format!("a step of {every_s} s: {problem}")))
    }
}

impl Simulation {
    /// The figures of plan and run as one JSON object, with the keys of `headway simulate --json`.
    pub fn figures_json(&self) -> String {
        self.figures.to_json()
    }

    /// A figure by its key, where it is a number.
    pub fn figure(&self, key: &str) -> Option<f64> {
        number(&self.figures, key)
    }

    /// Whether the steps reached the plan's end without a fault; otherwise the reason.
    ///
    /// # Errors
    /// [`Error::Job`].
    pub fn check(&self) -> Result<(), Error> {
        self.outcome.clone().map_err(Error::Job)
    }
}

/// The figures with the verdict that they make, as the command's have it.
fn with_verdict(figures: Figures, file: &JobFile, settings: &Settings) -> Figures {
    let mut planned = Planned {
        figures,
        settings: settings.clone(),
        heat: file.header.heat(),
        ..Planned::default()
    };
    settle(&mut planned);
    planned.figures
}

fn number(figures: &Figures, key: &str) -> Option<f64> {
    let value: serde_json::Value = serde_json::from_str(&figures.to_json()).ok()?;
    value.get(key)?.as_f64()
}

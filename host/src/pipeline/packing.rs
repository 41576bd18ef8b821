//! Packs a job for its file: checks its parts in order, against the limits and with the board's own checks, and
//! measures their time.
//!
//! In: parts of a stream, from any kind of input, and a file for their frames. Out: the job's frames,
//! figures of the finished motion, the job's header. Not covered: the destination of the job.

use crate::drive::device_check::{DeviceCheck, Refused};
use crate::drive::time_by_limit::{TimeByLimit, TimeTally};
use crate::job::SegmentStream;
use crate::job::StreamFacts;
use crate::job::file::JobHeader;
use crate::job::heat::{self, HEAT_TEXT, job_events};
use crate::job::spool::{JobSpool, SpoolError, SpooledJob};
use crate::pipeline::findings::objections::Objection;
use crate::pipeline::findings::settings_warnings::fast_melt;
use crate::pipeline::findings::time_figures;
use crate::pipeline::planned::Planned;
use crate::report::figures::Figures;
use crate::report::job_texts::{
    LATER_KINDS_TEXT, LAYER_OUTLINES_TEXT, NAME_TEXT, OUTLINE_TEXT, PASS_KINDS_TEXT, SETTINGS_TEXT,
    outline_to_json,
};
use crate::settings::{Settings, machine_file};
use std::io::{Read, Seek, Write};

/// The job so far.
pub struct JobPacking<F: Write> {
    spool: JobSpool<F>,
    is_empty: bool,
    times: TimeTally,
    device: DeviceCheck,
}

/// A complete job.
pub struct PackedJob<F> {
    /// Its frames.
    pub frames: SpooledJob<F>,
    /// Its use of the limits, and shares of its time.
    pub times: TimeByLimit,
    /// Where a board would stop it: such a job is not to be written.
    pub refused: Option<Refused>,
}

impl<F: Read + Write + Seek> JobPacking<F> {
    /// An empty job; its frames go to `file`.
    pub fn new(file: F) -> JobPacking<F> {
        JobPacking {
            spool: JobSpool::new(file),
            is_empty: true,
            times: TimeTally::default(),
            device: DeviceCheck::default(),
        }
    }

    /// Adds the next part, with its passes counted from `first_pass` on.
    ///
    /// # Errors
    /// [`SpoolError`].
    pub fn take(
        &mut self,
        piece: &SegmentStream,
        first_pass: u32,
        settings: &Settings,
    ) -> Result<(), SpoolError> {
        self.is_empty = false;
        let settings = Settings {
            machine: piece.machine(&settings.machine),
            ..settings.clone()
        };
        let (times, device) = (&mut self.times, &mut self.device);
        let added = self.spool.add(piece, first_pass);
        rayon::join(
            || times.add(piece, &settings),
            || device.add(piece, &settings.machine),
        );
        added
    }

    /// All of it.
    ///
    /// # Errors
    /// [`SpoolError`].
    pub fn finish(self, settings: &Settings) -> Result<PackedJob<F>, SpoolError> {
        Ok(PackedJob {
            frames: self.spool.finish()?,
            times: self.times.finish(settings),
            refused: self.device.finish(),
        })
    }

    /// All of a plan, whose own stream is added if none was, and which gets the figures and objections of its finished motion.
    ///
    /// # Errors
    /// [`SpoolError`].
    pub fn finish_plan(mut self, planned: &mut Planned) -> Result<PackedJob<F>, SpoolError> {
        if self.is_empty {
            self.take(&planned.stream, 0, &planned.settings)?;
        }
        let packed = self.finish(&planned.settings)?;
        let of_plan = std::mem::take(&mut planned.figures);
        let bytes = packed.frames.line_bytes;
        let print_s = of_plan.print_s.unwrap_or_default();
        planned.figures = of_plan.merged_with(&Figures {
            bytes: Some(bytes),
            bytes_per_s: Some(bytes as f64 / print_s.max(1e-9)),
            ..time_figures(packed.times.clone(), &planned.transform)
        });
        let fast = fast_melt(packed.times.flow_max_mm3_s, &planned.settings);
        planned.objections.splice(0..0, fast);
        if let Some(refused) = &packed.refused {
            let fault = Objection::of_board(refused, &planned.transform, &planned.settings);
            planned.objections.insert(0, fault);
        }
        planned.note_objections();
        Ok(packed)
    }
}

/// The header of a plan's job.
pub fn job_header(job: &Planned, stream: StreamFacts) -> JobHeader {
    let settings = &job.settings;
    let heat = job_events(&job.heat, settings.material.as_ref(), &stream.marks);
    let mut header = JobHeader::of_facts(
        stream,
        &settings.machine_name,
        &settings.machine,
        job.transform,
    );
    // How long planning took is no property of the job: the same job is the same file.
    let figures = Figures {
        plan_s: None,
        ..job.figures.clone()
    };
    header.figures_json = figures.to_json();
    let texts = [
        (NAME_TEXT, job.name.clone()),
        (OUTLINE_TEXT, outline_to_json(&job.outline)),
        (SETTINGS_TEXT, machine_file::to_toml(settings)),
    ];
    let texts = texts.map(|(key, text)| (key.to_string(), text));
    header.texts.extend(texts);
    if !job.layer_outlines.is_empty() {
        let text = job.layer_outlines.to_json();
        header.texts.insert(LAYER_OUTLINES_TEXT.to_string(), text);
    }
    if let Some(text) = job.pass_facts.text() {
        header.texts.insert(PASS_KINDS_TEXT.to_string(), text);
    }
    if let Some(text) = job.pass_facts.later_text() {
        header.texts.insert(LATER_KINDS_TEXT.to_string(), text);
    }
    if !heat.is_empty() {
        let text = heat::to_json(&heat);
        header.texts.insert(HEAT_TEXT.to_string(), text);
    }
    header
}

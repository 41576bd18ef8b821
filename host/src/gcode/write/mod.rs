//! G-code out: a finished stream -> moves for another controller.
//!
//! ```text
//! SegmentStream --ticks--> poses of a move --lines, arcs--> moves --dialect--> text
//! (servo ticks)            (mm, rad, mm³)                   (mm, deg, mm of filament, mm/min)
//! ```
//! In: a job's stream in machine coordinates, options. Out: text of the [`Dialect`], and [`Written`]: how many
//! moves it has, and how many a second at most. Orders of heaters and fans stand where the job has them, a move
//! ending there; behind the last all heaters are off. X Y Z are the tip; a tilt is A B with the head at R_x(A) R_y(B)
//! R_z(C), C the heading, degrees.
//! Time is the stream's: each move lasts as long as its ticks. Leaves out pressure advance (the controller's
//! own), and axes of machines that do not know the tip.

pub mod arc_moves;
pub mod controller_time;
pub mod demands;
pub mod dialect;
pub mod ends;
pub mod file_time;
mod heat;
pub mod limits;
pub mod lines;
mod moves;
pub(crate) mod poses;
mod pushes;
pub mod read_back;
pub mod template;

use crate::job::heat::{HeatEvent, ended};
use crate::job::{MotionState, SegmentStream};
use crate::settings::Settings;
use controller_time::{ControllerTime, SlowedBy};
use demands::Demands;
use dialect::{ArcsWritten, Dialect, Retraction};
use headway_firmware::configuration::flow_curves::Curve;
use headway_firmware::kinematics::pose::Pose;
use headway_protocol::segment::FlowAction;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNELS};
use limits::AxisLimits;
use poses::{Poses, event_ticks};
use std::collections::VecDeque;
use std::f64::consts::PI;
use std::io::Write;
use template::FieldError;

/// Tip tolerance where none is given, mm: with what decimals take, well below a step.
pub const TIP_TOLERANCE_MM: f64 = 0.002;
/// Volume of a bead of 0.1 mm² over 20 µm, mm³.
const VOLUME_TOLERANCE_MM3: f64 = 0.002;
/// Narrowest bead up to which these hold, mm: of a wider one a move may be off by the same share.
const FINE_BEAD_MM: f64 = 0.4;
/// Tips that stay within this do not move, mm; headings, degrees.
const STILL_MM: f64 = 5e-5;
const STILL_DEG: f64 = 5e-4;

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JobText<'a> {
    /// The job's name.
    pub name: &'a str,
    /// The machine it was planned for.
    pub machine: &'a str,
    /// Its motion.
    pub stream: &'a SegmentStream,
    /// Servo ticks a second.
    pub servo_hz: f64,
    /// What it orders of heaters and fans, by tick.
    pub heat: &'a [HeatEvent],
}

/// How.
#[derive(Clone, Debug, PartialEq)]
pub struct WriteOptions {
    /// For which controller.
    pub dialect: Dialect,
    /// Primes and retracts; `None` is the extruder's axis: what a controller retracts by of its own is set by the file
    /// and stays set behind it.
    pub retraction: Option<Retraction>,
    /// Diameter of the filament, mm.
    pub filament_mm: f64,
    /// Letters of tilt about X, about Y, heading.
    pub turns: [u8; 3],
    /// Letter of the extruder; `None` is the dialect's.
    pub extruder: Option<u8>,
    /// Headings within one turn.
    pub wrapped: bool,
    /// How far the tip may be beside the stream's, mm.
    pub tip_mm: f64,
    /// How far the extruded volume may be off the stream's within a move, mm³.
    pub volume_mm3: f64,
    /// What the controller's axes do.
    pub limits: AxisLimits,
    /// Arcs (G2, G3) where they are fewer than straight moves; `None` is the dialect's.
    pub arcs: Option<bool>,
    /// Start and end block; `None` are the dialect's.
    pub blocks: [Option<String>; 2],
    /// Heaters stay on at the end.
    pub leave_hot: bool,
    /// How high the tip may be, mm, where it is known.
    pub height_mm: Option<f64>,
    /// Density of the material, g/cm³, where it is known.
    pub density_g_cm3: Option<f64>,
    /// What to ask the extruder for so that a flow arrives, mm³/s.
    pub asked: Curve,
    /// Further lines, by servo ticks: each stands before the first move that begins then or later.
    pub lines: Vec<(u64, String)>,
    /// Kinds of the beads in a slicer's words, each from a servo tick on.
    pub types: Vec<(u64, &'static str)>,
}

impl WriteOptions {
    /// What a dialect writes where nothing else is asked for.
    pub fn of_dialect(dialect: Dialect) -> WriteOptions {
        WriteOptions {
            dialect,
            retraction: None,
            filament_mm: 1.75,
            turns: *b"ABC",
            extruder: None,
            wrapped: false,
            tip_mm: dialect.tolerances()[0],
            volume_mm3: VOLUME_TOLERANCE_MM3,
            limits: AxisLimits::BUILT_IN,
            arcs: None,
            blocks: [None, None],
            leave_hot: false,
            height_mm: None,
            density_g_cm3: None,
            asked: Curve::default(),
            lines: Vec::new(),
            types: Vec::new(),
        }
    }

    /// With what a job's settings say of its machine and material, and tolerances that go with a coarse nozzle.
    pub fn with_settings(self, settings: &Settings) -> WriteOptions {
        let coarser = (2.0 * settings.aperture.minor_mm() / FINE_BEAD_MM).max(1.0);
        WriteOptions {
            tip_mm: self.tip_mm * coarser,
            volume_mm3: self.volume_mm3 * coarser.powi(3),
            height_mm: Some(settings.work_area_mm[1][2]),
            density_g_cm3: settings.material.and_then(|of| of.density_g_cm3),
            asked: settings.machine.curves.asked(),
            ..self
        }
    }
}

/// What was written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Written {
    /// Moves.
    pub moves: usize,
    /// Arcs among them.
    pub arcs: usize,
    /// Most of them in half a second, a second.
    pub moves_a_second: f64,
    /// Duration of the stream, s.
    pub duration_s: f64,
    /// What moves extrude, mm³.
    pub volume_mm3: f64,
    /// Time that the controller's own planner takes for them, s: see [`controller_time`].
    pub controller_time_s: f64,
    /// What slows the most of its moves down.
    pub slowed_by: Option<SlowedBy>,
    /// What they ask of its checks.
    pub demands: Demands,
}

/// Why nothing is written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The blocks.
    #[error(transparent)]
    Field(#[from] FieldError),
    /// The extruder and a tilt.
    #[error("{letter} is the extruder and turns the head too: give the extruder another letter")]
    Letter {
        /// The letter of both.
        letter: char,
    },
    /// A start block behind which the controller would not do what the job does.
    #[error(
        "line {line} of the start block, `{text}`: {problem}; take it back before the block ends, or leave it out"
    )]
    Block {
        /// Line of the block, from 1.
        line: usize,
        /// That line.
        text: String,
        /// What comes of it.
        problem: String,
    },
    /// Arcs that the controller would not run as the job does.
    #[error("{dialect} has no arcs that are written: {reason}")]
    Arcs {
        /// Its name.
        dialect: &'static str,
        /// Why, and what to do.
        reason: &'static str,
    },
    /// The place to write to.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// The numbers of the last move, as they were written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct At {
    tip_mm: [f64; 3],
    turn_deg: [f64; 3],
}

struct Writer<'a, W> {
    out: W,
    options: &'a WriteOptions,
    servo_hz: f64,
    at: At,
    /// Highest place of the tip so far, mm.
    top_mm: f64,
    /// Turns before they are wrapped.
    turn_deg: [f64; 3],
    tilts: bool,
    /// The heading's acceleration is kept by the speeds of the file, not by the controller.
    follows: bool,
    arcs: ArcsWritten,
    /// Extruded so far, 10⁻⁵ mm of filament.
    e_units: i64,
    e_mm: f64,
    feed: String,
    retracted_mm: Option<f64>,
    /// Length and speed that the controller retracts by.
    retraction: String,
    recent: VecDeque<f64>,
    /// Progress as it was told last.
    told_pct: Option<u64>,
    time: ControllerTime,
    written: Written,
    /// Types that are written.
    typed: usize,
}

/// The arcs that are written.
fn arcs_written(options: &WriteOptions) -> Result<ArcsWritten, WriteError> {
    let has = options.dialect.arcs();
    let refused = |reason| WriteError::Arcs {
        dialect: options.dialect.name(),
        reason,
    };
    // I and J are an arc's centre.
    let is_free = !options.turns.contains(&b'J') && options.extruder != Some(b'J');
    match options.arcs {
        Some(false) => Ok(ArcsWritten::None),
        None if options.dialect.writes_arcs_by_default() && is_free => Ok(has),
        None => Ok(ArcsWritten::None),
        Some(true) if !is_free => Err(refused("J is an axis here: give it another letter")),
        Some(true) if has == ArcsWritten::None => Err(refused(
            "it takes the inverse time of an arc as a speed in mm/min; leave --arcs out",
        )),
        Some(true) => Ok(has),
    }
}

/// True where the tool axis leaves the vertical.
pub fn is_tilting(stream: &SegmentStream) -> bool {
    let tilts =
        |control: &[i32; CHANNELS]| control[CHANNEL_TILT_X] != 0 || control[CHANNEL_TILT_Y] != 0;
    tilts(&stream.start) || stream.knots.iter().any(|knot| tilts(&knot.control))
}

/// Writes a job.
///
/// # Errors
/// [`WriteError`].
pub fn write_gcode(
    out: impl Write,
    job: &JobText,
    options: &WriteOptions,
) -> Result<Written, WriteError> {
    let stream = job.stream;
    let ticks = stream.marks.last().map_or(0, |mark| mark.end_tick);
    let mut poses = Poses::new(stream);
    let first = poses.at(0);
    let tilts = is_tilting(stream);
    let follows = !tilts && options.dialect.heading_follows();
    let planned = match follows {
        true => options.limits.followed(),
        false => options.limits,
    };
    let mut writer = Writer {
        out,
        options,
        servo_hz: job.servo_hz,
        at: At::default(),
        top_mm: f64::NEG_INFINITY,
        turn_deg: [0.0; 3],
        tilts,
        follows,
        arcs: arcs_written(options)?,
        e_units: 0,
        e_mm: 0.0,
        feed: String::new(),
        retracted_mm: None,
        retraction: String::new(),
        recent: VecDeque::new(),
        told_pct: None,
        time: ControllerTime::new(options.dialect, planned),
        written: Written {
            duration_s: ticks as f64 / job.servo_hz,
            ..Written::default()
        },
        typed: 0,
    };
    if tilts && options.turns.contains(&writer.extruder()) {
        let letter = char::from(writer.extruder());
        return Err(WriteError::Letter { letter });
    }
    let heat = ended(job.heat, ticks, options.leave_hot);
    let job = &JobText {
        heat: &heat,
        ..*job
    };
    writer.begin(job, &first)?;
    writer.marks(job, &mut poses)?;
    writer.end(job, &first)
}

/// Cross-section of a filament of this diameter, mm².
pub fn filament_mm2(filament_mm: f64) -> f64 {
    0.25 * PI * filament_mm * filament_mm
}

impl<W: Write> Writer<'_, W> {
    /// The job's moves, events and orders, mark by mark.
    fn marks(&mut self, job: &JobText, poses: &mut Poses) -> Result<(), WriteError> {
        let events = event_ticks(job.stream);
        let is_prime = |event: &&(u64, FlowAction, f64, f64)| event.1 == FlowAction::Prime;
        let mut primes_left = events.iter().filter(is_prime).count();
        let mut layer = None;
        let first_orders = job.heat.iter().take_while(|event| event.tick == 0);
        let mut heat = &job.heat[first_orders.count()..];
        let mut lines = self.options.lines.iter().peekable();
        for mark in &job.stream.marks {
            self.orders_until(&mut heat, mark.start_tick, false)?;
            while let Some((_, line)) = lines.next_if(|(tick, _)| *tick <= mark.start_tick) {
                writeln!(self.out, "{line}")?;
            }
            if mark.state == MotionState::Print && layer != Some(mark.layer) {
                layer = Some(mark.layer);
                let z_mm = poses.at(mark.start_tick)[2];
                let number = mark.layer;
                writeln!(self.out, ";LAYER_CHANGE\n;Z:{z_mm:.4}\n;LAYER:{number}")?;
            }
            let within = |tick: u64| (mark.start_tick..mark.end_tick).contains(&tick);
            let of_mark = events.iter().filter(|(tick, ..)| within(*tick));
            for (_, action, volume_mm3, duration_s) in of_mark.clone() {
                if *action == FlowAction::Prime {
                    self.prime(*volume_mm3, *duration_s)?;
                    primes_left -= 1;
                }
            }
            let ticks = [mark.start_tick, mark.end_tick];
            self.move_with_orders(ticks, &mut heat, poses)?;
            for (_, action, volume_mm3, duration_s) in of_mark {
                if *action == FlowAction::Retract {
                    self.retract(*volume_mm3, *duration_s, primes_left > 0)?;
                }
            }
        }
        for (_, line) in lines {
            writeln!(self.out, "{line}")?;
        }
        self.orders_until(&mut heat, u64::MAX, true)
    }

    fn filament_mm2(&self) -> f64 {
        filament_mm2(self.options.filament_mm)
    }

    fn extruder(&self) -> u8 {
        let of_dialect = self.options.dialect.extruder();
        self.options.extruder.unwrap_or(of_dialect)
    }

    fn style(&self) -> Retraction {
        self.options.retraction.unwrap_or(Retraction::Extruder)
    }

    /// The place of a pose, turns unwound.
    fn place(&mut self, pose: &[f64; CHANNELS]) -> At {
        let mut turn_deg = [0.0, 0.0, pose[CHANNEL_HEADING].to_degrees()];
        if self.tilts {
            let axis = Pose::from_channels(pose).tool_axis();
            let b = axis.x.clamp(-1.0, 1.0).asin().to_degrees();
            let a = f64::atan2(-axis.y, axis.z).to_degrees();
            // What R_x(A) R_y(B) turns about the axis beside the smallest turn to it.
            let tilted = crate::gcode::Place {
                tip_mm: [0.0; 3],
                turn_deg: [a, b, 0.0],
            };
            let twist_deg = tilted.axis_and_heading().1.to_degrees();
            turn_deg = [a, b, turn_deg[2] - twist_deg];
        }
        for (turn, before) in turn_deg.iter_mut().zip(self.turn_deg) {
            // The heading is unwound by itself; its twist is not.
            if self.tilts {
                *turn += 360.0 * ((before - *turn) / 360.0).round();
            }
        }
        self.turn_deg = turn_deg;
        if self.options.wrapped {
            turn_deg[2] = turn_deg[2].rem_euclid(360.0);
        }
        At {
            tip_mm: [pose[0], pose[1], pose[2]].map(|mm| (mm * 1e4).round() / 1e4),
            turn_deg: turn_deg.map(|deg| (deg * 1e3).round() / 1e3),
        }
    }

    /// The words that change, and those of the first `told` axes.
    fn words(&self, to: &At, told: usize) -> String {
        let mut words = String::new();
        for (axis, letter) in ["X", "Y", "Z"].into_iter().enumerate() {
            let moves = (to.tip_mm[axis] - self.at.tip_mm[axis]).abs() > STILL_MM;
            if axis < told || moves {
                words.push_str(&format!(" {letter}{}", short(to.tip_mm[axis], 4)));
            }
        }
        for (axis, letter) in self.options.turns.into_iter().enumerate() {
            let is_used = axis == 2 || self.tilts;
            let turns = (to.turn_deg[axis] - self.at.turn_deg[axis]).abs() > STILL_DEG;
            if is_used && (axis + 3 < told || turns) {
                words.push_str(&format!(
                    " {}{}",
                    char::from(letter),
                    short(to.turn_deg[axis], 3)
                ));
            }
        }
        words
    }

    /// Filament up to `e_mm` as a word; empty where nothing comes.
    fn extrusion(&mut self, e_mm: f64) -> String {
        let units = (e_mm * 1e5).round() as i64;
        let (before, extruder) = (self.e_units, char::from(self.extruder()));
        self.e_mm = e_mm;
        if units == before {
            return String::new();
        }
        self.e_units = units;
        self.written.demands.extruder_at(units as f64 * 1e-5);
        let number = match self.options.dialect.is_machine_tool() {
            true => units,
            false => units - before,
        };
        format!(" {extruder}{}", short(number as f64 * 1e-5, 5))
    }
}

/// A number without needless digits.
pub(crate) fn short(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let text = match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.'),
        false => &text,
    };
    match text {
        "-0" => "0".to_string(),
        text => text.to_string(),
    }
}

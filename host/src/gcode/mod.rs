//! G-code in: what a slicer or a post-processor wrote -> passes with widths, speeds and volumes. G-code
//! out: [`mod@write`].
//!
//! ```text
//! bytes --words--> Line --interpreter--> Steps --passes--> GcodeProgram
//!                 (letters, numbers)    (mm, deg, mm/s)    (mm, mm³)
//! ```
//! In: text of PrusaSlicer, OrcaSlicer, Cura, or plain G-code. Out: [`GcodeProgram`], its places in the
//! file's own coordinates, and notes on what it says and Headway does not do. Leaves out how the
//! nozzle is turned and how the head moves: that is planning's.

pub mod around;
pub mod axes;
pub mod comments;
pub mod curve_chords;
pub mod error;
pub mod extrusion;
pub mod flavour;
pub mod interpreter;
pub mod passes;
pub mod words;
pub mod write;

use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;

use crate::job::heat::HeatOrder;
use axes::FileAxes;
use comments::{OWN_HEADER, Slicer};
use extrusion::Taken;
use headway_firmware::kinematics::pose::{TILT_MAX_RAD, TILT_ROUNDING_RAD};
use interpreter::Steps;
use nalgebra::{Rotation3, Unit, Vector3};
use std::sync::Arc;

/// Largest file, bytes.
pub const GCODE_BYTES_MAX: u64 = 256 * 1024 * 1024;
/// Longest line without its comment and without a text, as names of objects and their outlines are.
pub const LINE_CHARS_MAX: usize = 1000;
/// Most straight moves of a file, curves in chords.
pub const MOVES_MAX: usize = 2_000_000;
/// Farthest place, mm.
pub const PLACE_MAX_MM: f64 = 100_000.0;
/// Farthest turn of a rotary axis, degrees: a thousand turns.
pub const ANGLE_MAX_DEG: f64 = 360_000.0;
/// Diameters of filament, mm.
pub const FILAMENT_MM: [f64; 2] = [0.1, 20.0];
/// Diameter where nobody says it.
pub const FILAMENT_DEFAULT_MM: f64 = 1.75;
/// Slowest bead, mm/s, where it lasts longer than `SLOW_S_MAX`: in the 4 s that a bead's width then takes
/// any hot end oozes more than it lays. What is shorter are a path's first and last micrometres, told with
/// their time (G93).
pub const SPEED_MIN_MM_S: f64 = 0.1;
/// Slowest push of the extruder alone, mm³/s, where it lasts longer than `SLOW_S_MAX`: less than oozes.
pub const PUSH_MIN_MM3_S: f64 = 0.01;
const SLOW_S_MAX: f64 = 1.0;
/// Most that is pushed or pulled in one go, mm³: three metres of the thicker filament.
pub const PUSH_MAX_MM3: f64 = 20_000.0;
/// Widest bead, mm²: 40 mm by 20 mm and more, as concrete is printed.
pub const BEAD_MAX_MM2: f64 = 1000.0;
/// What a bead's length counts more for that, mm: E is rounded.
const BEAD_MORE_MM: f64 = 1.0;
/// Longest job, days.
pub const DAYS_MAX: f64 = 60.0;
/// Lines of each kind that a note names.
const LINES_TOLD: usize = 8;

/// A place of the tip and the turns of head or table.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Tip, mm.
    pub tip_mm: [f64; 3],
    /// A, B, C, degrees.
    pub turn_deg: [f64; 3],
}

pub use comments::BeadKind;

/// What holds between two places of a pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// Line of the file, from 1.
    pub line: usize,
    /// Tip speed.
    pub speed_mm_s: f64,
    /// Width of the bead, where a comment tells it.
    pub width_mm: Option<f64>,
    /// Height of the bead, where it is known.
    pub height_mm: Option<f64>,
    /// What it deposits; `None` in a file that extrudes nothing.
    pub volume_mm3: Option<f64>,
    /// Infill or support, as a comment tells it.
    pub is_inside: bool,
    /// Kind of the bead, as a comment tells it.
    pub kind: BeadKind,
}

/// A prime or retract.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Push {
    /// Volume; `None` is the machine's own.
    pub mm3: Option<f64>,
    /// Rate that the file asks.
    pub rate_mm3_s: Option<f64>,
}

/// One run without an interruption of flow.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GcodePass {
    /// Layer from 0.
    pub layer: u32,
    /// Where the head goes from the pass before to this one, ends left out.
    pub travel: Vec<Place>,
    /// How it goes there: one more than places.
    pub travel_legs: Vec<Leg>,
    /// Two or more places.
    pub points: Vec<Place>,
    /// Between them, one less.
    pub legs: Vec<Leg>,
    /// Before it.
    pub prime: Option<Push>,
    /// After it.
    pub retract: Option<Push>,
}

/// Where an order of heaters and fans stands; passes are counted from 0, their number is the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeatPlace {
    /// Where the head leaves for a pass, behind the retract of the one before.
    Leaving(usize),
    /// Where a pass begins, before its prime.
    Start(usize),
    /// At a place of a pass, as its points are counted.
    Point(usize, usize),
}

impl HeatPlace {
    /// The same place of another pass.
    pub fn of_pass(self, other: impl Fn(usize) -> usize) -> HeatPlace {
        match self {
            HeatPlace::Leaving(pass) => HeatPlace::Leaving(other(pass)),
            HeatPlace::Start(pass) => HeatPlace::Start(other(pass)),
            HeatPlace::Point(pass, point) => HeatPlace::Point(other(pass), point),
        }
    }
}

/// An order at its place: of heaters and fans, or something else that a line says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedOrder<T = HeatOrder> {
    /// Line of the file, from 1.
    pub line: usize,
    /// Where.
    pub place: HeatPlace,
    /// What.
    pub order: T,
}

/// A file's passes and what else it says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GcodeProgram {
    /// Name for headers and pictures.
    pub name: String,
    /// Who wrote it.
    pub slicer: Slicer,
    /// Passes in order, one or more.
    pub passes: Vec<GcodePass>,
    /// Orders of heaters and fans, in their order.
    pub heat: Vec<PlacedOrder>,
    /// Numbers of the lines that say what no job does.
    pub left: Vec<PlacedOrder<usize>>,
    /// Diameter of the filament, mm.
    pub filament_mm: f64,
    /// The slicer's estimate of the printing time.
    pub estimate_s: Option<f64>,
    /// Least time of a layer that the slicer slowed for, s; 0 where it does not say it.
    pub layer_time_min_s: f64,
    /// Layers that begin within passes, as those of a vase do.
    pub layers_within: u32,
    /// C is given: headings are told.
    pub has_headings: bool,
    /// A or B is given: the tool tilts.
    pub has_tilts: bool,
    /// Its axes are declared: speeds and volumes of a path of tilts are the file's.
    pub is_declared: bool,
    /// One line each: what is not done, what was taken how.
    pub notes: Vec<String>,
}

/// How to read.
#[derive(Clone, Debug, PartialEq)]
pub struct GcodeOptions {
    /// Factor on all places and lengths, not on volumes of E.
    pub scale: f64,
    /// Diameter of the filament, over what the file says.
    pub filament_mm: Option<f64>,
    /// The axes of the machine that the file was written for, where they are declared.
    pub axes: Option<Arc<FileAxes>>,
    /// Letters of the tilts about X and Y and of the heading, of a head that tilts around its tip (X Y Z), where no
    /// axes are declared.
    pub head_letters: Option<[u8; 3]>,
}

impl Default for GcodeOptions {
    fn default() -> GcodeOptions {
        GcodeOptions {
            scale: 1.0,
            filament_mm: None,
            axes: None,
            head_letters: None,
        }
    }
}

/// Lines among which a file says who wrote it.
const HEAD_LINES: usize = 100;

impl GcodeOptions {
    /// Those of a text: what Headway wrote says its axes itself, whatever is declared.
    fn of_text(&self, text: &str) -> GcodeOptions {
        let is_header = |line: &str| {
            let comment = line.trim_start().strip_prefix(';');
            comment.is_some_and(|comment| comment.trim_start().starts_with(OWN_HEADER))
        };
        let is_own = words::lines(text).take(HEAD_LINES).any(is_header);
        GcodeOptions {
            axes: self.axes.clone().filter(|_| !is_own),
            ..self.clone()
        }
    }
}

impl Place {
    /// Between the tips.
    pub fn distance_mm(&self, other: &Place) -> f64 {
        let squares = (0..3).map(|i| (self.tip_mm[i] - other.tip_mm[i]).powi(2));
        squares.sum::<f64>().sqrt()
    }

    /// Tool axis from the tip into the head, and heading about it, rad: the head stands at
    /// R_x(A) R_y(B) R_z(C), heading by the smallest turn from upright to the axis.
    pub fn axis_and_heading(&self) -> (Unit<Vector3<f64>>, f64) {
        let [a, b, c] = self.turn_deg.map(f64::to_radians);
        let tilted = Rotation3::from_axis_angle(&Vector3::x_axis(), a)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), b);
        let axis = Unit::new_normalize(tilted * Vector3::z());
        let upright = Rotation3::rotation_between(&Vector3::z(), &axis).unwrap_or_default();
        let x = upright.inverse() * (tilted * Vector3::x());
        (axis, c + x.y.atan2(x.x))
    }
}

impl GcodePass {
    /// What it deposits, mm³; `None` where the file does not say it.
    pub fn volume_mm3(&self) -> Option<f64> {
        self.legs.iter().map(|leg| leg.volume_mm3).sum()
    }
}

impl GcodeProgram {
    /// A job that Headway exported: it is read, and not planned again.
    pub fn is_export(&self) -> bool {
        self.slicer == Slicer::Headway
    }

    /// Its passes lie along lines that were drawn: no file says more of them.
    pub fn is_drawn(&self) -> bool {
        self.slicer == Slicer::Drawing
    }

    /// Layers of the passes.
    pub fn layers(&self) -> u32 {
        self.passes.last().map_or(1, |pass| pass.layer + 1) + self.layers_within
    }

    /// Length of all passes, mm.
    pub fn print_mm(&self) -> f64 {
        let pairs = self.passes.iter().flat_map(|pass| pass.points.windows(2));
        pairs.map(|pair| pair[1].distance_mm(&pair[0])).sum()
    }

    /// What all passes deposit, mm³; `None` where the file does not say it.
    pub fn volume_mm3(&self) -> Option<f64> {
        self.passes.iter().map(GcodePass::volume_mm3).sum()
    }
}

/// Reads a file. `name` is used for headers.
///
/// # Errors
/// [`Refusal`], the first that is found.
pub fn read(bytes: &[u8], name: &str, options: &GcodeOptions) -> Result<GcodeProgram, Refusal> {
    if bytes.starts_with(b"GCDE") {
        return Err(refusal!(
            "it is binary G-code: switch \"binary G-code\" off in the slicer and export again"
        ));
    }
    // Comments may be in any 8-bit encoding; editors and old systems end files with NUL or Ctrl-Z.
    let text = String::from_utf8_lossy(bytes);
    let text = text
        .trim_start_matches('\u{feff}')
        .trim_end_matches(['\0', '\u{1a}', '\n', '\r']);
    let options = &options.of_text(text);
    let (steps, taken) = steps_of(text, options)?;
    if let Some(second) = steps.second_tool.clone().filter(|_| !steps.extrudes) {
        return Err(second);
    }
    let filament_mm = filament_mm(&steps, options)?;
    let (mut passes, heat, left, left_out) = passes::passes(&steps, filament_mm)?;
    if passes.is_empty() {
        return Err(refusal!(
            "nothing is printed: no move in the plane extrudes (E rises) in {lines} lines; is \
             this the sliced file, with its extrusion?",
            lines = steps.lines
        ));
    }
    check_beads(&passes)?;
    if options.scale != 1.0 {
        passes.iter_mut().for_each(|pass| pass.scale(options.scale));
    }
    check_speed(&passes)?;
    check_tilt(&passes)?;
    let mut notes = notes(&steps, options, filament_mm);
    notes.extend(taken.note);
    notes.extend(left_out.notes());
    Ok(GcodeProgram {
        name: name.to_string(),
        slicer: steps.comments.slicer,
        filament_mm,
        layer_time_min_s: steps.comments.layer_time_min_s,
        estimate_s: steps.comments.estimate_s.filter(|s| *s > 0.0),
        layers_within: left_out.layers,
        has_tilts: steps.turns[0],
        // Undeclared tilts are of a head whose heading is where it stands.
        has_headings: steps.turns[1] || steps.turns[0] && options.axes.is_none(),
        is_declared: options.axes.is_some(),
        passes,
        heat,
        left,
        notes,
    })
}

/// Reads the lines as firmwares begin, and anew where that is not how E is meant.
fn steps_of(text: &str, options: &GcodeOptions) -> Result<(Steps, Taken), Refusal> {
    let declared = flavour::declared(text);
    let is_said = declared.e_relative.is_some();
    let as_said = Taken {
        relative: declared.e_relative.unwrap_or(false),
        volumetric: declared.volumetric,
        note: None,
    };
    let steps = interpreter::steps(text, declared.flavour, &as_said, is_said, options)?;
    let filament_mm = filament_mm(&steps, options)?;
    let taken = extrusion::taken(&steps.counted, &declared, filament_mm);
    let as_taken = Taken {
        note: None,
        ..taken.clone()
    };
    match as_taken == as_said {
        true => Ok((steps, taken)),
        false => {
            // A file of two million moves has room for one reading.
            drop(steps);
            let steps = interpreter::steps(text, declared.flavour, &taken, is_said, options)?;
            Ok((steps, taken))
        }
    }
}

impl GcodePass {
    fn scale(&mut self, factor: f64) {
        for place in self.points.iter_mut().chain(&mut self.travel) {
            place.tip_mm.iter_mut().for_each(|c| *c *= factor);
        }
        for leg in &mut self.legs {
            leg.width_mm = leg.width_mm.map(|mm| mm * factor);
            leg.height_mm = leg.height_mm.map(|mm| mm * factor);
            leg.volume_mm3 = leg.volume_mm3.map(|mm3| mm3 * factor.powi(3));
        }
    }
}

fn filament_mm(steps: &Steps, options: &GcodeOptions) -> Result<f64, Refusal> {
    let said = options.filament_mm.or(steps.comments.filament_mm);
    let diameter_mm = said.unwrap_or(FILAMENT_DEFAULT_MM);
    if (FILAMENT_MM[0]..=FILAMENT_MM[1]).contains(&diameter_mm) {
        Ok(diameter_mm)
    } else {
        Err(error::filament(0, diameter_mm))
    }
}

/// Seconds of a day.
const DAY_S: f64 = 86_400.0;

/// Beads that no nozzle lays, by the numbers of the file.
fn check_beads(passes: &[GcodePass]) -> Result<(), Refusal> {
    for pass in passes {
        for (pair, leg) in pass.points.windows(2).zip(&pass.legs) {
            let length_mm = pair[1].distance_mm(&pair[0]) + BEAD_MORE_MM;
            let area_mm2 = leg.volume_mm3.unwrap_or(0.0) / length_mm;
            if area_mm2 > BEAD_MAX_MM2 {
                return Err(refusal!(
                    "line {line}: a bead of {} mm² in cross-section, more than {}: check E \
                     (M82, M83, G92) and the filament's diameter",
                    Short(area_mm2),
                    Short(BEAD_MAX_MM2),
                    line = leg.line
                ));
            }
        }
    }
    Ok(())
}

/// Beads slower than they can be, and a job of months: a feed in the wrong unit.
fn check_speed(passes: &[GcodePass]) -> Result<(), Refusal> {
    let mut sum_s = 0.0;
    for pass in passes {
        for (pair, leg) in pass.points.windows(2).zip(&pass.legs) {
            let (line, speed_mm_s) = (leg.line, leg.speed_mm_s);
            let seconds = pair[1].distance_mm(&pair[0]) / speed_mm_s;
            if speed_mm_s < SPEED_MIN_MM_S && seconds > SLOW_S_MAX {
                return Err(refusal!(
                    "line {line}: it prints at {} mm/s for {} s, slower than 0.1 mm/s: check F, \
                     which is mm/min, and the modes (G93, G94)",
                    Short(speed_mm_s),
                    Short(seconds)
                ));
            }
            sum_s += seconds;
            check_days(sum_s, line)?;
        }
    }
    Ok(())
}

/// The time of a job so far.
pub(crate) fn check_days(seconds: f64, line: usize) -> Result<(), Refusal> {
    let days = seconds / DAY_S;
    match days > DAYS_MAX {
        true => Err(refusal!(
            "line {line}: up to here the job takes {} days, more than {}: check F, which is \
             mm/min, E and the flow that the machine allows (flow_max_mm3_s)",
            Short(days),
            Short(DAYS_MAX)
        )),
        false => Ok(()),
    }
}

/// Poses have tilts up to a bound.
fn check_tilt(passes: &[GcodePass]) -> Result<(), Refusal> {
    for pass in passes {
        let lines = pass.legs.iter().map(|leg| leg.line);
        for (place, line) in pass.points.iter().skip(1).zip(lines) {
            let tilt_rad = place.axis_and_heading().0.z.clamp(-1.0, 1.0).acos();
            if tilt_rad > TILT_MAX_RAD + TILT_ROUNDING_RAD {
                return Err(error::too_tilted(line, tilt_rad));
            }
        }
    }
    Ok(())
}

fn notes(steps: &Steps, options: &GcodeOptions, filament_mm: f64) -> Vec<String> {
    let mut notes = Vec::new();
    let comments = &steps.comments;
    if steps.extrudes && comments.filament_mm.is_none() && options.filament_mm.is_none() {
        notes.push(format!(
            "no line tells the filament's diameter: {filament_mm} mm is taken (--filament-diameter)"
        ));
    }
    if let Some(axes) = &options.axes {
        notes.push(format!(
            "axes of the file: {}; F is {}, by G93 the move's time",
            axes.text(),
            axes.feed().text()
        ));
        if axes.heading().is_some() && !steps.turns[1] {
            notes.push("no move names the declared heading: it is free".to_string());
        }
    }
    notes.extend(steps.macros.iter().take(LINES_TOLD).cloned());
    let more = |count: usize| match count.saturating_sub(LINES_TOLD) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    if !steps.carried.is_empty() {
        let count = steps.carried.len();
        let told = steps.carried[..count.min(LINES_TOLD)].join(", ");
        notes.push(format!(
            "heaters and fans that no job has, order them by the controller that has them: {told}{}",
            more(count)
        ));
    }
    if !steps.undone.is_empty() {
        let mut undone: Vec<_> = steps.undone.iter().collect();
        undone.sort_by_key(|(_, (line, _))| *line);
        let told = undone.iter().take(LINES_TOLD);
        let told = told.map(|(code, (line, times))| match times {
            1 => format!("line {line} {code}"),
            _ => format!("line {line} {code} ({times} times)"),
        });
        let told = told.collect::<Vec<_>>().join(", ");
        notes.push(format!("not done: {told}{}", more(undone.len())));
    }
    notes
}

#[cfg(test)]
mod tests;

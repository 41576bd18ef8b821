//! Goal: any input of any format ends soon, within little memory, with the right result or a message that says where
//! it is wrong. Method: some hundred inputs of a few lines, what each should come to computed by hand beside it;
//! each runs in a thread of its own that is waited for, under an allocator that counts. A binary of its own, since
//! all of a program shares the allocator.

mod drawings;
mod gcode;
mod jobs;
mod machines;
mod paths;
mod solids;

use headway::gcode::{GcodeOptions, GcodeProgram, read};
use headway::input::centre_lines::CentreLine;
use headway::input::{Format, Input, ReadOptions, read_any};
use headway::job::file;
use headway::mesh::MeshFormat;
use headway::pipeline::gcode::plan_gcode;
use headway::pipeline::packing::JobPacking;
use headway::settings::Settings;
use headway::settings::machine_file::from_toml;
use peak_alloc::PeakAlloc;
use std::f64::consts::PI;
use std::io::Cursor;
use std::sync::mpsc;
use std::time::{Duration, Instant};

#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

/// The most that an input may take. Measured: 1.1 s for the slowest, 352 MB for the largest.
const SECONDS_MAX: u64 = 10;
const BYTES_MAX: usize = 1_000_000_000;
/// The most that all of them may take together, s, beside other tests on the same cores; alone they take 4.
const ALL_SECONDS_MAX: f64 = 60.0;
/// Cross-section of 1.75 mm filament, mm².
const FILAMENT_MM2: f64 = 0.25 * PI * 1.75 * 1.75;
/// Curves are chords within 1 µm of them, up to 2e-4 shorter; nothing else is rounded as far.
const SHARE: f64 = 4e-4;

/// What an input is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// G-code, read.
    Gcode,
    /// G-code, read, planned and packed for the default machine.
    Planned,
    /// An outline or a path.
    Drawing(Format),
    /// A solid.
    Solid(MeshFormat),
    /// A machine file.
    Machine,
    /// A job.
    Job,
}

/// What it should come to.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Want {
    /// Length of the beads (mm), their filament (mm of 1.75 mm), layers.
    Beads(f64, f64, u32),
    /// The heights of the beads one after another, mm.
    Heights(&'static [f64]),
    /// Volumes of prime and retract of each pass, mm of 1.75 mm filament; 0 where there is none.
    Pushes(&'static [[f64; 2]]),
    /// Seconds of the planned job, at least and at most.
    Seconds(f64, f64),
    /// Area of outlines, mm².
    Area(f64),
    /// Volume of a solid, mm³.
    Volume(f64),
    /// Length of a path from point to point, mm.
    Path(f64),
    /// Nothing but that it is taken.
    Taken,
    /// Refused with this in the message.
    Refused(&'static str),
}

/// An input.
struct Case {
    what: &'static str,
    kind: Kind,
    bytes: Vec<u8>,
    want: Want,
}

fn case(what: &'static str, kind: Kind, bytes: impl Into<Vec<u8>>, want: Want) -> Case {
    let bytes = bytes.into();
    Case {
        what,
        kind,
        bytes,
        want,
    }
}

/// What became of an input.
#[derive(Debug)]
enum Found {
    Program(Box<GcodeProgram>),
    Seconds(f64),
    Area(f64),
    Volume(f64),
    Path(f64),
    Taken,
    Refused(String),
}

fn gcode(bytes: &[u8], plans: bool) -> Result<Found, String> {
    let told = |error: &dyn std::fmt::Display| error.to_string();
    let program = read(bytes, "awkward", &GcodeOptions::default()).map_err(|error| told(&error))?;
    if !plans {
        return Ok(Found::Program(Box::new(program)));
    }
    let plan = plan_gcode(&program, None, &Settings::default(), &()).map_err(|e| told(&e))?;
    let mut packing = JobPacking::new(Cursor::new(Vec::new()));
    let taken = packing.take(&plan.stream, 0, &plan.settings);
    taken.map_err(|error| told(&error))?;
    packing.finish(&plan.settings).map_err(|e| told(&e))?;
    Ok(Found::Seconds(plan.motion.duration_s))
}

fn run(kind: Kind, bytes: &[u8]) -> Result<Found, String> {
    let options = ReadOptions::default();
    let format = match kind {
        Kind::Gcode | Kind::Planned => return gcode(bytes, kind == Kind::Planned),
        Kind::Machine => {
            let text = String::from_utf8_lossy(bytes);
            let read = from_toml(&text).map_err(|error| error.to_string());
            return read.map(|_| Found::Taken);
        }
        Kind::Job => {
            let read = file::read(&mut Cursor::new(bytes));
            return read.map(|_| Found::Taken).map_err(|e| e.to_string());
        }
        Kind::Drawing(format) => format,
        Kind::Solid(format) => Format::Mesh(format),
    };
    Ok(
        match read_any(bytes, "awkward", format, &options).map_err(|e| e.to_string())? {
            Input::Outline(loaded) => {
                let regions = loaded.target.regions.iter();
                Found::Area(regions.map(|region| region.area_mm2()).sum())
            }
            Input::Lines(drawn) => {
                let edges = drawn.lines.iter().flat_map(CentreLine::edges);
                Found::Path(edges.map(|[from, to]| (to - from).norm()).sum())
            }
            Input::Path(run) => {
                let pairs = run.points.windows(2);
                let steps = pairs.map(|pair| (pair[1].tip_mm - pair[0].tip_mm).norm());
                Found::Path(steps.sum())
            }
            Input::Mesh(loaded) => Found::Volume(loaded.mesh.volume_mm3()),
            Input::Gcode(program) => Found::Program(Box::new(program)),
        },
    )
}

fn is_near(found: f64, wanted: f64) -> bool {
    (found - wanted).abs() <= SHARE * wanted.abs().max(1e-9)
}

fn heights_of(program: &GcodeProgram) -> Vec<f64> {
    let legs = program.passes.iter().flat_map(|pass| &pass.legs);
    legs.map(|leg| leg.height_mm.unwrap_or(0.0)).collect()
}

fn is_right(found: &Found, want: Want) -> bool {
    match (found, want) {
        (Found::Program(program), Want::Beads(length_mm, filament_mm, layers)) => {
            let used_mm = program.volume_mm3().unwrap_or(0.0) / FILAMENT_MM2;
            is_near(program.print_mm(), length_mm)
                && is_near(used_mm, filament_mm)
                && program.layers() == layers
        }
        (Found::Program(program), Want::Heights(wanted)) => {
            let heights = heights_of(program);
            let mut pairs = heights.iter().zip(wanted);
            heights.len() == wanted.len() && pairs.all(|(a, b)| (a - b).abs() < 1e-6)
        }
        (Found::Program(program), Want::Pushes(wanted)) => {
            let found = program.passes.iter().map(|pass| {
                let of = |push: Option<headway::gcode::Push>| push.and_then(|push| push.mm3);
                [pass.prime, pass.retract].map(|push| of(push).unwrap_or(0.0) / FILAMENT_MM2)
            });
            let is_same =
                |(a, b): ([f64; 2], &[f64; 2])| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
            program.passes.len() == wanted.len() && found.zip(wanted).all(is_same)
        }
        (Found::Seconds(seconds), Want::Seconds(from, to)) => (from..=to).contains(seconds),
        (Found::Area(found), Want::Area(wanted))
        | (Found::Volume(found), Want::Volume(wanted))
        | (Found::Path(found), Want::Path(wanted)) => is_near(*found, wanted),
        (Found::Refused(_), _) => false,
        (_, Want::Taken) => true,
        _ => false,
    }
}

/// Short, for a message.
fn shown(found: &Found) -> String {
    match found {
        Found::Program(program) => format!(
            "{} mm, {} mm of filament, {} layers, heights {:?}, notes {:?}",
            program.print_mm(),
            program.volume_mm3().unwrap_or(0.0) / FILAMENT_MM2,
            program.layers(),
            heights_of(program).iter().take(20).collect::<Vec<_>>(),
            program.notes
        ),
        other => format!("{other:?}"),
    }
}

/// What is wrong with a case's outcome.
fn problem(case: Case) -> Option<String> {
    let Case {
        what,
        kind,
        bytes,
        want,
    } = case;
    let (sender, receiver) = mpsc::channel();
    HEAP.reset_peak_usage();
    let before = HEAP.current_usage();
    let started = Instant::now();
    std::thread::spawn(move || {
        let found = run(kind, &bytes).unwrap_or_else(Found::Refused);
        // Nobody may be waiting any more.
        let _ = sender.send(found);
    });
    let found = match receiver.recv_timeout(Duration::from_secs(SECONDS_MAX)) {
        Ok(found) => found,
        Err(error) => return Some(format!("{what}: no end in {SECONDS_MAX} s ({error})")),
    };
    let taken = HEAP.peak_usage().saturating_sub(before);
    let seconds = started.elapsed().as_secs_f64();
    if seconds > 0.3 || taken > 100_000_000 {
        println!("{what}: {seconds:.2} s, {} MB", taken / 1_000_000);
    }
    if taken > BYTES_MAX {
        return Some(format!("{what}: {taken} bytes"));
    }
    let is_wanted = match (&found, want) {
        (Found::Refused(message), Want::Refused(part)) => message.contains(part),
        _ => is_right(&found, want),
    };
    (!is_wanted).then(|| format!("{what}: {want:?} wanted, found {}", shown(&found)))
}

#[test]
fn a_hundred_awkward_inputs_end_soon_and_right() {
    let started = Instant::now();
    let tables = [
        gcode::cases(),
        solids::cases(),
        drawings::cases(),
        paths::cases(),
        machines::cases(),
        jobs::cases(),
    ];
    let cases: Vec<Case> = tables.into_iter().flatten().collect();
    let count = cases.len();
    let problems: Vec<String> = cases.into_iter().filter_map(problem).collect();
    let seconds = started.elapsed().as_secs_f64();
    println!("{count} inputs in {seconds:.1} s");
    assert!(problems.is_empty(), "{}", problems.join("\n"));
    assert!(count >= 100, "{count}");
    assert!(seconds < ALL_SECONDS_MAX, "{seconds} s");
}

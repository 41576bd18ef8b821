//! Goal: a pump's output is set so early that the flow is there when the job lays, over changes of speed, and is off wherever
//! the machine stops. Method: programs are run by the interpreters of their languages, timed by the model of blocks and
//! blends, and their outputs held against the volume of the job's stream at each servo tick.

use super::programs::{OnPath, Sample, limits, on_path, options, run, samples, sources, written};
use super::wrist::arm;
use headway::input::{self, Format, ReadOptions, Target};
use headway::programs::{Language, Program};
use headway::settings::pump::{PumpKind, PumpOutput};
use headway::settings::{Settings, machine_file};
use headway::{Plan, plan_target};
use headway_tests::robot_programs::block_time::motion_seconds;
use headway_tests::robot_programs::krl::run_krl;
use headway_tests::robot_programs::rapid::run_rapid;
use headway_tests::robot_programs::{Motion, SourceFile, Step};
use std::path::Path;

/// What is promised of a start and a stop, s. A Sinumerik rounds corners by a tolerance in place of a length, so that the time
/// of the short blocks before a start is known less.
fn edge_s(language: Language) -> f64 {
    match language {
        Language::Sinumerik => 12e-3,
        _ => 5e-3,
    }
}
const HZ: f64 = 2000.0;

fn pump(language: Language, kind: PumpKind) -> PumpOutput {
    let output = match language {
        Language::Rapid => "ao_pump",
        _ => "1",
    };
    PumpOutput {
        output: output.to_string(),
        kind,
        // Volts, or the share of the whole range.
        mm3_s_per_unit: Some(match language {
            Language::Rapid | Language::Sinumerik => 40.0,
            _ => 400.0,
        }),
        lag_s: 0.05,
        start_lead_s: 0.06,
        stop_lead_s: 0.04,
        rate_min_mm3_s: 0.0,
        rate_max_mm3_s: None,
    }
}

/// A program's outputs on its own time.
struct Played {
    /// When each motion ends, s.
    ends_s: Vec<f64>,
    /// Changes: when, s, and to what.
    changes: Vec<(f64, f64)>,
}

/// What a synchronised action sets with the next motion.
fn with_next_motion(text: &str) -> Option<f64> {
    let (_, action) = text.strip_prefix("WHEN ")?.split_once(" DO ")?;
    action.split_once('=')?.1.parse().ok()
}

fn played(steps: &[Step], timed: &[Motion], settings: &Settings) -> Played {
    let seconds = motion_seconds(timed, &limits(settings));
    let (mut now_s, mut level) = (0.0, 0.0);
    let mut played = Played {
        ends_s: Vec::new(),
        changes: Vec::new(),
    };
    for step in steps {
        let set = match step {
            Step::Move(_) => {
                now_s += seconds[played.ends_s.len()];
                played.ends_s.push(now_s);
                None
            }
            Step::Wait { seconds } => {
                now_s += seconds;
                None
            }
            Step::Note { text } => with_next_motion(text).map(|value| (now_s, value)),
            Step::Output {
                value,
                before_end_mm,
                delay_s,
                ..
            } => {
                let speed = timed[played.ends_s.len().saturating_sub(1)].speed_mm_s;
                Some((now_s - before_end_mm / speed + delay_s, *value))
            }
        };
        if let Some((at_s, value)) = set.filter(|set| set.1 != level) {
            played.changes.push((at_s, value));
            level = value;
        }
    }
    played
}

/// Between the points of a rising curve.
fn along(points: &[(f64, f64)], x: f64) -> f64 {
    let after = points
        .partition_point(|point| point.0 < x)
        .clamp(1, points.len() - 1);
    let [(x0, y0), (x1, y1)] = [points[after - 1], points[after]];
    y0 + (y1 - y0) * ((x - x0) / (x1 - x0).max(1e-12)).clamp(0.0, 1.0)
}

/// Ticks at which the job begins and ends to lay; a thousandth of the greatest flow is a rest whose volume is rounded.
fn laid(volumes_mm3: &[f64]) -> Vec<[usize; 2]> {
    let flows = volumes_mm3.windows(2).map(|pair| pair[1] - pair[0]);
    let least_mm3 = 1e-3 * flows.fold(0.0, f64::max);
    let mut spans: Vec<[usize; 2]> = Vec::new();
    for (tick, pair) in volumes_mm3.windows(2).enumerate() {
        if pair[1] - pair[0] <= least_mm3 {
            continue;
        }
        match spans.last_mut().filter(|span| tick - span[1] < 40) {
            Some(span) => span[1] = tick + 1,
            None => spans.push([tick, tick + 1]),
        }
    }
    spans
}

/// Runs of the output that is on, as starts and ends.
fn runs(changes: &[(f64, f64)]) -> Vec<[f64; 2]> {
    let mut runs: Vec<[f64; 2]> = Vec::new();
    let mut before = 0.0;
    for &(at_s, value) in changes {
        match (before > 0.0, value > 0.0) {
            (false, true) => runs.push([at_s, f64::INFINITY]),
            (true, false) => runs.last_mut().unwrap()[1] = at_s,
            _ => {}
        }
        before = value;
    }
    runs
}

fn check(plan: &Plan, job: &[Sample], settings: &Settings, language: Language) {
    let pump = settings.pump.as_ref().unwrap();
    let program = written(plan, settings, &options(language)).unwrap();
    let steps = run(&program, language);
    check_stops(&program, &steps, language);
    let OnPath { timed, posed } = on_path(job, &steps, language);
    let played = played(&steps, &timed, settings);
    let volumes_mm3: Vec<f64> = job.iter().map(|of| of.volume_mm3).collect();
    // Where the job is at a time of the program, by the ends of its blocks.
    let mut places: Vec<(f64, f64)> = vec![(0.0, 0.0)];
    let first = played.ends_s.len() - posed.len();
    for ((_, _, tick), end_s) in posed.iter().zip(&played.ends_s[first..]) {
        let last = places.last().unwrap();
        if *tick as f64 >= last.0 && *end_s >= last.1 {
            places.push((*tick as f64, *end_s));
        }
    }
    let spans = laid(&volumes_mm3);
    let on = runs(&played.changes);
    assert_eq!(on.len(), spans.len(), "{language:?}: starts");
    let mut worst_s: f64 = 0.0;
    for (span, on) in spans.iter().zip(&on) {
        let [begins_s, ends_s] = span.map(|tick| along(&places, tick as f64));
        let starts_s = begins_s - on[0] - pump.start_lead_s;
        let stops_s = ends_s - on[1] - pump.stop_lead_s;
        worst_s = worst_s.max(starts_s.abs()).max(stops_s.abs());
    }
    let changes = played.changes.len();
    println!(
        "{language:?}: {} starts, {changes} changes, at most {worst_s:.4} s off",
        on.len()
    );
    assert!(worst_s < edge_s(language), "{language:?}: {worst_s} s off");
    if pump.kind == PumpKind::Analog {
        check_flow(&played.changes, &places, &volumes_mm3, pump, language);
    }
}

/// The flow, its lag after the output, is that of the job.
fn check_flow(
    changes: &[(f64, f64)],
    places: &[(f64, f64)],
    volumes_mm3: &[f64],
    pump: &PumpOutput,
    language: Language,
) {
    let per_unit = pump.mm3_s_per_unit.unwrap();
    let ends = changes.iter().skip(1).map(|change| change.0);
    let pumped_mm3: f64 = (changes.iter().zip(ends))
        .map(|(change, end_s)| per_unit * change.1 * (end_s - change.0))
        .sum();
    let laid_mm3 = volumes_mm3.last().unwrap() - volumes_mm3[0];
    let share = pumped_mm3 / laid_mm3;
    // The lead of starts is longer than that of stops: so much is pumped more.
    let runs = runs(changes);
    let more_s = (pump.start_lead_s - pump.stop_lead_s) * runs.len() as f64;
    let on_s: f64 = runs.iter().map(|run| run[1] - run[0]).sum();
    // A program that takes longer than the job pumps for longer.
    let inverse: Vec<(f64, f64)> = places.iter().map(|of| (of.1, of.0)).collect();
    let job_s: f64 = (runs.iter())
        .map(|run| (along(&inverse, run[1]) - along(&inverse, run[0])) / HZ)
        .sum();
    let due = on_s / job_s + more_s / on_s;
    println!("{language:?}: {share:.4} of the volume, {due:.4} by the leads");
    assert!((share - due).abs() < 0.02, "{language:?}: {share}");
    let rate = |tick: usize| (volumes_mm3[tick + 1] - volumes_mm3[tick]) * HZ;
    let most = (0..volumes_mm3.len() - 1).map(rate).fold(0.0, f64::max);
    let [mut looks, mut wrong] = [0, 0];
    for run in runs {
        let mut at_s = run[0] + 0.03;
        while at_s < run[1] - 0.03 {
            let value = changes[changes.partition_point(|change| change.0 <= at_s) - 1].1;
            let tick = along(&inverse, at_s + pump.lag_s) as usize;
            looks += 1;
            // The nearest in 10 ms: a change is where its stretch begins.
            let near = (tick.saturating_sub(20)..(tick + 20).min(volumes_mm3.len() - 1)).map(rate);
            let off = near
                .map(|rate| (rate - per_unit * value).abs())
                .fold(f64::MAX, f64::min);
            wrong += usize::from(off > 0.05 * most);
            at_s += 1e-3;
        }
    }
    println!("{language:?}: flow wrong at {wrong} of {looks} looks");
    assert!(
        looks > 500 && wrong * 50 < looks,
        "{language:?}: {wrong} of {looks}"
    );
}

/// The printer for pellets, or a large arm with its nozzle, with a pump that its output alone starts and stops.
fn job(language: Language) -> Settings {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/machines/pellet.toml");
    let mut settings = machine_file::from_toml(&std::fs::read_to_string(path).unwrap()).unwrap();
    settings.wide_beads.pump_start_mm = 0.0;
    settings.wide_beads.pump_stop_mm = 0.0;
    if language != Language::Sinumerik {
        let arm = arm("arm-large.toml", 400.0);
        settings.machine.kinematics = arm.machine.kinematics;
        settings.machine.joints = arm.machine.joints;
        settings.work_area_mm = arm.work_area_mm;
    }
    settings
}

/// Four washers of 36 mm.
fn washers() -> Target {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/washers.geojson");
    let options = ReadOptions {
        scale: 3.0,
        ..ReadOptions::default()
    };
    let bytes = std::fs::read(path).unwrap();
    let read = input::read(&bytes, "washers.geojson", Format::GeoJson, &options);
    read.unwrap().target
}

#[test]
fn outputs_come_before_the_flow() {
    let mut plans: Vec<(Settings, Plan, Vec<Sample>)> = Vec::new();
    for settings in [job(Language::Rapid), job(Language::Sinumerik)] {
        let plan = plan_target(&washers(), &settings).unwrap();
        let samples = samples(&plan, &settings);
        plans.push((settings, plan, samples));
    }
    for language in Language::ALL {
        let (settings, plan, samples) = &plans[usize::from(language == Language::Sinumerik)];
        let kinds = match language {
            Language::Rapid | Language::Krl => &[PumpKind::Analog, PumpKind::Digital][..],
            _ => &[PumpKind::Analog],
        };
        for &kind in kinds {
            let settings = Settings {
                pump: Some(pump(language, kind)),
                ..settings.clone()
            };
            check(plan, samples, &settings, language);
        }
    }
}

/// Twenty places of the program at which the pump runs: the controller's own routine switches it off.
fn check_stops(program: &Program, steps: &[Step], language: Language) {
    let files = sources(program);
    let mut level = 0.0;
    let mut running: Vec<usize> = Vec::new();
    for (place, step) in steps.iter().enumerate() {
        level = match step {
            Step::Output { value, .. } => *value,
            Step::Note { text } => with_next_motion(text).unwrap_or(level),
            _ => level,
        };
        if level > 0.0 {
            running.push(place);
        }
    }
    assert!(running.len() > 20, "{language:?}");
    for number in 0..20 {
        let place = running[number * running.len() / 20];
        assert_eq!(
            stopped(&steps[..=place], &files, language),
            Some(0.0),
            "{language:?}: {place}"
        );
    }
    // What is written at the end, and before the first motion.
    let outputs = |step: &Step| matches!(step, Step::Output { value, .. } if *value > 0.0);
    assert!(
        !steps
            .iter()
            .take_while(|step| !matches!(step, Step::Move(_)))
            .any(outputs)
    );
    assert_eq!(level, 0.0, "{language:?}: it runs on after the program");
}

/// What the output is once the machine stands.
fn stopped(steps: &[Step], files: &[SourceFile], language: Language) -> Option<f64> {
    let value = |step: &Step| match step {
        Step::Output { value, .. } => Some(*value),
        _ => None,
    };
    let note = |part: &str| {
        steps
            .iter()
            .any(|step| matches!(step, Step::Note { text } if text.contains(part)))
    };
    match language {
        Language::Rapid => {
            let done = run_rapid(files, "part_pump_off").unwrap();
            done.iter().find_map(value)
        }
        Language::Krl => {
            let file = files.iter().find(|file| file.name == "part_stop.sub")?;
            let (condition, rest) = file.text.split_once("IF ")?.1.split_once(" THEN\n")?;
            // One of the two is true wherever a program does not go on.
            assert_eq!(condition, "$STOPMESS OR ($PRO_STATE1<>#P_ACTIVE)");
            let text = format!("DEF stop( )\n{}END\n", rest.split_once("ENDIF")?.0);
            let name = "stop.src".to_string();
            let done = run_krl(&[SourceFile { name, text }], "stop").unwrap();
            done.iter().find_map(value)
        }
        Language::UrScript => note("is low while no program runs").then_some(0.0),
        Language::Sinumerik => note("IDS=1 WHENEVER $AC_VACTW==0 DO $A_OUT").then_some(0.0),
    }
}

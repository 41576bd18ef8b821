//! What the heading profile does to print time and coverage: every reference slice, planned point by
//! point and over the corridor, for a slow and a fast heading axis, and which limit binds how long.
//!
//! Run with `cargo bench -p headway-tests --bench heading_profile -- [slow|fast|built-in]
//! [pointwise|corridor] [NAME ..]`.
//! Coverage and overlap by the oracle of `headway_tests::layer_oracle`. Prints, asserts nothing;
//! without the reference slices beside the checkout it says so.

use headway::geometry::polygon::Region;
use headway::input::{Format, ReadOptions, read};
use headway::job::{MotionState, SegmentStream};
use headway::plan_target;
use headway::settings::{HeadingProfile, Settings};
use headway_firmware::spline::Spans;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME};
use headway_tests::cpu_clock::process_s;
use headway_tests::folders::files;
use headway_tests::layer_oracle::{Rings, print_poses, sweep};

const SLICES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/slices");
/// Name, speed and acceleration of the heading axes, degrees; the jerk builds the acceleration up
/// in 10 ms, as on the built-in machine.
const AXES: [(&str, f64, f64); 3] = [
    ("slow", 200.0, 1_000.0),
    ("fast", 1_020.0, 2_000.0),
    ("built-in", 1_080.0, 20_000.0),
];
/// Joint that turns the nozzle on the planar machine.
const NOZZLE: usize = 3;

const PROFILES: [(&str, HeadingProfile); 2] = [
    ("pointwise", HeadingProfile::Pointwise),
    ("corridor", HeadingProfile::Corridor),
];

fn main() {
    let asked: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with('-'))
        .collect();
    let is_axis = |name: &str| AXES.iter().any(|(axis, ..)| *axis == name);
    let is_profile = |name: &str| PROFILES.iter().any(|(profile, _)| *profile == name);
    let has = |name: &str| asked.iter().any(|a| a == name);
    let all_axes = !asked.iter().any(|a| is_axis(a));
    let all_profiles = !asked.iter().any(|a| is_profile(a));
    let parts: Vec<&String> = asked
        .iter()
        .filter(|a| !is_axis(a) && !is_profile(a))
        .collect();
    for (axis, speed_deg_s, acceleration_deg_s2) in AXES {
        for (profile, heading_profile) in PROFILES {
            if !(all_axes || has(axis)) || !(all_profiles || has(profile)) {
                continue;
            }
            let mut settings = Settings {
                heading_profile,
                ..Settings::default()
            };
            let nozzle = &mut settings.machine.joints[NOZZLE];
            nozzle.speed_max = speed_deg_s.to_radians();
            nozzle.acceleration_max = acceleration_deg_s2.to_radians();
            nozzle.jerk_max = nozzle.acceleration_max / 0.01;
            table(&format!("{axis}, {profile}"), &settings, &parts);
        }
    }
}

/// Sums over the slices of one table.
#[derive(Default)]
struct Sums {
    area_mm2: f64,
    covered: f64,
    overlap: f64,
    print_s: f64,
    binding_s: [f64; LIMITS.len()],
}

fn table(axis: &str, settings: &Settings, parts: &[&String]) {
    println!(
        "{axis}: slice | covered of reachable % | overlap % | passes | heading rad | print s | s bound by {LIMITS:?}"
    );
    let started = process_s();
    let mut sums = Sums::default();
    for file in files(SLICES, "json") {
        let name = file
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .to_string();
        if parts.is_empty() || parts.iter().any(|p| name.contains(p.as_str())) {
            row(
                &name,
                &std::fs::read(&file).expect(&name),
                settings,
                &mut sums,
            );
        }
    }
    println!(
        "{axis}: covered {:.3}, overlap {:.3}, {:.1} s printed, bound {:.0?}, {:.0} s of processor",
        sums.covered / sums.area_mm2,
        sums.overlap / sums.area_mm2,
        sums.print_s,
        sums.binding_s,
        process_s() - started
    );
}

fn row(name: &str, bytes: &[u8], settings: &Settings, sums: &mut Sums) {
    let Ok(loaded) = read(bytes, name, Format::Polygon, &ReadOptions::default()) else {
        return;
    };
    let plan = match plan_target(&loaded.target, settings) {
        Ok(plan) => plan,
        Err(error) => return println!("| {name} | {error}"),
    };
    let offset = [plan.transform.offset_mm[0], plan.transform.offset_mm[1]];
    let poses = print_poses(&plan.stream, offset, 0.03);
    let axes = [settings.aperture.major_mm(), settings.aperture.minor_mm()];
    let cell_mm = (plan.figures.area_mm2 / 2e6).sqrt().clamp(0.01, 0.04);
    let found = sweep(&rings(&loaded.target.regions), &poses, axes, cell_mm);
    let covered = 100.0 * found.covered_pct / plan.figures.reachable_pct;
    let binding_s = binding_s(&plan.stream, settings);
    println!(
        "| {name} | {covered:.2} | {:.2} | {} | {:.0} | {:.1} | {binding_s:.1?}",
        found.overlap_pct,
        plan.figures.passes,
        plan.figures.heading_travel_rad,
        plan.figures.print_s
    );
    sums.area_mm2 += found.area_mm2;
    sums.covered += found.area_mm2 * covered;
    sums.overlap += found.area_mm2 * found.overlap_pct;
    sums.print_s += plan.figures.print_s;
    for (sum, bound) in sums.binding_s.iter_mut().zip(binding_s) {
        *sum += bound;
    }
}

fn rings(regions: &[Region]) -> Rings {
    let points = |ring: &headway::geometry::polygon::Ring| -> Vec<[f64; 2]> {
        ring.points.iter().map(|p| [p.x, p.y]).collect()
    };
    regions.iter().flat_map(|r| r.rings()).map(points).collect()
}

/// What may hold the head back while it prints; the last one is time off the passes.
const LIMITS: [&str; 8] = [
    "tip speed",
    "tip acceleration",
    "heading rate",
    "heading acceleration",
    "flow",
    "flow change",
    "none (smoothing)",
    "off the passes",
];
/// A limit whose share is used to more than this binds.
const BINDS: f64 = 0.85;

/// Seconds that each limit binds for, the one that is used most at each tick.
fn binding_s(stream: &SegmentStream, settings: &Settings) -> [f64; LIMITS.len()] {
    let servo_hz = f64::from(settings.machine.servo_hz);
    let nozzle = &settings.machine.joints[NOZZLE];
    let mut sums = [0.0; LIMITS.len()];
    let mut marks = stream.marks.iter().peekable();
    for span in Spans::new(&stream.start, &stream.knots) {
        for tick in 0..u32::from(span.duration_ticks) {
            let now = span.start_tick + u64::from(tick);
            while marks.peek().is_some_and(|m| m.end_tick <= now) {
                marks.next();
            }
            let printing = marks.peek().is_some_and(|m| m.state == MotionState::Print);
            let local = f64::from(tick) + 0.5;
            let (v, a) = (
                span.velocity(local, servo_hz),
                span.acceleration(local, servo_hz),
            );
            let ratios = [
                v[0].hypot(v[1]) / settings.speed_mm_s,
                a[0].hypot(a[1]) / settings.tip_acceleration_mm_s2,
                v[CHANNEL_HEADING].abs() / nozzle.speed_max,
                a[CHANNEL_HEADING].abs() / nozzle.acceleration_max,
                v[CHANNEL_VOLUME].abs() / settings.flow_max_mm3_s,
                a[CHANNEL_VOLUME].abs() / settings.flow_rate_of_change_max_mm3_s2,
            ]
            .map(|ratio| ratio / settings.plan_share);
            let most = (0..ratios.len()).fold(0, |b, i| if ratios[i] > ratios[b] { i } else { b });
            let which = match (printing, ratios[most] > BINDS) {
                (false, _) => 7,
                (true, true) => most,
                (true, false) => 6,
            };
            sums[which] += 1.0 / servo_hz;
        }
    }
    sums
}

//! Goal: paths of files are printed by a nozzle that has stops as by one that turns for ever: complete, as wide, with their
//! volume. Method: rings, a spiral, a square and tangential headings, as G-code and as waypoints, between stops of several
//! kinds; headings, angles about the middle and widths read from the finished stream's poses.

use headway::job::{MotionState, SegmentStream};
use headway::pipeline::gcode::plan_gcode;
use headway::plan_waypoints;
use headway::settings::Settings;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME};
use headway_tests::layer_oracle::{OraclePose, print_poses};
use std::f64::consts::{PI, TAU};
use std::fmt::Write;

const RADIUS_MM: f64 = 12.0;

fn between(stop_deg: f64) -> Settings {
    let mut settings = Settings::default();
    let nozzle = &mut settings.machine.joints[3];
    nozzle.position_min = -stop_deg.to_radians();
    nozzle.position_max = stop_deg.to_radians();
    settings
}

struct Followed {
    stream: SegmentStream,
    notes: Vec<String>,
}

impl Followed {
    fn gcode(text: &str, settings: &Settings) -> Followed {
        let program = headway::gcode::read(text.as_bytes(), "file", &Default::default());
        let plan = plan_gcode(&program.expect("a file"), None, settings, &()).expect("a plan");
        Followed {
            stream: plan.stream,
            notes: plan.jumps.notes(),
        }
    }

    fn waypoints(text: &str, settings: &Settings) -> Followed {
        let run = headway::input::waypoints::read(text.as_bytes(), "file", &Default::default());
        let plan = plan_waypoints(&run.expect("a run"), settings).expect("a plan");
        Followed {
            stream: plan.stream,
            notes: plan.jumps.notes(),
        }
    }

    fn poses(&self) -> Vec<OraclePose> {
        print_poses(&self.stream, [0.0; 2], 0.05)
    }

    /// The heading farthest from 0 of all knots, degrees.
    fn farthest_deg(&self) -> f64 {
        let headings = self.stream.knots.iter().map(|k| k.control[CHANNEL_HEADING]);
        1e-6 * f64::from(headings.map(i32::abs).max().expect("knots")).to_degrees()
    }

    /// Volume that is printed, mm³.
    fn volume_mm3(&self) -> f64 {
        let printed = self
            .stream
            .marks
            .iter()
            .filter(|mark| mark.state == MotionState::Print);
        let volume = |tick: u64| {
            let spans = self.stream.spans();
            let of = spans
                .filter(|span| span.start_tick <= tick)
                .last()
                .expect("a span");
            of.position((tick - of.start_tick) as f64)[CHANNEL_VOLUME]
        };
        printed
            .map(|mark| volume(mark.end_tick) - volume(mark.start_tick))
            .sum()
    }
}

/// Widths of the built-in ellipse across the travel, mm, and the largest gap in the angles about the middle, degrees.
fn widths_and_gap(poses: &[OraclePose]) -> (Vec<f64>, f64) {
    let middle = |of: fn(&OraclePose) -> f64| {
        let ends = poses.iter().map(of);
        let [low, high] = ends.fold([f64::MAX, f64::MIN], |[low, high], at| {
            [low.min(at), high.max(at)]
        });
        0.5 * (low + high)
    };
    let (x_mm, y_mm) = (middle(|pose| pose.x_mm), middle(|pose| pose.y_mm));
    let mut angles: Vec<f64> = poses
        .iter()
        .map(|pose| (pose.y_mm - y_mm).atan2(pose.x_mm - x_mm).to_degrees())
        .collect();
    angles.sort_by(f64::total_cmp);
    let around = angles[0] + 360.0 - angles[angles.len() - 1];
    let gap = angles
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(around, f64::max);
    let of_one = poses.windows(2).filter(|pair| pair[0].pass == pair[1].pass);
    let widths = of_one.filter_map(|pair| {
        let (dx, dy) = (pair[1].x_mm - pair[0].x_mm, pair[1].y_mm - pair[0].y_mm);
        let off_rad = pair[0].heading_rad - dy.atan2(dx);
        (dx.hypot(dy) > 1e-4).then(|| 2.0 * (0.6 * off_rad.sin()).hypot(0.2 * off_rad.cos()))
    });
    (widths.collect(), gap)
}

/// Share of widths within some, and the gap is closed.
fn assert_ring(followed: &Followed, stop_deg: f64, [low_mm, high_mm]: [f64; 2]) {
    // Half a step of the built-in motor.
    assert!(
        followed.farthest_deg() < stop_deg + 0.02,
        "{}",
        followed.farthest_deg()
    );
    let (widths, gap_deg) = widths_and_gap(&followed.poses());
    let within = widths
        .iter()
        .filter(|width| (low_mm..high_mm).contains(*width))
        .count();
    assert!(
        within as f64 > 0.95 * widths.len() as f64,
        "{within} of {}",
        widths.len()
    );
    assert!(gap_deg < 2.0, "{gap_deg}");
}

fn ring_of_gcode(turns: f64, width_mm: f64) -> String {
    let mut text = "G90\nM83\nG21\n;LAYER_CHANGE\n;HEIGHT:0.2\n;TYPE:Outer wall\n".to_string();
    let _ = writeln!(text, ";WIDTH:{width_mm}\nG0 X112 Y100 Z0.2 F6000");
    for k in 1..=(turns * 48.0) as u32 {
        let (sin, cos) = (TAU * f64::from(k) / 48.0).sin_cos();
        let (x, y) = (100.0 + RADIUS_MM * cos, 100.0 + RADIUS_MM * sin);
        let _ = writeln!(text, "G1 X{x:.3} Y{y:.3} E0.1 F1800");
    }
    text
}

fn ring_of_waypoints(turns: f64, heading: impl Fn(f64) -> String) -> String {
    let points = (0..=(turns * 72.0) as u32).map(|k| {
        let angle = TAU * f64::from(k) / 72.0;
        let (sin, cos) = angle.sin_cos();
        let heading = heading(angle.to_degrees());
        format!(
            "{} {} 0 0 0 1 {heading}\n",
            RADIUS_MM * cos,
            RADIUS_MM * sin
        )
    });
    points.collect()
}

#[test]
fn rings_of_files_are_complete_between_stops() {
    for stop_deg in [100.0, 180.0, 190.0, 200.0, 1e5] {
        let settings = between(stop_deg);
        for turns in [1.0, 1.125] {
            let ring = Followed::gcode(&ring_of_gcode(turns, 0.8), &settings);
            assert_ring(&ring, stop_deg, [0.7, 0.9]);
            // 0.1 mm of filament of 1.75 mm a leg.
            let asked_mm3 = 0.1 * PI * 0.875 * 0.875 * (turns * 48.0).floor();
            let laid_mm3 = ring.volume_mm3();
            assert!(
                (laid_mm3 / asked_mm3 - 1.0).abs() < 0.001,
                "{laid_mm3} of {asked_mm3}"
            );
        }
        let across = Followed::waypoints(&ring_of_waypoints(1.0, |_| String::new()), &settings);
        assert_ring(&across, stop_deg, [1.15, 1.25]);
        // A ring is one turn: stops at half a turn either way ask for no cut.
        assert_eq!(
            across.notes.is_empty(),
            stop_deg >= 180.0,
            "{:?}",
            across.notes
        );
    }
}

/// Goal: headings of a file are met by others that print the same, and passes that turn on are cut seldom. Method:
/// tangential headings over five turns; the pieces' headings against the travel, and cuts by hand: a piece turns by half a
/// turn less than there is room at least, or by all of it.
#[test]
fn headings_of_files_are_met_between_stops() {
    let text = ring_of_waypoints(5.0, |deg| format!("{}", deg + 90.0));
    for (stop_deg, cuts) in [
        (100.0, 9..=10),
        (180.0, 4..=9),
        (270.0, 3..=4),
        (1e5, 0..=0),
    ] {
        let settings = between(stop_deg);
        let followed = Followed::waypoints(&text, &settings);
        // Along the travel: the narrow bead.
        assert_ring(&followed, stop_deg, [0.4, 0.41]);
        let told = followed.notes.iter().find_map(|note| {
            let rest = note.strip_prefix("the nozzle reaches a stop within passes, ")?;
            match rest.split_once(' ')?.0 {
                "once" => Some(1),
                times => times.parse::<usize>().ok(),
            }
        });
        let told = told.unwrap_or_default();
        assert!(cuts.contains(&told), "{stop_deg}: {told} cuts");
    }
}

//! Goal: between two passes the head goes no farther than what is printed asks, and touches nothing.
//! Method: a wall, then ribs leaning on both its sides, planned for the example gantry and table, with
//! the shape of the head and without it. The travels that came out are held against every point printed
//! before by a cone and a cylinder of facets worked out here, one turn of the tool frame each.

use headway::input::ReadOptions;
use headway::input::waypoints::{WaypointRun, read};
use headway::job::MotionState;
use headway::settings::head_shape::HeadOutline;
use headway::settings::{Settings, machine_file};
use headway::{Plan, plan_waypoints};
use nalgebra::{Rotation3, Vector3};
use std::path::Path;

const HEIGHT_MM: f64 = 8.0;
const LENGTH_MM: f64 = 60.0;

fn machine(name: &str) -> Settings {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../examples/machines")
        .join(name);
    machine_file::from_toml(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A wall along x of single lines, up at once; then ribs beside it by turns, leaning away by 30°.
fn wall_and_ribs() -> WaypointRun {
    let mut text = String::new();
    let mut line = |y: f64, z: f64, lean: f64| {
        for step in 0..=120 {
            let x = LENGTH_MM * f64::from(step) / 120.0;
            text += &format!(
                "{x:.4} {y:.4} {z:.4} 0 {:.7} {:.7}\n",
                lean.sin(),
                lean.cos()
            );
        }
    };
    for layer in 0..(HEIGHT_MM / 0.8) as u32 {
        line(0.0, 0.8 * f64::from(layer + 1), 0.0);
    }
    for rib in 0..8 {
        let side = if rib % 2 == 0 { 1.0 } else { -1.0 };
        line(side * 4.0, 1.0 + 0.5 * f64::from(rib / 2), side * 0.5);
    }
    read(text.as_bytes(), "wall and ribs", &ReadOptions::default()).unwrap()
}

fn tip(pose: &[f64; 7]) -> Vector3<f64> {
    Vector3::new(pose[0], pose[1], pose[2])
}

/// Distance of a point from the profile of nozzle and head in the plane of the tool's axis, mm; negative
/// inside. The profile is the polygon that turns about the axis.
fn off_profile_mm(settings: &Settings, height_mm: f64, from_axis_mm: f64) -> f64 {
    let Some(HeadOutline::Cone(head)) = settings.head.as_ref().map(|head| &head.outline) else {
        panic!("the example machines have a cone");
    };
    let wide_mm =
        head.nozzle_tip_radius_mm + head.nozzle_length_mm * (0.5 * head.nozzle_angle_rad).tan();
    let top_mm = head.nozzle_length_mm + head.head_length_mm;
    let profile = [
        [0.0, 0.0],
        [0.0, head.nozzle_tip_radius_mm],
        [head.nozzle_length_mm, wide_mm],
        [head.nozzle_length_mm, head.head_radius_mm],
        [top_mm, head.head_radius_mm],
        [top_mm, 0.0],
    ];
    let mut nearest_mm = f64::INFINITY;
    let mut inside = false;
    for (index, a) in profile.iter().enumerate() {
        let b = profile[(index + 1) % profile.len()];
        let (along, across) = (
            [b[0] - a[0], b[1] - a[1]],
            [height_mm - a[0], from_axis_mm - a[1]],
        );
        let square = along[0] * along[0] + along[1] * along[1];
        let share = ((along[0] * across[0] + along[1] * across[1]) / square).clamp(0.0, 1.0);
        // The axis is no wall.
        if a[1] + b[1] > 0.0 {
            let off = [across[0] - share * along[0], across[1] - share * along[1]];
            nearest_mm = nearest_mm.min(off[0].hypot(off[1]));
        }
        if (a[1] > from_axis_mm) != (b[1] > from_axis_mm) {
            let at = a[0] + (from_axis_mm - a[1]) / (b[1] - a[1]) * along[0];
            inside ^= height_mm < at;
        }
    }
    if inside { -nearest_mm } else { nearest_mm }
}

/// The least distance of nozzle and head from what is printed before, on the way across between passes,
/// and how many passes were crossed between.
fn nearest_across_mm(plan: &Plan, settings: &Settings) -> (f64, usize) {
    let mut printed: Vec<Vector3<f64>> = Vec::new();
    let mut nearest_mm = f64::INFINITY;
    let mut crossings = 0;
    let moves = &plan.route.moves;
    for (index, route_move) in moves.iter().enumerate() {
        let curve = &route_move.curve;
        let looks = |count: usize| {
            (0..=count).map(move |look| {
                curve
                    .evaluate(curve.span_count() as f64 * look as f64 / count as f64)
                    .value
            })
        };
        let is_print = |at: usize| moves.get(at).is_some_and(|m| m.state == MotionState::Print);
        if is_print(index) {
            printed.extend(looks(100).map(|pose| tip(&pose)));
        }
        // Back, across, down and prime come before the next print.
        let is_across = route_move.state == MotionState::Travel
            && moves
                .get(index + 1)
                .is_some_and(|m| m.state == MotionState::Travel)
            && index > 0
            && moves[index - 1].state == MotionState::Travel;
        if !is_across || printed.is_empty() || !moves[index..].iter().any(|m| m.pass.is_some()) {
            continue;
        }
        crossings += 1;
        for pose in looks(200) {
            let upright = Rotation3::new(Vector3::new(pose[3], pose[4], 0.0)).inverse();
            for point in &printed {
                let away = upright * (point - tip(&pose));
                let off_mm = off_profile_mm(settings, away.z, away.xy().norm());
                nearest_mm = nearest_mm.min(off_mm);
            }
        }
    }
    (nearest_mm, crossings)
}

fn travel_mm(plan: &Plan) -> f64 {
    let moves = plan.route.moves.iter();
    let travels = moves.filter(|route_move| route_move.state == MotionState::Travel);
    let legs = travels.flat_map(|route_move| route_move.curve.control.windows(2));
    legs.map(|leg| (tip(&leg[1]) - tip(&leg[0])).norm()).sum()
}

#[test]
fn the_head_crosses_close_to_what_is_printed_and_touches_nothing() {
    for name in ["gantry.toml", "trunnion.toml"] {
        let settings = Settings {
            gap_mm: Some(5.0),
            ..machine(name)
        };
        let run = wall_and_ribs();
        let close = plan_waypoints(&run, &settings).unwrap();
        let unknown = Settings {
            head: None,
            ..settings.clone()
        };
        let around = plan_waypoints(&run, &unknown).unwrap();
        let (nearest_mm, crossings) = nearest_across_mm(&close, &settings);
        println!(
            "{name}: {:.0} mm of travel, {:.0} mm around the ball; {:.1} s, {:.1} s; nearest {nearest_mm:.2} mm",
            travel_mm(&close),
            travel_mm(&around),
            close.motion.duration_s,
            around.motion.duration_s,
        );
        assert_eq!(crossings, 17, "{name}");
        assert!(nearest_mm > 0.4 * settings.lift_mm, "{name}: {nearest_mm}");
        assert!(travel_mm(&close) < travel_mm(&around), "{name}");
        assert!(
            close.motion.duration_s < 0.9 * around.motion.duration_s,
            "{name}"
        );
    }
}

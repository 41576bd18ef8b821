//! Goal: passes tilt as far as they must and no further, all poses are free, and impossible runs are refused.
//! Method: a wall with a tower next to it, judged by the collisions of the finished plan.
use crate::input::ReadOptions;
use crate::input::waypoints::{WaypointRun, read};
use crate::pipeline::{PlanError, plan_waypoints};
use crate::settings::Settings;
use crate::settings::head_shape::{ConeAndCylinder, HeadOutline, HeadShape};

fn settings(tilt_max_deg: Option<f64>) -> Settings {
    let gantry = Settings::gantry();
    Settings {
        head: Some(HeadShape {
            outline: HeadOutline::Cone(ConeAndCylinder {
                nozzle_tip_radius_mm: 0.3,
                nozzle_angle_rad: 60f64.to_radians(),
                nozzle_length_mm: 20.0,
                head_radius_mm: 22.0,
                head_length_mm: 40.0,
            }),
            tip_slack_mm: Some(1.2),
        }),
        tilt_max_rad: tilt_max_deg.map(f64::to_radians),
        layer_height_mm: 0.5,
        ..gantry
    }
}

const LAYER_MM: f64 = 0.5;

struct Text(String);

impl Text {
    fn at(&mut self, [x, y, z]: [f64; 3], [nx, ny, nz]: [f64; 3]) {
        self.0 += &format!("{x:.5} {y:.5} {z:.5} {nx:.9} {ny:.9} {nz:.9}\n");
    }

    fn wall(&mut self, x: f64, height_mm: f64) {
        for layer in 1..=(height_mm / LAYER_MM) as u32 {
            for y in [-30.0, 30.0] {
                self.at([x, y, LAYER_MM * f64::from(layer)], [0.0, 0.0, 1.0]);
            }
        }
    }

    fn run(&self, gap_mm: f64) -> WaypointRun {
        let mut run = read(self.0.as_bytes(), "run", &ReadOptions::default()).unwrap();
        // Jumps of that length end a pass: each layer of a wall is one.
        for index in 1..run.points.len() {
            let step = run.points[index].tip_mm - run.points[index - 1].tip_mm;
            run.points[index].begins = step.z.abs() > 1e-6 || step.norm() > gap_mm;
        }
        run
    }
}

/// A tower of four lines a layer beside what was printed before.
fn tower(text: &mut Text, height_mm: f64) {
    for layer in 1..=(height_mm / LAYER_MM) as u32 {
        let z = LAYER_MM * f64::from(layer);
        for (line, ends) in [[-6.0, 6.0], [6.0, -6.0], [-6.0, 6.0], [6.0, -6.0]]
            .iter()
            .enumerate()
        {
            for y in ends {
                text.at([1.2 * line as f64, *y, z], [0.0, 0.0, 1.0]);
            }
        }
    }
}

#[test]
fn a_tower_beside_a_wall_leans_away() {
    let mut text = Text(String::new());
    text.wall(-6.0, 30.0);
    let first = text.0.lines().count();
    tower(&mut text, 30.0);
    let run = text.run(20.0 + 60.0);
    let upright = plan_waypoints(&run, &settings(None)).unwrap();
    assert!(upright.touches.unwrap().touched_mm > 100.0);
    assert_eq!(upright.leaned, None);

    let plan = plan_waypoints(&run, &settings(Some(60.0))).unwrap();
    let touches = plan.touches.as_ref().unwrap();
    assert_eq!(touches.deepest, [], "{touches:?}");
    let leaned = plan.leaned.as_ref().unwrap();
    let lean_deg = leaned.lean_max_rad.to_degrees();
    assert!((10.0..45.0).contains(&lean_deg), "{lean_deg}");
    // The wall itself stays as it was asked for; a lean changes by little from layer to layer.
    let axes: Vec<_> = leaned.run.points.iter().map(|point| point.axis).collect();
    assert!(axes[..first].iter().all(|axis| axis.z == 1.0));
    let steps = axes[first..]
        .windows(2)
        .map(|pair| pair[0].angle(&pair[1]).to_degrees());
    let most_deg = steps.fold(0.0, f64::max);
    // A degree for 0.2 mm of height.
    assert!(most_deg < LAYER_MM / 0.2, "{most_deg}");
}

#[test]
fn a_lean_follows_axes_that_change_along_a_pass() {
    let mut text = Text(String::new());
    for step in 0..=800 {
        let angle = 0.25 * f64::from(step);
        text.at(
            [
                1.5 * angle.cos(),
                1.5 * angle.sin(),
                0.5 + 0.05 * f64::from(step),
            ],
            [0.0, 0.0, 1.0],
        );
    }
    let first = text.0.lines().count();
    // A ring about the post, its axes leaning in by 20°.
    for step in 0..=120 {
        let angle = std::f64::consts::TAU * f64::from(step) / 120.0;
        let (sin, cos) = angle.sin_cos();
        let lean = 20f64.to_radians();
        text.at(
            [12.0 * cos, 12.0 * sin, 3.0],
            [-cos * lean.sin(), -sin * lean.sin(), lean.cos()],
        );
    }
    let mut run = text.run(1e9);
    run.points.iter_mut().for_each(|point| point.begins = false);
    run.points[first].begins = true;
    let upright = plan_waypoints(&run, &settings(None)).unwrap();
    assert!(upright.touches.unwrap().touched_mm > 30.0);
    let plan = plan_waypoints(&run, &settings(Some(60.0))).unwrap();
    let touches = plan.touches.as_ref().unwrap();
    assert_eq!(touches.deepest, [], "{touches:?}");
    let leaned = plan.leaned.as_ref().unwrap();
    assert_eq!(leaned.passes, [1, 2]);
    // The way is smooth: 3° of ring a waypoint, the axis turns by about as much.
    let axes: Vec<_> = leaned.run.points[first..]
        .iter()
        .map(|point| point.axis)
        .collect();
    let turns = axes
        .windows(2)
        .map(|pair| pair[0].angle(&pair[1]).to_degrees());
    let most_deg = turns.fold(0.0, f64::max);
    assert!(most_deg < 4.0, "{most_deg}");
}

#[test]
fn a_gap_without_a_free_axis_is_refused_with_the_place() {
    let mut text = Text(String::new());
    text.wall(-4.0, 40.0);
    text.wall(8.0, 40.0);
    let walls = text.0.lines().count();
    tower(&mut text, 1.0);
    let error = plan_waypoints(&text.run(80.0), &settings(Some(60.0))).unwrap_err();
    let PlanError::Refused(refused) = error else {
        panic!("{error}");
    };
    // line {line}: with the tip at (x, y, z) mm there is ... in the way is earlier print near (x, y, z) mm
    let text = refused.to_string();
    let numbers = |behind: &str| -> Vec<f64> {
        let rest = text.split_once(behind).expect(&text).1;
        let ends = |c: char| !(c.is_ascii_digit() || ", .-".contains(c));
        let numbers = rest.split(ends).next().unwrap().split(", ");
        numbers.map(|n| n.parse().expect(&text)).collect()
    };
    assert!(numbers("line ")[0] > walls as f64, "{text}");
    let (at_mm, by_mm) = (
        numbers("with the tip at ("),
        numbers("earlier print near ("),
    );
    assert!(
        (0.0..=3.6).contains(&at_mm[0]) && (at_mm[2] - 0.5).abs() < 1e-9,
        "{text}"
    );
    assert!(by_mm[0] == -4.0 || by_mm[0] == 8.0, "{text}");

    // A cone of a waypoint's own is kept.
    let mut text = Text(String::new());
    text.wall(-6.0, 30.0);
    tower(&mut text, 2.0);
    let mut run = text.run(80.0);
    run.points
        .iter_mut()
        .for_each(|point| point.cone_rad = Some(0.01));
    let error = plan_waypoints(&run, &settings(Some(60.0)))
        .unwrap_err()
        .to_string();
    assert!(error.contains("within 0.6°"), "{error}");
}

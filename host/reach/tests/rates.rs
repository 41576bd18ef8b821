//! Speed of finding collisions and free axes: `cargo test --release -p headway-reach -- --ignored --nocapture`. Times
//! of one machine alone mean little, so brute force over the same points is measured in the same execution.

use headway_reach::free_axes::{Cap, Place, nearest_free};
use headway_reach::profile::HeadProfile;
use headway_reach::standing::{Point, Standing};
use headway_reach::touch::Head;
use headway_reach::{Pose, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::time::Instant;

/// A wall of 60 x 2.4 x 40 mm and a tower of 12 x 12 x 50 mm beside it, each layer in lines.
fn wall_and_tower() -> (Vec<Point>, usize) {
    let mut points = Vec::new();
    let mut line = |x: f64, half_mm: f64, z: f64| {
        let count = (half_mm / 0.2) as i32;
        for k in -count..=count {
            points.push(Point {
                at_mm: Vector3::new(x, 0.2 * f64::from(k), z),
                half_width_mm: 0.4,
                normal: Vector3::z(),
            });
        }
        points.len()
    };
    let mut wall = 0;
    for layer in 1..=200 {
        for k in 0..3 {
            wall = line(-6.0 - 0.8 * f64::from(k), 30.0, 0.2 * f64::from(layer));
        }
    }
    for layer in 1..=250 {
        for k in 0..16 {
            line(0.8 * f64::from(k), 6.0, 0.2 * f64::from(layer));
        }
    }
    (points, wall)
}

#[test]
#[ignore = "prints rates"]
fn rates_of_touches_and_free_axes() {
    let (points, wall) = wall_and_tower();
    let knots = [[0.0, 0.3], [20.0, 11.847], [20.0, 22.0], [60.0, 22.0]];
    let profile = HeadProfile::new(&knots).unwrap();
    let head = Head {
        profile: &profile,
        slack_mm: 0.6,
    };
    let begun = Instant::now();
    let standing = Standing::new(&points);
    println!(
        "{} points, tree {:.3} s",
        points.len(),
        begun.elapsed().as_secs_f64()
    );
    let mut random = Pcg64Mcg::seed_from_u64(1);
    for tilt_deg in [0.0f64, 15.0, 30.0, 45.0, 60.0] {
        let poses: Vec<(Pose, usize)> = (0..100_000)
            .map(|_| {
                let before = random.random_range(1..points.len());
                let around: f64 = random.random_range(0.0..std::f64::consts::TAU);
                let (sin, cos) = tilt_deg.to_radians().sin_cos();
                let axis = Vector3::new(sin * around.cos(), sin * around.sin(), cos);
                let tip_mm = points[before].at_mm;
                (Pose { tip_mm, axis }, before)
            })
            .collect();
        let begun = Instant::now();
        let touching = poses
            .iter()
            .filter(|(pose, before)| head.any(&standing, pose, *before).is_some());
        let touching = touching.count();
        let tree_s = begun.elapsed().as_secs_f64() / poses.len() as f64;
        let begun = Instant::now();
        let brute = poses[..200].iter().filter(|(pose, before)| {
            let held = points[..*before].iter().filter(|point| {
                let seen = pose.seen(&point.at_mm);
                seen[0] > head.slack_mm && seen[1] < profile.radius_mm(seen[0])
            });
            held.count() > 0
        });
        let brute = brute.count();
        let brute_s = begun.elapsed().as_secs_f64() / 200.0;
        assert!(brute <= 200);
        println!(
            "{tilt_deg:2.0}°: {:.1} % touch, {:.0} poses a second, {:.0} times brute force",
            touching as f64 / 1000.0,
            1.0 / tree_s,
            brute_s / tree_s
        );
    }
    let cone = [Cap {
        axis: Vector3::z(),
        angle_rad: 60f64.to_radians(),
    }];
    let places: Vec<Place> = (wall..points.len())
        .step_by(31)
        .map(|before| Place {
            tip_mm: points[before].at_mm,
            before,
        })
        .collect();
    let begun = Instant::now();
    let mut none = 0;
    for place in &places {
        let axis = nearest_free(&head, &standing, &[*place], Vector3::z(), &cone);
        none += usize::from(axis.is_none());
    }
    let each_s = begun.elapsed().as_secs_f64() / places.len() as f64;
    println!(
        "{} nearest free axes, {none} without, {:.0} a second",
        places.len(),
        1.0 / each_s
    );
}

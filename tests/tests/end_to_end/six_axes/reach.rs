//! Goal: what a head touches, where it may go between two poses and the nearest free axis are exact. Method: brute
//! force over all points with a formula of its own (the head as facets of its outline, turned about the axis), and a
//! net of axes. The jobs: a block of lines, a spiral vase, a wall with a tower beside it, and random lines.

use headway::reach::free_axes::{Cap, Place, nearest_free};
use headway::reach::profile::HeadProfile;
use headway::reach::standing::{Point, Standing};
use headway::reach::touch::Head;
use headway::reach::{Pose, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// A head: height and radius of its edges, and what its tip may dip, mm.
struct Outline {
    edges: [[f64; 2]; 4],
    slack_mm: f64,
}

/// The example gantry's head: a cone of 60° and 20 mm, a cylinder of 22 mm.
const GANTRY: Outline = Outline {
    edges: [[0.0, 0.8], [20.0, 12.347], [20.0, 22.0], [60.0, 22.0]],
    slack_mm: 0.1,
};
/// The same with a slim tip, and a slack to lean over flat layers.
const SLIM: Outline = Outline {
    edges: [[0.0, 0.3], [20.0, 11.847], [20.0, 22.0], [60.0, 22.0]],
    slack_mm: 0.6,
};

fn lines(from: [f64; 3], to: [f64; 3], half_width_mm: f64) -> impl Iterator<Item = Point> {
    let [from, to] = [from, to].map(Vector3::from);
    let count = ((to - from).norm() / 0.5).ceil();
    (0..=count as u32).map(move |k| Point {
        at_mm: from + (to - from) * (f64::from(k) / count),
        half_width_mm,
        normal: Vector3::z(),
    })
}

fn block() -> Vec<Point> {
    let rows = (1..=40).flat_map(|layer| (0..12).map(move |row| (layer, row)));
    rows.flat_map(|(layer, row)| {
        let (y, z) = (0.8 * f64::from(row), 0.2 * f64::from(layer));
        lines([0.0, y, z], [20.0, y, z], 0.4)
    })
    .collect()
}

fn vase() -> Vec<Point> {
    let turn = |k: u32| {
        let angle = 0.05 * f64::from(k);
        let radius = 12.0 + 6.0 * (0.02 * angle).sin();
        let at_mm = Vector3::new(
            radius * angle.cos(),
            radius * angle.sin(),
            0.3 * angle / TAU,
        );
        Point {
            at_mm,
            half_width_mm: 0.3,
            normal: Vector3::z(),
        }
    };
    (0..16_000).map(turn).collect()
}

/// A wall of three lines, 40 mm high, and the tower beside it; how many points are the wall's.
fn wall_and_tower(gap_mm: f64) -> (Vec<Point>, usize) {
    let mut points: Vec<Point> = Vec::new();
    for layer in 1..=200 {
        for line in 0..3 {
            let (x, z) = (-gap_mm - 0.8 * f64::from(line), 0.2 * f64::from(layer));
            points.extend(lines([x, -30.0, z], [x, 30.0, z], 0.4));
        }
    }
    let wall = points.len();
    for layer in 1..=250 {
        for line in 0..8 {
            let (x, z) = (1.6 * f64::from(line), 0.2 * f64::from(layer));
            points.extend(lines([x, -6.0, z], [x, 6.0, z], 0.4));
        }
    }
    (points, wall)
}

fn scatter(random: &mut Pcg64Mcg) -> Vec<Point> {
    let mut corner = || [0; 3].map(|_| random.random_range(-30.0..30.0));
    let ends: Vec<[[f64; 3]; 2]> = (0..300).map(|_| [corner(), corner()]).collect();
    ends.into_iter()
        .flat_map(|[from, to]| lines(from, to, 0.25))
        .collect()
}

/// The head holds a point: in the half plane through axis and point, right of no facet of the outline.
fn holds(head: &Outline, pose: &Pose, point: &Point) -> bool {
    // The middle, and the place of the flat disc about it that lies nearest to the tip's foot.
    let foot = pose.tip_mm - point.normal * (pose.tip_mm - point.at_mm).dot(&point.normal);
    let way = foot - point.at_mm;
    let edge = point.at_mm + way * (point.half_width_mm / way.norm().max(1e-300)).min(1.0);
    holds_place(head, pose, point.at_mm) || holds_place(head, pose, edge)
}

fn holds_place(head: &Outline, pose: &Pose, place_mm: Vector3) -> bool {
    let from_axis_mm = pose.axis.cross(&(place_mm - pose.tip_mm)).norm();
    let height_mm = (place_mm - pose.tip_mm).dot(&pose.axis);
    height_mm > head.slack_mm
        && head.edges.windows(2).any(|facet| {
            let [[low, narrow], [high, wide]] = [facet[0], facet[1]];
            let share = (height_mm - low) / (high - low);
            (0.0..=1.0).contains(&share) && from_axis_mm < narrow + share * (wide - narrow)
        })
}

fn tilted(tilt_rad: f64, around_rad: f64) -> Vector3 {
    let (sin, cos) = tilt_rad.sin_cos();
    Vector3::new(sin * around_rad.cos(), sin * around_rad.sin(), cos)
}

fn check_poses(count: usize) {
    let profile = HeadProfile::new(&GANTRY.edges).unwrap();
    let head = Head {
        profile: &profile,
        slack_mm: GANTRY.slack_mm,
    };
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let jobs = [block(), vase(), wall_and_tower(6.0).0, scatter(&mut random)];
    let mut touching = 0;
    for points in &jobs {
        let standing = Standing::new(points);
        for tilt_deg in [0.0f64, 30.0, 60.0] {
            for _ in 0..count {
                let before = random.random_range(0..points.len());
                let pose = Pose {
                    tip_mm: points[before].at_mm,
                    axis: tilted(tilt_deg.to_radians(), random.random_range(0.0..TAU)),
                };
                let brute = points[..before]
                    .iter()
                    .any(|point| holds(&GANTRY, &pose, point));
                let found = head.any(&standing, &pose, before);
                assert_eq!(found.is_some(), brute, "{pose:?} before {before}");
                assert!(found.is_none_or(|order| order < before && holds(&GANTRY, &pose, &points[order])));
                touching += usize::from(brute);

                // A short motion: where it is said to be clear nothing on the way touches.
                let mut step = || random.random_range(-0.3..0.3);
                let to = Pose {
                    tip_mm: pose.tip_mm + Vector3::new(step(), step(), step()),
                    axis: (pose.axis + 0.2 * Vector3::new(step(), step(), step())).normalize(),
                };
                if !brute && head.is_clear_between(&standing, [&pose, &to], before) {
                    for k in 1..=8 {
                        let share = f64::from(k) / 8.0;
                        let between = Pose {
                            tip_mm: pose.tip_mm.lerp(&to.tip_mm, share),
                            axis: pose.axis.lerp(&to.axis, share).normalize(),
                        };
                        let hit = points[..before]
                            .iter()
                            .any(|point| holds(&GANTRY, &between, point));
                        assert!(!hit, "{pose:?} to {to:?} before {before}");
                    }
                }
            }
        }
    }
    // The jobs are hard: a good part of the poses touches, and a good part does not.
    let all = 12 * count;
    assert!(
        (all / 10..all * 9 / 10).contains(&touching),
        "{touching} of {all}"
    );
}

#[test]
fn touches_are_those_of_brute_force() {
    check_poses(40);
}

/// As a user would hear of it: `cargo test -p headway-tests --test end_to_end -- --ignored touches_of_15_000`.
#[test]
#[ignore = "15,000 poses against all points take minutes"]
fn touches_of_15_000_poses_are_those_of_brute_force() {
    check_poses(1250);
}

fn check_axes(gaps_mm: &[f64], step: usize) {
    let profile = HeadProfile::new(&SLIM.edges).unwrap();
    let head = Head {
        profile: &profile,
        slack_mm: SLIM.slack_mm,
    };
    let cone = Cap {
        axis: Vector3::z(),
        angle_rad: 60f64.to_radians(),
    };
    for &gap_mm in gaps_mm {
        let (points, wall) = wall_and_tower(gap_mm);
        let standing = Standing::new(&points);
        let (mut upright, mut leaning) = (0, 0);
        for before in (wall..points.len()).step_by(step) {
            let place = Place {
                tip_mm: points[before].at_mm,
                before,
            };
            let axis = nearest_free(&head, &standing, &[place], Vector3::z(), &[cone])
                .unwrap_or_else(|| panic!("no free axis at {place:?}"));
            let is_free = |axis: Vector3| {
                let tip_mm = place.tip_mm;
                let pose = Pose { tip_mm, axis };
                !points[..before]
                    .iter()
                    .any(|point| holds(&SLIM, &pose, point))
            };
            assert!(is_free(axis), "{axis} at {place:?}");
            let tilt_rad = axis.angle(&Vector3::z());
            leaning += usize::from(tilt_rad > 1e-9);
            upright += usize::from(tilt_rad <= 1e-9);
            // None of a ring half a degree nearer, or of one half as far, is free; below a microradian rounding is.
            for nearer_rad in [tilt_rad - 0.5f64.to_radians(), 0.5 * tilt_rad] {
                if nearer_rad > 1e-6 {
                    for k in 0..48 {
                        let other = tilted(nearer_rad, TAU * f64::from(k) / 48.0);
                        assert!(
                            !is_free(other),
                            "{other} is nearer than {axis} at {place:?}"
                        );
                    }
                }
            }
        }
        assert!(
            upright > 0 && leaning > 0,
            "gap {gap_mm}: {upright}, {leaning}"
        );
    }
}

#[test]
fn no_axis_is_nearer_than_the_nearest_free_one() {
    check_axes(&[6.0], 2503);
}

/// `cargo test -p headway-tests --test end_to_end -- --ignored no_axis_is_nearer`.
#[test]
#[ignore = "thousands of places against all points take minutes"]
fn no_axis_is_nearer_at_any_place_of_three_gaps() {
    check_axes(&[4.0, 6.0, 10.0], 97);
}

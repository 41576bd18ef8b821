//! Goal: a wall about as wide as a whole number of beads has no more passes than beads, whatever the last micrometres of
//! its width are. Method: tubes and the section of a vase with walls around one to four of the widest beads, from far
//! below to far above and more densely towards the whole number; passes are counted. Around three and four beads by name.

use headway::geometry::Point2;
use headway::geometry::aperture::Aperture;
use headway::geometry::polygon::{Region, Ring};
use headway::input::Target;
use headway::plan_target;
use headway::settings::{PassMode, Settings};
use std::f64::consts::TAU;

/// Farthest from the whole number of beads, of a bead.
const AWAY: f64 = 0.05;
const RADIUS_MM: f64 = 20.0;

/// The outline of a wall: its centre line is a circle with `lobes` bulges, its sides are chords of `count` points.
fn wall(width_mm: f64, count: u32, lobes: f64) -> Target {
    let ring = |inside_mm: f64, turn: f64| {
        let point = |i: u32| {
            let angle = turn * TAU * f64::from(i) / f64::from(count);
            let radius = RADIUS_MM * (1.0 + 0.08 * (lobes * angle).cos());
            let slope = -RADIUS_MM * 0.08 * lobes * (lobes * angle).sin();
            let (sin, cos) = angle.sin_cos();
            let along =
                nalgebra::Vector2::new(slope * cos - radius * sin, slope * sin + radius * cos);
            let along = along.normalize();
            Point2::new(radius * cos, radius * sin)
                + nalgebra::Vector2::new(-along.y, along.x) * inside_mm
        };
        Ring {
            points: (0..count).map(point).collect(),
        }
    };
    Target {
        name: "wall".to_string(),
        regions: vec![Region {
            exterior: ring(0.0, 1.0),
            holes: vec![ring(width_mm, -1.0)],
        }],
    }
}

/// Counts the passes of walls of `widths` widths around each number of beads.
fn sweep(
    widths: u32,
    (count, lobes): (u32, f64),
    (major_mm, minor_mm): (f64, f64),
    pass_mode: PassMode,
    beads_max: u32,
) {
    let settings = Settings {
        aperture: Aperture::Ellipse { major_mm, minor_mm },
        pass_mode,
        ..Settings::default()
    };
    for beads in 1..=beads_max {
        let mut most = (0, 0.0);
        for step in 0..widths {
            let away = 2.0 * f64::from(step) / f64::from(widths - 1) - 1.0;
            let width_mm = 2.0 * major_mm * (f64::from(beads) + AWAY * away.powi(3));
            let plan = plan_target(&wall(width_mm, count, lobes), &settings).expect("a plan");
            let passes = plan.figures.passes;
            if passes > most.0 {
                most = (passes, width_mm);
            }
        }
        println!(
            "{count} sides, {lobes} lobes, {pass_mode:?}: {beads} beads, at most {most:?} passes"
        );
        assert!(most.0 <= beads as usize, "{beads} beads: {most:?}");
    }
}

#[test]
fn a_wall_has_no_more_passes_than_beads() {
    sweep(5, (128, 0.0), (1.0, 0.3), PassMode::One, 1);
    sweep(5, (90, 5.0), (0.6, 0.2), PassMode::Two, 2);
}

#[test]
#[ignore = "minutes: cargo test -p headway-tests --test end_to_end -- --ignored forty_widths"]
fn forty_widths_around_each_number_of_beads() {
    for (major_mm, minor_mm, pass_mode) in [(1.0, 0.3, PassMode::One), (0.6, 0.2, PassMode::Two)] {
        for count in [64, 128, 257] {
            sweep(40, (count, 0.0), (major_mm, minor_mm), pass_mode, 4);
        }
    }
    sweep(40, (90, 5.0), (0.6, 0.2), PassMode::Two, 4);
}

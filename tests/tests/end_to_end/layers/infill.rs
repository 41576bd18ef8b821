//! Goal: walls with lines inside: the lines cover the share that was asked, the walls all of their
//! band, nothing leaves the outline; a brim covers its own ring. Method: the finished segments by the layer oracle, which knows
//! only the knots; windows of the plate in which the share follows from the spacing alone.

use headway::geometry::Point2;
use headway::geometry::polygon::{Region, Ring};
use headway::input::Target;
use headway::settings::{Infill, Settings};
use headway::{Plan, plan_target};
use headway_tests::layer_oracle::{Rings, print_poses, sweep};

const AXES_MM: [f64; 2] = [0.6, 0.2];

fn rectangle(low: [f64; 2], high: [f64; 2]) -> Vec<[f64; 2]> {
    vec![low, [high[0], low[1]], high, [low[0], high[1]]]
}

fn target(points: &[[f64; 2]]) -> Target {
    let exterior = Ring {
        points: points.iter().copied().map(Point2::from).collect(),
    };
    Target {
        name: "part".to_string(),
        regions: vec![Region {
            exterior,
            holes: Vec::new(),
        }],
    }
}

/// A plate of 40 x 30 mm about the origin.
fn planned(density_pct: f64, angle_deg: f64) -> (Plan, Settings) {
    let target = target(&rectangle([-20.0, -15.0], [20.0, 15.0]));
    let settings = Settings {
        infill: Some(Infill {
            density_pct,
            angle_rad: angle_deg.to_radians(),
            ..Infill::solid(2)
        }),
        ..Settings::default()
    };
    let plan = plan_target(&target, &settings).expect("a plan");
    (plan, settings)
}

fn covered(plan: &Plan, rings: &Rings) -> (f64, f64) {
    let offset = [plan.transform.offset_mm[0], plan.transform.offset_mm[1]];
    let poses = print_poses(&plan.stream, offset, 0.03);
    let found = sweep(rings, &poses, AXES_MM, 0.02);
    (found.covered_pct, found.outside_depth_mm)
}

#[test]
fn lines_cover_the_share_that_was_asked() {
    for density_pct in [25.0, 50.0] {
        for angle_deg in [0.0, 90.0] {
            let (plan, _) = planned(density_pct, angle_deg);
            // Whole numbers of the spacings 4.8 and 2.4 mm.
            let window = vec![rectangle([-9.6, -9.6], [9.6, 9.6])];
            let (share, _) = covered(&plan, &window);
            // The raster: 0.02 mm on either flank of a bead of 1.2 mm.
            assert!(
                (share - density_pct).abs() < 0.02 * density_pct,
                "{density_pct} % at {angle_deg}°: {share}"
            );
            let whole = plan.infill_area_mm2(None).expect("ground for lines");
            // Two walls of 15 mm / 13 beads all round.
            let left_mm2 = (40.0 - 60.0 / 13.0) * (30.0 - 60.0 / 13.0);
            assert!((whole[0] - left_mm2).abs() < 10.0, "{}", whole[0]);
        }
    }
}

#[test]
fn walls_cover_their_band_and_nothing_leaves_the_outline() {
    let (plan, _) = planned(20.0, 45.0);
    let outline = rectangle([-20.0, -15.0], [20.0, 15.0]);
    let inner = rectangle([-17.75, -12.75], [17.75, 12.75]);
    let (share, _) = covered(&plan, &vec![outline.clone(), inner]);
    // The four corners, which no aperture reaches, and the waves of the inner edge.
    assert!(share > 98.0, "{share}");
    let (_, outside_mm) = covered(&plan, &vec![outline]);
    assert!(outside_mm < 0.002, "{outside_mm}");
}

/// The tip of a line moves along the infill's angle, the major axis across it; lines are linked, solid
/// and sparse, so that one interruption does for many rows.
#[test]
fn a_solid_inside_is_covered_by_lines_across_their_travel() {
    let (plan, settings) = planned(100.0, 30.0);
    let outline = rectangle([-20.0, -15.0], [20.0, 15.0]);
    let (share, outside_mm) = covered(&plan, &vec![outline]);
    println!(
        "{share} % covered, {} % again, {} passes",
        plan.figures.overlap_pct, plan.figures.passes
    );
    assert!(share > 98.5, "{share}");
    assert!(outside_mm < 0.002, "{outside_mm}");
    assert!(plan.figures.passes <= 6, "{}", plan.figures.passes);
    let along = 30.0_f64.to_radians();
    let (sparse, _) = planned(50.0, 30.0);
    // What joins them along the walls is none of the lines.
    let (mut passes, mut lines_mm, mut whole_mm, mut joins_mm) = (0, 0.0, 0.0, 0.0);
    for pass in &sparse.regions()[0].passes {
        if !pass.kind.is_line() {
            continue;
        }
        passes += 1;
        for pair in pass.placements.windows(2) {
            let way = pair[1].at.center - pair[0].at.center;
            let off_rad = settings.aperture.wrapped_rad(way.y.atan2(way.x) - along);
            if off_rad.abs() > 0.02 {
                joins_mm += way.norm();
                continue;
            }
            lines_mm += way.norm();
            let across = settings
                .aperture
                .extent_mm(pair[0].at.heading_rad, across_of(along));
            // Next to a way along the wall the nozzle begins to turn before the line ends.
            if across > 0.58 {
                whole_mm += way.norm();
            }
        }
    }
    assert!(whole_mm > 0.9 * lines_mm, "{whole_mm} of {lines_mm} mm");
    println!("{passes} passes, {lines_mm} mm of lines, {joins_mm} mm between them");
    assert!((1..=4).contains(&passes), "{passes}");
    // Rows 2.4 mm apart over 35.4 x 25.4 mm, less their ends.
    assert!(lines_mm > 300.0, "{lines_mm}");
    assert!(joins_mm < 0.25 * lines_mm, "{joins_mm}");
}

fn across_of(along_rad: f64) -> headway::geometry::Vector2 {
    headway::geometry::Vector2::new(-along_rad.sin(), along_rad.cos())
}

/// A plate with four round holes, a slot and a notch: lines of a sparse infill are joined into few passes, at every spacing,
/// and still cover their share.
#[test]
fn sparse_lines_around_holes_are_joined() {
    let outline = [
        [0.0, 0.0],
        [70.0, 0.0],
        [70.0, 30.0],
        [45.0, 30.0],
        [45.0, 50.0],
        [70.0, 50.0],
        [70.0, 80.0],
        [0.0, 80.0],
    ];
    let round = |x_mm: f64, y_mm: f64, radius_mm: f64| {
        let points = (0..40).map(|i| {
            let turn_rad = -f64::from(i) / 40.0 * std::f64::consts::TAU;
            Point2::new(
                x_mm + radius_mm * turn_rad.cos(),
                y_mm + radius_mm * turn_rad.sin(),
            )
        });
        Ring {
            points: points.collect(),
        }
    };
    let slot = [[20.0, 30.0], [20.0, 55.0], [26.0, 55.0], [26.0, 30.0]];
    let mut part = target(&outline);
    part.regions[0].holes = vec![
        round(10.0, 10.0, 4.0),
        round(60.0, 15.0, 5.0),
        round(10.0, 70.0, 4.0),
        Ring {
            points: slot.into_iter().map(Point2::from).collect(),
        },
    ];
    for (density_pct, most) in [(10.0, 3), (15.0, 5), (25.0, 3)] {
        let settings = Settings {
            infill: Some(Infill {
                density_pct,
                ..Infill::solid(2)
            }),
            ..Settings::default()
        };
        let plan = plan_target(&part, &settings).expect("a plan");
        let passes = plan.regions().iter().flat_map(|region| &region.passes);
        let lines: Vec<f64> = passes
            .filter(|pass| pass.kind.is_line())
            .map(|pass| pass.length_mm())
            .collect();
        println!("{density_pct} %: {lines:.0?}");
        // Of 15, 22 and 39 lines; with neighbours alone a wall's ends are joined in one of two ways.
        assert!(lines.len() <= most, "{density_pct} %: {lines:?}");
        // Ground of 4,400 mm² at a line every 1.2 mm / density, less their ends.
        let expected_mm = 4400.0 * density_pct / 100.0 / 1.2;
        let laid_mm: f64 = lines.iter().sum();
        assert!(laid_mm > 0.85 * expected_mm, "{laid_mm} of {expected_mm}");
    }
}

/// An L whose arms are 7.4 mm wide: two walls leave strips of 2.5 mm, too narrow for lines at 45°.
#[test]
fn narrow_ground_is_filled_in_loops() {
    let l = [
        [0.0, 0.0],
        [30.0, 0.0],
        [30.0, 7.4],
        [7.4, 7.4],
        [7.4, 25.0],
        [0.0, 25.0],
    ];
    let settings = Settings {
        infill: Some(Infill::solid(2)),
        ..Settings::default()
    };
    let plan = plan_target(&target(&l), &settings).expect("a plan");
    let (share, outside_mm) = covered(&plan, &vec![l.to_vec()]);
    assert!(share > 99.0, "{share}");
    assert!(outside_mm < 0.002, "{outside_mm}");
    let passes = &plan.regions()[0].passes;
    assert!(passes.iter().all(|pass| !pass.kind.is_line()));
    assert!(plan.infill_area_mm2(None).is_some());
}

/// A brim lies around the part and against it, and counts for nothing in the part's own figures.
/// The oracle sweeps a ring about the part: what the brim covers of it.
#[test]
fn a_brim_covers_its_ring_and_not_the_figures() {
    let plate = rectangle([-8.0, -6.0], [8.0, 6.0]);
    let bare = plan_target(&target(&plate), &Settings::default()).expect("a plan");
    let mut settings = Settings::default();
    settings.skirt.brim_loops = 2;
    let brimmed = plan_target(&target(&plate), &settings).expect("a plan");
    // The corners of the brim are round: a cross of four sides.
    for side in [
        rectangle([-7.0, -8.4], [7.0, -6.0]),
        rectangle([8.0, -5.0], [10.4, 5.0]),
    ] {
        let (share, _) = covered(&brimmed, &vec![side]);
        assert!(share > 98.5, "{share}");
    }
    let (with, without) = (&brimmed.figures, &bare.figures);
    assert!((with.covered_pct - without.covered_pct).abs() < 0.2);
    assert!(with.outside_depth_mm < 0.002);
    assert!((with.area_mm2 - 192.0).abs() < 1e-6);
    // Once around at 0.6 mm, once at 1.8 mm.
    let around_mm = 2.0 * 56.0 + std::f64::consts::TAU * (0.6 + 1.8);
    assert!((with.skirt_mm - around_mm).abs() < 6.0, "{}", with.skirt_mm);
    assert_eq!(without.skirt_mm, 0.0);
}

//! Goal: a mesh interpolates its points and is near a smooth bed, a job over it is the same curve lifted
//! by the bed's height, and invalid input is refused with its key or its place. Method: beds by formula,
//! the plan and the lifted plan evaluated at many times, hostile files.
use super::surface::POINTS_MIN;
use super::*;
use crate::drive::plan_curve::{PlanCursor, stream_ticks};
use crate::drive::test_streams::spiral;
use crate::settings::Settings;
use headway_protocol::segment::{FlowAction, FlowEvent, Knot};
use headway_protocol::units::{CHANNELS, Ticks, Units};

fn mesh(points: [usize; 2], bed: impl Fn(f64, f64) -> f64) -> BedMesh {
    let (min_mm, max_mm) = ([20.0, 10.0], [220.0, 190.0]);
    let at = |axis: usize, number: usize| {
        let share = number as f64 / (points[axis] - 1) as f64;
        min_mm[axis] + share * (max_mm[axis] - min_mm[axis])
    };
    let rows = (0..points[1]).map(|row| {
        let columns = 0..points[0];
        columns
            .map(|column| bed(at(0, column), at(1, row)))
            .collect()
    });
    BedMesh {
        machine_hash: Settings::default().machine.hash(),
        min_mm,
        max_mm,
        heights_mm: rows.collect(),
        fade_start_mm: FADE_START_MM,
        fade_height_mm: FADE_HEIGHT_MM,
    }
}

/// A quarter of a millimetre of warp.
fn warped(x: f64, y: f64) -> f64 {
    0.05 + 0.1 * (x / 45.0).sin() * (y / 60.0).cos() + 0.0004 * (x - y)
}

#[test]
fn the_surface_goes_through_its_points_and_near_a_smooth_bed() {
    let plane = |x: f64, y: f64| 0.3 - 0.002 * x + 0.001 * y;
    let bowl = |x: f64, y: f64| 1e-5 * ((x - 90.0) * (x - 90.0) + (y - 70.0) * (y - 120.0));
    for (bed, points, off_mm) in [
        (&plane as &dyn Fn(f64, f64) -> f64, [3, 3], 1e-12),
        // A parabola is met exactly, to its edges.
        (&bowl, [3, 4], 1e-12),
        // Third order: an eighth for half the grid.
        (&warped, [9, 9], 0.006),
        (&warped, [17, 17], 0.0008),
    ] {
        let mesh = mesh(points, bed);
        let mut worst = 0.0f64;
        for i in 0..=60 {
            for j in 0..=60 {
                let (x, y) = (
                    20.0 + 200.0 * f64::from(i) / 60.0,
                    10.0 + 3.0 * f64::from(j),
                );
                worst = worst.max((mesh.height_mm(x, y) - bed(x, y)).abs());
            }
        }
        assert!(worst <= off_mm, "{points:?}: {worst}");
        for (row, heights) in mesh.heights_mm.iter().enumerate() {
            let y = 10.0 + 180.0 * row as f64 / (points[1] - 1) as f64;
            let corner = [heights[0], heights[points[0] - 1]];
            let found = [mesh.height_mm(20.0, y), mesh.height_mm(220.0, y)];
            assert!((corner[0] - found[0]).abs() < 1e-12 && (corner[1] - found[1]).abs() < 1e-12);
            // Beyond the grid its edge goes on.
            assert_eq!(mesh.height_mm(500.0, y), mesh.height_mm(220.0, y));
            assert_eq!(mesh.height_mm(-1e9, y), mesh.height_mm(20.0, y));
        }
    }
}

#[test]
fn the_mesh_is_whole_below_its_blend_and_its_mean_above() {
    let mesh = mesh([5, 5], warped);
    let (x, y) = (77.0, 31.0);
    let (height, mean) = (mesh.height_mm(x, y), mesh.mean_mm());
    for (z, share) in [
        (-0.5, 1.0),
        (1.0, 1.0),
        (5.5, 0.5),
        (10.0, 0.0),
        (80.0, 0.0),
    ] {
        let expected = mean + share * (height - mean);
        assert!(
            (mesh.shift_mm([x, y, z]) - expected).abs() < 1e-12,
            "at {z}"
        );
    }
    assert_eq!(
        mesh.shift_mm([x, y, 10.0]),
        mesh.shift_mm([x + 60.0, y, 30.0])
    );
}

/// A spiral in the middle of the bed whose spans are long, with volume that wraps.
fn long_spans() -> SegmentStream {
    let mut stream = spiral(3.0);
    let at = |knot: usize| stream.knots[(4 * knot).min(stream.knots.len() - 1)];
    let knots: Vec<Knot> = (0..stream.knots.len() / 4 + 4)
        .map(|number| {
            let mut knot = at(number);
            let far = (number as i32).wrapping_mul(90_000_000);
            knot.control[CHANNELS - 1] = stream.start[CHANNELS - 1].wrapping_add(far);
            knot.duration_ticks *= 4;
            knot
        })
        .collect();
    stream.knots = knots;
    stream.events = (0..stream.knots.len() as u32)
        .step_by(3)
        .map(|span| FlowEvent {
            span,
            offset_ticks: (span % 5) as u16 * 9,
            action: FlowAction::Prime,
            volume_units: 1000,
            duration_ticks: Ticks(20),
        })
        .collect();
    stream
}

#[test]
fn refined_spans_are_the_same_curve_and_keep_their_events() {
    let stream = long_spans();
    let fine = refined(&stream, 0.5);
    assert!(fine.knots.len() > 2 * stream.knots.len(), "it is refined");
    assert_eq!(stream_ticks(&fine.knots), stream_ticks(&stream.knots));
    let (mut old, mut new) = (PlanCursor::new(&stream), PlanCursor::new(&fine));
    let ticks = stream_ticks(&stream.knots);
    for step in 0..4 * ticks {
        let at = step as f64 / 4.0;
        let (old, new) = (old.position(at), new.position(at));
        for channel in 0..CHANNELS {
            let units = (old[channel] - new[channel]).abs()
                * headway_protocol::units::UNITS_PER_NATURAL[channel];
            // Half a unit of rounding, and what doubles do to 10⁹ units.
            assert!(units <= 0.51, "channel {channel} at {at}: {units}");
        }
    }
    let times = |stream: &SegmentStream| -> Vec<u64> {
        let mut starts = vec![0u64, 8, 16];
        let mut at = 16;
        for knot in &stream.knots {
            at += u64::from(knot.duration_ticks);
            starts.push(at);
        }
        let time = |event: &FlowEvent| starts[event.span as usize] + u64::from(event.offset_ticks);
        stream.events.iter().map(time).collect()
    };
    assert_eq!(times(&stream), times(&fine));
    assert!(crate::job::frames::WireFrames::encode(&fine).is_ok());
    // Nothing to do, nothing done, to the bit.
    assert_eq!(refined(&stream, 1e6), stream);
}

#[test]
fn a_job_over_a_bed_is_its_plan_lifted_by_the_beds_height() {
    let settings = Settings::default();
    let stream = spiral(3.0);
    let mesh = mesh([9, 9], warped);
    let over = over_bed(&stream, &mesh, &settings.machine).expect("it fits");
    assert_eq!(over.events, stream.events);
    assert_eq!(over.marks, stream.marks);
    let (mut plan, mut lifted) = (PlanCursor::new(&stream), PlanCursor::new(&over));
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for at in 0..stream_ticks(&stream.knots) {
        let (plan, lifted) = (plan.position(at as f64), lifted.position(at as f64));
        let shift = lifted[CHANNEL_Z] - plan[CHANNEL_Z];
        let expected = mesh.shift_mm([plan[CHANNEL_X], plan[CHANNEL_Y], plan[CHANNEL_Z]]);
        // Control points are moved, not the curve; and half a unit.
        assert!((shift - expected).abs() < 0.0007, "{shift} for {expected}");
        range = [range[0].min(shift), range[1].max(shift)];
        for channel in (0..CHANNELS).filter(|channel| *channel != CHANNEL_Z) {
            assert!((plan[channel] - lifted[channel]).abs() <= 1e-4);
        }
    }
    assert!(range[1] - range[0] > 0.01, "the bed was felt: {range:?}");
}

#[test]
fn a_job_of_coarse_units_is_lifted_by_the_same_height() {
    let machine = Settings::default().machine;
    let units = Units {
        length_exponent: 4,
        angle_exponent: 0,
        volume_exponent: 8,
    };
    let mut coarse = spiral(3.0);
    coarse.units = units;
    coarse.start = units.of_base(&coarse.start);
    let mut fine = coarse.clone();
    for knot in &mut coarse.knots {
        knot.control = units.of_base(&knot.control);
    }
    coarse.events.clear();
    // The same places in base units.
    fine.units = Units::BASE;
    fine.events.clear();
    fine.start = units.to_base(&coarse.start);
    for (knot, coarse) in fine.knots.iter_mut().zip(&coarse.knots) {
        knot.control = units.to_base(&coarse.control);
    }
    let mesh = mesh([9, 9], warped);
    let [coarse, fine] =
        [coarse, fine].map(|job| over_bed(&job, &mesh, &machine).expect("it fits"));
    assert_eq!(coarse.units, units);
    let (mut one, mut other) = (PlanCursor::new(&coarse), PlanCursor::new(&fine));
    for at in 0..stream_ticks(&fine.knots) {
        let (one, other) = (one.position(at as f64), other.position(at as f64));
        for channel in [CHANNEL_X, CHANNEL_Y, CHANNEL_Z] {
            // A unit of 1.6 µm: points are put in and lifted, rounded to half a unit each.
            assert!(
                (one[channel] - other[channel]).abs() <= 0.00161,
                "{channel} at {at}"
            );
        }
    }
}

#[test]
fn a_job_that_cannot_follow_is_refused_with_the_place() {
    let settings = Settings::default();
    let machine = &settings.machine;
    let stream = spiral(3.0);
    let good = mesh([9, 9], warped);
    let other = BedMesh {
        machine_hash: 7,
        ..good.clone()
    };
    let refused = over_bed(&stream, &other, machine).expect_err("another machine's");
    assert!(refused.to_string().contains("00000007"), "{refused}");
    let short = BedMesh {
        fade_height_mm: 2.0,
        ..good.clone()
    };
    let refused = over_bed(&stream, &short, machine).expect_err("too short");
    assert!(refused.to_string().contains("layers would be"), "{refused}");
    let deep = mesh([4, 4], |_, _| -15.0);
    let refused = over_bed(&stream, &deep, machine).expect_err("below the range");
    assert!(
        refused.to_string().starts_with("over this bed, 0"),
        "{refused}"
    );
    assert!(
        refused.to_string().contains("joint z would be at -"),
        "{refused}"
    );
    // The third joint of an arm is an angle.
    let elbow = super::fault_text(&SpanFault::SoftLimit(2, 1_570_796), ("j3", true));
    assert!(elbow.contains("joint j3 would be at 90.000°"), "{elbow}");
    // Ripples that Z cannot follow; the blend would allow them.
    let mut rippled = mesh([64, 64], |x, y| 3.0 * (x * 1.1).sin() * (y * 0.9).cos());
    rippled.fade_height_mm = 200.0;
    let refused = over_bed(&stream, &rippled, machine).expect_err("too fast");
    let text = refused.to_string();
    let needed = text.split_once("motor 2 would need ").expect(&text).1;
    let needed = needed.split_once(" times").expect(&text).0;
    assert!(needed.parse::<f64>().unwrap() > 1.05, "{text}");
}

#[test]
fn a_file_comes_back_and_one_that_cannot_be_is_refused_with_its_key() {
    let mut written = mesh([3, 4], warped);
    for height in written.heights_mm.iter_mut().flatten() {
        *height = (*height * 1e4).round() / 1e4;
    }
    let text = to_toml(&written);
    assert_eq!(from_toml(&text).expect("a mesh"), written);
    let short = from_toml(
        "machine = \"1\"\n[grid]\nmin_mm = [0, 0]\nmax_mm = [9, 9]\nheights_mm = [[0, 0, 0], [0, 1, 0], [0, 0, 0]]",
    )
    .expect("what must be there");
    assert_eq!((short.fade_start_mm, short.fade_height_mm), (1.0, 10.0));
    let first = text
        .lines()
        .find(|line| line.starts_with("    ["))
        .expect("a row");
    for (old, new, said) in [
        ("machine = \"", "machine = \"x", "machine: x"),
        ("fade_start_mm = 1", "fade_start_mm = -1", "fade_start_mm"),
        (
            "fade_height_mm = 10",
            "fade_height_mm = 1",
            "fade_height_mm: 1 is not",
        ),
        (
            "fade_height_mm = 10",
            "fade_height_mm = nan",
            "fade_height_mm: NaN",
        ),
        ("min_mm = [20, 10]", "min_mm = [220, 10]", "grid: max_mm"),
        ("min_mm = [20, 10]", "min_mm = [nan, 10]", "grid: max_mm"),
        (first, "    [0, 0],", "grid.heights_mm: 3 to 64 rows"),
        (first, "    [0, 21, 0],", "grid.heights_mm: 21"),
        (first, "    [0, nan, 0],", "grid.heights_mm: NaN"),
        ("[grid]", "[grid]\nrotated = true", "unknown field"),
    ] {
        assert!(text.contains(old), "{old}");
        let refused = from_toml(&text.replacen(old, new, 1)).expect_err(new);
        assert!(refused.to_string().contains(said), "{refused} for {new}");
    }
    assert_eq!(POINTS_MIN, 3);
}

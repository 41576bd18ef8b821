//! Goal: neither aperture nor nozzle body enters a keep-out, in passes and in travel. Method: brute
//! force over the finished stream: every pose on the bed or above it, a few micrometres apart, by
//! distances to all edges of the keep-outs; aperture outlines by their points, corners of the
//! keep-outs by the ellipse's equation.

use headway::geometry::Point2;
use headway::geometry::polygon::{Region, Ring};
use headway::input::Target;
use headway::plan::route::travel::TravelError;
use headway::settings::{Settings, Skirt};
use headway::{Plan, PlanError, plan_target, plan_target_around};
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y};

const AXES_MM: [f64; 2] = [0.6, 0.2];

fn region(points: &[[f64; 2]]) -> Region {
    Region {
        exterior: Ring {
            points: points.iter().copied().map(Point2::from).collect(),
        },
        holes: Vec::new(),
    }
}

fn rectangle(low: [f64; 2], high: [f64; 2]) -> Region {
    region(&[low, [high[0], low[1]], high, [low[0], high[1]]])
}

/// A plate of 24 x 12 mm with a clamp on it, a pin in the middle and a finished neighbour that
/// touches it.
fn plate() -> (Target, Vec<Region>) {
    let target = Target {
        name: "plate".to_string(),
        regions: vec![rectangle([0.0, 0.0], [24.0, 12.0])],
    };
    let clamp = region(&[[6.0, -4.0], [9.0, -4.0], [8.0, 7.0], [6.5, 6.0]]);
    let pin = region(
        &(0..48)
            .map(|i| f64::from(i) * std::f64::consts::TAU / 48.0)
            .map(|angle| [16.0 + angle.cos(), 6.0 + angle.sin()])
            .collect::<Vec<[f64; 2]>>(),
    );
    let neighbour = rectangle([-6.0, 12.0], [30.0, 20.0]);
    (target, vec![clamp, pin, neighbour])
}

fn settings(body_mm: f64) -> Settings {
    Settings {
        nozzle_body_radius_mm: body_mm,
        skirt: Skirt {
            brim_loops: 1,
            ..Settings::default().skirt
        },
        // The head waits in the work area's corner, far from the plate.
        ..Settings::default()
    }
}

/// Least distance of the centre from the keep-outs (negative: inside), and deepest entry of any
/// point of the aperture, over the whole stream, mm; and the number of poses.
fn brute_force(plan: &Plan, keep_out: &[Region]) -> (f64, f64, usize) {
    let distance_mm = |p: Point2| {
        let edges = keep_out.iter().flat_map(Region::edges);
        let far = edges.map(|(a, b)| {
            let t = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
            (p - (a + (b - a) * t)).norm()
        });
        let far_mm = far.fold(f64::INFINITY, f64::min);
        let inside = keep_out.iter().any(|region| region.contains(p));
        if inside { -far_mm } else { far_mm }
    };
    let outline: Vec<[f64; 2]> = (0..90)
        .map(|i| f64::from(i) * std::f64::consts::TAU / 90.0)
        .map(|angle| [AXES_MM[0] * angle.cos(), AXES_MM[1] * angle.sin()])
        .collect();
    let (mut center_mm, mut entry_mm, mut poses) = (f64::INFINITY, 0.0_f64, 0);
    for span in plan.stream.spans() {
        let ticks = f64::from(span.duration_ticks);
        for step in 0..20 {
            let pose = span.position(ticks * f64::from(step) / 20.0);
            let at = plan
                .transform
                .to_input([pose[CHANNEL_X], pose[CHANNEL_Y], 0.0]);
            let center = Point2::new(at[0], at[1]);
            let near_mm = distance_mm(center);
            poses += 1;
            center_mm = center_mm.min(near_mm);
            if near_mm > AXES_MM[0] + 0.01 {
                continue;
            }
            let (sin, cos) = pose[CHANNEL_HEADING].sin_cos();
            for [u, v] in &outline {
                let p =
                    center + headway::geometry::Vector2::new(u * cos - v * sin, u * sin + v * cos);
                entry_mm = entry_mm.max(-distance_mm(p));
            }
            for p in keep_out.iter().flat_map(|region| &region.exterior.points) {
                let d = p - center;
                let (u, v) = (d.x * cos + d.y * sin, d.y * cos - d.x * sin);
                let scaled = (u / AXES_MM[0]).hypot(v / AXES_MM[1]);
                entry_mm = entry_mm.max((1.0 - scaled) * AXES_MM[0]);
            }
        }
    }
    (center_mm, entry_mm, poses)
}

#[test]
fn nothing_enters_a_keep_out() {
    let (target, keep_out) = plate();
    for (body_mm, inside, layers) in [
        (0.0, false, 1),
        (0.4, true, 3),
        (1.5, false, 2),
        (1.5, true, 1),
    ] {
        let settings = Settings {
            avoid_crossing: inside,
            layers,
            ..settings(body_mm)
        };
        let plan = plan_target_around(&target, &keep_out, &settings, &()).expect("a plan");
        let (center_mm, entry_mm, poses) = brute_force(&plan, &keep_out);
        println!(
            "body {body_mm} mm: {poses} poses, centre {center_mm} mm away, entry {entry_mm} mm, \
             {} mm² given up, {} % covered",
            plan.kept_out_mm2, plan.figures.covered_of_reachable_pct
        );
        assert!(poses > 20_000, "{poses}");
        assert!(center_mm >= body_mm - 1e-3, "{body_mm}: {center_mm}");
        assert!(entry_mm <= 1e-3, "{body_mm}: {entry_mm}");
        assert!(plan.figures.covered_of_reachable_pct > 98.0);
        // The clamp's part on the plate and the pin, at least.
        assert!(plan.kept_out_mm2 > 15.0 && plan.kept_out_mm2 < 120.0);
    }
    // Without keep-outs the same oracle sees the head drive straight through them.
    let plan = plan_target(&target, &settings(0.0)).expect("a plan");
    let (center_mm, entry_mm, _) = brute_force(&plan, &keep_out);
    assert!(center_mm < -0.5 && entry_mm > 0.5, "{center_mm} {entry_mm}");
}

#[test]
fn what_cannot_be_reached_is_refused_with_the_place() {
    let (target, _) = plate();
    let all = [rectangle([-1.0, -1.0], [25.0, 13.0])];
    let refused = plan_target_around(&target, &all, &settings(0.0), &());
    let refused = refused.expect_err("nothing left").to_string();
    assert!(refused.contains("leave no ground to print on"), "{refused}");
    // A closed frame around a part of the plate: the head gets in or out nowhere.
    let mut frame = rectangle([4.0, 2.0], [20.0, 10.0]);
    let mut hole = rectangle([6.0, 4.0], [18.0, 8.0]).exterior;
    hole.points.reverse();
    frame.holes.push(hole);
    let refused = plan_target_around(&target, &[frame], &settings(0.0), &());
    assert!(
        matches!(refused, Err(PlanError::Travel(TravelError::Blocked { .. }))),
        "{:?}",
        refused.err()
    );
}

/// Goal: with `avoid_crossing` travel inside a region stays there where there is a way. Method:
/// an outline with a deep slot, travels of the finished stream against its edges.
#[test]
fn travel_stays_inside_where_asked() {
    let comb = Target {
        name: "comb".to_string(),
        regions: vec![region(&[
            [0.0, 0.0],
            [30.0, 0.0],
            [30.0, 14.0],
            [22.0, 14.0],
            [22.0, 4.0],
            [19.0, 4.0],
            [19.0, 14.0],
            [11.0, 14.0],
            [11.0, 4.0],
            [8.0, 4.0],
            [8.0, 14.0],
            [0.0, 14.0],
        ])],
    };
    let infill = headway::settings::Infill {
        density_pct: 25.0,
        angle_rad: 0.3,
        ..headway::settings::Infill::solid(1)
    };
    let base = Settings {
        infill: Some(infill),
        ..Settings::default()
    };
    let straight = plan_target(&comb, &base).expect("a plan");
    let inside = Settings {
        avoid_crossing: true,
        ..base
    };
    let kept = plan_target(&comb, &inside).expect("a plan");
    println!(
        "{} crossings and {} mm of travel straight, {} and {} mm inside",
        straight.outline_crossings,
        straight.figures.travel_mm,
        kept.outline_crossings,
        kept.figures.travel_mm
    );
    assert!(straight.outline_crossings >= 1);
    assert_eq!(kept.outline_crossings, 0);
    assert!(kept.figures.travel_mm < 2.0 * straight.figures.travel_mm);
    // The figure against the stream itself: no centre between two passes lies outside.
    let marks = &kept.stream.marks;
    let printed = |m: &headway::job::Mark| m.state == headway::job::MotionState::Print;
    let first = marks.iter().find(|m| printed(m)).expect("a pass").end_tick;
    let last = marks.iter().rfind(|m| printed(m)).expect("a pass").end_tick;
    let mut tick = 0;
    let mut looked = 0;
    for span in kept.stream.spans() {
        let at_share = |share: f64| span.position(share * f64::from(span.duration_ticks));
        tick += u64::from(span.duration_ticks);
        if tick <= first || tick > last {
            continue;
        }
        for step in 0..8 {
            let pose = at_share(f64::from(step) / 8.0);
            let at = [pose[CHANNEL_X], pose[CHANNEL_Y], 0.0];
            let at = kept.transform.to_input(at);
            let inside = comb.regions[0].contains(Point2::new(at[0], at[1]));
            looked += 1;
            assert!(inside, "{at:?}");
        }
    }
    assert!(looked > 1000, "{looked}");
}

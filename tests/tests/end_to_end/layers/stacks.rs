//! Goal: a print of several layers is the one-layer print, stacked: every layer at its height and
//! covered as it was said, nothing laid between two layers, the tip never below the layer it is
//! printing. Method: the simulated steps by forward kinematics of our own (counts over steps per mm)
//! and the layer oracle; settings whose layers can be told by hand.

use headway::drive::dry_run::{DryRun, dry_run};
use headway::drive::simulator::SimulatorSetup;
use headway::input::Target;
use headway::job::{MotionState, SegmentStream};
use headway::plan::layers::layer_groups::RegionPrint;
use headway::plan::layers::region_plan::Reversal;
use headway::plan::pass::LayerPass;
use headway::settings::{Infill, SeamPlace, Settings};
use headway::{Plan, PlanError, plan_target};
use headway_tests::layer_oracle::{OraclePose, Rings, print_poses, sweep};
use headway_tests::outlines::{example, region};

const AXES_MM: [f64; 2] = [0.6, 0.2];

fn target(regions: &[Rings]) -> Target {
    Target {
        name: "part".to_string(),
        regions: regions.iter().map(region).collect(),
    }
}

fn plate(width_mm: f64, depth_mm: f64) -> Rings {
    let (x, y) = (0.5 * width_mm, 0.5 * depth_mm);
    vec![vec![[-x, -y], [x, -y], [x, y], [-x, y]]]
}

/// The plate and a taper beside it.
fn two_parts() -> [Rings; 2] {
    let mut far = example("taper");
    for point in far.iter_mut().flatten() {
        point[0] += 20.0;
    }
    [plate(12.0, 8.0), far]
}

/// The tip, the heading and the extruder's steps after every step of any motor.
#[derive(Clone, Copy)]
struct Moment {
    tip_mm: [f64; 3],
    heading_rad: f64,
    extruder: i64,
}

fn moments(dry_run: &DryRun, settings: &Settings) -> Vec<Moment> {
    let joints = &settings.machine.joints;
    let record = &dry_run.simulation.motion;
    let mut counts = record.start_counts;
    let steps = record.steps.iter();
    steps
        .map(|step| {
            counts[usize::from(step.motor)] += if step.forward { 1 } else { -1 };
            let place = |joint: usize| counts[joint] as f64 / joints[joint].steps_per_unit;
            Moment {
                tip_mm: [place(0), place(1), place(2)],
                heading_rad: place(3),
                extruder: counts[4],
            }
        })
        .collect()
}

fn run_dry(plan: &Plan, settings: &Settings) -> DryRun {
    let setup = SimulatorSetup::default();
    let dry_run = dry_run(&plan.stream, settings, &setup, |_| {}).expect("dry_run");
    assert_eq!(dry_run.simulation.figures.faults, 0);
    let trace = &dry_run.trace;
    assert_eq!(trace.final_counts, trace.expected_counts);
    dry_run
}

/// Far enough that both are worth looking at.
fn is_apart(last: &OraclePose, pose: &OraclePose) -> bool {
    let far_mm = (pose.x_mm - last.x_mm).hypot(pose.y_mm - last.y_mm);
    far_mm > 0.03 || (pose.heading_rad - last.heading_rad).abs() > 0.02
}

/// True for places that are one step of x and of y apart at most.
fn is_within_a_step(p: &[f64; 3], q: &[f64; 3]) -> bool {
    (0..2).all(|axis| (p[axis] - q[axis]).abs() < 1.5 / 80.0)
}

/// Half a step of the z joint and what the segments may be off, mm.
const Z_SLACK_MM: f64 = 0.5 / 400.0 + 0.001;

/// Four layers of two parts with a brim. Every step of the extruder forward comes at one of four
/// heights, which come once each and in order; between them the tip is never below the layer that
/// was printed last, and it crosses only from half a lift above on. What the head does at a layer's height covers it.
#[test]
fn steps_of_four_layers_lie_where_they_should() {
    let parts = two_parts();
    let mut settings = Settings {
        layers: 4,
        ..Settings::default()
    };
    settings.skirt.brim_loops = 1;
    let plan = plan_target(&target(&parts), &settings).expect("a plan");
    let dry_run = run_dry(&plan, &settings);
    let bed_mm = plan.transform.offset_mm[2];
    let height_of = |layer: usize| bed_mm + settings.layer_height_mm * (layer + 1) as f64;
    let mut layer = 0;
    let mut poses: Vec<Vec<OraclePose>> = vec![Vec::new(); 4];
    let (mut crossings, mut before, mut has_begun) = (0, None::<Moment>, false);
    // Where the head left the layer, and the moves since then at less than half a lift.
    let (mut left_mm, mut lows_mm) = ([f64::NAN; 3], Vec::new());
    for now in moments(&dry_run, &settings) {
        let z_mm = now.tip_mm[2];
        let Some(was) = before.replace(now) else {
            continue;
        };
        let lowest_mm = height_of(layer) - Z_SLACK_MM;
        assert!(z_mm >= lowest_mm, "{:?} on layer {layer}", now.tip_mm);
        if now.extruder > was.extruder {
            if layer < 3 && (z_mm - height_of(layer + 1)).abs() < Z_SLACK_MM {
                layer += 1;
            }
            let off_mm = z_mm - height_of(layer);
            assert!(off_mm.abs() < Z_SLACK_MM, "{:?}, layer {layer}", now.tip_mm);
            has_begun = true;
        }
        let pose = OraclePose {
            x_mm: now.tip_mm[0] - plan.transform.offset_mm[0],
            y_mm: now.tip_mm[1] - plan.transform.offset_mm[1],
            heading_rad: now.heading_rad,
            pass: 0,
            layer: 0,
            path_mm: 0.0,
        };
        let on_layer = (z_mm - height_of(layer)).abs() < Z_SLACK_MM;
        if on_layer && poses[layer].last().is_none_or(|last| is_apart(last, &pose)) {
            poses[layer].push(pose);
        }
        let crossed = now.tip_mm[..2] != was.tip_mm[..2];
        // On the layer while it is printed, else from half a lift above it to a lift above the next.
        if on_layer {
            // What is nearer to an end than a step may be rounded to another step as its height changes.
            let ends = [left_mm, now.tip_mm];
            let crosses = |at: &[f64; 3]| ends.iter().all(|end| !is_within_a_step(at, end));
            let low = lows_mm.drain(..).find(crosses);
            assert!(low.is_none(), "{low:?} before layer {layer}");
            left_mm = now.tip_mm;
        } else if has_begun && crossed {
            crossings += 1;
            // The curve rounds the hop's corner by a step of its control points, 24 a lift, and a few um more where it is
            // begun fast.
            let step_mm = settings.lift_mm / 20.0;
            let low_mm = height_of(layer) + 0.5 * settings.lift_mm - step_mm - Z_SLACK_MM;
            let high_mm = height_of(layer + 1) + settings.lift_mm + Z_SLACK_MM;
            assert!(z_mm <= high_mm, "{:?} after layer {layer}", now.tip_mm);
            if z_mm < low_mm {
                lows_mm.push(now.tip_mm);
            }
        }
    }
    let crosses = |at: &[f64; 3]| !is_within_a_step(at, &left_mm);
    let low = lows_mm.into_iter().find(crosses);
    assert!(low.is_none(), "{low:?} after the last layer");
    assert_eq!(layer, 3);
    assert!(crossings > 10_000, "{crossings}");
    for (layer, poses) in poses.iter().enumerate() {
        for (part, rings) in parts.iter().enumerate() {
            let of_part = |pose: &&OraclePose| (pose.x_mm > 9.0) == (part == 1);
            let poses: Vec<OraclePose> = poses.iter().filter(of_part).copied().collect();
            let found = sweep(rings, &poses, AXES_MM, 0.02);
            assert!(
                // Standard quality, small parts: 98.6 when this was written.
                found.covered_pct > 98.0,
                "layer {layer}, part {part}: {found:?}"
            );
            if layer > 0 {
                // No brim; rounding of x and y to steps blurs it by 9 µm.
                let outside_mm = found.outside_depth_mm;
                assert!(outside_mm < 0.012, "layer {layer}: {outside_mm}");
            }
        }
    }
}

/// Poses of each layer, from the knots and the marks.
fn poses_of_layers(plan: &Plan) -> Vec<Vec<OraclePose>> {
    let offset = [plan.transform.offset_mm[0], plan.transform.offset_mm[1]];
    let mut layers = vec![Vec::new(); plan.stream.layers() as usize];
    for pose in print_poses(&plan.stream, offset, 0.03) {
        let mut marks = plan.stream.marks.iter();
        let mark = marks.find(|mark| mark.pass == Some(pose.pass));
        layers[mark.expect("a mark").layer as usize].push(pose);
    }
    layers
}

/// Two walls and sparse lines over eight layers, two solid at the bottom and one on top: each layer
/// covers what its kind says, also those whose coverage was taken over from one like it, and lines
/// lie across those below.
#[test]
fn solid_layers_lie_below_and_above_the_sparse_ones() {
    let rings = plate(24.0, 18.0);
    let settings = Settings {
        layers: 8,
        infill: Some(Infill {
            density_pct: 25.0,
            bottom_layers: Some(2),
            top_layers: Some(1),
            ..Infill::solid(2)
        }),
        ..Settings::default()
    };
    let plan = plan_target(&target(std::slice::from_ref(&rings)), &settings).expect("a plan");
    let kinds: Vec<(u32, u32)> = plan
        .kinds
        .iter()
        .map(|k| (k.first_layer, k.layers))
        .collect();
    // Solid at 45° and 135°, sparse at 45° and 135°; the top one is solid at 135°, and a roof over the lines at 45°.
    assert_eq!(kinds, [(0, 1), (1, 1), (2, 3), (3, 2), (7, 1)]);
    let layers = poses_of_layers(&plan);
    for (layer, poses) in layers.iter().enumerate() {
        let found = sweep(&rings, poses, AXES_MM, 0.02);
        let said = plan.measured.swept[layer];
        let solid = layer < 2 || layer == 7;
        println!("layer {layer}: {found:?} {:.2}", said.covered_pct());
        assert_eq!(found.covered_pct > 98.0, solid, "layer {layer}: {found:?}");
        assert!((found.covered_pct - said.covered_pct()).abs() < 0.3);
        assert!((found.overlap_pct - said.overlap_pct()).abs() < 0.3);
        assert!(found.outside_depth_mm < 0.002, "layer {layer}: {found:?}");
    }
    let figures = &plan.figures;
    assert!(figures.covered_pct_min < 70.0 && figures.overlap_pct_max < 3.0);
    let mean = layers
        .iter()
        .map(|poses| sweep(&rings, poses, AXES_MM, 0.02).covered_pct);
    let mean_pct = mean.sum::<f64>() / 8.0;
    assert!((figures.covered_pct - mean_pct).abs() < 0.3, "{mean_pct}");
    for (number, curve) in plan.curves.iter().enumerate() {
        if !curve.kind.is_line() || curve.layer < 2 || curve.layer == 7 {
            continue;
        }
        // Lines are joined along the walls, where the nozzle goes round: a third of the way at least is
        // along them.
        let asked = if curve.layer % 2 == 0 { 45.0 } else { 135.0 };
        let (mut along_mm, mut all_mm) = (0.0, 0.0);
        for pair in curve.control.windows(2) {
            let step = [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]];
            let off = (step[1].atan2(step[0]).to_degrees() - asked).rem_euclid(180.0);
            let length_mm = step[0].hypot(step[1]);
            all_mm += length_mm;
            if off.min(180.0 - off) < 1.0 {
                along_mm += length_mm;
            }
        }
        assert!(
            along_mm > all_mm / 3.0,
            "curve {number}: {along_mm} of {all_mm} mm"
        );
    }
}

/// Tip heights of a stream's printing moves by layer, and how many passes each layer has.
fn heights_and_passes(stream: &SegmentStream) -> Vec<(f64, usize)> {
    let mut layers: Vec<(f64, usize)> = Vec::new();
    for mark in &stream.marks {
        assert!(mark.layer as usize <= layers.len());
        if mark.state != MotionState::Print {
            continue;
        }
        if mark.layer as usize == layers.len() {
            let mut tick = 0;
            let knots = stream.knots.iter();
            // Knot n is the last of span n's control points.
            let z = knots
                .map(|knot| {
                    let at = tick;
                    tick += u64::from(knot.duration_ticks);
                    (at, knot.control[2])
                })
                .find(|(at, _)| *at >= mark.start_tick)
                .map_or(0, |(_, z)| z);
            layers.push((f64::from(z) / 1e4, 0));
        }
        layers[mark.layer as usize].1 += 1;
    }
    layers
}

/// From the first printing's end to the second one's start, mm.
fn crossing_mm(plan: &Plan) -> f64 {
    let of_print = |print: usize| {
        let curves = plan.curves.iter().zip(&plan.print_of_curve);
        curves.filter(move |(_, of)| **of == print)
    };
    let (end, start) = (of_print(0).next_back(), of_print(1).next());
    let (Some((end, _)), Some((start, _))) = (end, start) else {
        panic!("two printings");
    };
    let (from, to) = (end.control[end.control.len() - 1], start.control[0]);
    (to[0] - from[0]).hypot(to[1] - from[1])
}

/// The first of many layers is the job of one, to the byte; the others lie on top of it with as many
/// passes, whatever the number of threads.
#[test]
fn layers_are_the_one_layer_stacked() {
    let target = target(&two_parts());
    let planned = |layers: u32, threads: usize| {
        let settings = Settings {
            layers,
            ..Settings::default()
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().expect("threads");
        pool.install(|| plan_target(&target, &settings).expect("a plan"))
    };
    let (one, five) = (planned(1, 2), planned(5, 1));
    // The last move of one layer lifts the head, and shows in its last knots.
    let same = one.stream.knots.iter().zip(&five.stream.knots);
    let same = same.take_while(|(a, b)| a == b).count();
    assert!(same + 60 > one.stream.knots.len(), "{same}");
    assert_eq!(five.stream, planned(5, 4).stream);
    let layers = heights_and_passes(&five.stream);
    assert_eq!(layers.len(), 5);
    for (number, (z_mm, passes)) in layers.iter().enumerate() {
        assert!((z_mm - 0.2 * (number + 1) as f64).abs() < 1e-4, "{z_mm}");
        assert_eq!(*passes, layers[0].1);
    }
    let crossing_mm = crossing_mm(&five);
    let (one, five) = (one.figures, five.figures);
    assert_eq!(five.passes, 5 * one.passes);
    assert!((five.print_mm - 5.0 * one.print_mm).abs() < 0.5);
    assert!((five.area_mm2 - one.area_mm2).abs() < 1e-9);
    assert!((five.covered_pct - one.covered_pct).abs() < 0.02);
    assert!((five.covered_pct_min - one.covered_pct).abs() < 0.05);
    // Each layer begins where the last one ended: from part to part once a layer, and lifts.
    let lifts_mm = 2.0 * (0.4 + 0.2) * one.passes as f64;
    let more_mm = five.travel_mm - one.travel_mm;
    assert!(more_mm < 4.0 * (crossing_mm + lifts_mm + 1.0), "{more_mm}");
}

/// Seams stay above one another where they are wanted, also on layers that are printed the other way
/// round: on a disk, every layer's outer loop begins and ends within two beads of the place that lies
/// farthest along the direction.
#[test]
fn aligned_seams_make_a_line_up_the_part() {
    let direction_rad = 0.3_f64;
    let mut settings = Settings {
        layers: 4,
        ..Settings::default()
    };
    settings.seam.place = SeamPlace::Aligned;
    settings.seam.direction_rad = direction_rad;
    let disk: Rings = vec![
        (0..120)
            .map(|i| f64::from(i) * std::f64::consts::TAU / 120.0)
            .map(|angle| [6.0 * angle.cos(), 6.0 * angle.sin()])
            .collect(),
    ];
    let plan = plan_target(&target(&[disk]), &settings).expect("a plan");
    let seam = [6.0 * direction_rad.cos(), 6.0 * direction_rad.sin()];
    let seam: [f64; 2] = std::array::from_fn(|axis| seam[axis] + plan.transform.offset_mm[axis]);
    let far_mm = |c: &[f64; 3]| (c[0] - seam[0]).hypot(c[1] - seam[1]);
    for layer in 0..4 {
        let curves = plan.curves.iter().filter(|curve| curve.layer == layer);
        let ends = curves.flat_map(|c| {
            [
                far_mm(&c.control[0]),
                far_mm(&c.control[c.control.len() - 1]),
            ]
        });
        let near = ends.filter(|mm| *mm < 2.4).count();
        assert!(near >= 1, "layer {layer}");
    }
    let turned: Vec<bool> = plan.prints.iter().map(|print| print.turned.walls).collect();
    println!("{turned:?}");
}

/// Goal: layers with lines are printed the way round that makes the least travel, walls before lines.
/// Method: the U-part's layers; of the four ways round each the shortest from where the one below ended to
/// its walls and on to its lines, by the ends of the passes.
#[test]
fn layers_with_lines_are_turned_to_save_travel() {
    let settings = Settings {
        layers: 12,
        infill: Some(Infill {
            density_pct: 25.0,
            bottom_layers: Some(1),
            top_layers: Some(1),
            ..Infill::solid(2)
        }),
        ..Settings::default()
    };
    let plan = plan_target(&target(&[example("u-part")]), &settings).expect("a plan");
    let passes = |print: &RegionPrint, turned: Reversal| {
        plan.kinds[print.kind].regions[print.region].passes_turned(turned)
    };
    let ends = |pass: &LayerPass| {
        let placements = &pass.placements;
        [&placements[0], &placements[placements.len() - 1]].map(|placement| placement.at.center)
    };
    let mut turned_layers = 0;
    for pair in plan.prints.windows(2) {
        let below = passes(&pair[0], pair[0].turned);
        let from = ends(&below[below.len() - 1])[1];
        let way_mm = |turned: Reversal| {
            let passes = passes(&pair[1], turned);
            let is_line = |pass: &LayerPass| pass.kind.is_line();
            assert!(passes.is_sorted_by_key(is_line), "walls come first");
            let first_line = passes.iter().position(is_line).expect("lines");
            let to_lines = match first_line {
                0 => 0.0,
                first => (ends(&passes[first])[0] - ends(&passes[first - 1])[1]).norm(),
            };
            (ends(&passes[0])[0] - from).norm() + to_lines
        };
        if plan.kinds[pair[1].kind]
            .infill
            .is_none_or(|infill| infill.is_solid())
        {
            assert_eq!(pair[1].turned, Reversal::default());
            continue;
        }
        let chosen_mm = way_mm(pair[1].turned);
        for (walls, lines) in [(false, false), (true, false), (false, true), (true, true)] {
            assert!(chosen_mm < way_mm(Reversal { walls, lines }) + 1e-6);
        }
        turned_layers += u32::from(pair[1].turned != Reversal::default());
    }
    assert!(turned_layers > 0);
}

/// Walls that turn the nozzle once a layer fit between stops two and a half turns apart, since it
/// turns back between layers; between stops less than a turn apart they are cut, and between stops
/// less than half a turn apart refused.
#[test]
fn the_nozzle_turns_back_between_its_stops() {
    let planned = |stop_deg: f64, layers: u32| {
        let mut settings = Settings {
            layers,
            infill: Some(Infill {
                density_pct: 0.0,
                ..Infill::solid(1)
            }),
            ..Settings::default()
        };
        settings.machine.joints[3].position_min = -stop_deg.to_radians();
        settings.machine.joints[3].position_max = stop_deg.to_radians();
        plan_target(&target(&[plate(16.0, 10.0)]), &settings)
    };
    let free = planned(1e5, 6).expect("a plan");
    let most = |plan: &Plan| {
        let knots = plan.stream.knots.iter();
        knots
            .map(|k| f64::from(k.control[5].abs()) * 1e-6)
            .fold(0.0, f64::max)
    };
    // Without stops six layers turn on and on.
    assert!(most(&free).to_degrees() > 1500.0, "{}", most(&free));
    let kept = planned(450.0, 6).expect("a plan");
    assert!(most(&kept).to_degrees() < 450.0, "{}", most(&kept));
    assert_eq!(kept.figures.passes, free.figures.passes);
    let cut = planned(150.0, 6).expect("a plan");
    assert!(most(&cut).to_degrees() < 150.0, "{}", most(&cut));
    assert!(cut.figures.passes > kept.figures.passes);
    // Ends of pieces move apart until open ground outweighs what they lay twice: both together, a cut costs none.
    let lost_pct = |plan: &Plan| 100.0 - plan.figures.covered_pct + 0.5 * plan.figures.overlap_pct;
    assert!(lost_pct(&cut) < lost_pct(&kept) + 0.05);
    match planned(80.0, 6) {
        Err(PlanError::Motion(error)) => {
            assert!(error.to_string().contains("joint c"), "{error}");
        }
        other => panic!("{:?}", other.map(|plan| plan.figures)),
    }
}

/// What is too high or too long is refused with figures to go by.
#[test]
fn too_many_layers_are_refused() {
    let planned = |layers: u32, layer_height_mm: f64, rings: Rings| {
        let settings = Settings {
            layers,
            layer_height_mm,
            ..Settings::default()
        };
        plan_target(&target(&[rings]), &settings)
    };
    let text = |result: Result<Plan, PlanError>| match result {
        Err(error) => error.to_string(),
        Ok(plan) => panic!("{} layers", plan.figures.layers),
    };
    let high = text(planned(1001, 0.2, plate(4.0, 4.0)));
    assert!(high.contains("200.200 mm high"), "{high}");
    let many = text(planned(10_001, 0.01, plate(4.0, 4.0)));
    assert!(many.contains("at most 10000"), "{many}");
    let long = text(planned(10_000, 0.02, plate(40.0, 30.0)));
    assert!(
        long.contains("10000 layers") && long.contains("fit"),
        "{long}"
    );
    println!("{long}");
}

//! Goal: a part whose layers change is planned layer by layer as its outlines ask, whole and the same
//! with any number of threads. Method: solids by formula, their sections known by hand; the job
//! run through the firmware library; a prism against the plan of its outline.

use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::geometry::polygon::Region;
use headway::input::Target;
use headway::job::{MotionState, SegmentStream};
use headway::mesh::layers::{HeightRange, LayerHeights, SlicedPart, sliced};
use headway::mesh::{Mesh, Point3};
use headway::pipeline::mesh::{FirstLayer, PartPlan, plan_part};
use headway::plan_target;
use headway::settings::{Infill, Settings};
use std::f64::consts::TAU;

/// A body of revolution about z from its profile (radius, z), bottom to top, its ends on the axis.
fn revolved(profile: &[[f64; 2]], around: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for &[radius, z] in profile {
        for k in 0..around {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(around)).sin_cos();
            mesh.vertices
                .push(Point3::new(radius * cos, radius * sin, z));
        }
    }
    for row in 0..profile.len() as u32 - 1 {
        for k in 0..around {
            let next = (k + 1) % around;
            let (a, b) = (row * around + k, row * around + next);
            mesh.triangles
                .extend([[a, b, b + around], [a, b + around, a + around]]);
        }
    }
    mesh
}

fn cut(mesh: &Mesh, first_mm: f64, layer_mm: f64) -> SlicedPart {
    let heights = LayerHeights {
        first_mm,
        layer_mm,
        ranges: Vec::new(),
        range: None,
    };
    sliced(mesh, &heights).expect("layers")
}

fn planned(part: &SlicedPart, first: FirstLayer, settings: &Settings) -> PartPlan {
    plan_part(part, &[], first, settings, &()).expect("a plan")
}

/// Runs the job through the firmware library.
fn check_run(stream: &SegmentStream, settings: &Settings) {
    let run = dry_run(stream, settings, &SimulatorSetup::default(), |_| {}).expect("a run");
    assert_eq!(run.simulation.figures.faults, 0);
    assert_eq!(run.trace.final_counts, run.trace.expected_counts);
}

/// Volume that is deposited on each layer, mm³, and its print moves' height.
fn layers_of(stream: &SegmentStream) -> Vec<(u32, f64)> {
    let mut found: Vec<(u32, f64)> = Vec::new();
    for mark in &stream.marks {
        if mark.state == MotionState::Print && found.last().is_none_or(|l| l.0 != mark.layer) {
            found.push((mark.layer, mark.start_tick as f64));
        }
    }
    found
}

/// Goal: a prism given as a mesh is the prism given as an outline. Method: both planned; path, time,
/// volume and coverage compared (travel to the first pass may differ: the outline has other
/// first points).
#[test]
fn an_upright_mesh_is_its_outline() {
    let mesh = revolved(&[[0.0, 0.0], [7.0, 0.0], [7.0, 1.2], [0.0, 1.2]], 6);
    let settings = Settings {
        layers: 6,
        ..Settings::default()
    };
    let part = cut(&mesh, 0.2, 0.2);
    assert_eq!(part.layers.len(), 6);
    // The same to the last digit: planned once.
    let first = &part.layers[0].regions;
    assert!(part.layers.iter().all(|layer| layer.regions == *first));
    let target = Target {
        name: "prism".to_string(),
        regions: first.clone(),
    };
    let prism = plan_target(&target, &settings).expect("a prism");
    let part = planned(&part, FirstLayer::default(), &settings);
    let (one, other) = (&prism.figures, &part.printed.figures);
    assert_eq!((one.passes, one.layers), (other.passes, other.layers));
    assert!((one.print_mm - other.print_mm).abs() < 1e-3 * one.print_mm);
    assert!((one.volume_mm3 - other.volume_mm3).abs() < 1e-3 * one.volume_mm3);
    assert!((one.covered_pct - other.covered_pct).abs() < 0.1);
    assert!((one.print_s - other.print_s).abs() < 0.02 * one.print_s);
    check_run(&part.printed.stream, &settings);
}

/// Goal: every layer of a cone is printed at its height, in order, and gets its volume; threads
/// change nothing; the first layer has its own height and is slower. Method: volumes by the sum of
/// sections, streams compared whole.
#[test]
fn a_cone_is_printed_layer_by_layer() {
    let mesh = revolved(&[[0.0, 0.0], [6.0, 0.0], [3.0, 3.0], [0.0, 3.0]], 40);
    let settings = Settings::default();
    let part = cut(&mesh, 0.3, 0.2);
    assert_eq!(part.layers.len(), 14);
    let first = FirstLayer {
        speed_mm_s: Some(20.0),
    };
    let of_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads")
            .install(|| planned(&part, first, &settings))
    };
    let plan = of_threads(1);
    assert_eq!(plan.printed.stream, of_threads(3).printed.stream);
    let layers: Vec<u32> = layers_of(&plan.printed.stream)
        .iter()
        .map(|l| l.0)
        .collect();
    assert_eq!(layers, (0..14).collect::<Vec<u32>>());
    let f = &plan.printed.figures;
    assert!(f.covered_pct > 97.0, "{}", f.covered_pct);
    assert!(f.outside_depth_mm < 1e-3, "{}", f.outside_depth_mm);
    // What is covered times each layer's height, within what is laid twice.
    let expected = part.volume_mm3() * f.covered_pct / 100.0;
    assert!(
        (f.volume_mm3 / expected - 1.0).abs() < 0.01,
        "{} {expected}",
        f.volume_mm3
    );
    assert!(plan.printed.left_out.is_empty());
    check_run(&plan.printed.stream, &settings);
    // The first layer alone, slow and as fast as the others.
    let time_s = |first: FirstLayer| {
        let one = SlicedPart {
            wanted: 0..1,
            ..part.clone()
        };
        planned(&one, first, &settings).printed.figures.print_s
    };
    assert!(time_s(first) > 1.5 * time_s(FirstLayer::default()));
}

/// Half a step of the z joint and what the segments may be off, mm.
const Z_SLACK_MM: f64 = 0.5 / 400.0 + 0.001;

/// Goal: layers of several heights are cut at their middles, get their own volume and lie where they should.
/// Method: a cone whose ranges ask for 7 layers up to 1 mm, leave 1 to 2 mm out and ask for a height of which no
/// whole number fits up to 3 mm; tops, sections and volumes by hand, against the simulated steps, the sections
/// and the flow.
#[test]
fn ranges_have_layers_of_their_own_height() {
    let around = 40;
    let mesh = revolved(&[[0.0, 0.0], [6.0, 0.0], [3.0, 3.0], [0.0, 3.0]], around);
    let settings = Settings::default();
    let range = |from_mm, to_mm, layer_mm| HeightRange {
        from_mm,
        to_mm,
        layer_mm,
    };
    let heights = LayerHeights {
        first_mm: 0.3,
        layer_mm: 0.2,
        ranges: vec![range(0.0, 1.0, 0.1), range(2.0, 3.0, 0.3)],
        range: None,
    };
    let part = sliced(&mesh, &heights).expect("layers");
    let mut tops_mm = vec![0.3];
    tops_mm.extend((4..=10).map(|k| 0.1 * f64::from(k)));
    tops_mm.extend((6..=10).map(|k| 0.2 * f64::from(k)));
    tops_mm.extend((9..=12).map(|k| 0.25 * f64::from(k)));
    let bottoms_mm = std::iter::once(&0.0).chain(&tops_mm);
    let heights_mm: Vec<f64> = tops_mm.iter().zip(bottoms_mm).map(|(t, b)| t - b).collect();
    assert_eq!(part.layers.len(), tops_mm.len());
    assert!(
        part.notes[0].contains("5 of 0.2 mm from 1 to 2 mm (no range"),
        "{:?}",
        part.notes
    );
    let share = 0.5 * f64::from(around) * (TAU / f64::from(around)).sin();
    for (layer, (top_mm, height_mm)) in part.layers.iter().zip(tops_mm.iter().zip(&heights_mm)) {
        assert!((layer.top_mm - top_mm).abs() < 1e-9, "{}", layer.top_mm);
        let expected_mm2 = share * (6.0 - (top_mm - 0.5 * height_mm)).powi(2);
        assert!(
            (layer.area_mm2() / expected_mm2 - 1.0).abs() < 1e-6,
            "{top_mm}"
        );
    }

    let plan = planned(&part, FirstLayer::default(), &settings);
    assert!(plan.printed.left_out.is_empty());
    for (number, height_mm) in (0u32..).zip(&heights_mm) {
        let uses = plan.printed.uses.iter().filter(|used| used.layer == number);
        let volume_mm3: f64 = uses.map(|used| used.volume_mm3).sum();
        let swept = plan
            .printed
            .swept
            .iter()
            .filter(|(layer, _)| *layer == number);
        let covered_mm2: f64 = swept.map(|(_, swept)| swept.covered_mm2).sum();
        // What is laid outside of the raster's cells, as on every layer.
        let ratio = volume_mm3 / (covered_mm2 * height_mm);
        assert!((ratio - 1.0).abs() < 0.01, "layer {number}: {ratio}");
    }

    let run = dry_run(
        &plan.printed.stream,
        &settings,
        &SimulatorSetup::default(),
        |_| {},
    )
    .expect("a run");
    assert_eq!(run.simulation.figures.faults, 0);
    let record = &run.simulation.motion;
    let steps_per_mm = settings.machine.joints[2].steps_per_unit;
    let (mut z_steps, mut layer) = (record.start_counts[2], 0);
    for step in record.steps.iter() {
        let way = if step.forward { 1 } else { -1 };
        z_steps += if step.motor == 2 { way } else { 0 };
        if step.motor != 4 || !step.forward {
            continue;
        }
        let z_mm = z_steps as f64 / steps_per_mm - plan.transform.offset_mm[2];
        let next = tops_mm.get(layer + 1);
        if next.is_some_and(|next_mm| (z_mm - next_mm).abs() < Z_SLACK_MM) {
            layer += 1;
        }
        assert!(
            (z_mm - tops_mm[layer]).abs() < Z_SLACK_MM,
            "{z_mm} on layer {layer}"
        );
    }
    assert_eq!(layer + 1, tops_mm.len());
}

/// Goal: what no bead fits in leaves the others, and is told. Method: a cone up to a point: its tip
/// is listed, everything below printed; a needle alone is refused.
#[test]
fn a_tip_is_left_out_and_told() {
    let settings = Settings::default();
    let mesh = revolved(&[[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]], 24);
    let part = cut(&mesh, 0.2, 0.2);
    let plan = planned(&part, FirstLayer::default(), &settings);
    let left_out: Vec<u32> = plan.printed.left_out.iter().map(|l| l.layer).collect();
    assert!(!left_out.is_empty() && left_out.len() < 5, "{left_out:?}");
    assert_eq!(left_out.last(), Some(&14));
    let printed = layers_of(&plan.printed.stream).len();
    assert_eq!(printed + left_out.len(), 15);
    let needle = revolved(&[[0.0, 0.0], [0.1, 0.0], [0.1, 3.0], [0.0, 3.0]], 24);
    let part = cut(&needle, 0.2, 0.2);
    let error = plan_part(&part, &[], FirstLayer::default(), &settings, &());
    let text = error.expect_err("too thin").to_string();
    assert!(text.contains("nothing can be printed"), "{text}");
}

/// Goal: of a stair with sparse lines, steps are closed, the inside is not, and what is closed holds
/// on to the inside by a bead's width. Method: ground that is swept on each layer, against walls
/// alone, from the pieces' rasters.
#[test]
fn steps_are_closed_and_the_inside_is_sparse() {
    let stair = [
        [0.0, 0.0],
        [16.0, 0.0],
        [16.0, 2.4],
        [8.0, 2.4],
        [8.0, 4.8],
        [0.0, 4.8],
    ];
    let mesh = revolved(&stair, 4);
    let part = cut(&mesh, 0.2, 0.2);
    let settings = Settings {
        infill: Some(Infill {
            density_pct: 20.0,
            bottom_layers: Some(2),
            top_layers: Some(2),
            ..Infill::solid(2)
        }),
        ..Settings::default()
    };
    let mut covered = vec![0.0; part.layers.len()];
    let plan = planned(&part, FirstLayer::default(), &settings);
    for (layer, swept) in &plan.printed.swept {
        covered[*layer as usize] += swept.covered_mm2;
    }
    let area_mm2 = |layer: usize| {
        part.layers[layer]
            .regions
            .iter()
            .map(Region::area_mm2)
            .sum::<f64>()
    };
    let pct: Vec<f64> = covered
        .iter()
        .enumerate()
        .map(|(layer, covered)| 100.0 * covered / area_mm2(layer))
        .collect();
    for layer in [0, 1, 22, 23] {
        assert!(pct[layer] > 96.0, "{layer}: {pct:?}");
    }
    for layer in [2, 5, 9, 12, 15, 21] {
        assert!(pct[layer] < 75.0, "{layer}: {pct:?}");
    }
    // The step: three quarters closed, the rest under the upper body sparse.
    for layer in [10, 11] {
        assert!(pct[layer] > 82.0 && pct[layer] < 95.0, "{layer}: {pct:?}");
    }
    check_run(&plan.printed.stream, &settings);
}

//! Goal: pieces with build directions of their own are printed by the simulated firmware without a fault, and no pose touches
//! what is printed, on machines that tilt head or table and on an arm. Method: a small T, cut by hand; poses and print are read
//! from the wire (by de Boor), and each of many poses is held against all earlier print by plain loops.

use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::geometry::aperture::Aperture;
use headway::job::MotionState;
use headway::mesh::{LoadedMesh, Mesh, Point3};
use headway::pipeline::pieces::plan_pieces;
use headway::settings::directions::{Directions, PieceCut};
use headway::settings::{Settings, machine_file};
use headway::{Plan, settings};
use headway_tests::segment_oracle::Oracle;
use nalgebra::{Rotation3, Vector3};

/// A stem 4 x 4 x 10 under an arm 15 x 4 x 4 mm.
fn tee() -> LoadedMesh {
    let outline = [
        [-2.0, 0.0],
        [2.0, 0.0],
        [2.0, 9.0],
        [7.5, 9.0],
        [7.5, 13.0],
        [-7.5, 13.0],
        [-7.5, 9.0],
        [-2.0, 9.0],
    ];
    let count = outline.len() as u32;
    let side = |y: f64| outline.iter().map(move |[x, z]| Point3::new(*x, y, *z));
    let face = [
        [0, 1, 2],
        [0, 2, 7],
        [7, 2, 4],
        [2, 3, 4],
        [7, 4, 5],
        [7, 5, 6],
    ];
    let mut triangles: Vec<[u32; 3]> = face.to_vec();
    triangles.extend(face.map(|[a, b, c]| [a + count, c + count, b + count]));
    for k in 0..count {
        let next = (k + 1) % count;
        triangles.push([k, k + count, next + count]);
        triangles.push([k, next + count, next]);
    }
    LoadedMesh {
        name: "tee".to_string(),
        mesh: Mesh {
            vertices: side(-2.0).chain(side(2.0)).collect(),
            triangles,
        },
        carved: Vec::new(),
        notes: Vec::new(),
    }
}

fn machine(name: &str) -> Settings {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/machines");
    let text = std::fs::read_to_string(format!("{folder}/{name}.toml")).unwrap();
    Settings {
        aperture: Aperture::Ellipse {
            major_mm: 1.0,
            minor_mm: 0.5,
        },
        layer_height_mm: 0.5,
        quality: settings::Quality::Fast,
        ..machine_file::from_toml(&text).unwrap()
    }
}

/// Deepest that a pose is in earlier print beyond the slack, and how many were looked at.
fn deepest_mm(plan: &Plan, settings: &Settings) -> (f64, usize) {
    let head = settings.head.as_ref().unwrap();
    let (edges, slack_mm) = (head.knots(), head.tip_slack_mm(settings.layer_height_mm));
    let oracle = Oracle::new(&plan.stream);
    let mut print: Vec<Vector3<f64>> = Vec::new();
    let (mut deepest_mm, mut looked) = (0.0f64, 0);
    let mut table_mm = f64::INFINITY;
    for mark in &plan.stream.marks {
        for tick in (mark.start_tick..mark.end_tick).step_by(8) {
            let pose = oracle.at(tick as f64, 0);
            let tip = Vector3::new(pose[0], pose[1], pose[2]);
            let axis = Rotation3::new(Vector3::new(pose[3], pose[4], 0.0)) * Vector3::z();
            if (tick - mark.start_tick) % 32 == 0 {
                looked += 1;
                for place in &print {
                    let above_mm = (place - tip).dot(&axis);
                    let aside_mm = axis.cross(&(place - tip)).norm();
                    for facet in edges.windows(2).filter(|_| above_mm > slack_mm) {
                        let [[low, narrow], [high, wide]] = [facet[0], facet[1]];
                        if (low..=high).contains(&above_mm) && high > low {
                            let share = (above_mm - low) / (high - low);
                            deepest_mm =
                                deepest_mm.max(narrow + share * (wide - narrow) - aside_mm);
                        }
                    }
                }
                let leaning = (1.0 - axis.z * axis.z).max(0.0).sqrt();
                let rims = edges
                    .iter()
                    .map(|[up, wide]| tip.z + up * axis.z - wide * leaning);
                table_mm = table_mm.min(rims.fold(f64::INFINITY, f64::min));
            }
            if mark.state == MotionState::Print && (tick - mark.start_tick) % 16 == 0 {
                print.push(tip);
            }
        }
    }
    assert!(table_mm > settings.work_area_mm[0][2] - 1e-3, "{table_mm}");
    (deepest_mm, looked)
}

fn printed(name: &str, directions: &Directions) {
    let settings = machine(name);
    let plan = plan_pieces(&tee(), directions, &settings, &()).unwrap();
    let pieces = &plan.pieces.as_ref().unwrap().figures;
    assert!((2..=5).contains(&pieces.len()), "{pieces:?}");
    let volume_mm3: f64 = pieces.iter().map(|of| of.volume_mm3).sum();
    assert!(
        (volume_mm3 / (4.0 * 36.0 + 4.0 * 60.0) - 1.0).abs() < 0.06,
        "{pieces:?}"
    );
    let left_mm2: f64 = pieces.iter().map(|of| of.overhang_mm2).sum();
    let upright_mm2: f64 = pieces.iter().map(|of| of.overhang_upright_mm2).sum();
    assert!(
        (upright_mm2 - 44.0).abs() < 5.0 && left_mm2 <= 0.06 * upright_mm2,
        "{pieces:?}"
    );
    let mut on_machine = settings.clone();
    on_machine.machine = plan.stream.machine(&settings.machine);
    let found = dry_run(
        &plan.stream,
        &on_machine,
        &SimulatorSetup::default(),
        |_| {},
    )
    .unwrap();
    assert_eq!(
        found.simulation.figures.faults, 0,
        "{:?}",
        found.simulation.fault
    );
    assert_eq!(
        plan.touches.as_ref().unwrap().touched_mm,
        0.0,
        "{:?}",
        plan.touches
    );
    let (deepest_mm, looked) = deepest_mm(&plan, &settings);
    println!(
        "{name}: {} pieces, {looked} poses, {deepest_mm:.3} mm deep",
        pieces.len()
    );
    assert!(
        looked > 1000 && deepest_mm <= 0.0,
        "{deepest_mm} of {looked}"
    );
}

/// Both arms, leaning by 45°.
fn by_hand() -> Directions {
    let arm = |side: f64| PieceCut {
        direction: [side, 0.0, 1.0],
        at_mm: [side * 2.0, 0.0, 9.1],
    };
    Directions::Given(vec![arm(1.0), arm(-1.0)])
}

#[test]
fn pieces_by_hand_are_printed_by_a_tilting_head() {
    printed("gantry", &by_hand());
}

#[test]
fn pieces_that_are_found_are_printed_by_a_tilting_head() {
    printed("gantry", &Directions::Auto);
}

#[test]
fn pieces_are_printed_on_a_tilting_table() {
    printed("trunnion", &by_hand());
}

#[test]
fn pieces_are_printed_by_an_arm() {
    printed("arm-small", &by_hand());
}

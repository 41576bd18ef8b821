//! Goal: volumes of an object (modifiers, one part among several) are printed as they ask, and objects have speeds and seams of
//! their own. Method: plates cut by hand into layers, with boxes as volumes; what is laid where, how fast and from where, by
//! samples of the finished motion, against areas by hand.

use headway::geometry::Point2;
use headway::geometry::polygon::{Region, Ring};
use headway::job::MotionState;
use headway::mesh::layers::{SlicedPart, TargetLayer};
use headway::mesh::object_settings::{
    ObjectInfill, OwnSeam, OwnSettings, OwnSpeeds, PartObject, Zone,
};
use headway::mesh::{Mesh, Point3};
use headway::pipeline::layer_uses::Use;
use headway::pipeline::mesh::{FirstLayer, PartPlan, plan_part};
use headway::report::pose_table::{StreamSample, samples_within};
use headway::settings::{Infill, Settings};
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME};
use std::ops::Range;

const HEIGHT_MM: f64 = 0.2;
/// A plate of 48 x 30 mm, and the half of it that a volume is.
const PLATE_MM: [f64; 2] = [48.0, 30.0];
const HALF_MM: f64 = 24.0;
const BEAD_MM: f64 = 1.2;

fn rectangle([x, y]: [f64; 2], [u, v]: [f64; 2]) -> Region {
    let corners = [[x, y], [u, y], [u, v], [x, v]];
    Region {
        exterior: Ring {
            points: corners.map(Point2::from).to_vec(),
        },
        holes: Vec::new(),
    }
}

/// A box by its corners.
fn cuboid(low: [f64; 3], high: [f64; 3]) -> Mesh {
    let corner = |i: usize| {
        let of = |axis: usize| [low, high][i >> axis & 1][axis];
        Point3::new(of(0), of(1), of(2))
    };
    let quads: [[u32; 4]; 6] = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    Mesh {
        vertices: (0..8).map(corner).collect(),
        triangles: quads
            .iter()
            .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
            .collect(),
    }
}

/// The half of the plate beyond 24 mm, and more on all other sides.
fn half(own: OwnSettings, is_part: bool) -> Zone {
    Zone {
        name: None,
        mesh: cuboid([HALF_MM, -5.0, -1.0], [70.0, 50.0, 9.0]),
        own,
        is_part,
    }
}

fn of_infill(infill: ObjectInfill) -> OwnSettings {
    OwnSettings {
        infill,
        ..OwnSettings::default()
    }
}

/// Plates of 48 x 30 mm one over the other, an object with these volumes; one layer more than is wanted.
fn plates(wanted: Range<u32>, own: OwnSettings, zones: Vec<Zone>) -> SlicedPart {
    let layer = |number: u32| TargetLayer {
        number,
        height_mm: HEIGHT_MM,
        top_mm: HEIGHT_MM * f64::from(number + 1),
        regions: vec![rectangle([0.0, 0.0], PLATE_MM)],
    };
    SlicedPart {
        layers: (0..wanted.end + 1).map(layer).collect(),
        wanted,
        objects: vec![PartObject {
            name: Some("plate".to_string()),
            bounds_mm: [[0.0; 3], [48.0, 30.0, 9.0]].map(Point3::from),
            own,
            zones,
        }],
        notes: Vec::new(),
    }
}

/// Settings of the job: one wall and lines of 20 % without solid layers.
fn sparse() -> Settings {
    Settings {
        infill: Some(Infill {
            density_pct: 20.0,
            bottom_layers: Some(0),
            top_layers: Some(0),
            ..Infill::solid(1)
        }),
        ..Settings::default()
    }
}

fn planned(part: &SlicedPart, settings: &Settings) -> PartPlan {
    let plan = plan_part(part, &[], FirstLayer::default(), settings, &()).expect("a plan");
    assert_eq!(plan.unfollowed, None);
    assert_eq!(plan.printed.left_out, []);
    plan
}

/// Samples of the beads of a layer, with their places on the plate.
fn beads(plan: &PartPlan, layer: u32) -> Vec<(StreamSample, Point2)> {
    let servo_hz = f64::from(Settings::default().machine.servo_hz);
    let stream = &plan.printed.stream;
    let samples = samples_within(stream, servo_hz, 1.0, stream.ticks_of_layer(layer));
    let beads = samples.filter(|sample| sample.mark.state == MotionState::Print);
    let [x, y, _] = plan.transform.offset_mm;
    let placed = beads.map(|bead| {
        let at = Point2::new(bead.position[0] - x, bead.position[1] - y);
        (bead, at)
    });
    placed.collect()
}

/// What is laid of a kind on either side of the border, farther from it and from the outline than this, mm³.
fn laid_within_mm3(plan: &PartPlan, layer: u32, what: Use, margin_mm: f64) -> [f64; 2] {
    let servo_hz = f64::from(Settings::default().machine.servo_hz);
    let mut laid_mm3 = [0.0; 2];
    for (bead, at) in beads(plan, layer) {
        let pass = bead.mark.pass.unwrap_or_default() as usize;
        let from_edges = [
            at.x,
            at.y,
            PLATE_MM[0] - at.x,
            PLATE_MM[1] - at.y,
            (at.x - HALF_MM).abs(),
        ];
        let is_within = from_edges.iter().all(|mm| *mm >= margin_mm);
        if is_within && plan.printed.pass_uses.get(pass) == Some(&what) {
            laid_mm3[usize::from(at.x > HALF_MM)] += bead.velocity[CHANNEL_VOLUME] / servo_hz;
        }
    }
    laid_mm3
}

/// What is laid of a kind on either side of the border, mm³.
fn laid_mm3(plan: &PartPlan, layer: u32, what: Use) -> [f64; 2] {
    laid_within_mm3(plan, layer, what, 0.0)
}

/// From the border and the walls to where lines are what their distance makes them, and what lies there of a layer of this
/// density on either side, mm³.
const WINDOW_MM: f64 = 4.0;

fn lines_mm3(density: f64) -> f64 {
    let [wide_mm, high_mm] = [HALF_MM, PLATE_MM[1]].map(|mm| mm - 2.0 * WINDOW_MM);
    density * HEIGHT_MM * wide_mm * high_mm
}

fn near(found: f64, asked: f64, share: f64, what: &str) {
    println!("{what}: {found:.3} of {asked:.3}");
    assert!(
        (found / asked - 1.0).abs() < share,
        "{what}: {found} {asked}"
    );
}

/// Goal: where only lines differ, the walls go around the whole object, and each side has its own lines. Method: a plate of
/// which one half is a modifier of 60 %, and one of two parts; lines in windows of 16 x 22 mm, walls by hand.
#[test]
fn a_modifier_has_its_own_lines() {
    let dense = of_infill(ObjectInfill {
        density_pct: Some(60.0),
        ..ObjectInfill::default()
    });
    let lines = |plan: &PartPlan| laid_within_mm3(plan, 1, Use::Sparse, WINDOW_MM);
    for is_part in [false, true] {
        let part = plates(1..2, OwnSettings::default(), vec![half(dense, is_part)]);
        let plan = planned(&part, &sparse());
        near(lines(&plan)[0], lines_mm3(0.2), 0.02, "lines of 20 %");
        near(lines(&plan)[1], lines_mm3(0.6), 0.02, "lines of 60 %");
        let walls: f64 = laid_mm3(&plan, 1, Use::Walls).iter().sum();
        let band_mm2 = PLATE_MM[0] * PLATE_MM[1]
            - (PLATE_MM[0] - 2.0 * BEAD_MM) * (PLATE_MM[1] - 2.0 * BEAD_MM);
        near(walls, HEIGHT_MM * band_mm2, 0.02, "walls");
    }
    // Material after it that asks for nothing ends it.
    let rest = half(OwnSettings::default(), true);
    let part = plates(1..2, OwnSettings::default(), vec![half(dense, true), rest]);
    let plan = planned(&part, &sparse());
    near(
        lines(&plan)[1],
        lines_mm3(0.2),
        0.2,
        "lines of 20 % on the other side",
    );
}

/// Goal: a modifier of 100 % is filled, one of 0 % is empty, and one with solid layers has them where it is, on top of the
/// part and not of itself. Method: volumes of kinds of lines, by hand; the filled half extends a bead into the other.
#[test]
fn a_modifier_has_its_own_solid_layers() {
    let inside_mm2 = |wide_mm: f64| wide_mm * (PLATE_MM[1] - 2.0 * BEAD_MM);
    let filled_mm3 = HEIGHT_MM * inside_mm2(HALF_MM - BEAD_MM + BEAD_MM);
    let of = |density_pct: f64| {
        of_infill(ObjectInfill {
            density_pct: Some(density_pct),
            ..ObjectInfill::default()
        })
    };
    let all =
        |plan: &PartPlan, layer: u32, what: Use| laid_mm3(plan, layer, what).iter().sum::<f64>();
    let filled = plates(1..2, OwnSettings::default(), vec![half(of(100.0), false)]);
    let filled = planned(&filled, &sparse());
    // Where walls end and lines begin is the optimiser's choice: 0.05 mm of it are 1 %.
    near(all(&filled, 1, Use::Solid), filled_mm3, 0.04, "filled");
    let empty = plates(1..2, OwnSettings::default(), vec![half(of(0.0), false)]);
    let empty = planned(&empty, &sparse());
    let lines = laid_within_mm3(&empty, 1, Use::Sparse, WINDOW_MM);
    near(
        lines[0],
        lines_mm3(0.2),
        0.02,
        "lines beside the empty half",
    );
    assert_eq!(lines[1], 0.0);

    let topped = of_infill(ObjectInfill {
        top_layers: Some(2),
        ..ObjectInfill::default()
    });
    let mut below = half(topped, false);
    below.mesh = cuboid([HALF_MM, -5.0, -1.0], [70.0, 50.0, 0.7]);
    for (zone, solid_layers) in [(half(topped, false), [4, 5].as_slice()), (below, &[])] {
        let plan = planned(&plates(2..5, OwnSettings::default(), vec![zone]), &sparse());
        for layer in 2..5 {
            // The first solid layer lies on lines of 20 %: a bridge.
            let [solid, bridge] = [Use::Solid, Use::Bridge].map(|what| all(&plan, layer, what));
            match solid_layers.contains(&layer) {
                true => near(solid + bridge, filled_mm3, 0.03, "top"),
                false => assert_eq!(solid + bridge, 0.0, "{layer}"),
            }
            assert_eq!(
                bridge > 0.0,
                solid_layers.first() == Some(&layer),
                "{layer}"
            );
        }
    }
}

/// Goal: where the number of walls differs, both sides have walls along the border, each as many as it asks for, and nothing
/// between them stays open. Method: a half of three walls and no lines beside one of one wall; areas by hand, a raster of the
/// finished motion over the border.
#[test]
fn a_modifier_has_its_own_walls() {
    let walled = of_infill(ObjectInfill {
        walls: Some(3),
        density_pct: Some(0.0),
        ..ObjectInfill::default()
    });
    let part = plates(1..2, OwnSettings::default(), vec![half(walled, false)]);
    let plan = planned(&part, &sparse());
    let band_mm2 = |walls: f64| {
        let inner = |mm: f64| mm - 2.0 * walls * BEAD_MM;
        HALF_MM * PLATE_MM[1] - inner(HALF_MM) * inner(PLATE_MM[1])
    };
    let walls = laid_mm3(&plan, 1, Use::Walls);
    // Corners of inner loops are round.
    near(walls[0], HEIGHT_MM * band_mm2(1.0), 0.03, "one wall");
    near(walls[1], HEIGHT_MM * band_mm2(3.0), 0.03, "three walls");
    let lines = laid_within_mm3(&plan, 1, Use::Sparse, WINDOW_MM);
    near(lines[0], lines_mm3(0.2), 0.02, "lines beside it");
    assert_eq!(lines[1], 0.0);
    let open_mm2 = open_mm2(
        &plan,
        [HALF_MM - 1.0, 3.0],
        [HALF_MM + 1.0, PLATE_MM[1] - 3.0],
    );
    assert!(open_mm2 < 0.1, "{open_mm2} mm² open along the border");
}

/// Area of a window that no pose of layer 1 covers, cells of 0.05 mm.
fn open_mm2(plan: &PartPlan, low: [f64; 2], high: [f64; 2]) -> f64 {
    const CELL_MM: f64 = 0.05;
    let settings = Settings::default();
    let [a, b] = [settings.aperture.major_mm(), settings.aperture.minor_mm()];
    let beads = beads(plan, 1);
    let count = |axis: usize| ((high[axis] - low[axis]) / CELL_MM).round() as usize;
    let is_open = |column: usize, row: usize| {
        let x = low[0] + (column as f64 + 0.5) * CELL_MM;
        let y = low[1] + (row as f64 + 0.5) * CELL_MM;
        !beads.iter().any(|(bead, at)| {
            let (sin, cos) = bead.position[CHANNEL_HEADING].sin_cos();
            let [u, v] = [x - at.x, y - at.y];
            let [along, across] = [u * cos + v * sin, v * cos - u * sin];
            (along / a).powi(2) + (across / b).powi(2) <= 1.0
        })
    };
    let cells = (0..count(0)).flat_map(|column| (0..count(1)).map(move |row| (column, row)));
    let open = cells.filter(|(column, row)| is_open(*column, *row)).count();
    open as f64 * CELL_MM * CELL_MM
}

/// Goal: speeds by kind are those of the object or of the modifier, where the job's own are higher, and the rest keeps the
/// job's. Method: the fastest bead of each kind on either side of the border.
#[test]
fn objects_and_modifiers_have_speeds_of_their_own() {
    let fastest = |plan: &PartPlan, is_in: fn(Point2) -> bool, what: Use| {
        let own = beads(plan, 1).into_iter().filter(|(bead, at)| {
            let pass = bead.mark.pass.unwrap_or_default() as usize;
            is_in(*at) && plan.printed.pass_uses.get(pass) == Some(&what)
        });
        own.map(|(bead, _)| bead.speed_mm_s()).fold(0.0, f64::max)
    };
    let share = Settings::default().plan_share;
    let slow = OwnSettings {
        speeds: OwnSpeeds {
            outer_wall: Some(15.0),
            inner_walls: Some(20.0),
            sparse: Some(25.0),
            ..OwnSpeeds::default()
        },
        ..OwnSettings::default()
    };
    let left = |at: Point2| at.x < HALF_MM - 1.3;
    let right = |at: Point2| at.x > HALF_MM + 1.3;
    let whole = planned(&plates(1..2, slow, Vec::new()), &sparse());
    let part = planned(
        &plates(1..2, OwnSettings::default(), vec![half(slow, false)]),
        &sparse(),
    );
    for (plan, is_in) in [
        (&whole, left as fn(Point2) -> bool),
        (&whole, right),
        (&part, right),
    ] {
        near(
            fastest(plan, is_in, Use::Walls),
            15.0 * share,
            0.02,
            "walls",
        );
        near(
            fastest(plan, is_in, Use::Sparse),
            25.0 * share,
            0.02,
            "lines",
        );
    }
    for what in [Use::Walls, Use::Sparse] {
        let speed = fastest(&part, left, what);
        assert!(speed > 1.5 * 25.0, "{what:?}: {speed}");
    }
}

/// Goal: the seam of an object is where it asks for it. Method: the first place of the walls of each layer, with seams to the
/// rear and nearest to where the head is.
#[test]
fn objects_have_seams_of_their_own() {
    let with = |seam: OwnSeam| OwnSettings {
        seam: Some(seam),
        ..OwnSettings::default()
    };
    let seams = |own: OwnSettings| -> Vec<Point2> {
        let plan = planned(&plates(0..2, own, Vec::new()), &sparse());
        (0..2).map(|layer| beads(&plan, layer)[0].1).collect()
    };
    for at in seams(with(OwnSeam::Rear)) {
        assert!(at.y > PLATE_MM[1] - BEAD_MM, "{at}");
    }
    let usual = seams(OwnSettings::default());
    assert_eq!(seams(with(OwnSeam::Nearest)), usual);
    assert!(usual.iter().any(|at| at.y < PLATE_MM[1] - BEAD_MM));
}

/// Goal: without walls, what a volume asks of its lines is not followed, and said so.
#[test]
fn without_walls_volumes_are_not_followed() {
    let dense = of_infill(ObjectInfill {
        density_pct: Some(60.0),
        ..ObjectInfill::default()
    });
    let part = plates(0..1, OwnSettings::default(), vec![half(dense, false)]);
    let plan = plan_part(&part, &[], FirstLayer::default(), &Settings::default(), &());
    let note = plan.expect("a plan").unfollowed.expect("a note");
    assert!(note.contains("plate") && note.contains("--walls"), "{note}");
}

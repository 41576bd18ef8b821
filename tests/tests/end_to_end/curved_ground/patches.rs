//! Goal: ground that hangs over, stands upright or closes around something is covered, up to the patch's own rims or an
//! outline drawn on it. Method: meshes by formulas, on a machine whose table tilts as far as it is asked to, judged by the
//! oracle on the formula.

use super::covered::{assert_printed, row};
use super::shapes::{circle, fast_gantry, machine, ring, sheet};
use headway::geometry::polygon::Region;
use headway::input::space_outline::SpaceOutline;
use headway::mesh::Mesh;
use headway::pipeline::surface::plan_on_patch;
use headway::settings::Settings;
use headway::{Plan, PlanError};
use headway_tests::ground_oracle::{Ground, Laid, Look, Vec3, laid};
use headway_tests::refusal_numbers::numbers_behind;
use std::f64::consts::TAU;

/// The trunnion, its table tilting to 170° to either side, its axes long enough.
pub fn tilting() -> Settings {
    let mut settings = machine("trunnion");
    settings.head = None;
    for joint in &mut settings.machine.joints {
        if joint.rotary {
            let least = 170f64.to_radians();
            joint.position_min = joint.position_min.min(-least);
            joint.position_max = joint.position_max.max(least);
        } else {
            joint.position_min -= 500.0;
            joint.position_max += 500.0;
        }
    }
    settings
}

/// A rectangle of a surface's parameters with a round hole.
fn with_hole(low: [f64; 2], high: [f64; 2], hole: [f64; 2], radius_mm: f64) -> Region {
    let [[x0, y0], [x1, y1]] = [low, high];
    Region {
        exterior: ring(&[[x0, y0], [x1, y0], [x1, y1], [x0, y1]]),
        holes: vec![circle(hole, radius_mm, 192, -1.0)],
    }
}

/// A region of the parameters as an outline in space.
fn drawn(region: &Region, place: impl Fn(f64, f64) -> Vec3) -> SpaceOutline {
    let rings = region.rings().map(|ring| {
        let count = ring.points.len();
        let edges = (0..count).flat_map(|k| {
            let (from, to) = (ring.points[k], ring.points[(k + 1) % count]);
            let steps = ((to - from).norm() / 0.1).ceil().max(1.0) as i32;
            (0..steps).map(move |s| from + (to - from) * (f64::from(s) / f64::from(steps)))
        });
        edges.map(|p| place(p.x, p.y)).collect()
    });
    SpaceOutline {
        name: "patch".to_string(),
        rings: rings.collect(),
    }
}

/// A mesh of a rectangle of the parameters with a margin.
fn patch(
    low: [f64; 2],
    high: [f64; 2],
    margin: f64,
    step: f64,
    place: impl Fn(f64, f64) -> Vec3,
) -> Mesh {
    let [low, high] = [low.map(|c| c - margin), high.map(|c| c + margin)];
    let counts = [0, 1].map(|k| ((high[k] - low[k]) / step).ceil() as usize);
    sheet(counts, false, |s, t| {
        place(
            low[0] + s * (high[0] - low[0]),
            low[1] + t * (high[1] - low[1]),
        )
    })
}

fn cylinder(u: f64, v: f64) -> Vec3 {
    let (sin, cos) = (u / 10.0).sin_cos();
    Vec3::new(10.0 * cos, 10.0 * sin, v)
}

fn sphere(u: f64, v: f64) -> Vec3 {
    let ((su, cu), (sv, cv)) = ((u / 15.0).sin_cos(), (v / 15.0).sin_cos());
    15.0 * Vec3::new(cv * cu, cv * su, sv)
}

fn torus(u: f64, v: f64) -> Vec3 {
    let ((su, cu), (sv, cv)) = ((u / 19.0).sin_cos(), (v / 5.0).sin_cos());
    Vec3::new((14.0 + 5.0 * cv) * cu, (14.0 + 5.0 * cv) * su, 5.0 * sv)
}

fn folded(u: f64, v: f64) -> Vec3 {
    Vec3::new(8.0 * (u / 4.0).sin() + 0.1 * u, v, u * u / 12.0)
}

type Place = fn(f64, f64) -> Vec3;

fn planned(
    name: &str,
    place: Place,
    region: &Region,
    settings: &Settings,
) -> Result<(Plan, Laid), PlanError> {
    let bounds = region.bounds();
    let mesh = patch(
        bounds.min.coords.into(),
        bounds.max.coords.into(),
        1.6,
        0.8,
        place,
    );
    let plan = plan_on_patch(Some(&drawn(region, place)), &mesh, settings, &())?;
    let found = laid(&plan, &Ground::new(place), region, &Look::default());
    row(name, &found, &plan, settings);
    Ok((plan, found))
}

#[test]
#[ignore = "the table of the measurements' page: a minute each"]
fn table_of_patches() {
    let settings = tilting();
    let cases: [(&str, Place, Region); 3] = [
        (
            "sphere's side",
            sphere,
            with_hole([0.0, -9.0], [26.0, 10.5], [12.0, 0.0], 3.5),
        ),
        (
            "torus' side",
            torus,
            with_hole([0.0, -4.8], [24.0, 6.0], [12.0, 1.0], 2.5),
        ),
        (
            "folded sheet",
            folded,
            with_hole([-9.0, -8.0], [9.0, 8.0], [1.0, 1.0], 3.0),
        ),
    ];
    for (name, place, region) in cases {
        match planned(name, place, &region, &settings) {
            Ok((plan, _)) => assert_printed(&plan, &settings),
            Err(error) => println!("{name}: {error}"),
        }
    }
    full_cylinder([10.0, 20.0], 4.0, &settings);
}

/// The wall of a cylinder with a hole in it, its mesh cut out around the hole, closed around.
fn full_cylinder([radius_mm, height_mm]: [f64; 2], hole_mm: f64, settings: &Settings) -> Laid {
    let length = TAU * radius_mm;
    let place = move |u: f64, v: f64| {
        let (sin, cos) = (u / radius_mm).sin_cos();
        Vec3::new(radius_mm * cos, radius_mm * sin, v)
    };
    let counts = [(length / 0.5) as usize, (height_mm / 0.5) as usize];
    let mut mesh = sheet(counts, true, |s, t| place(length * s, height_mm * t));
    let middle = place(0.5 * length, 0.45 * height_mm);
    // Vertices near the hole come to lie on it, triangles inside it go.
    let mut region = with_hole(
        [-2.0, 0.0],
        [length + 2.0, height_mm],
        [0.5 * length, 0.45 * height_mm],
        hole_mm,
    );
    if hole_mm == 0.0 {
        region.holes.clear();
    }
    let flat = |p: &headway::mesh::Point3| {
        let u = p.y.atan2(p.x).rem_euclid(TAU) * radius_mm;
        nalgebra::Vector2::new(u - 0.5 * length, p.z - middle.z)
    };
    if hole_mm > 0.0 {
        for vertex in &mut mesh.vertices {
            let off = flat(vertex);
            if (off.norm() - hole_mm).abs() < 0.36 {
                let to = off * (hole_mm / off.norm());
                *vertex = place(0.5 * length + to.x, middle.z + to.y).into();
            }
        }
        let vertices = mesh.vertices.clone();
        mesh.triangles.retain(|triangle| {
            !triangle
                .iter()
                .all(|&k| flat(&vertices[k as usize]).norm() < hole_mm + 1e-6)
        });
        // The hole of the mesh is the polygon of its vertices.
        let mut rim: Vec<nalgebra::Vector2<f64>> = mesh
            .vertices
            .iter()
            .map(flat)
            .filter(|off| (off.norm() - hole_mm).abs() < 1e-6)
            .collect();
        rim.sort_by(|a, b| b.y.atan2(b.x).total_cmp(&a.y.atan2(a.x)));
        let at = |off: &nalgebra::Vector2<f64>| [0.5 * length + off.x, middle.z + off.y];
        region.holes = vec![ring(&rim.iter().map(at).collect::<Vec<_>>())];
    }
    let plan = plan_on_patch(None, &mesh, settings, &()).unwrap();
    let ground = Ground {
        place: Box::new(place),
        period: Some(length),
    };
    let found = laid(&plan, &ground, &region, &Look::default());
    row("full cylinder", &found, &plan, settings);
    // The plan's own figures count neither side of the cut twice.
    let own = &plan.figures;
    assert!((own.covered_pct - found.covered_pct).abs() < 0.3, "{own:?}");
    assert!((own.overlap_pct - found.twice_pct).abs() < 0.3, "{own:?}");
    assert_printed(&plan, settings);
    found
}

/// Goal: a tube is unrolled, cut open, covered all around and printed. Method: R 4, 5 mm high, no hole.
#[test]
fn a_tube_is_covered_all_around() {
    let found = full_cylinder([4.0, 5.0], 0.0, &tilting());
    // What was asked for.
    assert!(
        found.covered_pct > 98.5 && found.twice_pct < 1.5,
        "{found:?}"
    );
}

/// Goal: an outline drawn on a sphere's side, where it leans over, is covered inside its walls. Method: R 15, a
/// rectangle of 8 x 6 mm about 20° below the equator.
#[test]
fn an_outline_is_laid_where_ground_leans_over() {
    let region = Region {
        exterior: ring(&[[0.0, -8.0], [8.0, -8.0], [8.0, -2.0], [0.0, -2.0]]),
        holes: Vec::new(),
    };
    let settings = tilting();
    let (plan, found) = planned("sphere's side", sphere, &region, &settings).unwrap();
    assert!(
        found.covered_pct > 98.5 && found.twice_pct < 1.5,
        "{found:?}"
    );
    // Facets of 0.8 mm lie 5 um below the sphere, half of which the smooth ground makes good.
    assert!(found.depth_um < 4.0, "{found:?}");
    assert!(plan.on_surface.unwrap().tilt_max_rad > 110f64.to_radians());
}

/// Goal: what is no patch is refused with the place. Method: an outline beside its mesh, a closed mesh without an
/// outline, a fin.
#[test]
fn what_is_no_patch_is_refused_with_the_place() {
    let settings = fast_gantry();
    let refused = |outline: Option<&SpaceOutline>, mesh: &Mesh| {
        let planned = plan_on_patch(outline, mesh, &settings, &());
        planned.expect_err("refused").to_string()
    };
    let mesh = patch([0.0, 0.0], [8.0, 8.0], 1.0, 1.0, cylinder);
    let region = Region {
        exterior: ring(&[[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]]),
        holes: Vec::new(),
    };
    let beside = drawn(&region, |u, v| 1.02 * cylinder(u, v));
    let error = refused(Some(&beside), &mesh);
    assert!(error.starts_with("the outline's point ("), "{error}");
    assert!(numbers_behind(&error, "mm lies ")[0] > 0.1, "{error}");

    let mut fin = mesh.clone();
    let [a, b, _] = fin.triangles[0];
    fin.vertices
        .push(headway::mesh::Point3::new(20.0, 0.0, 0.0));
    fin.triangles.push([a, b, fin.vertices.len() as u32 - 1]);
    let error = refused(None, &fin);
    assert!(
        error.starts_with("the surface is no sheet near ("),
        "{error}"
    );

    // A tetrahedron.
    let corners = [
        [0.0, 0.0, 0.0],
        [9.0, 0.0, 0.0],
        [0.0, 9.0, 0.0],
        [0.0, 0.0, 9.0],
    ];
    let closed = Mesh {
        vertices: corners.map(headway::mesh::Point3::from).to_vec(),
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    };
    let error = refused(None, &closed);
    assert!(error.contains(") mm is closed: "), "{error}");
}

//! Goal: a mesh that cannot be flattened whole is cut into patches that join with no open seam and little laid twice, in one
//! job. Method: meshes by formulas up to their rims, on a machine whose table tilts as far as it is asked to; the oracle looks
//! at the whole shape at once, by a formula that knows no seams.

use super::covered::{assert_printed, row};
use super::patches::tilting;
use super::shapes::{circle, ring, sheet};
use headway::geometry::polygon::Region;
use headway::mesh::{Mesh, Point3};
use headway::pipeline::surface::{Seams, SurfaceError, plan_on_patch};
use headway::settings::Settings;
use headway::{Plan, PlanError};
use headway_tests::ground_oracle::{Ground, Laid, Look, Vec3, laid};
use headway_tests::refusal_numbers::numbers_behind;
use std::f64::consts::TAU;

/// A sphere by distance and direction from its top: no seam but the rim.
fn sphere(radius_mm: f64) -> impl Fn(f64, f64) -> Vec3 {
    move |u, v| {
        let away = u.hypot(v);
        let (sin, cos) = (away / radius_mm).sin_cos();
        // (sin x) / x at the top.
        let out = if away < 1e-9 {
            1.0
        } else {
            radius_mm * sin / away
        };
        Vec3::new(out * u, out * v, radius_mm * cos)
    }
}

/// Rings of facets about the top, down to an angle from it.
fn dome(radius_mm: f64, angle_deg: f64, facet_mm: f64) -> Mesh {
    let place = sphere(radius_mm);
    let length_mm = radius_mm * angle_deg.to_radians();
    let rings = (length_mm / facet_mm).ceil() as u32;
    let around = (TAU * radius_mm / facet_mm) as u32;
    let mut mesh = Mesh {
        vertices: vec![Point3::from(place(0.0, 0.0))],
        triangles: Vec::new(),
    };
    for j in 1..=rings {
        for i in 0..around {
            let away = length_mm * f64::from(j) / f64::from(rings);
            let (sin, cos) = (TAU * f64::from(i) / f64::from(around)).sin_cos();
            mesh.vertices
                .push(Point3::from(place(away * cos, away * sin)));
        }
    }
    let vertex = |i: u32, j: u32| 1 + (j - 1) * around + i % around;
    for i in 0..around {
        mesh.triangles.push([0, vertex(i, 1), vertex(i + 1, 1)]);
        for j in 1..rings {
            let [a, b, c, d] = [
                vertex(i, j),
                vertex(i, j + 1),
                vertex(i + 1, j + 1),
                vertex(i + 1, j),
            ];
            mesh.triangles.push([a, b, c]);
            mesh.triangles.push([a, c, d]);
        }
    }
    mesh
}

/// Plans a dome up to its rim; the rim is a polygon of its facets' corners.
fn on_dome([radius_mm, angle_deg, facet_mm]: [f64; 3], look: &Look) -> (Plan, Laid, Settings) {
    let settings = tilting();
    let mesh = dome(radius_mm, angle_deg, facet_mm);
    let plan = plan_on_patch(None, &mesh, &settings, &()).unwrap();
    let corners = (TAU * radius_mm / facet_mm) as i32;
    let region = Region {
        exterior: circle(
            [0.0, 0.0],
            radius_mm * angle_deg.to_radians(),
            // The oracle's boundary is a circle, not the chords of the facets.
            64 * corners,
            1.0,
        ),
        holes: Vec::new(),
    };
    let found = laid(&plan, &Ground::new(sphere(radius_mm)), &region, look);
    row("dome", &found, &plan, &settings);
    (plan, found, settings)
}

fn told(plan: &Plan) -> Seams {
    let on = plan.on_surface.as_ref().unwrap();
    println!("{:?}", on.seams);
    for layer in &on.layers {
        let open: Vec<_> = layer.open.iter().take(4).collect();
        println!("{:?} {open:?}", layer.swept);
    }
    on.seams.unwrap()
}

/// What was asked for, by the oracle; the plan's own figures say the same.
fn assert_covered(plan: &Plan, found: &Laid) {
    assert!(
        found.covered_pct >= 98.5 && found.twice_pct <= 1.5,
        "{found:?}"
    );
    let own = &plan.figures;
    assert!((own.covered_pct - found.covered_pct).abs() < 0.3, "{own:?}");
    assert!((own.overlap_pct - found.twice_pct).abs() < 0.3, "{own:?}");
    assert!(
        (own.area_mm2 / found.area_mm2 - 1.0).abs() < 0.01,
        "{own:?}"
    );
}

/// Goal: a dome beyond its equator, which no one chart holds, is covered across its seams and printed. Method: R 5 to 100°.
#[test]
fn a_dome_beyond_its_equator_is_printed_in_patches() {
    let look = Look {
        cell_mm: 0.03,
        ..Look::default()
    };
    let (plan, found, settings) = on_dome([5.0, 100.0, 0.5], &look);
    let seams = told(&plan);
    assert!((2..=5).contains(&seams.patches), "{seams:?}");
    // A hundredth of a millimetre of each seam, on average, at most.
    assert!(seams.open_mm2 < 0.01 * seams.length_mm, "{seams:?}");
    assert_covered(&plan, &found);
    // The ground's facets of 0.5 mm are 6 um off R 5, and their chords 6 um inside the rim.
    assert!(found.depth_um < 8.0, "{found:?}");
    assert_printed(&plan, &settings);
}

#[test]
#[ignore = "the table of the measurements' page: a minute"]
fn a_dome_to_123_degrees_is_printed_in_patches() {
    let (plan, found, settings) = on_dome([10.0, 123.0, 0.5], &Look::default());
    told(&plan);
    assert_printed(&plan, &settings);
    assert_covered(&plan, &found);
}

#[test]
#[ignore = "the table of the measurements' page: some minutes"]
fn a_torus_to_145_degrees_is_printed_in_patches() {
    let settings = tilting();
    let [out_mm, tube_mm] = [10.0, 5.0];
    let length_mm = TAU * out_mm;
    let place = move |u: f64, v: f64| {
        let ((su, cu), (sv, cv)) = ((u / out_mm).sin_cos(), (v / tube_mm).sin_cos());
        let out = out_mm + tube_mm * cv;
        Vec3::new(out * cu, out * su, tube_mm * sv)
    };
    // From 145° off the top on the outside to 145° on the inside.
    let [low, high] = [-55f64, 235.0].map(|deg| tube_mm * deg.to_radians());
    let counts = [
        (TAU * (out_mm + tube_mm) / 0.6) as usize,
        ((high - low) / 0.5) as usize,
    ];
    let mesh = sheet(counts, true, |s, t| {
        place(length_mm * s, low + (high - low) * t)
    });
    let plan = plan_on_patch(None, &mesh, &settings, &()).unwrap();
    let region = Region {
        exterior: ring(&[
            [-2.0, low],
            [length_mm + 2.0, low],
            [length_mm + 2.0, high],
            [-2.0, high],
        ]),
        holes: Vec::new(),
    };
    let ground = Ground {
        place: Box::new(place),
        period: Some(length_mm),
    };
    let found = laid(&plan, &ground, &region, &Look::default());
    row("torus", &found, &plan, &settings);
    told(&plan);
    assert_printed(&plan, &settings);
    assert_covered(&plan, &found);
}

/// Goal: what patches do not mend is refused as before, with the place. Method: a dome with a crease around it.
#[test]
fn a_crease_is_refused_in_patches_as_well() {
    let mut mesh = dome(5.0, 100.0, 0.5);
    for vertex in &mut mesh.vertices {
        if vertex.z < 1.0 {
            let out = 1.0 + 0.3 * (1.0 - vertex.z);
            (vertex.x, vertex.y) = (out * vertex.x, out * vertex.y);
        }
    }
    match plan_on_patch(None, &mesh, &tilting(), &()) {
        Err(PlanError::Surface(SurfaceError::TooRough(refused))) => {
            let text = refused.to_string();
            let at_mm = numbers_behind(&text, "near (");
            assert!((at_mm[2] - 1.0).abs() < 1.0, "{text}");
        }
        other => panic!("{:?}", other.map(|plan| plan.figures)),
    }
}

/// Goal: a skirt is not left out without a word. Method: a dome in patches, with one loop around it.
#[test]
fn a_skirt_around_patches_is_refused() {
    let mut settings = tilting();
    settings.skirt.loops = 1;
    match plan_on_patch(None, &dome(5.0, 100.0, 0.5), &settings, &()) {
        Err(error) => {
            let text = error.to_string();
            let patches = numbers_behind(&text, "the surface is cut into ")[0];
            assert!((2.0..=5.0).contains(&patches), "{text}");
        }
        other => panic!("{:?}", other.map(|plan| plan.figures)),
    }
}

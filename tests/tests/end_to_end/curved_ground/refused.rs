//! Goal: ground that a flat nozzle cannot lie on is refused or reported with the place, and ground that is steep only
//! beside the outline is not refused. Method: meshes by formulas.

use super::shapes::{circle, fast_gantry, ring, sheet, target};
use headway::geometry::polygon::Region;
use headway::mesh::Mesh;
use headway::pipeline::surface::plan_on_surface;
use headway::settings::Quality;
use headway::{Plan, PlanError};
use headway_tests::ground_oracle::{Ground, Look, Vec3, laid};
use headway_tests::refusal_numbers::numbers_behind;
use std::f64::consts::{PI, TAU};

fn heights(half_mm: f64, step_mm: f64, height: impl Fn(f64, f64) -> f64) -> Mesh {
    let count = (2.0 * half_mm / step_mm).round() as usize;
    sheet([count, count], false, |s, t| {
        let (x, y) = (half_mm * (2.0 * s - 1.0), half_mm * (2.0 * t - 1.0));
        Vec3::new(x, y, height(x, y))
    })
}

fn square(half_mm: f64) -> Region {
    let h = half_mm;
    Region {
        exterior: ring(&[[-h, -h], [h, -h], [h, h], [-h, h]]),
        holes: Vec::new(),
    }
}

/// The text, the radius of the bend and its place.
fn bend(planned: Result<Plan, PlanError>) -> (String, f64, Vec<f64>) {
    let text = planned.expect_err("refused").to_string();
    let radius_mm = numbers_behind(&text, "the surface bends with a radius of ");
    let at_mm = numbers_behind(&text, "near (");
    assert!(!radius_mm.is_empty() && at_mm.len() >= 3, "{text}");
    (text, radius_mm[0], at_mm)
}

/// A crease of 53° (slopes of 0.5 to either side) was laid without a word, the nozzle's ends in the air or in the ground.
#[test]
fn a_crease_is_refused_with_its_place() {
    let roof = heights(14.0, 0.25, |x, _| 10.0 - 0.5 * (x - 1.0).abs());
    let planned = plan_on_surface(&target(square(6.0)), &roof, &[], &fast_gantry(), &());
    let (error, radius_mm, at_mm) = bend(planned);
    assert!(radius_mm < 1.8 && (at_mm[0] - 1.0).abs() < 0.5, "{error}");
}

/// A ripple of R 1 mm: waves of 5 mm, 0.6 mm high.
#[test]
fn a_ripple_is_refused_with_its_place() {
    let ripple = heights(14.0, 0.1, |x, _| 3.0 + 0.6 * (TAU * x / 5.0).sin());
    let planned = plan_on_surface(&target(square(6.0)), &ripple, &[], &fast_gantry(), &());
    let (error, radius_mm, at_mm) = bend(planned);
    // Crests and troughs lie a quarter wave off the zeros.
    let phase = ((at_mm[0] / 2.5 - 0.5).rem_euclid(1.0) - 0.5).abs() - 0.5;
    assert!(
        (radius_mm - 1.05).abs() < 0.15 && phase.abs() < 0.1,
        "{error} {phase}"
    );
}

/// Goal: two false refusals stay mended: a bowl of R 15 with a disc of R 9, which is steep in the corners of the disc's
/// box, and the top of a torus, which has nothing in them.
#[test]
fn steep_ground_beside_the_outline_is_no_matter() {
    let mut settings = fast_gantry();
    settings.head = None;
    settings.quality = Quality::Fast;
    // Large parts: coarse cells tell whether they are covered, and depth needs none.
    let coarse = Look {
        cell_mm: 0.05,
        ..Look::default()
    };
    let bowl = |x: f64, y: f64| 15.0 - (225.0 - (x * x + y * y).min(210.0)).sqrt();
    let disc = Region {
        exterior: circle([0.0, 0.0], 9.0, 128, 1.0),
        holes: Vec::new(),
    };
    let plan = plan_on_surface(
        &target(disc.clone()),
        &heights(12.0, 0.2, bowl),
        &[],
        &settings,
        &(),
    );
    let plan = plan.unwrap();
    let ground = Ground::new(move |x, y| Vec3::new(x, y, bowl(x, y)));
    let found = laid(&plan, &ground, &disc, &coarse);
    super::covered::row("bowl", &found, &plan, &settings);
    assert!(
        found.covered_pct > 98.5 && found.twice_pct < 1.5 && found.depth_um < 2.0,
        "{found:?}"
    );

    let torus = sheet([240, 120], true, |s, t| {
        let ((su, cu), (sv, cv)) = ((TAU * s).sin_cos(), (TAU * t - PI).sin_cos());
        let out = 10.0 + 4.0 * cv;
        Vec3::new(out * cu, out * su, 4.0 * sv)
    });
    let band = Region {
        exterior: circle([0.0, 0.0], 12.8, 128, 1.0),
        holes: vec![circle([0.0, 0.0], 7.2, 128, -1.0)],
    };
    let plan = plan_on_surface(&target(band.clone()), &torus, &[], &settings, &()).unwrap();
    let ground = Ground::new(|x: f64, y: f64| {
        let off = x.hypot(y) - 10.0;
        Vec3::new(x, y, (16.0 - off * off).max(1e-6).sqrt())
    });
    let found = laid(&plan, &ground, &band, &coarse);
    super::covered::row("torus", &found, &plan, &settings);
    assert!(
        found.covered_pct > 98.5 && found.twice_pct < 1.5,
        "{found:?}"
    );
    // At R 4 mm what is left of third order is a³ / R² = 13 um, and the smooth ground is 26 um off.
    assert!(found.depth_um < 25.0, "{found:?}");
}

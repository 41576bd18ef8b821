//! Goal: a plan on curved ground covers it as the plane is covered, lays hardly more of it twice, keeps inside the
//! outline and takes hardly longer. Method: surfaces by formulas, as facets of 0.2 mm for the planner; judged by an
//! oracle on the formula itself that shares no code with the planner (`headway_tests::ground_oracle`).

use super::shapes::{Shape, fast_gantry, ring, shapes, target};
use headway::Plan;
use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::drive::time_by_limit::time_by_limit;
use headway::geometry::polygon::Region;
use headway::pipeline::surface::plan_on_surface;
use headway::plan_target;
use headway::settings::Settings;
use headway::settings::aperture_text::parse_aperture;
use headway_tests::ground_oracle::{Ground, Laid, Look, Nozzle, Vec3, laid};

fn planned(shape: &Shape, region: &Region, settings: &Settings) -> Plan {
    plan_on_surface(&target(region.clone()), &shape.mesh(), &[], settings, &()).unwrap()
}

pub fn row(name: &str, found: &Laid, plan: &Plan, settings: &Settings) {
    let f = &plan.figures;
    let mut limits: Vec<(String, f64)> = time_by_limit(&plan.stream, settings)
        .shares
        .into_iter()
        .collect();
    limits.sort_by(|a, b| b.1.total_cmp(&a.1));
    limits.truncate(4);
    let limits: Vec<String> = limits
        .iter()
        .map(|(name, share)| format!("{name} {share:.2}"))
        .collect();
    let on = plan.on_surface.as_ref().unwrap();
    println!(
        "{name:14} covered {:.2} twice {:.2} outside {:.3} ({:.1} um) mm/mm2 {:.3} ms/mm2 {:.1} volume {:.4} passes {} area \
         {:.1} | own {:.2} {:.2} {:.1} um | scales {:.3?} off {:.3} | {}",
        found.covered_pct,
        found.twice_pct,
        found.outside_pct,
        found.depth_um,
        found.print_mm / found.area_mm2,
        1e3 * found.print_s / found.area_mm2,
        found.volume_ratio,
        found.passes,
        found.area_mm2,
        f.covered_pct,
        f.overlap_pct,
        1e3 * f.outside_depth_mm,
        on.scales,
        on.off_mm,
        limits.join(", "),
    );
}

#[test]
#[ignore = "the table of the measurements' page: some minutes"]
fn table_of_surfaces() {
    let settings = fast_gantry();
    for outline in ["square", "L"] {
        let plane = super::shapes::outline(outline);
        let flat = plan_target(&target(plane.clone()), &settings).unwrap();
        let f = &flat.figures;
        println!(
            "planar {outline}: {:.2} {:.2} mm/mm2 {:.3}",
            f.covered_pct,
            f.overlap_pct,
            f.print_mm / f.area_mm2
        );
    }
    for shape in shapes() {
        for outline in ["square", "L"] {
            let region = shape.outline(outline);
            let plan = planned(&shape, &region, &settings);
            let found = laid(&plan, &shape.ground(), &region, &Look::default());
            row(
                &format!("{} {outline}", shape.name),
                &found,
                &plan,
                &settings,
            );
        }
    }
}

/// Simulated without a fault, the tip as near as half a step and 5 um explain.
pub fn assert_printed(plan: &Plan, settings: &Settings) {
    let printed = dry_run(&plan.stream, settings, &SimulatorSetup::default(), |_| {}).unwrap();
    let (figures, trace) = (&printed.simulation.figures, &printed.trace);
    assert_eq!(figures.faults, 0, "{:?}", printed.simulation.fault);
    assert!(
        trace.tip_error_um_max <= trace.half_step_um_max + 5.0,
        "{trace:?}"
    );
}

/// Goal: small parts on a dome and an arch are covered as in the plane, outside by no more than 2 um, with the volume
/// that lies there; figures of the plan say what the oracle finds. Method: see the head of this file.
#[test]
fn curved_ground_is_covered_as_the_plane_is() {
    let settings = fast_gantry();
    let square = Region {
        exterior: ring(&[[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]]),
        holes: Vec::new(),
    };
    let plane = plan_target(&target(square.clone()), &settings)
        .unwrap()
        .figures;
    for (name, shift) in [("dome", [9.0, 3.0]), ("arch", [11.0, 0.0])] {
        let shape = shapes()
            .into_iter()
            .find(|shape| shape.name == name)
            .unwrap();
        let region = square.shifted(shift.into());
        let plan = planned(&shape, &region, &settings);
        let found = laid(&plan, &shape.ground(), &region, &Look::default());
        row(name, &found, &plan, &settings);
        // The bounds that were asked for.
        assert!(found.covered_pct > plane.covered_pct - 0.3, "{found:?}");
        assert!(found.twice_pct < plane.overlap_pct + 0.5, "{found:?}");
        assert!(found.depth_um < 2.0, "{found:?}");
        assert!((found.volume_ratio - 1.0).abs() < 0.01, "{found:?}");
        // Cells of 0.02 mm against those of the plan's own raster, and a tick between poses.
        let f = &plan.figures;
        assert!(
            (f.covered_pct - found.covered_pct).abs() < 0.15,
            "{found:?}"
        );
        assert!((f.overlap_pct - found.twice_pct).abs() < 0.15, "{found:?}");
        assert!(
            (1e3 * f.outside_depth_mm - found.depth_um).abs() < 1.0,
            "{found:?}"
        );
        assert!(
            // A row of cells along a side of 8 mm.
            (f.area_mm2 / found.area_mm2 - 1.0).abs() < 5e-3,
            "{found:?}"
        );
        assert_printed(&plan, &settings);
    }
}

/// Goal: a polygon that no turn but a whole one brings onto itself covers curved ground as the plane, and stays inside. Method:
/// a trapezoid of 1.1 x 0.5 to 0.3 mm on a dome and an arch, judged by its corners in the tool's frame.
#[test]
fn a_nozzle_without_symmetry_covers_curved_ground() {
    let corners = [[-0.5, -0.25], [0.6, -0.15], [0.6, 0.15], [-0.5, 0.25]];
    let mut settings = fast_gantry();
    let text = format!("polygon:{corners:?}").replace(' ', "");
    settings.aperture = parse_aperture(&text).unwrap();
    assert!(settings.aperture.period_rad() > 6.0);
    let square = Region {
        exterior: ring(&[[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]]),
        holes: Vec::new(),
    };
    let in_plane = plan_target(&target(square.clone()), &settings).unwrap();
    let plane = &in_plane.figures;
    let look = Look {
        nozzle: Nozzle::Polygon(corners.to_vec()),
        ..Look::default()
    };
    // In the plane by the same oracle.
    let flat = Ground::new(|u, v| Vec3::new(u, v, 0.0));
    let flat = laid(&in_plane, &flat, &square, &look);
    println!(
        "plane covered {:.2} {:.2} twice {:.2} {:.2} volume {:.4}",
        plane.covered_pct, flat.covered_pct, plane.overlap_pct, flat.twice_pct, flat.volume_ratio
    );
    for (name, shift) in [("dome", [9.0, 3.0]), ("arch", [11.0, 0.0])] {
        let shape = shapes()
            .into_iter()
            .find(|shape| shape.name == name)
            .unwrap();
        let region = square.shifted(shift.into());
        let plan = planned(&shape, &region, &settings);
        let found = laid(&plan, &shape.ground(), &region, &look);
        row(name, &found, &plan, &settings);
        assert!(found.covered_pct > plane.covered_pct - 0.3, "{found:?}");
        assert!(found.twice_pct < plane.overlap_pct + 0.5, "{found:?}");
        assert!(found.depth_um < 2.0, "{found:?}");
        assert!((found.volume_ratio - 1.0).abs() < 0.01, "{found:?}");
        let f = &plan.figures;
        assert!(
            (f.covered_pct - found.covered_pct).abs() < 0.15,
            "{found:?}"
        );
        assert!(
            (1e3 * f.outside_depth_mm - found.depth_um).abs() < 1.0,
            "{found:?}"
        );
        assert_printed(&plan, &settings);
    }
}

//! Goal: a plan on curved ground covers it as the plane is covered, lays hardly more of it twice, keeps inside the
//! outline and takes hardly longer. Method: surfaces by formulas, as facets of 0.2 mm for the planner; judged by an
//! oracle on the formula itself that shares no code with the planner (`headway_tests::ground_oracle`).

use super::shapes::{fast_gantry, machine, shapes, target};
use headway::surface_plan::plan_on_surface;
use headway_tests::ground_oracle::{Laid, Look, laid};

fn judged(name: &str, outline: &str) -> Laid {
    let shape = shapes()
        .into_iter()
        .find(|shape| shape.name == name)
        .unwrap();
    let region = shape.outline(outline);
    let settings = fast_gantry();
    let begun = std::time::Instant::now();
    let plan =
        plan_on_surface(&target(region.clone()), &shape.mesh(), &[], &settings, &()).unwrap();
    let plan_s = begun.elapsed().as_secs_f64();
    let found = laid(&plan, &shape.ground(), &region, &Look::default());
    let f = &plan.figures;
    println!(
        "{name:7} {outline:6} covered {:.2} twice {:.2} outside {:.3} ({:.1} um) mm/mm2 {:.3} ms/mm2 {:.1} volume \
         {:.4} passes {} area {:.1} | own {:.2} {:.2} {:.1} um | scales {:?} off {:.3} plan {plan_s:.1} s",
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
        plan.on_surface
            .as_ref()
            .map(|laid| laid.scales)
            .unwrap_or_default(),
        plan.on_surface
            .as_ref()
            .map(|laid| laid.off_mm)
            .unwrap_or_default(),
    );
    found
}

#[test]
#[ignore = "the table of the measurements' page: some minutes"]
fn table_of_surfaces() {
    let _ = machine;
    for shape in shapes() {
        for outline in ["square", "L"] {
            judged(shape.name, outline);
        }
    }
}

//! Goal: the parts that curved layers are measured on are printed whole on machines that tilt head or table and on an arm.
//! Method: the dome of 40 mm, the wing and the bracket planned with a skin, and every step simulated.

use super::printed::assert_printed;
use super::stairs::machine;
use headway::pipeline::surface::curved_layers::{CurvedLayers, plan_curved_layers};
use headway_tests::curved_parts::{CurvedPart, bracket, dome, wing};
use std::time::Instant;

fn whole(name: &str, part: &CurvedPart, asked: CurvedLayers) {
    for machine_name in ["gantry", "trunnion", "arm-small"] {
        let settings = machine(machine_name);
        let begun = Instant::now();
        let plan = plan_curved_layers(&part.mesh, asked, &settings, &()).unwrap();
        let figures = &plan.figures;
        println!(
            "{name} on {machine_name}, {asked:?}: planned in {:.0} s, printed in {:.0} s, {:.1} mm³, covered {:.2} %, outside \
             {:.4} mm, left out {}, touches {:?}",
            begun.elapsed().as_secs_f64(),
            figures.print_s,
            figures.volume_mm3,
            figures.covered_pct,
            figures.outside_depth_mm,
            plan.left_out.len(),
            plan.touches.as_ref().map(|touches| &touches.deepest),
        );
        assert!(figures.covered_pct > 98.5, "{figures:?}");
        assert_printed(&plan, &settings);
        println!("in all {:.0} s", begun.elapsed().as_secs_f64());
    }
}

#[test]
#[ignore = "a whole part on three machines: by name"]
fn a_whole_dome_is_printed() {
    whole("dome", &dome(1.0, 10.0, 0.25), CurvedLayers::Skin(2));
}

#[test]
#[ignore = "a whole part on three machines: by name"]
fn a_whole_wing_is_printed() {
    whole("wing", &wing(), CurvedLayers::Skin(3));
}

#[test]
#[ignore = "a whole part on three machines: by name"]
fn a_whole_bracket_is_printed() {
    whole("bracket", &bracket(), CurvedLayers::Skin(3));
}

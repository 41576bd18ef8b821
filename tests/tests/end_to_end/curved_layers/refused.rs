//! Goal: parts that curved layers do nothing for, or cannot, are refused with what to do. Method: meshes by formulas.

use super::stairs::machine;
use headway::pipeline::surface::curved_layers::{CurvedLayers, divided};
use headway_tests::curved_parts::{dome, wing};

/// A block that is a whole number of layers high has no stairs to lose.
#[test]
fn a_flat_block_is_refused() {
    let settings = machine("gantry");
    let mut part = dome(0.3, 1.0, 0.5);
    for vertex in &mut part.mesh.vertices {
        vertex.z = if vertex.z > 0.5 { 1.0 } else { 0.0 };
    }
    let error = divided(&part.mesh, CurvedLayers::Skin(3), &settings).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("no top that curved layers follow"), "{text}");
    assert!(text.contains("leave --curved-layers out"), "{text}");
}

/// A wing's rim is three layers high: more curved ones do not fit.
#[test]
fn a_thin_rim_has_no_room_for_a_thick_skin() {
    let settings = machine("gantry");
    let part = wing();
    let error = divided(&part.mesh, CurvedLayers::Skin(8), &settings).unwrap_err();
    let text = error.to_string();
    let height = text
        .split_once(") mm is ")
        .and_then(|(_, rest)| rest.split_once(" mm high"));
    let height_mm: f64 = height.and_then(|(mm, _)| mm.parse().ok()).expect(&text);
    assert!((0.5..0.75).contains(&height_mm), "{text}");
    assert!(text.contains("skin:3 fits"), "{text}");
}

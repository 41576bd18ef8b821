//! The guide's picture of curved layers: the section of the example part with a skin.

use super::stairs::machine;
use headway::geometry::Point2;
use headway::mesh::{MeshFormat, MeshOptions, read};
use headway::pipeline::surface::curved_layers::layer_shape::PartLayer;
use headway::pipeline::surface::curved_layers::{CurvedLayers, divided};
use headway_tests::curved_parts::holds;
use std::fmt::Write;
use std::path::Path;

const PX_PER_MM: f64 = 36.0;
const STEP_MM: f64 = 0.05;

/// The section of layers at y = 0, from the middle to the rim: one strip for each.
fn strips(layers: &[PartLayer], left_px: f64, base_px: f64, svg: &mut String) {
    for (number, layer) in layers.iter().enumerate() {
        let thick = |x: f64| layer.thickness_mm(Point2::new(x, 0.0)).unwrap_or(0.2);
        let (mut tops, mut undersides) = (Vec::new(), Vec::new());
        for step in 0..(12.2 / STEP_MM) as usize {
            let x = (step as f64 + 0.37) * STEP_MM;
            if holds(&layer.regions, x, 1e-3) {
                let z = layer.top_mm(Point2::new(x, 0.0));
                let px = |z: f64| (left_px + PX_PER_MM * x, base_px - PX_PER_MM * z);
                tops.push(px(z));
                undersides.push(px(z - thick(x)));
            }
        }
        let points = tops.iter().chain(undersides.iter().rev());
        let points: Vec<String> = points.map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let fill = match (layer.is_curved(), number % 2) {
            (true, 0) => "#0f766e",
            (true, _) => "#5eead4",
            (false, 0) => "#94a3b8",
            (false, _) => "#cbd5e1",
        };
        writeln!(
            svg,
            "<polygon fill=\"{fill}\" points=\"{}\"/>",
            points.join(" ")
        )
        .unwrap();
    }
}

fn words(svg: &mut String, x: f64, y: f64, text: &str) {
    writeln!(
        svg,
        "<text fill=\"#111827\" font-family=\"sans-serif\" font-size=\"15\" x=\"{x}\" y=\"{y}\">{text}</text>"
    )
    .unwrap();
}

#[test]
#[ignore = "writes docs/pictures/curved-layers.svg"]
fn the_picture_shows_the_layers_of_the_example() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let bytes = std::fs::read(root.join("examples/cap.stl")).unwrap();
    let mesh = read(&bytes, "cap", MeshFormat::Stl, &MeshOptions::default())
        .unwrap()
        .mesh;
    let settings = machine("gantry");
    let mut svg = String::from(
        "<svg viewBox=\"0 0 960 270\" width=\"960\" xmlns=\"http://www.w3.org/2000/svg\">\n\
         <rect fill=\"#ffffff\" height=\"100%\" width=\"100%\"/>\n",
    );
    let skin = divided(&mesh, CurvedLayers::Skin(3), &settings).unwrap();
    strips(&skin.layers, 24.0, 220.0, &mut svg);
    let [flat_mm3, own_mm3] = skin.figures.stair_error_mm3;
    let [flat, curved] = skin.figures.layers;
    let [least, most] = skin.figures.thickness;
    let lines = [
        "--curved-layers skin:3".to_string(),
        format!("{flat} flat layers, {curved} curved"),
        format!("stairs {own_mm3:.2} mm³ instead of {flat_mm3:.2}"),
        format!("curved ones {least:.2} to {most:.2} layer heights thick"),
    ];
    for (line, text) in lines.iter().enumerate() {
        words(&mut svg, 480.0, 70.0 + 24.0 * line as f64, text);
    }
    svg.push_str("</svg>\n");
    assert!(svg.len() > 10_000 && curved == 3);
    std::fs::write(root.join("docs/pictures/curved-layers.svg"), svg).unwrap();
}

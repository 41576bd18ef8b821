//! Goal: the command prints what a slicer's project means. Method: packages of boxes in PrusaSlicer's manner; volumes and
//! layers by hand.

use crate::rig::{box_triangles, folder, headway, object, path, stderr};
use std::io::Write;
use std::path::{Path, PathBuf};

/// A box by its corners.
type Corners = [[f64; 3]; 2];

/// A project of one object of these boxes, with what PrusaSlicer keeps of it in other files.
fn project(folder: &Path, boxes: &[Corners], files: &[(&str, &str)]) -> PathBuf {
    let (mut vertices, mut triangles) = (String::new(), String::new());
    let faces = boxes.iter().copied().flat_map(box_triangles);
    for (number, face) in faces.enumerate() {
        for [x, y, z] in face {
            vertices += &format!("<vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>");
        }
        let [a, b, c] = [0, 1, 2].map(|corner| 3 * number + corner);
        triangles += &format!("<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>");
    }
    let model = format!(
        "<model unit=\"millimeter\"><resources><object id=\"1\" type=\"model\"><mesh><vertices>{vertices}\
         </vertices><triangles>{triangles}</triangles></mesh></object></resources><build>\
         <item objectid=\"1\"/></build></model>"
    );
    let file = folder.join("plate.3mf");
    let mut package = zip::ZipWriter::new(std::fs::File::create(&file).expect("a file"));
    let options = zip::write::SimpleFileOptions::default();
    let model = [("3D/3dmodel.model", model.as_str())];
    for (name, text) in model.iter().chain(files) {
        package.start_file(*name, options).expect("a file");
        package.write_all(text.as_bytes()).expect("a file");
    }
    package.finish().expect("a file");
    file
}

/// The volumes of an object, the second one with these settings.
fn volumes(settings: &[(&str, &str)]) -> String {
    let settings = settings
        .iter()
        .map(|(key, value)| format!("<metadata type=\"volume\" key=\"{key}\" value=\"{value}\"/>"));
    let settings: String = settings.collect();
    format!(
        "<config><object id=\"1\"><volume firstid=\"0\" lastid=\"11\"/><volume firstid=\"12\" lastid=\"23\">{settings}\
         </volume></object></config>"
    )
}

const VOLUMES: &str = "Metadata/Slic3r_PE_model.config";

/// Goal: a plate of 2,000 mm³ with a slot through it is 1,500 mm³ by layers.
#[test]
fn a_negative_volume_is_cut_away() {
    let plate = [[0.0; 3], [20.0, 20.0, 5.0]];
    let slot = [[5.0, 5.0, -1.0], [15.0, 15.0, 6.0]];
    let config = volumes(&[("volume_type", "NegativeVolume")]);
    let folder = folder("negative-volume");
    let file = project(&folder, &[plate, slot], &[(VOLUMES, &config)]);
    let found = object(&headway(&["inspect", path(&file), "--json"]));
    let layers_mm3 = found["layers_volume_mm3"].as_f64().expect("a volume");
    assert!((layers_mm3 - 1500.0).abs() < 1e-6, "{layers_mm3}");
    assert_eq!(found["box_mm"][0][2], 0.0);
    let notes = found["notes"].to_string();
    assert!(notes.contains("1 negative volume"), "{notes}");
}

/// Goal: a modifier is no material, and settings of it, of its object and of heights are told in one note, also by `plan`.
/// Method: a plate of 288 mm³ with a modifier that reaches beyond it, and a range of heights.
#[test]
fn settings_of_modifiers_and_heights_are_told() {
    let plate = [[0.0; 3], [24.0, 12.0, 1.0]];
    let half = [[12.0, -3.0, -1.0], [30.0, 20.0, 2.0]];
    let config = volumes(&[
        ("volume_type", "ParameterModifier"),
        ("fill_density", "100%"),
    ]);
    let ranges = "<objects><object id=\"1\"><range min_z=\"0.4\" max_z=\"0.8\"><option opt_key=\"layer_height\">0.1\
                  </option></range></object></objects>";
    let folder = folder("height-ranges");
    let ranges = ("Metadata/Prusa_Slicer_layer_config_ranges.xml", ranges);
    let file = project(&folder, &[plate, half], &[(VOLUMES, &config), ranges]);
    let found = object(&headway(&["inspect", path(&file), "--json"]));
    let layers_mm3 = found["layers_volume_mm3"].as_f64().expect("a volume");
    assert!((layers_mm3 - 288.0).abs() < 1e-6, "{layers_mm3}");
    let told = "settings of 1 object or modifier and of height ranges are not followed: give layer heights";
    let notes = found["notes"].to_string();
    assert_eq!(notes.matches("not followed").count(), 1, "{notes}");
    assert!(notes.contains(told), "{notes}");
    let job = folder.join("plate.hwj");
    let planned = headway(&["plan", path(&file), "-o", path(&job), "--json"]);
    assert!(stderr(&planned).contains(told), "{}", stderr(&planned));
    assert_eq!(object(&planned)["layers"], 5);
}

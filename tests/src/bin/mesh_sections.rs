//! Prints the sections of a mesh as JSON, for tools/compare_sections.py:
//! `mesh_sections part.stl 0.2` -> `{"volume_mm3", "layers": [{"z_mm", "regions": [[ring, ...], ...]}]}`,
//! `z_mm` the height of the cut, rings lists of [x, y], exteriors first.

use headway::input::{Format, Input, ReadOptions, read_any};
use headway::mesh::layers::{LayerHeights, sliced};
use serde_json::json;
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, file, layer_mm] = &arguments[..] else {
        return Err("usage: mesh_sections FILE LAYER_MM".into());
    };
    let path = Path::new(file);
    let format = Format::of_ending(path).ok_or("which format?")?;
    let bytes = std::fs::read(path)?;
    let Input::Mesh(loaded) = read_any(&bytes, "part", format, &ReadOptions::default())? else {
        return Err("no mesh".into());
    };
    let layer_mm = layer_mm.parse()?;
    let heights = LayerHeights {
        first_mm: layer_mm,
        layer_mm,
        ranges: Vec::new(),
        range: None,
    };
    let part = sliced(&loaded.mesh, &heights)?;
    let layers = part.layers.iter().map(|layer| {
        let rings = |region: &headway::geometry::polygon::Region| -> Vec<Vec<[f64; 2]>> {
            let rings = region.rings();
            rings
                .map(|ring| ring.points.iter().map(|p| [p.x, p.y]).collect())
                .collect()
        };
        let regions: Vec<_> = layer.regions.iter().map(rings).collect();
        json!({"z_mm": layer.top_mm - 0.5 * layer.height_mm, "regions": regions})
    });
    let all = json!({
        "notes": loaded.notes.iter().chain(&part.notes).collect::<Vec<_>>(),
        "volume_mm3": loaded.mesh.volume_mm3(),
        "layers": layers.collect::<Vec<_>>(),
    });
    println!("{all}");
    Ok(())
}

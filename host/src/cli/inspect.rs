//! `headway inspect`: what is in a job file or an input.

use super::CliError;
use super::args::InspectArgs;
use super::console::Console;
use super::load;
use crate::geometry::polygon::{Box2, Region, Ring};
use crate::input::{Loaded, ReadOptions};
use serde_json::json;

pub(super) fn run(args: &InspectArgs, console: &Console) -> Result<(), CliError> {
    let flatten_mm = ReadOptions::default().flatten_mm;
    let loaded = load::target(&args.file, &args.input, flatten_mm, console)?;
    if args.json {
        return console.result(&format!("{:#}\n", input_json(&loaded)));
    }
    console.result(&input_text(&loaded))
}

fn input_json(loaded: &Loaded) -> serde_json::Value {
    let target = &loaded.target;
    let bounds = bounds(&target.regions);
    let regions: Vec<_> = target
        .regions
        .iter()
        .map(|region| {
            json!({
                "area_mm2": region.area_mm2(),
                "perimeter_mm": perimeter_mm(region),
                "holes": region.holes.len(),
                "points": points(region),
            })
        })
        .collect();
    json!({
        "kind": "input",
        "name": target.name,
        "area_mm2": target.regions.iter().map(Region::area_mm2).sum::<f64>(),
        "box_mm": [[bounds.min.x, bounds.min.y], [bounds.max.x, bounds.max.y]],
        "regions": regions,
        "notes": loaded.notes,
    })
}

fn input_text(loaded: &Loaded) -> String {
    let target = &loaded.target;
    let bounds = bounds(&target.regions);
    let size = bounds.size();
    let mut text = format!(
        "{}: {:.3} x {:.3} mm at ({:.3}, {:.3}), {:.3} mm² in {} region{}\n",
        target.name,
        size.x,
        size.y,
        bounds.min.x,
        bounds.min.y,
        target.regions.iter().map(Region::area_mm2).sum::<f64>(),
        target.regions.len(),
        if target.regions.len() == 1 { "" } else { "s" },
    );
    for (number, region) in target.regions.iter().enumerate() {
        text += &format!(
            "  region {number}: {:.3} mm², boundary {:.3} mm, {} holes, {} points\n",
            region.area_mm2(),
            perimeter_mm(region),
            region.holes.len(),
            points(region),
        );
    }
    text
}

fn bounds(regions: &[Region]) -> Box2 {
    let corners: Vec<_> = regions
        .iter()
        .map(Region::bounds)
        .flat_map(|b| [b.min, b.max])
        .collect();
    Box2::of(&corners)
}

fn perimeter_mm(region: &Region) -> f64 {
    region.rings().map(Ring::perimeter_mm).sum()
}

fn points(region: &Region) -> usize {
    region.rings().map(|ring| ring.points.len()).sum()
}

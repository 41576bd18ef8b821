//! `headway inspect`: the contents of a job file or an input.

use crate::cli::args::inspect::InspectArgs;
use crate::cli::error::CliError;
use crate::cli::reading::layer_options::layer_heights;
use crate::cli::reading::{job, load};
use crate::cli::terminal::console::Console;
use crate::gcode::GcodeProgram;
use crate::geometry::polygon::{Box2, Region, Ring};
use crate::input::centre_lines::{CentreLine, CentreLines};
use crate::input::near_waypoints::usual_spacing_mm;
use crate::input::waypoints::WaypointRun;
use crate::input::{Input, Loaded};
use crate::job::file::JobSummary;
use crate::job::heat::{self, HeatEvent};
use crate::mesh::layers::{SlicedPart, sliced_carved};
use crate::mesh::{LoadedMesh, Mesh};
use crate::report::figures::Figures;
use crate::report::job_texts::NAME_TEXT;
use crate::settings::Settings;
use serde_json::json;

/// Heater and fan commands that are listed one by one.
const ORDERS_TOLD: usize = 20;

pub(crate) fn run(args: &InspectArgs, console: &Console) -> Result<(), CliError> {
    if job::is_job(&args.file) {
        let summary = job::read_summary(&args.file)?;
        if args.json {
            return console.result(&format!("{:#}\n", job_json(&summary)));
        }
        return console.result(&job_text(&summary));
    }
    let settings = Settings::default();
    let loaded = match load::input(&args.file, &args.input, &settings, console)? {
        Input::Outline(loaded) => loaded,
        Input::Path(run) if args.json => {
            return console.result(&format!("{:#}\n", path_json(&run)));
        }
        Input::Path(run) => return console.result(&path_text(&run)),
        Input::Lines(drawn) => return console.result(&lines_text(&drawn)),
        Input::Mesh(loaded) => return mesh(args, &loaded, console),
        Input::Gcode(program) if args.json => {
            return console.result(&format!("{:#}\n", gcode_json(&program)));
        }
        Input::Gcode(program) => return console.result(&gcode_text(&program)),
    };
    if args.json {
        return console.result(&format!("{:#}\n", input_json(&loaded)));
    }
    console.result(&input_text(&loaded))
}

/// Lines of a drawing.
fn lines_text(drawn: &CentreLines) -> String {
    let edges = drawn.lines.iter().flat_map(CentreLine::edges);
    let length_mm: f64 = edges.map(|[from, to]| (to - from).norm()).sum();
    let closed = drawn.lines.iter().filter(|line| line.closed).count();
    let (name, count) = (&drawn.name, drawn.lines.len());
    format!("{name}: {count} lines, {closed} of them closed, {length_mm:.3} mm\n")
}

/// A mesh as it is cut.
fn mesh(args: &InspectArgs, loaded: &LoadedMesh, console: &Console) -> Result<(), CliError> {
    let heights = layer_heights(&args.layers, args.layer_height)?;
    let part = sliced_carved(&loaded.mesh, &loaded.carved, &heights)
        .map_err(|error| CliError::Job(format!("{}: {error}", args.file.display())))?;
    console.notes(&part.notes);
    if args.json {
        return console.result(&format!("{:#}\n", mesh_json(loaded, &part)));
    }
    let [low, high] = loaded.bounds_mm();
    let size = high - low;
    let of_height = match heights.ranges.is_empty() {
        true => format!(" of {} mm", heights.layer_mm),
        false => String::new(),
    };
    console.result(&format!(
        "{}: {:.3} x {:.3} x {:.3} mm at ({:.3}, {:.3}, {:.3}), {:.3} mm³ in {} triangles{}\n  {} \
         layers{}, {:.3} mm³\n",
        loaded.name,
        size.x,
        size.y,
        size.z,
        low.x,
        low.y,
        low.z,
        loaded.solids().map(Mesh::volume_mm3).sum::<f64>(),
        triangles(loaded),
        match loaded.carved.is_empty() {
            true => "",
            false => " before the negative volumes are cut away",
        },
        part.wanted_layers().len(),
        of_height,
        part.volume_mm3(),
    ))
}

fn triangles(loaded: &LoadedMesh) -> usize {
    loaded.solids().map(|mesh| mesh.triangles.len()).sum()
}

fn mesh_json(loaded: &LoadedMesh, part: &SlicedPart) -> serde_json::Value {
    let [low, high] = loaded.bounds_mm();
    let volume_mm3: f64 = loaded.solids().map(Mesh::volume_mm3).sum();
    let notes = [&loaded.notes[..], &part.notes[..]].concat();
    let layers = part.wanted_layers().iter().map(|layer| {
        json!({
            "z_mm": layer.top_mm,
            "height_mm": layer.height_mm,
            "area_mm2": layer.area_mm2(),
            "regions": layer.regions.len(),
        })
    });
    json!({
        "kind": "mesh",
        "name": loaded.name,
        "triangles": triangles(loaded),
        "volume_mm3": volume_mm3,
        "layers_volume_mm3": part.volume_mm3(),
        "box_mm": [[low.x, low.y, low.z], [high.x, high.y, high.z]],
        "layers": layers.collect::<Vec<_>>(),
        "notes": notes,
    })
}

fn job_json(summary: &JobSummary) -> serde_json::Value {
    let header = &summary.header;
    let figures: serde_json::Value = serde_json::from_str(&header.figures_json).unwrap_or_default();
    json!({
        "kind": "job",
        "name": header.texts.get(NAME_TEXT),
        "machine": header.machine_name,
        "machine_hash": format!("{:08x}", header.machine_hash),
        "format_version": header.format_version,
        "protocol_version": header.protocol_version,
        "job": format!("{:08x}", header.job),
        "offset_mm": header.transform.offset_mm,
        "frames": header.frames,
        "knots": header.knots,
        "events": header.events,
        "duration_s": duration_s(summary),
        "heat": heat_json(summary),
        "figures": figures,
    })
}

fn job_text(summary: &JobSummary) -> String {
    let header = &summary.header;
    let [x, y, z] = header.transform.offset_mm;
    let figures: Figures = serde_json::from_str(&header.figures_json).unwrap_or_default();
    format!(
        "{}: job {:08x} for machine {} ({:08x}), {:.3} s\n  format {}, protocol {}; {} knots and {} \
         flow events in {} frames of {} bytes\n  the input's origin lies at ({x:.3}, {y:.3}, {z:.3}) \
         mm on the machine\n{}",
        header.texts.get(NAME_TEXT).map_or("job", String::as_str),
        header.job,
        header.machine_name,
        header.machine_hash,
        duration_s(summary),
        header.format_version,
        header.protocol_version,
        header.knots,
        header.events,
        header.frames,
        summary.frames_end - summary.frames_start,
        figures.to_text(),
    ) + &heat_text(summary)
}

/// Orders of heaters and fans with their times.
fn heat_json(summary: &JobSummary) -> Vec<serde_json::Value> {
    let header = &summary.header;
    let servo_hz = f64::from(header.machine.servo_hz);
    let one = |event: &HeatEvent| {
        json!({
            "t_s": event.tick as f64 / servo_hz,
            "order": event.order,
        })
    };
    header.heat().iter().map(one).collect()
}

/// The same as lines, with most of many omitted.
fn heat_text(summary: &JobSummary) -> String {
    let header = &summary.header;
    let mut lines = heat::list(&header.heat(), f64::from(header.machine.servo_hz));
    let more = lines.len().saturating_sub(ORDERS_TOLD);
    lines.truncate(ORDERS_TOLD);
    let mut text: String = lines.iter().map(|line| format!("  {line}\n")).collect();
    if more > 0 {
        text += &format!("  and {more} more commands (--json lists them)\n");
    }
    text
}

fn duration_s(summary: &JobSummary) -> f64 {
    let header = &summary.header;
    let ticks = header.marks.last().map_or(0, |mark| mark.end_tick);
    ticks as f64 / f64::from(header.machine.servo_hz)
}

fn path_json(run: &WaypointRun) -> serde_json::Value {
    json!({
        "kind": "path",
        "name": run.name,
        "waypoints": run.points.len(),
        "length_mm": chords_mm(run),
        "spacing_mm": usual_spacing_mm(&run.points).0,
        "headings": run.points.iter().all(|point| point.heading_rad.is_some()),
        "notes": run.notes,
    })
}

fn path_text(run: &WaypointRun) -> String {
    let headings = match run.points.first().and_then(|point| point.heading_rad) {
        Some(_) => "with headings",
        None => "the major axis is across the travel",
    };
    format!(
        "{}: {} waypoints, {:.3} mm long, usually {:.3} mm from one waypoint to the next; {headings}\n",
        run.name,
        run.points.len(),
        chords_mm(run),
        usual_spacing_mm(&run.points).0
    )
}

fn gcode_json(program: &GcodeProgram) -> serde_json::Value {
    json!({
        "kind": "gcode",
        "name": program.name,
        "slicer": program.slicer.name(),
        "layers": program.layers(),
        "passes": program.passes.len(),
        "length_mm": program.print_mm(),
        "volume_mm3": program.volume_mm3(),
        "estimate_s": program.estimate_s,
        "headings": program.has_headings,
        "heat": program.heat.iter().map(|placed| json!({
            "line": placed.line,
            "order": placed.order,
        })).collect::<Vec<_>>(),
        "notes": program.notes,
    })
}

fn gcode_text(program: &GcodeProgram) -> String {
    let volume = program
        .volume_mm3()
        .map_or("no extrusion".to_string(), |mm3| format!("{mm3:.3} mm³"));
    let estimate = program
        .estimate_s
        .map_or(String::new(), |s| format!("; its estimate is {s:.1} s"));
    format!(
        "{}: {}, {} layers, {} passes of {:.3} mm, {volume}{estimate}\n",
        program.name,
        program.slicer.name(),
        program.layers(),
        program.passes.len(),
        program.print_mm(),
    )
}

/// Sum of the distances between waypoints.
fn chords_mm(run: &WaypointRun) -> f64 {
    let pairs = run.points.windows(2);
    pairs
        .map(|pair| (pair[1].tip_mm - pair[0].tip_mm).norm())
        .sum()
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

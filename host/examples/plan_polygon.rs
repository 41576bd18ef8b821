//! Plans a polygon with a hole, prints what it comes to, writes the job and its poses.
//!
//! `cargo run --example plan_polygon -- OUTPUT_FOLDER`

use headway::api::{Error, Machine, Options, Part, plan};
use std::path::Path;

/// Plans and writes into a folder.
pub fn run(folder: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let exterior = vec![[0.0, 0.0], [12.0, 0.0], [12.0, 8.0], [0.0, 8.0]];
    let hole = vec![[4.0, 3.0], [8.0, 3.0], [8.0, 5.0], [4.0, 5.0]];
    let part = Part::from_polygons("frame", &[vec![exterior, hole]])?;
    let mut options = Options::default();
    options.speed_mm_s = Some(40.0);
    options.aperture = Some("ellipse:1.2x0.4".to_string());
    let job = plan(&part, &Machine::default(), &options)?;
    for note in job.notes() {
        println!("note: {note}");
    }
    println!(
        "{}: {:.1} s, {:.2} % covered",
        job.name(),
        job.duration_s(),
        job.figure("covered_pct").unwrap_or_default()
    );
    let widest_mm = job.poses(0.001)?.filter_map(|pose| pose.width_mm);
    println!("widest bead: {:.3} mm", widest_mm.fold(0.0, f64::max));
    std::fs::write(folder.join("frame.hwj"), job.bytes())?;
    job.write_csv(std::fs::File::create(folder.join("frame.csv"))?, 0.001)?;
    job.write_gcode(
        std::fs::File::create(folder.join("frame.gcode"))?,
        "klipper",
    )?;
    Ok(())
}

#[allow(dead_code)]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1);
    let folder = folder.ok_or_else(|| Error::Job("give a folder for the output".to_string()))?;
    run(Path::new(&folder))
}

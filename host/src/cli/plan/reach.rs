//! `headway reach`: how much of a mesh can be printed at most.

use crate::cli::args::reach::ReachArgs;
use crate::cli::args::{InputArgs, SettingsArgs};
use crate::cli::error::CliError;
use crate::cli::reading::{load, part};
use crate::cli::terminal::console::Console;
use crate::cli::terminal::result_kind::PICTURE;
use crate::input::Input;
use crate::pipeline::reach::{PartReach, ReachDirection, ReachOptions, part_reach};
use crate::report::reach_picture::{ReachPicture, draw};
use crate::settings::Settings;
use serde_json::json;
use std::time::Instant;

/// Turns about x, y and z that bring each side down.
const SIDES: [&str; 6] = ["0,0,0", "180,0,0", "90,0,0", "-90,0,0", "0,90,0", "0,-90,0"];
/// Directions that are printed.
const DIRECTIONS: usize = 5;

pub(crate) fn run(args: &ReachArgs, console: &Console) -> Result<(), CliError> {
    let begun = Instant::now();
    if let Some(deg) = args.tilt_max.filter(|deg| !(0.0..=90.0).contains(deg)) {
        let text = format!("--tilt-max {deg}: give an angle of 0 to 90 degrees");
        return Err(CliError::Usage(text));
    }
    let output = args
        .output
        .as_ref()
        .map(|output| output.file(PICTURE, console));
    let output = output.transpose()?;
    let mut settings = load::settings(&SettingsArgs {
        machine: args.machine.clone(),
        aperture: args.aperture.iter().cloned().collect(),
        ..SettingsArgs::default()
    })?;
    settings.obstacles = part::obstacles(&args.obstacle)?;
    let (reach, side) = match args.orient {
        false => (of_side(args, None, &settings, console)?, None),
        true => best_side(args, &settings, console)?,
    };
    console.notes(&reach.notes);
    let name = args.input.display();
    if reach.found_pct == 0.0 {
        let why = reach.left_out.first().map_or("support", |place| place.why);
        return Err(CliError::Job(format!(
            "{name}: nothing of it can be printed ({why})"
        )));
    }
    if let Some(output) = &output {
        output.write(drawn(&reach, &name.to_string()).as_bytes())?;
    }
    if args.json {
        let mut object = json!(reach);
        object["rotate"] = json!(side);
        object["reach_s"] = json!(begun.elapsed().as_secs_f64());
        return console.result(&format!("{object:#}\n"));
    }
    console.result(&as_text(&reach, side))
}

fn of_side(
    args: &ReachArgs,
    side: Option<&str>,
    settings: &Settings,
    console: &Console,
) -> Result<PartReach, CliError> {
    let options = ReachOptions {
        voxel_mm: args.voxel,
        tilt_max_rad: args.tilt_max.map(f64::to_radians),
    };
    let reading = InputArgs {
        rotate: side.map(str::to_string).or(args.reading.rotate.clone()),
        ..args.reading.clone()
    };
    let refused = |text: &str| CliError::Job(format!("{}: {text}", args.input.display()));
    let Input::Mesh(mesh) = load::input(&args.input, &reading, settings, console)? else {
        return Err(refused(
            "only a mesh fills a space: give an STL, 3MF or OBJ file",
        ));
    };
    let bar = console.stage("reach");
    let reach = part_reach(&mesh, settings, &options);
    bar.finish_and_clear();
    reach.map_err(|error| refused(&error.to_string()))
}

/// The side down with which most is found; of equal ones the lowest part, which has the fewest layers.
fn best_side(
    args: &ReachArgs,
    settings: &Settings,
    console: &Console,
) -> Result<(PartReach, Option<&'static str>), CliError> {
    let mut best: Result<(PartReach, Option<&str>), CliError> = Err(CliError::OutputClosed);
    for side in SIDES {
        let reach = of_side(args, Some(side), settings, console);
        let rank = |reach: &PartReach| (reach.found_pct * 10.0).round();
        let height_mm = |reach: &PartReach| reach.size[2] as f64 * reach.voxel_mm;
        let is_better = match (&best, &reach) {
            (Ok((best, _)), Ok(reach)) => {
                let by_share = rank(reach).total_cmp(&rank(best));
                by_share
                    .then(height_mm(best).total_cmp(&height_mm(reach)))
                    .is_gt()
            }
            (Ok(_), Err(_)) => false,
            (Err(_), _) => true,
        };
        if is_better {
            best = reach.map(|reach| (reach, Some(side)));
        }
    }
    best
}

fn as_text(reach: &PartReach, side: Option<&str>) -> String {
    let mut lines = vec![format!(
        "{} voxels of {:.3} mm; the aperture alone covers {:.1} % of them",
        reach.cells.len(),
        reach.voxel_mm,
        reach.aperture_pct
    )];
    lines.extend(side.map(|side| format!("best side down: --rotate {side}")));
    lines.push("  tilt up to      found    at most".to_string());
    lines.extend(reach.levels.iter().map(|level| {
        let (found, most) = (level.found_pct, level.bound_pct);
        format!("  {:9.1}°  {found:7.1} %  {most:7.1} %", level.tilt_deg)
    }));
    lines.push(format!(
        "free tilt of the head {:.1}°: up to it, an order by height has no collision",
        reach.free_tilt_deg
    ));
    lines.extend(reach.left_out.iter().map(|place| {
        let [x, y, z] = place.middle_mm;
        let [dx, dy, dz] = place.size_mm;
        format!(
            "left out for {}: {:.0} mm³ about ({x:.1}, {y:.1}, {z:.1}) mm, {dx:.1} x {dy:.1} x {dz:.1} mm",
            place.why, place.volume_mm3
        )
    }));
    let used = reach.directions.iter().take(DIRECTIONS);
    let used = used.map(
        |ReachDirection {
             tilt_deg,
             azimuth_deg,
             share_pct,
         }| { format!("tilt {tilt_deg:.0}° to {azimuth_deg:.0}° {share_pct:.1} %") },
    );
    let (count, used) = (reach.directions.len(), used.collect::<Vec<_>>().join(", "));
    lines.push(format!("{count} directions used: {used}"));
    lines.extend(reach.pieces.filter(|pieces| *pieces > 1).map(|pieces| {
        format!("plan --directions auto divides it into {pieces} pieces, of which less hangs")
    }));
    lines
        .push("this is what is possible with material laid voxel by voxel, not a plan".to_string());
    lines.join("\n") + "\n"
}

fn drawn(reach: &PartReach, title: &str) -> String {
    let levels = reach.levels.iter();
    let levels = levels.map(|level| [level.tilt_deg, level.found_pct, level.bound_pct]);
    draw(&ReachPicture {
        title,
        levels: &levels.collect::<Vec<_>>(),
        size: reach.size,
        cells: &reach.cells,
    })
}

//! `headway inspect JOB --axes-at X,Y,Z,T`: which tool axes are free at a place and time of a job.

use crate::cli::args::inspect::InspectArgs;
use crate::cli::error::CliError;
use crate::cli::reading::job;
use crate::cli::reading::job::Job;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::result_kind::PICTURE;
use crate::job::MotionState;
use crate::plan::judge::axes_at::{AxesAt, MAP_SECTORS, Moment, axes_at};
use crate::reach::Vector3;
use crate::report::axes_picture::{self, MarkedAxis};
use crate::report::pose_table::{duration_ticks, samples};
use serde_json::json;

/// Poses of a job that are checked, at most: of longer ones they are farther apart.
const SAMPLES_MAX: f64 = 4e6;

pub(crate) fn run(args: &InspectArgs, at: &str, console: &Console) -> Result<(), CliError> {
    let [tip_mm @ .., time_s] = four_numbers(at).ok_or_else(|| {
        CliError::Usage(format!(
            "--axes-at {at}: write the tip in mm, input coordinates, and the time in s, as in --axes-at 10,20,5,180"
        ))
    })?;
    if !job::is_job(&args.file) {
        return Err(CliError::Usage(
            "--axes-at goes with a job (.hwj): the state at a time is known once it is planned"
                .to_string(),
        ));
    }
    let picture = args.picture.as_ref();
    let picture = picture
        .map(|path| path.file(PICTURE, console))
        .transpose()?;
    let job = job::read(&args.file)?;
    let axes = of_job(&job, tip_mm, time_s).ok_or_else(|| {
        CliError::Job(format!(
            "{}: the head's shape is not in the job's machine file ([head])",
            args.file.display()
        ))
    })?;
    if let Some(file) = &picture {
        let [x, y, z] = tip_mm;
        let title = format!("free tool axes, tip at ({x}, {y}, {z}) mm after {time_s} s");
        let picture = axes_picture::draw(&title, &axes.map, MAP_SECTORS, &marks(&axes));
        file.write(picture.as_bytes())?;
    }
    match args.json {
        true => console.result(&format!("{:#}\n", to_json(&axes, tip_mm, time_s))),
        false => console.result(&to_text(&axes)),
    }
}

fn four_numbers(text: &str) -> Option<[f64; 4]> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let numbers: [f64; 4] = numbers.ok()?.try_into().ok()?;
    numbers
        .iter()
        .all(|number| number.is_finite())
        .then_some(numbers)
}

fn of_job(job: &Job, tip_mm: [f64; 3], time_s: f64) -> Option<AxesAt> {
    let settings = job.settings.as_ref()?;
    let every_ticks = (duration_ticks(&job.stream) as f64 / SAMPLES_MAX).max(2.0);
    let moments = samples(&job.stream, job.servo_hz(), every_ticks).map(|sample| Moment {
        time_s: sample.time_s,
        pose: sample.position,
        lays: sample.mark.state == MotionState::Print,
    });
    let tip_mm = Vector3::from(job.transform.to_machine(tip_mm));
    axes_at(moments, tip_mm, time_s, settings)
}

fn polar_rad(axis: &Vector3) -> [f64; 2] {
    [axis.xy().norm().atan2(axis.z), axis.y.atan2(axis.x)]
}

fn marks(axes: &AxesAt) -> Vec<MarkedAxis> {
    let wish = MarkedAxis {
        at_rad: polar_rad(&axes.wish),
        label: "the job's",
        colour: "#1e3a8a",
    };
    let nearest = axes.nearest.filter(|_| !axes.wish_is_free);
    let nearest = nearest.map(|axis| MarkedAxis {
        at_rad: polar_rad(&axis),
        label: "nearest free",
        colour: "#065f46",
    });
    std::iter::once(wish).chain(nearest).collect()
}

fn free_pct(axes: &AxesAt) -> f64 {
    let rings = axes.map.chunks(MAP_SECTORS);
    // A ring has the weight of the part of the sphere that it represents.
    let weight = |ring: usize| {
        let [tilt_rad, _] = crate::plan::judge::axes_at::map_axis_rad(ring, 0);
        tilt_rad.sin()
    };
    let (mut free, mut all) = (0.0, 0.0);
    for (ring, axes) in rings.enumerate() {
        free += weight(ring) * axes.iter().filter(|is_free| **is_free).count() as f64;
        all += weight(ring) * axes.len() as f64;
    }
    100.0 * free / f64::max(all, f64::MIN_POSITIVE)
}

fn to_json(axes: &AxesAt, tip_mm: [f64; 3], time_s: f64) -> serde_json::Value {
    let numbers = |axis: &Vector3| [axis.x, axis.y, axis.z];
    let caps = axes.caps.iter().map(|cap| {
        json!({
            "axis": numbers(&cap.axis),
            "half_angle_deg": cap.angle_rad.to_degrees(),
        })
    });
    json!({
        "tip_mm": tip_mm,
        "time_s": time_s,
        "points": axes.points,
        "axis": numbers(&axes.wish),
        "axis_is_free": axes.wish_is_free,
        "nearest_free_axis": axes.nearest.as_ref().map(numbers),
        "nearest_free_lean_deg": axes.nearest.map(|axis| axis.angle(&axes.wish).to_degrees()),
        "tilt_over_table_max_deg": axes.tilt_over_table_rad.min(std::f64::consts::PI).to_degrees(),
        "free_pct": free_pct(axes),
        "caps": caps.collect::<Vec<_>>(),
    })
}

fn to_text(axes: &AxesAt) -> String {
    let degrees = |axis: &Vector3| {
        let [tilt_rad, around_rad] = polar_rad(axis).map(f64::to_degrees);
        format!("tilted by {tilt_rad:.2}° towards {around_rad:.1}°")
    };
    let state = match (axes.wish_is_free, &axes.nearest) {
        (true, _) => "free".to_string(),
        (false, Some(axis)) => format!(
            "collides; the nearest free one is tilted {:.2}° from it, {}",
            axis.angle(&axes.wish).to_degrees(),
            degrees(axis)
        ),
        (false, None) => "collides, and no other is free".to_string(),
    };
    format!(
        "the job's tool axis, {}: {state}\n  {:.1} % of the axes up to 90° are free; {} points stand, the search met {} \
         caps\n",
        degrees(&axes.wish),
        free_pct(axes),
        axes.points,
        axes.caps.len()
    )
}

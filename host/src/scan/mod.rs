//! A scan of a printed layer against its job: what of the machine makes it other than asked.
//!
//! ```text
//! bytes --read--> Cloud (mm) --register: level, turn, move--> points in the job's coordinates
//! SegmentStream --Layer: passes, stations--> --Ground: who covers what first-->
//! both --edges: nozzle, Ground of it--> --sections: volume by station--> --estimates: flow, lag, ends--> Measured
//! ```
//! In: points, a job's layer. Out: [`Measured`]: values with standard errors, or what a layer needs that tells them. Knows no
//! files and no planning. Not covered: layers that are not flat, scales of the scanner's axes.

mod changes;
mod cloud;
mod edges;
mod estimates;
mod fit;
mod ground;
mod height_map;
pub mod layer;
mod read;
mod register;
mod sections;

pub use changes::Change;
pub use estimates::{Estimate, FlowFactor};
pub use register::Registration;

use crate::settings::Settings;
use crate::text::refusal::{Refusal, refusal};
use cloud::Cloud;
use estimates::Extruder;
use ground::{Ground, Nozzle};
use layer::Layer;
use serde::Serialize;
use std::io::BufRead;

/// Ranges of flow that are listed.
const FLOWS: usize = 10;
/// Most places that are listed.
const PLACES: usize = 10;
/// From which share of its volume a place has a gap or a bulge.
const PLACE_SHARE: f64 = 0.25;

/// What a scan's numbers are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Of rows, PLY and meshes.
    pub mm_per_unit: f64,
    /// Of a picture, which cannot be read without.
    pub picture: Option<PictureScale>,
}

impl Scale {
    /// Coordinates in mm, no picture.
    pub const MM: Scale = Scale {
        mm_per_unit: 1.0,
        picture: None,
    };
}

/// What a height map's pixels are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureScale {
    /// Side of a pixel.
    pub pixel_mm: f64,
    /// Height of a grey level.
    pub level_mm: f64,
}

/// Where a bead is far from what it should be.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct OffPlace {
    /// Its middle, in the job's coordinates.
    pub at_mm: [f64; 2],
    /// Number of its pass.
    pub pass: u32,
    /// Along the pass.
    pub length_mm: f64,
    /// Volume that is too much, or too little below 0, mm³.
    pub volume_mm3: f64,
}

/// A piece of a pass as it was found, for pictures and tables.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct MeasuredStation {
    /// Number of its pass.
    pub pass: u32,
    /// Its middle.
    pub at_mm: [f64; 2],
    /// Direction of travel.
    pub along: [f64; 2],
    /// Its length along the pass.
    pub length_mm: f64,
    /// Heading of the nozzle, degrees.
    pub heading_deg: f64,
    /// Asked width.
    pub width_mm: f64,
    /// Mean flow.
    pub flow_mm3_s: f64,
    /// Asked volume and that found.
    pub volume_mm3: [Option<f64>; 2],
    /// Mean height over the ground that it covers.
    pub height_mm: Option<f64>,
    /// How far the left and the right edge are outside of the asked ones, where they are free.
    pub edges_mm: [Option<f64>; 2],
}

/// What a scan tells.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// Rows of the scan that were points.
    pub points: u64,
    /// Rows that were none.
    pub dropped: u64,
    /// How the scan lies on the job.
    pub registration: Registration,
    /// How much the layer is too high over the bed.
    pub height_error_mm: f64,
    /// Values with their errors.
    pub estimates: Vec<Estimate>,
    /// Keys of the machine file that change by them.
    pub changes: Vec<Change>,
    /// Factors by flow.
    pub flow_factors: Vec<FlowFactor>,
    /// Gaps and bulges, the largest first.
    pub places: Vec<OffPlace>,
    /// All along the passes.
    pub stations: Vec<MeasuredStation>,
}

impl Measured {
    /// A value that is told.
    pub fn value(&self, name: &str) -> Option<f64> {
        let found = self.estimates.iter().find(|estimate| estimate.name == name);
        found.and_then(|estimate| estimate.value)
    }
}

/// Size of the cells in which points are averaged, mm: smaller than what an edge is found to.
fn cell_mm(aperture: &crate::geometry::aperture::Aperture) -> f64 {
    aperture.minor_mm() / 8.0
}

/// Reads a scan and measures its layer.
///
/// # Errors
/// A `Refusal` that says what the scan lacks.
pub fn read(
    mut scan: impl BufRead,
    scale: &Scale,
    layer: &Layer,
    settings: &Settings,
) -> Result<Measured, Refusal> {
    let mut cloud = Cloud::new(cell_mm(&settings.aperture));
    read::read(&mut scan, scale, &mut cloud)?;
    measure(cloud, layer, settings)
}

fn measure(cloud: Cloud, layer: &Layer, settings: &Settings) -> Result<Measured, Refusal> {
    let (read, dropped) = (cloud.points, cloud.dropped);
    let (mut points, first_mm) = cloud.into_points()?;
    let asked = Ground::of(layer, &Nozzle::default())?;
    let (registration, edges) = register::register(&mut points, first_mm, layer, &asked)?;
    let ground = &edges.ground;
    let seen_mm = register::seen_height_mm(&points, ground);
    if (seen_mm - layer.top_mm()).abs() > 0.6 * layer.height_mm {
        return Err(refusal!(
            "the scan is {seen_mm:.3} mm high over the layer, which is {:.3} mm: is it of another layer (--layer)?",
            layer.top_mm()
        ));
    }
    let sections = sections::sections(&points, layer, ground);
    let mut estimates = estimates::of_edges(layer, &edges);
    let own = &settings.machine.extruder;
    let extruder = Extruder {
        advance_s: own.pressure_advance_s,
        window_s: 1e-3 * own.pressure_advance_window_ms,
    };
    let volumes = estimates::of_volumes(layer, &sections, &extruder);
    estimates.splice(0..0, volumes.estimates);
    let flow = estimates[0].value.unwrap_or(1.0);
    let stations = layer.stations.iter().zip(&sections);
    let stations = stations.zip(&volumes.asked_mm3).zip(&edges.off_mm);
    let stations = stations.map(
        |(((station, section), asked_mm3), off_mm)| MeasuredStation {
            pass: layer.passes[station.pass].number,
            at_mm: station.at_mm.into(),
            along: station.along.into(),
            length_mm: station.length_mm,
            heading_deg: station.heading_rad.to_degrees(),
            width_mm: 2.0 * station.half_mm,
            flow_mm3_s: asked_mm3 / station.seconds(),
            volume_mm3: [Some(*asked_mm3), section.volume_mm3],
            height_mm: section
                .volume_mm3
                .filter(|_| section.ground_mm2 > 0.0)
                .map(|volume| volume / section.ground_mm2),
            edges_mm: *off_mm,
        },
    );
    let stations: Vec<MeasuredStation> = stations.collect();
    let mut measured = Measured {
        points: read,
        dropped,
        registration,
        height_error_mm: seen_mm - layer.top_mm(),
        flow_factors: estimates::flow_factors(layer, &sections, &volumes.asked_mm3, FLOWS),
        estimates,
        places: off_places(&stations, flow),
        stations,
        changes: Vec::new(),
    };
    measured.changes = changes::changes(&measured, settings);
    Ok(measured)
}

/// Runs of stations that have too much, or too little.
fn off_places(stations: &[MeasuredStation], flow: f64) -> Vec<OffPlace> {
    let mut places: Vec<OffPlace> = Vec::new();
    let mut last = None;
    for (number, station) in stations.iter().enumerate() {
        let [Some(asked), Some(found)] = station.volume_mm3 else {
            continue;
        };
        let more = found - flow * asked;
        if more.abs() < PLACE_SHARE * flow * asked.abs() {
            continue;
        }
        let goes_on = last.is_some_and(|last: usize| last + 1 == number);
        last = Some(number);
        match places.last_mut() {
            Some(place)
                if goes_on
                    && place.pass == station.pass
                    && (place.volume_mm3 > 0.0) == (more > 0.0) =>
            {
                place.length_mm += station.length_mm;
                place.volume_mm3 += more;
            }
            _ => places.push(OffPlace {
                at_mm: station.at_mm,
                pass: station.pass,
                length_mm: station.length_mm,
                volume_mm3: more,
            }),
        }
    }
    places.sort_by(|a, b| b.volume_mm3.abs().total_cmp(&a.volume_mm3.abs()));
    places.truncate(PLACES);
    places
}

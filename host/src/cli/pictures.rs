//! Planner's intermediates -> the report's plain structs.

use super::planned::Planned;
use crate::geometry::clearance::Configuration;
use crate::geometry::frame::Frame;
use crate::geometry::polygon::Region;
use crate::geometry::{Point2, Vector2, coverage};
use crate::job::MotionState;
use crate::part_transform::PartTransform;
use crate::plan::contour::{Contour, SIMPLIFY_MM};
use crate::plan::measure::{OFF_REGIONS, RegionRaster, measure_layer};
use crate::plan::passes::PassKind;
use crate::report::coverage_picture::{Cell, CoveragePicture, Raster};
use crate::report::plan_picture::{PicturePass, PlanPicture, Zone};
use crate::report::pose_table::{duration_ticks, samples};
use crate::report::stream_plots::stream_plots;
use crate::report::{Report, ReportFile, write_report};
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y, CHANNEL_Z};

/// Most samples of a picture's paths.
const SAMPLES_MAX: u64 = 200_000;

/// All files of the report.
pub(super) fn report_files(planned: &Planned) -> Vec<ReportFile> {
    let title = format!("{}: plan", planned.name);
    let coverage_title = format!("{}: deposited area", planned.name);
    let rasters = match &planned.plan {
        Some(plan) => plan
            .regions
            .iter()
            .zip(&plan.coverage)
            .map(|(region, swept)| raster(region.contour.offset, swept))
            .collect(),
        None => rasters_of_job(planned),
    };
    write_report(&Report {
        title: &planned.name,
        figures: &planned.figures,
        plan: Some(plan_picture(&title, planned)),
        coverage: (!rasters.is_empty()).then(|| CoveragePicture {
            title: &coverage_title,
            regions: &planned.outline,
            rasters,
        }),
        motion: Some(stream_plots(
            &planned.name,
            &planned.stream,
            &planned.settings,
        )),
        notes: &planned.notes,
    })
}

/// Passes as the finished segments run them; zones from the planner, where it is at hand.
pub(super) fn plan_picture<'a>(title: &'a str, planned: &'a Planned) -> PlanPicture<'a> {
    let servo_hz = f64::from(planned.settings.machine.servo_hz);
    let zone_of = zones(planned);
    let (passes, travel) = stream_paths(planned, servo_hz, &zone_of);
    let mut axis = Vec::new();
    for region in planned.plan.iter().flat_map(|plan| &plan.regions) {
        let point = |node: u32| region.axis.points.get(node as usize);
        axis.extend(region.axis.links.iter().filter_map(|&[from, to]| {
            let offset: Vector2 = region.contour.offset;
            Some(vec![point(from)? + offset, point(to)? + offset])
        }));
    }
    for skirt in planned.plan.iter().filter_map(|plan| plan.skirt.as_ref()) {
        let links = skirt.axis.iter();
        axis.extend(links.map(|&[from, to]| vec![from + skirt.offset, to + skirt.offset]));
    }
    let keep_out = planned.plan.as_ref().map(|plan| plan.keep_out.as_slice());
    PlanPicture {
        title,
        keep_out: keep_out.unwrap_or_default(),
        regions: &planned.outline,
        aperture: planned.settings.aperture,
        axis,
        passes,
        travel,
        unreachable: planned
            .unreachable
            .iter()
            .map(|run| vec![run.from, run.to])
            .collect(),
    }
}

/// The zone of each pass number.
fn zones(planned: &Planned) -> Vec<Zone> {
    let Some(plan) = &planned.plan else {
        return Vec::new();
    };
    plan.curves
        .iter()
        .map(|curve| match curve.kind {
            PassKind::TwoPass => Zone::TwoPass,
            PassKind::OnePass => Zone::OnePass,
            PassKind::Infill => Zone::Infill,
            PassKind::Skirt => Zone::Skirt,
        })
        .collect()
}

fn stream_paths(
    planned: &Planned,
    servo_hz: f64,
    zone_of: &[Zone],
) -> (Vec<PicturePass>, Vec<Vec<Point2>>) {
    let stream = &planned.stream;
    let every_ticks = duration_ticks(stream).div_ceil(SAMPLES_MAX).max(1) as f64;
    let mut passes: Vec<PicturePass> = Vec::new();
    let mut travel: Vec<Vec<Point2>> = Vec::new();
    let mut before: Option<(MotionState, Option<u32>)> = None;
    for sample in samples(stream, servo_hz, every_ticks) {
        let now = (sample.mark.state, sample.mark.pass);
        let is_new = before != Some(now);
        before = Some(now);
        let at = configuration(&planned.transform, &sample.position);
        match sample.mark.state {
            MotionState::Print => {
                if is_new {
                    passes.push(PicturePass {
                        placements: Vec::new(),
                    });
                }
                let number = sample.mark.pass.map_or(usize::MAX, |pass| pass as usize);
                let zone = zone_of.get(number).copied().unwrap_or(Zone::Unknown);
                if let Some(pass) = passes.last_mut() {
                    pass.placements.push((at, zone));
                }
            }
            // The way to the first pass interrupts nothing.
            MotionState::Travel if !passes.is_empty() => {
                if is_new {
                    travel.push(Vec::new());
                }
                if let Some(way) = travel.last_mut() {
                    way.push(at.center);
                }
            }
            _ => {}
        }
    }
    (passes, travel)
}

fn configuration(transform: &PartTransform, position: &[f64; 7]) -> Configuration {
    let [x, y, _] = transform.to_input([
        position[CHANNEL_X],
        position[CHANNEL_Y],
        position[CHANNEL_Z],
    ]);
    Configuration {
        center: Point2::new(x, y),
        heading_rad: position[CHANNEL_HEADING],
    }
}

/// A job from a file is swept again over the outline that rode along.
fn rasters_of_job(planned: &Planned) -> Vec<Raster> {
    // What was planned once has contours; an outline that has none is not drawn.
    let contours: Option<Vec<Contour>> = planned
        .outline
        .iter()
        .map(|region| Contour::of_region(region, SIMPLIFY_MM).ok())
        .collect();
    let contours: Vec<Contour> = contours.unwrap_or_default();
    let servo_hz = f64::from(planned.settings.machine.servo_hz);
    let (passes, _) = stream_paths(planned, servo_hz, &[]);
    let region_of_pass: Vec<usize> = passes
        .iter()
        .map(|pass| {
            let start = pass.placements.first().map(|(at, _)| at.center);
            let holds = |region: &Region| start.is_some_and(|p| region.contains(p));
            planned
                .outline
                .iter()
                .position(holds)
                .unwrap_or(OFF_REGIONS)
        })
        .collect();
    let (_, swept) = measure_layer(
        &planned.stream,
        &contours.iter().collect::<Vec<_>>(),
        &region_of_pass,
        &planned.transform,
        &planned.settings,
        &(),
    );
    contours
        .iter()
        .zip(&swept)
        .map(|(contour, swept)| raster(contour.offset, swept))
        .collect()
}

fn raster(offset: Vector2, raster: &RegionRaster) -> Raster {
    let swept = &raster.swept;
    Raster {
        frame: Frame {
            centre: raster.frame.centre + offset,
            ..raster.frame
        },
        origin: swept.origin,
        cell_mm: swept.cell_mm,
        columns: swept.columns,
        cells: swept
            .cells
            .iter()
            .map(|cell| match cell {
                coverage::Cell::Outside => Cell::Empty,
                coverage::Cell::Gap => Cell::Gap,
                coverage::Cell::Covered => Cell::Once,
                coverage::Cell::Overlap => Cell::Overlap,
                coverage::Cell::Spill => Cell::Spill,
            })
            .collect(),
    }
}

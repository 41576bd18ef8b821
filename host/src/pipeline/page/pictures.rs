//! Planner's intermediates -> the report's plain structs.
//!
//! In: a planned job, with the planner's intermediates where they are at hand. Out: the report's files, or its page
//! alone. Leaves out where they go.

use crate::drive::time_by_limit::limit_names;
use crate::geometry::clearance::Configuration;
use crate::geometry::coverage::Coverage;
use crate::geometry::frame::Frame;
use crate::geometry::polygon::Region;
use crate::geometry::{Point2, Vector2};
use crate::job::transform::PartTransform;
use crate::job::{MotionState, SegmentStream};
use crate::pipeline::page::layers::{LayerMotions, kinds_of_layers};
use crate::pipeline::planned::Planned;
use crate::plan::judge::measure::{MeasuredPrint, measure};
use crate::plan::judge::region_raster::RegionRaster;
use crate::plan::layers::layer_groups::OFF_REGIONS;
use crate::plan::outline::contour::{Contour, SIMPLIFY_MM};
use crate::plan::pass::PassKind;
use crate::report::figures::SlowPlaceFigures;
use crate::report::machine_links::MachineLinks;
use crate::report::page::{inline_html, live_html};
use crate::report::plan_marks::Colouring;
use crate::report::plan_picture::{PicturePass, PlanPicture, Zone};
use crate::report::pose_table::{duration_ticks, samples_within};
use crate::report::{DrawnLayer, Place, Report, ReportFile, write_report};
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y, CHANNEL_Z};

/// Most samples of a picture's paths.
const SAMPLES_MAX: u64 = 200_000;

/// A layer that is drawn for all that are like it.
pub struct ShownLayer {
    /// From 0.
    pub layer: u32,
    /// Its number and the layers identical to it; empty if there is only one.
    pub label: String,
    title: String,
}

impl ShownLayer {
    fn of(planned: &Planned, layer: u32, label: String) -> ShownLayer {
        let title = match label.as_str() {
            "" => format!("{}: plan", planned.name),
            label => format!("{}: plan, {label}", planned.name),
        };
        ShownLayer {
            layer,
            title,
            label,
        }
    }
}

/// The first layer of each kind.
fn shown_layers(planned: &Planned) -> Vec<ShownLayer> {
    let layers = planned.stream.layers();
    let kind_of_layer = kinds_of_layers(planned);
    // A range of layers need not begin with the first.
    let lowest = planned.stream.marks.first().map_or(0, |mark| mark.layer);
    // A job from a file may be without its settings, and a part's layers all differ.
    if layers <= 1 || kind_of_layer.len() != layers as usize {
        let label = |layer: u32| match layers {
            0 | 1 => String::new(),
            _ => format!("layer {} of {layers}", layer + 1),
        };
        // Of a part in curved layers the last as well: it follows the top.
        let is_curved = planned.plan.as_ref();
        let is_curved = is_curved.is_some_and(|plan| plan.is_in_space());
        let last = (is_curved && layers > lowest + 1).then(|| layers - 1);
        let shown = std::iter::once(lowest).chain(last);
        return shown
            .map(|layer| ShownLayer::of(planned, layer, label(layer)))
            .collect();
    }
    let kinds = kind_of_layer.iter().max().map_or(0, |last| last + 1);
    (0..kinds)
        .filter_map(|kind| {
            let layer = kind_of_layer.iter().position(|&of| of == kind)?;
            let like = kind_of_layer.iter().filter(|&&of| of == kind).count() - 1;
            let like = match like {
                0 => String::new(),
                like => format!(" and {like} like it"),
            };
            let kinds = planned.figures.layer_kinds.as_deref();
            let laid = kinds.and_then(|kinds| kinds.get(kind)?.inside_text());
            let inside = laid.map_or(String::new(), |laid| format!(" ({laid})"));
            let label = format!("layer {} of {layers}{like}{inside}", layer + 1);
            Some(ShownLayer::of(planned, layer as u32, label))
        })
        .collect()
}

/// All files of the report.
pub fn report_files(planned: &Planned) -> Vec<ReportFile> {
    with_report(planned, write_report)
}

/// The page with the bar that watches and orders a print.
pub fn live_page(planned: &Planned) -> String {
    with_report(planned, live_html)
}

/// The page by itself: no file lies beside it.
pub fn inline_page(planned: &Planned) -> String {
    with_report(planned, inline_html)
}

fn with_report<T>(planned: &Planned, finish: impl FnOnce(&Report) -> T) -> T {
    let shown = shown_layers(planned);
    let rasters = rasters(planned, &shown);
    let motions = LayerMotions::of(planned);
    let drawn = shown.iter().zip(rasters).map(|(shown, swept)| DrawnLayer {
        layer: shown.layer,
        label: &shown.label,
        plan: plan_picture(&shown.title, planned, shown.layer),
        swept,
        motion: motions.motion(shown.layer),
    });
    let settings = &planned.settings;
    let machine = planned.stream.machine(&settings.machine);
    finish(&Report {
        title: &planned.name,
        figures: &planned.figures,
        layers: drawn.collect(),
        more_layers: motions.more(&shown),
        facts: motions.facts(),
        notes: &planned.notes,
        machine: MachineLinks::of(&machine, settings, &planned.transform),
        servo_hz: f64::from(settings.machine.servo_hz),
        flow_limit_mm3_s: settings.flow_max_mm3_s * settings.plan_share,
        limits: &limit_names(settings),
        slow_places: &slow_places(planned),
        left_out: &planned.left_out,
    })
}

fn slow_places(planned: &Planned) -> Vec<Place> {
    let places = planned.figures.slow_places.iter().flatten();
    let place = |place: &SlowPlaceFigures| Place {
        what: match place.limit.as_str() {
            "none" => format!("{:.2} s for a millimetre", place.seconds),
            limit => format!(
                "{:.2} s for a millimetre, by {}",
                place.seconds,
                limit.replace('_', " ")
            ),
        },
        x_mm: place.x_mm,
        y_mm: place.y_mm,
        layer: place.layer,
    };
    places.map(place).collect()
}

/// What was swept of each layer shown.
fn rasters(planned: &Planned, shown: &[ShownLayer]) -> Vec<Vec<(Frame, Coverage)>> {
    let Some(plan) = &planned.plan else {
        return rasters_of_job(planned, shown);
    };
    if plan.is_in_space() {
        // Most of the layers are in space: there is no one plane to draw cells in.
        return shown.iter().map(|_| Vec::new()).collect();
    }
    let of_layer = |shown: &ShownLayer| {
        let prints = plan.prints.iter();
        let prints = prints.filter(|print| print.layer == shown.layer);
        prints
            .filter_map(|print| {
                let swept = plan.measured.rasters[print.like].as_ref()?;
                Some(placed(plan.region_of(print).contour.offset, swept))
            })
            .collect()
    };
    shown.iter().map(of_layer).collect()
}

/// A layer's passes as the finished segments run them; zones from the planner, where it is at hand.
pub fn plan_picture<'a>(title: &'a str, planned: &'a Planned, layer: u32) -> PlanPicture<'a> {
    let servo_hz = f64::from(planned.settings.machine.servo_hz);
    let zone_of = zones(planned);
    let (passes, travel) = stream_paths(planned, servo_hz, &zone_of, layer);
    let mut axis = Vec::new();
    for region in planned.plan.iter().flat_map(|plan| plan.regions()) {
        let point = |node: u32| region.axis.points.get(node as usize);
        axis.extend(region.axis.links.iter().filter_map(|&[from, to]| {
            let offset: Vector2 = region.contour.offset;
            Some(vec![point(from)? + offset, point(to)? + offset])
        }));
    }
    let skirt = planned.plan.iter().filter_map(|plan| plan.skirt.as_ref());
    for skirt in skirt.filter(|_| layer == 0) {
        let links = skirt.axis.iter();
        axis.extend(links.map(|&[from, to]| vec![from + skirt.offset, to + skirt.offset]));
    }
    let keep_out = planned.plan.as_ref().map(|plan| plan.keep_out.as_slice());
    // Those of a part in curved layers are of all layers together.
    let unreachable = match &planned.plan {
        Some(plan) if plan.is_in_space() => &[][..],
        _ => &planned.unreachable,
    };
    PlanPicture {
        title,
        keep_out: keep_out.unwrap_or_default(),
        regions: planned.outline_of(layer),
        aperture: planned.settings.aperture,
        axis,
        passes,
        travel,
        unreachable: unreachable
            .iter()
            .map(|run| vec![run.from, run.to])
            .collect(),
        colouring: Colouring::Zone,
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
            PassKind::Infill | PassKind::Sparse | PassKind::Bridge | PassKind::Roof => Zone::Infill,
            PassKind::Skirt => Zone::Skirt,
        })
        .collect()
}

fn stream_paths(
    planned: &Planned,
    servo_hz: f64,
    zone_of: &[Zone],
    layer: u32,
) -> (Vec<PicturePass>, Vec<Vec<Point2>>) {
    let stream = &planned.stream;
    let ticks = match stream.layers() {
        0 | 1 => [0, duration_ticks(stream)],
        _ => stream.ticks_of_layer(layer),
    };
    let every_ticks = (ticks[1] - ticks[0]).div_ceil(SAMPLES_MAX).max(1) as f64;
    let mut passes: Vec<PicturePass> = Vec::new();
    let mut travel: Vec<Vec<Point2>> = Vec::new();
    let mut before: Option<(MotionState, Option<u32>)> = None;
    for sample in samples_within(stream, servo_hz, every_ticks, ticks) {
        // The tick after a layer's last is the next one's.
        if sample.mark.layer != layer {
            continue;
        }
        let now = (sample.mark.state, sample.mark.pass);
        let is_new = before != Some(now);
        before = Some(now);
        let at = configuration(&planned.transform, &sample.position);
        match sample.mark.state {
            MotionState::Print => {
                if is_new {
                    passes.push(PicturePass {
                        placements: Vec::new(),
                        speeds_mm_s: Vec::new(),
                    });
                }
                let number = sample.mark.pass.map_or(usize::MAX, |pass| pass as usize);
                let zone = zone_of.get(number).copied().unwrap_or(Zone::Unknown);
                if let Some(pass) = passes.last_mut() {
                    pass.placements.push((at, zone));
                    pass.speeds_mm_s.push(sample.speed_mm_s());
                }
            }
            // The move to the first pass interrupts nothing.
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
fn rasters_of_job(planned: &Planned, shown: &[ShownLayer]) -> Vec<Vec<(Frame, Coverage)>> {
    // What was planned once has contours; an outline that has none is not drawn.
    let contours: Option<Vec<Contour>> = planned
        .outline
        .iter()
        .map(|region| Contour::of_region(region, SIMPLIFY_MM).ok())
        .collect();
    let contours: Vec<Contour> = contours.unwrap_or_default();
    let mut prints = Vec::new();
    let mut print_of_pass = vec![OFF_REGIONS; passes_of(&planned.stream)];
    for shown in shown {
        name_passes(planned, shown.layer, prints.len(), &mut print_of_pass);
        prints.extend(contours.iter().map(|contour| MeasuredPrint {
            contour,
            layer: shown.layer,
            like: usize::MAX,
        }));
    }
    let (_, measured) = measure(
        &planned.stream,
        &prints,
        &print_of_pass,
        &planned.transform,
        &planned.settings,
        &(),
    );
    let rasters = prints.iter().zip(&measured.rasters);
    let rasters: Vec<Option<(Frame, Coverage)>> = rasters
        .map(|(print, swept)| Some(placed(print.contour.offset, swept.as_ref()?)))
        .collect();
    let mut rasters = rasters.into_iter();
    let of_layer = |_| rasters.by_ref().take(contours.len()).flatten().collect();
    shown.iter().map(of_layer).collect()
}

/// Passes of a stream.
fn passes_of(stream: &SegmentStream) -> usize {
    let passes = stream.marks.iter().filter_map(|mark| mark.pass);
    passes.max().map_or(0, |last| last as usize + 1)
}

/// Gives a layer's passes the numbers of the regions that they begin in, counted from `first`.
fn name_passes(planned: &Planned, layer: u32, first: usize, print_of_pass: &mut [usize]) {
    let servo_hz = f64::from(planned.settings.machine.servo_hz);
    let marks = planned.stream.marks.iter();
    let numbers = marks.filter(|mark| mark.layer == layer && mark.state == MotionState::Print);
    let (passes, _) = stream_paths(planned, servo_hz, &[], layer);
    for (number, pass) in numbers.filter_map(|mark| mark.pass).zip(&passes) {
        let start = pass.placements.first().map(|(at, _)| at.center);
        let holds = |region: &Region| start.is_some_and(|p| region.contains(p));
        if let Some(region) = planned.outline.iter().position(holds) {
            print_of_pass[number as usize] = first + region;
        }
    }
}

/// A raster with its frame in the input's coordinates.
fn placed(offset: Vector2, raster: &RegionRaster) -> (Frame, Coverage) {
    let frame = Frame {
        centre: raster.frame.centre + offset,
        ..raster.frame
    };
    (frame, raster.swept.clone())
}

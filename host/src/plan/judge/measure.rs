//! Measures the finished segments: coverage, overlap, outside depth, lengths and times.
//!
//! Input: the stream (machine coordinates), the regions' contours and the region of each pass. The
//! poses are those of the quantised spline, sampled so finely that the sampling does not show on
//! the raster.

use super::region_raster::RegionRaster;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::{Configuration, outside_bound_mm, outside_depth_mm};
use crate::geometry::coverage::{Cell, Coverage, SweptPose, return_mm};
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::frame::Frame;
use crate::geometry::polygon::Region;
use crate::geometry::{Point2, Vector2};
use crate::job::transform::PartTransform;
use crate::job::{MotionState, SegmentStream};
use crate::plan::coverage::raster::SKEW_RAD;
use crate::plan::judge::figures::{PlanFigures, Swept};
use crate::plan::layers::layer_groups::OFF_REGIONS;
use crate::plan::outline::contour::Contour;
use crate::plan::outline::reachable::reachable;
use crate::plan::outline::trimmed_outline::{is_beyond_reach, trimmed_outline};
use crate::plan::progress::{Progress, Stage, Steps};
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNEL_Z};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// One printing of a region.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredPrint<'a> {
    /// The region's outline.
    pub contour: &'a Contour,
    /// Layer from 0.
    pub layer: u32,
    /// An earlier printing with the same curves, whose figures are reused if its poses are the
    /// same; any other number for none.
    pub like: usize,
}

/// What was measured, by printing.
#[derive(Clone, Debug, Default)]
pub struct Measured {
    /// Each printing.
    pub swept: Vec<Swept>,
    /// The rasters of those whose figures were not reused.
    pub rasters: Vec<Option<RegionRaster>>,
}

/// Cells that a small layer is divided into: the border of the raster then counts for little.
const CELLS_AIM: f64 = 1e6;
/// Smallest and largest raster cell, of the aperture's unit, as long as the raster stays below `CELLS_MAX`.
const CELL: [f64; 2] = [0.005, 0.02];
/// Most cells of one region's raster.
const CELLS_MAX: usize = 6_000_000;
/// Longest step between poses of the sweep, of the unit: the scallop it leaves on the sharpest aperture
/// (b²/a = 0.07 mm) is below 1 µm.
pub(super) const STEP: f64 = 0.02;
/// The same for a sharp corner, which leaves a notch of half the step at worst.
const STEP_SHARP: f64 = 0.004;
/// Longest turn between poses of the sweep, rad.
pub(super) const STEP_RAD: f64 = 0.02;
/// Uncovered cells that are checked for whether they could be reached; more are sampled evenly.
const ASKED_MAX: usize = 4_000;

/// Poses that differ by less leave the same figures, mm: a thousandth of a raster's cell.
const SAME_MM: f64 = 1e-5;

/// Measures the printings of a stream. `print_of_pass` is the number of each pass's printing, or
/// [`OFF_REGIONS`]. Printings are ordered by layer, and only one layer's poses are in memory at a
/// time.
pub fn measure(
    stream: &SegmentStream,
    prints: &[MeasuredPrint],
    print_of_pass: &[usize],
    transform: &PartTransform,
    settings: &Settings,
    progress: &dyn Progress,
) -> (PlanFigures, Measured) {
    let steps = Steps::begin(progress, Stage::Figures, prints.len());
    let mut measured = Measured::default();
    let mut skirt_mm = 0.0;
    // Poses of printings that later ones repeat.
    let mut known: BTreeMap<usize, Vec<SweptPose>> = BTreeMap::new();
    let repeated: BTreeSet<usize> = (prints.iter().enumerate())
        .filter(|(number, print)| print.like < *number)
        .map(|(_, print)| print.like)
        .collect();
    let cell_mm = raster_cell_mm(prints, settings.aperture.unit_mm());
    let (outlines, reach) = outlines_of(prints);
    let mut measure_up_to = |layer: u32, poses: Vec<SweptPose>| {
        skirt_mm += length_off_regions_mm(&poses, print_of_pass);
        let first = measured.swept.len();
        let of_layer = prints[first..].iter();
        let count = of_layer.take_while(|print| print.layer <= layer).count();
        let poses = poses_of_prints(poses, print_of_pass, first..first + count);
        let found = poses.into_par_iter().zip(&prints[first..]).enumerate();
        let found: Vec<(Swept, Option<RegionRaster>, Option<Vec<SweptPose>>)> = found
            .map(|(number, (poses, print))| {
                let number = first + number;
                let like = known.get(&print.like).zip(measured.swept.get(print.like));
                let same = like.and_then(|(others, swept)| same(&poses, others, swept, settings));
                let kept = repeated.contains(&number).then(|| poses.clone());
                let (swept, raster) = match same {
                    Some(swept) => (swept, None),
                    None => {
                        let known = &reach[outlines[number]];
                        let region = PrintedRegion::of(print, transform, settings, known);
                        let (swept, raster) = region.measure(poses, cell_mm);
                        (swept, (print.like >= number).then_some(raster))
                    }
                };
                steps.done();
                (swept, raster, kept)
            })
            .collect();
        for (number, (swept, raster, kept)) in (first..).zip(found) {
            measured.swept.push(swept);
            measured.rasters.push(raster);
            known.extend(kept.map(|poses| (number, poses)));
        }
    };
    let mut figures = walk_stream(stream, settings, &mut measure_up_to);
    // What nothing was printed on.
    measure_up_to(u32::MAX, Vec::new());
    figures.skirt_mm = skirt_mm;
    figures.passes = print_of_pass.len();
    let layers: Vec<u32> = prints.iter().map(|print| print.layer).collect();
    figures.set_shares(&layers, &measured.swept);
    (figures, measured)
}

/// The poses of each of the printings. A large one has millions: those of the only one are not copied.
fn poses_of_prints(
    poses: Vec<SweptPose>,
    print_of_pass: &[usize],
    prints: Range<usize>,
) -> Vec<Vec<SweptPose>> {
    let print_of = |pose: &SweptPose| print_of_pass.get(pose.pass as usize).copied();
    if prints.len() == 1
        && poses
            .iter()
            .all(|pose| print_of(pose) == Some(prints.start))
    {
        return vec![poses];
    }
    let mut of_prints = vec![Vec::new(); prints.len()];
    for pass in poses.chunk_by(|p, q| p.pass == q.pass) {
        if let Some(print) = print_of(&pass[0]).filter(|print| prints.contains(print)) {
            of_prints[print - prints.start].extend_from_slice(pass);
        }
    }
    of_prints
}

/// The number of each printing's outline, and room for what is known of each.
fn outlines_of(prints: &[MeasuredPrint]) -> (Vec<usize>, Vec<KnownReach>) {
    let mut numbers: HashMap<*const Contour, usize> = HashMap::new();
    let outlines = prints.iter().map(|print| {
        let next = numbers.len();
        *numbers
            .entry(std::ptr::from_ref(print.contour))
            .or_insert(next)
    });
    let outlines = outlines.collect();
    let reach = numbers.values().map(|_| KnownReach::default()).collect();
    (outlines, reach)
}

/// Cells of the rasters: a layer's figures are over all of its regions, however small each is.
fn raster_cell_mm(prints: &[MeasuredPrint], unit_mm: f64) -> f64 {
    let of_a_layer = prints
        .iter()
        .take_while(|print| print.layer == prints[0].layer);
    let area_mm2: f64 = of_a_layer.map(|p| p.contour.region.area_mm2()).sum();
    let [least_mm, most_mm] = CELL.map(|cell| cell * unit_mm);
    (area_mm2 / CELLS_AIM).sqrt().clamp(least_mm, most_mm)
}

/// The result of poses that equal earlier ones to [`SAME_MM`]; the depth is then the earlier one
/// plus the largest displacement of a point of the aperture. `None` if they are not equal.
fn same(
    poses: &[SweptPose],
    others: &[SweptPose],
    swept: &Swept,
    settings: &Settings,
) -> Option<Swept> {
    if poses.len() != others.len() {
        return None;
    }
    let aperture = &settings.aperture;
    let pairs = poses.iter().zip(others);
    let apart_mm = pairs.map(|(pose, other)| {
        let turned_rad = aperture.wrapped_rad(pose.at.heading_rad - other.at.heading_rad);
        (pose.at.center - other.at.center).norm() + aperture.major_mm() * turned_rad.abs()
    });
    let apart_mm = apart_mm.fold(0.0, f64::max);
    let moved = Swept {
        outside_depth_mm: swept.outside_depth_mm + apart_mm,
        ..*swept
    };
    (apart_mm <= SAME_MM).then_some(moved)
}

/// What a printing is measured against, in a frame of its own.
struct PrintedRegion<'a> {
    contour: &'a Contour,
    settings: &'a Settings,
    /// Of earlier layers of the same outline, which leave much the same cells open.
    known: &'a KnownReach,
    shift: Vector2,
    frame: Frame,
    outline: Region,
    walls: EdgeIndex,
}

impl<'a> PrintedRegion<'a> {
    fn of(
        print: &MeasuredPrint<'a>,
        transform: &PartTransform,
        settings: &'a Settings,
        known: &'a KnownReach,
    ) -> Self {
        let contour = print.contour;
        let may_mirror = settings.aperture.is_mirror_image();
        let mut frame = contour.frame.mirrored_if(may_mirror);
        frame.turn_rad += SKEW_RAD;
        let outline = frame.region_in(&contour.region);
        PrintedRegion {
            contour,
            settings,
            known,
            shift: Vector2::new(transform.offset_mm[0], transform.offset_mm[1]),
            frame,
            walls: EdgeIndex::of_region(&outline, settings.aperture.major_mm()),
            outline,
        }
    }

    fn local(&self, pose: &SweptPose) -> SweptPose {
        let center = self.contour.to_local(pose.at.center - self.shift);
        SweptPose {
            at: Configuration {
                center: self.frame.point_in(center),
                heading_rad: self.frame.angle_in(pose.at.heading_rad),
            },
            ..*pose
        }
    }

    /// What the poses sweep of the region, and how deep they leave it.
    fn measure(&self, mut poses: Vec<SweptPose>, cell_mm: f64) -> (Swept, RegionRaster) {
        for pose in &mut poses {
            *pose = self.local(pose);
        }
        let (depth_mm, at) = deepest(&poses, &self.walls, self.settings);
        let at = self.contour.to_input(self.frame.point_out(at.center));
        let (shares, raster) = self.sweep(&poses, cell_mm);
        let swept = Swept {
            outside_depth_mm: depth_mm,
            outside_at_mm: [at.x, at.y],
            ..shares
        };
        (swept, raster)
    }

    fn sweep(&self, poses: &[SweptPose], cell_mm: f64) -> (Swept, RegionRaster) {
        let settings = self.settings;
        let area_mm2 = self.contour.region.area_mm2();
        let return_mm = return_mm(&settings.aperture);
        let swept = Coverage::sweep(
            &self.walls,
            &settings.aperture,
            poses,
            cell_mm,
            CELLS_MAX,
            return_mm,
        );
        let gap_share = reachable_share_of_gaps(&swept, self);
        let [covered_pct, overlap_pct] = swept.covered_and_overlap_pct();
        let covered_share = covered_pct / 100.0;
        let shares = Swept {
            area_mm2,
            covered_mm2: area_mm2 * covered_share,
            overlap_mm2: area_mm2 * overlap_pct / 100.0,
            reachable_mm2: area_mm2 * (covered_share + (1.0 - covered_share) * gap_share),
            ..Swept::default()
        };
        let frame = self.frame;
        (shares, RegionRaster { frame, swept })
    }
}

/// Path of the passes that belong to no region.
fn length_off_regions_mm(poses: &[SweptPose], region_of_pass: &[usize]) -> f64 {
    let passes = poses.chunk_by(|p, q| p.pass == q.pass);
    let off = passes.filter_map(|poses| {
        let last = poses.last()?;
        let region = region_of_pass.get(last.pass as usize)?;
        (*region == OFF_REGIONS).then_some(last.path_mm)
    });
    off.sum::<f64>() + 0.0
}

/// Samples the print poses of the stream, handed on layer by layer, and sums lengths, times and
/// heading over all of it.
fn walk_stream(
    stream: &SegmentStream,
    settings: &Settings,
    of_layer: &mut impl FnMut(u32, Vec<SweptPose>),
) -> PlanFigures {
    let servo_hz = f64::from(settings.machine.servo_hz);
    let mut figures = PlanFigures::default();
    let mut poses = Vec::new();
    let mut layer = 0;
    let mut ticks_done = 0u64;
    let mut pass_before = None;
    let mut last: Option<[f64; 4]> = None;
    let mut path_mm = 0.0;
    let step_mm = longest_step_mm(&settings.aperture);
    for (span, mark) in stream.marked_spans() {
        if let Some(pass) = mark.map(|mark| mark.pass)
            && pass_before.replace(pass) != Some(pass)
        {
            path_mm = 0.0;
        }
        let ticks = f64::from(span.duration_ticks);
        let velocity = span.velocity(0.5 * ticks, servo_hz);
        let span_s = ticks / servo_hz;
        let steps = (velocity[CHANNEL_X].hypot(velocity[CHANNEL_Y]) * span_s / step_mm)
            .max(velocity[CHANNEL_HEADING].abs() * span_s / STEP_RAD)
            .ceil()
            .clamp(2.0, 4096.0) as usize;
        let printing = mark.filter(|m| m.state == MotionState::Print);
        if let Some(mark) = printing.filter(|mark| mark.layer != layer) {
            of_layer(layer, std::mem::take(&mut poses));
            layer = mark.layer;
        }
        for step in 0..steps {
            let p = span.position(ticks * step as f64 / steps as f64);
            let rate = span.velocity(ticks * step as f64 / steps as f64, servo_hz);
            let at = [p[CHANNEL_X], p[CHANNEL_Y], p[CHANNEL_Z], p[CHANNEL_HEADING]];
            let moved = last.map_or(0.0, |l| {
                ((at[0] - l[0]).powi(2) + (at[1] - l[1]).powi(2) + (at[2] - l[2]).powi(2)).sqrt()
            });
            figures.heading_travel_rad += last.map_or(0.0, |l| (at[3] - l[3]).abs());
            figures.heading_rate_max_rad_s = figures
                .heading_rate_max_rad_s
                .max(rate[CHANNEL_HEADING].abs());
            last = Some(at);
            let Some(pass) = printing.and_then(|m| m.pass) else {
                figures.travel_mm += moved;
                continue;
            };
            figures.print_mm += moved;
            path_mm += moved;
            let at = Configuration {
                center: Point2::new(at[0], at[1]),
                heading_rad: at[3],
            };
            poses.push(SweptPose { at, pass, path_mm });
        }
        ticks_done += u64::from(span.duration_ticks);
        let [before, after] = [0.0, ticks].map(|local| span.position(local)[CHANNEL_VOLUME]);
        figures.volume_mm3 += after - before;
    }
    of_layer(layer, poses);
    figures.print_s = ticks_done as f64 / servo_hz;
    figures
}

/// What [`STEP`] is for the default ellipse; less where corners of a polygon are sharper.
pub(super) fn longest_step_mm(aperture: &Aperture) -> f64 {
    let unit_mm = aperture.unit_mm();
    match aperture {
        Aperture::Ellipse { .. } => STEP * unit_mm,
        Aperture::Rounded(_) => (8.0 * aperture.sharpest_radius_mm() * SCALLOP * unit_mm)
            .sqrt()
            .clamp(STEP_SHARP * unit_mm, STEP * unit_mm),
    }
}

/// Scallop that a rounded corner may leave, of the unit.
const SCALLOP: f64 = 1e-3;

/// The placement that leaves the region farthest. Those that may reach deepest are measured first,
/// the others only as long as they may reach deeper than what was found.
fn deepest(poses: &[SweptPose], walls: &EdgeIndex, settings: &Settings) -> (f64, Configuration) {
    let aperture = &settings.aperture;
    let bounds_mm: Vec<f64> = poses
        .par_iter()
        .map(|pose| outside_bound_mm(aperture, pose.at, walls))
        .collect();
    let mut order: Vec<usize> = (0..poses.len()).filter(|&i| bounds_mm[i] > 0.0).collect();
    order.sort_by(|&i, &j| bounds_mm[j].total_cmp(&bounds_mm[i]).then(i.cmp(&j)));
    let mut best = (0.0, usize::MAX);
    for batch in order.chunks(DEPTH_BATCH) {
        if bounds_mm[batch[0]] <= best.0 {
            break;
        }
        let depths: Vec<f64> = batch
            .par_iter()
            .map(|&i| outside_depth_mm(aperture, poses[i].at, walls))
            .collect();
        for (&i, depth_mm) in batch.iter().zip(depths) {
            if depth_mm > best.0 || (depth_mm == best.0 && i < best.1) {
                best = (depth_mm, i);
            }
        }
    }
    let origin = Configuration {
        center: Point2::origin(),
        heading_rad: 0.0,
    };
    (best.0, poses.get(best.1).map_or(origin, |pose| pose.at))
}

/// Placements measured side by side: enough for any number of threads.
const DEPTH_BATCH: usize = 256;

/// Uncovered cells of an outline, by their place: whether some placement inside could cover each.
type KnownReach = Mutex<HashMap<[u64; 2], bool>>;

/// Which share of the uncovered cells some placement inside could cover.
fn reachable_share_of_gaps(raster: &Coverage, region: &PrintedRegion) -> f64 {
    let gaps = raster.count(Cell::Gap);
    if gaps == 0 {
        return 0.0;
    }
    let aperture = &region.settings.aperture;
    let stride = gaps.div_ceil(ASKED_MAX);
    let asked: Vec<_> = raster.gaps().step_by(stride).collect();
    let key = |p: &Point2| [p.x.to_bits(), p.y.to_bits()];
    // No lock is held while threads help each other.
    let lock = || region.known.lock().unwrap_or_else(PoisonError::into_inner);
    let mut of_outline = std::mem::take(&mut *lock());
    let mut near = asked.clone();
    near.retain(|p| !of_outline.contains_key(&key(p)));
    if !near.is_empty() {
        of_outline.extend(near.iter().map(|p| (key(p), false)));
        // With noise finer than the nozzle most cells are unreachable: no search for those.
        let hull = trimmed_outline(&region.outline, aperture);
        let hull = EdgeIndex::of_region(&hull, aperture.major_mm());
        near.retain(|&p| !is_beyond_reach(&hull, p, aperture));
        let found = reachable(aperture, &near, &region.walls);
        of_outline.extend(found.iter().map(|(p, is_reached)| (key(p), *is_reached)));
    }
    let reached = (asked.iter()).filter(|p| of_outline[&key(p)]).count();
    *lock() = of_outline;
    reached as f64 / asked.len() as f64
}

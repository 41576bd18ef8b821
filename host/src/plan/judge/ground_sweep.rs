//! The area that the poses of a stream cover on a curved surface: a raster on each layer, with true
//! areas.
//!
//! In: the stream (machine coordinates), the chart with the regions in it (mm). Out: [`Swept`] of each layer, and its
//! uncovered places. A cell is a place of the chart with its point on the layer's top and its area there; it is
//! covered if that point, seen along the tool axis of a pose, is in the aperture, and covered twice by the same rule
//! as in the plane ([`crate::geometry::coverage`]). The depth of the aperture outside the regions is measured at
//! points of its outline, projected onto the surface. Not covered: skirts, and unreachable area: all of the regions
//! counts as reachable.

use super::figures::Swept;
pub use super::ground_raster::OpenPlace;
use super::ground_raster::{GroundCell, NO_VISIT, Raster, Visit, open_places};
use super::measure::{STEP_RAD, longest_step_mm};
use crate::geometry::aperture::Aperture;
use crate::geometry::chart::{Chart, SurfaceFrame};
use crate::geometry::clearance::{Configuration, outside_bound_mm};
use crate::geometry::coverage::{SweptPose, return_mm};
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::place_scale::{ScaleField, placed};
use crate::geometry::polygon::Region;
use crate::geometry::{Point2, Vector2};
use crate::job::transform::PartTransform;
use crate::job::{MotionState, SegmentStream};
use crate::plan::route::moves::tip;
use crate::settings::Settings;
use headway_firmware::kinematics::pose::tool_axis;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_X, CHANNELS,
};
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;

/// Side of the cells, of the aperture's unit, unless a layer would have more than this many.
const CELL: f64 = 0.02;
const CELLS_MAX: f64 = 3e6;
/// A point this far off a pose's plane, of a layer's height, is on another sheet of the surface.
const SHEET: f64 = 2.0;
/// How much farther than in its tangent plane the aperture may reach in the chart, of its reach.
const REACH: f64 = 1.1;
/// Points of the outline at which its depth outside is measured, and the number of poses checked in this
/// detail.
const OUTLINE: usize = 96;
const POSES_MEASURED: usize = 400;
/// Places from which the place of a tip is sought, about, and how many of the nearest are tried.
const BEGINS: f64 = 800.0;
const BEGINS_TRIED: usize = 24;
/// How much farther than its shape in the chart the aperture may reach, of its size.
const NEARLY: f64 = 1.02;

/// A curved surface and its regions to be covered.
pub struct CurvedGround<'a> {
    /// From the plan's plane to the surface.
    pub chart: &'a dyn Chart,
    /// The nozzle's scale by place, in the chart.
    pub scale: &'a ScaleField,
    /// The regions to cover, in the chart.
    pub regions: &'a [Region],
    /// From the surface's coordinates to the machine's.
    pub transform: &'a PartTransform,
    /// The layer on the surface.
    pub lowest_layer: u32,
    /// What lies beside it on the same layers, if it is one of several patches.
    pub joined: Option<Joined<'a>>,
}

/// A patch of ground that others join.
#[derive(Clone, Copy)]
pub struct Joined<'a> {
    /// Its share of the ground, in its chart: the regions to cover reach over the seams.
    pub share: &'a [Region],
    /// Passes of the other patches, which cover some of it along the seams.
    pub is_beside: &'a (dyn Fn(u32) -> bool + Sync),
}

/// Result for a layer.
#[derive(Clone, Debug)]
pub struct LayerSwept {
    /// Layer from 0.
    pub layer: u32,
    /// Its areas and depth; the place of the depth is in x and y of the surface.
    pub swept: Swept,
    /// Its open places, the largest first.
    pub open: Vec<OpenPlace>,
}

/// A pose of the sweep.
#[derive(Clone, Copy)]
struct GroundPose {
    tip_mm: Vector3<f64>,
    /// Tool X and Y, over the semi-widths: a point is in an ellipse where both products' squares sum to 1.
    axes: [Vector3<f64>; 2],
    normal: Vector3<f64>,
    /// Its position in the chart, and its heading there.
    at: SweptPose,
}

/// Measures all layers of a stream. `print_of_pass` is below [`usize::MAX`] for passes of the regions.
pub fn sweep_ground(
    stream: &SegmentStream,
    ground: &CurvedGround,
    is_of_regions: impl Fn(u32) -> bool,
    settings: &Settings,
) -> Vec<LayerSwept> {
    let is_beside = |pass: u32| ground.joined.is_some_and(|joined| (joined.is_beside)(pass));
    let layers = poses_by_layer(stream, settings, |pass| {
        is_of_regions(pass) || is_beside(pass)
    });
    let edges = ground.regions.iter().flat_map(Region::edges);
    let edges: Vec<Edge> = edges.map(|(a, b)| Edge { a, b }).collect();
    if edges.is_empty() {
        return Vec::new();
    }
    let walls = EdgeIndex::new(edges, settings.aperture.major_mm());
    let share = ground.joined.map(|joined| {
        let edges = joined.share.iter().flat_map(Region::edges);
        let edges: Vec<Edge> = edges.map(|(a, b)| Edge { a, b }).collect();
        EdgeIndex::new(edges, settings.aperture.major_mm())
    });
    layers
        .par_iter()
        .map(|(layer, poses)| {
            let above = layer.saturating_sub(ground.lowest_layer) + 1;
            let top_mm = settings.layer_height_mm * f64::from(above);
            let job = LayerJob {
                ground,
                walls: &walls,
                share: share.as_ref().unwrap_or(&walls),
                above_mm: top_mm,
                settings,
            };
            job.measured(*layer, poses)
        })
        .collect()
}

type Pose = [f64; CHANNELS];
/// A pose with its pass and the path of that so far, mm.
type PrintPose = (Pose, u32, f64);
/// A layer with its poses.
type LayerPoses = (u32, Vec<PrintPose>);

/// The print poses of each layer with pass and path, machine coordinates.
fn poses_by_layer(
    stream: &SegmentStream,
    settings: &Settings,
    is_of_regions: impl Fn(u32) -> bool,
) -> Vec<LayerPoses> {
    let servo_hz = f64::from(settings.machine.servo_hz);
    let step_mm = longest_step_mm(&settings.aperture);
    let mut layers: Vec<LayerPoses> = Vec::new();
    let (mut path_mm, mut pass_before) = (0.0, None);
    let mut before: Option<Pose> = None;
    for (span, mark) in stream.marked_spans() {
        if let Some(pass) = mark.map(|mark| mark.pass)
            && pass_before.replace(pass) != Some(pass)
        {
            path_mm = 0.0;
        }
        let ticks = f64::from(span.duration_ticks);
        let printing = mark.filter(|mark| mark.state == MotionState::Print);
        let Some((here, pass)) = printing.and_then(|mark| Some((mark, mark.pass?))) else {
            continue;
        };
        if !is_of_regions(pass) {
            continue;
        }
        let velocity = span.velocity(0.5 * ticks, servo_hz);
        let span_s = ticks / servo_hz;
        let speed = (0..3).map(|axis| velocity[CHANNEL_X + axis].powi(2));
        let steps = (speed.sum::<f64>().sqrt() * span_s / step_mm)
            .max(velocity[CHANNEL_HEADING].abs() * span_s / STEP_RAD)
            .ceil()
            .clamp(1.0, 4096.0) as usize;
        if layers.last().is_none_or(|(layer, _)| *layer != here.layer) {
            layers.push((here.layer, Vec::new()));
            before = None;
        }
        let Some((_, poses)) = layers.last_mut() else {
            continue;
        };
        for step in 0..steps {
            let pose = span.position(ticks * step as f64 / steps as f64);
            path_mm += before.map_or(0.0, |before| (tip(&pose) - tip(&before)).norm());
            poses.push((pose, pass, path_mm));
            before = Some(pose);
        }
    }
    layers
}

/// Turns the tool's frame at rest into that of a pose.
fn turned(pose: &Pose) -> Rotation3<f64> {
    let tilt = Vector3::new(pose[CHANNEL_TILT_X], pose[CHANNEL_TILT_Y], 0.0);
    Rotation3::new(tilt) * Rotation3::from_axis_angle(&Vector3::z_axis(), pose[CHANNEL_HEADING])
}

/// One layer in progress.
struct LayerJob<'a> {
    ground: &'a CurvedGround<'a>,
    walls: &'a EdgeIndex,
    /// The rim of what is to be covered.
    share: &'a EdgeIndex,
    /// The layer's top above the surface.
    above_mm: f64,
    settings: &'a Settings,
}

impl LayerJob<'_> {
    fn measured(&self, layer: u32, poses: &[PrintPose]) -> LayerSwept {
        let poses = self.on_ground(poses);
        let raster = self.raster();
        let cells = self.cells(&raster);
        let visits = self.visits(&raster, &cells, &poses);
        let mut swept = Swept::default();
        for (cell, visit) in cells.iter().zip(&visits).filter(|(cell, _)| cell.is_inside) {
            swept.area_mm2 += cell.area_mm2;
            if visit.pass != NO_VISIT.pass {
                swept.covered_mm2 += cell.area_mm2;
            }
            if visit.is_again {
                swept.overlap_mm2 += cell.area_mm2;
            }
        }
        swept.reachable_mm2 = swept.area_mm2;
        let own: Vec<GroundPose> = match self.ground.joined {
            Some(joined) => {
                let own = poses
                    .iter()
                    .filter(|pose| !(joined.is_beside)(pose.at.pass));
                own.copied().collect()
            }
            None => poses,
        };
        (swept.outside_depth_mm, swept.outside_at_mm) = self.deepest(&own);
        LayerSwept {
            layer,
            swept,
            open: open_places(&raster, &cells, &visits),
        }
    }

    /// The poses in the surface's coordinates, with their positions in the chart.
    fn on_ground(&self, poses: &[PrintPose]) -> Vec<GroundPose> {
        let offset = Vector3::from(self.ground.transform.offset_mm);
        let mut near: Option<(u32, Point2)> = None;
        let begins = self.begins();
        let placed = poses.iter().filter_map(|&(pose, pass, path_mm)| {
            let tip_mm = tip(&pose) - offset;
            let chart = self.ground.chart;
            if self.is_far(pass, tip_mm, &begins) {
                near = None;
                return None;
            }
            let center = match near.filter(|(of, _)| *of == pass) {
                Some((_, near)) => chart.place_of(tip_mm, near, self.above_mm),
                None => self.place_anew(tip_mm, &begins),
            };
            near = Some((pass, center));
            let turn = turned(&pose);
            let axes = [Vector3::x(), Vector3::y()].map(|axis| turn * axis);
            let frame = chart.frame(center, self.above_mm);
            Some(GroundPose {
                tip_mm,
                axes,
                normal: tool_axis(nalgebra::Vector2::new(
                    pose[CHANNEL_TILT_X],
                    pose[CHANNEL_TILT_Y],
                )),
                at: SweptPose {
                    at: Configuration {
                        center,
                        heading_rad: heading_in_chart(&frame, axes[0]),
                    },
                    pass,
                    path_mm,
                },
            })
        });
        placed.collect()
    }

    /// True for a pose of another patch that does not reach this one.
    fn is_far(&self, pass: u32, tip_mm: Vector3<f64>, begins: &[(Point2, Vector3<f64>)]) -> bool {
        let Some(joined) = self.ground.joined.filter(|joined| (joined.is_beside)(pass)) else {
            return false;
        };
        let bounds = joined.share.iter().map(|region| region.bounds().size());
        let step_mm = bounds.map(|size| (size.x * size.y / BEGINS).sqrt());
        let reach_mm = 2.0 * (self.settings.aperture.reach_mm() + step_mm.fold(0.0, f64::max));
        let away = begins.iter().map(|(_, at)| (at - tip_mm).norm_squared());
        away.fold(f64::INFINITY, f64::min) > reach_mm * reach_mm
    }

    /// The place of a tip that nothing is known of: where the surface is cut open there are two near it, of which the
    /// one inside the regions counts.
    fn place_anew(&self, tip_mm: Vector3<f64>, begins: &[(Point2, Vector3<f64>)]) -> Point2 {
        let mut begins: Vec<(f64, Point2)> = begins
            .iter()
            .map(|(at, on_layer)| ((on_layer - tip_mm).norm_squared(), *at))
            .collect();
        begins.sort_by(|a, b| a.0.total_cmp(&b.0));
        let placed = begins.iter().take(BEGINS_TRIED).map(|(_, begin)| {
            let chart = self.ground.chart;
            let at = chart.place_of(tip_mm, *begin, self.above_mm);
            let off_mm = (chart.frame(at, self.above_mm).tip_mm - tip_mm).norm();
            let outside_mm = (-self.walls.signed_distance_mm(at)).max(0.0);
            (off_mm + outside_mm, at)
        });
        let best = placed.min_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or(self.walls.bounds().min, |(_, at)| at)
    }

    /// Places of the regions from which the place of a tip is sought, with their points on the layer.
    fn begins(&self) -> Vec<(Point2, Vector3<f64>)> {
        let bounds = self.walls.bounds();
        let size = bounds.size();
        let step_mm = (size.x * size.y / BEGINS).sqrt();
        let [columns, rows] = [size.x, size.y].map(|side| (side / step_mm).ceil() as usize);
        let all = (0..=rows).flat_map(|j| (0..=columns).map(move |i| [i, j]));
        let all = all.map(|[i, j]| bounds.min + step_mm * Vector2::new(i as f64, j as f64));
        let inside = all.filter(|&at| self.walls.signed_distance_mm(at) > -step_mm);
        let inside = inside.map(|at| (at, self.ground.chart.frame(at, self.above_mm).tip_mm));
        inside.collect()
    }

    fn raster(&self) -> Raster {
        let aperture = &self.settings.aperture;
        let bounds = self.walls.bounds();
        let size = bounds.size();
        let least_mm = (size.x * size.y / CELLS_MAX).sqrt();
        let cell_mm = (CELL * aperture.unit_mm()).max(least_mm);
        let cells = |length_mm: f64| (length_mm / cell_mm).ceil() as usize + 1;
        Raster {
            origin: bounds.min - cell_mm * Vector2::new(0.37, 0.61),
            cell_mm,
            columns: cells(size.x),
            rows: cells(size.y),
        }
    }

    fn cells(&self, raster: &Raster) -> Vec<GroundCell> {
        let chart_mm2 = raster.cell_mm * raster.cell_mm;
        let cell = |number: usize| {
            let at = raster.middle(number);
            let frame = self.ground.chart.frame(at, self.above_mm);
            GroundCell {
                at_mm: frame.tip_mm,
                area_mm2: chart_mm2 * frame.area_factor().max(0.0),
                is_inside: self.share.contains(at),
            }
        };
        let numbers = 0..raster.columns * raster.rows;
        numbers.into_par_iter().map(cell).collect()
    }

    fn visits(&self, raster: &Raster, cells: &[GroundCell], poses: &[GroundPose]) -> Vec<Visit> {
        let aperture = &self.settings.aperture;
        let return_mm = return_mm(aperture);
        let sheet_mm = SHEET * self.settings.layer_height_mm;
        // How far the aperture reaches along tool X and Y, with what the chart may be off its tangent plane.
        let spare_mm = (REACH - 1.0) * aperture.reach_mm();
        let sides_mm = [Vector2::x(), Vector2::y()]
            .map(|axis| [-axis, axis].map(|to| spare_mm + aperture.support_mm(0.0, to)));
        let mut visits = vec![NO_VISIT; cells.len()];
        for pose in poses {
            let SweptPose { at, pass, path_mm } = pose.at;
            let frame = self.ground.chart.frame(at.center, self.above_mm);
            let reach_mm = REACH * aperture.reach_mm() / frame.stretches()[1].max(0.1);
            // Tool X and Y for a step along each of the chart's axes.
            let axes = pose.axes;
            let per_step = axes.map(|axis| frame.along.map(|step| axis.dot(&step)));
            let window = |middle: f64, count: usize| {
                let [low, high] = [-reach_mm, reach_mm].map(|by| (middle + by) / raster.cell_mm);
                low.max(0.0) as usize..(high.max(0.0) as usize + 1).min(count)
            };
            let middle = at.center - raster.origin;
            let columns = window(middle.x, raster.columns);
            for row in window(middle.y, raster.rows) {
                let up_mm = (row as f64 + 0.5) * raster.cell_mm - middle.y;
                let mut range = [-reach_mm, reach_mm];
                for ([by_u, by_v], sides_mm) in per_step.iter().zip(sides_mm) {
                    range = within(range, [*by_u, by_v * up_mm], sides_mm);
                }
                let [low, high] = range.map(|by_mm| (middle.x + by_mm) / raster.cell_mm);
                let [from, end] = [low - 1.0, high + 1.0].map(|at| at.max(0.0) as usize);
                for column in columns.start.max(from)..columns.end.min(end) {
                    let number = row * raster.columns + column;
                    let off = cells[number].at_mm - pose.tip_mm;
                    let [x, y] = pose.axes.map(|axis| axis.dot(&off));
                    let is_in = aperture.contains_in_tool(Vector2::new(x, y));
                    if !is_in || off.dot(&pose.normal).abs() > sheet_mm {
                        continue;
                    }
                    let visit = &mut visits[number];
                    visit.is_again |= visit.pass != NO_VISIT.pass
                        && (visit.pass != pass || path_mm - visit.path_mm > return_mm);
                    (visit.pass, visit.path_mm) = (pass, path_mm);
                }
            }
        }
        visits
    }

    /// Largest depth of the aperture outside the regions, on the surface, and its place.
    fn deepest(&self, poses: &[GroundPose]) -> (f64, [f64; 2]) {
        let aperture = self.settings.aperture.scaled(NEARLY);
        let mut bounds: Vec<(f64, usize)> = poses
            .par_iter()
            .enumerate()
            .filter_map(|(number, pose)| {
                let (aperture, at) = placed(Some(self.ground.scale), &aperture, pose.at.at);
                let bound_mm = outside_bound_mm(&aperture, at, self.walls);
                (bound_mm > 0.0).then_some((bound_mm, number))
            })
            .collect();
        bounds.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        bounds.truncate(POSES_MEASURED);
        let depths = bounds.par_iter().map(|&(_, number)| {
            let pose = &poses[number];
            (self.depth(pose), pose.tip_mm)
        });
        let depths: Vec<((f64, f64), Vector3<f64>)> = depths.collect();
        let deepest = depths.iter().max_by(|a, b| a.0.0.total_cmp(&b.0.0));
        deepest.map_or((0.0, [0.0; 2]), |((depth_mm, _), at)| {
            (depth_mm.max(0.0), [at.x, at.y])
        })
    }

    /// Largest distance of a point of the outline outside, mm; and its place on the outline.
    fn depth(&self, pose: &GroundPose) -> (f64, f64) {
        let aperture: &Aperture = &self.settings.aperture;
        let chart = self.ground.chart;
        let depths = (0..OUTLINE).map(|k| {
            let share = k as f64 / OUTLINE as f64;
            let (sin, cos) = (std::f64::consts::TAU * share).sin_cos();
            let own = aperture.support_point(0.0, Vector2::new(cos, sin));
            let [x, y] = pose.axes;
            let point = pose.tip_mm + own.x * x + own.y * y;
            let at = chart.place_of(point, pose.at.at.center, self.above_mm);
            let lambda = self.ground.scale.at(at).lambda;
            (-lambda * self.walls.signed_distance_mm(at), share)
        });
        depths.fold((0.0, 0.0), |deepest, here| match here.0 > deepest.0 {
            true => here,
            false => deepest,
        })
    }
}

/// Of the steps in a range those that, times a slope plus an offset, are within the sides.
fn within([low, high]: [f64; 2], [slope, offset]: [f64; 2], [below, over]: [f64; 2]) -> [f64; 2] {
    if slope.abs() < f64::EPSILON {
        return [low, high];
    }
    let [p, q] = [-below, over].map(|side| (side - offset) / slope);
    [low.max(p.min(q)), high.min(p.max(q))]
}

/// Heading of a direction of space in the chart.
fn heading_in_chart(frame: &SurfaceFrame, axis: Vector3<f64>) -> f64 {
    let [u, v] = frame.along;
    let mixed = u.dot(&v);
    let metric = nalgebra::Matrix2::new(u.norm_squared(), mixed, mixed, v.norm_squared());
    let right = Vector2::new(axis.dot(&u), axis.dot(&v));
    let in_chart = metric
        .try_inverse()
        .map_or(right, |inverse| inverse * right);
    in_chart.y.atan2(in_chart.x)
}

//! Ground that a plan is laid on: its chart, the nozzle's scale in it, and whether a flat nozzle fits there.
//!
//! In: a chart and the regions in it (mm). Out: [`OnSurface`], or why not, with the place.

use super::{ChartJob, OFF_SHARE_MAX, middle_mm};
use crate::geometry::chart::{Chart, PatchChart, sharpest_bend_per_mm};
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::place_scale::ScaleField;
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::{Point2, Vector2};
use crate::pipeline::open_ground::OpenGround;
use crate::pipeline::surface::error::{SurfaceError, spot};
use crate::plan::judge::ground_sweep::LayerSwept;
use crate::plan::layers::skirt::skirt_reach_mm;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::route::clear_travel::UPRIGHT_RAD;
use crate::plan::route::surface::layer_folds;
use crate::settings::Settings;
use crate::text::refusal::refusal;
use headway_protocol::units::{CHANNEL_X, CHANNELS};
use nalgebra::Vector3;
use std::sync::Arc;

/// Step over the ground at which its bends and slopes are taken, mm, as long as there are no more than this along an axis.
const LOOK_MM: f64 = 0.3;
const LOOKS_MAX: f64 = 256.0;
/// Where between least and greatest the scale is at which the chart is as large as the ground: which beads there are is
/// decided for it, and elsewhere they are moved and turned. At the middle some ground stays open where the scale is
/// greatest, at the greatest more is turned than need be (trials on six surfaces).
const TOPOLOGY_SHARE: f64 = 0.75;
/// What the scale may range by.
const RANGE_MAX: f64 = 1.5;
/// What the ends of a flat nozzle may be off the ground before it is reported, of the layer height.
const HANG_SHARE: f64 = 0.1;
/// An edge of an outline goes into the chart in pieces that are this close to it, mm, and at most halved so often.
const CHORD_MM: f64 = 5e-4;
const HALVINGS: usize = 12;
/// Edges longer than this are halved whether their middle lies on the chord or not, mm.
const LONG_MM: f64 = 2.0;

/// Where the ends of a flat nozzle are farthest off the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SharpBend {
    /// Radius of the bend, mm.
    pub radius_mm: f64,
    /// How far the ends are off.
    pub off_mm: f64,
    /// Place on the ground.
    pub at_mm: [f64; 3],
}

/// Seams between the patches that a surface is cut into.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seams {
    /// Number of patches.
    pub patches: usize,
    /// Length of the seams.
    pub length_mm: f64,
    /// Ground of all layers that stays open within half a nozzle's length of a seam.
    pub open_mm2: f64,
}

/// How a plan lies on its ground.
#[derive(Clone, Debug)]
pub struct OnSurface {
    /// The smooth ground over the plane of the plan, input coordinates.
    pub chart: Arc<PatchChart>,
    /// The nozzle's scale by place.
    pub scale: ScaleField,
    /// What is covered, in the chart.
    pub regions: Vec<Region>,
    /// How far the smooth ground is off the mesh at most, mm.
    pub off_mm: f64,
    /// That place.
    pub off_at_mm: [f64; 3],
    /// The greatest angle of the tool axis against Z, rad.
    pub tilt_max_rad: f64,
    /// Least and greatest length on the ground for one of the chart.
    pub scales: [f64; 2],
    /// The sharpest bend, where it is to be reported.
    pub sharp_bend: Option<SharpBend>,
    /// Boundary of the plan that is not reached, input coordinates of the first layer from above.
    pub unreachable: Vec<UnreachableRun>,
    /// What was covered.
    pub layers: Vec<LayerSwept>,
    /// Where it is cut into patches. Chart, scale and regions are then those of the lowest patch.
    pub seams: Option<Seams>,
}

/// What is found looking over the ground.
#[derive(Default)]
struct Looked {
    tilt: (f64, Vector3<f64>),
    bend: (f64, Vector3<f64>),
    least: Option<(f64, Vector3<f64>)>,
    most: Option<(f64, Vector3<f64>)>,
}

impl OnSurface {
    /// Looks the ground of regions over.
    ///
    /// # Errors
    /// [`SurfaceError`].
    pub(super) fn on(
        chart: PatchChart,
        off: (f64, [f64; 3]),
        job: &mut ChartJob,
        settings: &Settings,
    ) -> Result<OnSurface, SurfaceError> {
        let scale = scale_of(&chart, &job.around, settings)?;
        let looked = looked_over(&chart, &scale, &job.around);
        let (tilt_max_rad, at) = looked.tilt;
        let tilts = settings.tilts();
        if tilt_max_rad > UPRIGHT_RAD && !tilts {
            return Err(SurfaceError::Refused(refusal!(
                "the surface slopes by {:.1}° near {}, and this machine's head does not tilt; plan for another machine \
                 (--machine)",
                tilt_max_rad.to_degrees(),
                spot(at.into())
            )));
        }
        let sharp_bend = sharp_bend(&looked, settings)?;
        let [least, most] = scales(&looked)?;
        let factor = least + TOPOLOGY_SHARE * (most - least);
        job.scale(factor);
        let chart = chart.scaled(factor);
        let scale = scale_of(&chart, &job.around, settings)?;
        let scales = [least / factor, most / factor];
        Ok(OnSurface {
            chart: Arc::new(chart),
            scale,
            regions: job.regions.clone(),
            off_mm: off.0,
            off_at_mm: off.1,
            tilt_max_rad,
            scales,
            sharp_bend,
            unreachable: Vec::new(),
            layers: Vec::new(),
            seams: None,
        })
    }

    /// What holds for several patches together; `None` of none.
    pub(super) fn together(patches: Vec<OnSurface>) -> Option<OnSurface> {
        patches.into_iter().reduce(|all, patch| {
            let (off_mm, off_at_mm) = match patch.off_mm > all.off_mm {
                true => (patch.off_mm, patch.off_at_mm),
                false => (all.off_mm, all.off_at_mm),
            };
            let [all_least, all_most] = all.scales;
            let [least, most] = patch.scales;
            let bends = [all.sharp_bend, patch.sharp_bend].into_iter().flatten();
            OnSurface {
                off_mm,
                off_at_mm,
                tilt_max_rad: all.tilt_max_rad.max(patch.tilt_max_rad),
                scales: match most / least > all_most / all_least {
                    true => patch.scales,
                    false => all.scales,
                },
                sharp_bend: bends.min_by(|a, b| a.radius_mm.total_cmp(&b.radius_mm)),
                unreachable: [all.unreachable.as_slice(), &patch.unreachable].concat(),
                ..all
            }
        })
    }

    /// Open places of all layers, the largest first.
    pub fn open_ground(&self) -> Vec<OpenGround> {
        open_places(&self.layers)
    }

    /// A place of the chart as it is seen from above.
    pub fn seen_from_above(&self, at: Point2) -> Point2 {
        let on_ground = self.chart.jet(at).at_mm;
        Point2::new(on_ground.x, on_ground.y)
    }

    /// The ground under a tip on the ground's side.
    pub fn ground_below(&self, pose: &[f64; CHANNELS]) -> Vector3<f64> {
        let tip = Vector3::from_fn(|axis, _| pose[CHANNEL_X + axis]);
        self.chart.jet(self.chart.place(tip)).at_mm
    }
}

/// Open places of layers, the largest first.
pub(super) fn open_places(layers: &[LayerSwept]) -> Vec<OpenGround> {
    let open = layers.iter().flat_map(|layer| {
        layer.open.iter().map(|place| OpenGround {
            area_mm2: place.area_mm2,
            at: Point2::new(place.at_mm[0], place.at_mm[1]),
            layer: layer.layer,
            layers: 1,
        })
    });
    let mut open: Vec<OpenGround> = open.collect();
    open.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    open
}

/// The nozzle's scale over regions and what lies beside them as far as a nozzle and a skirt reach.
fn scale_of(
    chart: &PatchChart,
    regions: &[Region],
    settings: &Settings,
) -> Result<ScaleField, SurfaceError> {
    let edges = regions.iter().flat_map(Region::edges);
    let edges: Vec<Edge> = edges.map(|(a, b)| Edge { a, b }).collect();
    let index = EdgeIndex::new(edges, LOOK_MM);
    let beside_mm = skirt_reach_mm(settings) + settings.aperture.reach_mm();
    let bounds = index.bounds().grown(beside_mm);
    let is_ground = |at: Point2| index.signed_distance_mm(at) > -beside_mm;
    let above_mm = middle_mm(settings);
    let scale = ScaleField::of(chart, bounds, is_ground, above_mm);
    scale.ok_or_else(|| {
        let at_mm = chart.frame(bounds.min, 0.0).tip_mm;
        SurfaceError::TooRough(layer_folds(above_mm, at_mm.into()))
    })
}

fn sharp_bend(looked: &Looked, settings: &Settings) -> Result<Option<SharpBend>, SurfaceError> {
    let (bend_per_mm, at) = looked.bend;
    let bend = SharpBend {
        radius_mm: 1.0 / bend_per_mm.max(1e-9),
        off_mm: 0.5 * settings.aperture.major_mm().powi(2) * bend_per_mm,
        at_mm: at.into(),
    };
    let share = bend.off_mm / settings.layer_height_mm;
    if share > OFF_SHARE_MAX {
        return Err(SurfaceError::TooRough(refusal!(
            "the surface bends with a radius of {:.2} mm near {}: the ends of a flat nozzle are {:.2} mm off it there, \
             more than half a layer; keep the outline off the edge, round it, or use a smaller --aperture",
            bend.radius_mm,
            spot(bend.at_mm),
            bend.off_mm
        )));
    }
    Ok((share > HANG_SHARE).then_some(bend))
}

fn scales(looked: &Looked) -> Result<[f64; 2], SurfaceError> {
    let (Some((least, least_at)), Some((most, most_at))) = (looked.least, looked.most) else {
        return Ok([1.0; 2]);
    };
    if most / least > RANGE_MAX {
        return Err(SurfaceError::NotFlat(refusal!(
            "flattened, the surface is {:.2} times larger near {} than near {}, more than {RANGE_MAX:.1} times; cut \
             it into smaller patches",
            most / least,
            spot(most_at.into()),
            spot(least_at.into())
        )));
    }
    Ok([least, most])
}

/// Looks at places of the regions and along their edges.
fn looked_over(chart: &PatchChart, scale: &ScaleField, regions: &[Region]) -> Looked {
    let mut looked = Looked::default();
    for region in regions {
        let bounds = region.bounds();
        let size = bounds.size();
        let step_mm = LOOK_MM.max(size.x.max(size.y) / LOOKS_MAX);
        let [columns, rows] = [size.x, size.y].map(|side| (side / step_mm).ceil() as usize);
        let inner = (0..=rows).flat_map(|j| (0..=columns).map(move |i| (i, j)));
        let inner = inner.map(|(i, j)| bounds.min + step_mm * Vector2::new(i as f64, j as f64));
        let index = EdgeIndex::of_region(region, step_mm);
        let inner = inner.filter(|&p| index.contains(p));
        for at in inner.chain(region.edges().map(|(p, _)| p)) {
            let jet = chart.jet(at);
            let [u, v] = jet.along;
            let tilt_rad = u.cross(&v).angle(&Vector3::z());
            let bend_per_mm = sharpest_bend_per_mm(&jet).abs();
            let lambda = scale.at(at).lambda;
            if tilt_rad > looked.tilt.0 {
                looked.tilt = (tilt_rad, jet.at_mm);
            }
            if bend_per_mm > looked.bend.0 {
                looked.bend = (bend_per_mm, jet.at_mm);
            }
            if looked.least.is_none_or(|(least, _)| lambda < least) {
                looked.least = Some((lambda, jet.at_mm));
            }
            if looked.most.is_none_or(|(most, _)| lambda > most) {
                looked.most = Some((lambda, jet.at_mm));
            }
        }
    }
    looked
}

/// A region in the chart: its edges in as many pieces as they need to be curves there.
pub fn in_chart(region: &Region, place: impl Fn(Point2) -> Point2) -> Region {
    let middle = |a: Point2, b: Point2| nalgebra::center(&a, &b);
    let apart_mm = |a: Point2, b: Point2| (b - a).norm();
    let ring = |ring: &Ring| Ring {
        points: divided(&ring.points, &place, middle, apart_mm),
    };
    Region {
        exterior: ring(&region.exterior),
        holes: region.holes.iter().map(ring).collect(),
    }
}

/// What lies within the largest of these rings and outside the others; `None` without any.
pub fn region_within(mut rings: Vec<Ring>) -> Option<Region> {
    let area_mm2 = |ring: &Ring| ring.signed_area_mm2().abs();
    rings.sort_by(|a, b| area_mm2(b).total_cmp(&area_mm2(a)));
    let mut rings = rings.into_iter();
    Some(Region {
        exterior: rings.next()?,
        holes: rings.collect(),
    })
}

/// A ring of points in space in the chart.
pub fn in_space(ring: &[Vector3<f64>], chart: &PatchChart) -> Ring {
    let place = |at: Vector3<f64>| chart.place(at);
    let middle = |a: Vector3<f64>, b: Vector3<f64>| 0.5 * (a + b);
    let apart_mm = |a: Vector3<f64>, b: Vector3<f64>| (b - a).norm();
    Ring {
        points: divided(ring, &place, middle, apart_mm),
    }
}

/// A ring of points, wherever they are, in the chart.
pub fn divided<T: Copy>(
    ring: &[T],
    place: &impl Fn(T) -> Point2,
    middle: impl Fn(T, T) -> T,
    apart_mm: impl Fn(T, T) -> f64,
) -> Vec<Point2> {
    let edges = Edges {
        place,
        middle,
        apart_mm,
    };
    let mut points = Vec::new();
    for (k, &from) in ring.iter().enumerate() {
        let to = ring[(k + 1) % ring.len()];
        let ends = [(from, place(from)), (to, place(to))];
        points.push(ends[0].1);
        edges.divide(ends, HALVINGS, &mut points);
    }
    points
}

/// How edges go into the chart.
struct Edges<'a, P, M, A> {
    place: &'a P,
    middle: M,
    apart_mm: A,
}

impl<P, M, A> Edges<'_, P, M, A> {
    /// Adds the places between two ends of an edge that the chord does not meet.
    fn divide<T: Copy>(
        &self,
        [from, to]: [(T, Point2); 2],
        halvings: usize,
        points: &mut Vec<Point2>,
    ) where
        P: Fn(T) -> Point2,
        M: Fn(T, T) -> T,
        A: Fn(T, T) -> f64,
    {
        let at = (self.middle)(from.0, to.0);
        let middle = (at, (self.place)(at));
        let is_bent = (middle.1 - nalgebra::center(&from.1, &to.1)).norm() > CHORD_MM;
        // A long edge may bend to either side of its chord.
        let is_long = (self.apart_mm)(from.0, to.0) > LONG_MM;
        if halvings == 0 || !(is_bent || is_long) {
            return;
        }
        self.divide([from, middle], halvings - 1, points);
        if is_bent {
            points.push(middle.1);
        }
        self.divide([middle, to], halvings - 1, points);
    }
}

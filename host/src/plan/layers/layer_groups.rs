//! The layers of a job: which are identical, and how each one's regions are printed.
//!
//! In a prism every layer has the same outline, in other parts each its own. Layers of the same
//! outline with the same lines inside are planned once ([`LayerGroup`]); they differ only in their
//! height, the order of their regions and the direction of each, begun near the head's position
//! ([`RegionPrint`]).
//!
//! Input: the regions with their axes. Output: groups, printings, and the curves of the complete
//! job in machine coordinates. A curve is stored once, however many layers print it.

use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::frame::{Frame, snapped};
use crate::geometry::place_scale::ScaleField;
use crate::geometry::plane_curve::PlaneControl;
use crate::geometry::{Point2, Vector2};
use crate::job::transform::PartTransform;
use crate::plan::curve::heading_stops::PassCutter;
use crate::plan::curve::layer_path::{pass_curves, path_tolerance_mm};
use crate::plan::curve::pushing_inside::InsideWalls;
use crate::plan::joining::order::region_order;
use crate::plan::layers::PlanePass;
use crate::plan::layers::bridge_ground::Bridge;
use crate::plan::layers::each_kind::from_the_middle;
use crate::plan::layers::inside::Inside;
use crate::plan::layers::optimised_passes::PassCurve;
use crate::plan::layers::region_plan::region_work::RegionWork;
use crate::plan::layers::region_plan::{RegionPlan, Reversal};
use crate::plan::layers::skirt::SkirtPlan;
use crate::plan::pass::{LayerPass, PassKind};
use crate::plan::progress::{Progress, Stage, Steps, Stopped};
use crate::settings::{Infill, Settings};
use crate::text::refusal::{Refusal, refusal};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The region number of a pass without a region: skirt and brim count as neither coverage nor
/// depth.
pub const OFF_REGIONS: usize = usize::MAX;
/// Most control points of all printed curves: 800 m of path and more, and 1 GB while it is planned.
pub const POINTS_MAX: usize = 10_000_000;

/// Layers that are planned once.
#[derive(Clone, Debug)]
pub struct LayerGroup {
    /// Walls and lines; `None` for loops all the way in.
    pub infill: Option<Infill>,
    /// How many layers are of this kind.
    pub layers: u32,
    /// The lowest of them.
    pub first_layer: u32,
    /// The regions in the input's order.
    pub regions: Vec<RegionPlan>,
}

/// One printing of a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegionPrint {
    /// Layer from 0.
    pub layer: u32,
    /// Number of the layer's kind.
    pub kind: usize,
    /// Number of the region.
    pub region: usize,
    /// Its reversed parts.
    pub turned: Reversal,
    /// The first printing that runs the same curves: its own number, or an earlier one's.
    pub like: usize,
}

/// The different infills, in the order of their first layers, and the infill of each layer.
pub fn infills_of_layers(settings: &Settings) -> (Vec<Option<Infill>>, Vec<usize>) {
    let mut kinds: Vec<Option<Infill>> = Vec::new();
    let mut of_layer = Vec::with_capacity(settings.layers as usize);
    for layer in 0..settings.layers {
        let infill = settings.infill.as_ref();
        let infill = infill.map(|infill| infill.of_layer(layer, settings.layers));
        let known = kinds.iter().position(|known| *known == infill);
        of_layer.push(known.unwrap_or(kinds.len()));
        if known.is_none() {
            kinds.push(infill);
        }
    }
    (kinds, of_layer)
}

/// Requirements on the layers of a group.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerKind {
    /// Number of the outline among the different ones.
    pub outline: usize,
    /// What is inside the walls of its regions.
    pub inside: Inside,
}

/// One layer of a stack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StackLayer {
    /// Number in the job, from 0.
    pub number: u32,
    /// Its top, input coordinates.
    pub top_mm: f64,
    /// Number of its kind.
    pub kind: usize,
}

/// Kinds and layers of a prism: one outline, solid layers at the bottom and the top, of which the first one over a
/// sparse infill has `bridges`.
pub fn prism_layers(
    settings: &Settings,
    bridges: impl Fn(u32) -> Vec<Bridge>,
) -> (Vec<LayerKind>, Vec<StackLayer>) {
    let (infills, infill_of_layer) = infills_of_layers(settings);
    let is_solid = |layer: u32| {
        let infill = infills[infill_of_layer[layer as usize]];
        infill.is_none_or(|infill| infill.is_solid())
    };
    let mut kinds: Vec<LayerKind> = infills
        .iter()
        .map(|&infill| LayerKind {
            outline: 0,
            inside: Inside {
                infill,
                ..Inside::default()
            },
        })
        .collect();
    let mut layers = Vec::with_capacity(infill_of_layer.len());
    for (number, &infill) in (0u32..).zip(&infill_of_layer) {
        let is_roof = number > 0 && is_solid(number) && !is_solid(number - 1);
        let bridges = if is_roof { bridges(number) } else { Vec::new() };
        let kind = if bridges.is_empty() {
            infill
        } else {
            let mut roof = kinds[infill].clone();
            roof.inside.bridges = bridges;
            kinds.push(roof);
            kinds.len() - 1
        };
        layers.push(StackLayer {
            number,
            top_mm: settings.layer_height_mm * f64::from(number + 1),
            kind,
        });
    }
    // Of a part of few layers, all of that kind may be roofs.
    let is_used = |kind: usize| layers.iter().any(|layer| layer.kind == kind);
    let used: Vec<usize> = (0..kinds.len()).filter(|&kind| is_used(kind)).collect();
    for layer in &mut layers {
        layer.kind = used.partition_point(|&kind| kind < layer.kind);
    }
    let kinds = used.iter().map(|&kind| kinds[kind].clone()).collect();
    (kinds, layers)
}

/// The groups of layers, with the plans of their regions. `outlines` are the regions of the different outlines.
///
/// # Errors
/// [`Stopped`].
pub fn layer_groups(
    outlines: &[Vec<RegionWork>],
    kinds: &[LayerKind],
    layers: &[StackLayer],
    progress: &dyn Progress,
) -> Result<Vec<LayerGroup>, Stopped> {
    let counts: Vec<usize> = (kinds.iter())
        .map(|kind| outlines[kind.outline].len())
        .collect();
    let steps = Steps::begin(progress, Stage::Passes, counts.iter().sum());
    let regions = from_the_middle(&counts, |kind, region, next_to| {
        let kind = &kinds[kind];
        let work = &outlines[kind.outline][region];
        steps.step(|| work.planned(&kind.inside, next_to))
    })?;
    let kinds = kinds.iter().zip(regions).enumerate();
    let groups = kinds.map(|(number, (kind, regions))| {
        let mut its_layers = layers.iter().filter(|layer| layer.kind == number);
        let first_layer = its_layers.next().map_or(0, |layer| layer.number);
        LayerGroup {
            infill: kind.inside.infill,
            layers: 1 + its_layers.count() as u32,
            first_layer,
            regions,
        }
    });
    Ok(groups.collect())
}

/// How the regions of every layer are printed: nearest first, each begun at its nearer end, from
/// where the layer below was left. `from` is where the head is first, input coordinates.
pub fn region_prints(
    kinds: &[LayerGroup],
    layers: &[StackLayer],
    from: Point2,
) -> Vec<RegionPrint> {
    let mut position = from;
    let mut prints: Vec<RegionPrint> = Vec::new();
    let mut known = BTreeMap::new();
    for &StackLayer {
        number: layer,
        kind,
        ..
    } in layers
    {
        let regions = &kinds[kind].regions;
        let centers: Vec<Point2> = regions.iter().map(RegionPlan::middle).collect();
        for region in region_order(&centers, position) {
            let turned = regions[region].turned(position);
            position = regions[region].end(turned).unwrap_or(position);
            let like = *known.entry((kind, region, turned)).or_insert(prints.len());
            prints.push(RegionPrint {
                layer,
                kind,
                region,
                turned,
                like,
            });
        }
    }
    prints
}

/// A curve that is printed, machine coordinates.
#[derive(Clone, Debug)]
struct PrintCurve {
    kind: PassKind,
    then: Vec<(usize, PassKind)>,
    control: Arc<[PlaneControl]>,
}

/// The curves of the complete job in machine coordinates, with skirt and brim on the first layer
/// before its regions, and the printing of each.
///
/// # Errors
/// [`Refusal`] above [`POINTS_MAX`].
pub fn plane_passes(
    skirt: Option<&SkirtPlan>,
    kinds: &[LayerGroup],
    prints: &[RegionPrint],
    layers: &[StackLayer],
    transform: &PartTransform,
    settings: &Settings,
) -> Result<(Vec<PlanePass>, Vec<usize>), Refusal> {
    let place = Vector2::new(transform.offset_mm[0], transform.offset_mm[1]);
    let firsts = prints.par_iter().enumerate();
    let curves: Vec<Vec<PrintCurve>> = firsts
        .map(|(number, print)| {
            if print.like != number {
                return Vec::new();
            }
            let region = &kinds[print.kind].regions[print.region];
            let framed = FramedPasses {
                passes: &region.passes_turned(print.turned),
                curves: &region.curves_turned(print.turned),
                walls: &region.walls,
                scale: region.scale.as_ref(),
                frame: region.frame,
                shift: region.contour.offset + place,
            };
            framed.curves(region_curves, settings)
        })
        .collect();
    let around = skirt.map_or(Vec::new(), |skirt| {
        let framed = FramedPasses {
            passes: &skirt.passes,
            curves: &[],
            walls: &skirt.walls,
            scale: None,
            frame: Frame::IDENTITY,
            shift: skirt.offset + place,
        };
        framed.curves(pass_curves, settings)
    });
    let of_print = |print: &RegionPrint| curves[print.like].iter();
    check_length(
        around.iter().chain(prints.iter().flat_map(of_print)),
        layers.len() as u32,
    )?;
    let top_mm: BTreeMap<u32, f64> = layers.iter().map(|l| (l.number, l.top_mm)).collect();
    let (mut passes, mut print_of_pass) = (Vec::new(), Vec::new());
    let mut add = |curves: &[PrintCurve], layer: u32, print: usize| {
        for curve in curves {
            passes.push(PlanePass {
                kind: curve.kind,
                then: curve.then.clone(),
                layer,
                z_mm: transform.offset_mm[2] + top_mm.get(&layer).copied().unwrap_or_default(),
                control: curve.control.clone(),
            });
            print_of_pass.push(print);
        }
    };
    let first_layer = layers.first().map_or(0, |layer| layer.number);
    add(&around, first_layer, OFF_REGIONS);
    for (number, print) in prints.iter().enumerate() {
        add(&curves[print.like], print.layer, number);
    }
    Ok((passes, print_of_pass))
}

/// Where between two of its periods a heading counts to the next one: no round angle is there.
const PERIOD_SHARE: f64 = 0.37;
/// Ends of a pass that differ by less along an axis count as equally far along it, mm.
const SAME_MM: f64 = 1e-6;

/// The curves of a region's pass, found in the same manner in both directions: the path is pushed off
/// the walls in many small steps, in which rounding would grow into another curve.
fn region_curves(pass: &LayerPass, inside: &InsideWalls) -> Vec<Vec<PlaneControl>> {
    let mut pass = pass.clone();
    let is_back = runs_back(&pass);
    if is_back {
        pass.placements.reverse();
    }
    let Some(first) = pass.placements.first() else {
        return Vec::new();
    };
    // Headings a period apart are the same, but for their last digits.
    let period_rad = inside.aperture.period_rad();
    let periods_rad = (first.at.heading_rad / period_rad + PERIOD_SHARE).floor() * period_rad;
    for placement in &mut pass.placements {
        placement.at = Configuration {
            center: placement.at.center.map(snapped),
            heading_rad: snapped(placement.at.heading_rad - periods_rad),
        };
    }
    let mut curves = pass_curves(&pass, inside);
    if is_back {
        curves.reverse();
    }
    for curve in &mut curves {
        if is_back {
            curve.reverse();
        }
        for control in curve {
            control[2] += periods_rad;
        }
    }
    curves
}

/// True if the first placement is farther along the axes than the last one; for a loop, the first
/// that differs from its counterpart.
fn runs_back(pass: &LayerPass) -> bool {
    let forwards = pass.placements.iter().map(|p| p.at.center);
    let pairs = forwards.clone().zip(forwards.rev());
    let mut ways = pairs.map(|(first, last)| last - first);
    let way = ways.find(|way| way.amax() > SAME_MM);
    way.is_some_and(|way| {
        let along_mm = if way.x.abs() > SAME_MM { way.x } else { way.y };
        along_mm < 0.0
    })
}

/// Passes and walls in a frame; `shift` leads from outside the frame to machine coordinates, mm.
struct FramedPasses<'a> {
    passes: &'a [LayerPass],
    /// The curves of those that have one already.
    curves: &'a [PassCurve],
    walls: &'a EdgeIndex,
    scale: Option<&'a ScaleField>,
    frame: Frame,
    shift: Vector2,
}

impl FramedPasses<'_> {
    /// Their curves in machine coordinates; `whole` makes those of one or of a piece of one that stays
    /// within a tolerance.
    fn curves(
        &self,
        whole: impl Fn(&LayerPass, &InsideWalls) -> Vec<Vec<PlaneControl>>,
        settings: &Settings,
    ) -> Vec<PrintCurve> {
        let inside = InsideWalls {
            scale: self.scale,
            ..InsideWalls::flat(&settings.aperture, self.walls, path_tolerance_mm(settings))
        };
        let whole = |pass: &LayerPass| whole(pass, &inside);
        let to_machine = |control: &PlaneControl| {
            let at = self.frame.configuration_out(Configuration {
                center: Point2::new(control[0], control[1]),
                heading_rad: control[2],
            });
            let center = at.center + self.shift;
            [center.x, center.y, at.heading_rad]
        };
        let cutter = PassCutter::new(self.passes, self.walls, &self.frame, settings);
        let mut curves = Vec::new();
        for (number, pass) in self.passes.iter().enumerate() {
            let known = self.curves.get(number).and_then(Option::as_ref);
            let found = match known.filter(|control| cutter.fits(control)) {
                Some(control) => vec![control.to_vec()],
                None => cutter.curves(pass, whole),
            };
            let kinds = kinds_of(pass, &found).into_iter().zip(&found);
            curves.extend(kinds.map(|((kind, then), control)| PrintCurve {
                kind,
                then,
                control: control.iter().map(to_machine).collect(),
            }));
        }
        curves
    }
}

/// The kind of each curve of a pass, and the control points from which on it is of another one.
fn kinds_of(
    pass: &LayerPass,
    curves: &[Vec<PlaneControl>],
) -> Vec<(PassKind, Vec<(usize, PassKind)>)> {
    let mut from = (0, 0);
    let mut begins = Vec::with_capacity(pass.then.len());
    for (place, kind) in &pass.then {
        let all = (0..curves.len()).flat_map(|c| (0..curves[c].len()).map(move |i| (c, i)));
        let away_mm =
            |(c, i): (usize, usize)| (curves[c][i][0] - place.x).hypot(curves[c][i][1] - place.y);
        let nearest = all.filter(|at| *at >= from);
        from = nearest
            .min_by(|a, b| away_mm(*a).total_cmp(&away_mm(*b)))
            .unwrap_or(from);
        begins.push((from, *kind));
    }
    let of_curve = |number: usize| {
        let before = begins.iter().rev().find(|(at, _)| *at <= (number, 0));
        let within = begins.iter().filter(|((c, i), _)| *c == number && *i > 0);
        let within = within.map(|((_, i), kind)| (*i, *kind));
        (
            before.map_or(pass.kind, |(_, kind)| *kind),
            within.collect(),
        )
    };
    (0..curves.len()).map(of_curve).collect()
}

fn check_length<'a>(
    curves: impl Iterator<Item = &'a PrintCurve>,
    layers: u32,
) -> Result<(), Refusal> {
    let points: usize = curves.map(|curve| curve.control.len()).sum();
    if points <= POINTS_MAX {
        return Ok(());
    }
    let share = POINTS_MAX as f64 / points as f64;
    let fitting = (f64::from(layers) * share).floor().max(0.0) as u32;
    Err(refusal!(
        "{layers} layers of this part are a path of {points} control points, and a job has at most \
         {POINTS_MAX}: print fewer --layers at a time ({fitting} fit), or less of the part"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::walls;
    use crate::plan::pass::test_passes::{arc, pass};
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    /// What adding periods rounds of a heading; settling headings at another period moves them by up to
    /// 4e-9.
    const ROUNDING: f64 = 1e-11;

    /// Goal: a pass makes the same curve in whatever direction it runs and however many periods its
    /// headings are away. Method: an arc whose ends lie equally far along an axis, an open loop
    /// that ends where it begins, a bow that begins at a heading of 0, each against its reverse
    /// with headings some periods on.
    #[test]
    fn curves_do_not_depend_on_direction_or_period() {
        let settings = Settings::default();
        let center = Point2::new(0.1, -0.2);
        let place = |i: u32| {
            let angle = TAU * f64::from(i) / 90.0;
            let (sin, cos) = angle.sin_cos();
            (center + Vector2::new(1.4 * cos, 1.4 * sin), angle)
        };
        let passes = [
            arc(center, 1.4, -FRAC_PI_2, PI),
            pass((0..=90).map(place), false),
            arc(center, 1.4, 0.0, 2.0),
        ];
        let walls = walls(&[&[[-2.4, -2.4], [2.4, -2.4], [2.4, 2.4], [-2.4, 2.4]]]);
        let aperture = &settings.aperture;
        for pass in &passes {
            let curves = region_curves(pass, &InsideWalls::flat(aperture, &walls, 1e-3));
            for periods in [-3.0, 1.0, 4.0] {
                let periods_rad = periods * aperture.period_rad();
                let mut other = pass.clone();
                other.placements.reverse();
                for placement in &mut other.placements {
                    placement.at.heading_rad += periods_rad;
                }
                let mut others = region_curves(&other, &InsideWalls::flat(aperture, &walls, 1e-3));
                others.reverse();
                assert_eq!(curves.len(), others.len());
                for (curve, other) in curves.iter().zip(&others) {
                    assert_eq!(curve.len(), other.len());
                    for (a, b) in curve.iter().zip(other.iter().rev()) {
                        let apart = [a[0] - b[0], a[1] - b[1], a[2] + periods_rad - b[2]];
                        let apart = apart.iter().fold(0.0, |most: f64, d| most.max(d.abs()));
                        assert!(apart < ROUNDING, "{a:?} {b:?}");
                    }
                }
            }
        }
    }
}

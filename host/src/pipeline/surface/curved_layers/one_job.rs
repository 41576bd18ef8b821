//! Layers planned and put after each other -> one route, its motion, and what it covers.
//!
//! In: layers in order (heights above the bed, mm). Out: a [`Plan`] in input coordinates. From the lift behind one
//! layer's last pass the head goes straight up, across above all that is printed so far while it turns and tilts, and
//! straight down.

use super::CurvedFigures;
use super::laid_layer::{Context, Ground, Laid, curved, flat};
use super::layer_shape::{PartLayer, Shape};
use super::upright::{EdgeDepth, upright};
use crate::geometry::Point2;
use crate::geometry::polygon::{Box2, Region};
use crate::job::transform::PartTransform;
use crate::job::{MotionState, SegmentStream};
use crate::pipeline::error::no_region_printable;
use crate::pipeline::layer_time::lay_with_layer_times;
use crate::pipeline::piece::unreachable_boundary;
use crate::pipeline::placed_passes::{PlacedPasses, placed_passes};
use crate::pipeline::stack::{LeftOut, printings};
use crate::pipeline::{Plan, PlanError, start_pose};
use crate::plan::headings::stops::nearest_heading;
use crate::plan::judge::figures::{PlanFigures, Swept};
use crate::plan::judge::ground_sweep::{CurvedGround, LayerSwept, sweep_ground};
use crate::plan::judge::measure::{Measured, measure};
use crate::plan::judge::touches::touches;
use crate::plan::layers::PlanePass;
use crate::plan::layers::hollow::shell_layers;
use crate::plan::layers::layer_groups::{LayerGroup, OFF_REGIONS, RegionPrint};
use crate::plan::layers::shells::solid_ground;
use crate::plan::layers::skirt::skirt_reach_mm;
use crate::plan::motion::best_place::FoundPlace;
use crate::plan::motion::singular::SingularPlaces;
use crate::plan::progress::Progress;
use crate::plan::route::moves::{PathCurve, Route, RouteMove};
use crate::plan::route::waypoint_route::{complete_route, has_motion};
use crate::settings::Settings;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS,
};

type Point = [f64; CHANNELS];

/// Layers that were planned together, and the number of their first pass in the job.
struct Numbered {
    laid: Laid,
    first_layer: u32,
    first_pass: usize,
}

/// The job so far.
#[derive(Default)]
struct OneJob {
    moves: Vec<RouteMove>,
    parts: Vec<Numbered>,
    curves: Vec<PlanePass>,
    left_out: Vec<LeftOut>,
    top_mm: f64,
    volume_mm3: f64,
    edge_depth: Option<EdgeDepth>,
}

/// Plans layers as one job.
///
/// # Errors
/// [`PlanError`].
pub fn planned(
    layers: &[PartLayer],
    bed_mm: f64,
    figures: CurvedFigures,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    let mut job = OneJob::default();
    let mut number = 0;
    let solid = |number: u32| solid_of(layers, number, settings);
    // Flat layers that follow each other are planned together.
    for group in layers.chunk_by(|a, b| !a.is_curved() && !b.is_curved()) {
        let context = Context {
            settings,
            start: job.end(),
            is_first: number == 0,
            solid: &solid,
            progress,
        };
        progress.layers(number as usize, layers.len());
        for laid in laid_group(number, group, &context)? {
            job.add(laid, number, settings);
        }
        number += group.len() as u32;
    }
    progress.layers(layers.len(), layers.len());
    if job.curves.is_empty() {
        return Err(no_region_printable(job.left_out.len()));
    }
    job.raise(bed_mm);
    job.laid_out(layers, bed_mm, figures, settings, progress)
}

/// Layers that are planned together: flat ones, or a curved one.
fn laid_group(number: u32, group: &[PartLayer], context: &Context) -> Result<Vec<Laid>, PlanError> {
    match &group[0].shape {
        Shape::Flat { .. } => Ok(vec![flat(
            number..number + group.len() as u32,
            group,
            context,
        )?]),
        Shape::Curved { top, below } if !context.settings.tilts() => {
            upright(number, &group[0], (top, below), context)
        }
        Shape::Curved { top, below } => Ok(vec![curved(
            number,
            &group[0].regions,
            (top, below),
            context,
        )?]),
    }
}

/// What of a flat layer is filled whatever the density: what has no flat layer within a few above or below.
fn solid_of(layers: &[PartLayer], number: u32, settings: &Settings) -> Vec<Region> {
    let infill = settings.infill.as_ref().filter(|infill| !infill.is_solid());
    let Some(infill) = infill else {
        return Vec::new();
    };
    let (mut outlines, mut own) = (Vec::new(), None);
    for (layer, of) in (0u32..).zip(layers).filter(|(_, layer)| !layer.is_curved()) {
        if layer == number {
            own = Some(outlines.len());
        }
        outlines.push(of.regions.as_slice());
    }
    own.map_or(Vec::new(), |own| {
        solid_ground(&outlines, own, shell_layers(infill))
    })
}

impl OneJob {
    fn end(&self) -> Point {
        let last = self.moves.last().and_then(|last| last.curve.control.last());
        last.copied().unwrap_or_default()
    }

    /// Puts layers behind what there is.
    fn add(&mut self, mut laid: Laid, first_layer: u32, settings: &Settings) {
        self.left_out.append(&mut laid.left_out);
        self.edge_depth = EdgeDepth::deeper(self.edge_depth, laid.edge_depth);
        let first_pass = self.curves.len();
        let begin = laid
            .moves
            .first()
            .and_then(|first| first.curve.control.first());
        if let Some(&begin) = begin {
            let end = self.end();
            let period_rad = settings.aperture.period_rad();
            let heading_rad = begin[CHANNEL_HEADING];
            let turn_rad = match self.moves.is_empty() {
                true => 0.0,
                false => {
                    nearest_heading(heading_rad, end[CHANNEL_HEADING], period_rad) - heading_rad
                }
            };
            let more_mm3 = self.volume_mm3 - begin[CHANNEL_VOLUME];
            for route_move in &mut laid.moves {
                for point in &mut route_move.curve.control {
                    point[CHANNEL_HEADING] += turn_rad;
                    point[CHANNEL_VOLUME] += more_mm3;
                }
                route_move.pass = route_move.pass.map(|pass| pass + first_pass as u32);
            }
            let mut begin = begin;
            begin[CHANNEL_HEADING] += turn_rad;
            begin[CHANNEL_VOLUME] += more_mm3;
            if !self.moves.is_empty() {
                self.travel([end, begin], first_layer, settings.lift_mm);
            }
            let points = laid
                .moves
                .iter()
                .flat_map(|route_move| &route_move.curve.control);
            self.top_mm = points
                .map(|point| point[CHANNEL_Z])
                .fold(self.top_mm, f64::max);
            self.moves.append(&mut laid.moves);
            self.volume_mm3 = self.end()[CHANNEL_VOLUME];
        }
        self.curves.append(&mut laid.curves);
        self.parts.push(Numbered {
            laid,
            first_layer,
            first_pass,
        });
    }

    /// Up, across, down.
    fn travel(&mut self, [from, to]: [Point; 2], layer: u32, lift_mm: f64) {
        let above_mm = (self.top_mm + lift_mm)
            .max(from[CHANNEL_Z])
            .max(to[CHANNEL_Z]);
        let [up, over] = [from, to].map(|mut point| {
            point[CHANNEL_Z] = above_mm;
            point
        });
        for control in [vec![from, up], vec![up, over], vec![over, to]] {
            if control[0] != control[1] {
                let travel = RouteMove::new(MotionState::Travel, layer, control);
                self.moves.push(travel);
            }
        }
    }

    /// From heights above the bed to input coordinates.
    fn raise(&mut self, bed_mm: f64) {
        let moves = self.moves.iter_mut();
        for point in moves.flat_map(|route_move| &mut route_move.curve.control) {
            point[CHANNEL_Z] += bed_mm;
        }
        self.top_mm += bed_mm;
        if let Some(deepest) = &mut self.edge_depth {
            deepest.at_mm[2] += bed_mm;
        }
    }

    fn bounds(&self, layers: &[PartLayer], settings: &Settings) -> Box2 {
        let points = self
            .moves
            .iter()
            .flat_map(|route_move| &route_move.curve.control);
        let points = points.map(|point| Point2::new(point[CHANNEL_X], point[CHANNEL_Y]));
        let regions = layers.iter().flat_map(|layer| &layer.regions);
        let boxes = regions.map(|region| region.bounds());
        let corners: Vec<Point2> = boxes.flat_map(|b| [b.min, b.max]).chain(points).collect();
        Box2::of(&corners).grown(skirt_reach_mm(settings))
    }

    /// The route on the machine, with the way there and back.
    fn placed(
        &self,
        layers: &[PartLayer],
        bed_mm: f64,
        settings: &Settings,
    ) -> Result<Placed, PlanError> {
        let bounds = self.bounds(layers, settings);
        let stacked = Settings {
            layers: layers.len() as u32,
            ..settings.clone()
        };
        let transform = PartTransform::choose_box(bounds, [bed_mm, self.top_mm], &stacked)?;
        let PlacedPasses {
            passes,
            transform,
            found_place,
            singular,
            ..
        } = placed_passes(
            vec![self.curves_at(&transform)],
            transform,
            bounds,
            settings,
            false,
        )?;
        let top_mm = self.top_mm + transform.offset_mm[2];
        let route = complete_route(
            &[&self.moves],
            passes,
            top_mm,
            start_pose(settings),
            settings,
        );
        Ok(Placed {
            route,
            transform,
            found_place,
            singular,
        })
    }

    /// The motion, and what it covers.
    fn laid_out(
        self,
        layers: &[PartLayer],
        bed_mm: f64,
        mut curved: CurvedFigures,
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<Plan, PlanError> {
        let Placed {
            mut route,
            transform,
            found_place,
            singular,
        } = self.placed(layers, bed_mm, settings)?;
        let touches = touches(&route, None, settings);
        let (stream, motion, slowed) = lay_with_layer_times(&mut route, settings, progress)?;
        let flat = self.flat_prints();
        let judged = self.judged(&stream, &flat, &transform, bed_mm, settings, progress);
        for part in &self.parts {
            if let Ground::Surface(laid) = &part.laid.on {
                curved.unreachable.extend(laid.unreachable.iter().copied());
            }
        }
        curved.unreachable.extend(unreachable_boundary(
            flat.kinds.iter().flat_map(|kind| &kind.regions),
        ));
        curved.swept = judged.curved;
        curved.edge_depth = self.edge_depth;
        Ok(Plan {
            transform,
            found_place,
            singular,
            touches,
            left_out: self.left_out,
            curves: self.curves,
            curved_layers: Some(curved),
            kinds: flat.kinds,
            prints: flat.prints,
            print_of_curve: flat.print_of_curve,
            measured: judged.measured,
            slowed,
            route,
            stream,
            motion,
            figures: judged.figures,
            ..Plan::default()
        })
    }

    fn curves_at(&self, transform: &PartTransform) -> Vec<PathCurve> {
        let moves = self
            .moves
            .iter()
            .filter(|route_move| has_motion(route_move));
        let curves =
            moves.map(|route_move| super::super::shifted(&route_move.curve, transform.offset_mm));
        curves.collect()
    }

    /// The flat layers of all parts, counted together.
    fn flat_prints(&self) -> FlatPrints {
        let mut flat = FlatPrints::default();
        for part in &self.parts {
            let (first_kind, first_print) = (flat.kinds.len(), flat.prints.len());
            let of_part = part.laid.print_of_curve.iter();
            match &part.laid.on {
                Ground::Plane { kinds, prints } => {
                    flat.kinds.extend(kinds.iter().cloned());
                    flat.prints.extend(prints.iter().map(|print| RegionPrint {
                        kind: first_kind + print.kind,
                        like: first_print + print.like,
                        ..*print
                    }));
                    flat.print_of_curve
                        .extend(of_part.map(|print| match *print {
                            OFF_REGIONS => OFF_REGIONS,
                            print => first_print + print,
                        }));
                }
                Ground::Surface(_) => flat.print_of_curve.extend(of_part.map(|_| OFF_REGIONS)),
            }
        }
        flat
    }

    /// Coverage of all layers: flat ones in the plane, curved ones on their surfaces.
    fn judged(
        &self,
        stream: &SegmentStream,
        flat: &FlatPrints,
        transform: &PartTransform,
        bed_mm: f64,
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Judged {
        let prints = printings(&flat.kinds, &flat.prints);
        let (mut figures, measured) = measure(
            stream,
            &prints,
            &flat.print_of_curve,
            transform,
            settings,
            progress,
        );
        let swept = prints.iter().zip(&measured.swept);
        let mut swept: Vec<(u32, Swept)> = swept.map(|(p, swept)| (p.layer, *swept)).collect();
        let curved = self.swept_on_surfaces(stream, transform, bed_mm, settings);
        swept.extend(curved.iter().map(|layer| (layer.layer, layer.swept)));
        swept.sort_by_key(|(layer, _)| *layer);
        let (layers, swept): (Vec<u32>, Vec<Swept>) = swept.into_iter().unzip();
        figures.set_shares(&layers, &swept);
        // What is printed beside regions of the plane lies on curved ones.
        figures.skirt_mm = 0.0;
        Judged {
            figures,
            measured,
            curved,
        }
    }

    fn swept_on_surfaces(
        &self,
        stream: &SegmentStream,
        transform: &PartTransform,
        bed_mm: f64,
        settings: &Settings,
    ) -> Vec<LayerSwept> {
        let mut raised = *transform;
        raised.offset_mm[2] += bed_mm;
        let of_parts = self.parts.iter().flat_map(|part| {
            let Ground::Surface(laid) = &part.laid.on else {
                return Vec::new();
            };
            let ground = CurvedGround {
                chart: &*laid.chart,
                scale: &laid.scale,
                regions: &laid.regions,
                transform: &raised,
                lowest_layer: part.first_layer,
                joined: None,
            };
            let of_regions = |pass: u32| {
                let own = (pass as usize).checked_sub(part.first_pass);
                let print = own.and_then(|own| part.laid.print_of_curve.get(own));
                print.is_some_and(|print| *print != OFF_REGIONS)
            };
            sweep_ground(stream, &ground, of_regions, settings)
        });
        of_parts.collect()
    }
}

/// A route on the machine.
struct Placed {
    route: Route,
    transform: PartTransform,
    found_place: Option<FoundPlace>,
    singular: SingularPlaces,
}

/// Flat layers, for what is said of those of other plans.
#[derive(Default)]
struct FlatPrints {
    kinds: Vec<LayerGroup>,
    prints: Vec<RegionPrint>,
    print_of_curve: Vec<usize>,
}

/// What was covered.
struct Judged {
    figures: PlanFigures,
    measured: Measured,
    curved: Vec<LayerSwept>,
}

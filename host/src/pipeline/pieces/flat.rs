//! Layers of a piece -> its moves, planned flat as a part is.
//!
//! In: sliced layers in the piece's frame (mm). Out: [`Flat`]: moves from the first prime to the lift after the last pass, in
//! the frame; layers, passes and volume counted from 0.

use crate::geometry::polygon::Region;
use crate::job::MotionState;
use crate::job::transform::PartTransform;
use crate::mesh::layers::SlicedPart;
use crate::pipeline::PlanError;
use crate::pipeline::blocks::gather;
use crate::pipeline::part_body::PartBody;
use crate::pipeline::stack::{LeftOut, route_stack};
use crate::plan::layers::PlanePass;
use crate::plan::layers::layer_groups::{LayerGroup, OFF_REGIONS, RegionPrint};
use crate::plan::progress::Progress;
use crate::plan::route::moves::RouteMove;
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNELS};

/// What was planned of a piece.
#[derive(Default)]
pub(super) struct Flat {
    pub(super) moves: Vec<RouteMove>,
    pub(super) curves: Vec<PlanePass>,
    /// For each pass the number of its print, or [`OFF_REGIONS`].
    pub(super) print_of_curve: Vec<usize>,
    pub(super) kinds: Vec<LayerGroup>,
    pub(super) prints: Vec<RegionPrint>,
    pub(super) left_out: Vec<LeftOut>,
}

/// Plans the layers of a piece; with a skirt around the lowest one if it `is_first`.
///
/// # Errors
/// [`PlanError`]; a region that cannot be planned is left out instead.
pub(super) fn flat(
    part: &SlicedPart,
    is_first: bool,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Flat, PlanError> {
    let outlines: Vec<&[Region]> = part.layers.iter().map(|l| l.regions.as_slice()).collect();
    let body = PartBody::new(&outlines, &part.wanted, settings);
    let mut flat = Flat::default();
    let mut rest = part.wanted_layers();
    while let Some(lowest) = rest.first() {
        let transform = PartTransform::default();
        let (mut stack, used) = gather(rest, &body, &[], settings, transform);
        let around = lowest.regions.as_slice();
        let is_around = is_first && lowest.number == 0 && !around.is_empty();
        stack.skirt_around = is_around.then_some(around);
        stack.start = Some(flat.end().unwrap_or_else(|| begin(&stack.outlines)));
        rest = &rest[used..];
        stack.is_last = rest.is_empty();
        let routed = route_stack(&stack, settings, progress)?;
        let (first_pass, first_kind, first_print) =
            (flat.curves.len(), flat.kinds.len(), flat.prints.len());
        let moves = routed.route.moves.into_iter().map(|own| RouteMove {
            pass: own.pass.map(|pass| pass + first_pass as u32),
            ..own
        });
        flat.moves.extend(moves);
        flat.curves.extend(routed.curves);
        flat.kinds.extend(routed.kinds);
        flat.prints
            .extend(routed.prints.into_iter().map(|print| RegionPrint {
                kind: first_kind + print.kind,
                like: first_print + print.like,
                ..print
            }));
        let prints = routed.print_of_curve.into_iter().map(|print| match print {
            OFF_REGIONS => OFF_REGIONS,
            print => first_print + print,
        });
        flat.print_of_curve.extend(prints);
        flat.left_out.extend(routed.left_out);
    }
    let is_begun = |own: &RouteMove| own.state != MotionState::Travel;
    let first = flat.moves.iter().position(is_begun);
    flat.moves.drain(..first.unwrap_or(flat.moves.len()));
    Ok(flat)
}

/// The corner of the lowest layer.
fn begin(outlines: &[Vec<Region>]) -> [f64; CHANNELS] {
    let mut pose = [0.0; CHANNELS];
    if let Some(region) = outlines.iter().flatten().next() {
        (pose[CHANNEL_X], pose[CHANNEL_Y]) = (region.bounds().min.x, region.bounds().min.y);
    }
    pose
}

impl Flat {
    fn end(&self) -> Option<[f64; CHANNELS]> {
        self.moves.last()?.curve.control.last().copied()
    }

    /// Counts layers, passes and volume on from these.
    pub(super) fn count_on(&mut self, layers: u32, passes: u32, volume_mm3: f64) {
        let points = self.moves.iter().flat_map(|own| &own.curve.control);
        let begun_mm3 = points.map(|pose| pose[CHANNEL_VOLUME]).next();
        let more_mm3 = volume_mm3 - begun_mm3.unwrap_or_default();
        for own in &mut self.moves {
            own.layer += layers;
            own.pass = own.pass.map(|pass| pass + passes);
            let control = own.curve.control.iter_mut();
            control.for_each(|pose| pose[CHANNEL_VOLUME] += more_mm3);
        }
        self.curves.iter_mut().for_each(|own| own.layer += layers);
        self.kinds
            .iter_mut()
            .for_each(|own| own.first_layer += layers);
        self.prints.iter_mut().for_each(|own| own.layer += layers);
        self.left_out.iter_mut().for_each(|own| own.layer += layers);
    }

    /// The volume laid up to its end.
    pub(super) fn volume_mm3(&self) -> Option<f64> {
        self.end().map(|pose| pose[CHANNEL_VOLUME])
    }
}

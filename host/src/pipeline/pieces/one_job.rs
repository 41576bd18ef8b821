//! Pieces planned and put after each other -> one route, its motion, and what it covers.
//!
//! Each piece is measured in its own frame, as a part is: the finished stream is turned back for it.

use super::PartPieces;
use super::flat::{Flat, flat};
use super::frame::Frame;
use super::sections::Divided;
use crate::geometry::polygon::Box2;
use crate::job::SegmentStream;
use crate::job::transform::PartTransform;
use crate::mesh::layers::SlicedPart;
use crate::pipeline::error::no_region_printable;
use crate::pipeline::layer_time::lay_with_layer_times;
use crate::pipeline::open_ground::open_ground;
use crate::pipeline::piece::unreachable_boundary;
use crate::pipeline::placed_passes::{PlacedPasses, placed_passes};
use crate::pipeline::stack::printings;
use crate::pipeline::surface::shifted;
use crate::pipeline::{Plan, PlanError, start_pose};
use crate::plan::judge::figures::Swept;
use crate::plan::judge::measure::measure;
use crate::plan::judge::touches::touches;
use crate::plan::layers::layer_groups::OFF_REGIONS;
use crate::plan::motion::singular::lines_up_upright;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::progress::Progress;
use crate::plan::route::moves::{PathCurve, RouteMove};
use crate::plan::route::waypoint_route::{complete_route, has_motion};
use crate::report::figures::PieceFigures;
use crate::settings::Settings;
use crate::settings::directions::PieceCut;

/// A piece with its layers planned.
struct Planned {
    frame: Frame,
    part: SlicedPart,
    flat: Flat,
    /// Numbers of its first layer and pass in the job.
    first_layer: u32,
    first_pass: usize,
}

/// Plans the pieces of a part as one job.
///
/// # Errors
/// [`PlanError`].
pub(super) fn planned(
    divided: &Divided,
    cuts: Vec<PieceCut>,
    transform: PartTransform,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    let pieces = pieces(divided, settings, progress)?;
    let left_out = pieces
        .iter()
        .flat_map(|piece| piece.flat.left_out.clone())
        .collect::<Vec<_>>();
    let moves: Vec<&[RouteMove]> = pieces.iter().map(|piece| &piece.flat.moves[..]).collect();
    if moves.iter().all(|moves| moves.is_empty()) {
        return Err(no_region_printable(left_out.len()));
    }
    let [low, high] = divided.mesh.bounds_mm();
    let curves_of = |moves: &&[RouteMove]| -> Vec<PathCurve> {
        let curves = moves.iter().filter(|own| has_motion(own));
        curves
            .map(|own| shifted(&own.curve, transform.offset_mm))
            .collect()
    };
    let bounds = Box2 {
        min: low.xy(),
        max: high.xy(),
    };
    let passes = moves.iter().map(curves_of).collect();
    let PlacedPasses {
        passes, singular, ..
    } = placed_passes(passes, transform, bounds, settings, false)?;
    let top_mm = high.z + transform.offset_mm[2];
    let mut route = complete_route(&moves, passes, top_mm, start_pose(settings), settings);
    let touches = touches(&route, None, settings);
    let (stream, motion, slowed) = lay_with_layer_times(&mut route, settings, progress)?;
    let (mut plan, found) = judged(&pieces, &stream, transform, settings, progress);
    plan.curves = pieces
        .iter()
        .flat_map(|piece| piece.flat.curves.iter().cloned())
        .collect();
    Ok(Plan {
        transform,
        singular,
        touches,
        left_out,
        slowed,
        pieces: Some(PartPieces {
            figures: pieces
                .iter()
                .zip(0..)
                .map(|(of, piece)| of.figures(divided, &cuts, piece))
                .collect(),
            cuts,
            ..found
        }),
        route,
        stream,
        motion,
        ..plan
    })
}

/// The pieces in the order of printing, each leaned, its layers, passes and volume counted on.
fn pieces(
    divided: &Divided,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Vec<Planned>, PlanError> {
    let mut pieces: Vec<Planned> = Vec::new();
    let (mut layers, mut passes, mut volume_mm3) = (0, 0, 0.0);
    for piece in 0..=divided.cuts.len() {
        progress.layers(piece, divided.cuts.len() + 1);
        let frame = divided.frame(piece);
        let part = divided.layers(piece, settings)?;
        let mut flat = flat(&part, piece == 0, settings, progress)?;
        flat.count_on(layers, passes as u32, volume_mm3);
        let is_free = lines_up_upright(&settings.machine.kinematics);
        match divided.cuts.first() {
            Some(first) if piece == 0 && is_free => frame.leaning(&first.direction),
            _ => frame,
        }
        .lean(&mut flat.moves);
        let (first_layer, first_pass) = (layers, passes);
        layers += part.layers.len() as u32;
        passes += flat.curves.len();
        volume_mm3 = flat.volume_mm3().unwrap_or(volume_mm3);
        pieces.push(Planned {
            frame,
            part,
            flat,
            first_layer,
            first_pass,
        });
    }
    progress.layers(divided.cuts.len() + 1, divided.cuts.len() + 1);
    Ok(pieces)
}

/// A plan with what was covered: kinds, prints and rasters are those of the rest, shares those of all pieces.
fn judged(
    pieces: &[Planned],
    stream: &SegmentStream,
    transform: PartTransform,
    settings: &Settings,
    progress: &dyn Progress,
) -> (Plan, PartPieces) {
    let passes = pieces.iter().map(|piece| piece.flat.curves.len()).sum();
    let mut swept: Vec<(u32, Swept)> = Vec::new();
    let mut found = PartPieces::default();
    let mut of_rest = None;
    for piece in pieces {
        let mut print_of_curve = vec![OFF_REGIONS; passes];
        let own = piece.first_pass..piece.first_pass + piece.flat.curves.len();
        print_of_curve[own].copy_from_slice(&piece.flat.print_of_curve);
        let seen = piece.frame.stream(stream, &transform);
        let prints = printings(&piece.flat.kinds, &piece.flat.prints);
        let placed = PartTransform::default();
        let (figures, measured) =
            measure(&seen, &prints, &print_of_curve, &placed, settings, progress);
        let of_prints = prints.iter().zip(&measured.swept);
        swept.extend(of_prints.map(|(print, swept)| (print.layer, *swept)));
        let plan = Plan {
            kinds: piece.flat.kinds.clone(),
            prints: piece.flat.prints.clone(),
            print_of_curve,
            measured,
            figures,
            ..Plan::default()
        };
        piece.look(&plan, &mut found, settings);
        of_rest = of_rest.or(Some(plan));
    }
    found.open.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    let mut plan = of_rest.unwrap_or_default();
    let (layers, swept): (Vec<u32>, Vec<Swept>) = swept.into_iter().unzip();
    plan.figures.set_shares(&layers, &swept);
    // The passes of the other pieces are off the regions of the rest.
    plan.figures.skirt_mm = 0.0;
    (plan, found)
}

impl Planned {
    /// Adds its open places and its boundary that is not reached.
    fn look(&self, plan: &Plan, found: &mut PartPieces, settings: &Settings) {
        let level_mm = |layer: u32| {
            let own = self.part.layers.get((layer - self.first_layer) as usize);
            own.map_or(0.0, |layer| layer.top_mm)
        };
        for mut open in open_ground(plan, settings) {
            open.at = self
                .frame
                .seen(open.at, level_mm(open.layer.max(self.first_layer)));
            found.open.push(open);
        }
        for kind in &plan.kinds {
            let level_mm = level_mm(kind.first_layer);
            let seen = |run: UnreachableRun| UnreachableRun {
                from: self.frame.seen(run.from, level_mm),
                to: self.frame.seen(run.to, level_mm),
            };
            found
                .unreachable
                .extend(unreachable_boundary(&kind.regions).into_iter().map(seen));
        }
    }

    fn figures(&self, divided: &Divided, cuts: &[PieceCut], piece: usize) -> PieceFigures {
        let cut = piece.checked_sub(1).map(|cut| &divided.cuts[cut]);
        let [x, y, z] = cut.map_or([0.0, 0.0, 1.0], |cut| cut.direction.into());
        let [upright_mm2, overhang_mm2] = divided.hanging_mm2[piece];
        let heights = self.part.layers.iter().map(|layer| layer.height_mm);
        PieceFigures {
            direction: [x, y, z],
            at_mm: piece.checked_sub(1).map(|cut| cuts[cut].at_mm),
            tilt_deg: z.clamp(-1.0, 1.0).acos().to_degrees(),
            layers: self.part.layers.len() as u64,
            height_mm: heights.sum(),
            volume_mm3: self.part.volume_mm3(),
            overhang_upright_mm2: upright_mm2,
            overhang_mm2,
        }
    }
}

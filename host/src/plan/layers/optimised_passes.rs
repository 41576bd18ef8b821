//! The passes of a region handed to the optimiser and taken back as the curves that are printed.
//!
//! In: passes in printing order (mm, rad), the walls, the settings. Out: for each pass the control points of its
//! curve, inside the walls; `None` where the optimiser does not apply (apertures other than the ellipse, headings with
//! stops, beads that are to overlap, lines of a sparse infill and bridges in the region) or where what it made is not
//! inside: such a pass becomes a curve as it is, by [`crate::plan::curve::layer_path`].

use crate::geometry::aperture::Aperture;
use crate::geometry::coverage::return_mm;
use crate::geometry::edge_index::EdgeIndex;
use crate::plan::curve::even_spans::{EvenSpans, even_spans};
use crate::plan::curve::heading_stops::heading_range;
use crate::plan::curve::layer_path::{merged, path_tolerance_mm, sharpened, whole_inside};
use crate::plan::curve::plane_curve::{PlaneControl, configuration, curve_at};
use crate::plan::curve::pushing_inside::{InsideWalls, strayed_spans};
use crate::plan::optimise::{Effort, Objective, OptimisedPass, optimise};
use crate::plan::pass::{LayerPass, PassKind, Placement};
use crate::plan::pose_limits::PoseLimits;
use crate::settings::{Quality, Settings};
use std::sync::Arc;

/// Ground laid twice against ground left open.
const TWICE_SHARE: f64 = 0.5;
/// What a curve may be moved by on its way inside, against b: 50 µm for 0.2 mm, which one pose in a thousand
/// takes. What is farther outside is not a rest that the optimiser left.
const MOVED_SHARE: f64 = 0.25;

/// The curve of a pass, where there is one.
pub type PassCurve = Option<Arc<[PlaneControl]>>;

/// True where the optimiser knows the nozzle, which is an ellipse that turns without an end, and where ground that is
/// laid twice is a loss: beads that are asked to overlap keep doing so.
pub fn knows_job(settings: &Settings) -> bool {
    let aperture = &settings.aperture;
    let is_ellipse = matches!(aperture, Aperture::Ellipse { .. }) && !aperture.is_round();
    let mut stops = heading_range(settings).into_iter();
    is_ellipse && stops.all(f64::is_infinite) && settings.overlap_pct == 0.0
}

/// True where it knows the passes too.
pub fn may_optimise(passes: &[LayerPass], settings: &Settings) -> bool {
    let is_known = |pass: &LayerPass| pass.kind.follows_walls() || pass.kind == PassKind::Infill;
    knows_job(settings) && passes.iter().all(is_known)
}

/// The passes optimised, and their curves; those of which the optimiser made none as `otherwise` makes them.
pub fn optimised_or(
    mut passes: Vec<LayerPass>,
    walls: &EdgeIndex,
    settings: &Settings,
    otherwise: impl Fn(Vec<LayerPass>) -> Vec<LayerPass>,
) -> (Vec<LayerPass>, Vec<PassCurve>) {
    let before = passes.clone();
    let curves = optimised(&mut passes, walls, settings);
    if curves.iter().any(Option::is_none) {
        let others = otherwise(before);
        let left = passes.iter_mut().zip(others).zip(&curves);
        for ((pass, other), _) in left.filter(|(_, curve)| curve.is_none()) {
            *pass = other;
        }
    }
    (passes, curves)
}

/// Optimises the passes of a region together. The placements of those with a curve become poses of it.
fn optimised(passes: &mut [LayerPass], walls: &EdgeIndex, settings: &Settings) -> Vec<PassCurve> {
    let aperture = &settings.aperture;
    let limits = PoseLimits::of(settings);
    let begun = passes.iter().map(|pass| {
        let (control, numbers) = merged(pass);
        let even = even_spans(&sharpened(&control), aperture, &limits);
        (even, numbers)
    });
    let begun: Vec<(EvenSpans, Vec<usize>)> = begun.collect();
    let unknowns = begun.iter().map(|(even, _)| OptimisedPass {
        control: even.control.clone(),
        log_pace: even.log_pace.clone(),
    });
    let mut unknowns: Vec<OptimisedPass> = unknowns.collect();
    let objective = Objective {
        price_s_mm2: settings.quality.price_s_mm2(),
        twice_share: TWICE_SHARE,
        return_mm: return_mm(aperture),
    };
    let effort = Effort {
        iterations: iterations(settings.quality),
    };
    optimise(&mut unknowns, walls, aperture, &limits, &objective, &effort);
    let inside = InsideWalls {
        aperture,
        walls,
        tolerance_mm: path_tolerance_mm(settings),
    };
    let found = unknowns.iter().zip(passes).zip(&begun);
    found
        .map(|((unknown, pass), (even, numbers))| {
            let control = checked(&unknown.control, &inside)?;
            // A curve that was led around has a few more points than it began with.
            let share = (even.numbers.len() - 1) as f64 / (control.len() - 1) as f64;
            let begun = |i: usize| numbers[even.numbers[(i as f64 * share) as usize]];
            pass.placements = placements_on(&control, |i| pass.placements[begun(i)]);
            Some(control.into())
        })
        .collect()
}

/// Iterations that a quality pays for.
fn iterations(quality: Quality) -> usize {
    match quality {
        Quality::Fast => 10,
        Quality::Standard => 20,
        Quality::Fine => 80,
    }
}

/// The curve where it is inside the walls, or all but; else pushed inside as the curve of any other pass.
fn checked(control: &[PlaneControl], inside: &InsideWalls) -> Option<Vec<PlaneControl>> {
    let mut pushed = control.to_vec();
    let far_mm = MOVED_SHARE * inside.aperture.minor_mm();
    let is_inside = |curve: &[PlaneControl]| !inside.cutting_spans(curve).contains(&true);
    let hardly_moved =
        inside.push(&mut pushed) && !strayed_spans(control, &pushed, far_mm).contains(&true);
    let found = match hardly_moved {
        true => Some(pushed),
        false => whole_inside(control, inside),
    };
    found.filter(|curve| is_inside(curve))
}

/// The poses of a curve where its spans meet, each with the contact of the placement that `begun` has.
fn placements_on(control: &[PlaneControl], begun: impl Fn(usize) -> Placement) -> Vec<Placement> {
    let last = control.len() - 1;
    (0..=last)
        .map(|i| {
            let at = match i {
                i if i == last => control[last],
                i => curve_at(control, i, 0.0),
            };
            Placement {
                at: configuration(at),
                feasible: true,
                ..begun(i)
            }
        })
        .collect()
}

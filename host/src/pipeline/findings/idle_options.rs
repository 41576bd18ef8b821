//! Options that were given and change nothing in the job.
//!
//! In: the options, the finished plan with its figures and settings. Out: a line for each, with why. Not covered: limits
//! that nothing exceeds (tolerances, longest times), which are kept, and options that planning keeps in part: those are
//! objections and notes of their stage.

use crate::pipeline::layer_uses::Use;
use crate::pipeline::planned::Planned;
use crate::settings::options::Options;
use crate::settings::{Infill, SeamPlace};

/// One line for each of them.
pub(crate) fn idle_options(options: &Options, planned: &Planned) -> Vec<String> {
    let given = options.given().into_iter();
    let idle = given.filter_map(|name| Some((name, why_idle(name, planned)?)));
    idle.map(|(name, why)| format!("{name} changes nothing here: {why}"))
        .collect()
}

/// Why a given option changes nothing.
fn why_idle(name: &str, planned: &Planned) -> Option<&'static str> {
    let settings = &planned.settings;
    // Surfaces do not count by kind: all may be there.
    let by_kind = planned.figures.by_kind.as_ref();
    let lacks = |kind: Use| {
        let used = by_kind.map(|by_kind| by_kind.get(kind.name()));
        used.is_some_and(|used| used.is_none_or(|used| used.volume_mm3 <= 0.0))
    };
    let infill = settings.infill.as_ref();
    let is_solid = infill.is_some_and(Infill::is_solid);
    let none_sparse = !is_solid && lacks(Use::Sparse);
    let is_hollow = infill.is_some_and(|infill| infill.density_pct <= 0.0);
    Some(match name {
        "--wall-speed" if lacks(Use::Walls) => "no loops are laid along the outline",
        "--solid-speed" if lacks(Use::Solid) => "no lines of filled ground are laid",
        "--sparse-speed" if lacks(Use::Sparse) => "no sparse lines are laid",
        "--infill-density" | "--infill-spacing" if none_sparse && !is_hollow => {
            "nothing lies so far inside that its lines would be sparse"
        }
        "--infill-angle" if lacks(Use::Sparse) && lacks(Use::Solid) => "no lines are laid inside",
        "--bottom" | "--top" if is_solid => "all layers are solid",
        "--bridge-max" if lacks(Use::Bridge) => "no bridges are laid",
        "--skirt-distance-mm" if settings.skirt.loops == 0 => "there is no skirt (--skirt N)",
        "--seam-direction" if settings.seam.place != SeamPlace::Aligned => {
            "it is that of aligned seams (--seam aligned)"
        }
        "--law" if settings.aperture.is_round() => "a round nozzle has no heading",
        _ => return None,
    })
}

//! The profile as published: at each contact the feasible heading nearest to the law's angle, of
//! the two signs the one that turns less. Kept to show what looking along the pass gains.

use super::Run;
use rayon::prelude::*;

/// Step of the search for a feasible heading, rad.
const STEP_RAD: f64 = 0.02;
/// A placement that is slid by more than this share of b does not touch at its contact.
const SLIDE_SHARE: f64 = 1e-3;

/// For one sign of the heading angle: the feasible heading nearest to the law's, and how far off.
#[derive(Clone, Copy)]
struct Found {
    heading_rad: f64,
    off_rad: f64,
}

/// Headings of all contacts, unwrapped.
pub fn pointwise(run: &Run) -> Vec<f64> {
    let found: Vec<[Found; 2]> = (0..run.contacts.len())
        .into_par_iter()
        .map(|i| [1.0, -1.0].map(|sign| nearest(run, i, sign)))
        .collect();
    let mut headings = Vec::with_capacity(found.len());
    let mut last: Option<f64> = None;
    for [plus, minus] in found {
        let from = last.unwrap_or(plus.heading_rad);
        let turn = |f: Found| run.aperture.wrapped_rad(f.heading_rad - from);
        let is_plus = if (plus.off_rad - minus.off_rad).abs() < 0.5 * STEP_RAD {
            turn(plus).abs() <= turn(minus).abs()
        } else {
            plus.off_rad < minus.off_rad
        };
        let heading = from + turn(if is_plus { plus } else { minus });
        headings.push(heading);
        last = Some(heading);
    }
    headings
}

/// Outwards from the law's angle to both sides, at most a quarter turn.
fn nearest(run: &Run, i: usize, sign: f64) -> Found {
    let (contact, aperture) = (&run.contacts[i], run.aperture);
    let law_rad = sign * aperture.angle_of_extent_rad(contact.extent_mm);
    let heading_rad = contact.normal.y.atan2(contact.normal.x) + law_rad;
    let steps = (std::f64::consts::FRAC_PI_2 / STEP_RAD).ceil() as usize;
    let slide_max_mm = SLIDE_SHARE * aperture.minor_mm();
    (0..=steps)
        .flat_map(|step| [1.0, -1.0].map(|way| way * STEP_RAD * step as f64))
        .find(|off| {
            let found = run.place(i, heading_rad + off);
            found.feasible && found.slide_mm <= slide_max_mm
        })
        .map_or(
            Found {
                heading_rad,
                off_rad: f64::INFINITY,
            },
            |off| Found {
                heading_rad: heading_rad + off,
                off_rad: off.abs(),
            },
        )
}

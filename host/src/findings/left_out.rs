//! What a plan leaves out, as places for the eye.
//!
//! In: pieces of open ground and runs of boundary out of reach, input coordinates. Out: the largest of
//! each, mm.

use crate::open_ground::OpenGround;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::report::Place;

/// Places of either kind that the report's page lists.
const PLACES_SHOWN: usize = 20;

/// Open ground and unreachable boundary as places for the eye.
pub(crate) fn left_out(open: &[OpenGround], unreachable: &[UnreachableRun]) -> Vec<Place> {
    let open = open.iter().map(|piece| Place {
        what: match piece.layers {
            1 => format!("{:.3} mm² of open ground", piece.area_mm2),
            layers => format!(
                "{:.3} mm² of open ground, on {layers} layers",
                piece.area_mm2
            ),
        },
        x_mm: piece.at.x,
        y_mm: piece.at.y,
    });
    let runs = longest_first(unreachable).into_iter().map(|run| {
        let at = nalgebra::center(&run.from, &run.to);
        Place {
            what: format!("{:.3} mm of boundary out of reach", run.length_mm()),
            x_mm: at.x,
            y_mm: at.y,
        }
    });
    told_once(open).chain(told_once(runs)).collect()
}

/// Runs by their length.
pub(super) fn longest_first(unreachable: &[UnreachableRun]) -> Vec<&UnreachableRun> {
    let mut longest: Vec<&UnreachableRun> = unreachable.iter().collect();
    longest.sort_by(|a, b| b.length_mm().total_cmp(&a.length_mm()));
    longest
}

/// The first places, each once with how often it comes: layers that are alike lack the same.
fn told_once(places: impl Iterator<Item = Place>) -> impl Iterator<Item = Place> {
    let mut told: Vec<(Place, usize)> = Vec::new();
    for place in places {
        let known = told.iter().position(|(other, _)| *other == place);
        match known {
            Some(number) => told[number].1 += 1,
            None if told.len() < PLACES_SHOWN => told.push((place, 1)),
            None => {}
        }
    }
    told.into_iter().map(|(place, times)| match times {
        1 => place,
        times => Place {
            what: format!("{}, on {times} layers", place.what),
            ..place
        },
    })
}

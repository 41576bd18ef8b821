//! Places that a plan leaves uncovered, for display.
//!
//! In: uncovered areas and unreachable intervals of the boundary, input coordinates. Out: the largest
//! of each, mm.

use crate::pipeline::open_ground::OpenGround;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::report::Place;
use crate::report::figures::{Figures, LayerPlace};

/// Places of either kind that the report's page lists.
const PLACES_SHOWN: usize = 20;

/// Uncovered area and unreachable boundary as places for display; `layers` are the lowest ones of the boundary,
/// where they are known.
pub(crate) fn left_out(
    open: &[OpenGround],
    unreachable: &[UnreachableRun],
    layers: &[u32],
) -> Vec<Place> {
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
        layer: Some(piece.layer),
    });
    let mut runs: Vec<(&UnreachableRun, Option<u32>)> = unreachable
        .iter()
        .enumerate()
        .map(|(k, run)| (run, layers.get(k).copied()))
        .collect();
    runs.sort_by(|a, b| b.0.length_mm().total_cmp(&a.0.length_mm()));
    let runs = runs.into_iter().map(|(run, layer)| {
        let at = nalgebra::center(&run.from, &run.to);
        Place {
            what: format!("{:.3} mm of boundary out of reach", run.length_mm()),
            x_mm: at.x,
            y_mm: at.y,
            layer,
        }
    });
    told_once(open).chain(told_once(runs)).collect()
}

/// Regions that are not printed and overhangs, as figures have them; of a job from a file its boundary as well.
pub(crate) fn of_figures(figures: &Figures, is_job: bool) -> Vec<Place> {
    let of = |places: &Option<Vec<LayerPlace>>, what: &'static str| {
        let places = places.iter().flatten().take(PLACES_SHOWN);
        let place = |place: &LayerPlace| Place {
            what: format!("{:.3} mm² {what}", place.area_mm2),
            x_mm: place.x_mm,
            y_mm: place.y_mm,
            layer: None,
        };
        places.map(place).collect::<Vec<_>>()
    };
    let mut all = of(&figures.left_out_places, "not printed");
    all.extend(of(&figures.overhang_places, "over nothing"));
    let boundary = figures.unreachable_places_mm.iter().flatten();
    let boundary = boundary.take(PLACES_SHOWN).map(|&[x_mm, y_mm, mm]| Place {
        what: format!("{mm:.3} mm of boundary out of reach"),
        x_mm,
        y_mm,
        layer: None,
    });
    all.extend(boundary.filter(|_| is_job));
    all
}

/// Runs by their length.
pub(super) fn longest_first(unreachable: &[UnreachableRun]) -> Vec<&UnreachableRun> {
    let mut longest: Vec<&UnreachableRun> = unreachable.iter().collect();
    longest.sort_by(|a, b| b.length_mm().total_cmp(&a.length_mm()));
    longest
}

/// The first places, each once with its number of occurrences: equal layers lack the same places.
fn told_once(places: impl Iterator<Item = Place>) -> impl Iterator<Item = Place> {
    let mut told: Vec<(Place, usize)> = Vec::new();
    for place in places {
        let is_same = |other: &Place| {
            let layer = other.layer;
            *other
                == Place {
                    layer,
                    ..place.clone()
                }
        };
        let known = told.iter().position(|(other, _)| is_same(other));
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

#[cfg(test)]
mod tests {
    //! Goal: a place that several layers lack is told once, with the lowest of them. Method: runs by hand.
    use super::*;
    use crate::geometry::Point2;

    #[test]
    fn what_several_layers_lack_is_told_once_with_the_lowest() {
        let run = |x: f64| UnreachableRun {
            from: Point2::new(x, 0.0),
            to: Point2::new(x + 1.0, 0.0),
        };
        let open = OpenGround {
            area_mm2: 0.5,
            at: Point2::new(3.0, 4.0),
            layer: 7,
            layers: 2,
        };
        let found = left_out(&[open], &[run(1.0), run(5.0), run(1.0)], &[3, 4, 6]);
        let told: Vec<(&str, Option<u32>)> = found
            .iter()
            .map(|place| (place.what.as_str(), place.layer))
            .collect();
        assert_eq!(
            told,
            [
                ("0.500 mm² of open ground, on 2 layers", Some(7)),
                ("1.000 mm of boundary out of reach, on 2 layers", Some(3)),
                ("1.000 mm of boundary out of reach", Some(4)),
            ]
        );
    }

    #[test]
    fn a_job_from_a_file_lists_what_its_figures_know() {
        let place = |area_mm2: f64| LayerPlace {
            x_mm: 1.0,
            y_mm: 2.0,
            z_mm: 3.0,
            area_mm2,
        };
        let figures = Figures {
            left_out_places: Some(vec![place(0.5)]),
            overhang_places: Some(vec![place(4.0)]),
            unreachable_places_mm: Some(vec![[5.0, 6.0, 0.25]]),
            ..Figures::default()
        };
        let what = |is_job: bool| {
            let places = of_figures(&figures, is_job).into_iter();
            places.map(|place| place.what).collect::<Vec<_>>()
        };
        let of_plan = ["0.500 mm² not printed", "4.000 mm² over nothing"];
        assert_eq!(what(false), of_plan);
        assert_eq!(what(true)[..2], of_plan);
        assert_eq!(what(true)[2], "0.250 mm of boundary out of reach");
    }
}

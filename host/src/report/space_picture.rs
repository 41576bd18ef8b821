//! A path in space with its tool axes, seen from above at a slant.
//!
//! In: positions of the tip (mm, input coordinates), tool axes, whether flow is on. Out: SVG.
//! Parallel projection: X to the lower right, Y to the upper right, Z up. Not covered: hidden
//! lines.

use super::canvas::{Canvas, INK, Swatch};
use crate::geometry::Point2;
use crate::geometry::polygon::Box2;
use nalgebra::Vector3;
use svg::node::element::Path;

/// The view turns the part by this angle about Z, and looks down on it at this angle, degrees.
const TURN_DEG: f64 = 35.0;
const DOWN_DEG: f64 = 30.0;
/// Length of an axis as a share of the picture.
const AXIS_SHARE: f64 = 0.05;
/// Axes in the whole picture.
const AXES: usize = 400;
const PATH_COLOUR: &str = "#2b6cb0";
const TRAVEL_COLOUR: &str = "#a0aec0";
const AXIS_COLOUR: &str = "#dd6b20";

/// A place on the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpacePoint {
    /// Tip, mm.
    pub tip_mm: [f64; 3],
    /// Tool axis, from the tip into the head.
    pub axis: [f64; 3],
    /// True where flow is on.
    pub prints: bool,
}

/// The data drawn.
#[derive(Clone, Debug)]
pub struct SpacePicture {
    /// Written above.
    pub title: String,
    /// The path in order.
    pub points: Vec<SpacePoint>,
}

fn seen(place: &Vector3<f64>) -> Point2 {
    let (turn_sin, turn_cos) = TURN_DEG.to_radians().sin_cos();
    let (down_sin, down_cos) = DOWN_DEG.to_radians().sin_cos();
    let right = turn_cos * place.x + turn_sin * place.y;
    let away = turn_cos * place.y - turn_sin * place.x;
    Point2::new(right, down_cos * place.z + down_sin * away)
}

/// The picture as SVG.
pub fn draw(picture: &SpacePicture) -> String {
    let tips = || {
        picture
            .points
            .iter()
            .map(|point| Vector3::from(point.tip_mm))
    };
    let places: Vec<Point2> = tips().map(|tip| seen(&tip)).collect();
    let size = Box2::of(&places).size();
    let length_mm = AXIS_SHARE * size.x.max(size.y).max(1e-3);
    let printed = picture.points.iter().filter(|point| point.prints).count();
    let every = printed.div_ceil(AXES).max(1);
    let axes: Vec<[Point2; 2]> = picture
        .points
        .iter()
        .filter(|point| point.prints)
        .step_by(every)
        .map(|point| {
            let tip = Vector3::from(point.tip_mm);
            [
                seen(&tip),
                seen(&(tip + length_mm * Vector3::from(point.axis))),
            ]
        })
        .collect();
    let all: Vec<Point2> = places
        .iter()
        .chain(axes.iter().flatten())
        .copied()
        .collect();
    let mut canvas = Canvas::new(Box2::of(&all), &picture.title);
    let mut data = [String::new(), String::new(), String::new()];
    let mut at = 0;
    for run in picture.points.chunk_by(|a, b| a.prints == b.prints) {
        // A run begins where the one before it ended.
        let from = at - usize::from(at > 0);
        at += run.len();
        let kind = usize::from(run[0].prints);
        canvas.line_data(&mut data[kind], &places[from..at], false);
    }
    for axis in &axes {
        canvas.line_data(&mut data[2], axis, false);
    }
    let [travel, path, axes] = data;
    for (data, colour, width) in [
        (travel, TRAVEL_COLOUR, 0.7),
        (axes, AXIS_COLOUR, 0.8),
        (path, PATH_COLOUR, 1.4),
    ] {
        let line = Path::new().set("d", data).set("fill", "none");
        canvas.add(line.set("stroke", colour).set("stroke-width", width));
    }
    let origin = Point2::origin();
    if Box2::of(&all).contains(origin) {
        canvas.dots(&[origin], 3.0, INK);
        canvas.legend(Swatch::Dot(INK), "origin of the input");
    }
    canvas.legend(Swatch::Line(PATH_COLOUR, 1.4, false), "path with flow");
    canvas.legend(
        Swatch::Line(AXIS_COLOUR, 0.8, false),
        "tool axis, from the tip",
    );
    canvas.legend(Swatch::Line(TRAVEL_COLOUR, 0.7, false), "travel");
    canvas.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn path_travel_and_axes_are_drawn() {
        let point = |x: f64, prints: bool| SpacePoint {
            tip_mm: [x, 0.0, 0.1 * x],
            axis: [0.0, 0.6, 0.8],
            prints,
        };
        let picture = SpacePicture {
            title: "a run".to_string(),
            points: (0..100).map(|i| point(f64::from(i), i >= 10)).collect(),
        };
        let text = draw(&picture);
        assert!(
            text.contains("a run") && text.contains("tool axis"),
            "{text}"
        );
        for colour in [PATH_COLOUR, TRAVEL_COLOUR, AXIS_COLOUR] {
            assert!(text.contains(colour), "{colour}");
        }
        assert!(!text.contains("NaN"), "{text}");
        // Up is up, and what is to the right is.
        let up = seen(&Vector3::z()).y;
        assert!(up > 0.5 && seen(&Vector3::x()).x > 0.5 && seen(&Vector3::y()).x > 0.0);
    }
}

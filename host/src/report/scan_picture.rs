//! A layer as a scan found it: pieces of its passes, as wide as they are, coloured by how much too much or too little they have.
//!
//! In: pieces and places. Out: one SVG.

use super::canvas::{Canvas, Swatch};
use crate::geometry::polygon::Box2;
use crate::geometry::{Point2, Vector2};
use svg::node::element::Path;

/// Classes of the error of the volume: up to which share of the asked, colour, words.
const CLASSES: [(f64, &str, &str); 7] = [
    (-0.25, "#1e3a8a", "a quarter too little, or less"),
    (-0.10, "#3b82f6", "10 to 25 % too little"),
    (-0.03, "#93c5fd", "3 to 10 % too little"),
    (0.03, "#d1d5db", "within 3 %"),
    (0.10, "#fca5a5", "3 to 10 % too much"),
    (0.25, "#dc2626", "10 to 25 % too much"),
    (f64::INFINITY, "#7f1d1d", "a quarter too much, or more"),
];
const UNSEEN: &str = "#fef08a";
const PLACE_PX: f64 = 5.0;

/// A piece of a pass.
pub struct ScannedPiece {
    /// Its middle.
    pub at_mm: [f64; 2],
    /// Direction of travel, a unit vector.
    pub along: [f64; 2],
    /// Its length along the pass.
    pub length_mm: f64,
    /// To the left and to the right.
    pub widths_mm: [f64; 2],
    /// Volume that is too much, as a share of the asked; `None` where the scan has nothing.
    pub off: Option<f64>,
}

impl ScannedPiece {
    fn class(&self) -> Option<usize> {
        let off = self.off?;
        CLASSES.iter().position(|(most, ..)| off <= *most)
    }

    /// Right and left at its begin, left and right at its end.
    fn corners(&self) -> [Point2; 4] {
        let (at, along) = (Point2::from(self.at_mm), Vector2::from(self.along));
        let half = along * (0.5 * self.length_mm);
        let [left, right] = self.widths_mm.map(|w| Vector2::new(-along.y, along.x) * w);
        [
            at - half - right,
            at - half + left,
            at + half + left,
            at + half - right,
        ]
    }
}

/// Draws the pieces in the order in which they were printed, and dots at places, mm.
pub fn draw(title: &str, pieces: &[ScannedPiece], places: &[[f64; 2]]) -> String {
    let all: Vec<[Point2; 4]> = pieces.iter().map(ScannedPiece::corners).collect();
    let mut canvas = Canvas::new(Box2::of(&all.concat()), title);
    for run in (0..pieces.len()).collect::<Vec<_>>().chunk_by(|a, b| {
        // Later pieces cover earlier ones in part: a path has what follows one another in one colour.
        pieces[*a].class() == pieces[*b].class()
    }) {
        let mut data = String::new();
        for piece in run {
            canvas.line_data(&mut data, &all[*piece], true);
        }
        let fill = pieces[run[0]].class().map_or(UNSEEN, |own| CLASSES[own].1);
        canvas.add(Path::new().set("d", data).set("fill", fill));
    }
    for (_, fill, words) in CLASSES {
        canvas.legend(Swatch::Fill(fill), words);
    }
    canvas.legend(Swatch::Fill(UNSEEN), "not seen");
    if !places.is_empty() {
        canvas.legend(Swatch::Dot("black"), "largest gaps and bulges");
        let places: Vec<Point2> = places.iter().copied().map(Point2::from).collect();
        canvas.dots(&places, PLACE_PX, "black");
    }
    canvas.finish()
}

#[cfg(test)]
mod tests {
    //! Goal: pieces are where and as wide as they are, in their colour. Method: two of a pass along x, one unseen.
    use super::*;

    #[test]
    fn pieces_have_their_width_and_their_colour() {
        let piece = |x, widths_mm, off| ScannedPiece {
            at_mm: [x, 0.0],
            along: [1.0, 0.0],
            length_mm: 10.0,
            widths_mm,
            off,
        };
        let pieces = [
            piece(5.0, [1.0, 2.0], Some(0.05)),
            piece(15.0, [1.0, 1.0], None),
        ];
        let drawn = draw("part", &pieces, &[[5.0, 0.0]]);
        // 20 mm are 1,000 px; the sheet is higher than its 3 mm, which lie at its lower edge.
        for (corners, fill) in [
            (
                "M24.00 324.00L24.00 174.00L524.00 174.00L524.00 324.00Z",
                "#fca5a5",
            ),
            (
                "M524.00 274.00L524.00 174.00L1024.00 174.00L1024.00 274.00Z",
                UNSEEN,
            ),
        ] {
            let path = drawn.split("<path").find(|path| path.contains(corners));
            assert!(path.is_some_and(|path| path.contains(fill)), "{drawn}");
        }
        assert_eq!(
            drawn.matches("<circle").count(),
            2,
            "a dot and the legend's"
        );
        assert_eq!(draw("none", &[], &[]).matches("<path").count(), 0);
    }
}

//! The curved edges of a segment Voronoi diagram.
//!
//! In: a point and an edge (mm). Out: points of the curve that is equidistant from both, mm, by
//! their abscissa along the edge. Source: G. Voronoi (1908); the closed form of a parabola by focus
//! and directrix.

use super::Generator;
use crate::geometry::edge_index::Edge;
use crate::geometry::{Point2, Vector2};

/// A focus closer to its line than the diagram can distinguish, mm: its parabola is then the
/// perpendicular at the focus, and the edge is drawn straight.
const HEIGHT_MIN_MM: f64 = 5e-4;

/// The parabola between a point and a line: `base` is the focus' foot on the line, `height` its
/// distance; a point at abscissa x along the line is (x² + h²) / 2h above it.
pub struct Parabola {
    base: Point2,
    along: Vector2,
    up: Vector2,
    pub height: f64,
}

impl Parabola {
    pub fn of(edges: &[Edge], generators: &[Generator; 2]) -> Option<Parabola> {
        let (number, focus) = match *generators {
            [Generator::Edge(e), Generator::Vertex(q)] => (e, q),
            [Generator::Vertex(q), Generator::Edge(e)] => (e, q),
            _ => return None,
        };
        let edge = edges[number];
        let length = edge.length_mm();
        if length <= 0.0 {
            return None;
        }
        let along = (edge.b - edge.a) / length;
        let base = edge.a + along * along.dot(&(focus - edge.a));
        let up = focus - base;
        let height = up.norm();
        (height > HEIGHT_MIN_MM).then(|| Parabola {
            base,
            along,
            up: up / height,
            height,
        })
    }

    /// The abscissa of a point of the curve along the line. On the steep arms it is computed from
    /// the height, since there a rounding of the abscissa would move the point far along the arm.
    pub fn abscissa(&self, p: Point2) -> f64 {
        let x = self.along.dot(&(p - self.base));
        let rise = self.up.dot(&(p - self.base));
        if x.abs() > self.height && 2.0 * rise > self.height {
            (self.height * (2.0 * rise - self.height))
                .sqrt()
                .copysign(x)
        } else {
            x
        }
    }

    pub fn point(&self, x: f64) -> Point2 {
        let rise = (x * x + self.height * self.height) / (2.0 * self.height);
        self.base + self.along * x + self.up * rise
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: a focus next to its line does not throw points along the steep arms (found on a noisy
    /// ring of 10⁵ edges: middles 15 mm off, so that every angle was tried in vain). Method: points
    /// of the arms moved sideways by the grid's rounding come back within a grid unit of height.
    #[test]
    fn steep_arms_keep_their_height() {
        for height in [6e-4, 1e-3, 0.02] {
            let edges = [Edge {
                a: Point2::new(-3.0, 0.0),
                b: Point2::new(3.0, 0.0),
            }];
            let focus = Generator::Vertex(Point2::new(0.0, height));
            let parabola = Parabola::of(&edges, &[Generator::Edge(0), focus]).expect("a parabola");
            for x in [-0.3f64, -0.05, 0.05, 0.3] {
                let on_arm = parabola.point(x);
                let moved = on_arm + Vector2::new(5e-5, 0.0);
                let back = parabola.point(parabola.abscissa(moved));
                assert!((back - on_arm).norm() < 1e-4, "{height} {x} {back}");
            }
        }
        // Closer than the diagram can tell: straight.
        let edges = [Edge {
            a: Point2::new(-3.0, 0.0),
            b: Point2::new(3.0, 0.0),
        }];
        let focus = Generator::Vertex(Point2::new(0.0, 1e-5));
        assert!(Parabola::of(&edges, &[Generator::Edge(0), focus]).is_none());
    }
}

//! What stands on the machine before the job: parts, clamps, as points close enough to stand for their faces.

use headway_reach::Vector3;
use headway_reach::standing::Point;
use std::sync::Arc;

/// Distance of the points that stand for a face, mm, before there are too many.
const SPACING_MM: f64 = 0.5;
/// Most points: with more they stand farther apart, and each for more.
const POINTS_MAX: f64 = 1e6;

/// Points of what stands, machine coordinates.
#[derive(Clone, Default, PartialEq)]
pub struct Obstacles {
    /// Each for all within its half width.
    pub points: Arc<[Point]>,
    /// The triangles that they stand for, mm.
    pub triangles: Arc<[[Vector3; 3]]>,
}

/// How many there are: keys of caches are made of settings' text, and shadows are in them on their own.
impl std::fmt::Debug for Obstacles {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Obstacles({})", self.points.len())
    }
}

impl Obstacles {
    /// Of triangles, mm, machine coordinates. Each is divided until no point of a piece is farther from its middle than
    /// the half width: what a head touches of a face is a point or its edge.
    pub fn of(triangles: Vec<[Vector3; 3]>) -> Obstacles {
        let area_mm2: f64 = triangles.iter().map(area_mm2).sum();
        let around_mm: f64 = triangles.iter().map(around_mm).sum();
        let mut spacing_mm = SPACING_MM;
        let count = |spacing_mm: f64| {
            let across = area_mm2 / (spacing_mm * spacing_mm);
            triangles.len() as f64 + 4.0 * across + around_mm / spacing_mm
        };
        // A triangle takes a point however far apart they are.
        while count(spacing_mm) > POINTS_MAX + 2.0 * triangles.len() as f64 {
            spacing_mm *= 2.0;
        }
        let mut points = Vec::new();
        for triangle in &triangles {
            divide(triangle, spacing_mm, &mut points);
        }
        Obstacles {
            points: points.into(),
            triangles: triangles.into(),
        }
    }
}

fn area_mm2([a, b, c]: &[Vector3; 3]) -> f64 {
    0.5 * (b - a).cross(&(c - a)).norm()
}

fn around_mm([a, b, c]: &[Vector3; 3]) -> f64 {
    (b - a).norm() + (c - b).norm() + (a - c).norm()
}

/// Halves the longest edge until the piece is small: as often as its size against the spacing.
fn divide(triangle: &[Vector3; 3], spacing_mm: f64, points: &mut Vec<Point>) {
    let [a, b, c] = triangle;
    let across = (b - a).cross(&(c - a));
    // A triangle without ground stands for its edge.
    let normal = across.try_normalize(0.0).unwrap_or_else(Vector3::z);
    let mut waiting = vec![*triangle];
    while let Some(piece) = waiting.pop() {
        let edges = [0, 1, 2].map(|k| (piece[(k + 1) % 3] - piece[k]).norm());
        let longest = edges.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
        let longest = longest.map_or(0, |(k, _)| k);
        let middle = (piece[0] + piece[1] + piece[2]) / 3.0;
        if edges[longest] > spacing_mm {
            let [a, b, c] = [0, 1, 2].map(|k| piece[(longest + k) % 3]);
            let half = 0.5 * (a + b);
            waiting.push([a, half, c]);
            waiting.push([half, b, c]);
            continue;
        }
        let radii = piece.iter().map(|corner| (corner - middle).norm());
        points.push(Point {
            at_mm: middle,
            half_width_mm: radii.fold(0.0, f64::max),
            normal,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: points stand for all of a face, however thin or large it is. Method: places of triangles by their
    /// barycentric coordinates, each within some point's half width.
    #[test]
    fn points_cover_the_face() {
        let corner = |x: f64, y: f64, z: f64| Vector3::new(x, y, z);
        for triangle in [
            [
                corner(0.0, 0.0, 0.0),
                corner(3.0, 0.0, 1.0),
                corner(0.5, 2.0, 0.3),
            ],
            [
                corner(0.0, 0.0, 0.0),
                corner(9.0, 0.0, 0.0),
                corner(4.0, 1e-3, 0.0),
            ],
        ] {
            let obstacles = Obstacles::of(vec![triangle]);
            assert!(obstacles.points.len() < 200, "{}", obstacles.points.len());
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let [s, t] = [i, j].map(|k| f64::from(k) / 20.0);
                    let at = triangle[0] * (1.0 - s - t) + triangle[1] * s + triangle[2] * t;
                    let is_held =
                        |point: &Point| (point.at_mm - at).norm() <= point.half_width_mm + 1e-12;
                    assert!(obstacles.points.iter().any(is_held), "{at}");
                }
            }
        }
    }

    /// Goal: a table of 2 m takes no more points than allowed. Method: count them.
    #[test]
    fn large_faces_take_farther_points() {
        let [a, b, c] =
            [[0.0, 0.0], [2000.0, 0.0], [0.0, 2000.0]].map(|[x, y]| Vector3::new(x, y, 0.0));
        let count = Obstacles::of(vec![[a, b, c]]).points.len() as f64;
        assert!(count < POINTS_MAX && count > 0.02 * POINTS_MAX, "{count}");
    }
}

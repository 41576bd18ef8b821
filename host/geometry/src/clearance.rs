//! Clearance of a placed aperture inside a region: one query, no grid, no tolerance.
//!
//! For the ellipse: rotate by -heading, scale by (1/a, 1/b); the aperture is inside exactly when its centre
//! is and the scaled boundary is no closer than 1 to the origin (docs/design/heading-law.md). For slots,
//! rectangles and polygons the boundary is transformed into the tool's frame and its distance from the
//! shape found there ([`super::rounded_polygon`]); the gap is given as a share of b.

use super::aperture::{Aperture, Turn};
use super::edge_index::{Edge, EdgeIndex};
use super::polygon::Box2;
use super::rounded_polygon::{Gap, RoundedPolygon};
use super::{Point2, Vector2};

/// The aperture's centre and heading in the layer plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Configuration {
    /// Aperture centre.
    pub center: Point2,
    /// Heading phi: angle of the major axis against the x axis, counter-clockwise, unwrapped.
    pub heading_rad: f64,
}

/// A configuration with sine and cosine of its heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turned {
    /// Aperture centre.
    pub center: Point2,
    /// Its heading.
    pub turn: Turn,
}

impl From<Configuration> for Turned {
    #[inline]
    fn from(at: Configuration) -> Turned {
        Turned {
            center: at.center,
            turn: at.heading_rad.into(),
        }
    }
}

impl From<Turned> for Configuration {
    #[inline]
    fn from(at: Turned) -> Configuration {
        Configuration {
            center: at.center,
            heading_rad: at.turn.heading_rad,
        }
    }
}

/// Where a query finds the edges that a placement may meet.
pub trait EdgesNear {
    /// Calls `visit` with at least each edge that meets the area, possibly more than once.
    fn for_edges_near(&self, area: Box2, visit: impl FnMut(&Edge));
}

impl EdgesNear for EdgeIndex {
    #[inline]
    fn for_edges_near(&self, area: Box2, mut visit: impl FnMut(&Edge)) {
        self.for_edges_in(area, |number| visit(&self.edges()[number]));
    }
}

/// All edges that may be met by many placements near one point: in their order, in groups with a
/// bounding box.
#[derive(Clone, Debug)]
pub struct EdgesAbout {
    edges: Vec<Edge>,
    boxes: Vec<Box2>,
}

/// Edges in a row that share a box.
const EDGES_PER_BOX: usize = 8;

impl EdgesAbout {
    /// Of these edges; neighbours should be near each other.
    pub fn new(edges: Vec<Edge>) -> EdgesAbout {
        let about = |edges: &[Edge]| {
            let first = Box2::of(&[edges[0].a, edges[0].b]);
            edges.iter().fold(first, |around, edge| Box2 {
                min: around.min.inf(&edge.a).inf(&edge.b),
                max: around.max.sup(&edge.a).sup(&edge.b),
            })
        };
        EdgesAbout {
            boxes: edges.chunks(EDGES_PER_BOX).map(about).collect(),
            edges,
        }
    }
}

impl EdgesNear for EdgesAbout {
    #[inline]
    fn for_edges_near(&self, area: Box2, mut visit: impl FnMut(&Edge)) {
        for (around, edges) in self.boxes.iter().zip(self.edges.chunks(EDGES_PER_BOX)) {
            if around.meets(&area) {
                edges.iter().for_each(&mut visit);
            }
        }
    }
}

/// Scaled distance of the boundary from the aperture's centre: 1 is contact, more is clear, less
/// cuts (1 + gap / b for an aperture that is not an ellipse). `limit` bounds the search: anything
/// farther is returned as `limit`. The side of the centre is not checked.
pub fn scaled_clearance(
    aperture: &Aperture,
    at: Configuration,
    index: &EdgeIndex,
    limit: f64,
) -> f64 {
    match aperture {
        Aperture::Ellipse { major_mm, minor_mm } => {
            let axes_mm = [*major_mm, *minor_mm];
            nearest_scaled(axes_mm, at.into(), index, limit).map_or(limit, |q| q.norm())
        }
        Aperture::Rounded(shape) => {
            let limit_mm = (limit - 1.0) * aperture.minor_mm();
            nearest_gap(shape, at, index, limit_mm)
                .map_or(limit, |gap| scaled_of_gap(aperture, gap.gap_mm))
        }
    }
}

/// The scaled distance of a gap.
fn scaled_of_gap(aperture: &Aperture, gap_mm: f64) -> f64 {
    (1.0 + gap_mm / aperture.minor_mm()).max(0.0)
}

/// The wall that is closest to the shape or cuts it deepest, if its gap is below `limit_mm`; its
/// direction is in plane coordinates.
fn nearest_gap(
    shape: &RoundedPolygon,
    at: Configuration,
    walls: &(impl EdgesNear + ?Sized),
    limit_mm: f64,
) -> Option<Gap> {
    let (sin, cos) = at.heading_rad.sin_cos();
    let reach = |x: f64, y: f64| {
        // Support along a direction of the plane, brought into the tool's frame.
        shape.support_mm(Vector2::new(x * cos + y * sin, y * cos - x * sin)) + limit_mm.max(0.0)
    };
    let area = Box2 {
        min: at.center - Vector2::new(reach(-1.0, 0.0), reach(0.0, -1.0)),
        max: at.center + Vector2::new(reach(1.0, 0.0), reach(0.0, 1.0)),
    };
    let local = |p: Point2| {
        let d = p - at.center;
        Vector2::new(d.x * cos + d.y * sin, d.y * cos - d.x * sin)
    };
    let mut least_mm = limit_mm;
    let mut best: Option<Gap> = None;
    walls.for_edges_near(area, |edge| {
        if !edge.may_meet(&area) {
            return;
        }
        if let Some(gap) = shape.gap_to(local(edge.a), local(edge.b), least_mm)
            && gap.gap_mm < least_mm
        {
            least_mm = gap.gap_mm;
            best = Some(gap);
        }
    });
    best.map(|gap| Gap {
        gap_mm: gap.gap_mm,
        outward: Vector2::new(
            gap.outward.x * cos - gap.outward.y * sin,
            gap.outward.x * sin + gap.outward.y * cos,
        ),
    })
}

/// The boundary point nearest to the centre in the ellipse's scaled frame (in which it is the unit
/// circle), where it is nearer than `limit`.
#[inline]
fn nearest_scaled(
    axes_mm: [f64; 2],
    Turned { center, turn }: Turned,
    walls: &(impl EdgesNear + ?Sized),
    limit: f64,
) -> Option<Vector2> {
    let [major_mm, minor_mm] = axes_mm;
    let Turn { sin, cos, .. } = turn;
    let half = Vector2::new(
        ((major_mm * cos).powi(2) + (minor_mm * sin).powi(2)).sqrt(),
        ((major_mm * sin).powi(2) + (minor_mm * cos).powi(2)).sqrt(),
    ) * limit;
    let area = Box2 {
        min: center - half,
        max: center + half,
    };
    let scaled = |p: Point2| {
        let d = p - center;
        Vector2::new(
            (d.x * cos + d.y * sin) / major_mm,
            (d.y * cos - d.x * sin) / minor_mm,
        )
    };
    let mut best2 = limit * limit;
    let mut best = None;
    walls.for_edges_near(area, |edge| {
        if !edge.may_meet(&area) {
            return;
        }
        let (a, b) = (scaled(edge.a), scaled(edge.b));
        // Beyond the same side of the square about the disk: no part of it is near enough.
        let beyond = |p: f64, q: f64| (p > limit && q > limit) || (p < -limit && q < -limit);
        if beyond(a.x, b.x) || beyond(a.y, b.y) {
            return;
        }
        let q = nearest_to_origin(a, b);
        let distance2 = q.norm_squared();
        if distance2 < best2 {
            best2 = distance2;
            best = Some(q);
        }
    });
    best
}

/// True if the placed aperture is inside the region with the given slack (in aperture radii;
/// negative slack permits a cut of that share).
pub fn is_inside(aperture: &Aperture, at: Configuration, index: &EdgeIndex, slack: f64) -> bool {
    scaled_clearance(aperture, at, index, 1.0 + slack.max(0.0)) >= 1.0 + slack
        && index.contains(at.center)
}

/// Depth of the placed aperture outside the region, mm: the largest distance from a point of the
/// aperture outside to the boundary; 0 if it is inside.
///
/// Branch and bound on the fact that depth changes by at most the distance moved: first along the
/// outline, where the deepest point is unless the aperture completely contains something (a small
/// hole), then over the interior. Accuracy: `OUTLINE_ACCURACY` on the outline, `INSIDE_ACCURACY` in
/// the interior; for a depth certainly below `NEGLIGIBLE` its upper bound is returned.
pub fn outside_depth_mm(aperture: &Aperture, at: Configuration, index: &EdgeIndex) -> f64 {
    let bound_mm = outside_bound_mm(aperture, at, index);
    if bound_mm.is_infinite() {
        return deepest(aperture, at, |p| -index.signed_distance_mm(p));
    }
    if bound_mm <= NEGLIGIBLE * aperture.unit_mm() {
        return bound_mm;
    }
    let edges = edges_around(aperture, at, index, bound_mm);
    deepest(aperture, at, |p| depth_among(&edges, at.center, p))
}

/// What [`outside_depth_mm`] is certainly not above, at the cost of one query: 0 where the placed
/// aperture is inside, infinite where its centre is outside.
pub fn outside_bound_mm(aperture: &Aperture, at: Configuration, index: &EdgeIndex) -> f64 {
    if !index.contains(at.center) {
        return f64::INFINITY;
    }
    let clearance = scaled_clearance(aperture, at, index, 1.0);
    let bound_mm = match aperture {
        // Beyond a boundary point on the way from the centre lies at most this share of the way.
        Aperture::Ellipse { major_mm, .. } => (1.0 - clearance) * major_mm,
        // A boundary point at depth d leaves at least 1 - d / (inner radius) of the way to it.
        Aperture::Rounded(shape) => {
            let share = (1.0 - clearance) * aperture.minor_mm() / shape.axis_inside_mm();
            let share = if clearance > 0.0 { share.min(1.0) } else { 1.0 };
            share * shape.reach_mm()
        }
    };
    bound_mm.max(0.0)
}

/// Depths below this are not worth a search, of the aperture's unit.
const NEGLIGIBLE: f64 = 1e-5;
/// Absolute (of the unit) and relative accuracy of depths on the outline.
const OUTLINE_ACCURACY: (f64, f64) = (1e-5, 0.002);
/// Absolute (of the unit) and relative accuracy of depths inside the outline.
const INSIDE_ACCURACY: (f64, f64) = (5e-4, 0.05);
/// Bound on evaluations of one placement, far above the number in any test.
const LOOKS_MAX: usize = 100_000;

/// Edges that matter for depths up to `bound_mm`, each once.
fn edges_around(
    aperture: &Aperture,
    at: Configuration,
    index: &EdgeIndex,
    bound_mm: f64,
) -> Vec<Edge> {
    let reach = |x: f64, y: f64| aperture.support_mm(at.heading_rad, Vector2::new(x, y));
    let area = Box2 {
        min: at.center - Vector2::new(reach(-1.0, 0.0), reach(0.0, -1.0)),
        max: at.center + Vector2::new(reach(1.0, 0.0), reach(0.0, 1.0)),
    }
    .grown(bound_mm);
    let mut numbers = Vec::new();
    index.for_edges_in(area, |number| numbers.push(number));
    numbers.sort_unstable();
    numbers.dedup();
    numbers
        .into_iter()
        .map(|n| index.edges()[n])
        .filter(|e| e.may_meet(&area))
        .collect()
}

/// Distance from `p` to the nearest of the edges, negative if the path from `inside` (a point of
/// the region) to `p` ends inside.
fn depth_among(edges: &[Edge], inside: Point2, p: Point2) -> f64 {
    let way = p - inside;
    let (mut nearest, mut outside) = (f64::INFINITY, false);
    for edge in edges {
        nearest = nearest.min((edge.foot(p) - p).norm_squared());
        let side = |q: Point2| way.perp(&(q - inside)) > 0.0;
        let along = edge.b - edge.a;
        let beyond = |q: Point2| along.perp(&(q - edge.a)) > 0.0;
        outside ^= side(edge.a) != side(edge.b) && beyond(inside) != beyond(p);
    }
    if outside {
        nearest.sqrt()
    } else {
        -nearest.sqrt()
    }
}

/// The largest depth over the placed aperture, at least 0.
fn deepest(aperture: &Aperture, at: Configuration, depth_mm: impl Fn(Point2) -> f64) -> f64 {
    let (sin, cos) = at.heading_rad.sin_cos();
    let place = |q: Vector2| at.center + Vector2::new(q.x * cos - q.y * sin, q.x * sin + q.y * cos);
    let mut best = 0.0f64;
    let mut looks = 0;
    let unit_mm = aperture.unit_mm();
    let wanted = |best: f64, (least, share): (f64, f64)| best + (least * unit_mm).max(share * best);

    let (step, rate_mm) = (1.0 / OUTLINE_PIECES as f64, aperture.outline_rate_mm());
    let mut arcs: Vec<(f64, f64)> = (0..OUTLINE_PIECES)
        .map(|k| ((k as f64 + 0.5) * step, step / 2.0))
        .collect();
    while let Some((share, half)) = arcs.pop() {
        let depth = depth_mm(place(aperture.outline_at(share)));
        best = best.max(depth);
        looks += 1;
        if depth + rate_mm * half > wanted(best, OUTLINE_ACCURACY) && looks < LOOKS_MAX {
            arcs.extend([
                (share - half / 2.0, half / 2.0),
                (share + half / 2.0, half / 2.0),
            ]);
        }
    }
    looks = 0;
    let mut cells = vec![(Vector2::zeros(), aperture.reach_mm())];
    while let Some((middle, half)) = cells.pop() {
        let reach = half * std::f64::consts::SQRT_2;
        let off_mm = aperture.beyond_mm(middle);
        if off_mm > reach {
            continue;
        }
        let depth = depth_mm(place(middle));
        if off_mm <= 0.0 {
            best = best.max(depth);
        }
        looks += 1;
        if depth + reach > wanted(best, INSIDE_ACCURACY) && looks < LOOKS_MAX {
            let h = half / 2.0;
            for (x, y) in [(-h, -h), (h, -h), (-h, h), (h, h)] {
                cells.push((middle + Vector2::new(x, y), h));
            }
        }
    }
    best
}

/// First pieces of the outline.
const OUTLINE_PIECES: usize = 32;

/// The point of the edge a-b nearest to the origin.
fn nearest_to_origin(a: Vector2, b: Vector2) -> Vector2 {
    let d = b - a;
    let length2 = d.norm_squared();
    let t = if length2 > 0.0 {
        (-a.dot(&d) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    a + d * t
}

/// The deepest contact of a placed aperture with the boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallContact {
    /// Scaled distance: 1 is touching, less is cutting.
    pub scaled: f64,
    /// Unit vector from the centre side towards the wall: the aperture's own normal there.
    pub outward: Vector2,
    /// Distance by which the aperture must move back along `outward` to just touch, mm (exact for a
    /// straight wall, close for a vertex and an ellipse).
    pub depth_mm: f64,
}

/// The boundary point nearest to the centre in the aperture's scaled frame, if it is nearer than
/// `limit`.
pub fn contact(
    aperture: &Aperture,
    at: Configuration,
    walls: &(impl EdgesNear + ?Sized),
    limit: f64,
) -> Option<WallContact> {
    contact_turned(aperture, at.into(), walls, limit)
}

/// The same where sine and cosine of the heading are known.
pub fn contact_turned(
    aperture: &Aperture,
    at: Turned,
    walls: &(impl EdgesNear + ?Sized),
    limit: f64,
) -> Option<WallContact> {
    let (major_mm, minor_mm) = match aperture {
        Aperture::Ellipse { major_mm, minor_mm } => (*major_mm, *minor_mm),
        Aperture::Rounded(shape) => {
            let limit_mm = (limit - 1.0) * aperture.minor_mm();
            return nearest_gap(shape, at.into(), walls, limit_mm).map(|gap| WallContact {
                scaled: scaled_of_gap(aperture, gap.gap_mm),
                outward: gap.outward,
                depth_mm: -gap.gap_mm,
            });
        }
    };
    let q = nearest_scaled([major_mm, minor_mm], at, walls, limit)?;
    let distance = q.norm();
    if distance < 1e-9 {
        return Some(WallContact {
            scaled: 0.0,
            outward: Vector2::zeros(),
            depth_mm: minor_mm,
        });
    }
    let Turn { sin, cos, .. } = at.turn;
    // A normal of the unit circle maps back by the inverse transpose of the scaling.
    let (u, v) = (q.x / major_mm, q.y / minor_mm);
    let outward = Vector2::new(u * cos - v * sin, u * sin + v * cos).normalize();
    let extent = aperture.extent_mm(at.turn, outward);
    Some(WallContact {
        scaled: distance,
        outward,
        depth_mm: (1.0 - distance) * extent,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::{ELLIPSE, SQUARE, random_numbers, star, walls};

    fn at(x: f64, y: f64, heading_rad: f64) -> Configuration {
        Configuration {
            center: Point2::new(x, y),
            heading_rad,
        }
    }

    /// Goal: closed forms. Method: past a wall by the extent less the distance; past a corner to its
    /// vertex; a swallowed hole by its inscribed circle; contact and clear placements 0.
    #[test]
    fn known_depths() {
        let square = walls(&[SQUARE]);
        for heading in [0.0, 0.4, 1.1, 2.0] {
            let extent = ELLIPSE.extent_mm(heading, Vector2::y());
            for depth in [2e-4, 5e-3, 0.05, extent] {
                let found = outside_depth_mm(&ELLIPSE, at(5.0, extent - depth, heading), &square);
                assert!(
                    (found - depth).abs() < 1e-5 + 0.002 * depth,
                    "{found} {depth}"
                );
            }
            let contact = outside_depth_mm(&ELLIPSE, at(5.0, extent, heading), &square);
            assert!(contact < 1e-9, "{contact}");
            assert_eq!(
                outside_depth_mm(&ELLIPSE, at(5.0, extent + 1e-6, heading), &square),
                0.0
            );
        }
        let tip = (0.4f64.powi(2) + 0.0).sqrt();
        let found = outside_depth_mm(&ELLIPSE, at(10.0 - 0.2, 5.0, 0.0), &square);
        assert!((found - tip).abs() < 2e-3, "{found}");
        let hole: &[[f64; 2]] = &[[4.95, 5.05], [5.05, 5.05], [5.05, 4.95], [4.95, 4.95]];
        let holed = walls(&[SQUARE, hole]);
        for center in [[5.1, 5.0], [5.2, 5.02], [5.0, 5.0]] {
            let found = outside_depth_mm(&ELLIPSE, at(center[0], center[1], 0.1), &holed);
            assert!((found - 0.05).abs() < 0.003, "{found}");
        }
    }

    /// Goal: right on any shape. Method: random placements on a spiky star with a hole, against the
    /// depth of a dense grid of points of the aperture, which can only be less, and by no more than
    /// the grid's spacing.
    #[test]
    fn agrees_with_brute_force() {
        let mut random = random_numbers(11);
        let star = star(36, |_| 1.2 + 1.6 * random());
        let hole: &[[f64; 2]] = &[[0.1, 0.3], [0.4, -0.2], [-0.3, -0.1]];
        let star = walls(&[&star, hole]);
        let (mut outside, mut inside) = (0, 0);
        for _ in 0..300 {
            let (turn, far) = (std::f64::consts::TAU * random(), 2.2 * random());
            let placed = at(far * turn.cos(), far * turn.sin(), 3.0 * random());
            let mut brute = 0.0f64;
            let count = 60;
            for i in -count..=count {
                for j in -count..=count {
                    let (u, v) = (
                        f64::from(i) / f64::from(count),
                        f64::from(j) / f64::from(count),
                    );
                    if u * u + v * v > 1.0 {
                        continue;
                    }
                    let (sin, cos) = placed.heading_rad.sin_cos();
                    let (u, v) = (0.6 * u, 0.2 * v);
                    let p = placed.center + Vector2::new(u * cos - v * sin, u * sin + v * cos);
                    brute = brute.max(-star.signed_distance_mm(p));
                }
            }
            let found = outside_depth_mm(&ELLIPSE, placed, &star);
            let tolerance = 5e-4 + 0.05 * brute;
            assert!(found > brute - tolerance, "{found} {brute} {placed:?}");
            assert!(found < brute + 0.02, "{found} {brute} {placed:?}");
            outside += u32::from(brute > 1e-3);
            inside += u32::from(found == 0.0);
        }
        assert!(outside > 100 && inside > 5, "{outside} {inside}");
    }
}

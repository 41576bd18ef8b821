//! How well a placed aperture keeps inside a region: one query, no grid, no tolerance.
//!
//! For the ellipse: rotate by -heading, scale by (1/a, 1/b); the aperture is inside exactly when
//! its centre is and the scaled boundary comes no closer than 1 to the origin (SPEC section 2).

use super::aperture::Aperture;
use super::edge_index::EdgeIndex;
use super::polygon::Box2;
use super::{Point2, Vector2};

/// The aperture's centre and heading in the layer plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Configuration {
    /// Aperture centre.
    pub center: Point2,
    /// Heading phi: angle of the major axis against the x axis, counter-clockwise, unwrapped.
    pub heading_rad: f64,
}

/// Scaled distance of the boundary from the aperture's centre: 1 is contact, more is clear, less
/// cuts. `limit` bounds the search (in aperture radii): anything farther is reported as `limit`.
/// Says nothing of which side the centre is on.
pub fn scaled_clearance(
    aperture: &Aperture,
    at: Configuration,
    index: &EdgeIndex,
    limit: f64,
) -> f64 {
    let Aperture::Ellipse { major_mm, minor_mm } = *aperture;
    let (sin, cos) = at.heading_rad.sin_cos();
    let half = Vector2::new(
        ((major_mm * cos).powi(2) + (minor_mm * sin).powi(2)).sqrt(),
        ((major_mm * sin).powi(2) + (minor_mm * cos).powi(2)).sqrt(),
    ) * limit;
    let area = Box2 {
        min: at.center - half,
        max: at.center + half,
    };
    let scaled = |p: Point2| {
        let d = p - at.center;
        Vector2::new(
            (d.x * cos + d.y * sin) / major_mm,
            (d.y * cos - d.x * sin) / minor_mm,
        )
    };
    let mut best2 = limit * limit;
    index.for_edges_in(area, |number| {
        let edge = index.edges()[number];
        best2 = best2.min(origin_to_edge2(scaled(edge.a), scaled(edge.b)));
    });
    best2.sqrt()
}

/// True where the placed aperture lies inside the region with the given slack (in aperture radii;
/// negative slack allows a cut of that share).
pub fn is_inside(aperture: &Aperture, at: Configuration, index: &EdgeIndex, slack: f64) -> bool {
    scaled_clearance(aperture, at, index, 1.0 + slack.max(0.0)) >= 1.0 + slack
        && index.contains(at.center)
}

/// How far the placed aperture leaves the region, mm: the largest distance from an aperture point
/// outside to the boundary. Zero where it is inside. Found on the aperture's outline, which is
/// sampled at `OUTLINE_SAMPLES` points and refined around the worst one.
pub fn outside_depth_mm(aperture: &Aperture, at: Configuration, index: &EdgeIndex) -> f64 {
    if is_inside(aperture, at, index, 0.0) {
        return 0.0;
    }
    let depth = |angle: f64| {
        let Aperture::Ellipse { major_mm, minor_mm } = *aperture;
        let (sin, cos) = at.heading_rad.sin_cos();
        let (u, v) = (major_mm * angle.cos(), minor_mm * angle.sin());
        let p = at.center + Vector2::new(u * cos - v * sin, u * sin + v * cos);
        (-index.signed_distance_mm(p)).max(0.0)
    };
    let step = std::f64::consts::TAU / OUTLINE_SAMPLES as f64;
    let (mut worst_angle, mut worst) = (0.0, 0.0);
    for k in 0..OUTLINE_SAMPLES {
        let found = depth(k as f64 * step);
        if found > worst {
            (worst_angle, worst) = (k as f64 * step, found);
        }
    }
    let mut width = step;
    for _ in 0..REFINEMENTS {
        width /= 2.0;
        for angle in [worst_angle - width, worst_angle + width] {
            let found = depth(angle);
            if found > worst {
                (worst_angle, worst) = (angle, found);
            }
        }
    }
    worst
}

/// Samples of the outline: 0.08 mm apart on the default aperture, so that a spike thinner than
/// that can hide only where the whole aperture is cut, which the scaled clearance has seen.
const OUTLINE_SAMPLES: usize = 64;
/// Halvings around the worst sample: 0.08 mm down to 1 µm along the outline.
const REFINEMENTS: usize = 7;

fn origin_to_edge2(a: Vector2, b: Vector2) -> f64 {
    let d = b - a;
    let length2 = d.norm_squared();
    let t = if length2 > 0.0 {
        (-a.dot(&d) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (a + d * t).norm_squared()
}

/// The deepest contact of a placed aperture with the boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallContact {
    /// Scaled distance: 1 is touching, less is cutting.
    pub scaled: f64,
    /// Unit vector from the centre side towards the wall: the aperture's own normal there.
    pub outward: Vector2,
    /// How far the aperture must go back along `outward` for the contact to be touching, mm
    /// (exact for a straight wall, close for a vertex).
    pub depth_mm: f64,
}

/// The boundary point nearest to the centre in the aperture's scaled frame, where it is nearer
/// than `limit`.
pub fn contact(
    aperture: &Aperture,
    at: Configuration,
    index: &EdgeIndex,
    limit: f64,
) -> Option<WallContact> {
    let Aperture::Ellipse { major_mm, minor_mm } = *aperture;
    let (sin, cos) = at.heading_rad.sin_cos();
    let half = Vector2::new(
        ((major_mm * cos).powi(2) + (minor_mm * sin).powi(2)).sqrt(),
        ((major_mm * sin).powi(2) + (minor_mm * cos).powi(2)).sqrt(),
    ) * limit;
    let area = Box2 {
        min: at.center - half,
        max: at.center + half,
    };
    let scaled = |p: Point2| {
        let d = p - at.center;
        Vector2::new(
            (d.x * cos + d.y * sin) / major_mm,
            (d.y * cos - d.x * sin) / minor_mm,
        )
    };
    let mut best: Option<(f64, Vector2)> = None;
    index.for_edges_in(area, |number| {
        let edge = index.edges()[number];
        let (a, b) = (scaled(edge.a), scaled(edge.b));
        let d = b - a;
        let length2 = d.norm_squared();
        let t = if length2 > 0.0 {
            (-a.dot(&d) / length2).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let q = a + d * t;
        let distance2 = q.norm_squared();
        if distance2 < limit * limit && best.is_none_or(|(found, _)| distance2 < found) {
            best = Some((distance2, q));
        }
    });
    let (distance2, q) = best?;
    let distance = distance2.sqrt();
    if distance < 1e-9 {
        return Some(WallContact {
            scaled: 0.0,
            outward: Vector2::zeros(),
            depth_mm: minor_mm,
        });
    }
    // A normal of the unit circle maps back by the inverse transpose of the scaling.
    let (u, v) = (q.x / major_mm, q.y / minor_mm);
    let outward = Vector2::new(u * cos - v * sin, u * sin + v * cos).normalize();
    let extent = aperture.extent_mm(at.heading_rad, outward);
    Some(WallContact {
        scaled: distance,
        outward,
        depth_mm: (1.0 - distance) * extent,
    })
}

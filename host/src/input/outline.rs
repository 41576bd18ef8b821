//! Rings as drawn -> valid regions in mm: the common end of all input formats.
//!
//! Cleans (repeated points), measures (finite, size, count), nests (by the format's order or by
//! the SVG fill rule), orients (exterior counter-clockwise), and asks whether the result is valid
//! in the sense of OGC simple features. Coordinates are never changed beyond unit and scale.

use super::error::At;
use super::{InputError, Loaded, POINTS_MAX, ReadOptions, Target};
use crate::geometry::Point2;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::{Box2, Region, Ring};

/// Largest outline, mm: twice the largest printer there is.
pub const SIZE_MAX_MM: f64 = 100_000.0;
/// Smallest outline, mm: a tenth of the smallest aperture that is taken.
pub const SIZE_MIN_MM: f64 = 0.001;
/// Farthest coordinate, mm: 1e7 mm still leaves 2e-9 mm of an f64.
pub const FAR_MAX_MM: f64 = 1.0e7;
/// Ends of a contour closer than this are the same point, mm: rounding of drawing programs.
const CLOSED_MM: f64 = 1.0e-4;

/// What a format's reader makes of a file: mm, but for `--scale`.
pub(super) struct Drawing {
    pub name: Option<String>,
    pub shapes: Vec<Shape>,
    pub notes: Vec<String>,
}

/// Rings that belong together.
pub(super) struct Shape {
    /// For messages: `feature 3`, `shape 2 (id 'gear')`.
    pub what: String,
    pub rings: Vec<RawRing>,
    pub rule: Rule,
}

/// A contour as drawn.
pub(super) struct RawRing {
    /// For messages: `hole 2`.
    pub what: String,
    pub points: Vec<Point2>,
    /// Closed by the format; otherwise its ends must meet.
    pub closed: bool,
}

/// Which side of the rings is inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rule {
    /// The first ring is the exterior, the others are its holes.
    ExteriorFirst,
    /// Where the winding number is not 0.
    NonZero,
    /// Where the winding number is odd.
    EvenOdd,
}

/// A cleaned ring with its name for messages.
struct NamedRing {
    what: String,
    ring: Ring,
}

/// Builds the target, or says what is wrong with the drawing.
pub(super) fn to_target(
    mut drawing: Drawing,
    name: &str,
    options: &ReadOptions,
) -> Result<Loaded, InputError> {
    let points = drawing
        .shapes
        .iter()
        .flat_map(|shape| &shape.rings)
        .map(|ring| ring.points.len())
        .sum();
    if points > POINTS_MAX {
        return Err(InputError::TooManyPoints { points });
    }
    for shape in &mut drawing.shapes {
        scale_and_check_points(shape, options.scale)?;
    }
    check_size(&drawing)?;
    let mut notes = std::mem::take(&mut drawing.notes);
    let mut regions: Vec<(String, Region)> = Vec::new();
    for shape in drawing.shapes {
        let rings = clean(shape.rings, options.repair, &mut notes)?;
        match shape.rule {
            Rule::ExteriorFirst => {
                if let Some(region) = exterior_first(rings, &mut notes) {
                    regions.push((shape.what, region));
                }
            }
            rule => nest(&shape.what, rings, rule, &mut notes, &mut regions),
        }
    }
    if regions.is_empty() {
        return Err(InputError::Empty {
            hint: "it must hold at least one closed, filled contour",
        });
    }
    let regions = validity::settle(regions, options, &mut notes)?;
    Ok(Loaded {
        target: Target {
            name: drawing.name.unwrap_or_else(|| name.to_string()),
            regions,
        },
        notes,
    })
}

fn scale_and_check_points(shape: &mut Shape, scale: f64) -> Result<(), InputError> {
    for ring in &mut shape.rings {
        for (number, point) in ring.points.iter_mut().enumerate() {
            *point *= scale;
            if !(point.x.is_finite() && point.y.is_finite()) {
                return Err(InputError::BadPoint {
                    ring: ring.what.clone(),
                    point: number,
                    problem: format!("[{}, {}] after unit and scale", point.x, point.y),
                });
            }
            if point.x.abs().max(point.y.abs()) > FAR_MAX_MM {
                return Err(InputError::TooFar {
                    at: At(*point),
                    max_mm: FAR_MAX_MM,
                });
            }
        }
    }
    Ok(())
}

fn check_size(drawing: &Drawing) -> Result<(), InputError> {
    let all: Vec<Point2> = drawing
        .shapes
        .iter()
        .flat_map(|shape| &shape.rings)
        .flat_map(|ring| ring.points.iter().copied())
        .collect();
    if all.is_empty() {
        return Err(InputError::Empty {
            hint: "it holds no points",
        });
    }
    let size = Box2::of(&all).size();
    if size.x.max(size.y) > SIZE_MAX_MM {
        return Err(InputError::TooBig {
            width_mm: size.x,
            height_mm: size.y,
            max_mm: SIZE_MAX_MM,
        });
    }
    if size.x.max(size.y) < SIZE_MIN_MM {
        return Err(InputError::TooSmall {
            width_mm: size.x,
            height_mm: size.y,
            min_mm: SIZE_MIN_MM,
        });
    }
    Ok(())
}

/// Drops repeated points, refuses open contours and such without area.
fn clean(
    rings: Vec<RawRing>,
    repair: bool,
    notes: &mut Vec<String>,
) -> Result<Vec<NamedRing>, InputError> {
    let mut cleaned = Vec::with_capacity(rings.len());
    for RawRing {
        what,
        mut points,
        closed,
    } in rings
    {
        let (Some(&start), Some(&end)) = (points.first(), points.last()) else {
            return Err(InputError::TooFewPoints {
                ring: what,
                at: At(Point2::origin()),
                distinct: 0,
            });
        };
        let gap_mm = (end - start).norm();
        if !closed && gap_mm > CLOSED_MM {
            if !repair {
                return Err(InputError::Open {
                    ring: what,
                    start: At(start),
                    end: At(end),
                    gap_mm,
                });
            }
            notes.push(format!(
                "repaired: {what} was open by {gap_mm:.4} mm at {}, its ends are joined",
                At(end)
            ));
        }
        points.dedup();
        let meets = |end: &Point2| *end == start || (!closed && (end - start).norm() <= CLOSED_MM);
        while points.len() > 1 && points.last().is_some_and(meets) {
            points.pop();
        }
        let ring = Ring { points };
        if ring.points.len() < 3 {
            return Err(InputError::TooFewPoints {
                ring: what,
                at: At(start),
                distinct: ring.points.len(),
            });
        }
        // Rounding of the area is about 1e-16 of the box; a part in 1e12 is no area.
        let size = Box2::of(&ring.points).size();
        if ring.signed_area_mm2().abs() <= 1e-12 * size.norm_squared() && is_flat(&ring) {
            return Err(InputError::NoArea {
                ring: what,
                at: At(start),
            });
        }
        cleaned.push(NamedRing { what, ring });
    }
    Ok(cleaned)
}

/// True where all points lie on one line (a figure of eight has no net area, but is not flat).
fn is_flat(ring: &Ring) -> bool {
    let first = ring.points[0];
    let far =
        ring.points
            .iter()
            .map(|p| p - first)
            .fold(crate::geometry::Vector2::zeros(), |best, d| {
                if d.norm_squared() > best.norm_squared() {
                    d
                } else {
                    best
                }
            });
    ring.points
        .iter()
        .all(|p| (p - first).perp(&far).abs() <= 1e-9 * far.norm_squared())
}

fn exterior_first(rings: Vec<NamedRing>, notes: &mut Vec<String>) -> Option<Region> {
    let mut rings = rings.into_iter();
    let mut exterior = rings.next()?;
    if turn(&mut exterior.ring, true) {
        notes.push(format!("{} was clockwise; turned", exterior.what));
    }
    let mut turned = 0;
    let holes = rings
        .map(|mut hole| {
            turned += usize::from(turn(&mut hole.ring, false));
            hole.ring
        })
        .collect();
    if turned > 0 {
        notes.push(format!("{turned} holes were counter-clockwise; turned"));
    }
    Some(Region {
        exterior: exterior.ring,
        holes,
    })
}

/// Makes the ring counter-clockwise (or clockwise); true where it was not.
fn turn(ring: &mut Ring, counter_clockwise: bool) -> bool {
    let wrong = (ring.signed_area_mm2() > 0.0) != counter_clockwise;
    if wrong {
        ring.points.reverse();
    }
    wrong
}

/// Sorts a shape's rings into exteriors and holes by its fill rule. A ring with the same on both
/// sides bounds nothing and is dropped. Sound for rings that do not cross; crossing ones come out
/// as something that the validity test refuses.
fn nest(
    what: &str,
    rings: Vec<NamedRing>,
    rule: Rule,
    notes: &mut Vec<String>,
    regions: &mut Vec<(String, Region)>,
) {
    let filled = |winding: i32| match rule {
        Rule::EvenOdd => winding % 2 != 0,
        _ => winding != 0,
    };
    let mut exteriors: Vec<(NamedRing, Vec<Ring>)> = Vec::new();
    let mut holes: Vec<NamedRing> = Vec::new();
    let windings: Vec<i32> = (0..rings.len())
        .map(|k| winding_around(&rings, k))
        .collect();
    let mut dropped = 0;
    for (mut named, outside) in rings.into_iter().zip(windings) {
        let own = if named.ring.signed_area_mm2() > 0.0 {
            1
        } else {
            -1
        };
        match (filled(outside), filled(outside + own)) {
            (false, true) => {
                turn(&mut named.ring, true);
                exteriors.push((named, Vec::new()));
            }
            (true, false) => {
                turn(&mut named.ring, false);
                holes.push(named);
            }
            _ => dropped += 1,
        }
    }
    if dropped > 0 {
        notes.push(format!(
            "{what}: {dropped} contours lie inside filled ground by the fill rule and bound nothing"
        ));
    }
    for hole in holes {
        let inside = representative(&hole.ring);
        let home = exteriors
            .iter_mut()
            .filter(|(exterior, _)| winding(&exterior.ring, inside) != 0)
            .min_by(|(a, _), (b, _)| {
                a.ring
                    .signed_area_mm2()
                    .total_cmp(&b.ring.signed_area_mm2())
            });
        match home {
            Some((_, its_holes)) => its_holes.push(hole.ring),
            None => notes.push(format!("{} is a hole in nothing; left out", hole.what)),
        }
    }
    let many = exteriors.len() > 1;
    for (exterior, holes) in exteriors {
        let name = if many {
            exterior.what
        } else {
            what.to_string()
        };
        regions.push((
            name,
            Region {
                exterior: exterior.ring,
                holes,
            },
        ));
    }
}

/// Winding number that all rings but the k-th make at the k-th.
fn winding_around(rings: &[NamedRing], k: usize) -> i32 {
    let place = representative(&rings[k].ring);
    rings
        .iter()
        .enumerate()
        .filter(|&(other, _)| other != k)
        .map(|(_, named)| winding(&named.ring, place))
        .sum()
}

/// A point on the ring that other rings hardly touch: the middle of its longest edge.
fn representative(ring: &Ring) -> Point2 {
    let mut best = (0.0, ring.points[0]);
    for (a, b) in ring.edges() {
        let length = (b - a).norm_squared();
        if length > best.0 {
            best = (length, nalgebra::center(&a, &b));
        }
    }
    best.1
}

fn winding(ring: &Ring, p: Point2) -> i32 {
    ring.edges()
        .filter(|&(a, b)| crate::geometry::polygon::crosses_ray(a, b, p))
        .map(|(a, b)| if b.y > a.y { 1 } else { -1 })
        .sum()
}

mod validity {
    //! Validity of the regions, one by one and together.
    use super::*;

    /// Refuses what is not valid.
    pub(super) fn settle(
        regions: Vec<(String, Region)>,
        _options: &ReadOptions,
        _notes: &mut [String],
    ) -> Result<Vec<Region>, InputError> {
        for (number, (first, region)) in regions.iter().enumerate() {
            for (second, other) in &regions[number + 1..] {
                if let Some(at) = shared_place(region, other) {
                    return Err(InputError::Overlap {
                        first: first.clone(),
                        second: second.clone(),
                        at: At(at),
                    });
                }
            }
        }
        Ok(regions.into_iter().map(|(_, region)| region).collect())
    }

    /// A place where the insides of two valid regions meet; `None` where they are apart or only
    /// touch in points.
    fn shared_place(one: &Region, other: &Region) -> Option<Point2> {
        let (a, b) = (one.bounds(), other.bounds());
        let apart =
            a.max.x < b.min.x || b.max.x < a.min.x || a.max.y < b.min.y || b.max.y < a.min.y;
        if apart {
            return None;
        }
        let cell_mm = (b.size().x + b.size().y) / 200.0;
        let index = EdgeIndex::of_region(other, cell_mm);
        for (start, end) in one.edges() {
            let mut found: Option<Point2> = None;
            index.for_edges_in(Box2::of(&[start, end]), |number| {
                if found.is_none() {
                    found = crossing(start, end, index.edges()[number]);
                }
            });
            if found.is_some() {
                return found;
            }
        }
        let inside = |region: &Region, p: Point2| region.contains(p).then_some(p);
        inside(other, representative(&one.exterior))
            .or_else(|| inside(one, representative(&other.exterior)))
    }

    /// Where two edges cross inside both, or run along each other.
    fn crossing(a: Point2, b: Point2, edge: Edge) -> Option<Point2> {
        let (u, v, w) = (b - a, edge.b - edge.a, edge.a - a);
        let cross = u.perp(&v);
        let size = u.norm() * v.norm();
        if cross.abs() > 1e-12 * size {
            let s = w.perp(&v) / cross;
            let t = w.perp(&u) / cross;
            let inner = |x: f64| x > 1e-12 && x < 1.0 - 1e-12;
            return (inner(s) && inner(t)).then(|| a + u * s);
        }
        if w.perp(&u).abs() > 1e-12 * u.norm() * (u.norm() + w.norm()) {
            return None;
        }
        // On one line: the overlap of their spans along u.
        let along = |p: Point2| (p - a).dot(&u) / u.norm_squared();
        let (s0, s1) = (along(edge.a), along(edge.b));
        let (low, high) = (s0.min(s1).max(0.0), s0.max(s1).min(1.0));
        (high - low > 1e-12).then(|| a + u * ((low + high) / 2.0))
    }
}

//! Rings as drawn -> valid regions in mm: the last stage of all input formats.
//!
//! Cleans (repeated points), measures (finite, size, count), nests (by the format's order or by the
//! SVG fill rule), orients (exterior counter-clockwise), and checks whether the result is valid in
//! the sense of OGC simple features. Coordinates are never changed beyond unit and scale.

use super::error::At;
use super::names::name_of;
use super::settle::{self, NamedRegion};
use super::{Loaded, POINTS_MAX, ReadOptions, Target};
use crate::geometry::Point2;
use crate::geometry::edge_index::Edge;
use crate::geometry::polygon::{Box2, Region, Ring};
use crate::geometry::repair::FillRule;
use crate::geometry::tangle::crossings_about;
use crate::input::error;
use crate::text::refusal::{Refusal, refusal};

/// Largest outline, mm: twice the largest printer there is.
pub const SIZE_MAX_MM: f64 = 100_000.0;
/// Smallest outline, mm: a tenth of the smallest accepted aperture.
pub const SIZE_MIN_MM: f64 = 0.001;
/// Farthest coordinate, mm: 1e7 mm still leaves 2e-9 mm of an f64.
pub const FAR_MAX_MM: f64 = 1.0e7;
/// Ends of a contour closer than this are the same point, mm: rounding of drawing programs.
pub(super) const CLOSED_MM: f64 = 1.0e-4;

/// Maximum number of crossings of an outline that are found, or repaired: 3,000 points at random make
/// a million.
const CROSSINGS_MAX: f64 = 3e6;

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
    /// Of its fill, where the format has one: shapes of two colours are not seen as one.
    pub colour: Option<String>,
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
pub(super) struct NamedRing {
    pub what: String,
    pub ring: Ring,
}

/// Polygons, each an exterior and its holes, as a drawing.
pub(super) fn of_polygons(polygons: &[Vec<Vec<[f64; 2]>>]) -> Drawing {
    let ring = |(polygon, number): (usize, usize), points: &[[f64; 2]]| RawRing {
        what: match number {
            0 => format!("the exterior of polygon {polygon}"),
            _ => format!("hole {} of polygon {polygon}", number - 1),
        },
        points: points.iter().map(|[x, y]| Point2::new(*x, *y)).collect(),
        closed: true,
    };
    let shapes = polygons.iter().enumerate().map(|(polygon, rings)| Shape {
        what: format!("polygon {polygon}"),
        rings: rings
            .iter()
            .enumerate()
            .map(|(number, points)| ring((polygon, number), points))
            .collect(),
        rule: Rule::ExteriorFirst,
        colour: None,
    });
    Drawing {
        name: None,
        shapes: shapes.collect(),
        notes: Vec::new(),
    }
}

/// Builds the target, or reports the defect of the drawing.
pub(super) fn to_target(
    mut drawing: Drawing,
    name: &str,
    options: &ReadOptions,
) -> Result<Loaded, Refusal> {
    scale_and_check(&mut drawing, options.scale)?;
    check_tangle(&drawing)?;
    let mut notes = std::mem::take(&mut drawing.notes);
    let mut regions: Vec<NamedRegion> = Vec::new();
    for shape in drawing.shapes {
        let rings = clean(shape.rings, options.repair, &mut notes)?;
        let found = match shape.rule {
            Rule::ExteriorFirst => settle::exterior_first(&shape.what, rings, options, &mut notes)?,
            Rule::NonZero => {
                settle::by_fill_rule(&shape.what, rings, FillRule::NonZero, options, &mut notes)?
            }
            Rule::EvenOdd => {
                settle::by_fill_rule(&shape.what, rings, FillRule::EvenOdd, options, &mut notes)?
            }
        };
        let colour = &shape.colour;
        regions.extend(found.into_iter().map(|region| NamedRegion {
            colour: colour.clone(),
            ..region
        }));
    }
    if regions.is_empty() {
        return Err(error::empty(
            "it must hold at least one closed, filled contour",
        ));
    }
    let regions = settle::together(regions, options, &mut notes)?;
    let rings = regions.iter().flat_map(Region::rings);
    let points = rings.map(|ring| ring.points.len()).sum();
    if points > POINTS_MAX {
        return Err(error::too_many_points(points));
    }
    Ok(Loaded {
        target: Target {
            name: name_of(drawing.name.as_deref(), name, "part"),
            regions,
        },
        notes,
        may_be_lines: false,
    })
}

/// Scales a drawing; refuses what is too large, or too many points.
pub(super) fn scale_and_check(drawing: &mut Drawing, scale: f64) -> Result<(), Refusal> {
    let points = drawing
        .shapes
        .iter()
        .flat_map(|shape| &shape.rings)
        .map(|ring| ring.points.len())
        .sum();
    if points > POINTS_MAX {
        return Err(error::too_many_points(points));
    }
    for shape in &mut drawing.shapes {
        scale_and_check_points(shape, scale)?;
    }
    check_size(drawing)
}

fn scale_and_check_points(shape: &mut Shape, scale: f64) -> Result<(), Refusal> {
    for ring in &mut shape.rings {
        for (number, point) in ring.points.iter_mut().enumerate() {
            *point *= scale;
            if !(point.x.is_finite() && point.y.is_finite()) {
                return Err(error::bad_point(
                    &ring.what,
                    number,
                    &format!("[{}, {}] after unit and scale", point.x, point.y),
                ));
            }
            if point.x.abs().max(point.y.abs()) > FAR_MAX_MM {
                return Err(error::too_far(At(*point), FAR_MAX_MM));
            }
        }
    }
    Ok(())
}

fn check_size(drawing: &Drawing) -> Result<(), Refusal> {
    let all: Vec<Point2> = drawing
        .shapes
        .iter()
        .flat_map(|shape| &shape.rings)
        .flat_map(|ring| ring.points.iter().copied())
        .collect();
    if all.is_empty() {
        return Err(error::empty("it holds no points"));
    }
    let size = Box2::of(&all).size();
    if size.x.max(size.y) > SIZE_MAX_MM {
        return Err(refusal!(
            "the outline is {width_mm:.6} x {height_mm:.6} mm, larger than {SIZE_MAX_MM} mm: \
             check its units (--units) or give --scale",
            width_mm = size.x,
            height_mm = size.y
        ));
    }
    if size.x.max(size.y) < SIZE_MIN_MM {
        return Err(refusal!(
            "the outline is {width_mm:.9} x {height_mm:.9} mm, smaller than {SIZE_MIN_MM} mm: \
             check its units (--units) or give --scale",
            width_mm = size.x,
            height_mm = size.y
        ));
    }
    Ok(())
}

/// Refuses a scribble, which crosses itself as often as its number of points squared.
fn check_tangle(drawing: &Drawing) -> Result<(), Refusal> {
    let rings = drawing.shapes.iter().flat_map(|shape| &shape.rings);
    let edges = rings.flat_map(|ring| {
        let pairs = ring.points.windows(2);
        pairs.map(|pair| Edge {
            a: pair[0],
            b: pair[1],
        })
    });
    let edges: Vec<Edge> = edges.collect();
    let crossings = crossings_about(&edges);
    match crossings > CROSSINGS_MAX {
        true => Err(refusal!(
            "the contours cross themselves and each other about {crossings:.0} times: this is \
             no outline, and too much to mend; draw what is to be filled, or fewer points"
        )),
        false => Ok(()),
    }
}

/// Drops repeated points, refuses open contours and such without area.
fn clean(
    rings: Vec<RawRing>,
    repair: bool,
    notes: &mut Vec<String>,
) -> Result<Vec<NamedRing>, Refusal> {
    let mut cleaned = Vec::with_capacity(rings.len());
    for RawRing {
        what,
        mut points,
        closed,
    } in rings
    {
        let (Some(&start), Some(&end)) = (points.first(), points.last()) else {
            return Err(error::too_few_points(&what, At(Point2::origin()), 0));
        };
        let gap_mm = (end - start).norm();
        if !closed && gap_mm > CLOSED_MM {
            if !repair {
                return Err(refusal!(
                    "{what} is open: it starts at {start} and ends {gap_mm:.4} mm away at \
                     {end}; close it in the drawing, let --repair join the ends, or print lines \
                     as beads with --centre-lines",
                    start = At(start),
                    end = At(end)
                ));
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
            return Err(error::too_few_points(&what, At(start), ring.points.len()));
        }
        // Rounding of the area is about 1e-16 of the box; a part in 1e12 is no area.
        let size = Box2::of(&ring.points).size();
        if ring.signed_area_mm2().abs() <= 1e-12 * size.norm_squared() && is_flat(&ring) {
            return Err(refusal!(
                "{what} near {at} encloses no area (its points are on a line): remove it",
                at = At(start)
            ));
        }
        cleaned.push(NamedRing { what, ring });
    }
    Ok(cleaned)
}

/// True if all points are on one line (a figure of eight has no net area, but is not flat).
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

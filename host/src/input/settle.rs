//! Cleaned rings -> valid, oriented regions; or their defect; or, on request, repaired ones.
//!
//! Either the format names the exterior (JSON), or a fill rule decides (SVG). In both cases, rings
//! that cross are found before their nesting is evaluated. Repair follows the fill rule: SVG shapes
//! by their own; named rings by "inside the exterior and outside the holes" (each ring by the
//! non-zero rule), overlapping parts by their union.

use super::ReadOptions;
use super::error::At;
use super::outline::NamedRing;
use crate::geometry::Point2;
use crate::geometry::polygon::{Box2, Region, Ring, crosses_ray};
use crate::geometry::repair::{FillRule, RepairChanges, repair};
use crate::geometry::validity::{RingName, ValidityError, validate, validate_all, validate_apart};
use crate::input::error;
use crate::text::refusal::{Refusal, refusal};

/// A region with its name for messages.
pub(super) struct NamedRegion {
    pub what: String,
    pub region: Region,
    /// It has been found valid by itself.
    pub is_valid: bool,
    /// Colour of its fill, where the format has one.
    pub colour: Option<String>,
}

/// The first ring is the exterior, the others are its holes.
pub(super) fn exterior_first(
    what: &str,
    rings: Vec<NamedRing>,
    options: &ReadOptions,
    notes: &mut Vec<String>,
) -> Result<Vec<NamedRegion>, Refusal> {
    let mut rings = rings.into_iter();
    let Some(mut exterior) = rings.next() else {
        return Ok(Vec::new());
    };
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
    let region = Region {
        exterior: exterior.ring,
        holes,
    };
    let found = validate(&region);
    let is_valid = found.is_ok();
    let regions = match found {
        Ok(()) => vec![region],
        Err(problem) if options.repair => {
            let mended = exterior_without_holes(&region);
            notes.push(repair_note(
                what,
                &problem,
                std::slice::from_ref(&region),
                &mended,
            ));
            mended
        }
        Err(problem) => {
            return Err(error::invalid(what, problem));
        }
    };
    Ok(named(what, regions, is_valid))
}

/// The fill rule decides which rings are exteriors and which are holes.
pub(super) fn by_fill_rule(
    what: &str,
    rings: Vec<NamedRing>,
    rule: FillRule,
    options: &ReadOptions,
    notes: &mut Vec<String>,
) -> Result<Vec<NamedRegion>, Refusal> {
    let Some(problem) = crossing(&rings) else {
        return Ok(nest(what, rings, rule, notes));
    };
    if !options.repair {
        return Err(error::invalid(&ring_names(what, &rings, &problem), problem));
    }
    let mut drawn = rings.into_iter().map(|named| named.ring);
    let Some(exterior) = drawn.next() else {
        return Ok(Vec::new());
    };
    let drawn = [Region {
        exterior,
        holes: drawn.collect(),
    }];
    let (mended, _) = repair(&drawn, rule);
    notes.push(repair_note(what, &problem, &drawn, &mended));
    Ok(named(what, mended, false))
}

/// All regions of the drawing: separate, or merged on request.
pub(super) fn together(
    regions: Vec<NamedRegion>,
    options: &ReadOptions,
    notes: &mut Vec<String>,
) -> Result<Vec<Region>, Refusal> {
    let names: Vec<String> = regions.iter().map(|r| r.what.clone()).collect();
    let colours: Vec<Option<String>> = regions.iter().map(|r| r.colour.clone()).collect();
    let are_valid = regions.iter().all(|r| r.is_valid);
    let regions: Vec<Region> = regions.into_iter().map(|r| r.region).collect();
    let found = if are_valid {
        validate_apart(&regions)
    } else {
        validate_all(&regions)
    };
    let Err(problem) = found else {
        return Ok(regions);
    };
    if !options.repair {
        return Err(match problem {
            ValidityError::RegionsOverlap {
                first,
                second,
                at_mm: [x, y],
            } => overlap([first, second], [x, y], &names, &colours),
            problem => error::invalid("the drawing", problem),
        });
    }
    let (mended, changes) = repair(&regions, FillRule::NonZero);
    let what = "the drawing";
    if let RepairChanges {
        fault: Some(fault), ..
    } = &changes
    {
        notes.push(repair_note(what, fault, &regions, &mended));
    }
    match validate_all(&mended) {
        Ok(()) if mended.is_empty() => Err(error::empty("the repair left nothing")),
        Ok(()) => Ok(mended),
        Err(problem) => Err(error::invalid("the drawing after --repair", problem)),
    }
}

/// The refusal of an overlap: a union shows what is drawn only where both have the same colour.
fn overlap(
    [first, second]: [usize; 2],
    [x, y]: [f64; 2],
    names: &[String],
    colours: &[Option<String>],
) -> Refusal {
    let at = At(Point2::new(x, y));
    let [under, over] = [first.min(second), first.max(second)];
    match (&colours[under], &colours[over]) {
        (Some(below), Some(above)) if below != above => refusal!(
            "{over} lies on {under} near {at}: delete the one that is no part (a background), \
             or, where one is meant as a hole, cut it out in the drawing program (Inkscape: \
             Path, Difference)",
            under = format!("{} ({below})", names[under]),
            over = format!("{} ({above})", names[over])
        ),
        _ => refusal!(
            "{first} and {second} overlap near {at}; move them apart, let --repair merge them, \
             or, where one is meant as a hole, cut it out in the drawing program (Inkscape: \
             Path, Difference)",
            first = names[first],
            second = names[second]
        ),
    }
}

/// What the exterior fills less what the holes fill, each by the non-zero rule.
fn exterior_without_holes(region: &Region) -> Vec<Region> {
    let alone = |ring: &Ring| Region {
        exterior: ring.clone(),
        holes: Vec::new(),
    };
    let (exteriors, _) = repair(&[alone(&region.exterior)], FillRule::NonZero);
    let mut holes: Vec<Region> = region.holes.iter().map(alone).collect();
    for hole in &mut holes {
        turn(&mut hole.exterior, true);
    }
    let (holes, _) = repair(&holes, FillRule::NonZero);
    // Inside is where the winding number is 1: clockwise hole rings take one turn off.
    let mut rings: Vec<Ring> = exteriors
        .into_iter()
        .flat_map(|r| std::iter::once(r.exterior).chain(r.holes))
        .collect();
    rings.extend(holes.into_iter().flat_map(|hole| {
        let rings = std::iter::once(hole.exterior).chain(hole.holes);
        rings.map(|mut ring| {
            ring.points.reverse();
            ring
        })
    }));
    let mut rings = rings.into_iter();
    let Some(exterior) = rings.next() else {
        return Vec::new();
    };
    let drawn = [Region {
        exterior,
        holes: rings.collect(),
    }];
    repair(&drawn, FillRule::Positive).0
}

fn repair_note(what: &str, fault: &ValidityError, before: &[Region], after: &[Region]) -> String {
    let area = |regions: &[Region]| regions.iter().map(Region::area_mm2).sum::<f64>();
    let rings = |regions: &[Region]| regions.iter().map(|r| r.holes.len() + 1).sum::<usize>();
    format!(
        "repaired {what} ({}): {} contours of {:.4} mm² became {} of {:.4} mm²",
        fault.to_string().split(';').next().unwrap_or_default(),
        rings(before),
        area(before),
        rings(after),
        area(after),
    )
}

/// The first crossing or touch that makes the rings no set of simple, separate rings; nesting is
/// no fault here.
fn crossing(rings: &[NamedRing]) -> Option<ValidityError> {
    let points: Vec<Point2> = rings
        .iter()
        .flat_map(|named| named.ring.points.iter().copied())
        .collect();
    let bounds = Box2::of(&points);
    let Box2 { min, max } = bounds.grown(1.0 + 0.1 * bounds.size().norm());
    let frame = [
        (min.x, min.y),
        (max.x, min.y),
        (max.x, max.y),
        (min.x, max.y),
    ];
    let as_holes = Region {
        exterior: Ring {
            points: frame.iter().map(|&(x, y)| Point2::new(x, y)).collect(),
        },
        holes: rings.iter().map(|named| named.ring.clone()).collect(),
    };
    match validate(&as_holes) {
        Err(
            ValidityError::HoleInHole { .. }
            | ValidityError::HoleOutside { .. }
            | ValidityError::Disconnected { .. },
        )
        | Ok(()) => None,
        Err(problem) => Some(problem),
    }
}

/// The names of the rings that a problem of [`crossing`] is about, where they are rings' numbers.
fn ring_names(what: &str, rings: &[NamedRing], problem: &ValidityError) -> String {
    let name = |ring: &RingName| match *ring {
        RingName::Hole(number) => rings.get(number).map(|named| named.what.clone()),
        RingName::Exterior => None,
    };
    let names = match problem {
        ValidityError::RingsCross { first, second, .. } => name(first)
            .zip(name(second))
            .map(|(first, second)| format!("{first} and {second}")),
        ValidityError::SelfIntersection { ring, .. }
        | ValidityError::SelfTouch { ring, .. }
        | ValidityError::Spike { ring, .. } => name(ring),
        _ => None,
    };
    names.unwrap_or_else(|| what.to_string())
}

fn named(what: &str, regions: Vec<Region>, is_valid: bool) -> Vec<NamedRegion> {
    let many = regions.len() > 1;
    let name = |number| match many {
        true => format!("{what}, part {number}"),
        false => what.to_string(),
    };
    regions
        .into_iter()
        .enumerate()
        .map(|(number, region)| NamedRegion {
            what: name(number),
            region,
            is_valid,
            colour: None,
        })
        .collect()
}

/// Makes the ring counter-clockwise (or clockwise); true where it was not.
fn turn(ring: &mut Ring, counter_clockwise: bool) -> bool {
    let wrong = (ring.signed_area_mm2() > 0.0) != counter_clockwise;
    if wrong {
        ring.points.reverse();
    }
    wrong
}

/// Sorts rings that do not cross into exteriors and holes. A ring with the same on both sides
/// bounds nothing and is dropped.
fn nest(
    what: &str,
    rings: Vec<NamedRing>,
    rule: FillRule,
    notes: &mut Vec<String>,
) -> Vec<NamedRegion> {
    let filled = |winding: i32| match rule {
        FillRule::EvenOdd => winding % 2 != 0,
        FillRule::NonZero => winding != 0,
        FillRule::Positive => winding > 0,
    };
    let around = windings_around(&rings);
    let mut regions: Vec<NamedRegion> = Vec::new();
    let mut holes: Vec<NamedRing> = Vec::new();
    let mut dropped = 0;
    for (NamedRing { what, mut ring }, outside) in rings.into_iter().zip(around) {
        let own = if ring.signed_area_mm2() > 0.0 { 1 } else { -1 };
        match (filled(outside), filled(outside + own)) {
            (false, true) => {
                turn(&mut ring, true);
                let region = Region {
                    exterior: ring,
                    holes: Vec::new(),
                };
                regions.push(NamedRegion {
                    what,
                    region,
                    is_valid: false,
                    colour: None,
                });
            }
            (true, false) => {
                turn(&mut ring, false);
                holes.push(NamedRing { what, ring });
            }
            _ => dropped += 1,
        }
    }
    if dropped > 0 {
        notes.push(format!(
            "{what}: {dropped} contours have the same on both sides by the fill rule and bound nothing"
        ));
    }
    for hole in holes {
        let place = representative(&hole.ring);
        let home = regions
            .iter_mut()
            .filter(|named| winding(&named.region.exterior, place) != 0)
            .min_by(|a, b| {
                let area = |named: &NamedRegion| named.region.exterior.signed_area_mm2();
                area(a).total_cmp(&area(b))
            });
        match home {
            Some(named) => named.region.holes.push(hole.ring),
            None => notes.push(format!(
                "{} is a hole outside every exterior; ignored",
                hole.what
            )),
        }
    }
    if let [only] = regions.as_mut_slice() {
        only.what = what.to_string();
    }
    regions
}

/// For each ring, the winding number that all others make at it.
fn windings_around(rings: &[NamedRing]) -> Vec<i32> {
    let boxes: Vec<Box2> = rings
        .iter()
        .map(|named| Box2::of(&named.ring.points))
        .collect();
    (0..rings.len())
        .map(|k| {
            let p = representative(&rings[k].ring);
            rings
                .iter()
                .zip(&boxes)
                .enumerate()
                .filter(|&(other, (_, b))| {
                    other != k
                        && b.min.x <= p.x
                        && p.x <= b.max.x
                        && b.min.y <= p.y
                        && p.y <= b.max.y
                })
                .map(|(_, (named, _))| winding(&named.ring, p))
                .sum()
        })
        .collect()
}

/// A point on the ring where other rings hardly touch it: on its longest edge, off the middle,
/// where drawings are symmetric.
fn representative(ring: &Ring) -> Point2 {
    let mut best = (-1.0, Point2::origin());
    for (a, b) in ring.edges() {
        let length = (b - a).norm_squared();
        if length > best.0 {
            best = (length, a + (b - a) * 0.4871);
        }
    }
    best.1
}

fn winding(ring: &Ring, p: Point2) -> i32 {
    ring.edges()
        .filter(|&(a, b)| crosses_ray(a, b, p))
        .map(|(a, b)| if b.y > a.y { 1 } else { -1 })
        .sum()
}

//! Several copies of a part on the bed: their positions, checked not to touch.
//!
//! In: number and distance of copies, or a position for each (mm); the part's outlines. Out: offsets from the
//! first one, which keeps the input's position. Number and length of rows are chosen to use the smallest share
//! of the work area's length and width. Not covered: parts of different files, and rotation.

use crate::geometry::boolean::{filled, grown, intersection};
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::repair::FillRule;
use crate::geometry::{Point2, Vector2};
use crate::text::refusal::{Refusal, refusal};

/// Most parts on a bed.
pub const COPIES_MAX: u32 = 1000;
/// Parts closer than this touch, mm.
const TOUCH_MM: f64 = 0.1;

/// Default gap between copies, mm.
const GAP_MM: f64 = 5.0;
/// Accepted gaps, mm.
const GAPS_MM: [f64; 2] = [0.2, 1000.0];

/// Two parts touch.
pub fn touch(first: usize, second: usize, at: Point2) -> Refusal {
    refusal!(
        "parts {first} and {second} touch near ({:.3}, {:.3}): move one of their --at, or use \
         --copies, which leaves --copy-gap between them",
        at.x,
        at.y
    )
}

/// The gap between copies: the requested one, or the default.
///
/// # Errors
/// [`Refusal`].
pub fn checked_gap_mm(asked: Option<f64>) -> Result<f64, Refusal> {
    let gap_mm = asked.unwrap_or(GAP_MM);
    match (GAPS_MM[0]..=GAPS_MM[1]).contains(&gap_mm) {
        true => Ok(gap_mm),
        false => Err(refusal!(
            "--copy-gap {gap_mm}: write {} to {} mm",
            GAPS_MM[0],
            GAPS_MM[1]
        )),
    }
}

/// Offsets of `copies` parts in rows with `gap_mm` between their boxes, on an area of this size.
///
/// # Errors
/// [`Refusal`].
pub fn in_rows(
    copies: u32,
    part: Box2,
    gap_mm: f64,
    area_mm: [f64; 2],
) -> Result<Vec<Vector2>, Refusal> {
    let size = part.size();
    let pitch = size.add_scalar(gap_mm);
    let along = |axis: usize| {
        let fits = (area_mm[axis] + gap_mm) / pitch[axis].max(1e-9);
        (fits + 1e-9).floor().clamp(0.0, f64::from(COPIES_MAX)) as u32
    };
    let (columns_max, rows_max) = (along(0), along(1));
    let fitting = columns_max * rows_max;
    // One that is too large for the machine is reported with its own size.
    if copies > fitting.max(1) {
        return Err(refusal!(
            "{copies} parts of {width_mm:.3} x {height_mm:.3} mm with {gap_mm} mm between them \
             do not fit on the work area: {fitting} do; print fewer --copies or lower --copy-gap",
            width_mm = size.x,
            height_mm = size.y
        ));
    }
    let used = |columns: u32| {
        let rows = copies.div_ceil(columns);
        let share = |count: u32, axis: usize| f64::from(count) * pitch[axis] / area_mm[axis];
        share(columns, 0).max(share(rows, 1))
    };
    let may = |columns: &u32| copies.div_ceil(*columns) <= rows_max.max(1);
    let columns = (1..=columns_max.clamp(1, copies)).filter(may);
    let columns = columns
        .min_by(|a, b| used(*a).total_cmp(&used(*b)))
        .unwrap_or(1);
    let place = |number: u32| {
        let [column, row] = [number % columns, number / columns].map(f64::from);
        Vector2::new(column * pitch.x, row * pitch.y)
    };
    Ok((0..copies).map(place).collect())
}

/// Puts as many parts into each layer as there are offsets; `layers` are all different layers of one part. Says how many
/// there are, and where.
///
/// # Errors
/// [`Refusal`].
pub fn spread(layers: &mut [&mut Vec<Region>], offsets: &[Vector2]) -> Result<String, Refusal> {
    check_apart(layers.iter().flat_map(|layer| layer.iter()), offsets)?;
    for layer in layers {
        **layer = copied(layer, offsets);
    }
    let told = offsets.iter().take(4);
    let told: Vec<String> = told
        .map(|at| format!("({:.2}, {:.2})", at.x, at.y))
        .collect();
    let more = if offsets.len() > 4 { ", ..." } else { "" };
    Ok(format!(
        "{} parts, printed layer by layer together, at {}{more} mm from the first",
        offsets.len(),
        told.join(", ")
    ))
}

/// The box around all layers of a part.
pub fn box_of(layers: &[&mut Vec<Region>]) -> Box2 {
    let regions = layers.iter().flat_map(|layer| layer.iter());
    let corners: Vec<Point2> = regions
        .flat_map(|region| [region.bounds().min, region.bounds().max])
        .collect();
    Box2::of(&corners)
}

/// Refuses parts that touch; `outlines` are all outlines of one part.
///
/// # Errors
/// [`Refusal`], the first pair.
pub fn check_apart<'a>(
    outlines: impl Iterator<Item = &'a Region>,
    offsets: &[Vector2],
) -> Result<(), Refusal> {
    let rings: Vec<_> = outlines.flat_map(Region::rings).cloned().collect();
    let corners: Vec<Point2> = rings.iter().flat_map(|ring| ring.points.clone()).collect();
    let size = Box2::of(&corners).grown(TOUCH_MM).size();
    // Made where two boxes meet.
    let mut whole: Option<[Vec<Region>; 2]> = None;
    for (second, to) in offsets.iter().enumerate() {
        for (first, from) in offsets[..second].iter().enumerate() {
            let apart = to - from;
            if apart.x.abs() >= size.x || apart.y.abs() >= size.y {
                continue;
            }
            let [part, around] = whole.get_or_insert_with(|| {
                let part = filled(rings.iter(), FillRule::NonZero);
                let around = grown(&part, TOUCH_MM);
                [part, around]
            });
            let other: Vec<Region> = part.iter().map(|region| region.shifted(apart)).collect();
            let shared = intersection(around, &other);
            if let Some(place) = shared
                .first()
                .and_then(|region| region.exterior.points.first())
            {
                return Err(touch(first + 1, second + 1, place + from));
            }
        }
    }
    Ok(())
}

/// The outlines at each offset.
pub fn copied(regions: &[Region], offsets: &[Vector2]) -> Vec<Region> {
    let at = |&offset: &Vector2| regions.iter().map(move |region| region.shifted(offset));
    offsets.iter().flat_map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::region;

    fn part(width: f64, height: f64) -> Region {
        region(&[&[
            [1.0, 2.0],
            [1.0 + width, 2.0],
            [1.0 + width, 2.0 + height],
            [1.0, 2.0 + height],
        ]])
    }

    /// Goal: rows fill the bed evenly, no more than fit. Method: sizes by hand.
    #[test]
    fn rows_lie_side_by_side_with_their_gap() {
        let bounds = part(20.0, 10.0).bounds();
        let rows = in_rows(6, bounds, 5.0, [100.0, 100.0]).unwrap();
        let expected = [
            [0.0, 0.0],
            [25.0, 0.0],
            [0.0, 15.0],
            [25.0, 15.0],
            [0.0, 30.0],
            [25.0, 30.0],
        ];
        assert_eq!(rows, expected.map(|[x, y]| Vector2::new(x, y)));
        // Four fit along x to the last digit, six along y.
        assert_eq!(in_rows(24, bounds, 5.0, [95.0, 85.0]).unwrap().len(), 24);
        let error = in_rows(25, bounds, 5.0, [95.0, 85.0]).unwrap_err();
        assert!(error.to_string().contains("24 do"), "{error}");
        assert_eq!(
            in_rows(1, bounds, 5.0, [1.0, 1.0]).unwrap(),
            [Vector2::zeros()]
        );
        assert!(check_apart([part(20.0, 10.0)].iter(), &rows).is_ok());
    }

    /// Goal: parts that touch are refused with their place, nested ones that do not are taken. Method:
    /// a plate, and an L around whose corner another one lies.
    #[test]
    fn parts_that_touch_are_refused_with_their_place() {
        let plate = part(20.0, 10.0);
        let offsets = [[0.0, 0.0], [30.0, 0.0], [45.0, 5.0]].map(|[x, y]| Vector2::new(x, y));
        let error = check_apart([plate].iter(), &offsets).unwrap_err();
        let text = error.to_string();
        let place = text
            .strip_prefix("parts 2 and 3 touch near (")
            .expect(&text);
        let place = place.split_once(')').expect(&text).0;
        let at: Vec<f64> = place.split(", ").map(|n| n.parse().unwrap()).collect();
        assert!(
            (45.8..51.2).contains(&at[0]) && (6.8..12.2).contains(&at[1]),
            "{text}"
        );
        let corner = region(&[&[
            [0.0, 0.0],
            [20.0, 0.0],
            [20.0, 2.0],
            [2.0, 2.0],
            [2.0, 20.0],
            [0.0, 20.0],
        ]]);
        let nested = [Vector2::zeros(), Vector2::new(4.0, 4.0)];
        assert!(check_apart([corner.clone()].iter(), &nested).is_ok());
        let closer = [Vector2::zeros(), Vector2::new(2.05, 4.0)];
        assert!(check_apart([corner].iter(), &closer).is_err());
    }
}

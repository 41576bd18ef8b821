//! Repairs outlines that cross or overlap: the area of the fill rule becomes valid regions.
//!
//! Coordinates are rounded to a fine integer grid (the part's size / 2^30 or better), so even
//! untouched corners can move by far less than a nanometre on a printable part.

use super::boolean::filled;
use super::polygon::Region;
use super::validity::{ValidityError, validate_all};

/// Which places rings enclose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FillRule {
    /// Enclosed an odd number of times.
    EvenOdd,
    /// Wound around by any number of turns but zero.
    NonZero,
    /// Wound around counter-clockwise more often than clockwise.
    Positive,
}

/// Changes made by the repair, for the user.
#[derive(Clone, Debug, PartialEq)]
pub struct RepairChanges {
    /// The first fault found, `None` if there was no fault.
    pub fault: Option<ValidityError>,
    /// Regions before and after.
    pub regions: [usize; 2],
    /// Rings before and after.
    pub rings: [usize; 2],
    /// Points before and after.
    pub points: [usize; 2],
    /// Area before (exteriors less holes, each by its size) and after, mm².
    pub area_mm2: [f64; 2],
}

/// Regions with the filled area of the given rings; valid ones are returned unchanged. Rings
/// without area are dropped; the result may be empty.
pub fn repair(regions: &[Region], rule: FillRule) -> (Vec<Region>, RepairChanges) {
    let fault = validate_all(regions).err();
    let mended = match &fault {
        None => regions.to_vec(),
        Some(_) => filled(regions.iter().flat_map(Region::rings), rule),
    };
    let count = |set: &[Region], of: fn(&Region) -> usize| set.iter().map(of).sum::<usize>();
    let rings = |r: &Region| r.holes.len() + 1;
    let points = |r: &Region| r.rings().map(|ring| ring.points.len()).sum();
    let area = |set: &[Region]| -> f64 {
        let of = |r: &Region| {
            let holes: f64 = r.holes.iter().map(|h| h.signed_area_mm2().abs()).sum();
            r.exterior.signed_area_mm2().abs() - holes
        };
        set.iter().map(of).sum()
    };
    let changes = RepairChanges {
        fault,
        regions: [regions.len(), mended.len()],
        rings: [count(regions, rings), count(&mended, rings)],
        points: [count(regions, points), count(&mended, points)],
        area_mm2: [area(regions), area(&mended)],
    };
    (mended, changes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point2;
    use crate::polygon::Ring;

    fn ring(points: &[[f64; 2]]) -> Ring {
        Ring {
            points: points.iter().map(|p| Point2::new(p[0], p[1])).collect(),
        }
    }

    fn simple(points: &[[f64; 2]]) -> Region {
        Region {
            exterior: ring(points),
            holes: vec![],
        }
    }

    /// Goal: a bow tie becomes its two wings. Method: count, area, validity.
    #[test]
    fn bow_tie() {
        let tie = simple(&[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]]);
        let (mended, changes) = repair(&[tie], FillRule::EvenOdd);
        assert_eq!(mended.len(), 2);
        assert!((changes.area_mm2[1] - 8.0).abs() < 1e-6);
        assert!(matches!(
            changes.fault,
            Some(ValidityError::SelfIntersection { .. })
        ));
        assert_eq!(validate_all(&mended), Ok(()));
    }

    /// Goal: overlapping parts join by the non-zero rule, the overlap goes by even-odd.
    #[test]
    fn overlapping_squares() {
        let square = |x: f64| simple(&[[x, 0.0], [x + 4.0, 0.0], [x + 4.0, 4.0], [x, 4.0]]);
        let parts = [square(0.0), square(3.0)];
        let (joined, changes) = repair(&parts, FillRule::NonZero);
        assert_eq!(joined.len(), 1);
        assert!((changes.area_mm2[1] - 28.0).abs() < 1e-6);
        let (parted, changes) = repair(&parts, FillRule::EvenOdd);
        assert_eq!(parted.len(), 2);
        assert!((changes.area_mm2[1] - 24.0).abs() < 1e-6);
    }

    /// Goal: the valid stays as it is, to the bit.
    #[test]
    fn valid_is_untouched() {
        let mut region = simple(&[[0.1, 0.0], [10.0, 0.0], [10.0, 10.3], [0.0, 10.0]]);
        region
            .holes
            .push(ring(&[[4.0, 4.0], [5.0, 6.0], [6.0, 4.0]]));
        let (mended, changes) = repair(std::slice::from_ref(&region), FillRule::NonZero);
        assert_eq!(mended, [region]);
        assert_eq!(changes.fault, None);
    }

    /// Goal: invalid reference polygons come out valid. Skipped where the data is absent.
    #[test]
    fn reference_polygons() {
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
        let names = [
            "slices/Spec-House-1st-Floor_z19100_c0",
            "slices/topopt-bone-cantilever_z4100_c0",
            "polygons/water",
            "polygons/bad-hole",
            "polygons/touching-holes",
        ];
        for name in names {
            let Ok(text) = std::fs::read_to_string(format!("{root}/{name}.json")) else {
                assert!(
                    std::env::var_os("HEADWAY_DEMAND_DATA").is_none(),
                    "no reference data"
                );
                println!("skipped: no reference data {root}/{name}.json");
                continue;
            };
            let json: serde_json::Value = serde_json::from_str(&text).unwrap();
            let rings: Vec<Vec<[f64; 2]>> = std::iter::once(json["exterior"].clone())
                .chain(json["holes"].as_array().unwrap().iter().cloned())
                .map(|value| serde_json::from_value(value).unwrap())
                .collect();
            let region = Region {
                exterior: ring(&rings[0]),
                holes: rings[1..].iter().map(|r| ring(r)).collect(),
            };
            let (mended, changes) = repair(&[region], FillRule::NonZero);
            println!("{name}: {changes:?}");
            assert!(!mended.is_empty());
            assert_eq!(validate_all(&mended), Ok(()), "{name}");
        }
    }
}

//! What rides along in a job file beside the stream: the settings and the outline, so that a job
//! can be drawn and checked without its input.

use crate::geometry::Point2;
use crate::geometry::polygon::{Region, Ring};
use serde::{Deserialize, Serialize};

/// Key of the machine file's text among a job's texts.
pub const SETTINGS_TEXT: &str = "settings";
/// Key of the outline's JSON among a job's texts.
pub const OUTLINE_TEXT: &str = "outline";
/// Key of the part's name among a job's texts.
pub const NAME_TEXT: &str = "name";

#[derive(Deserialize, Serialize)]
struct RegionText {
    exterior: Vec<[f64; 2]>,
    holes: Vec<Vec<[f64; 2]>>,
}

/// The regions as JSON, mm, input coordinates.
pub fn outline_to_json(regions: &[Region]) -> String {
    let ring = |ring: &Ring| ring.points.iter().map(|p| [p.x, p.y]).collect();
    let regions: Vec<RegionText> = regions
        .iter()
        .map(|region| RegionText {
            exterior: ring(&region.exterior),
            holes: region.holes.iter().map(ring).collect(),
        })
        .collect();
    serde_json::to_string(&regions).unwrap_or_else(|_| "[]".to_string())
}

/// What [`outline_to_json`] wrote; `None` where it is something else.
pub fn outline_from_json(text: &str) -> Option<Vec<Region>> {
    let ring = |points: Vec<[f64; 2]>| Ring {
        points: points.iter().map(|p| Point2::new(p[0], p[1])).collect(),
    };
    let regions: Vec<RegionText> = serde_json::from_str(text).ok()?;
    let regions = regions.into_iter().map(|region| Region {
        exterior: ring(region.exterior),
        holes: region.holes.into_iter().map(ring).collect(),
    });
    Some(regions.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlines_come_back_bit_for_bit() {
        let ring = |offset: f64| Ring {
            points: (0..5)
                .map(|k| Point2::new(0.1 * f64::from(k) + offset, 1.0 / 3.0 + offset))
                .collect(),
        };
        let regions = vec![Region {
            exterior: ring(1000.7),
            holes: vec![ring(0.3), ring(-7e-7)],
        }];
        let text = outline_to_json(&regions);
        assert_eq!(outline_from_json(&text), Some(regions));
        assert_eq!(outline_from_json("{}"), None);
    }
}

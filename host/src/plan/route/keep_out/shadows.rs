//! Keep-outs of obstacles on the machine: the projections of `--obstacle`, for heads that do not
//! tilt.
//!
//! In: triangles (mm, machine coordinates), the head's profile, the part's position. Out: regions in the input's
//! coordinates for [`crate::plan::route::keep_out`]: that module grows them by the nozzle's body, so they are
//! grown here by the excess of the head's width over it at the obstacle's height above the first layer.

use crate::geometry::Point2;
use crate::geometry::boolean::{filled, grown};
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::repair::FillRule;
use crate::job::transform::PartTransform;
use crate::settings::Settings;
use headway_reach::Vector3;

/// Heights within so much of each other are grown alike, mm.
const BAND_MM: f64 = 2.0;
/// Most bands.
const BANDS_MAX: usize = 16;

/// The keep-outs that were given, and the shadows of all obstacles.
pub fn with_shadows(
    keep_out: &[Region],
    transform: &PartTransform,
    settings: &Settings,
) -> Vec<Region> {
    let mut all = keep_out.to_vec();
    let triangles = &settings.obstacles.triangles;
    let profile = settings.head.as_ref().map(|head| head.profile());
    // The tip is never lower than the first layer.
    let tip_mm = settings.work_area_mm[0][2] + settings.layer_height_mm;
    let top_mm = |triangle: &[Vector3; 3]| {
        triangle
            .iter()
            .map(|corner| corner.z)
            .fold(f64::NEG_INFINITY, f64::max)
    };
    let highest_mm = triangles.iter().map(top_mm).fold(tip_mm, f64::max);
    let band_mm = BAND_MM.max((highest_mm - tip_mm) / BANDS_MAX as f64);
    for band in 0..=BANDS_MAX {
        let [low_mm, high_mm] = [band, band + 1].map(|band| tip_mm + band_mm * band as f64);
        let is_in_band = |triangle: &&[Vector3; 3]| {
            let top_mm = top_mm(triangle);
            top_mm > low_mm && top_mm <= high_mm
        };
        let rings: Vec<Ring> = triangles
            .iter()
            .filter(is_in_band)
            .filter_map(|triangle| shadow(triangle, transform))
            .collect();
        if rings.is_empty() {
            continue;
        }
        let shadows = filled(rings.iter(), FillRule::NonZero);
        let profile = profile.as_ref();
        let radius_mm = profile.map_or(0.0, |head| head.radius_mm(high_mm - tip_mm));
        all.extend(grown(&shadows, radius_mm - settings.nozzle_body_radius_mm));
    }
    all
}

/// A triangle from above, counter-clockwise; `None` if it is vertical.
fn shadow(triangle: &[Vector3; 3], transform: &PartTransform) -> Option<Ring> {
    let corners = triangle.map(|corner| transform.to_input(corner.into()));
    let [a, b, c] = corners.map(|[x, y, _]| Point2::new(x, y));
    let double_mm2 = (b - a).perp(&(c - a));
    let points = match double_mm2 {
        left if left > 1e-9 => vec![a, b, c],
        right if right < -1e-9 => vec![a, c, b],
        _ => return None,
    };
    Some(Ring { points })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::head_shape::{HeadOutline, HeadShape};
    use crate::settings::obstacles::Obstacles;

    /// Goal: a block keeps the head off by its radius at the block's height. Method: a box of 10 mm, 4 mm high, under a
    /// cone of 45°, whose area is known.
    #[test]
    fn a_block_keeps_the_head_off() {
        let corner = |x: f64, y: f64| Vector3::new(x, y, 4.2);
        let [a, b, c, d] = [
            corner(0.0, 0.0),
            corner(10.0, 0.0),
            corner(10.0, 10.0),
            corner(0.0, 10.0),
        ];
        let settings = Settings {
            head: Some(HeadShape {
                outline: HeadOutline::Profile(vec![[0.0, 1.0], [20.0, 21.0]]),
                tip_slack_mm: None,
            }),
            obstacles: Obstacles::of(vec![[a, b, c], [a, d, c]]),
            ..Settings::default()
        };
        let transform = PartTransform {
            offset_mm: [100.0, 0.0, 0.0],
        };
        let kept = with_shadows(&[], &transform, &settings);
        assert_eq!(kept.len(), 1);
        // 4 mm above the tip the radius is 5 mm.
        let area_mm2 = 100.0 + 4.0 * 10.0 * 5.0 + std::f64::consts::PI * 25.0;
        assert!(
            (kept[0].area_mm2() - area_mm2).abs() < 0.1,
            "{}",
            kept[0].area_mm2()
        );
        assert!(kept[0].exterior.points.iter().all(|point| point.x < -84.0));
    }
}

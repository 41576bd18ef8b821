//! Passes, limits and walls for the optimiser's tests.
//!
//! In: lengths in mm. Out: passes of even spans, the limits of the built-in machine.

use super::{Objective, OptimisedPass, Site};
use crate::pose_limits::{AxisLimits, PoseLimits};
use headway_geometry::aperture::Aperture;
use headway_geometry::edge_index::EdgeIndex;
use headway_geometry::plane_curve::PlaneControl;
use headway_geometry::rounded_polygon::{Kind, RoundedPolygon};
use headway_geometry::test_shapes::{ELLIPSE, drop_corners, walls};

/// A name for the message of a test that fails.
pub fn kind_name(aperture: &Aperture) -> &'static str {
    match aperture {
        Aperture::Ellipse { .. } => "ellipse",
        Aperture::Rounded(shape) => match shape.kind() {
            Kind::Stadium(_) => "stadium",
            Kind::Rectangle(_) => "rect",
            Kind::Polygon => "polygon",
        },
    }
}

/// 95 % of 60 mm/s, 3000 mm/s², 3·10⁵ mm/s³; heading 1080°/s, 20,000°/s², 2·10⁶°/s³.
pub fn limits() -> PoseLimits {
    let tip = AxisLimits {
        speed: 190.0,
        acceleration: 2850.0,
        jerk: 2.85e5,
    };
    let heading = AxisLimits {
        speed: 17.9,
        acceleration: 331.6,
        jerk: 3.316e4,
    };
    PoseLimits {
        tip_speed_mm_s: 57.0,
        tip_acceleration_mm_s2: 2850.0,
        axes: [tip, tip, heading],
    }
}

/// 2 s/mm², half for area laid twice, a return after 1.5 a.
pub fn objective(major_mm: f64) -> Objective {
    Objective {
        price_s_mm2: 2.0,
        twice_share: 0.5,
        return_mm: 1.5 * major_mm,
    }
}

/// An ellipse, a slot, a rectangle with sharp corners and a drop without symmetry.
pub fn apertures() -> [Aperture; 4] {
    let drop = RoundedPolygon::polygon(&drop_corners()).expect("a drop");
    [
        ELLIPSE,
        Aperture::Rounded(RoundedPolygon::stadium(1.2, 0.4)),
        Aperture::Rounded(RoundedPolygon::rectangle(1.2, 0.4, 0.0)),
        Aperture::Rounded(drop),
    ]
}

/// All area within the walls.
pub fn site<'a>(walls: &'a EdgeIndex, aperture: &'a Aperture, limits: &'a PoseLimits) -> Site<'a> {
    Site {
        width_by_radius_max: None,
        walls,
        left_out: &[],
        aperture,
        limits,
        scale: None,
    }
}

/// A rectangle from the origin.
pub fn rectangle(width_mm: f64, height_mm: f64) -> EdgeIndex {
    let corners = [
        [0.0, 0.0],
        [width_mm, 0.0],
        [width_mm, height_mm],
        [0.0, height_mm],
    ];
    walls(&[&corners])
}

/// A pass of `spans` spans whose control points are `pose` at 0..=1, with one pace throughout.
pub fn pass_of(spans: usize, span_s: f64, pose: impl Fn(f64) -> PlaneControl) -> OptimisedPass {
    OptimisedPass {
        control: (0..=spans).map(|k| pose(k as f64 / spans as f64)).collect(),
        log_pace: vec![span_s.ln(); spans + 1],
    }
}

/// A bead along a bar of 12 mm x 1.3 mm that wavers across it and in its heading.
pub fn wavering_bead(scale: f64) -> OptimisedPass {
    pass_of(44, 0.008, |t| {
        let wave = (40.0 * t).sin();
        let fade = (8.0 * t.min(1.0 - t)).min(1.0);
        [
            scale * (0.3 + 11.4 * t),
            scale * (0.65 + 0.04 * fade * wave),
            std::f64::consts::FRAC_PI_2 + 0.25 * fade * (23.0 * t).sin(),
        ]
    })
}

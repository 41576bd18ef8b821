//! F(p) for tool axes at one point and time of a job: which are free, and which free one is nearest to the
//! planned axis.
//!
//! In: the poses of a job in order (mm, rad, machine coordinates), a tip and a time, the head's shape. Out: the caps that
//! a search for the nearest free axis met, that axis, and a map of all axes within 90° of Z.

use crate::plan::route::moves::{tilt, tip};
use crate::plan::route::waypoint_curve::half_width_mm;
use crate::settings::Settings;
use headway_firmware::kinematics::pose::tool_axis;
use headway_protocol::units::CHANNELS;
use headway_reach::free_axes::{Cap, Found, Place, nearest_free};
use headway_reach::standing::{Point, Standing};
use headway_reach::touch::Head;
use headway_reach::{Pose, Vector3};
use nalgebra::Vector2;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Rings of the map.
pub const MAP_RINGS: usize = 45;
/// Axes of each of its rings.
pub const MAP_SECTORS: usize = 180;

/// A moment of a job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// When, s of the job.
    pub time_s: f64,
    /// Where, channels in mm, rad, mm³.
    pub pose: [f64; CHANNELS],
    /// True while it prints.
    pub lays: bool,
}

/// The free axes of a place.
#[derive(Clone, Debug, PartialEq)]
pub struct AxesAt {
    /// The job's own axis then.
    pub wish: Vector3,
    /// True where that is free.
    pub wish_is_free: bool,
    /// The nearest free one; `None` if there is none.
    pub nearest: Option<Vector3>,
    /// Caps that the search met: where the axis must not be.
    pub caps: Vec<Cap>,
    /// Largest tilt over the table, rad.
    pub tilt_over_table_rad: f64,
    /// Points that exist then.
    pub points: usize,
    /// Axes that are free, ring by ring from Z to 90°, each from X towards Y.
    pub map: Vec<bool>,
}

/// The tilt and the direction of an axis of the map, rad.
pub fn map_axis_rad(ring: usize, sector: usize) -> [f64; 2] {
    let [rings, sectors] = [MAP_RINGS as f64, MAP_SECTORS as f64];
    [
        FRAC_PI_2 * (ring as f64 + 0.5) / rings,
        TAU * (sector as f64 + 0.5) / sectors,
    ]
}

/// The free axes with the tip at a position, machine coordinates, at a time of the job; `None` if the head's shape is
/// not known.
pub fn axes_at(
    moments: impl Iterator<Item = Moment>,
    tip_mm: Vector3,
    time_s: f64,
    settings: &Settings,
) -> Option<AxesAt> {
    let shape = settings.head.as_ref()?;
    let mut points = settings.obstacles.points.to_vec();
    let mut before: Option<Moment> = None;
    let mut wish = Vector3::z();
    for moment in moments.take_while(|moment| moment.time_s <= time_s) {
        wish = tool_axis(tilt(&moment.pose));
        let from = before.unwrap_or(moment);
        let half_width_mm = half_width_mm(&from.pose, &moment.pose, &settings.aperture);
        let step_mm = (tip(&moment.pose) - tip(&from.pose)).norm();
        // Every half width a point, as the judge has them.
        if !moment.lays || !from.lays || step_mm >= half_width_mm || before.is_none() {
            if moment.lays {
                points.push(Point {
                    at_mm: tip(&moment.pose),
                    half_width_mm,
                    normal: wish,
                });
            }
            before = Some(moment);
        }
    }
    let (profile, standing) = (shape.profile(), Standing::new(&points));
    let head = Head {
        profile: &profile,
        slack_mm: shape.tip_slack_mm(settings.layer_height_mm),
    };
    let above_mm = tip_mm.z - settings.work_area_mm[0][2];
    let tilt_over_table_rad = profile.tilt_over_table_rad(above_mm, 0.5 * settings.layer_height_mm);
    let place = Place {
        tip_mm,
        before: points.len(),
    };
    let within = [Cap {
        axis: Vector3::z(),
        angle_rad: tilt_over_table_rad.min(FRAC_PI_2),
    }];
    let is_free = |axis: Vector3| {
        let pose = Pose { tip_mm, axis };
        axis.angle(&Vector3::z()) <= tilt_over_table_rad
            && head.any(&standing, &pose, points.len()).is_none()
    };
    let axes = (0..MAP_RINGS).flat_map(|ring| (0..MAP_SECTORS).map(move |sector| (ring, sector)));
    let map = axes.map(|(ring, sector)| {
        let [tilt_rad, around_rad] = map_axis_rad(ring, sector);
        let (sin, cos) = around_rad.sin_cos();
        is_free(tool_axis(tilt_rad * Vector2::new(-sin, cos)))
    });
    let map = map.collect();
    let search = nearest_free(&head, &standing, &[place], wish, &within);
    Some(AxesAt {
        wish,
        wish_is_free: is_free(wish),
        nearest: match search.found {
            Found::Free(axis) => Some(axis),
            Found::None { .. } | Found::GivenUp => None,
        },
        caps: search.caps,
        tilt_over_table_rad,
        points: points.len(),
        map,
    })
}

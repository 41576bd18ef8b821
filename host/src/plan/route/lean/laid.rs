//! The material of a run in printing order, along the chords of its waypoints, with the head's
//! positions.
//!
//! In: a run (mm, input coordinates), its offset, the head. Out: points of the print and poses of the
//! head, machine coordinates.

use crate::input::waypoints::{Waypoint, WaypointRun};
use crate::plan::route::waypoint_curve::{self as curve, divided, pose};
use crate::settings::Settings;
use crate::settings::head_shape::HeadShape;
use headway_reach::free_axes::Place;
use headway_reach::profile::HeadProfile;
use headway_reach::standing::{Point, Standing};
use headway_reach::touch::Head;
use headway_reach::{Pose, Vector3};
use std::ops::Range;

/// Extra clearance of tilted axes, relative to the layer height: curves are not their chords.
const MARGIN_SHARE: f64 = 0.25;
/// The same of the tip's slack.
const SLACK_SHARE: f64 = 0.9;
/// Turn of the axis between two places, rad.
const TURN_RAD: f64 = 0.05;

/// A point of a pass.
#[derive(Clone, Copy, Debug)]
pub struct PassPlace {
    /// Tip and number of existing points.
    pub place: Place,
    /// The waypoint before it, in the pass, and its share of the distance to the next one.
    pub after: usize,
    pub share: f64,
}

/// The points of a pass.
#[derive(Clone, Debug)]
pub struct PassPlaces {
    /// Its waypoints in the run.
    pub waypoints: Range<usize>,
    /// In order.
    pub places: Vec<PassPlace>,
}

/// A printed run.
pub struct Laid {
    pub passes: Vec<PassPlaces>,
    /// Obstacles, then the print.
    pub points: Vec<Point>,
    /// How many of them are obstacles.
    pub obstacles: usize,
    pub offset_mm: Vector3,
    /// Obstacles and print, as a tree.
    pub standing: Standing,
    /// The head, and the same with the margin that leaning axes keep.
    profiles: [HeadProfile; 2],
    slack_mm: f64,
    table_mm: f64,
    table_slack_mm: f64,
}

impl Laid {
    pub fn of(
        run: &WaypointRun,
        offset_mm: [f64; 3],
        head: &HeadShape,
        settings: &Settings,
    ) -> Laid {
        let offset_mm = Vector3::from(offset_mm);
        let mut points = settings.obstacles.points.to_vec();
        let obstacles = points.len();
        let mut passes = Vec::new();
        let mut from = 0;
        for waypoints in divided(run, settings) {
            let range = from..from + waypoints.len();
            from = range.end;
            if waypoints.len() > 1 {
                let places = laid_places(waypoints, offset_mm, settings, &mut points);
                passes.push(PassPlaces {
                    waypoints: range,
                    places,
                });
            }
        }
        let margin_mm = MARGIN_SHARE * settings.layer_height_mm;
        let profile = head.profile();
        // Wider and lower everywhere but at the flat end.
        let wide = profile
            .knots()
            .iter()
            .map(|&[height_mm, radius_mm]| match height_mm {
                0.0 => [height_mm, radius_mm],
                _ => [(height_mm - margin_mm).max(0.0), radius_mm + margin_mm],
            });
        let wide = HeadProfile::new(&wide.collect::<Vec<_>>());
        Laid {
            passes,
            obstacles,
            standing: Standing::new(&points),
            points,
            offset_mm,
            profiles: [profile.clone(), wide.unwrap_or(profile)],
            slack_mm: head.tip_slack_mm(settings.layer_height_mm),
            table_mm: settings.work_area_mm[0][2],
            table_slack_mm: 0.5 * settings.layer_height_mm,
        }
    }
}

impl Laid {
    /// The head, with the margin if `keeps`.
    pub fn head(&self, keeps: bool) -> Head<'_> {
        Head {
            profile: &self.profiles[usize::from(keeps)],
            slack_mm: self.slack_mm * if keeps { SLACK_SHARE } else { 1.0 },
        }
    }

    /// The collision of an axis at a point: the index of a printed point, or none for the table.
    pub fn touch(&self, place: &Place, axis: Vector3, keeps: bool) -> Option<Option<usize>> {
        let above_mm = place.tip_mm.z - self.table_mm;
        let below_mm = self.profiles[0].below_tip_mm(&axis);
        if below_mm > above_mm + self.table_slack_mm {
            return Some(None);
        }
        let pose = Pose {
            tip_mm: place.tip_mm,
            axis,
        };
        let head = self.head(keeps);
        head.any(&self.standing, &pose, place.before).map(Some)
    }

    /// The first point of a pass with a collision, and the obstacle; axes turn uniformly between waypoints.
    pub fn first_touch(
        &self,
        pass: &PassPlaces,
        axes: &[Vector3],
        keeps: bool,
    ) -> Option<(usize, Option<usize>)> {
        pass.places.iter().enumerate().find_map(|(index, place)| {
            let axis = place.axis(axes);
            let touched = self.touch(&place.place, axis, keeps)?;
            Some((index, touched))
        })
    }

    /// Largest tilt of the head over the table at all points of a pass, rad.
    pub fn tilt_over_table_rad(&self, pass: &PassPlaces) -> f64 {
        let heights = pass.places.iter().map(|place| place.place.tip_mm.z);
        let above_mm = heights.fold(f64::INFINITY, f64::min) - self.table_mm;
        self.profiles[0].tilt_over_table_rad(above_mm, self.table_slack_mm)
    }
}

impl PassPlace {
    /// The axis there.
    pub fn axis(&self, axes: &[Vector3]) -> Vector3 {
        let to = axes.get(self.after + 1).unwrap_or(&axes[self.after]);
        axes[self.after].lerp(to, self.share).normalize()
    }
}

/// Points along the chords of a pass, each printed before the next one; a point of the print at
/// each.
fn laid_places(
    waypoints: &[Waypoint],
    offset_mm: Vector3,
    settings: &Settings,
    points: &mut Vec<Point>,
) -> Vec<PassPlace> {
    let mut places = Vec::new();
    for (after, pair) in waypoints.windows(2).enumerate() {
        let chord = pair[1].tip_mm - pair[0].tip_mm;
        let half_width_mm = half_width_mm(&pair[0], &pair[1], settings);
        let turn_rad = pair[0].axis.angle(&pair[1].axis);
        let count = (chord.norm() / half_width_mm).max(turn_rad / TURN_RAD);
        let count = count.ceil().max(1.0);
        // The last chord is printed to its end.
        let is_last = after + 2 == waypoints.len();
        for step in 0..count as usize + usize::from(is_last) {
            let share = step as f64 / count;
            let tip_mm = pair[0].tip_mm.coords + chord * share + offset_mm;
            let place = Place {
                tip_mm,
                before: points.len(),
            };
            places.push(PassPlace {
                place,
                after,
                share,
            });
            points.push(Point {
                at_mm: tip_mm,
                half_width_mm,
                normal: pair[0].axis.into_inner(),
            });
        }
    }
    places
}

/// Half the width of the bead of a chord.
fn half_width_mm(from: &Waypoint, to: &Waypoint, settings: &Settings) -> f64 {
    let aperture = &settings.aperture;
    if let Some(width_mm) = from.width_mm {
        return (0.5 * width_mm).max(aperture.minor_mm());
    }
    if from.heading_rad.is_none() {
        return aperture.major_mm();
    }
    curve::half_width_mm(&pose(from, [0.0; 3]), &pose(to, [0.0; 3]), aperture)
}

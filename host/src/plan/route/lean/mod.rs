//! Tool axes that tilt away from obstacles and earlier print (`--tilt-max`): a run's axes become
//! unknowns within a cone.
//!
//! In: a run of waypoints (mm, input coordinates), its position, the head's profile, obstacles. Out: the run with
//! other axes where a pass would collide; clear passes keep theirs.
//!
//! ```text
//! run --laid--> Laid: points in order, a tree; places of each pass
//!   pass clear as it is?                         its axes
//!   one axis for all of the pass (free_axes)?    the nearest to that given, exact
//!   a lean that changes along the pass (along)?  dynamic programming over a net, then smoothed
//!   none: refused, with the place and what is in the way
//! ```
//! A lean is a rotation vector in the upright frame rotated onto the given axis (by the smallest rotation). The print
//! is assumed along the chords of the waypoints; the judge checks the curves ([`crate::plan::judge::touches`]). Not
//! covered: time: the smallest lean is chosen, not the fastest.

mod along;
mod laid;
mod normals;
#[cfg(test)]
mod tests;

use crate::input::waypoints::{Waypoint, WaypointRun};
use crate::settings::Settings;
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::Kinematics;
use headway_reach::Vector3;
use headway_reach::free_axes::{Cap, nearest_free};
use laid::{Laid, PassPlaces};
use nalgebra::{Rotation3, Unit, Vector2};
pub use normals::{LayerNormals, PassNormals};

/// Axes closer than this are one, rad.
const SAME_AXIS_RAD: f64 = 1e-9;

/// A run with tilted axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Leaned {
    /// The run.
    pub run: WaypointRun,
    /// Number of tilted passes, and of all.
    pub passes: [usize; 2],
    /// By how much at most, rad.
    pub lean_max_rad: f64,
    /// Normals of their layers.
    pub normals: LayerNormals,
}

/// The run with axes that tilt away where it would collide; `None` if all of it is clear already.
///
/// # Errors
/// [`Refusal`].
pub fn leaned(
    run: &WaypointRun,
    offset_mm: [f64; 3],
    tilt_max_rad: f64,
    settings: &Settings,
) -> Result<Option<Leaned>, Refusal> {
    if settings.machine.kinematics == Kinematics::Planar {
        return Err(refusal!(
            "--tilt-max: this machine's head does not tilt; plan for another machine \
             (--machine) or leave it out"
        ));
    }
    let Some(head) = &settings.head else {
        return Err(refusal!(
            "--tilt-max: the head's shape is not in the machine file ([head]), so nobody knows \
             what it would touch"
        ));
    };
    if settings.place == crate::settings::Place::Best && settings.at_mm.is_none() {
        return Err(refusal!(
            "--tilt-max depends on the position of the run: give --at instead of --place best"
        ));
    }
    let laid = Laid::of(run, offset_mm, head, settings);
    let mut found = Leaned {
        run: run.clone(),
        passes: [0, laid.passes.len()],
        lean_max_rad: 0.0,
        normals: LayerNormals::of(run, &laid),
    };
    for pass in &laid.passes {
        let points = &run.points[pass.waypoints.clone()];
        let given: Vec<Vector3> = points.iter().map(|point| point.axis.into_inner()).collect();
        if laid.first_touch(pass, &given, false).is_none() {
            continue;
        }
        let axes = pass_axes(&laid, pass, points, tilt_max_rad);
        let axes = axes.map_err(|blocked| blocked.refused(&laid, run, points, tilt_max_rad))?;
        found.passes[0] += 1;
        let own = &mut found.run.points[pass.waypoints.clone()];
        for ((point, axis), given) in own.iter_mut().zip(axes).zip(&given) {
            found.lean_max_rad = found.lean_max_rad.max(axis.angle(given));
            point.axis = Unit::new_normalize(axis);
        }
    }
    Ok((found.passes[0] > 0).then_some(found))
}

/// A place without a free axis.
struct Blocked {
    /// Its waypoint, in the pass.
    waypoint: usize,
    tip_mm: Vector3,
    /// The obstacle or print point, by its order of printing; `None` for the table.
    by: Option<usize>,
}

impl Blocked {
    fn refused(
        self,
        laid: &Laid,
        run: &WaypointRun,
        points: &[Waypoint],
        tilt_max_rad: f64,
    ) -> Refusal {
        let point = points.get(self.waypoint).or(run.points.first());
        let offset_mm = laid.offset_mm;
        let by = self.by.and_then(|order| laid.points.get(order));
        let by_mm = by.map_or(self.tip_mm, |point| point.at_mm);
        let place = |at: Vector3| {
            let at = at - offset_mm;
            format!("({:.3}, {:.3}, {:.3}) mm", at.x, at.y, at.z)
        };
        let what = match self.by.is_some_and(|order| order >= laid.obstacles) {
            true => "earlier print",
            false => "an obstacle (--obstacle), or the table,",
        };
        refusal!(
            "line {}: with the tip at {} there is no free tool axis within {:.1}° of the one given; in the way is \
             {what} near {}: allow more (--tilt-max), print in another order, or move it away",
            point.map_or(0, |point| point.line),
            place(self.tip_mm),
            point.map_or(0.0, |point| cone_rad(point, tilt_max_rad).to_degrees()),
            place(by_mm)
        )
    }
}

/// How far the axis of a waypoint may lean.
fn cone_rad(point: &Waypoint, tilt_max_rad: f64) -> f64 {
    point
        .cone_rad
        .map_or(tilt_max_rad, |cone| cone.min(tilt_max_rad))
}

/// The axis that leans by a rotation vector from a given one.
fn leaning(given: &Vector3, lean: Vector2<f64>) -> Vector3 {
    let upright = headway_firmware::kinematics::pose::tool_axis(lean);
    let frame = Rotation3::rotation_between(&Vector3::z(), given);
    // No axis points straight down: waypoints are refused long before.
    frame.map_or(*given, |frame| frame * upright)
}

/// Axes of a pass that touches with its own.
fn pass_axes(
    laid: &Laid,
    pass: &PassPlaces,
    points: &[Waypoint],
    tilt_max_rad: f64,
) -> Result<Vec<Vector3>, Blocked> {
    let wish = points[0].axis.into_inner();
    let is_one = |point: &Waypoint| point.axis.angle(&points[0].axis) < SAME_AXIS_RAD;
    if points.iter().all(is_one) {
        let cones = points.iter().map(|point| cone_rad(point, tilt_max_rad));
        let within = [
            Cap {
                axis: wish,
                angle_rad: cones.fold(tilt_max_rad, f64::min),
            },
            Cap {
                axis: Vector3::z(),
                angle_rad: laid.tilt_over_table_rad(pass),
            },
        ];
        let places: Vec<_> = pass.places.iter().map(|place| place.place).collect();
        let head = laid.head(true);
        if let Some(axis) = nearest_free(&head, &laid.standing, &places, wish, &within) {
            return Ok(vec![axis; points.len()]);
        }
    }
    along::axes_along(laid, pass, points, tilt_max_rad)
}

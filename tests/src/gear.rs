//! A six-axis gear: the job that bytes on the wire are measured with, and the example of six axes.
//!
//! r(t) = 20 + 0.8 sin 20t + 0.45 t/2pi mm around (100, 100), Z = 0.2 + 0.3 (1 - cos(2 pi L/200)),
//! A = 10° sin(2 pi L/200), B = 10° cos(2 pi L/200) - 10°, L the length so far; the nozzle's major
//! axis along the tangent, flow on. The gantry's limits do not bind at 60 mm/s.

use headway::job::MotionState;
use headway::plan::route::moves::{Route, RouteMove};
use headway::settings::Settings;
use headway_firmware::configuration::{JointConfiguration, Kinematics};
use headway_firmware::kinematics::pose::tilt_of_axis;
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::{PI, TAU};

/// Spacing of the samples, which are taken as control points.
const SPACING_MM: f64 = 0.1;
/// Deposited volume per mm: a bead of 0.4 x 0.2 mm.
const BEAD_MM2: f64 = 0.08;
/// Steps of t between two points of the length's sum.
const FINE: f64 = 1e-5;

/// One point of the gear.
#[derive(Clone, Copy, Debug)]
pub struct GearPoint {
    /// Tip, mm.
    pub tip_mm: [f64; 3],
    /// Tool axis.
    pub axis: [f64; 3],
    /// Heading about the tool axis, rad, unwrapped.
    pub heading_rad: f64,
    /// Length so far in the plane, mm.
    pub length_mm: f64,
}

fn plane(t: f64) -> [f64; 2] {
    let radius_mm = 20.0 + 0.8 * (20.0 * t).sin() + 0.45 * t / TAU;
    [100.0 + radius_mm * t.cos(), 100.0 + radius_mm * t.sin()]
}

fn height_mm(length_mm: f64) -> f64 {
    0.2 + 0.3 * (1.0 - (TAU * length_mm / 200.0).cos())
}

fn head(length_mm: f64) -> Rotation3<f64> {
    let ten = 10.0 * PI / 180.0;
    let phase = TAU * length_mm / 200.0;
    let a = Rotation3::from_axis_angle(&Vector3::x_axis(), ten * phase.sin());
    let b = Rotation3::from_axis_angle(&Vector3::y_axis(), ten * phase.cos() - ten);
    a * b
}

/// The gear's points, `SPACING_MM` apart, over so much length.
pub fn points(length_mm: f64) -> Vec<GearPoint> {
    let rise = |_: f64, length_mm: f64, run_mm: f64| {
        let rise = height_mm(length_mm + 1e-4) - height_mm(length_mm - 1e-4);
        rise / 2e-4 * run_mm
    };
    let axis = |_: f64, length_mm: f64| head(length_mm) * Vector3::z();
    sampled(length_mm, |_, length_mm| height_mm(length_mm), rise, axis)
}

/// Slope of the cone that the gear of the examples lies on, its tool axis along the cone's normal: what is
/// printed is never above the nozzle's flat end, 0.8 mm from its axis.
const CONE_RAD: f64 = 12.0 * PI / 180.0;
/// Radius at which the cone is one layer above the bed: the gear's outermost place.
const CONE_FOOT_MM: f64 = 22.2;

/// The same gear on a cone that falls outwards.
pub fn points_on_cone(length_mm: f64) -> Vec<GearPoint> {
    let height_mm = |t: f64| {
        let [x, y] = plane(t);
        let radius_mm = (x - 100.0).hypot(y - 100.0);
        0.2 + (CONE_FOOT_MM - radius_mm) * CONE_RAD.tan()
    };
    let rise = |t: f64, _: f64, _: f64| height_mm(t + FINE) - height_mm(t - FINE);
    let axis = |t: f64, _: f64| {
        let (sin, cos) = CONE_RAD.sin_cos();
        Vector3::new(sin * t.cos(), sin * t.sin(), cos)
    };
    sampled(length_mm, |t, _| height_mm(t), rise, axis)
}

/// Points `SPACING_MM` apart; the height, its rise over 2 [`FINE`] of so much length in the plane, and the tool
/// axis by t and the length so far.
fn sampled(
    length_mm: f64,
    height_mm: impl Fn(f64, f64) -> f64,
    rise_mm: impl Fn(f64, f64, f64) -> f64,
    axis: impl Fn(f64, f64) -> Vector3<f64>,
) -> Vec<GearPoint> {
    let mut points: Vec<GearPoint> = Vec::new();
    let (mut t, mut so_far_mm, mut heading_rad) = (0.0, 0.0, 0.0);
    let mut last = plane(0.0);
    while so_far_mm <= length_mm {
        if so_far_mm >= points.len() as f64 * SPACING_MM {
            let ahead = plane(t + FINE);
            let behind = plane(t - FINE);
            let run_mm = (ahead[0] - behind[0]).hypot(ahead[1] - behind[1]);
            let rise_mm = rise_mm(t, so_far_mm, run_mm);
            let tangent = Vector3::new(ahead[0] - behind[0], ahead[1] - behind[1], rise_mm);
            let axis = axis(t, so_far_mm);
            let tilt = tilt_of_axis(&axis);
            let upright = Rotation3::new(Vector3::new(tilt.x, tilt.y, 0.0)).inverse() * tangent;
            let angle = upright.y.atan2(upright.x);
            heading_rad = if points.is_empty() {
                angle
            } else {
                angle + TAU * ((heading_rad - angle) / TAU).round()
            };
            points.push(GearPoint {
                tip_mm: [last[0], last[1], height_mm(t, so_far_mm)],
                axis: axis.into(),
                heading_rad,
                length_mm: so_far_mm,
            });
        }
        t += FINE;
        let here = plane(t);
        so_far_mm += (here[0] - last[0]).hypot(here[1] - last[1]);
        last = here;
    }
    points
}

/// The gear as a waypoint file: a waypoint every other sample: four times as far apart, the
/// headings between them would be off by a quarter of their tolerance, and cost bytes.
pub fn waypoint_file(length_mm: f64) -> String {
    text_of(
        "A gear of 20 lobes in six axes, the nozzle along the tangent",
        &points(length_mm),
    )
}

/// The gear on a cone as a waypoint file: the example, which touches nothing.
pub fn example_file(length_mm: f64) -> String {
    text_of(
        "A gear of 20 lobes on a cone, the tool axis along its normal, the nozzle along the tangent",
        &points_on_cone(length_mm),
    )
}

fn text_of(what: &str, points: &[GearPoint]) -> String {
    let mut text = format!(
        "# name: gear-6axis\n# units: mm\n# {what}; written by the tests.\n\
         # x y z nx ny nz heading_deg\n",
    );
    for point in points.iter().step_by(2) {
        let [x, y, z] = point.tip_mm;
        let [nx, ny, nz] = point.axis;
        let heading_deg = point.heading_rad.to_degrees();
        text += &format!("{x:.5} {y:.5} {z:.5} {nx:.7} {ny:.7} {nz:.7} {heading_deg:.4}\n");
    }
    text
}

/// The gear as one printed move.
pub fn route(length_mm: f64) -> Route {
    let control = points(length_mm)
        .iter()
        .map(|point| {
            let tilt = tilt_of_axis(&Vector3::from(point.axis));
            let [x, y, z] = point.tip_mm;
            let volume_mm3 = point.length_mm * BEAD_MM2;
            [x, y, z, tilt.x, tilt.y, point.heading_rad, volume_mm3]
        })
        .collect();
    Route {
        moves: vec![RouteMove {
            pass: Some(0),
            ..RouteMove::new(MotionState::Print, 0, control)
        }],
    }
}

/// A gantry whose limits do not bind: each far beyond what 60 mm/s asks for.
pub fn gantry() -> Settings {
    let mut settings = Settings::default();
    let joint = |rotary: bool, steps_per_unit: f64| JointConfiguration {
        rotary,
        steps_per_unit,
        position_min: -1e4,
        position_max: 1e4,
        speed_max: if rotary { 100.0 } else { 500.0 },
        acceleration_max: 2e4,
        jerk_max: 1e8,
    };
    settings.machine.kinematics = Kinematics::Gantry {
        pivot_length_mm: 60.0,
    };
    let joints = [
        joint(false, 80.0),
        joint(false, 80.0),
        joint(false, 400.0),
        joint(true, 16_000.0 / TAU),
        joint(true, 16_000.0 / TAU),
        joint(true, 9_600.0 / TAU),
    ];
    settings.machine.joints = joints.into_iter().collect();
    settings.tip_acceleration_mm_s2 = 2e4;
    settings.flow_rate_of_change_max_mm3_s2 = 1e4;
    settings.machine.extruder.acceleration_max_mm3_s2 = 1e5;
    settings
}

/// The same as a machine file may say it: no motor asks for more than the step tick can give.
pub fn free_gantry() -> Settings {
    let mut settings = gantry();
    settings.machine_name = String::from("free-gantry");
    for (joint, speed_max) in settings
        .machine
        .joints
        .iter_mut()
        .skip(2)
        .zip([200.0, 60.0, 60.0])
    {
        joint.speed_max = speed_max;
    }
    settings
}

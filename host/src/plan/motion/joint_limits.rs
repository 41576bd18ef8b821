//! Limits of joints, tip, flow and extruder, and the motion of the joints under a path.
//!
//! In: the settings; motion of the channels by any parameter. Out: the limits that apply to a move
//! (the plan's share of the machine's), joint motion by the same parameter.

use crate::job::MotionState;
use crate::plan::motion::motion_error::{MotionError, bad_limit, no_pose};
use crate::plan::route::path_curve::CurvePoint;
use crate::settings::{Settings, joint_names};
use headway_firmware::configuration::{JOINTS_MAX, Kinematics};
use headway_firmware::kinematics;
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::kinematics::winding::Winding;
use headway_firmware::numbers::jet::Jet;
use headway_firmware::path::load::{LoadModel, range_slack};
use headway_firmware::steps::delay::advance_centre_ticks;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS, Units};

/// Limits of one joint, share applied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimit {
    /// True if it turns: rad instead of mm.
    pub rotary: bool,
    /// Lowest position, mm or rad.
    pub position_min: f64,
    /// Highest position, mm or rad.
    pub position_max: f64,
    /// How far beyond either the path may go, mm or rad.
    pub range_slack: f64,
    /// Speed, mm/s or rad/s.
    pub speed_max: f64,
    /// Acceleration, mm/s² or rad/s².
    pub acceleration_max: f64,
    /// Jerk, mm/s³ or rad/s³.
    pub jerk_max: f64,
}

/// Limits of the two motors of a pair, share applied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairLimit {
    /// The joints of which the motors are sum and difference.
    pub joints: [usize; 2],
    /// Limits of either motor; it has no range.
    pub motor: JointLimit,
}

/// All limits that bind a move, share applied.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionLimits {
    /// The machine's equations.
    pub kinematics: Kinematics,
    /// What the controller checks of every span that it is sent.
    pub span_check: LoadModel,
    /// Turns of the joints where the move begins.
    pub winding: Winding<f64>,
    /// One for each joint, in the machine's order.
    pub joints: Vec<JointLimit>,
    /// Those of motors that two joints move together.
    pub pair: Option<PairLimit>,
    /// Tip speed, mm/s.
    pub tip_speed_mm_s: f64,
    /// Requested tip speeds along the path, by its parameter; see `RouteMove::speeds_mm_s`.
    pub asked_mm_s: Vec<[f64; 2]>,
    /// Length of the tip's acceleration vector, mm/s².
    pub tip_acceleration_mm_s2: f64,
    /// dV/dt, mm³/s.
    pub flow_max_mm3_s: f64,
    /// |d²V/dt²|, mm³/s².
    pub flow_rate_of_change_max_mm3_s2: f64,
    /// Extruder rate that arrives, mm³/s, pressure advance and events included.
    pub extruder_speed_max_mm3_s: f64,
    /// Extruder acceleration, mm³/s².
    pub extruder_acceleration_max_mm3_s2: f64,
    /// K: e = V + K dV/dt; the largest, where it is a curve.
    pub pressure_advance_s: f64,
    /// Largest change of it with flow, s²/mm³.
    pub advance_bend_s2_mm3: f64,
    /// Window over which dV/dt is averaged, s, at least a servo tick.
    pub pressure_advance_window_s: f64,
    /// Servo ticks that everything else waits for the advance: half its window.
    pub advance_delay_ticks: u32,
    /// Servo ticks per second.
    pub servo_hz: f64,
    /// See [`Aperture::unit_mm`](crate::geometry::aperture::Aperture::unit_mm).
    pub unit_mm: f64,
    /// Units of the stream.
    pub units: Units,
}

impl MotionLimits {
    /// The limits of a kind of move: travel has its own tip speed.
    pub fn of(settings: &Settings, state: MotionState) -> Result<Self, MotionError> {
        let machine = &settings.machine;
        let share = settings.plan_share;
        let servo_hz = f64::from(machine.servo_hz);
        let extruder = &machine.extruder;
        let [speed_max_mm3_s, acceleration_max_mm3_s2] = machine.arriving_limits();
        let tip_speed_mm_s = match state {
            MotionState::Travel => settings.travel_speed_mm_s,
            _ => settings.speed_mm_s,
        };
        let count = kinematics::joint_count(&machine.kinematics);
        let units = settings.units();
        let mut span_check = LoadModel::new(machine);
        span_check.take_units(&units);
        let limits = Self {
            kinematics: machine.kinematics,
            span_check,
            winding: Winding::default(),
            joints: machine
                .joints
                .iter()
                .take(count)
                .map(|joint| JointLimit {
                    rotary: joint.rotary,
                    position_min: joint.position_min,
                    position_max: joint.position_max,
                    range_slack: PATH_SLACK_SHARE * range_slack(joint),
                    speed_max: joint.speed_max * share,
                    acceleration_max: joint.acceleration_max * share,
                    jerk_max: joint.jerk_max * share,
                })
                .collect(),
            pair: machine.motors.pair.as_ref().map(|pair| PairLimit {
                joints: pair.joints.map(usize::from),
                motor: JointLimit {
                    rotary: false,
                    position_min: f64::NEG_INFINITY,
                    position_max: f64::INFINITY,
                    range_slack: 0.0,
                    speed_max: pair.speed_max * share,
                    acceleration_max: pair.acceleration_max * share,
                    jerk_max: pair.jerk_max * share,
                },
            }),
            tip_speed_mm_s: tip_speed_mm_s * share,
            asked_mm_s: Vec::new(),
            tip_acceleration_mm_s2: settings.tip_acceleration_mm_s2 * share,
            flow_max_mm3_s: settings.flow_max_mm3_s * share,
            flow_rate_of_change_max_mm3_s2: settings.flow_rate_of_change_max_mm3_s2 * share,
            extruder_speed_max_mm3_s: speed_max_mm3_s * share,
            extruder_acceleration_max_mm3_s2: acceleration_max_mm3_s2 * share,
            pressure_advance_s: extruder.pressure_advance_s,
            advance_bend_s2_mm3: machine
                .curves
                .advance_bounds()
                .map_or(0.0, |[_, bend]| bend),
            pressure_advance_window_s: (extruder.pressure_advance_window_ms * 1e-3)
                .max(1.0 / servo_hz),
            advance_delay_ticks: advance_centre_ticks(extruder, machine.servo_hz),
            servo_hz,
            unit_mm: settings.aperture.unit_mm(),
            units,
        };
        limits.checked(count)
    }

    fn checked(self, joint_count: usize) -> Result<Self, MotionError> {
        let mut named = vec![
            ("plan_share or tip speed", self.tip_speed_mm_s),
            ("tip acceleration", self.tip_acceleration_mm_s2),
            ("flow", self.flow_max_mm3_s),
            ("flow rate of change", self.flow_rate_of_change_max_mm3_s2),
            ("extruder speed", self.extruder_speed_max_mm3_s),
            (
                "extruder acceleration",
                self.extruder_acceleration_max_mm3_s2,
            ),
            ("servo rate", self.servo_hz),
        ];
        let motor = self.pair.as_ref().map(|pair| &pair.motor);
        for joint in self.joints.iter().chain(motor) {
            named.push(("joint speed", joint.speed_max));
            named.push(("joint acceleration", joint.acceleration_max));
            named.push(("joint jerk", joint.jerk_max));
        }
        if self.joints.len() < joint_count {
            return Err(bad_limit("number of joints"));
        }
        match named
            .into_iter()
            .find(|(_, value)| !(value.is_finite() && *value > 0.0))
        {
            Some((name, _)) => Err(bad_limit(name)),
            None => Ok(self),
        }
    }

    /// Everything with limits of speed, acceleration and jerk: joints in order, then the motors of a pair, each with
    /// its derivatives computed from those of the joints.
    pub fn bounded<'a, const N: usize>(
        &'a self,
        of_joints: [&'a [f64; JOINTS_MAX]; N],
    ) -> impl Iterator<Item = (&'a JointLimit, [f64; N])> {
        let joints = self.joints.iter().enumerate();
        let joints = joints.map(move |(joint, limit)| (limit, of_joints.map(|of| of[joint])));
        let motors = self.pair.iter().flat_map(move |pair| {
            let [a, b] = pair.joints;
            let motor = move |sign: f64| of_joints.map(|of| of[a] + sign * of[b]);
            [1.0, -1.0].map(|sign| (&pair.motor, motor(sign)))
        });
        joints.chain(motors)
    }

    /// The same on a coarser clock, of which one tick has several servo ticks. The pressure advance is then
    /// averaged over at least a tick of it.
    pub fn on_coarse_ticks(&self, coarse: u16) -> MotionLimits {
        let servo_hz = self.servo_hz / f64::from(coarse);
        MotionLimits {
            servo_hz,
            pressure_advance_window_s: self.pressure_advance_window_s.max(1.0 / servo_hz),
            advance_delay_ticks: self.advance_delay_ticks / u32::from(coarse),
            ..self.clone()
        }
    }

    /// Tip speed at a place of the path, mm/s.
    pub fn tip_speed_at_mm_s(&self, u: f64) -> f64 {
        let after = self.asked_mm_s.partition_point(|[at, _]| *at <= u);
        let ends = (
            after.checked_sub(1).map(|before| self.asked_mm_s[before]),
            self.asked_mm_s.get(after),
        );
        let asked_mm_s = match ends {
            (Some([from, slow]), Some([to, fast])) => {
                slow + (fast - slow) * (u - from) / (to - from)
            }
            (Some([_, only]), None) | (None, Some(&[_, only])) => only,
            (None, None) => f64::INFINITY,
        };
        self.tip_speed_mm_s.min(asked_mm_s)
    }

    /// The slowest of them.
    pub fn slowest_tip_mm_s(&self) -> f64 {
        let asked = self.asked_mm_s.iter().map(|[_, speed]| *speed);
        asked.fold(self.tip_speed_mm_s, f64::min)
    }

    /// Tip speeds at the ticks of a motion along the path; empty if none are requested.
    pub fn asked_at_ticks(&self, u_at_tick: &[f64]) -> Vec<f64> {
        if self.asked_mm_s.is_empty() {
            return Vec::new();
        }
        let at = |u: &f64| self.tip_speed_at_mm_s(*u);
        u_at_tick.iter().map(at).collect()
    }

    /// The one at a share of the motion's time.
    pub fn tip_speed_at_share_mm_s(&self, asked_at_tick: &[f64], share: f64) -> f64 {
        let last = asked_at_tick.len().saturating_sub(1);
        let tick = (share * last as f64).round() as usize;
        let asked = asked_at_tick.get(tick.min(last)).copied();
        asked.unwrap_or(self.tip_speed_mm_s)
    }

    /// Largest flow, the extruder's rate including the full pressure advance, mm³/s.
    pub fn flow_rate_max_mm3_s(&self) -> f64 {
        let of_extruder = self.extruder_speed_max_mm3_s / (1.0 + self.advance_ratio());
        self.flow_max_mm3_s.min(of_extruder)
    }

    /// Largest change of flow, mm³/s²: pressure advance multiplies it by 1 + K/W at its start in the
    /// window, and a K that changes with flow adds dK/dq times its square; the end of the window is covered by the
    /// check of the finished segments.
    pub fn flow_slope_max_mm3_s2(&self) -> f64 {
        let (most, times) = (
            self.extruder_acceleration_max_mm3_s2,
            1.0 + self.advance_ratio(),
        );
        // The root of times x + bend x² = most, written so that no bend is no division by 0.
        let root = (times * times + 4.0 * self.advance_bend_s2_mm3 * most).sqrt();
        let of_extruder = 2.0 * most / (times + root);
        self.flow_rate_of_change_max_mm3_s2.min(of_extruder)
    }

    /// K / W: the immediate contribution of a change of flow to the extruder's rate.
    pub fn advance_ratio(&self) -> f64 {
        self.pressure_advance_s / self.pressure_advance_window_s
    }
}

/// Joint positions and derivatives by the parameter of their channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointPoint {
    /// mm or rad.
    pub position: [f64; JOINTS_MAX],
    /// First derivative.
    pub first: [f64; JOINTS_MAX],
    /// Second derivative.
    pub second: [f64; JOINTS_MAX],
    /// Third derivative.
    pub third: [f64; JOINTS_MAX],
}

/// The tip's channels.
pub fn tip_mm(value: &[f64; CHANNELS]) -> [f64; 3] {
    [value[CHANNEL_X], value[CHANNEL_Y], value[CHANNEL_Z]]
}

/// Joint motion of a channel motion, by its Taylor coefficients: exact except for rounding. Joints
/// that wind are within half a turn.
pub fn joint_point(kinematics: &Kinematics, point: &CurvePoint) -> Result<JointPoint, MotionError> {
    let channels: [Jet<f64, 4>; CHANNELS] = std::array::from_fn(|c| {
        let (second, third) = (point.second[c] / 2.0, point.third[c] / 6.0);
        Jet([point.value[c], point.first[c], second, third])
    });
    let added = kinematics::remainder(kinematics, &Pose::from_channels(&channels));
    let mut jets = added.map_err(|error| no_pose(error, tip_mm(&point.value)))?;
    for (jet, joint_channel) in jets.iter_mut().zip(kinematics::joint_channels(kinematics)) {
        if let Some(channel) = *joint_channel {
            *jet += channels[channel];
        }
    }
    Ok(JointPoint {
        position: jets.map(|jet| jet.0[0]),
        first: jets.map(|jet| jet.0[1]),
        second: jets.map(|jet| 2.0 * jet.0[2]),
        third: jets.map(|jet| 6.0 * jet.0[3]),
    })
}

/// Share of the controller's tolerance beyond the ends of a range that the path may use: the other half is for
/// the fit and for rounding to wire units.
const PATH_SLACK_SHARE: f64 = 0.5;

/// Fails where a joint is outside its range; `positions` with their turns.
pub fn check_range(
    limits: &MotionLimits,
    at_mm: [f64; 3],
    positions: &[f64; JOINTS_MAX],
) -> Result<(), MotionError> {
    for (joint, limit) in limits.joints.iter().enumerate() {
        let position = positions[joint];
        let inside = position >= limit.position_min - limit.range_slack
            && position <= limit.position_max + limit.range_slack;
        if !inside {
            return Err(outside_range(limits, joint, position, at_mm));
        }
    }
    Ok(())
}

/// The error of a joint that would be at `position`, mm or rad.
pub fn outside_range(
    limits: &MotionLimits,
    joint: usize,
    position: f64,
    at_mm: [f64; 3],
) -> MotionError {
    let range = limits.joints.get(joint);
    let names = joint_names(&limits.kinematics);
    MotionError::OutsideJointRange {
        joint,
        name: names.get(joint).copied().unwrap_or("?"),
        rotary: range.is_some_and(|limit| limit.rotary),
        position,
        minimum: range.map_or(f64::NAN, |limit| limit.position_min),
        maximum: range.map_or(f64::NAN, |limit| limit.position_max),
        at_mm,
    }
}

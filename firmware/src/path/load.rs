//! Demands of a span on the joints, for the time warp: computed once per knot, on reception.
//!
//! With segment time u, path rate sigma and q(u) a joint: acceleration = sigma² q'' + sigma' q'.
//! alpha = max |q''| / A and beta = max |q'| / A over all joints and the extruder bound the slope
//! that is always safe: |sigma'| <= (1 - alpha sigma²) / beta. Units: servo ticks.

use crate::configuration::motors::MotorPair;
use crate::configuration::{
    ExtruderConfiguration, JOINTS_MAX, JointConfiguration, Kinematics, MachineConfiguration,
};
use crate::design::{CEILING_OPEN, LIMIT_MARGIN, LOAD_ALPHA_MAX, LOAD_BETA_MIN_TICKS, WARP_ROOM};
use crate::flow::extruder_limits::event_ratio;
use crate::kinematics::pose::Pose;
use crate::kinematics::winding::Winding;
use crate::kinematics::{self, KinematicsError, Model};
use crate::numbers::jet::Jet;
use crate::numbers::real::{Real, smaller};
use crate::path::joint_channels::natural_of;
use crate::path::spline::{SpanPolynomial, SpanWindow};
use headway_protocol::segment::FlowEvent;
use headway_protocol::units::{CHANNEL_VOLUME, CHANNELS, ChannelPoint, Units};
use nalgebra::{Vector2, Vector3};

/// Demands of one span.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpanLoad {
    /// max |q''| / A, at most [`LOAD_ALPHA_MAX`].
    pub alpha: f32,
    /// max |q'| / A in ticks, at least [`LOAD_BETA_MIN_TICKS`].
    pub beta_ticks: f32,
    /// Largest sigma² that keeps every joint within its full limits.
    pub rate_squared_max: f32,
}

impl SpanLoad {
    /// Nothing moves: any rate, any slope.
    pub const REST: Self = Self {
        alpha: 0.0,
        beta_ticks: LOAD_BETA_MIN_TICKS,
        rate_squared_max: CEILING_OPEN,
    };
}

/// Why a span cannot be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpanFault {
    /// A pose in it has no joint positions.
    Kinematics(KinematicsError),
    /// A joint would leave its range: joint, position in 0.1 µm or µrad.
    SoftLimit(u8, i32),
    /// A motor would exceed its speed or acceleration: motor, thousandths of its limit.
    Limit(u8, i32),
}

/// Largest share of the extruder's acceleration that the plan is believed to use by itself. The gain
/// of pressure advance is a bound that hardly any plan reaches: used in full it could leave no slope
/// to stop with, and hold up a valid plan.
const EXTRUDER_ALPHA_MAX: f32 = 0.7;

/// Most that a joint may be beyond an end of its range, mm or rad: the tolerance of a fitted path, 1 µm, and more
/// than that of its angles, 0.1 mrad.
const RANGE_SLACK_MAX: f64 = 1e-3;

/// Distance beyond the ends of its range at which a joint's position still counts as the end, mm or rad: half a
/// step, which is no difference for a motor. Interpolation and rounding put a path exactly along the end on either
/// side of it.
pub fn range_slack(joint: &JointConfiguration) -> f64 {
    (0.5 / joint.steps_per_unit).min(RANGE_SLACK_MAX)
}

/// Limits of one joint in servo ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct JointLimit {
    per_acceleration: f32,
    per_speed: f32,
    position_min: f32,
    position_max: f32,
    range_slack: f32,
    units_per_natural: f32,
}

impl JointLimit {
    fn new(joint: &JointConfiguration, servo_hz: f64) -> Self {
        Self {
            per_acceleration: (servo_hz * servo_hz / joint.acceleration_max) as f32,
            per_speed: (servo_hz / joint.speed_max) as f32,
            position_min: joint.position_min as f32,
            position_max: joint.position_max as f32,
            range_slack: range_slack(joint) as f32,
            units_per_natural: if joint.rotary { 1e6 } else { 1e4 },
        }
    }
}

/// Limits of the complete machine, precomputed.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadModel {
    kinematics: Kinematics,
    ranges: [[f64; 2]; JOINTS_MAX],
    limits: [JointLimit; JOINTS_MAX],
    /// Motors that two joints move together, and their limits in ticks.
    pair: Option<(MotorPair, JointLimit)>,
    extruder_per_acceleration: f32,
    extruder_per_speed: f32,
    /// How much the extruder's acceleration grows through pressure advance: with V'' of now and of
    /// a window ago, e'' = V'' + K / W (V'' - V''(t - W)), at most 1 + 2 K / W of the largest.
    advance_gain: f32,
    /// The same of its rate: V' + K / W (V' - V'(t - W)) with a flow that has just begun.
    advance_rate_gain: f32,
    extruder: ExtruderConfiguration,
    servo_hz: f64,
    /// Units of the stream, and what each is in mm, rad and mm³.
    units: Units,
    natural: [f32; CHANNELS],
}

/// The largest demands of the evaluated joints and motors.
struct Demand {
    alpha: f32,
    beta: f32,
    speed: f32,
}

impl Default for Demand {
    fn default() -> Self {
        Self {
            alpha: 0.0,
            beta: LOAD_BETA_MIN_TICKS,
            speed: 0.0,
        }
    }
}

impl Demand {
    #[inline(always)]
    fn take(
        &mut self,
        motor: usize,
        limit: &JointLimit,
        rate: f32,
        acceleration: f32,
    ) -> Result<(), SpanFault> {
        let alpha = acceleration.abs() * limit.per_acceleration;
        let speed = rate.abs() * limit.per_speed;
        check_limit(motor, alpha.larger(speed))?;
        self.alpha = self.alpha.larger(alpha);
        self.speed = self.speed.larger(speed);
        self.beta = self.beta.larger(rate.abs() * limit.per_acceleration);
        Ok(())
    }

    /// The two motors of a pair: by the sum of its joints and by their difference.
    #[inline(never)]
    fn take_pair(
        &mut self,
        pair: &MotorPair,
        limit: &JointLimit,
        state: &JointState,
    ) -> Result<(), SpanFault> {
        let [a, b] = pair.joints.map(|joint| usize::from(joint) % JOINTS_MAX);
        for (motor, sign) in [(a, 1.0), (b, -1.0)] {
            let sum = |derivative: usize| state[a][derivative] + sign * state[b][derivative];
            self.take(motor, limit, sum(1), sum(2))?;
        }
        Ok(())
    }
}

/// Position, rate and acceleration of one joint at one place of a span, mm or rad and ticks.
type JointState = [[f32; 3]; JOINTS_MAX];

impl LoadModel {
    /// From the machine's configuration.
    pub fn new(configuration: &MachineConfiguration) -> Self {
        let servo_hz = f64::from(configuration.servo_hz);
        let mut limits = [JointLimit::default(); JOINTS_MAX];
        for (limit, joint) in limits.iter_mut().zip(&configuration.joints) {
            *limit = JointLimit::new(joint, servo_hz);
        }
        let extruder = &configuration.extruder;
        let [speed_max_mm3_s, acceleration_max_mm3_s2] = configuration.arriving_limits();
        let window_s = (extruder.pressure_advance_window_ms * 1e-3).max(1.0 / servo_hz);
        Self {
            kinematics: configuration.kinematics,
            ranges: configuration.ranges(),
            limits,
            pair: configuration.motors.pair.map(|pair| {
                let limit = JointLimit {
                    per_acceleration: (servo_hz * servo_hz / pair.acceleration_max) as f32,
                    per_speed: (servo_hz / pair.speed_max) as f32,
                    ..JointLimit::default()
                };
                (pair, limit)
            }),
            extruder_per_acceleration: (servo_hz * servo_hz / acceleration_max_mm3_s2) as f32,
            extruder_per_speed: (servo_hz / speed_max_mm3_s) as f32,
            advance_gain: (1.0 + 2.0 * extruder.pressure_advance_s / window_s) as f32,
            advance_rate_gain: (1.0 + extruder.pressure_advance_s / window_s) as f32,
            extruder: *extruder,
            servo_hz,
            units: Units::BASE,
            natural: natural_of(&Units::BASE),
        }
    }

    /// Takes these units from now on: at the start of a stream.
    pub fn take_units(&mut self, units: &Units) {
        self.units = *units;
        self.natural = natural_of(units);
    }

    /// Checks a prime or retract by itself.
    ///
    /// # Errors
    /// [`SpanFault::Limit`] where the extruder cannot follow.
    pub fn check_event(&self, event: &FlowEvent) -> Result<(), SpanFault> {
        let volume_mm3 = f64::from(event.volume_units) / self.units.per_natural(CHANNEL_VOLUME);
        let duration_s = f64::from(event.duration_ticks.0) / self.servo_hz;
        let ratio = event_ratio(&self.extruder, volume_mm3, duration_s);
        check_limit(kinematics::joint_count(&self.kinematics), ratio as f32)
    }

    /// Takes this joint solution from now on: at the start of a stream.
    pub fn take_solution(&mut self, solution: u8) {
        self.kinematics = self.kinematics.with_solution(solution);
    }

    /// Turns of the joints at rest on `start`; none if it has no joint positions.
    pub fn winding_at(&self, start: &ChannelPoint) -> Winding<f32> {
        let mut natural = [0.0; CHANNELS];
        for channel in 0..CHANNELS {
            natural[channel] = start[channel] as f32 / self.units.per_natural(channel) as f32;
        }
        let joints = kinematics::remainder(&self.kinematics, &Pose::from_channels(&natural));
        joints.map_or_else(
            |_| Winding::default(),
            |joints| Winding::at_rest(&self.kinematics, &joints, &self.ranges),
        )
    }

    /// Demands of the window's newest span. `winding` has the joints' turns at its start, and
    /// afterwards at its end.
    ///
    /// # Errors
    /// See [`SpanFault`].
    #[inline(never)]
    pub fn of_span(
        &self,
        window: &SpanWindow,
        winding: &mut Winding<f32>,
    ) -> Result<SpanLoad, SpanFault> {
        if window.is_rest() {
            return Ok(SpanLoad::REST);
        }
        let polynomial = window.polynomial::<f32>();
        let ticks = f32::from(window.duration_ticks());
        let states = self.joint_states(window, &polynomial, ticks, winding)?;
        let count = kinematics::joint_count(&self.kinematics);
        let mut demand = Demand::default();
        for state in &states {
            for (joint, limit) in self.limits.iter().enumerate().take(count) {
                let [position, rate, acceleration] = state[joint];
                check_range(joint, limit, position)?;
                demand.take(joint, limit, rate, acceleration)?;
            }
            if let Some((pair, limit)) = &self.pair {
                demand.take_pair(pair, limit, state)?;
            }
        }
        let Demand {
            mut alpha,
            mut beta,
            mut speed,
        } = demand;
        let natural = self.natural[CHANNEL_VOLUME];
        let flow = polynomial.rate_bound[CHANNEL_VOLUME] * natural;
        let per_acceleration = natural * self.extruder_per_acceleration * self.advance_gain;
        // Linear within a span: largest at one of its ends.
        let bend = polynomial.acceleration(0.0)[CHANNEL_VOLUME]
            .abs()
            .larger(polynomial.acceleration(ticks)[CHANNEL_VOLUME].abs());
        let bend_share = bend * natural * self.extruder_per_acceleration;
        let rates = [0.0, 0.5 * ticks, ticks].map(|t| polynomial.rate(t)[CHANNEL_VOLUME].abs());
        let rate = rates.into_iter().fold(0.0, Real::larger) * natural;
        check_limit(count, bend_share.larger(rate * self.extruder_per_speed))?;
        alpha = alpha.larger(smaller(bend * per_acceleration, EXTRUDER_ALPHA_MAX));
        beta = beta.larger(polynomial.rate_bound[CHANNEL_VOLUME] * per_acceleration);
        speed = speed.larger(flow * self.extruder_per_speed * self.advance_rate_gain);
        Ok(SpanLoad::bounded(alpha, beta, speed))
    }

    /// Joints at start, middle and end of a span, with their exact derivatives: what a tilting head
    /// makes of a channel may cancel most of the channel itself.
    #[inline(never)]
    fn joint_states(
        &self,
        window: &SpanWindow,
        polynomial: &SpanPolynomial<f32>,
        ticks: f32,
        winding: &mut Winding<f32>,
    ) -> Result<[JointState; 3], SpanFault> {
        let winds = kinematics::winds(&self.kinematics);
        let model: Model<Jet<f32, 3>> = Model::new(&self.kinematics);
        let mut states = [[[0.0f32; 3]; JOINTS_MAX]; 3];
        for (state, t) in states.iter_mut().zip([0.0, 0.5 * ticks, ticks]) {
            let channels = channel_jets(window, polynomial, t, &self.natural);
            let remainder = model.remainder(&Pose::from_channels(&channels));
            let remainder = remainder.map_err(SpanFault::Kinematics)?;
            let joint_channels = kinematics::joint_channels(&self.kinematics);
            let parts = state
                .iter_mut()
                .zip(remainder)
                .zip(joint_channels)
                .enumerate();
            for (index, ((slot, mut joint), joint_channel)) in parts {
                if winds >> index & 1 != 0 {
                    let turns = winding.follow(index, joint.value());
                    joint.0[0] += turns as f32 * core::f32::consts::TAU;
                }
                if let Some(channel) = joint_channel.and_then(|channel| channels.get(channel)) {
                    joint += *channel;
                }
                let Jet([position, rate, half_acceleration]) = joint;
                *slot = [position, rate, 2.0 * half_acceleration];
            }
        }
        Ok(states)
    }
}

/// The channels at a place of a span, mm, rad, mm³ and ticks.
#[inline(never)]
fn channel_jets(
    window: &SpanWindow,
    polynomial: &SpanPolynomial<f32>,
    t: f32,
    natural: &[f32; CHANNELS],
) -> [Jet<f32, 3>; CHANNELS] {
    let (offset, rate) = (polynomial.offset(t), polynomial.rate(t));
    let acceleration = polynomial.acceleration(t);
    let base = window.base();
    let mut channels = [Jet([0.0; 3]); CHANNELS];
    for (channel, jet) in channels.iter_mut().enumerate() {
        let natural = natural[channel];
        *jet = Jet([
            (single_of(base[channel]) + offset[channel]) * natural,
            rate[channel] * natural,
            0.5 * acceleration[channel] * natural,
        ]);
    }
    channels
}

impl SpanLoad {
    /// From the largest demands found; `speed` is max |q'| / v_max.
    fn bounded(alpha: f32, beta_ticks: f32, speed: f32) -> Self {
        let alpha = if alpha < LOAD_ALPHA_MAX {
            alpha
        } else {
            LOAD_ALPHA_MAX
        };
        let mut rate_squared_max = CEILING_OPEN;
        if alpha * rate_squared_max > WARP_ROOM {
            rate_squared_max = WARP_ROOM / alpha;
        }
        if speed * speed * rate_squared_max > 1.0 {
            rate_squared_max = 1.0 / (speed * speed);
        }
        Self {
            alpha,
            beta_ticks,
            // The plan itself is always allowed: it was checked exactly, this is an estimate.
            rate_squared_max: rate_squared_max.larger(1.0),
        }
    }
}

/// An i64 as f32 in two halves: the direct conversion is slow software on a Cortex-M4F.
fn single_of(value: i64) -> f32 {
    let high = (value >> 16) as i32 as f32;
    high * 65_536.0 + (value & 0xffff) as i32 as f32
}

/// The pose as far as remainders need it: the tilt, from its integer part and an offset in µrad.
/// They are scaled separately, so that no resolution is lost.
#[inline]
pub(crate) fn tilt_pose(tilt_base: [i32; 2], offset: [f32; 2]) -> Pose<f32> {
    const NATURAL: f32 = 1e-6;
    let tilt = |base: i32, offset: f32| base as f32 * NATURAL + offset * NATURAL;
    Pose {
        tip_mm: Vector3::new(0.0, 0.0, 0.0),
        tilt_rad: Vector2::new(tilt(tilt_base[0], offset[0]), tilt(tilt_base[1], offset[1])),
        heading_rad: 0.0,
    }
}

fn check_limit(motor: usize, ratio: f32) -> Result<(), SpanFault> {
    // Written so that a NaN is refused.
    if ratio <= LIMIT_MARGIN as f32 {
        Ok(())
    } else {
        Err(SpanFault::Limit(motor as u8, (ratio * 1000.0) as i32))
    }
}

fn check_range(joint: usize, limit: &JointLimit, position: f32) -> Result<(), SpanFault> {
    // f32 is coarser than half a step far from the origin; the servo checks exactly.
    let slack = limit.range_slack + 1e-6 * (1.0 + position.abs());
    // Written so that a NaN is refused.
    let inside = position >= limit.position_min - slack && position <= limit.position_max + slack;
    if inside {
        Ok(())
    } else {
        let units = (position * limit.units_per_natural) as i32;
        Err(SpanFault::SoftLimit(joint as u8, units))
    }
}

#[cfg(test)]
mod tests {
    //! Goal: loads are the shares of the limits that a span really uses. Method: spans of constant
    //! speed and acceleration with known answers.
    use super::*;
    use crate::configuration::ExtruderConfiguration;
    use crate::configuration::flow_curves::FlowCurves;
    use crate::configuration::motors::MotorMatrix;
    use crate::configuration::shaping::UNSHAPED;
    use headway_protocol::segment::Knot;

    fn configuration() -> MachineConfiguration {
        let joint = JointConfiguration {
            rotary: false,
            steps_per_unit: 80.0,
            position_min: -100.0,
            position_max: 100.0,
            speed_max: 200.0,
            acceleration_max: 3000.0,
            jerk_max: 1e6,
        };
        MachineConfiguration {
            kinematics: Kinematics::Planar,
            joints: core::iter::repeat_n(joint, 4).collect(),
            shapers: UNSHAPED,
            extruder: ExtruderConfiguration {
                steps_per_mm3: 400.0,
                speed_max_mm3_s: 50.0,
                acceleration_max_mm3_s2: 1000.0,
                pressure_advance_s: 0.0,
                pressure_advance_window_ms: 40.0,
            },
            servo_hz: 2000,
            step_hz: 200_000,
            motors: MotorMatrix::DIRECT,
            curves: FlowCurves::NONE,
        }
    }

    /// A window over uniform 10-tick spans of x = x0 + v t + a t² / 2 (mm, s).
    fn window(x0: f64, v: f64, a: f64) -> SpanWindow {
        let control = |i: i32| {
            // The control points of a parabola lie a h² / 6 below it.
            let t = f64::from(i) * 0.005;
            let x = x0 + v * t + a * t * t / 2.0 - a * 0.005 * 0.005 / 6.0;
            [(x * 1e4).round() as i32, 0, 0, 0, 0, 0, 0]
        };
        let mut window = SpanWindow::at_rest(&control(0));
        for i in 1..9 {
            window.push(&Knot {
                control: control(i),
                duration_ticks: 10,
            });
        }
        window
    }

    #[test]
    fn loads_are_shares_of_the_limits() {
        let model = LoadModel::new(&configuration());
        let load = model
            .of_span(&window(0.0, 60.0, 0.0), &mut Winding::default())
            .unwrap();
        // 60 mm/s over 3000 mm/s² is 20 ms, 40 ticks.
        assert!((load.beta_ticks - 40.0).abs() < 0.2, "{load:?}");
        assert!(load.alpha < 0.01, "{load:?}");
        let load = model
            .of_span(&window(0.0, 0.0, 1500.0), &mut Winding::default())
            .unwrap();
        assert!((load.alpha - 0.5).abs() < 0.02, "{load:?}");
        let load = model
            .of_span(&window(0.0, 160.0, 0.0), &mut Winding::default())
            .unwrap();
        // Override up to 200 / 160.
        assert!((load.rate_squared_max - 1.5625).abs() < 0.02, "{load:?}");
    }

    #[test]
    fn spans_out_of_range_and_absurd_ones_are_refused() {
        let model = LoadModel::new(&configuration());
        let beyond = model.of_span(&window(99.0, 60.0, 0.0), &mut Winding::default());
        assert!(matches!(beyond, Err(SpanFault::SoftLimit(0, units)) if units > 1_000_000));
        // The end belongs to the range, and so does what half a step leaves open: 1 µm at 80 steps a mm.
        let ends_at = |end_mm: f64| {
            // The newest span ends on the seventh control point.
            let way = window(end_mm - 7.0 * 60.0 * 0.005, 60.0, 0.0);
            model.of_span(&way, &mut Winding::default())
        };
        assert!(ends_at(100.0009).is_ok());
        let beyond = ends_at(100.0015);
        assert!(
            matches!(beyond, Err(SpanFault::SoftLimit(0, _))),
            "{beyond:?}"
        );
        // 4 % above the limit is what differences of short spans may make of a plan.
        assert!(
            model
                .of_span(&window(0.0, 208.0, 0.0), &mut Winding::default())
                .is_ok()
        );
        for (v, a) in [(212.0, 0.0), (400.0, 0.0), (0.0, 3200.0)] {
            let refused = model.of_span(&window(0.0, v, a), &mut Winding::default());
            assert!(
                matches!(refused, Err(SpanFault::Limit(0, permille)) if permille > 1050),
                "{refused:?}"
            );
        }
    }

    /// Goal: on a tilting head what the pivot does and what the tip does cancel, and the load is what is
    /// left. Method: the head nods about a pivot at rest, so that Z hardly moves although both of its
    /// parts do; the load against the joints' second differences in double precision.
    #[test]
    fn parts_of_a_joint_that_cancel_are_not_added_up() {
        let pivot_length_mm = 60.0;
        let mut configuration = configuration();
        configuration.kinematics = Kinematics::Gantry { pivot_length_mm };
        let (linear, rotary) = (
            configuration.joints[0],
            JointConfiguration {
                rotary: true,
                acceleration_max: 1e4,
                speed_max: 100.0,
                ..configuration.joints[0]
            },
        );
        configuration.joints = [linear, linear, linear, rotary, rotary, rotary]
            .into_iter()
            .collect();
        let model = LoadModel::new(&configuration);
        // 0.8 rad to either side, 0.25 s a period: the tip accelerates by some 25 m/s².
        let control = |i: i32| {
            let nod = 0.8 * (f64::from(i) * 0.005 * core::f64::consts::TAU / 0.25).sin();
            let (x, z) = (
                -pivot_length_mm * nod.sin(),
                pivot_length_mm * (1.0 - nod.cos()),
            );
            [x * 1e4, 0.0, z * 1e4, 0.0, nod * 1e6, 0.0, 0.0].map(|v| v.round() as i32)
        };
        let mut window = SpanWindow::at_rest(&control(0));
        let mut looked = 0;
        for i in 1..100 {
            window.push(&Knot {
                control: control(i),
                duration_ticks: 10,
            });
            let joint_channel = window.polynomial::<f64>().acceleration(0.0)[0].abs() * 4e6 * 1e-4;
            if i > 8 && joint_channel > 1.6 * 3000.0 {
                let load = model.of_span(&window, &mut Winding::default()).unwrap();
                assert!(
                    load.alpha < 0.2,
                    "knot {i}: {load:?}, the tip alone {joint_channel} mm/s²"
                );
                looked += 1;
            }
        }
        assert!(looked > 20, "{looked}");
    }

    #[test]
    fn a_rest_loads_nothing() {
        let model = LoadModel::new(&configuration());
        let window = SpanWindow::at_rest(&[5; 7]);
        assert_eq!(
            model.of_span(&window, &mut Winding::default()),
            Ok(SpanLoad::REST)
        );
    }
}

//! A motion that shakes one joint with a rising frequency, to find where a frame rings.
//!
//! In: first and last frequency, the machine. Out: a stream without material: X back and forth, then Y, each a chirp
//! x(t) = A(t) sin(2π (f0 t + r t²/2)) that rises by r = 1 Hz a second, and the time of each frequency. Speed and
//! acceleration keep to the machine's limits; **the jerk does not**: within its limit a machine could not be shaken,
//! and the board checks speed and acceleration only. The curve is the B-spline of the wire format: its acceleration
//! is linear from knot to knot, so that second differences of the control points bound it. Not covered: the
//! measurement, which is made with an accelerometer or by eye.

use super::CalibrationError;
use super::error::{check_linear_joints, usage};
use crate::job::{Mark, MotionState, SegmentStream};
use crate::settings::Settings;
use headway_protocol::segment::{Knot, REST_TICKS};
use headway_protocol::units::{CHANNEL_X, CHANNEL_Z, CHANNELS, Units, to_units};
use std::f64::consts::TAU;

/// Rise, Hz per second: at a damping of 0.05 a frame at 40 Hz rings up in 0.1 s.
pub const RISE_HZ_S: f64 = 1.0;
/// Usual first and last frequency, Hz: frames of printers ring at 20 to 80.
const USUAL_HZ: [f64; 2] = [10.0, 100.0];
/// Permitted frequencies, Hz.
const ASKED_HZ: [f64; 2] = [5.0, 150.0];
/// Acceleration for each Hz, mm/s²: that of Klipper's test (`accel_per_hz`), whose speed stays the same.
const ACCELERATION_PER_HZ: f64 = 60.0;
/// Share of the joint's and the tip's limits.
const LIMIT_SHARE: f64 = 0.9;
/// Ticks of a span: four and a half spans of a period at 75 Hz and a servo of 2 kHz.
const SPAN_TICKS: u16 = 6;
/// Amplitude that is still made of steps, in steps.
const STEPS_LEAST: f64 = 1.0;
/// The amplitude grows and fades over this time, s.
const FADE_S: f64 = 0.5;
/// Rest between the joints, s.
const PAUSE_S: f64 = 1.0;
/// Height above the bed, mm.
const HEIGHT_MM: f64 = 10.0;

/// One joint's part.
#[derive(Clone, Debug, PartialEq)]
pub struct Shaken {
    /// The joint's name.
    pub joint: &'static str,
    /// When it begins, s from the job's start.
    pub begin_s: f64,
    /// When it ends.
    pub end_s: f64,
    /// Frequency at the beginning.
    pub from_hz: f64,
    /// Frequency at the end.
    pub to_hz: f64,
    /// Largest amplitude, mm.
    pub amplitude_mm: f64,
}

/// The complete motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// Its stream.
    pub stream: SegmentStream,
    /// X, then Y.
    pub shaken: Vec<Shaken>,
    /// Position of the tip before and after, machine coordinates, mm.
    pub at_mm: [f64; 3],
}

/// Shakes X and Y from one frequency to another.
///
/// # Errors
/// [`CalibrationError`]: frequencies that make no sense or no steps, a machine whose tip has no such joints.
pub fn sweep(
    [from, to]: [Option<f64>; 2],
    at_mm: Option<[f64; 3]>,
    settings: &Settings,
) -> Result<Sweep, CalibrationError> {
    let machine = &settings.machine;
    check_linear_joints(settings)?;
    let [low, high] = settings.work_area_mm;
    let middle = |axis: usize| 0.5 * (low[axis] + high[axis]);
    let at_mm = at_mm.unwrap_or([middle(0), middle(1), low[2] + HEIGHT_MM]);
    let mut highest_hz = ASKED_HZ[1];
    for axis in 0..2 {
        highest_hz = highest_hz.min(highest(&Shake::of(axis, settings)));
    }
    let from = from.unwrap_or(USUAL_HZ[0]);
    let to = to.unwrap_or(USUAL_HZ[1].min(highest_hz.floor()));
    if !(from < to && from >= ASKED_HZ[0] && to <= highest_hz) {
        return Err(usage!(
            "frequencies from {from} to {to} Hz: write --from below --to, both from {} to {} Hz; above that the \
             acceleration_max of X and Y allows less than a step to and fro",
            ASKED_HZ[0],
            highest_hz.floor()
        ));
    }
    let mut made = Making::at(at_mm);
    let servo_hz = f64::from(machine.servo_hz);
    let mut shaken = Vec::new();
    for (axis, joint) in ["x", "y"].into_iter().enumerate() {
        made.rest(PAUSE_S, servo_hz);
        let begin_s = made.ticks as f64 / servo_hz;
        let shake = Shake::of(axis, settings);
        let amplitude_mm = made.shake(&shake, [from, to]);
        shaken.push(Shaken {
            joint,
            begin_s,
            end_s: made.ticks as f64 / servo_hz,
            from_hz: from,
            to_hz: to,
            amplitude_mm,
        });
    }
    made.rest(PAUSE_S, servo_hz);
    Ok(Sweep {
        stream: made.stream(),
        shaken,
        at_mm,
    })
}

/// How hard one axis may be shaken.
struct Shake {
    axis: usize,
    acceleration_mm_s2: f64,
    speed_mm_s: f64,
    step_mm: f64,
    span_s: f64,
}

impl Shake {
    fn of(axis: usize, settings: &Settings) -> Shake {
        let joint = settings.machine.joints.get(axis);
        let of_joint = |value: fn(&headway_firmware::configuration::JointConfiguration) -> f64| {
            joint.map_or(f64::INFINITY, value)
        };
        let acceleration = of_joint(|joint| joint.acceleration_max);
        Shake {
            axis,
            acceleration_mm_s2: LIMIT_SHARE * acceleration.min(settings.tip_acceleration_mm_s2),
            speed_mm_s: LIMIT_SHARE * of_joint(|joint| joint.speed_max),
            step_mm: of_joint(|joint| joint.steps_per_unit).recip(),
            span_s: f64::from(SPAN_TICKS) / f64::from(settings.machine.servo_hz),
        }
    }

    /// Amplitude of the control points at a frequency, mm, and that of the curve.
    fn amplitudes_mm(&self, hz: f64) -> [f64; 2] {
        let acceleration = self.acceleration_mm_s2.min(ACCELERATION_PER_HZ * hz);
        let turn = TAU * hz * self.span_s;
        // Second and first differences of a sine's samples, and the curve's value between them.
        let by_acceleration = acceleration * self.span_s * self.span_s / (2.0 * (1.0 - turn.cos()));
        let by_speed = self.speed_mm_s * self.span_s / (2.0 * (0.5 * turn).sin());
        let control = by_acceleration.min(by_speed);
        [control, control * (2.0 + turn.cos()) / 3.0]
    }
}

/// The highest frequency whose amplitude still has steps.
fn highest(shake: &Shake) -> f64 {
    let mut hz = ASKED_HZ[0];
    while hz < ASKED_HZ[1] && shake.amplitudes_mm(hz + 0.5)[1] >= STEPS_LEAST * shake.step_mm {
        hz += 0.5;
    }
    hz
}

/// A stream that grows.
struct Making {
    at_mm: [f64; 3],
    control: Vec<[f64; 3]>,
    durations: Vec<u16>,
    ticks: u64,
    marks: Vec<Mark>,
}

impl Making {
    fn at(at_mm: [f64; 3]) -> Making {
        let mut made = Making {
            at_mm,
            control: Vec::new(),
            durations: Vec::new(),
            ticks: 0,
            marks: Vec::new(),
        };
        // The wire fixes the first two.
        made.push_rest(REST_TICKS);
        made.push_rest(REST_TICKS);
        made.mark(MotionState::Hold);
        made
    }

    fn push(&mut self, place: [f64; 3], ticks: u16) {
        self.control.push(place);
        self.durations.push(ticks);
        self.ticks += u64::from(ticks);
    }

    fn push_rest(&mut self, ticks: u16) {
        self.push(self.at_mm, ticks);
    }

    fn mark(&mut self, state: MotionState) {
        let start_tick = self.marks.last().map_or(0, |mark: &Mark| mark.end_tick);
        self.marks.push(Mark {
            start_tick,
            end_tick: self.ticks,
            state,
            layer: 0,
            pass: None,
        });
    }

    fn rest(&mut self, seconds: f64, servo_hz: f64) {
        let spans = 4;
        let ticks = (seconds * servo_hz / f64::from(spans)).round() as u16;
        (0..spans).for_each(|_| self.push_rest(ticks));
        self.mark(MotionState::Hold);
    }

    /// A chirp; gives its largest amplitude, mm.
    fn shake(&mut self, shake: &Shake, [from, to]: [f64; 2]) -> f64 {
        let length_s = (to - from) / RISE_HZ_S;
        let spans = (length_s / shake.span_s).round() as u32;
        let mut most_mm = 0.0f64;
        for span in 0..spans {
            // A control point shapes four spans, and represents their middle.
            let t_s = shake.span_s * f64::from(span + 2);
            let hz = from + RISE_HZ_S * t_s;
            let phase = TAU * (from * t_s + 0.5 * RISE_HZ_S * t_s * t_s);
            let left_s = shake.span_s * f64::from(spans - span);
            let fade = smooth(t_s / FADE_S) * smooth(left_s / FADE_S);
            let [control_mm, curve_mm] = shake.amplitudes_mm(hz);
            most_mm = most_mm.max(fade * curve_mm);
            let mut place = self.at_mm;
            place[shake.axis] += fade * control_mm * phase.sin();
            self.push(place, SPAN_TICKS);
        }
        // Three equal ones are a rest; the motion has faded by then.
        (0..3).for_each(|_| self.push_rest(SPAN_TICKS));
        self.mark(MotionState::Travel);
        most_mm
    }

    fn stream(self) -> SegmentStream {
        let units = |[x, y, z]: [f64; 3]| {
            let mut natural = [0.0; CHANNELS];
            natural[CHANNEL_X..=CHANNEL_Z].copy_from_slice(&[x, y, z]);
            to_units(&natural)
        };
        let knots = self
            .control
            .iter()
            .enumerate()
            .map(|(number, &place)| Knot {
                control: units(place),
                duration_ticks: self
                    .durations
                    .get(number + 2)
                    .copied()
                    .unwrap_or(REST_TICKS),
            });
        SegmentStream {
            start: units(self.at_mm),
            knots: knots.collect(),
            events: Vec::new(),
            marks: self.marks,
            solution: 0,
            units: Units::BASE,
        }
    }
}

/// From 0 to 1 without a jump of speed or acceleration.
fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 + x * (6.0 * x - 15.0))
}

impl Sweep {
    /// When each joint is at a frequency, s from the job's start.
    pub fn seconds_of(&self, hz: f64) -> Vec<f64> {
        let of = |shaken: &Shaken| shaken.begin_s + (hz - shaken.from_hz) / RISE_HZ_S;
        self.shaken.iter().map(of).collect()
    }
}

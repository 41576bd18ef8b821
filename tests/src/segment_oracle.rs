//! What a stream of segments does, seen by an evaluator of its own: de Boor's algorithm on the wire's
//! integers, f64. It shares no code with what it checks.

use headway::job::{MotionState, SegmentStream};
use headway::settings::Settings;

/// Base units a mm, rad or mm³.
pub const UNITS: [f64; 7] = [1e4, 1e4, 1e4, 1e6, 1e6, 1e6, 1e6];

/// Units of a stream a mm, rad or mm³.
pub fn units_of(stream: &SegmentStream) -> [f64; 7] {
    let units = stream.units;
    let [length, angle] = [units.length_exponent, units.angle_exponent];
    let exponents = [
        length,
        length,
        length,
        angle,
        angle,
        angle,
        units.volume_exponent,
    ];
    std::array::from_fn(|c| UNITS[c] / 2f64.powi(i32::from(exponents[c])))
}

/// The wire's spline with its derivatives, by de Boor.
pub struct Oracle {
    /// Knots in ticks; the first span of the stream is knots[3]..knots[4].
    knots: Vec<f64>,
    /// Control points of the curve and of its first and second derivatives (per tick).
    control: [Vec<[f64; 7]>; 3],
}

impl Oracle {
    pub fn new(stream: &SegmentStream) -> Self {
        let mut durations = vec![8.0, 8.0, 8.0, 8.0];
        durations.extend(
            stream
                .knots
                .iter()
                .map(|knot| f64::from(knot.duration_ticks)),
        );
        // durations[i] is span i - 2; span -3 only closes the knot vector of the first points.
        durations.insert(0, 8.0);
        let mut knots = vec![-24.0];
        for duration in durations {
            knots.push(knots[knots.len() - 1] + duration);
        }
        let mut last = stream.start;
        let mut unwrapped = last.map(i64::from);
        let mut control = vec![unwrapped.map(|v| v as f64); 3];
        for knot in &stream.knots {
            for c in 0..7 {
                unwrapped[c] += i64::from(knot.control[c].wrapping_sub(last[c]));
            }
            last = knot.control;
            control.push(unwrapped.map(|v| v as f64));
        }
        let units = units_of(stream);
        for point in &mut control {
            for c in 0..7 {
                point[c] /= units[c];
            }
        }
        let first = Self::derivative(&knots, &control, 3);
        let second = Self::derivative(&knots[1..], &first, 2);
        Self {
            knots,
            control: [control, first, second],
        }
    }

    fn derivative(knots: &[f64], control: &[[f64; 7]], degree: usize) -> Vec<[f64; 7]> {
        (1..control.len())
            .map(|i| {
                let width = knots[i + degree] - knots[i];
                std::array::from_fn(|c| degree as f64 * (control[i][c] - control[i - 1][c]) / width)
            })
            .collect()
    }

    /// Value (order 0) or derivative (1, 2) at `t` ticks, natural units and seconds.
    pub fn at(&self, t: f64, order: usize) -> [f64; 7] {
        let degree = 3 - order;
        let knots = &self.knots[order..];
        let control = &self.control[order];
        let span = knots
            .partition_point(|&k| k <= t)
            .saturating_sub(1)
            .clamp(degree, control.len() - 1);
        let mut d: Vec<[f64; 7]> = (0..=degree).map(|j| control[span - degree + j]).collect();
        for r in 1..=degree {
            for j in (r..=degree).rev() {
                let low = knots[span - degree + j];
                let high = knots[span + 1 + j - r];
                let alpha = (t - low) / (high - low);
                let earlier = d[j - 1];
                for (value, earlier) in d[j].iter_mut().zip(earlier) {
                    *value = (1.0 - alpha) * earlier + alpha * *value;
                }
            }
        }
        let hz = 2000f64.powi(order as i32);
        d[degree].map(|v| v * hz)
    }

    pub fn end_tick(&self) -> f64 {
        self.knots[self.control[0].len()]
    }
}

/// Worst ratios over the whole stream, by dense sampling.
#[derive(Debug, Default)]
pub struct Worst {
    pub joint_speed: f64,
    pub joint_acceleration: f64,
    pub tip_speed: f64,
    pub tip_acceleration: f64,
    pub flow: f64,
    pub flow_change: f64,
    pub extruder_speed: f64,
    pub extruder_acceleration: f64,
}

impl Worst {
    pub fn all(&self) -> f64 {
        self.joint_speed
            .max(self.joint_acceleration)
            .max(self.tip_speed)
            .max(self.tip_acceleration)
            .max(self.flow)
            .max(self.flow_change)
            .max(self.extruder_speed)
            .max(self.extruder_acceleration)
    }
}

fn norm3(v: &[f64; 7]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

/// Samples a planar machine's stream at `per_tick` places a tick.
pub fn sample_limits(stream: &SegmentStream, settings: &Settings, per_tick: usize) -> Worst {
    let oracle = Oracle::new(stream);
    let share = settings.plan_share;
    let mut worst = Worst::default();
    let channels = [0, 1, 2, 5];
    let extruder = &settings.machine.extruder;
    let advance = extruder.pressure_advance_s / (extruder.pressure_advance_window_ms * 1e-3);
    let window = extruder.pressure_advance_window_ms * 2.0;
    for mark in &stream.marks {
        let speed_max = match mark.state {
            MotionState::Travel => settings.travel_speed_mm_s,
            _ => settings.speed_mm_s,
        };
        for i in 0..=(mark.end_tick - mark.start_tick) * per_tick as u64 {
            let t = mark.start_tick as f64 + i as f64 / per_tick as f64;
            let (v, a) = (oracle.at(t, 1), oracle.at(t, 2));
            for (joint, &c) in settings.machine.joints.iter().zip(&channels) {
                let speed = v[c].abs() / (share * joint.speed_max);
                let acceleration = a[c].abs() / (share * joint.acceleration_max);
                worst.joint_speed = worst.joint_speed.max(speed);
                worst.joint_acceleration = worst.joint_acceleration.max(acceleration);
            }
            worst.tip_speed = worst.tip_speed.max(norm3(&v) / (share * speed_max));
            worst.tip_acceleration = worst
                .tip_acceleration
                .max(norm3(&a) / (share * settings.tip_acceleration_mm_s2));
            worst.flow = worst.flow.max(v[6] / (share * settings.flow_max_mm3_s));
            worst.flow_change = worst
                .flow_change
                .max(a[6].abs() / (share * settings.flow_rate_of_change_max_mm3_s2));
            // Everything but the advance waits for half its window.
            let middle = t - window / 2.0;
            let (mut rate, mut change) = (v[6], a[6]);
            if t >= window {
                let delayed = |order| oracle.at(middle, order)[6];
                rate = delayed(1) + advance * (v[6] - oracle.at(t - window, 1)[6]);
                change = delayed(2) + advance * (a[6] - oracle.at(t - window, 2)[6]);
            }
            let (event_rate, event_change) = event_rates(stream, middle);
            worst.extruder_speed = worst
                .extruder_speed
                .max((rate + event_rate).abs() / (share * extruder.speed_max_mm3_s));
            worst.extruder_acceleration = worst
                .extruder_acceleration
                .max((change + event_change).abs() / (share * extruder.acceleration_max_mm3_s2));
        }
    }
    worst
}

/// Rate and its change of all events at a tick, mm³/s and mm³/s².
fn event_rates(stream: &SegmentStream, t: f64) -> (f64, f64) {
    use headway_protocol::segment::FlowAction;
    let (mut rate, mut change) = (0.0, 0.0);
    for event in &stream.events {
        let mut start = f64::from(event.offset_ticks);
        for span in 0..event.span as usize {
            start += match span {
                0 | 1 => 8.0,
                _ => f64::from(stream.knots[span - 2].duration_ticks),
            };
        }
        let duration = f64::from(event.duration_ticks.0);
        let sign = if event.action == FlowAction::Prime {
            1.0
        } else {
            -1.0
        };
        let volume = sign * f64::from(event.volume_units) / units_of(stream)[6];
        let x = (t - start) / duration;
        if (0.0..=1.0).contains(&x) {
            let seconds = duration / 2000.0;
            rate += volume / seconds * (30.0 * x.powi(2) - 60.0 * x.powi(3) + 30.0 * x.powi(4));
            change += volume / seconds.powi(2) * (60.0 * x - 180.0 * x.powi(2) + 120.0 * x.powi(3));
        }
    }
    (rate, change)
}

/// Largest distance of the stream from its path's tip, heading taken along: (mm, rad), over
/// samples ten times finer than the servo tick.
pub fn worst_fit(stream: &SegmentStream, control: &[[f64; 7]]) -> (f64, f64) {
    // The path itself, densely, by the plain basis of the uniform spline.
    let last = control.len() - 1;
    let point = |i: isize, c: usize| {
        if i < 0 {
            2.0 * control[0][c] - control[1][c]
        } else if i as usize > last {
            2.0 * control[last][c] - control[last - 1][c]
        } else {
            control[i as usize][c]
        }
    };
    let path = |u: f64| -> [f64; 7] {
        let i = (u.floor() as isize).clamp(0, last as isize - 1);
        let s = u - i as f64;
        std::array::from_fn(|c| {
            let [p0, p1, p2, p3] = [-1, 0, 1, 2].map(|k| point(i + k, c));
            ((1.0 - s).powi(3) * p0
                + (3.0 * s.powi(3) - 6.0 * s * s + 4.0) * p1
                + (-3.0 * s.powi(3) + 3.0 * s * s + 3.0 * s + 1.0) * p2
                + s.powi(3) * p3)
                / 6.0
        })
    };
    let oracle = Oracle::new(stream);
    let mark = stream.marks[1];
    let (mut worst_mm, mut worst_rad) = (0.0f64, 0.0f64);
    let mut u = 0.0;
    // Tip and heading against the tolerances together: where the head turns on a spot, the tip
    // alone does not say how far along it is.
    let distance = |p: &[f64; 7], u: f64| {
        let q = path(u.clamp(0.0, last as f64));
        let tip = (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (p[2] - q[2]).powi(2);
        tip * 1e6 + (p[5] - q[5]).powi(2) / 4e-8
    };
    for i in 0..=(mark.end_tick - mark.start_tick) * 10 {
        let p = oracle.at(mark.start_tick as f64 + i as f64 / 10.0, 0);
        // The nearest place of the path never runs back: golden-section search ahead of it.
        let (mut low, mut high) = ((u - 0.05f64).max(0.0), (u + 0.4).min(last as f64));
        for _ in 0..60 {
            let (a, b) = (low + 0.382 * (high - low), low + 0.618 * (high - low));
            if distance(&p, a) < distance(&p, b) {
                high = b;
            } else {
                low = a;
            }
        }
        u = 0.5 * (low + high);
        let q = path(u);
        let tip = (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (p[2] - q[2]).powi(2);
        worst_mm = worst_mm.max(tip.sqrt());
        worst_rad = worst_rad.max((p[5] - q[5]).abs());
    }
    (worst_mm, worst_rad)
}

pub fn duration_s(stream: &SegmentStream) -> f64 {
    stream.marks[stream.marks.len() - 1].end_tick as f64 / 2000.0
}

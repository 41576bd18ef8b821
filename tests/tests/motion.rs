//! Goal: the finished segments keep every limit, the path and the rests (issue 2, point 5).
//! Method: routes of known shape are timed and fitted; an evaluator of our own (de Boor's algorithm
//! on the wire's integers, f64) looks at the result. It shares no code with what it checks.

use headway::job::{MotionState, SegmentStream};
use headway::plan::route::{PathCurve, Route, Stretch, StretchEvent};
use headway::plan::segments::lay_segments;
use headway::settings::Settings;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

const UNITS: [f64; 7] = [1e4, 1e4, 1e4, 1e6, 1e6, 1e6, 1e6];

/// The wire's spline with its derivatives, by de Boor.
struct Oracle {
    /// Knots in ticks; the first span of the stream is knots[3]..knots[4].
    knots: Vec<f64>,
    /// Control points of the curve and of its first and second derivatives (per tick).
    control: [Vec<[f64; 7]>; 3],
}

impl Oracle {
    fn new(stream: &SegmentStream) -> Self {
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
        for point in &mut control {
            for c in 0..7 {
                point[c] /= UNITS[c];
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
    fn at(&self, t: f64, order: usize) -> [f64; 7] {
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

    fn end_tick(&self) -> f64 {
        self.knots[self.control[0].len()]
    }
}

/// Worst ratios over the whole stream, by dense sampling.
#[derive(Debug, Default)]
struct Worst {
    joint_speed: f64,
    joint_acceleration: f64,
    tip_speed: f64,
    tip_acceleration: f64,
    flow: f64,
    flow_change: f64,
    extruder_speed: f64,
    extruder_acceleration: f64,
}

impl Worst {
    fn all(&self) -> f64 {
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
fn sample_limits(stream: &SegmentStream, settings: &Settings, per_tick: usize) -> Worst {
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
            let (mut rate, mut change) = (v[6], a[6]);
            if t >= window {
                rate += advance * (v[6] - oracle.at(t - window, 1)[6]);
                change += advance * (a[6] - oracle.at(t - window, 2)[6]);
            }
            let (event_rate, event_change) = event_rates(stream, t);
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
        let volume = sign * f64::from(event.volume_units) * 1e-6;
        let x = (t - start) / duration;
        if (0.0..=1.0).contains(&x) {
            let seconds = duration / 2000.0;
            rate += volume / seconds * (30.0 * x.powi(2) - 60.0 * x.powi(3) + 30.0 * x.powi(4));
            change += volume / seconds.powi(2) * (60.0 * x - 180.0 * x.powi(2) + 120.0 * x.powi(3));
        }
    }
    (rate, change)
}

fn moving(state: MotionState, control: Vec<[f64; 7]>) -> Stretch {
    Stretch {
        state,
        layer: 0,
        pass: (state == MotionState::Print).then_some(0),
        curve: PathCurve { control },
        dwell_s: 0.0,
        event: None,
    }
}

fn route_of(control: Vec<[f64; 7]>) -> Route {
    Route {
        stretches: vec![moving(MotionState::Print, control)],
    }
}

/// A polyline of x, y with the heading on the tangent, control points about `step_mm` apart,
/// a bead of 0.24 mm².
fn curve_through(points: impl Iterator<Item = (f64, f64, f64)>) -> Vec<[f64; 7]> {
    let mut control: Vec<[f64; 7]> = Vec::new();
    let mut volume = 0.0;
    for (x, y, heading) in points {
        if let Some(last) = control.last() {
            volume += 0.24 * (x - last[0]).hypot(y - last[1]);
        }
        control.push([x, y, 0.2, 0.0, 0.0, heading, volume]);
    }
    control
}

/// The gear of SPEC section 9: 20 lobes, slowly growing, nozzle on the tangent.
fn gear(length_mm: f64) -> Vec<[f64; 7]> {
    let radius = |t: f64| 20.0 + 0.8 * (20.0 * t).sin() + 0.45 * t / std::f64::consts::TAU;
    let mut points = Vec::new();
    let (mut t, mut along) = (0.0f64, 0.0);
    let mut heading_before: Option<f64> = None;
    while along < length_mm {
        let r = radius(t);
        let dr = 16.0 * (20.0 * t).cos() + 0.45 / std::f64::consts::TAU;
        let (sin, cos) = t.sin_cos();
        let mut heading = (dr * sin + r * cos).atan2(dr * cos - r * sin);
        if let Some(before) = heading_before {
            let turns = ((before - heading) / std::f64::consts::TAU).round();
            heading += turns * std::f64::consts::TAU;
        }
        heading_before = Some(heading);
        points.push((100.0 + r * cos, 100.0 + r * sin, heading));
        t += 0.1 / dr.hypot(r);
        along += 0.1;
    }
    curve_through(points.into_iter())
}

fn random_smooth(random: &mut Pcg32, count: usize) -> Vec<[f64; 7]> {
    let phases: Vec<(f64, f64, f64)> = (0..6)
        .map(|k| {
            (
                random.random_range(0.0..6.3),
                random.random_range(0.0..6.3),
                8.0 / f64::from(k + 1),
            )
        })
        .collect();
    let at = |s: f64| {
        let (mut x, mut y) = (100.0, 100.0);
        for (k, (p, q, size)) in phases.iter().enumerate() {
            x += size * (s * (k + 1) as f64 + p).cos();
            y += size * (s * (k + 1) as f64 + q).sin();
        }
        (x, y)
    };
    let turn: f64 = random.random_range(-3.0..3.0);
    curve_through((0..count).map(|i| {
        let s = 6.0 * i as f64 / count as f64;
        let (x, y) = at(s);
        (x, y, turn * (2.0 * s).sin())
    }))
}

fn zigzag(random: &mut Pcg32, corners: usize) -> Vec<[f64; 7]> {
    let mut points = vec![(100.0f64, 100.0f64)];
    for _ in 0..corners {
        let (x, y) = points[points.len() - 1];
        let angle: f64 = random.random_range(0.0..std::f64::consts::TAU);
        let length: f64 = random.random_range(0.3..8.0);
        points.push((x + length * angle.cos(), y + length * angle.sin()));
    }
    let mut fine = Vec::new();
    for pair in points.windows(2) {
        let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
        let count = ((x1 - x0).hypot(y1 - y0) / 0.1).ceil() as usize;
        for i in 0..count {
            let s = i as f64 / count as f64;
            fine.push((
                x0 + s * (x1 - x0),
                y0 + s * (y1 - y0),
                (y1 - y0).atan2(x1 - x0),
            ));
        }
    }
    curve_through(fine.into_iter())
}

/// Largest distance of the stream from its path's tip, heading taken along: (mm, rad), over
/// samples ten times finer than the servo tick.
fn worst_fit(stream: &SegmentStream, control: &[[f64; 7]]) -> (f64, f64) {
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

fn duration_s(stream: &SegmentStream) -> f64 {
    stream.marks[stream.marks.len() - 1].end_tick as f64 / 2000.0
}

#[test]
fn a_straight_line_takes_the_time_of_its_trapezoid() {
    let settings = Settings::default();
    let control = vec![
        [50.0, 50.0, 0.2, 0.0, 0.0, 0.0, 0.0],
        [150.0, 50.0, 0.2, 0.0, 0.0, 0.0, 0.0],
    ];
    let (stream, report) = lay_segments(&route_of(control), &settings).unwrap();
    let worst = sample_limits(&stream, &settings, 4);
    assert!(worst.all() <= 1.0 + 1e-6, "{worst:?}");
    assert!(worst.tip_speed > 0.995, "{worst:?}");
    let (v, a) = (0.95 * 60.0, 0.95 * 3000.0);
    let smoothing_s = 0.010;
    let best_s = 100.0 / v + v / a + smoothing_s + 0.008;
    assert!(duration_s(&stream) >= best_s - smoothing_s - 0.001);
    // Two per cent above the optimum with its smoothing and the rest before it.
    assert!(duration_s(&stream) <= 1.02 * best_s, "{report:?}");
}

#[test]
fn gear_keeps_its_limits_and_its_path() {
    for speed_mm_s in [60.0, 150.0] {
        let settings = Settings {
            speed_mm_s,
            ..Settings::default()
        };
        let control = gear(130.0);
        let started = std::time::Instant::now();
        let (stream, report) = lay_segments(&route_of(control.clone()), &settings).unwrap();
        println!("{:?}", started.elapsed());
        let worst = sample_limits(&stream, &settings, 4);
        println!(
            "gear at {speed_mm_s}: {:.3} s, {} knots, {:.1} knots/s {report:?}\n{worst:?}",
            duration_s(&stream),
            stream.knots.len(),
            stream.knots.len() as f64 / duration_s(&stream)
        );
        assert!(worst.all() <= 1.0 + 1e-6, "{worst:?}");
        // Something must bind, or the plan is too slow.
        assert!(worst.all() > 0.97, "{worst:?}");
        assert_eq!(report.doubled_stretches, 0);
        let (tip_mm, heading_rad) = worst_fit(&stream, &control);
        println!("fit {tip_mm} {heading_rad}");
        assert!(tip_mm <= settings.tolerances.tip_mm, "{tip_mm}");
        assert!(
            heading_rad <= settings.tolerances.heading_rad,
            "{heading_rad}"
        );
    }
}

#[test]
fn gear_on_a_machine_whose_axes_do_not_bind() {
    let mut settings = Settings::default();
    for joint in &mut settings.machine.joints {
        joint.acceleration_max *= 100.0;
        joint.jerk_max *= 1000.0;
        joint.speed_max *= 10.0;
    }
    let (stream, report) = lay_segments(&route_of(gear(400.0)), &settings).unwrap();
    println!(
        "free gear: {:.3} s, {} knots, {:.1} knots/s {report:?}",
        duration_s(&stream),
        stream.knots.len(),
        stream.knots.len() as f64 / duration_s(&stream)
    );
}

#[test]
fn random_curves_keep_every_limit() {
    let mut random = Pcg32::seed_from_u64(7);
    let mut tightest = 0.0f64;
    for case in 0..12 {
        let settings = Settings {
            speed_mm_s: random.random_range(20.0..200.0),
            ..Settings::default()
        };
        let control = if case % 2 == 0 {
            random_smooth(&mut random, 400)
        } else {
            zigzag(&mut random, 12)
        };
        let (stream, report) = lay_segments(&route_of(control.clone()), &settings).unwrap();
        let worst = sample_limits(&stream, &settings, 4);
        println!(
            "case {case}: {:.3} s {} knots {report:?} {:.4}",
            duration_s(&stream),
            stream.knots.len(),
            worst.all()
        );
        assert!(worst.all() <= 1.0 + 1e-6, "case {case}: {worst:?}");
        assert_eq!(report.doubled_stretches, 0, "case {case}");
        assert!(report.ratios.jerk <= 1.02, "case {case}: {report:?}");
        tightest = tightest.max(worst.all());
        let (tip_mm, heading_rad) = worst_fit(&stream, &control);
        assert!(
            tip_mm <= settings.tolerances.tip_mm,
            "case {case}: {tip_mm}"
        );
        assert!(
            heading_rad <= settings.tolerances.heading_rad,
            "case {case}: {heading_rad}"
        );
    }
    assert!(tightest > 0.98);
}

/// A pass with prime and retract, a lifted travel, another pass.
fn two_passes(settings: &Settings) -> Route {
    let flow = &settings.prime_retract;
    let first = gear(30.0);
    let shift = first[first.len() - 1][6];
    let end = first[first.len() - 1];
    let mut second: Vec<[f64; 7]> = (0..200)
        .map(|i| {
            let s = 0.1 * f64::from(i);
            [
                80.0,
                90.0 + s,
                0.2,
                0.0,
                0.0,
                end[5] + 0.5,
                shift + 0.12 * s,
            ]
        })
        .collect();
    let begin = second[0];
    let mut route = Route::default();
    let prime_s = 1.875 * flow.prime_mm3 / flow.prime_rate_mm3_s;
    let retract_s = 1.875 * flow.retract_mm3 / flow.retract_rate_mm3_s;
    let pass = |control: Vec<[f64; 7]>, number: u32| {
        let mut dwell = moving(MotionState::Prime, vec![control[0]]);
        dwell.dwell_s = prime_s - flow.prime_lead_s;
        dwell.event = Some(StretchEvent::PrimeAtStart {
            volume_mm3: flow.prime_mm3,
            duration_s: prime_s,
        });
        let last = control[control.len() - 1];
        let mut print = moving(MotionState::Print, control);
        print.pass = Some(number);
        print.event = Some(StretchEvent::RetractBeforeEnd {
            volume_mm3: flow.retract_mm3,
            duration_s: retract_s,
            lead_s: flow.retract_lead_s,
        });
        let mut retract = moving(MotionState::Retract, vec![last]);
        retract.dwell_s = retract_s - flow.retract_lead_s;
        [dwell, print, retract]
    };
    route.stretches.extend(pass(first, 0));
    let mut lifted = [end, begin];
    lifted[0][2] += 0.4;
    lifted[1][2] += 0.4;
    route
        .stretches
        .push(moving(MotionState::Travel, vec![end, lifted[0]]));
    route
        .stretches
        .push(moving(MotionState::Travel, lifted.to_vec()));
    route
        .stretches
        .push(moving(MotionState::Travel, vec![lifted[1], begin]));
    route.stretches.extend(pass(std::mem::take(&mut second), 1));
    route
}

#[test]
fn passes_with_prime_and_retract_keep_the_extruder_within_its_limits() {
    let settings = Settings::default();
    let (stream, report) = lay_segments(&two_passes(&settings), &settings).unwrap();
    let worst = sample_limits(&stream, &settings, 2);
    println!("two passes: {report:?}\n{worst:?}");
    assert!(worst.all() <= 1.0 + 1e-6, "{worst:?}");
    assert_eq!(stream.events.len(), 4);
    assert!(stream.events.is_sorted_by_key(|e| (e.span, e.offset_ticks)));
}

#[test]
fn stretches_join_at_exact_rest_and_marks_have_no_gap() {
    let settings = Settings::default();
    let route = two_passes(&settings);
    let (stream, _) = lay_segments(&route, &settings).unwrap();
    let oracle = Oracle::new(&stream);
    assert_eq!(stream.marks.len(), route.stretches.len() + 1);
    assert_eq!(
        stream.marks[stream.marks.len() - 1].end_tick as f64,
        oracle.end_tick()
    );
    for pair in stream.marks.windows(2) {
        assert_eq!(pair[0].end_tick, pair[1].start_tick);
    }
    for (mark, stretch) in stream.marks[1..].iter().zip(&route.stretches) {
        let (start, end) = (mark.start_tick as f64, mark.end_tick as f64);
        let control = &stretch.curve.control;
        for (tick, wanted) in [(start, control[0]), (end, control[control.len() - 1])] {
            let (p, v, a) = (oracle.at(tick, 0), oracle.at(tick, 1), oracle.at(tick, 2));
            for c in 0..7 {
                assert!((p[c] - wanted[c]).abs() <= 0.5 / UNITS[c] + 1e-9);
                assert!(v[c].abs() < 1e-6 && a[c].abs() < 1e-3);
            }
        }
        if stretch.curve.control.len() == 1 {
            let ticks = (stretch.dwell_s * 2000.0).ceil().max(1.0);
            assert_eq!(end - start, ticks);
        }
    }
    let ends: Vec<_> = stream
        .knots
        .iter()
        .rev()
        .take(3)
        .map(|k| k.control)
        .collect();
    assert!(ends[0] == ends[1] && ends[1] == ends[2]);
}

/// Joints of the gantry from the pose channels, by rotation matrices: X Y Z A B C. C comes without
/// its turns.
fn gantry_joints(pose: &[f64; 7], pivot_mm: f64) -> [f64; 6] {
    let (tx, ty) = (pose[3], pose[4]);
    let theta = tx.hypot(ty);
    // Rodrigues with the axis (tx, ty, 0) / theta.
    let (kx, ky) = if theta > 0.0 {
        (tx / theta, ty / theta)
    } else {
        (1.0, 0.0)
    };
    let (sin, cos) = theta.sin_cos();
    let m = [
        [cos + kx * kx * (1.0 - cos), kx * ky * (1.0 - cos), ky * sin],
        [
            kx * ky * (1.0 - cos),
            cos + ky * ky * (1.0 - cos),
            -kx * sin,
        ],
        [-ky * sin, kx * sin, cos],
    ];
    let n = [m[0][2], m[1][2], m[2][2]];
    let (sin_psi, cos_psi) = pose[5].sin_cos();
    // Row 0 of R_min R_z(psi) is (cos B cos C, -cos B sin C, sin B).
    let row = [
        m[0][0] * cos_psi + m[0][1] * sin_psi,
        m[0][1] * cos_psi - m[0][0] * sin_psi,
    ];
    [
        pose[0] + pivot_mm * n[0],
        pose[1] + pivot_mm * n[1],
        pose[2] + pivot_mm * (n[2] - 1.0),
        (-n[1]).atan2(n[2]),
        n[0].asin(),
        (-row[1]).atan2(row[0]),
    ]
}

#[test]
fn tilting_on_a_gantry_keeps_every_joint_within_its_limits() {
    use headway_firmware::configuration::Kinematics;
    let settings = Settings::gantry();
    let Kinematics::Gantry { pivot_length_mm } = settings.machine.kinematics else {
        panic!("not a gantry");
    };
    let mut control = gear(80.0);
    for (i, point) in control.iter_mut().enumerate() {
        let along = 0.1 * i as f64;
        point[2] = 5.0 + 0.3 * (1.0 - (along / 30.0).cos());
        point[3] = 0.3 * (along / 7.0).sin();
        point[4] = 0.3 * (along / 11.0).cos();
    }
    let (stream, report) = lay_segments(&route_of(control), &settings).unwrap();
    let oracle = Oracle::new(&stream);
    // A twentieth of a tick: truncation and rounding of the differences are both below 1e-4.
    let step = 0.05;
    let step_s = step / 2000.0;
    let mut worst = [[0.0f64; 2]; 6];
    for i in 1..oracle.end_tick() as u64 * 2 {
        let t = i as f64 / 2.0;
        let at = |t: f64| gantry_joints(&oracle.at(t, 0), pivot_length_mm);
        let (before, here, after) = (at(t - step), at(t), at(t + step));
        for joint in 0..6 {
            let turn = |d: f64| {
                if joint == 5 {
                    d - (d / std::f64::consts::TAU).round() * std::f64::consts::TAU
                } else {
                    d
                }
            };
            let (first, second) = (
                turn(here[joint] - before[joint]),
                turn(after[joint] - here[joint]),
            );
            let limit = &settings.machine.joints[joint];
            let share = settings.plan_share;
            let speed = (first + second).abs() / (2.0 * step_s * limit.speed_max * share);
            let acceleration =
                (second - first).abs() / (step_s * step_s * limit.acceleration_max * share);
            worst[joint][0] = worst[joint][0].max(speed);
            worst[joint][1] = worst[joint][1].max(acceleration);
        }
    }
    println!("{report:?}\n{worst:?}");
    let highest = worst.iter().flatten().fold(0.0f64, |a, &b| a.max(b));
    assert!(highest <= 1.0 + 1e-4, "{worst:?}");
    assert!(highest > 0.95, "{worst:?}");
    assert_eq!(report.doubled_stretches, 0);
}

#[test]
fn places_outside_the_machine_are_refused_with_joint_and_place() {
    use headway::plan::joint_limits::MotionError;
    let settings = Settings::default();
    let mut control = gear(10.0);
    for point in &mut control {
        point[0] += 1000.0;
    }
    match lay_segments(&route_of(control), &settings) {
        Err(MotionError::OutsideJointRange { joint, at_mm, .. }) => {
            assert_eq!(joint, 0);
            assert!(at_mm[0] > 1000.0);
        }
        other => panic!("{other:?}"),
    }
    let mut tilted = gear(10.0);
    tilted[50][3] = 0.2;
    assert!(matches!(
        lay_segments(&route_of(tilted), &settings),
        Err(MotionError::Kinematics { .. })
    ));
    let mut broken = gear(10.0);
    broken[3][1] = f64::NAN;
    assert!(matches!(
        lay_segments(&route_of(broken), &settings),
        Err(MotionError::NotFinite { stretch: 0 })
    ));
}

#[test]
fn the_stream_does_not_depend_on_the_number_of_threads() {
    let settings = Settings::default();
    let route = two_passes(&settings);
    let with = |threads: usize| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| lay_segments(&route, &settings).unwrap().0)
    };
    let alone = with(1);
    assert_eq!(alone, with(2));
    assert_eq!(alone, with(5));
}

#[test]
fn settings_that_cannot_be_are_refused_by_the_library_too() {
    let square = headway::input::read(
        br#"{"units": "mm", "exterior": [[0, 0], [10, 0], [10, 10], [0, 10]]}"#,
        "square",
        headway::input::Format::Polygon,
        &headway::input::ReadOptions::default(),
    );
    let square = square.expect("valid").target;
    let mut settings = Settings::default();
    for speed_mm_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        settings.speed_mm_s = speed_mm_s;
        let refused = headway::plan_target(&square, &settings).expect_err("no such speed");
        assert!(
            matches!(refused, headway::PlanError::Settings(_)),
            "{speed_mm_s}: {refused}"
        );
    }
    // A motor may use 90 % of the step ticks at its joint's top speed, no more.
    for (share, fits) in [(0.89, true), (0.91, false)] {
        let mut settings = Settings::default();
        let machine = &mut settings.machine;
        let speed_max = machine.joints[0].speed_max;
        machine.joints[0].steps_per_unit = share * f64::from(machine.step_hz) / speed_max;
        let planned = headway::plan_target(&square, &settings);
        assert_eq!(planned.is_ok(), fits, "{share}");
        if let Err(refused) = planned {
            assert!(refused.to_string().contains("90 %"), "{refused}");
        }
    }
    let mut settings = Settings::default();
    settings.machine.joints[0].acceleration_max = 0.0;
    let refused = headway::plan_target(&square, &settings).expect_err("no such machine");
    assert!(
        refused.to_string().contains("joints.x.acceleration_max"),
        "{refused}"
    );
}

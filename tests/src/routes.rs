//! Routes of known shape on the built-in planar machine, for the tests of the motion.

use headway::job::MotionState;
use headway::plan::route::moves::{MoveEvent, PathCurve, Route, RouteMove};
use headway::settings::Settings;
use rand::RngExt;
use rand_pcg::Pcg32;

pub fn moving(state: MotionState, control: Vec<[f64; 7]>) -> RouteMove {
    RouteMove {
        state,
        layer: 0,
        pass: (state == MotionState::Print).then_some(0),
        curve: PathCurve { control },
        dwell_s: 0.0,
        speed_mm_s: None,
        speeds_mm_s: Vec::new(),
        acceleration_mm_s2: None,
        parts: Vec::new(),
        event: None,
    }
}

pub fn route_of(control: Vec<[f64; 7]>) -> Route {
    Route {
        moves: vec![moving(MotionState::Print, control)],
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

/// A wave of the tip with a wave of the heading over it: amplitude, rad, and rad a mm of way.
pub fn wave(heading_rad: f64, per_mm: f64) -> Vec<[f64; 7]> {
    curve_through((0..=600).map(|i| {
        let x = 0.05 * f64::from(i);
        let y = 0.8 * (0.7 * x).sin();
        (50.0 + x, 60.0 + y, heading_rad * (per_mm * x).sin())
    }))
}

/// A gear of 20 lobes, slowly growing, nozzle on the tangent.
pub fn gear(length_mm: f64) -> Vec<[f64; 7]> {
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

pub fn random_smooth(random: &mut Pcg32, count: usize) -> Vec<[f64; 7]> {
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

pub fn zigzag(random: &mut Pcg32, corners: usize) -> Vec<[f64; 7]> {
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

/// A pass with prime and retract, a lifted travel, another pass.
pub fn two_passes(settings: &Settings) -> Route {
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
        dwell.event = Some(MoveEvent::PrimeAtStart {
            volume_mm3: flow.prime_mm3,
            duration_s: prime_s,
        });
        let last = control[control.len() - 1];
        let mut print = moving(MotionState::Print, control);
        print.pass = Some(number);
        print.event = Some(MoveEvent::RetractBeforeEnd {
            volume_mm3: flow.retract_mm3,
            duration_s: retract_s,
            lead_s: flow.retract_lead_s,
        });
        let mut retract = moving(MotionState::Retract, vec![last]);
        retract.dwell_s = retract_s - flow.retract_lead_s;
        [dwell, print, retract]
    };
    route.moves.extend(pass(first, 0));
    let mut lifted = [end, begin];
    lifted[0][2] += 0.4;
    lifted[1][2] += 0.4;
    route
        .moves
        .push(moving(MotionState::Travel, vec![end, lifted[0]]));
    route
        .moves
        .push(moving(MotionState::Travel, lifted.to_vec()));
    route
        .moves
        .push(moving(MotionState::Travel, vec![lifted[1], begin]));
    route.moves.extend(pass(std::mem::take(&mut second), 1));
    route
}

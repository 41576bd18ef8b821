//! Goal: with its curves known, an extruder that loses more the faster it turns lays every millimetre of a bead as
//! planned, through pauses and overrides. Method: the motor's targets drive a model of the extruder, whose loss is
//! smooth where the curve has eight points, and of its melt, a first-order lag; what comes out is compared with the
//! path's volume at the head, by stretches of 5 mm.
use super::*;
use crate::configuration::flow_curves::CurvePoints;
use crate::configuration::shaping::{Shaper, ShaperKind};
use crate::steps::STEP;

/// mm³/mm of the bead.
const PER_MM: f64 = 0.08;

/// Of a flow asked of the motor, mm³/s: 4 % at 2.4, 25 % at 12.
fn share_lost(asked_mm3_s: f64) -> f64 {
    0.04 + 0.21 * ((asked_mm3_s - 2.4).max(0.0) / 9.6).powf(1.5)
}

fn curve_of_eight() -> CurvePoints {
    let at = |k: u32| 2.4 + f64::from(k) * 1.75;
    let points = (0..8).map(|k| [at(k) as f32, share_lost(at(k)) as f32]);
    points.collect()
}

/// Along x at up to 112 mm/s: flows of up to 9 mm³/s.
fn narrow_and_wide() -> Job {
    let speed = |t: f64| 36.0 + 24.0 * (t * core::f64::consts::TAU / 0.7).cos();
    let mut place = 0.0;
    let table: Vec<f64> = (0..=2100)
        .map(|i| {
            place += speed(f64::from(i) * 1e-3) * 1e-3;
            place
        })
        .collect();
    Job::of_curve(2.1, 10, |s| {
        let at = (s * 1000.0).clamp(0.0, 2099.0);
        let (low, part) = (at as usize, at.fract());
        let x = table[low] + part * (table[low + 1] - table[low]);
        [x, 0.0, 0.2, 0.0, 0.0, 0.0, PER_MM * x]
    })
}

/// What leaves the nozzle over what the path wants, least and most, by stretches of 5 mm; `melt_s`: lag of the
/// melt by flow.
fn laid(
    configuration: &MachineConfiguration,
    melt_s: impl Fn(f64) -> f64,
    disturbed: bool,
) -> [f64; 2] {
    let mut job = narrow_and_wide();
    job.events.clear();
    let mut host = Host::new(configuration, &job);
    let mut motors: Vec<[f64; 2]> = Vec::new();
    while host.machine.motion().state() != DeviceState::Finished {
        host.send(&job, 8, 16);
        match motors.len() {
            700 if disturbed => host.control(HostMessage::Control(Control::Override(60))),
            1500 if disturbed => host.control(HostMessage::Control(Control::Pause)),
            2500 if disturbed => host.control(HostMessage::Control(Control::Resume)),
            _ => {}
        }
        host.tick();
        let targets = host.machine.motion().targets();
        let natural = |motor: usize, steps: f64| targets[motor] as f64 / STEP as f64 / steps;
        motors.push([natural(0, 80.0), natural(4, 400.0)]);
        assert!(motors.len() < 40_000, "{:?}", host.faults);
    }
    assert_eq!(host.faults, []);
    // Pushed into the melt's pressure, which is the lag times what comes out.
    let (mut pressed, mut flow) = (0.0, 0.0);
    let (mut before, mut stretch) = (motors[0][0], 0.0);
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for pair in motors.windows(2) {
        let asked = (pair[1][1] - pair[0][1]) * 2000.0;
        let arrives = asked * (1.0 - if asked > 0.0 { share_lost(asked) } else { 0.0 });
        pressed += arrives / 2000.0;
        // Implicit: pressed' = arrives - flow, pressed = lag x flow.
        let lag = melt_s(flow);
        flow = pressed / (lag + 1.0 / 2000.0);
        pressed -= flow / 2000.0;
        stretch += flow / 2000.0;
        let way = pair[1][0] - before;
        if way >= 5.0 {
            let ratio = stretch / (way * PER_MM);
            range = [range[0].min(ratio), range[1].max(ratio)];
            (before, stretch) = (pair[1][0], 0.0);
        }
    }
    range
}

#[test]
fn beads_from_narrow_to_wide_have_their_volume() {
    let mut configuration = planar();
    configuration.extruder.acceleration_max_mm3_s2 = 20_000.0;
    configuration.extruder.pressure_advance_s = 0.03;
    configuration.extruder.pressure_advance_window_ms = 10.0;
    let plain = laid(&configuration, |_| 0.03, false);
    configuration.curves.loss = curve_of_eight();
    let straight = laid(&configuration, |_| 0.03, false);
    let disturbed = laid(&configuration, |_| 0.03, true);
    // A melt that yields less the faster it flows: A = 0.06 q / (1 + q / 12), of which K is the derivative.
    let lag = |flow: f64| 0.06 / (1.0 + flow / 12.0);
    let k = |flow: f64| 0.06 / (1.0 + flow / 12.0).powi(2);
    let points = (1..=8).map(|k| 0.15 * f64::from(k * k));
    configuration.curves.advance = points.map(|flow| [flow as f32, k(flow) as f32]).collect();
    configuration.extruder.pressure_advance_s = configuration.curves.advance_bounds().unwrap()[0];
    // The advance waits as well, for a shaper.
    configuration.shapers[1] = Shaper {
        kind: ShaperKind::Mzv,
        frequency_hz: 40.0,
        damping: 0.1,
    };
    let bent = laid(&configuration, lag, true);
    std::println!(
        "plain {plain:.4?}, curve {straight:.4?}, disturbed {disturbed:.4?}, both {bent:.4?}"
    );
    assert!(plain[0] < 0.87, "{plain:?}");
    for [least, most] in [straight, disturbed, bent] {
        assert!(least > 0.99 && most < 1.01, "{least} {most}");
    }
}

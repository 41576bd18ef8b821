//! Goal: pressure advance is centred on the motion: it deposits the melt where the path requires it, as
//! well as a model of the melt permits. Method: a job slows down for corners and speeds up again; the melt
//! follows the extruder's motor as a first-order lag; the flow out of the nozzle is compared with the
//! path's at the head's position.
use super::*;
use crate::steps::STEP;

/// Time constant of the melt.
const MELT_S: f64 = 0.04;

/// Along x at 60 mm/s, down to 12 mm/s at three corners; 10 mm³ in 100 mm.
fn corners() -> Job {
    let speed = |t: f64| 36.0 + 24.0 * (t * core::f64::consts::TAU / 0.35).cos();
    let mut place = 0.0;
    let table: Vec<f64> = (0..=1050)
        .map(|i| {
            place += speed(f64::from(i) * 1e-3) * 1e-3;
            place
        })
        .collect();
    Job::of_curve(1.05, 10, |s| {
        let at = (s * 1000.0).clamp(0.0, 1049.0);
        let (low, part) = (at as usize, at.fract());
        let x = table[low] + part * (table[low + 1] - table[low]);
        [x, 0.0, 0.2, 0.0, 0.0, 0.0, 0.1 * x]
    })
}

/// Volume that lies where it should not, mm³: half of the difference between what left the nozzle and
/// what the path wants, over the whole path, and the largest way off the volume at any moment.
fn misplaced_mm3(advance_s: f64, window_ms: f64, centred: bool) -> f64 {
    let mut configuration = planar();
    configuration.extruder.pressure_advance_s = advance_s;
    configuration.extruder.pressure_advance_window_ms = window_ms;
    let mut job = corners();
    job.events.clear();
    let mut host = Host::new(&configuration, &job);
    let mut motors: Vec<[f64; 2]> = Vec::new();
    while host.machine.motion().state() != DeviceState::Finished {
        host.send(&job, 8, 16);
        host.tick();
        let targets = host.machine.motion().targets();
        let natural = |motor: usize, steps: f64| targets[motor] as f64 / STEP as f64 / steps;
        motors.push([natural(0, 80.0), natural(4, 400.0)]);
    }
    assert_eq!(host.faults, []);
    // As it was: the head ahead of the advance by half the window.
    let shift = if centred {
        0
    } else {
        (window_ms * 1e-3 * 1000.0) as usize
    };
    let head = |tick: usize| motors[(tick + shift).min(motors.len() - 1)][0];
    let extruded = |tick: usize| {
        // e = V + advance: the planned part goes with the head.
        if centred {
            motors[tick][1]
        } else {
            let planned =
                |tick: usize| 0.1 * (motors[tick.min(motors.len() - 1)][0] - motors[0][0]);
            motors[tick][1] + planned(tick + shift) - planned(tick)
        }
    };
    let (mut melt, mut sum) = (extruded(0), 0.0);
    for tick in 1..motors.len() - 60 {
        let before = melt;
        melt += (extruded(tick) - melt) / (MELT_S * 2000.0);
        let wanted = 0.1 * (head(tick) - head(tick - 1));
        sum += 0.5 * (melt - before - wanted).abs();
    }
    sum
}

#[test]
fn advance_is_centred_and_halves_what_a_corner_misplaces() {
    let without = misplaced_mm3(0.0, 40.0, true);
    let late = misplaced_mm3(MELT_S, 40.0, false);
    let centred = misplaced_mm3(MELT_S, 40.0, true);
    let narrow = misplaced_mm3(MELT_S, 10.0, true);
    std::println!(
        "without {without:.4}, late {late:.4}, centred {centred:.4}, 10 ms {narrow:.4} mm³"
    );
    // 0.0 is what no window at all would reach.
    assert!(centred < 0.5 * without && centred < 0.6 * late, "{centred}");
    assert!(narrow < centred, "{narrow}");
}

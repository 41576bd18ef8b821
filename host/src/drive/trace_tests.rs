//! Goal: the comparison finds exactly the existing errors. Method: an ideal controller that follows
//! the plan itself and steps at the tick nearest to each crossing, then one with deliberate errors.

use super::*;
use crate::drive::test_streams::{planar, spiral};
use headway_firmware::steps::delay::motion_delay_s;
use headway_firmware::steps::output::StepOutput;

/// Steps at the tick after each crossing of the exact plan, `late_ticks` later than it should;
/// half a tick early in the mean, as the firmware.
fn ideal(stream: &SegmentStream, machine: &MachineConfiguration, late_ticks: i64) -> MotionRecord {
    let first_servo_tick = 7;
    let ratio = f64::from(machine.step_hz / machine.servo_hz);
    let ticks = stream_ticks(&stream.knots);
    let delay = motion_delay_s(machine) * f64::from(machine.servo_hz);
    let mut cursor = PlanCursor::new(stream);
    let start_counts = counts_at(&cursor.position(0.0), machine);
    let mut record = MotionRecord {
        start_counts,
        first_servo_tick,
        rates_q16: vec![65_536; ticks as usize],
        ..MotionRecord::default()
    };
    let mut counts = start_counts;
    let mut last_tick = 0;
    for step_tick in 0..((ticks + 7) as f64 * ratio) as u64 {
        let time = step_tick as f64 / ratio;
        let mut wanted = counts_at(&cursor.position(time), machine);
        let extruder = machine.joints.len();
        wanted[extruder] = counts[extruder];
        let mut steps = 0u8;
        let mut directions = 0u8;
        for motor in 0..MOTORS_MAX {
            let change = wanted[motor] - counts[motor];
            assert!(change.abs() <= 1, "one step a tick");
            if change != 0 {
                steps |= 1 << motor;
                directions |= u8::from(change > 0) << motor;
            }
        }
        counts = wanted;
        if steps != 0 {
            record.steps.set_directions(directions);
            let shift = ((first_servo_tick as f64 + delay) * ratio - 0.5).floor() as i64;
            last_tick = (step_tick as i64 + shift + late_ticks) as u64;
            record.steps.step(last_tick, steps);
        }
    }
    let expected = expected_counts(stream, machine);
    let extruder = machine.joints.len();
    let net = expected[extruder] - start_counts[extruder];
    record.steps.set_directions(0xff);
    for i in 0..net as u64 {
        record.steps.step(last_tick + 1 + i, 1 << extruder);
    }
    record
}

#[test]
fn an_ideal_controller_is_within_half_a_step_and_half_a_tick() {
    let (stream, machine) = (spiral(3.0), planar());
    let figures = compare(&stream, &machine, &ideal(&stream, &machine, 0));
    // A tick at 60 mm/s is 0.3 um.
    let bound_um = figures.half_step_um_max + 0.4;
    assert!(figures.tip_error_um_max < bound_um, "{figures:?}");
    assert!(figures.tip_error_um_max > 0.6 * figures.half_step_um_max);
    // The heading turns at up to 20 rad/s: 0.1 mrad a tick.
    let bound_mrad = figures.half_step_mrad_max + 0.1;
    assert!(figures.heading_error_mrad_max < bound_mrad, "{figures:?}");
    // The tick's own quantisation: uniform over 5 us, rms 1.44.
    assert!(figures.step_time_error_us_max < 2.7, "{figures:?}");
    assert!(
        (figures.step_time_error_us_rms - 1.44).abs() < 0.1,
        "{figures:?}"
    );
    assert_eq!(figures.volume_error_pct, 0.0);
    assert_eq!(figures.final_counts, figures.expected_counts);
    let half_x_um = 0.5e3 / machine.joints[0].steps_per_unit;
    assert!(figures.half_step_um_max >= half_x_um * 1.41);
}

#[test]
fn a_late_controller_and_a_lost_step_are_found() {
    let (stream, machine) = (spiral(2.0), planar());
    let late = compare(&stream, &machine, &ideal(&stream, &machine, 10));
    assert!((late.step_time_error_us_max - 52.5).abs() < 1.0, "{late:?}");
    let mut record = ideal(&stream, &machine, 0);
    record.steps.set_directions(0xff);
    record.steps.step(u64::from(u32::MAX), 1);
    let odd = compare(&stream, &machine, &record);
    assert_eq!(odd.final_counts[0], odd.expected_counts[0] + 1);
}

#[test]
fn a_stop_on_the_path_is_compared_along_the_path() {
    // The record says that nothing moved for 100 ticks in the middle; the steps say the same.
    let (stream, machine) = (spiral(2.0), planar());
    let mut record = ideal(&stream, &machine, 0);
    let good = compare(&stream, &machine, &record);
    let middle = record.rates_q16.len() / 2;
    for _ in 0..100 {
        record.rates_q16.insert(middle, 0);
    }
    let bad = compare(&stream, &machine, &record);
    assert!(bad.tip_error_um_max > 100.0 * good.tip_error_um_max);
}

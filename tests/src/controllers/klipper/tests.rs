//! Goal: what Klipper's documentation says of corners, axes and states. Method: lines of which the times are
//! worked out by hand, at 1000 mm/s² and without the minimum cruise ratio.
use super::super::HEADING;
use super::*;

fn printer() -> Klipper {
    Klipper::new(Config {
        acceleration_max_mm_s2: 1000.0,
        cruise_ratio_min: 0.0,
        ..Config::default()
    })
}

fn printed(lines: &str) -> Printed {
    let text =
        format!("MANUAL_STEPPER STEPPER=heading GCODE_AXIS=C\nM83\nM109 S210\nG0 F3000\n{lines}");
    printer().print(&text).expect("printed")
}

#[test]
fn a_square_corner_has_its_velocity() {
    // Two legs of 10 mm at 50 mm/s, 5 mm/s between: each 0.05 + 0.045 s of change, 1.25 + 1.2375 mm.
    let corner = printed("G1 X10 F3000\nG1 Y10\nG1 E1 F60000\n");
    let each = 0.05 + 0.045 + (10.0 - 1.25 - 1.2375) / 50.0;
    // The extruder alone: 1 mm by 83 mm/s and 1000 mm/s² of `max_extrude_only`, 266 each.
    let accel = 1000.0 * 4.0 * 0.16 / (0.25 * PI * 1.75 * 1.75) * 3.0;
    let alone = 2.0 * (1.0 / accel).sqrt();
    assert!(
        (corner.seconds - 2.0 * each - alone).abs() < 1e-6,
        "{} {}",
        corner.seconds,
        2.0 * each
    );
    assert_eq!(corner.slowed_by["square corner"], 1);
}

#[test]
fn a_further_axis_steps_by_its_corner_velocity() {
    // 10 mm with 10 degrees, then 10 mm with 30: at 1 degree/s of corner velocity 0.5 mm/s between.
    let slow = printed("G1 X10 C10 F3000\nG1 X20 C40\nG1 E1 F600");
    assert_eq!(slow.slowed_by["heading's corner"], 1);
    let turn = slow.peaks[HEADING];
    assert!((turn.step - 1.0).abs() < 1e-9, "{turn:?}");
    // Of a turn by half, nothing is slowed.
    let even = printed("G1 X10 C10 F3000\nG1 X20 C20\nG1 E1 F600");
    assert_eq!(even.slowed_by.get("heading's corner"), None);
    assert!(even.seconds < slow.seconds - 0.04);
}

#[test]
fn states_are_klippers() {
    let mut printer = printer();
    let start = "MANUAL_STEPPER STEPPER=heading GCODE_AXIS=C\n";
    assert_eq!(
        printer.print(start).expect("once").left,
        ["heading is still registered"]
    );
    let twice = printer.print(start).expect_err("registered");
    assert!(
        twice.contains("line 1: Must unregister axis first"),
        "{twice}"
    );
    // G92 knows no C, and an axis that stands somewhere keeps its place.
    let turned =
        printer.print("G1 C90 F6000\nG92 C0\nG1 C91\nMANUAL_STEPPER STEPPER=heading GCODE_AXIS=\n");
    assert_eq!(
        turned.expect("turned").left,
        [format!("heading stands at {} turns", 91.0 / 360.0)]
    );
    assert!(
        printer
            .print("M83\nG1 X1 E0.1\n")
            .expect_err("cold")
            .contains("below minimum temp")
    );
    // SET_RETRACTION forgets that the filament is back: no G11.
    let lines = "M83\nM104 S200\nSET_RETRACTION RETRACT_LENGTH=1\nG10\nSET_RETRACTION RETRACT_LENGTH=1\nG11\n";
    let pulled = printer.print(lines).expect("pulled");
    assert_eq!((pulled.moves, pulled.left.len()), (1, 2), "{pulled:?}");
}

#[test]
fn zigzags_are_smoothed_by_the_minimum_cruise_ratio() {
    // 1 mm from rest to rest: by half the acceleration to sqrt(500) mm/s, ramps of 0.25 mm by the whole.
    let mut printer = Klipper::new(Config {
        acceleration_max_mm_s2: 1000.0,
        ..Config::default()
    });
    let printed = printer
        .print("M104 S200\nM83\nG0 F3000\nG1 X1 E0.01 F6000\n")
        .expect("printed");
    let peak = 500.0f64.sqrt();
    let by_hand = 2.0 * peak / 1000.0 + 0.5 / peak;
    assert!(
        (printed.seconds - by_hand).abs() < 1e-9,
        "{} {by_hand}",
        printed.seconds
    );
}

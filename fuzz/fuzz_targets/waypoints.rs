//! The reader of waypoint files: no panic, what is taken is bounded, an error that can be printed.
#![no_main]

use headway::input::ReadOptions;
use headway::input::waypoints::read;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    match read(bytes, "fuzz", &ReadOptions::default()) {
        Ok(run) => {
            assert!(run.points.len() >= 2);
            for point in &run.points {
                assert!(point.tip_mm.iter().all(|c| c.abs() <= 1e7));
                assert!((point.axis.norm() - 1.0).abs() < 1e-9);
                assert!(point.heading_rad.is_none_or(f64::is_finite));
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});

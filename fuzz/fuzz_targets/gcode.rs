//! The reader of G-code: no panic, what is taken is bounded and whole, an error that can be printed.
#![no_main]

use headway::gcode::{GcodeOptions, PLACE_MAX_MM, read};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    match read(bytes, "fuzz", &GcodeOptions::default()) {
        Ok(program) => {
            assert!(!program.passes.is_empty());
            for pass in &program.passes {
                assert!(pass.points.len() >= 2);
                assert_eq!(pass.points.len(), pass.legs.len() + 1);
                for place in pass.points.iter().chain(&pass.travel) {
                    assert!(place.tip_mm.iter().all(|c| c.abs() <= 2.0 * PLACE_MAX_MM));
                    assert!(place.turn_deg.iter().all(|c| c.is_finite()));
                }
                for leg in &pass.legs {
                    assert!(leg.speed_mm_s.is_finite() && leg.speed_mm_s > 0.0);
                    assert!(
                        leg.volume_mm3
                            .is_none_or(|mm3| mm3.is_finite() && mm3 >= 0.0)
                    );
                    assert!(leg.width_mm.is_none_or(|mm| mm > 0.0));
                }
            }
            assert!(program.layers() >= 1);
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});

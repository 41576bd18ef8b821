//! The small texts of options: apertures, faults of the simulated line, ports.
#![no_main]

use headway::drive::link::LinkSpec;
use headway::drive::transport::Port;
use headway::settings::aperture_text::parse_aperture;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Err(error) = parse_aperture(text) {
        assert!(!error.to_string().is_empty());
    }
    if let Err(error) = text.parse::<Port>() {
        assert!(!error.to_string().is_empty());
    }
    if let Err(error) = text.parse::<LinkSpec>() {
        assert!(!error.to_string().is_empty());
    }
});

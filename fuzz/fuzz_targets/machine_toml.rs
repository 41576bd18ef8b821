//! The reader of machine files: no panic; what is taken is written and read again as the same.
#![no_main]

use headway::settings::machine_file::{from_toml, to_toml};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    match from_toml(text) {
        Ok(settings) => {
            settings
                .machine
                .check()
                .expect("the firmware can run what is taken");
            let again = from_toml(&to_toml(&settings)).expect("our own file");
            assert_eq!(again.machine.joints.len(), settings.machine.joints.len());
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});

//! Records of settings for a board; what is required of those that it takes is in `settings`.
#![no_main]

use headway_fuzz::settings::{Input, run};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: Input| run(&input));

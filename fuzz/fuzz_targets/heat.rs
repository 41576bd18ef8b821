//! The heat loop with sensors and transistors that fail; invariants in `heat`.
#![no_main]

use headway_fuzz::heat::{Run, run};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|attack: Run| run(&attack));

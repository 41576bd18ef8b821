//! The whole controller under messages that look right, and ticks; invariants in `attack`.
#![no_main]

use headway_fuzz::attack::{Attack, Target};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|attack: Attack| Target::run(&attack));

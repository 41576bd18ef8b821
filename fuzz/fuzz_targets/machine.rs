//! The whole controller under messages that look right, and ticks; invariants in `target`.
#![no_main]

use headway_fuzz::attack::Attack;
use headway_fuzz::target::Target;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|attack: Attack| Target::run(&attack));

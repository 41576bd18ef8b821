//! The host's sender and its patience at a board that says anything; invariants in `sender`.
#![no_main]

use headway_fuzz::sender::{Run, run};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|attack: Run| run(&attack));

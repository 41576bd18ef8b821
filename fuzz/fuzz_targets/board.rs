//! A board as a state machine: streams, commands and garbage on one line, questions and stops on a
//! second one, time between them; invariants in `board`.
#![no_main]

use headway_fuzz::board::{Siege, run};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|siege: Siege| run(&siege));

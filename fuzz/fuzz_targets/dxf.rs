//! The reader of DXF drawings: no panic, finite numbers, an error that can be printed.
#![no_main]

use headway::input::Format;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| headway_fuzz::read_input(bytes, Format::Dxf));

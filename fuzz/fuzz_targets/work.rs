//! Readers, planning and packing: work in proportion to the bytes that are read, whatever their numbers claim.
//!
//! A step is an allocation, or 64 bytes of one: every stage writes what it makes into memory of its own. The first
//! byte chooses the format. G-code is planned and packed as well, for the default machine.
#![no_main]

use headway::gcode::{self, GcodeOptions};
use headway::input::{self, Format, ReadOptions};
use headway::job::file;
use headway::mesh::{self, MeshFormat, MeshOptions};
use headway::pipeline::gcode::plan_gcode;
use headway::pipeline::packing::JobPacking;
use headway::settings::Settings;
use headway::settings::machine_file::from_toml;
use headway_fuzz::budget::{Budget, GCODE, READERS};
use libfuzzer_sys::fuzz_target;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use std::io::Cursor;

#[global_allocator]
static HEAP: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

fn read_gcode(bytes: &[u8]) {
    let Ok(program) = gcode::read(bytes, "fuzz", &GcodeOptions::default()) else {
        return;
    };
    let Ok(plan) = plan_gcode(&program, None, &Settings::default(), &()) else {
        return;
    };
    let mut packing = JobPacking::new(Cursor::new(Vec::new()));
    if packing.take(&plan.stream, 0, &plan.settings).is_ok() {
        let _ = packing.finish(&plan.settings);
    }
}

/// Paths among them: waypoints and curves.
fn read_drawing(bytes: &[u8], format: Format) {
    let _ = input::read_any(bytes, "fuzz", format, &ReadOptions::default());
}

fn read_mesh(bytes: &[u8], format: MeshFormat) {
    let _ = mesh::read(bytes, "fuzz", format, &MeshOptions::default());
}

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else {
        return;
    };
    let region = Region::new(HEAP);
    let mut budget: Budget = READERS;
    match kind % 12 {
        0 => {
            budget = GCODE;
            read_gcode(bytes);
        }
        1 => read_drawing(bytes, Format::GeoJson),
        2 => read_drawing(bytes, Format::Svg),
        3 => read_drawing(bytes, Format::Dxf),
        4 => read_drawing(bytes, Format::Waypoints),
        5 => read_mesh(bytes, MeshFormat::Stl),
        6 => read_mesh(bytes, MeshFormat::Obj),
        7 => {
            let _ = std::str::from_utf8(bytes).map(from_toml);
        }
        8 => {
            let _ = file::read(&mut Cursor::new(bytes));
        }
        9 => read_drawing(bytes, Format::Polygon),
        10 => read_drawing(bytes, Format::Nurbs),
        _ => read_mesh(bytes, MeshFormat::ThreeMf),
    }
    let counted = region.change();
    let reallocated = counted.bytes_reallocated.unsigned_abs();
    let steps = counted.allocations + (counted.bytes_allocated + reallocated) / 64;
    assert!(
        steps <= budget.of(bytes.len()),
        "{steps} steps for {} bytes",
        bytes.len()
    );
});

//! Goal: reading any file, and planning and packing G-code, takes work and memory in proportion to its bytes,
//! whatever its numbers claim. Method: an allocator that counts (a step is an allocation, or 64 bytes of one)
//! over files of a few lines in all formats that claim much; each is within a budget of steps a byte. One
//! test, of its own file, since all of a program shares the allocator. `fuzz/fuzz_targets/work.rs` holds the same
//! budget for what a fuzzer makes.

use headway::gcode::{self, GcodeOptions};
use headway::input::{self, Format, ReadOptions};
use headway::job::file;
use headway::mesh::{self, MeshFormat, MeshOptions};
use headway::pipeline::gcode::plan_gcode;
use headway::pipeline::packing::JobPacking;
use headway::settings::Settings;
use headway::settings::machine_file::from_toml;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use std::io::Cursor;

#[global_allocator]
static HEAP: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Steps whatever the size, and for each byte: readers alone, and G-code planned and packed, of which a line of ten
/// bytes may be a crossing of the whole machine.
const READERS: [usize; 2] = [1_000_000, 2_000];
const PLANNED: [usize; 2] = [50_000_000, 1_000_000];

fn plan(text: &str) -> &'static str {
    let Ok(program) = gcode::read(text.as_bytes(), "claims", &GcodeOptions::default()) else {
        return "refused";
    };
    let settings = Settings::default();
    let Ok(plan) = plan_gcode(&program, None, &settings, &()) else {
        return "not planned";
    };
    let mut packing = JobPacking::new(Cursor::new(Vec::new()));
    packing
        .take(&plan.stream, 0, &plan.settings)
        .expect("packed");
    packing.finish(&plan.settings).expect("a job");
    "planned"
}

fn drawing(bytes: &[u8], format: Format) -> &'static str {
    match input::read(bytes, "claims", format, &ReadOptions::default()) {
        Ok(_) => "read",
        Err(_) => "refused",
    }
}

fn solid(bytes: &[u8], format: MeshFormat) -> &'static str {
    match mesh::read(bytes, "claims", format, &MeshOptions::default()) {
        Ok(_) => "read",
        Err(_) => "refused",
    }
}

/// A binary STL file that claims four thousand million triangles and has one.
fn claiming_stl() -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend(u32::MAX.to_le_bytes());
    bytes.extend([0; 50]);
    bytes
}

/// Blocks that insert the one before ten times each, ten deep.
fn claiming_dxf() -> String {
    let mut text = "0\nSECTION\n2\nBLOCKS\n".to_string();
    for depth in 0..10 {
        text += &format!("0\nBLOCK\n2\nB{depth}\n70\n0\n10\n0\n20\n0\n");
        for x in 0..10 {
            text += &match depth {
                0 => format!("0\nLINE\n10\n{x}\n20\n0\n11\n{x}\n21\n5\n"),
                _ => format!(
                    "0\nINSERT\n2\nB{}\n10\n{x}\n20\n0\n70\n30000\n71\n30000\n",
                    depth - 1
                ),
            };
        }
        text += "0\nENDBLK\n";
    }
    text + "0\nENDSEC\n0\nSECTION\n2\nENTITIES\n0\nINSERT\n2\nB9\n10\n0\n20\n0\n0\nENDSEC\n0\nEOF\n"
}

/// Groups that use the one before ten times each, ten deep.
fn claiming_svg() -> String {
    let mut text =
        r##"<svg xmlns="http://www.w3.org/2000/svg" width="9mm" height="9mm"><defs>"##.to_string();
    text += r##"<g id="g0"><rect width="1" height="1"/></g>"##;
    for depth in 1..10 {
        let used = format!(r##"<use href="#g{}"/>"##, depth - 1).repeat(10);
        text += &format!(r##"<g id="g{depth}">{used}</g>"##);
    }
    text + r##"</defs><use href="#g9"/></svg>"##
}

#[test]
fn work_goes_with_bytes_and_not_with_claims() {
    let gcode = |text: &str| text.to_string();
    let inverse_time = gcode("G92 E0 C0\nG93\nG1 E.5 F990\nG1 X0.13 C-15 E.5045 F2353\n");
    let arcs = format!(
        "G91.1\nM83\nG0 X10\n{}",
        "G3 X10 Y0 I-10 J0 P100 E1000000000\n".repeat(50)
    );
    let crawl = gcode("G0 Z.2\nG1 X9 E.3 F6\nG1 Y9 E.6\n");
    let pull = gcode("M83\nG1 X10 Z.2 E1 F1200\nG1 E-1 F0.001\nG0 X20\nG1 E1\nG1 X30 E1\n");
    let flow = gcode("M83\nG0 Z.2\nG1 X2 E600 F6000\nG1 X4 E600\n");
    let far = gcode("M83\nG0 Z.2\nG1 X10 E.3 F1200\nG0 X99999\nG0 X0\nG1 X10 Y5 E.3\n");
    let waits = format!("G1 X1 Z.2 E1\n{}G1 X9 E9\n", "M106 S1\nM116\n".repeat(100));
    let orders = format!(
        "M83\nG0 Z.2\n{}",
        "G91\nG1 X.1 E.01 F1200\nM106 S9\nG90\n".repeat(100)
    );
    type Case = (
        &'static str,
        usize,
        [usize; 2],
        Box<dyn Fn() -> &'static str>,
    );
    let of_gcode =
        |what, text: String| -> Case { (what, text.len(), PLANNED, Box::new(move || plan(&text))) };
    let of_drawing = |what, text: String, format: Format| -> Case {
        (
            what,
            text.len(),
            READERS,
            Box::new(move || drawing(text.as_bytes(), format)),
        )
    };
    let of_solid = |what, bytes: Vec<u8>, format: MeshFormat| -> Case {
        (
            what,
            bytes.len(),
            READERS,
            Box::new(move || solid(&bytes, format)),
        )
    };
    let machine = format!(
        "[machine]\nname = \"{}\"\nservo_hz = 1e99\n",
        "a".repeat(500)
    );
    let job: Vec<u8> = (0..200u8).map(|byte| byte | 0x80).collect();
    let cases: Vec<Case> = vec![
        of_gcode("lines of inverse time", inverse_time),
        of_gcode("arcs of a hundred turns", arcs),
        of_gcode("a crawl of three minutes", crawl),
        of_gcode("a slow pull", pull),
        of_gcode("more than the extruder lays", flow),
        of_gcode("travel beyond the machine", far),
        of_gcode("waits for what nothing heats", waits),
        of_gcode("an order at each point", orders),
        of_solid("claimed triangles", claiming_stl(), MeshFormat::Stl),
        of_solid(
            "claimed corners",
            b"v 0 0 0\nf 1 2 4000000000\n".to_vec(),
            MeshFormat::Obj,
        ),
        of_drawing("blocks in blocks", claiming_dxf(), Format::Dxf),
        of_drawing("groups in groups", claiming_svg(), Format::Svg),
        (
            "a machine file",
            machine.len(),
            READERS,
            Box::new(move || {
                if from_toml(&machine).is_ok() {
                    "read"
                } else {
                    "refused"
                }
            }),
        ),
        (
            "a job file",
            job.len(),
            READERS,
            Box::new(move || match file::read(&mut Cursor::new(&job)) {
                Ok(_) => "read",
                Err(_) => "refused",
            }),
        ),
    ];
    for (what, bytes, [base, per_byte], run) in cases {
        let region = Region::new(HEAP);
        let outcome = run();
        let counted = region.change();
        let reallocated = counted.bytes_reallocated.unsigned_abs();
        let steps = counted.allocations + (counted.bytes_allocated + reallocated) / 64;
        println!("{what}: {outcome}, {bytes} bytes, {steps} steps");
        assert!(
            steps <= base + per_byte * bytes,
            "{what}: {steps} steps for {bytes} bytes"
        );
    }
}

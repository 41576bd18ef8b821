//! Jobs: damaged, cut off, claiming more than they have.

use super::Want::{Refused, Taken};
use super::{Case, Kind, Want, case};
use headway::gcode::{GcodeOptions, read};
use headway::job::file::{JobHeader, write};
use headway::job::frames::WireFrames;
use headway::pipeline::gcode::plan_gcode;
use headway::settings::Settings;

/// The job of a bead.
fn bead() -> Vec<u8> {
    let text = b"M83\nG1 X0 Z.2 F1200\nG1 X10 E1\n";
    let program = read(text, "bead", &GcodeOptions::default()).expect("a program");
    let plan = plan_gcode(&program, None, &Settings::default(), &()).expect("a plan");
    let machine = &plan.settings.machine;
    let frames = WireFrames::encode(&plan.stream).expect("frames");
    let header = JobHeader::new(&plan.stream, &frames, "planar", machine, plan.transform);
    let mut job = Vec::new();
    write(&mut job, &header, &frames).expect("a job");
    job
}

pub fn cases() -> Vec<Case> {
    let whole = bead();
    let of = |what, bytes: Vec<u8>, want: Want| case(what, Kind::Job, bytes, want);
    let cut = whole.len() / 2;
    let mut flipped = whole.clone();
    flipped[cut] ^= 1;
    let mut longer = whole.clone();
    longer.extend(b"tail");
    let mut claims = whole.clone();
    claims[8..]
        .iter_mut()
        .take(24)
        .for_each(|byte| *byte = 0xff);
    vec![
        of("a job", whole.clone(), Taken),
        of(
            "a job cut off",
            whole[..cut].to_vec(),
            Refused("truncated: it ends at byte"),
        ),
        of("a bit turned over", flipped, Refused("damaged")),
        of("a tail", longer, Refused("added behind its end")),
        of("its name alone", b"HEADWAYJ".to_vec(), Refused("truncated")),
        of(
            "something else",
            b"G1 X10\n".to_vec(),
            Refused("not a Headway job"),
        ),
        of(
            "claims beyond all",
            claims,
            Refused("a header of 4294967295 bytes"),
        ),
    ]
}

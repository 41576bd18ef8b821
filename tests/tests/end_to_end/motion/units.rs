//! Goal: jobs written before streams had units of their own are what they were, and no span of a wide nozzle wraps.
//! Method: a kept job of protocol version 9, with the digest of the steps that its own program made of it; a ring for
//! concrete, its control points unwrapped.

use headway::drive::dry_run::dry_run;
use headway::drive::simulator::SimulatorSetup;
use headway::input::Target;
use headway::job::{SegmentStream, file};
use headway::pipeline::planned::Planned;
use headway::plan_target;
use headway::settings::{Settings, machine_file};
use headway_protocol::units::{CHANNEL_VOLUME, Units};
use headway_tests::outlines::region;
use std::io::Cursor;

const OLD_JOB: &[u8] = include_bytes!("../../../data/jobs/bar-protocol-9.hwj");

#[test]
fn a_job_of_protocol_version_9_makes_the_steps_that_it_made_then() {
    let job = file::read(&mut Cursor::new(OLD_JOB)).expect("an old job");
    assert_eq!(job.header.protocol_version, 9);
    // Its nozzle was written by semi-axes.
    let planned = Planned::of_job(&job.header, SegmentStream::default(), String::new());
    assert_eq!(planned.settings.aperture, Settings::default().aperture);
    let stream = job.stream().expect("its stream");
    assert_eq!(stream.units, Units::BASE);
    assert_eq!(job.frames.job(), job.header.job);
    let settings = Settings {
        machine: job.header.machine.clone(),
        ..Settings::default()
    };
    let run = dry_run(&stream, &settings, &SimulatorSetup::default(), |_| {}).expect("a run");
    let figures = &run.simulation.figures;
    assert_eq!(figures.faults, 0);
    assert_eq!(figures.step_digest, "8328280b75e00ca6");
}

#[test]
fn a_job_of_protocol_version_10_is_read_and_one_of_a_later_version_is_not() {
    let job = file::read(&mut Cursor::new(OLD_JOB)).expect("an old job");
    let stream = job.stream().expect("its stream");
    // Version and schema of that build; the frames are the same.
    for (version, schema, is_read) in [(10, 0xd8f9_4d11, true), (10, 1, false), (12, 1, false)] {
        let mut header = job.header.clone();
        (header.protocol_version, header.schema_hash) = (version, schema);
        let mut written = Cursor::new(Vec::new());
        file::write(&mut written, &header, &job.frames).expect("memory");
        let read = file::read(&mut Cursor::new(written.into_inner()));
        assert_eq!(read.is_ok(), is_read, "{version}");
        if let Ok(read) = read {
            assert_eq!(read.stream().expect("its stream"), stream);
        }
    }
}

#[test]
fn a_ring_of_concrete_is_not_held_up_by_what_a_span_carries() {
    let text = std::fs::read_to_string(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../examples/machines/concrete.toml"
    ));
    let settings = machine_file::from_toml(&text.expect("a file")).expect("a machine");
    let rectangle = |x: f64, y: f64| vec![[-x, -y], [x, -y], [x, y], [-x, y]];
    let target = Target {
        name: "ring".to_string(),
        regions: vec![region(&vec![
            rectangle(200.0, 150.0),
            rectangle(160.0, 110.0),
        ])],
    };
    let plan = plan_target(&target, &settings).expect("a plan");
    let stream = &plan.stream;
    let units = stream.units;
    assert_eq!([units.length_exponent, units.volume_exponent], [5, 16]);
    let mut last = stream.start[CHANNEL_VOLUME];
    let (mut laid, mut largest) = (0i64, 0);
    for knot in &stream.knots {
        let step = knot.control[CHANNEL_VOLUME].wrapping_sub(last);
        last = knot.control[CHANNEL_VOLUME];
        laid += i64::from(step);
        largest = largest.max(step.unsigned_abs());
    }
    let laid_mm3 = laid as f64 / units.per_natural(CHANNEL_VOLUME);
    println!(
        "{:.2} s, {laid_mm3:.0} mm³, {largest} units at once",
        plan.figures.print_s
    );
    // A wrapped step would be missing from the whole.
    assert!((laid_mm3 / plan.figures.volume_mm3 - 1.0).abs() < 1e-6);
    assert!(largest < 1 << 30);
    // Before a span carried more than 966 mm³ it was 57 s.
    assert!(plan.figures.print_s < 45.0, "{}", plan.figures.print_s);
}

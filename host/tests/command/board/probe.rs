//! Goal: the command finds a bed where it is, writes a mesh that a job is streamed over, and refuses before
//! anything moves what cannot be reached. Method: the command itself, talking to a board of its own whose bed
//! is a file; heights against that file.
#![cfg(unix)]

use crate::rig::board::{Host, job};
use crate::rig::{folder, headway, object, stderr, succeeded};
use headway::bed_mesh::{BedMesh, from_toml, to_toml};
use headway::settings::machine_file;
use std::path::Path;

/// Homing of Z and the touch: each a step, and half a micrometre that a servo tick moves.
const BOUND_MM: f64 = 0.0065;

fn warped(x: f64, y: f64) -> f64 {
    0.1 + 0.15 * (x / 70.0).sin() * (y / 90.0).cos() - 0.0005 * y
}

/// A machine with a probe, and its bed.
fn machine_and_bed(folder: &Path, more: &str) -> (String, String, BedMesh) {
    let text = succeeded(&headway(&["machine", "new"]));
    let text = format!(
        "{text}\n[probe]\noffset_x_mm = -22\noffset_y_mm = 14\nz_offset_mm = 1.6\nfast_mm_s = 10\n\
         slow_mm_s = 1\n{more}"
    );
    let settings = machine_file::from_toml(&text).unwrap();
    let at = |number: usize| -20.0 + 10.0 * number as f64;
    let bed = BedMesh {
        machine_hash: settings.machine.hash(),
        min_mm: [-20.0, -20.0],
        max_mm: [280.0, 280.0],
        heights_mm: (0..31)
            .map(|row| (0..31).map(|column| warped(at(column), at(row))).collect())
            .collect(),
        fade_start_mm: 1.0,
        fade_height_mm: 30.0,
    };
    let place = |name: &str| folder.join(name).display().to_string();
    let (machine_place, bed_place) = (place("machine.toml"), place("true-bed.toml"));
    std::fs::write(&machine_place, text).unwrap();
    std::fs::write(&bed_place, to_toml(&bed)).unwrap();
    (machine_place, bed_place, bed)
}

fn board(machine: &str, bed: &str) -> (Host, String) {
    let listen = ["board", "simulate", "--listen", "tcp:127.0.0.1:0"];
    let rest = ["--speed", "50", "--machine", machine, "--bed", bed];
    let board = Host::start(&[&listen[..], &rest].concat());
    board.wait_for("listens on ");
    let said = board.said.lock().unwrap().clone();
    let port = said.split("listens on ").nth(1).unwrap();
    let port = port.split(';').next().unwrap().to_string();
    (board, port)
}

fn refused(arguments: &[&str], with: &str) {
    let done = headway(arguments);
    assert_ne!(done.status.code(), Some(0), "{arguments:?}");
    assert!(stderr(&done).contains(with), "{}", stderr(&done));
}

#[test]
fn a_bed_is_probed_and_a_job_streamed_over_it() {
    let folder = folder("probe");
    let (machine, bed_file, bed) = machine_and_bed(&folder, "");
    let (board, port) = board(&machine, &bed_file);
    let of = ["--machine", machine.as_str(), "--port", port.as_str()];
    let with = |arguments: &[&'static str]| [arguments, &of].concat();
    refused(&with(&["board", "probe"]), "home it first");
    refused(&["board", "probe", "--port", &port], "no [probe]");
    succeeded(&headway(&["board", "home", "--port", &port]));

    let counts = || {
        let status = object(&headway(&["board", "status", "--port", &port, "--json"]));
        status["counts"].clone()
    };
    let before = counts();
    // The nozzle would have to be at X 272; the range ends before that.
    refused(
        &with(&["board", "mesh", "--area", "20,20,250,200"]),
        "nothing has moved",
    );
    refused(
        &with(&["board", "probe", "--at", "100,1000"]),
        "nothing has moved",
    );
    refused(&with(&["board", "mesh", "--area", "9,9,9,9"]), "--area");
    assert_eq!(counts(), before);

    let point = object(&headway(&with(&[
        "board", "probe", "--at", "100,120", "--repeat", "4", "--json",
    ])));
    let height = point["height_mm"].as_f64().unwrap();
    assert!(
        (height - bed.height_mm(100.0, 120.0)).abs() < BOUND_MM,
        "{point:?}"
    );
    assert_eq!(point["touches_mm"].as_array().unwrap().len(), 4);
    assert!(point["range_mm"].as_f64().unwrap() < 0.0015, "{point:?}");

    let mesh_file = folder.join("bed.toml").display().to_string();
    let area = [
        "--area",
        "60,60,180,170",
        "--points",
        "4x3",
        "-o",
        &mesh_file,
    ];
    let said = succeeded(&headway(&[&["board", "mesh"], &area[..], &of].concat()));
    assert!(said.contains("4 x 3 points"), "{said}");
    let found = from_toml(&std::fs::read_to_string(&mesh_file).unwrap()).unwrap();
    assert_eq!((found.heights_mm.len(), found.heights_mm[0].len()), (3, 4));
    for (row, heights) in found.heights_mm.iter().enumerate() {
        for (column, height) in heights.iter().enumerate() {
            let (x, y) = (60.0 + 40.0 * column as f64, 60.0 + 55.0 * row as f64);
            let error = height - bed.height_mm(x, y);
            assert!(error.abs() < BOUND_MM, "{error} mm at {x}, {y}");
        }
    }
    // The same bed again, to the letter: nothing of it is of the day.
    let again_file = folder.join("again.toml").display().to_string();
    let again = [
        "--area",
        "60,60,180,170",
        "--points",
        "4x3",
        "-o",
        &again_file,
    ];
    succeeded(&headway(&[&["board", "mesh"], &again[..], &of].concat()));
    let again = from_toml(&std::fs::read_to_string(&again_file).unwrap()).unwrap();
    for (one, other) in found
        .heights_mm
        .iter()
        .flatten()
        .zip(again.heights_mm.iter().flatten())
    {
        assert!((one - other).abs() < 0.002, "{one} and {other}");
    }

    let (job, _) = job(&folder, 1);
    let over = ["--mesh", mesh_file.as_str(), "--port", port.as_str()];
    succeeded(&headway(&["board", "go", &job, "--port", &port]));
    refused(
        &[&["stream", job.as_str()][..], &over].concat(),
        "where the job begins",
    );
    succeeded(&headway(
        &[&["board", "go", job.as_str()][..], &over].concat(),
    ));
    let streamed = object(&headway(
        &[&["stream", job.as_str(), "--json"][..], &over].concat(),
    ));
    assert_eq!(streamed["done"], true);
    board.interrupt();
    board.end();
}

#[test]
fn z_is_homed_and_the_bed_probed_by_a_pin() {
    let folder = folder("pin");
    let more = "[switches.x]\nend = \"min\"\n[switches.y]\nend = \"min\"\n[switches.z]\nend = \"min\"\n\
                [wiring]\nemergency_input = 7\nswitch_inputs = { z = 8 }\nprobe_servo = true\n";
    let (machine, bed_file, bed) = machine_and_bed(&folder, more);
    let (board, port) = board(&machine, &bed_file);
    let of = ["--machine", machine.as_str(), "--port", port.as_str()];
    for position in ["self-test", "deploy", "reset", "stow"] {
        succeeded(&headway(&["board", "probe-pin", position, "--port", &port]));
    }
    succeeded(&headway(&["board", "home", "--port", &port]));
    // Z was homed where X and Y had been, so that is where the bed is as high as the nozzle believes.
    let status = object(&headway(&["board", "status", "--port", &port, "--json"]));
    assert_eq!(status["probe_pressed"], false);
    let settings = machine_file::from_toml(&std::fs::read_to_string(&machine).unwrap()).unwrap();
    let tip = [0, 1].map(|axis: usize| {
        let count = status["counts"][axis].as_f64().unwrap();
        count / settings.machine.joints[axis].steps_per_unit
    });
    let homed = bed.height_mm(tip[0] - 22.0, tip[1] + 14.0);
    let at = [&["board", "probe", "--at", "150,100", "--json"][..], &of].concat();
    let point = object(&headway(&at));
    let height = point["height_mm"].as_f64().unwrap();
    let expected = bed.height_mm(150.0, 100.0) - homed;
    assert!(
        (height - expected).abs() < BOUND_MM,
        "{height} for {expected}"
    );
    board.interrupt();
    board.end();
}

//! Goal: the joints of every kind of machine, written as a file of its own letters, are read back as the poses that they
//! came from, within 5 µm and 0.02°. Method: a vase on each example machine; its joints by the inverse equations, in six
//! digits; read by `machine:FILE` and, where the words can say it, by words.

use headway::gcode::axes::words::AxesWords;
use headway::gcode::axes::{FileAxes, FileMachine};
use headway::gcode::{GcodeOptions, Place, read};
use headway::settings::{Settings, joint_names, machine_file};
use headway_firmware::kinematics::pose::{Pose, tilt_of_axis};
use headway_firmware::kinematics::{inverse, joint_channels};
use nalgebra::{Rotation3, Vector3};
use std::fmt::Write;
use std::sync::Arc;

const TIP_MM: f64 = 5e-3;
const TURN_DEG: f64 = 0.02;
const POSES: usize = 120;

struct Kind {
    file: &'static str,
    /// How far its tool axis leans from Z: a vase between, or the nozzle's own lean.
    tilts_deg: [f64; 2],
    /// Letters of joints that are named by more than a letter.
    letters: &'static str,
    /// The same machine in words.
    words: Option<&'static str>,
}

const KINDS: [Kind; 9] = [
    Kind {
        file: "planar",
        tilts_deg: [0.0, 0.0],
        letters: "",
        words: Some("C=heading"),
    },
    Kind {
        file: "corexy",
        tilts_deg: [0.0, 0.0],
        letters: "",
        words: Some("C=heading,coordinates=tip"),
    },
    Kind {
        file: "gantry",
        tilts_deg: [2.0, 30.0],
        letters: "",
        words: Some("A=head:x:at=0/0/60,B=head:y:at=0/0/60,C=heading,coordinates=pivot"),
    },
    Kind {
        file: "trunnion",
        tilts_deg: [2.0, 30.0],
        letters: "",
        words: Some("A=table:x:at=150/150/0,C=table:z:at=150/150/0,H=heading,coordinates=pivot"),
    },
    Kind {
        file: "head-cb",
        tilts_deg: [2.0, 30.0],
        letters: "",
        words: Some("C=head:z:at=0/0/70,B=head:y:at=0/0/70,H=heading,coordinates=pivot"),
    },
    Kind {
        file: "table-bc",
        tilts_deg: [2.0, 30.0],
        letters: "",
        words: Some("B=table:y:at=150/150/0,C=table:z:at=150/150/0,H=heading,coordinates=pivot"),
    },
    Kind {
        file: "tilted-head",
        tilts_deg: [45.0, 45.0],
        letters: "",
        words: Some("C=head:z:at=60/0/60,H=heading,lean=45,coordinates=pivot"),
    },
    Kind {
        file: "polar",
        tilts_deg: [0.0, 0.0],
        letters: "",
        words: Some("C=table:z,H=heading,coordinates=pivot"),
    },
    Kind {
        file: "arm-small",
        tilts_deg: [2.0, 20.0],
        letters: ",letters=A/B/C/U/V/W/H",
        words: None,
    },
];

fn machine(name: &str) -> Settings {
    let path = format!(
        "{}/../examples/machines/{name}.toml",
        env!("CARGO_MANIFEST_DIR")
    );
    let text = std::fs::read_to_string(path).expect("an example");
    machine_file::from_toml(&text).expect("a machine")
}

/// Poses of a vase around the middle of the work area.
fn vase(settings: &Settings, [low, high]: [f64; 2]) -> Vec<Pose<f64>> {
    let [from, to] = settings.work_area_mm;
    let middle: Vec<f64> = (0..3).map(|i| 0.5 * (from[i] + to[i])).collect();
    (0..POSES)
        .map(|k| {
            let angle = 0.1 * k as f64;
            let tilt = (low + (high - low) * (0.5 - 0.5 * (0.6 * angle).cos())).to_radians();
            let n = Vector3::new(
                tilt.sin() * angle.cos(),
                tilt.sin() * angle.sin(),
                tilt.cos(),
            );
            let radius = 18.0 + 3.0 * (1.7 * angle).sin();
            Pose {
                tip_mm: Vector3::new(
                    middle[0] + radius * angle.cos(),
                    middle[1] + radius * angle.sin(),
                    0.8 * from[2] + 0.2 * middle[2] + 0.05 * k as f64,
                ),
                tilt_rad: tilt_of_axis(&n),
                heading_rad: 0.5 * angle - 1.0,
            }
        })
        .collect()
}

/// The joints as a file: angles in degrees, counted on.
fn text_of(poses: &[Pose<f64>], settings: &Settings, letters: &[u8]) -> String {
    let kinematics = &settings.machine.kinematics;
    let joints = &settings.machine.joints;
    let mut before: Option<Vec<f64>> = None;
    let mut text = String::from("M83\nG90\n");
    for (k, pose) in poses.iter().enumerate() {
        let found = inverse(kinematics, pose).expect("joints");
        let mut at: Vec<f64> = found.as_slice().to_vec();
        for (i, value) in at.iter_mut().enumerate() {
            if joints[i].rotary {
                *value = value.to_degrees();
                let near = before.as_ref().map_or(*value, |before| before[i]);
                *value += 360.0 * ((near - *value) / 360.0).round();
            }
        }
        text += if k == 0 { "G0" } else { "G1" };
        for (letter, value) in letters.iter().zip(&at) {
            write!(text, " {}{value:.6}", char::from(*letter)).expect("written");
        }
        text += if k == 0 { "\n" } else { " E.05 F1200\n" };
        before = Some(at);
    }
    assert_eq!(joint_channels(kinematics).len(), letters.len());
    text
}

fn is_at(place: &Place, pose: &Pose<f64>) -> bool {
    let (axis, heading_rad) = place.axis_and_heading();
    let tip_mm = Vector3::from(place.tip_mm) - pose.tip_mm;
    let upright = Rotation3::rotation_between(&Vector3::z(), &axis).expect("not upside down");
    let read = upright * Rotation3::from_axis_angle(&Vector3::z_axis(), heading_rad);
    // The norm of the difference of two turns is their angle times the root of 2, where that is small.
    let off_rad =
        (read.matrix() - pose.rotation().matrix()).norm() * std::f64::consts::FRAC_1_SQRT_2;
    tip_mm.norm() < TIP_MM && off_rad.to_degrees() < TURN_DEG
}

#[test]
fn joints_of_every_kind_come_back_as_their_poses() {
    for kind in &KINDS {
        let settings = machine(kind.file);
        let kinematics = &settings.machine.kinematics;
        let joints = joint_names(kinematics);
        let poses = vase(&settings, kind.tilts_deg);
        let own: Vec<u8> = match kind.letters.strip_prefix(",letters=") {
            Some(letters) => letters.bytes().filter(|letter| *letter != b'/').collect(),
            None => joints
                .iter()
                .map(|name| name.as_bytes()[0].to_ascii_uppercase())
                .collect(),
        };
        let text = text_of(&poses, &settings, &own);
        let of_machine = format!("machine{}", kind.letters);
        for words in [Some(of_machine.as_str()), kind.words]
            .into_iter()
            .flatten()
        {
            let parsed = AxesWords::parse(words).expect("words");
            let machine = FileMachine { kinematics, joints };
            let machine = parsed.machine.is_some().then_some(&machine);
            let axes = FileAxes::new(&parsed, machine).expect("axes");
            let options = GcodeOptions {
                axes: Some(Arc::new(axes)),
                ..GcodeOptions::default()
            };
            let program = read(text.as_bytes(), kind.file, &options);
            let program = program.unwrap_or_else(|error| panic!("{} {words}: {error}", kind.file));
            assert_eq!(program.passes.len(), 1, "{} {words}", kind.file);
            let places = &program.passes[0].points;
            let mut from = 0;
            for (number, pose) in poses.iter().enumerate() {
                let found = places[from..].iter().position(|place| is_at(place, pose));
                from += found.unwrap_or_else(|| {
                    let off = |place: &Place| (Vector3::from(place.tip_mm) - pose.tip_mm).norm();
                    let near = places.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
                    panic!(
                        "{} {words}: pose {number} {pose:?} is not read: {near:?}",
                        kind.file
                    )
                });
            }
            assert_eq!(from + 1, places.len());
            // Every step of a vase is at least its move's: nothing went the other way around.
            assert!(
                places.len() < 40 * POSES,
                "{} {words}: {}",
                kind.file,
                places.len()
            );
        }
    }
}

//! Goal: the links that the page draws end at the machine's tip. Method: random joint positions of the
//! example machines; the tool's frame on the part against the firmware's forward kinematics.

use super::*;
use headway_firmware::configuration::JOINTS_MAX;
use headway_firmware::kinematics;
use headway_firmware::kinematics::pose::Pose;
use std::path::Path;

fn machine(name: &str) -> Settings {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/machines");
    let text = std::fs::read_to_string(file.join(name)).expect("a machine file");
    crate::settings::machine_file::from_toml(&text).expect("settings")
}

/// Numbers from -1 to 1, the same in every run.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

#[test]
fn the_last_link_is_where_forward_kinematics_says() {
    let files = [
        "gantry.toml",
        "trunnion.toml",
        "arm-small.toml",
        "arm-large.toml",
    ];
    for file in files {
        let settings = machine(file);
        let offset_mm = [12.5, -7.25, 31.0];
        let transform = PartTransform { offset_mm };
        let links = MachineLinks::of(&settings.machine, &settings, &transform).expect("links");
        let mut noise = noise(7);
        for round in 0..2000 {
            let mut joints = [0.0; JOINTS_MAX];
            for (position, joint) in joints.iter_mut().zip(&settings.machine.joints) {
                *position = noise() * if joint.rotary { 1.4 } else { 200.0 };
            }
            let pose: Pose<f64> = kinematics::forward(&settings.machine.kinematics, &joints);
            let tool = links.tool_on_part(&joints);
            let tip_mm = transform.to_input(pose.tip_mm.into());
            let off_mm = (tool.translation.vector - Vector3::from(tip_mm)).norm();
            // Metres in f64, some ten products of them.
            assert!(off_mm < 1e-9, "{file}, round {round}: {off_mm} mm off");
            let turned = tool.rotation.to_rotation_matrix();
            let off = (turned.matrix() - pose.rotation().matrix()).norm();
            assert!(off < 1e-9, "{file}, round {round}: turned by {off}");
        }
    }
}

#[test]
fn the_part_lies_where_the_input_has_it() {
    let settings = machine("trunnion.toml");
    let offset_mm = [150.0, 150.0, 25.0];
    let transform = PartTransform { offset_mm };
    let links = MachineLinks::of(&settings.machine, &settings, &transform).expect("links");
    let rest = links.frames(&[0.0; JOINTS_MAX])[links.part];
    assert!(rest.translation.vector.norm() < 1e-12 && rest.rotation.angle() < 1e-12);
    // The part is 25 mm above the table's centre; tilted by 90° about X it lies as far to the front.
    let mut joints = [0.0; JOINTS_MAX];
    joints[3] = std::f64::consts::FRAC_PI_2;
    let origin = links.frames(&joints)[links.part].translation.vector;
    assert!(
        (origin - Vector3::new(0.0, -25.0, -25.0)).norm() < 1e-12,
        "{origin}"
    );
}

#[test]
fn every_link_comes_after_its_parent_and_planar_machines_have_none() {
    let settings = machine("arm-small.toml");
    let links = MachineLinks::of(&settings.machine, &settings, &PartTransform::default());
    let links = links.expect("links").links;
    assert!(
        links
            .iter()
            .enumerate()
            .skip(1)
            .all(|(k, link)| link.parent < k)
    );
    assert!(
        links
            .iter()
            .flat_map(|link| &link.solids)
            .flatten()
            .flatten()
            .all(|mm| mm.is_finite())
    );
    let planar = Settings::default();
    assert!(MachineLinks::of(&planar.machine, &planar, &PartTransform::default()).is_none());
}

//! The machines that are attacked: all kinds of kinematics, with switches and heaters.

use crate::attack::Kind;
use headway::settings::Settings;
use headway::settings::examples::MachineExample;
use headway::settings::machine_file::from_toml;
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_firmware::configuration::{JOINTS_MAX, MachineConfiguration};
use headway_firmware::kinematics::forward;
use headway_firmware::line::Conversation;
use headway_firmware::machine::Machine;
use headway_protocol::frame::{FRAME_BYTES_MAX, encode_frame};
use headway_protocol::message::{
    DeviceState, Hello, HostMessage, PROTOCOL_VERSION, SCHEMA_HASH, Start,
};
use headway_protocol::units::{ChannelPoint, Units, to_units};
use std::sync::LazyLock;

/// Places of the joints in their ranges that are tried as the middle of a machine: where two axes line up there is
/// none.
const SHARES: [f64; 4] = [0.5, 0.55, 0.6, 0.4];

/// A machine, and where it may be.
pub struct Subject {
    /// Its settings.
    pub configuration: MachineConfiguration,
    /// The usual ones for it.
    pub switches: HomingConfiguration,
    /// The usual ones.
    pub heat: HeatConfiguration,
    /// As it comes from start-up.
    pub machine: Machine,
    /// A pose in the middle of its ranges,
    pub centre: ChannelPoint,
    /// and the joint solution in which it is there.
    pub solution: u8,
    /// The tool axis stays where it is.
    pub upright: bool,
}

static SUBJECTS: LazyLock<Vec<Subject>> = LazyLock::new(|| {
    let built_in = [Settings::planar(), Settings::gantry()];
    let examples = MachineExample::ALL
        .map(|example| from_toml(example.text()).expect("an example file is read"));
    let all = built_in.into_iter().chain(examples);
    let all = all.chain([Settings::core_xy()]);
    all.map(|settings| subject(&settings)).collect()
});

/// The machine of a kind.
pub fn subject_of(kind: Kind) -> &'static Subject {
    &SUBJECTS[kind as usize]
}

/// Settings of every kind.
pub fn all() -> &'static [Subject] {
    &SUBJECTS
}

fn subject(settings: &Settings) -> Subject {
    let configuration = settings.machine.clone();
    let switches = HomingConfiguration::standard(&configuration);
    let machine = Machine::with_switches(&configuration, &switches, 0xfeed);
    let machine = machine.expect("built-in machines run");
    let solutions = 0..configuration.kinematics.solutions();
    let places = SHARES.map(|share| pose_at(&configuration, share));
    let mut tried = places
        .iter()
        .flat_map(|place| solutions.clone().map(move |solution| (*place, solution)));
    let (centre, solution) = tried
        .find(|(place, solution)| can_be_at(&configuration, &machine, place, *solution))
        .expect("every machine has a middle");
    Subject {
        heat: HeatConfiguration::standard(),
        upright: !settings.tilts(),
        configuration,
        switches,
        machine,
        centre,
        solution,
    }
}

fn pose_at(configuration: &MachineConfiguration, share: f64) -> ChannelPoint {
    let mut joints = [0.0; JOINTS_MAX];
    for (place, joint) in joints.iter_mut().zip(&configuration.joints) {
        if !joint.is_endless() {
            *place = joint.position_min + share * (joint.position_max - joint.position_min);
        }
    }
    let pose = forward(&configuration.kinematics, &joints);
    let (tip, tilt) = (pose.tip_mm, pose.tilt_rad);
    to_units(&[tip.x, tip.y, tip.z, tilt.x, tilt.y, pose.heading_rad, 0.0])
}

fn can_be_at(
    configuration: &MachineConfiguration,
    machine: &Machine,
    place: &ChannelPoint,
    solution: u8,
) -> bool {
    let mut machine = machine.clone();
    let mut line = Conversation::new(configuration, 1);
    let mut out = [0u8; FRAME_BYTES_MAX];
    let (hello, start) = opening(configuration, 1, place, solution);
    for (sequence, message) in [(1, hello), (2, start)] {
        if let Ok(length) = encode_frame(sequence, &message, &mut out) {
            machine.handle_line(&mut line, &out[..length]);
        }
    }
    machine.motion().state() == DeviceState::Filling
}

/// A greeting, and the opening of a stream at a place.
pub fn opening(
    configuration: &MachineConfiguration,
    host_session: u32,
    place: &ChannelPoint,
    solution: u8,
) -> (HostMessage<'static>, HostMessage<'static>) {
    let hello = HostMessage::Hello(Hello {
        protocol_version: PROTOCOL_VERSION,
        schema_hash: SCHEMA_HASH,
        host_session,
    });
    let start = HostMessage::Start(Start {
        job: 1,
        machine_hash: configuration.hash(),
        first_sequence: 0,
        position: *place,
        solution,
        units: Units::BASE,
    });
    (hello, start)
}

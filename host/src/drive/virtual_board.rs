//! A board without hardware: the firmware library behind a TCP or unix socket, in real time or
//! faster. A program that streams to it can stream to a real board.
//!
//! Its heaters are a model. Its steps only go into counters and a digest. Limit switches close at their
//! positions, so that homing can be tried. One host streams and moves; others may query and stop at the same
//! time (`board_lines`).

use crate::bed_mesh::BedMesh;
use crate::drive::board_lines::Lines;
use crate::drive::record::{Step, StepDigest};
use crate::drive::transport::Listener;
use crate::drive::virtual_drivers::VirtualDrivers;
use crate::drive::virtual_heaters::VirtualHeaters;
use crate::settings::probe::ProbeSettings;
use headway_firmware::board::octopus;
use headway_firmware::configuration::board_name::BoardName;
use headway_firmware::configuration::drivers::DriversConfiguration;
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_firmware::configuration::{
    ConfigurationError, JOINTS_MAX, MOTORS_MAX, MachineConfiguration,
};
use headway_firmware::design::{HOST_SILENT_MS, WEIGHED_KNOTS};
use headway_firmware::drivers::DriverService;
use headway_firmware::heat::HOST_SILENT_S;
use headway_firmware::kinematics::forward;
use headway_firmware::line::Conversation;
use headway_firmware::machine::Machine;
use headway_firmware::machine::round::{Controller, Surroundings};
use headway_firmware::motion::inputs::Inputs;
use headway_firmware::motion::probe_pin::{self, ProbePin};
use headway_firmware::settings::BoardLimits;
use headway_firmware::steps::output::StepOutput;
use headway_protocol::message::{PROBE_BIT, PinPosition};
use std::f64::consts::TAU;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Most virtual time made up at once: a computer that cannot keep up slows the board down.
const CATCH_UP_S: f64 = 0.05;
/// Virtual time between two checks for reports: a computer that catches up much time at once still
/// reports as often as a board whose main loop never rests.
const REPORT_PERIOD_S: f64 = 0.005;
/// Time between two checks of silent lines.
const LOOK: Duration = Duration::from_millis(1);

/// What to simulate.
#[derive(Clone, Debug)]
pub struct BoardSetup {
    /// The machine.
    pub machine: MachineConfiguration,
    /// Its switches; [`HomingConfiguration::none`] for none.
    pub switches: HomingConfiguration,
    /// Differs after every start.
    pub session: u32,
    /// Virtual seconds per second.
    pub speed: f64,
    /// Its heaters, cold at first; without any there is no fan either.
    pub heat: HeatConfiguration,
    /// What its probe trips at.
    pub bed: VirtualBed,
}

/// A bed below a probe.
#[derive(Clone, Debug, Default)]
pub struct VirtualBed {
    /// Its heights; flat at Z 0 without.
    pub mesh: Option<BedMesh>,
    /// Where the probe is, from the nozzle.
    pub probe: ProbeSettings,
    /// It is Z's switch at its lower end.
    pub is_switch_of_z: bool,
    /// Its pin, if it has one.
    pub pin: ProbePin,
}

impl VirtualBed {
    /// True where the probe touches the bed with the nozzle there, mm.
    fn is_touched(&self, [x_mm, y_mm, z_mm]: [f64; 3]) -> bool {
        let [dx_mm, dy_mm] = self.probe.offset_mm;
        let (x_mm, y_mm) = (x_mm + dx_mm, y_mm + dy_mm);
        let height = |mesh: &BedMesh| mesh.height_mm(x_mm, y_mm);
        z_mm - self.probe.z_offset_mm <= self.mesh.as_ref().map_or(0.0, height)
    }
}

/// Width of the index mark of a joint without ends: 3 mm at a radius of 60 mm.
const INDEX_RAD: f64 = 0.05;

/// The joint that moves down to it.
const Z: usize = 2;

/// Follows the steps.
#[derive(Clone, Debug, Default)]
struct Steps {
    directions: u8,
    counts: [i64; MOTORS_MAX],
    steps: u64,
    /// Step tick at which the newest job's segment time began to run, and the digest since then.
    origin_tick: u64,
    digest: StepDigest,
}

impl Steps {
    /// A job's segment time began at this step tick.
    fn begin_job(&mut self, origin_tick: u64) {
        if origin_tick != self.origin_tick {
            self.origin_tick = origin_tick;
            self.digest = StepDigest::default();
        }
    }
}

impl StepOutput for Steps {
    fn set_directions(&mut self, directions: u8) {
        self.directions = directions;
    }
    fn step(&mut self, tick: u64, motors: u8) {
        let tick = tick.wrapping_sub(self.origin_tick);
        for (motor, count) in (0..).zip(&mut self.counts) {
            if motors >> motor & 1 == 1 {
                let forward = self.directions >> motor & 1 == 1;
                *count += if forward { 1 } else { -1 };
                self.steps += 1;
                self.digest.add(&Step {
                    tick,
                    motor,
                    forward,
                });
            }
        }
    }
}

/// What a board has done.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BoardFigures {
    /// Steps of all motors.
    pub steps: u64,
    /// Hash of the newest job's steps, 16 hex digits: that of the simulation, if the queue never ran dry.
    pub step_digest: String,
    /// The firmware's step counts: joints in order, then the extruder.
    pub counts: Vec<i64>,
    /// How often the queue ran dry.
    pub underruns: u32,
    /// Hosts that have connected.
    pub hosts: u64,
}

/// The firmware library on a socket.
pub struct VirtualBoard {
    setup: BoardSetup,
    machine: Machine,
    heaters: VirtualHeaters,
    steps: Steps,
    listener: Listener,
    lines: Lines,
    begun: Instant,
    ticks_done: u64,
    /// Stores received settings, if possible.
    store: Option<SettingsWriter>,
    drivers: Option<(DriverService, VirtualDrivers)>,
}

/// The surroundings of a round of the board's main loop. Its lines are served between rounds, since hosts are
/// exchanged on them ([`Lines`]).
struct Around<'a> {
    heaters: &'a mut VirtualHeaters,
    drivers: &'a mut Option<(DriverService, VirtualDrivers)>,
    bytes: std::iter::Empty<u8>,
}

impl Surroundings for Around<'_> {
    const AT_ONCE: bool = false;
    const WEIGHED_KNOTS: usize = WEIGHED_KNOTS;
    type Bytes = std::iter::Empty<u8>;

    fn heard(&mut self, _line: usize) -> &mut Self::Bytes {
        &mut self.bytes
    }

    fn has_room(&mut self, _line: usize) -> bool {
        false
    }

    fn send(&mut self, _line: usize, _bytes: &[u8]) -> usize {
        0
    }

    fn heat(&mut self, controller: &mut impl Controller) {
        self.heaters.turn(|service| {
            let served = controller.with_motion(|motion| service.serve(motion, 0));
            served.flatten()
        });
    }

    fn drivers(&mut self, controller: &mut impl Controller) {
        let Some((service, port)) = self.drivers else {
            return;
        };
        if controller.with_motion(|motion| service.is_due(motion)) == Some(true) {
            service.turn(port);
            controller.with_motion(|motion| service.tell(motion));
        }
    }
}

/// Writes a record of settings to a place that survives a restart; true if it succeeded.
pub type SettingsWriter = Box<dyn FnMut(&[u8]) -> bool>;

impl VirtualBoard {
    /// Starts up.
    ///
    /// # Errors
    /// [`ConfigurationError`] where the firmware cannot run the machine.
    pub fn new(setup: BoardSetup, listener: Listener) -> Result<VirtualBoard, ConfigurationError> {
        let mut machine = Machine::with_switches(&setup.machine, &setup.switches, setup.session)?;
        machine.fit_probe_pin(setup.bed.pin);
        let mut heaters = VirtualHeaters::new(&mut machine, &setup.machine, &setup.heat);
        // Its time may run faster than that of its hosts, who have to be heard as often as a real board hears them.
        let patience = setup.speed.max(1.0);
        machine.wait_for_host((f64::from(HOST_SILENT_MS) * patience) as u32);
        heaters.wait_for_host(HOST_SILENT_S * patience as f32);
        Ok(VirtualBoard {
            setup,
            machine,
            heaters,
            steps: Steps::default(),
            listener,
            lines: Lines::default(),
            begun: Instant::now(),
            ticks_done: 0,
            store: None,
            drivers: None,
        })
    }

    /// The board has a store: received settings are kept with `store`, for its next start.
    pub fn keep_settings(&mut self, store: SettingsWriter) {
        let machine = &self.setup.machine;
        self.machine.keep_settings(BoardLimits {
            motors_max: MOTORS_MAX,
            servo_hz: machine.servo_hz,
            step_hz: machine.step_hz,
            inputs: octopus::BOARD.board_inputs(),
            names: &BoardName::ALL,
        });
        self.store = Some(store);
    }

    /// The active settings came from a record with this CRC.
    pub fn settings_in_force(&mut self, hash: u32) {
        self.machine.settings_in_force(hash);
    }

    /// Drivers with which it communicates: they are set up now, and served from here on.
    pub fn drive_with(&mut self, drivers: &DriversConfiguration, mut port: VirtualDrivers) {
        let mut service = DriverService::new(drivers, self.setup.machine.servo_hz);
        self.machine.set_up_drivers(&mut service, &mut port);
        self.drivers = Some((service, port));
    }

    /// Serves until stopped; `each` is called after every turn and may drop the line.
    ///
    /// # Errors
    /// The listener's.
    pub fn serve(
        &mut self,
        stop: &AtomicBool,
        mut each: impl FnMut(&mut VirtualBoard),
    ) -> io::Result<BoardFigures> {
        while !stop.load(Ordering::Relaxed) {
            self.turn()?;
            each(self);
        }
        Ok(self.figures())
    }

    /// Drops the connection, as a pulled cable does.
    pub fn pull(&mut self) {
        self.lines.pull(&mut self.machine);
    }

    /// The controller.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Its figures so far.
    pub fn figures(&self) -> BoardFigures {
        let motion = self.machine.motion();
        BoardFigures {
            steps: self.steps.steps,
            step_digest: format!("{:016x}", self.steps.digest.0),
            counts: motion.counts()[..motion.motors()].to_vec(),
            underruns: motion.underruns(),
            hosts: self.lines.hosts,
        }
    }

    /// Takes bytes, lets the time pass that has passed, answers.
    fn turn(&mut self) -> io::Result<()> {
        let store = &mut self.store;
        // After each message: what one completes is stored before the next is taken.
        let keep = |machine: &mut Machine, talk: &mut Conversation| {
            if let Some(store) = store {
                machine.store_settings(talk, store);
            }
        };
        if !self.lines.hear(&mut self.machine, keep) {
            std::thread::sleep(LOOK);
        }
        self.pass();
        self.lines.report(&mut self.machine);
        let configuration = &self.setup.machine;
        self.lines
            .accept(&self.listener, configuration, &mut self.machine)
    }

    fn pass(&mut self) {
        let servo_hz = f64::from(self.setup.machine.servo_hz);
        let rate_hz = servo_hz * self.setup.speed;
        let due = (self.begun.elapsed().as_secs_f64() * rate_hz) as u64;
        let most = (CATCH_UP_S * rate_hz) as u64 + 1;
        let ticks = due.saturating_sub(self.ticks_done).min(most);
        let report_ticks = (REPORT_PERIOD_S * servo_hz) as u64 + 1;
        for tick in 1..=ticks {
            let switches = self.switches();
            self.machine.set_inputs(Inputs {
                switches,
                emergency: false,
            });
            let mut around = Around {
                heaters: &mut self.heaters,
                drivers: &mut self.drivers,
                bytes: std::iter::empty(),
            };
            self.machine.round(&mut self.steps, &mut around);
            if let Some(start) = self.machine.motion().stream_start_ticks() {
                let interval_ticks = u64::from(self.machine.interval_ticks());
                self.steps.begin_job(start * interval_ticks);
            }
            if tick.is_multiple_of(report_ticks) {
                self.lines.report(&mut self.machine);
            }
        }
        self.ticks_done = due;
    }

    /// Where the joints truly are, mm and rad. The board starts in the middle of its range and does not
    /// know it; a joint without ends at 0.
    fn joints(&self) -> [f64; JOINTS_MAX] {
        let mut joints = [0.0; JOINTS_MAX];
        let steps = std::array::from_fn(|motor| self.steps.counts[motor] as f64);
        let steps = self.setup.machine.motors.joint_steps(&steps);
        let counted = self.setup.machine.joints.iter().zip(steps);
        for (place, (joint, count)) in joints.iter_mut().zip(counted) {
            let middle = 0.5 * (joint.position_min + joint.position_max);
            let middle = if middle.is_finite() { middle } else { 0.0 };
            *place = middle + count / joint.steps_per_unit;
        }
        joints
    }

    /// Bit of each joint that has run into its switch, and of the probe.
    fn switches(&self) -> u8 {
        let joints = self.joints();
        let tip = forward(&self.setup.machine.kinematics, &joints).tip_mm;
        let bed = &self.setup.bed;
        let pulse_us = self.machine.motion().probe_pulse_us();
        // A pin that is in touches nothing.
        let is_out = pulse_us == 0 || pulse_us == probe_pin::pulse_us(PinPosition::Deploy);
        let touched = is_out && bed.is_touched([tip.x, tip.y, tip.z]);
        let mut mask = u8::from(touched) << PROBE_BIT;
        for switch in &self.setup.switches.joints {
            let number = usize::from(switch.joint);
            let Some(at) = joints.get(number) else {
                continue;
            };
            let pressed = if number == Z && bed.is_switch_of_z {
                touched
            } else if self
                .setup
                .switches
                .is_mark(switch.joint, &self.setup.machine)
            {
                // An index mark, passed once a turn.
                let turns = (*at - switch.position_natural) / TAU;
                (turns - turns.round()).abs() * TAU < 0.5 * INDEX_RAD
            } else if switch.towards_max {
                *at >= switch.position_natural
            } else {
                *at <= switch.position_natural
            };
            mask |= u8::from(pressed) << number;
        }
        mask
    }
}

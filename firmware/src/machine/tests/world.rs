//! Common code of the tests of manual moves and of switches: a machine whose steps move carriages
//! with switches that bounce.
use super::*;
use crate::configuration::homing::{HomingConfiguration, JointHoming};
use crate::motion::inputs::Inputs;
use crate::steps::motor_mix::MotorMix;
use headway_protocol::message::PROBE_BIT;

/// A machine with carriages: where each motor really is, in steps from its switch.
pub(super) struct World {
    pub(super) host: Host,
    /// Joint, true if the switch is at the upper end, its place in true steps.
    pub(super) switches: Vec<(usize, bool, i64)>,
    /// True position = counted steps + this.
    pub(super) offsets: [i64; 8],
    mix: MotorMix,
    /// Width and turn of a joint's index switch, steps: pressed from its place down, once a turn.
    pub(super) index: Option<(usize, i64, i64)>,
    /// Ticks for which a switch chatters after its edge.
    pub(super) bounce_ticks: u32,
    pub(super) last_pressed: u8,
    chatter: [u32; 8],
    random: u32,
    pub(super) stuck: u8,
    /// The bed below each place of X and Y, true steps: the probe's.
    pub(super) bed: Option<fn(i64, i64) -> i64>,
    /// The probe is a pin.
    pub(super) pin: Option<Pin>,
}

/// A BLTouch: the pin goes out some time after it is told to, and in by itself with a short pulse when it
/// touches; it must be told something else before it goes out again.
#[derive(Default)]
pub(super) struct Pin {
    pub(super) told_us: u16,
    /// Ticks until it is out; it twitches as it begins.
    pub(super) leaves_in: Option<u32>,
    pub(super) is_out: bool,
    pub(super) pulse_left: u32,
    /// How often it touched.
    pub(super) touches: u32,
    /// It does not go out any more.
    pub(super) is_stuck: bool,
    /// It is Z's switch.
    pub(super) is_switch_of_z: bool,
}

impl Pin {
    fn tick(&mut self, pulse_us: u16, at_bed: bool) -> bool {
        if pulse_us != self.told_us {
            self.told_us = pulse_us;
            self.is_out = false;
            self.leaves_in = (pulse_us == 650 && !self.is_stuck).then_some(1200);
        }
        if let Some(left) = self.leaves_in {
            self.leaves_in = left.checked_sub(1);
            self.is_out = left == 0;
            if left == 1195 {
                self.pulse_left = 6;
            }
        }
        if self.is_out && at_bed {
            self.is_out = false;
            self.touches += 1;
            // 10 ms.
            self.pulse_left = 20;
        }
        let pressed = self.pulse_left > 0;
        self.pulse_left = self.pulse_left.saturating_sub(1);
        pressed
    }
}

pub(super) fn machine() -> (MachineConfiguration, HomingConfiguration) {
    let mut configuration = planar();
    for joint in 0..3 {
        configuration.joints[joint].position_min = 0.0;
        configuration.joints[joint].position_max = 200.0;
    }
    let mut switches = HomingConfiguration::standard(&configuration);
    let nozzle = JointHoming {
        joint: 3,
        towards_max: false,
        fast_natural_s: 2.0,
        slow_natural_s: 0.2,
        back_off_natural: 0.1,
        travel_max_natural: 7.0,
        position_natural: 0.5,
        guards: false,
    };
    switches.joints.push(nozzle).unwrap();
    (configuration, switches)
}

impl World {
    pub(super) fn new(
        configuration: &MachineConfiguration,
        switches: &HomingConfiguration,
    ) -> Self {
        let machine = Machine::with_switches(configuration, switches, 77).unwrap();
        let places = switches.joints.iter().map(|switch| {
            let joint = usize::from(switch.joint);
            // Somewhere between the starts and the ends of the carriages.
            let place = if switch.towards_max { 7000 } else { -6000 };
            (joint, switch.towards_max, place + 13 * joint as i64)
        });
        Self {
            host: Host::greet(machine, &flower()),
            switches: places.collect(),
            offsets: [0; 8],
            mix: MotorMix::new(&configuration.motors, configuration.joints.len()),
            index: None,
            bounce_ticks: 0,
            last_pressed: 0,
            chatter: [0; 8],
            random: 7,
            stuck: 0,
            bed: None,
            pin: None,
        }
    }

    /// Where the carriage of a joint truly is, steps.
    pub(super) fn truth(&self, joint: usize) -> i64 {
        self.mix.joints_of(self.host.counter.counts)[joint] + self.offsets[joint]
    }

    fn pressed(&mut self) -> u8 {
        let mut pressed = self.stuck;
        for &(joint, upper, place) in &self.switches {
            let truth = self.truth(joint);
            if let Some((index, width, turn)) = self.index
                && index == joint
            {
                let below = (place - truth).rem_euclid(turn);
                pressed |= u8::from(below < width) << joint;
                continue;
            }
            if (upper && truth >= place) || (!upper && truth <= place) {
                pressed |= 1 << joint;
            }
        }
        let at_bed = |bed: fn(i64, i64) -> i64| self.truth(2) <= bed(self.truth(0), self.truth(1));
        let at_bed = self.bed.is_some_and(at_bed);
        let pulse_us = self.host.machine.motion().probe_pulse_us();
        let touched = match &mut self.pin {
            Some(pin) => pin.tick(pulse_us, at_bed),
            None => at_bed,
        };
        pressed |= u8::from(touched) << PROBE_BIT;
        if let Some(pin) = &self.pin
            && pin.is_switch_of_z
        {
            pressed = pressed & !4 | u8::from(touched) << 2;
        }
        for joint in 0..8 {
            if (pressed ^ self.last_pressed) >> joint & 1 == 1 {
                self.chatter[joint] = self.bounce_ticks;
            }
        }
        self.last_pressed = pressed;
        for joint in 0..8 {
            if self.chatter[joint] > 0 {
                self.chatter[joint] -= 1;
                self.random = self
                    .random
                    .wrapping_mul(1_664_525)
                    .wrapping_add(1_013_904_223);
                if self.random >> 31 == 1 {
                    pressed ^= 1 << joint;
                }
            }
        }
        pressed
    }

    pub(super) fn tick(&mut self) {
        let switches = self.pressed();
        self.host.machine.set_inputs(Inputs {
            switches,
            emergency: false,
        });
        self.host.tick();
    }

    pub(super) fn command(&mut self, control: Control) {
        self.host.control(HostMessage::Control(control));
    }

    /// Runs until nothing moves; the number of ticks it took.
    pub(super) fn settle(&mut self) -> u32 {
        for tick in 1..400_000 {
            self.tick();
            let motion = self.host.machine.motion();
            let free = !matches!(
                motion.state(),
                DeviceState::Homing | DeviceState::Jogging | DeviceState::Probing
            );
            if free && motion.is_at_rest() {
                for _ in 0..SERVO_DELAY_TICKS {
                    self.tick();
                }
                self.host.poll();
                return tick;
            }
        }
        panic!("it never rests: {:?}", self.host.machine.motion().state());
    }

    /// Count that the machine believes, less where the carriage truly is.
    pub(super) fn belief(&self, joint: usize) -> i64 {
        let counts = self.host.machine.motion().counts();
        self.mix.joints_of(counts)[joint] - self.truth(joint)
    }
}

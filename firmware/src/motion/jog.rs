//! Moves outside any stream: jog, homing, probing, prime and retract by hand.
//!
//! They are in joint space, one joint at a time, without a tool-centre transform. All begin and end
//! at rest with no stream open; an abort or a fault brakes them. Afterwards the motors keep their
//! position, and the next stream must begin there.

use super::state::{Standing, State};
use super::{CommandError, Motion};
use crate::configuration::homing::HomingConfiguration;
use crate::configuration::{JOINTS_MAX, MOTORS_MAX, MachineConfiguration};
use crate::flow::extruder_limits::event_ratio;
use crate::motion::heat_panel::Melt;
use crate::motion::homing::{Homing, HomingOutcome};
use crate::motion::joint_move::{JointMove, MoveLimits};
use crate::path::interpolator::RestPose;
use crate::steps::{STEP, StepScale, Target};
use headway_protocol::message::{Control, Fault, FaultCause, JointOrder, PROBE_BIT};
use headway_protocol::segment::{FlowAction, FlowEvent};
use headway_protocol::units::{CHANNEL_VOLUME, ChannelPoint, Ticks, UNITS_PER_NATURAL};
use heapless::Vec;

/// Share of a joint's speed limit that going to a pose uses.
const GO_TO_SPEED_SHARE: f64 = 0.5;
/// The joint that goes up and down, on every machine so far.
const Z: usize = 2;

/// State of the moves by hand.
#[derive(Clone, Debug)]
pub(super) struct Jog {
    pub(super) machine: MachineConfiguration,
    switches: HomingConfiguration,
    /// Joints to be homed, and how many of them are.
    order: Vec<u8, { JointOrder::JOINTS_MAX }>,
    homed: usize,
    /// Moves to make one after the other: joint and goal; and how many of them have begun.
    route: Vec<(u8, i64), JOINTS_MAX>,
    begun: usize,
    pub(super) homing: Option<Homing>,
    /// The current homing is a probing.
    pub(super) probing: bool,
    pub(super) joint: usize,
    pub(super) mover: JointMove,
    /// Where the motors are to be.
    targets: [i64; MOTORS_MAX],
    /// Extruder position minus the flow's.
    extruder_offset: i64,
}

impl Jog {
    pub(super) fn new(machine: &MachineConfiguration, switches: &HomingConfiguration) -> Self {
        let given = switches;
        let mut switches = given.clone();
        for switch in &mut switches.joints {
            // A joint passes its index mark once a turn: settings may have any values.
            switch.guards &= !given.is_mark(switch.joint, machine);
        }
        Self {
            machine: machine.clone(),
            switches,
            order: Vec::new(),
            homed: 0,
            route: Vec::new(),
            begun: 0,
            homing: None,
            probing: false,
            joint: 0,
            mover: JointMove::at_rest(0),
            targets: [0; MOTORS_MAX],
            extruder_offset: 0,
        }
    }

    pub(super) fn is_homing(&self) -> bool {
        self.homing.is_some() || self.homed < self.order.len()
    }

    pub(super) fn is_probing(&self) -> bool {
        self.homing.is_some() && self.probing
    }

    /// Drops whatever is in progress.
    pub(super) fn clear(&mut self) {
        self.homing = None;
        self.probing = false;
        self.order.clear();
        self.homed = 0;
        self.route.clear();
        self.begun = 0;
    }

    /// Joints whose switches stop the present motion, of those that guard.
    fn guarded(&self) -> u8 {
        let homing = self.is_homing() && !self.probing;
        let moves = |joint: u8| usize::from(joint) == self.joint && !homing;
        let towards = |up: bool| self.mover.direction() == if up { 1 } else { -1 };
        self.switches
            .joints
            .iter()
            .filter(|switch| switch.guards && moves(switch.joint) && towards(switch.towards_max))
            .fold(0, |mask, switch| mask | 1 << switch.joint)
    }

    fn all_guards(&self) -> u8 {
        let guards = self.switches.joints.iter().filter(|switch| switch.guards);
        guards.fold(0, |mask, switch| mask | 1 << switch.joint)
    }

    /// Steps of a distance on the wire, 0.1 µm or µrad.
    #[inline(never)]
    pub(super) fn position_of(&self, joint: usize, units: i32) -> Option<i64> {
        let joint = self.machine.joints.get(joint)?;
        let scale = StepScale::new(joint.steps_per_unit / units_per_natural(joint.rotary));
        Some(scale.scaled(i64::from(units)).position)
    }
}

pub(super) fn units_per_natural(rotary: bool) -> f64 {
    if rotary { 1e6 } else { 1e4 }
}

impl Motion {
    /// Follows a command for a machine at rest.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn command_at_rest(&mut self, command: &Control) -> Result<(), CommandError> {
        if self.fault.is_some() {
            return Err(CommandError::Faulted);
        }
        if !self.is_free() {
            return Err(CommandError::Busy);
        }
        match *command {
            Control::SetPosition(position) => self.set_position(&position),
            Control::SetJoint {
                joint,
                position_units,
            } => self.set_joint(joint.into(), position_units),
            Control::Jog {
                joint,
                distance_units,
                speed_units_s,
            } => self.jog(joint.into(), distance_units, speed_units_s),
            Control::GoTo(position) => self.go_to(&position),
            Control::MotorsOff => {
                self.let_go(0);
                Ok(())
            }
            Control::Home(order) => self.home(order),
            Control::Probe { .. } => self.probe(command),
            Control::ProbePin(position) => self.move_pin(position),
            Control::Extrude {
                action,
                volume_units,
                duration_ticks,
            } => self.extrude(action, volume_units, duration_ticks),
            _ => Err(CommandError::Invalid),
        }
    }

    /// The motors but those `kept`, a mask, no longer hold: anything may push them.
    pub(super) fn let_go(&mut self, kept: u8) {
        self.reference.lose(self.joints.all() & !kept);
        self.kept_motors = kept;
        if let Some(standing) = self.state.standing_mut() {
            *standing = Standing::default();
        }
    }

    /// At rest with no stream open.
    pub(super) fn is_free(&self) -> bool {
        matches!(self.state, State::Idle { .. } | State::Finished(_)) && self.is_at_rest()
    }

    fn set_joint(&mut self, joint: usize, position_units: i32) -> Result<(), CommandError> {
        let position = self.jog.position_of(joint, position_units);
        let position = position.ok_or(CommandError::Invalid)?;
        if !self.joints.is_in_range(joint, position) {
            return Err(CommandError::Invalid);
        }
        self.declare_joint(joint, position);
        self.state = State::idle(Standing::left(self.state.holds_motors()));
        Ok(())
    }

    fn declare_joint(&mut self, joint: usize, position: i64) {
        let mut positions = self.programmer.newest_targets(&self.waiting);
        if let Some(slot) = positions.get_mut(joint) {
            *slot = position;
        }
        self.programmer.set_positions(&positions);
        self.jog.targets = positions;
        self.reference.learn(1 << joint);
    }

    fn jog(
        &mut self,
        joint: usize,
        distance_units: i32,
        speed_units_s: u32,
    ) -> Result<(), CommandError> {
        let hand = &self.jog;
        let distance = hand.position_of(joint, distance_units);
        let (Some(distance), Some(limits)) = (distance, hand.machine.joints.get(joint)) else {
            return Err(CommandError::Invalid);
        };
        let speed = f64::from(speed_units_s) / units_per_natural(limits.rotary);
        // A little more than the limit is the rounding of its units.
        if speed > limits.speed_max * (1.0 + 1e-6) {
            return Err(CommandError::Invalid);
        }
        let limits = MoveLimits::new(limits, speed, self.servo_hz);
        let here = self.joint_position(joint);
        if self.reference.known >> joint & 1 == 1 {
            // A joint that is outside, as on its switch, may come nearer.
            let goal = here.saturating_add(distance);
            let beyond = self.joints.beyond_range(joint, goal);
            if beyond > 0 && beyond >= self.joints.beyond_range(joint, here) {
                return Err(CommandError::Invalid);
            }
        }
        self.begin_jog();
        self.jog.joint = joint;
        self.jog.mover.begin(here, distance, limits);
        Ok(())
    }

    fn go_to(&mut self, position: &ChannelPoint) -> Result<(), CommandError> {
        let pose = RestPose::new(&self.joint_channels, position);
        let targets = self.rest_targets(&pose)?;
        let here = self.programmer.newest_targets(&self.waiting);
        let known = self.reference.known;
        self.begin_jog();
        let hand = &mut self.jog;
        let rises = targets.get(Z) > here.get(Z);
        let mut add = |joint: usize| {
            if known >> joint & 1 == 1
                && let (Some(goal), true) = (targets.get(joint), joint < hand.machine.joints.len())
            {
                // Room for every joint by the type's bound.
                let _ = hand.route.push((joint as u8, *goal));
            }
        };
        if rises {
            add(Z);
        }
        (0..JOINTS_MAX)
            .filter(|joint| *joint != Z)
            .for_each(&mut add);
        if !rises {
            add(Z);
        }
        self.rest_mover(0);
        Ok(())
    }

    /// Begins the next move of the route once the last one rests. True while moves remain.
    fn go_on(&mut self) -> bool {
        let hand = &self.jog;
        let Some(&(joint, goal)) = hand.route.get(hand.begun) else {
            return false;
        };
        if !hand.mover.is_done() || !self.programmer.is_at_rest() {
            return true;
        }
        let joint = usize::from(joint);
        let here = self.joint_position(joint);
        if let Some(limits) = hand.machine.joints.get(joint) {
            let speed = GO_TO_SPEED_SHARE * limits.speed_max;
            let limits = MoveLimits::new(limits, speed, self.servo_hz);
            let way = self.joints.way_to(joint, goal, here);
            self.jog.mover.begin(here, way, limits);
        }
        self.jog.joint = joint;
        self.jog.begun += 1;
        true
    }

    fn home(&mut self, order: JointOrder) -> Result<(), CommandError> {
        let switches = &self.jog.switches;
        let mut joints = Vec::new();
        if order == JointOrder::ALL {
            let all = switches.joints.iter().map(|switch| switch.joint);
            joints.extend(all.take(JointOrder::JOINTS_MAX));
        } else {
            joints.extend(order.joints());
        }
        let known = |joint: &u8| switches.of(*joint).is_some();
        if joints.is_empty() || !joints.iter().all(known) {
            return Err(CommandError::Invalid);
        }
        self.begin_jog();
        self.jog.order = joints;
        self.home_next();
        Ok(())
    }

    /// Begins with the next joint of the order.
    fn home_next(&mut self) {
        let hand = &mut self.jog;
        hand.homing = hand.order.get(hand.homed).and_then(|joint| {
            hand.joint = usize::from(*joint);
            let switch = hand.switches.of(*joint)?;
            let pin_ticks = self.pin.ticks_for(*joint, self.servo_hz);
            let is_mark = hand.switches.is_mark(*joint, &hand.machine);
            let homing = Homing::new(switch, &hand.machine)?.with_mark(is_mark);
            Some(homing.with_pin(pin_ticks))
        });
        if hand.homing.is_some() {
            // Until it has been found.
            self.reference.lose(1 << hand.joint);
        }
    }

    fn extrude(
        &mut self,
        action: FlowAction,
        volume_units: u32,
        duration_ticks: Ticks,
    ) -> Result<(), CommandError> {
        let extruder = &self.jog.machine.extruder;
        let volume_mm3 = f64::from(volume_units) / UNITS_PER_NATURAL[CHANNEL_VOLUME];
        let duration_s = f64::from(duration_ticks.0) / f64::from(self.servo_hz);
        if event_ratio(extruder, volume_mm3, duration_s) > 1.0 {
            return Err(CommandError::Invalid);
        }
        self.heat.begin_melt();
        if let Melt::Cold(heater) | Melt::Warming(heater) = self.heat.melt() {
            return Err(CommandError::Cold(heater));
        }
        self.begin_jog();
        // Nobody moves: the mover rests where the first joint is.
        self.rest_mover(0);
        self.flow.begin(&FlowEvent {
            span: 0,
            offset_ticks: 0,
            action,
            volume_units,
            duration_ticks,
        });
        Ok(())
    }

    #[inline(never)]
    pub(super) fn joint_position(&self, motor: usize) -> i64 {
        self.programmer
            .newest_targets(&self.waiting)
            .get(motor)
            .copied()
            .unwrap_or_default()
    }

    /// The mover rests where this joint is.
    // Once in the image.
    #[inline(never)]
    pub(super) fn rest_mover(&mut self, joint: usize) {
        self.jog.joint = joint;
        self.jog.mover = JointMove::at_rest(self.joint_position(joint));
    }

    /// A move by hand begins: nothing of the last one is left.
    #[inline(never)]
    pub(super) fn begin_jog(&mut self) {
        self.jog.clear();
        self.state = State::Jog { brakes: false };
        self.idle_ticks = 0;
        self.programmer.forget(&self.waiting);
        self.jog.targets = self.programmer.newest_targets(&self.waiting);
        let motor = self.joints.count();
        self.flow.take_scale(self.joint_channels.extruder_scale());
        self.flow.declare(&mut self.flow_window, Target::default());
        self.jog.extruder_offset = self.joint_position(motor);
    }

    /// One servo tick: the motors' targets.
    pub(super) fn tick_jog(&mut self, brakes: bool) -> [i64; MOTORS_MAX] {
        let motor = self.joints.count();
        if brakes || self.fault.is_some() {
            self.jog.clear();
            self.jog.mover.brake();
            self.flow.cut();
        }
        self.tick_homing();
        let goes_on = self.go_on();
        let (flow, _) = self.flow.target(&mut self.flow_window, Target::default());
        let flow = flow.distance();
        let hand = &mut self.jog;
        if let Some(target) = hand.targets.get_mut(motor) {
            *target = hand.extruder_offset + flow;
        }
        let place = hand.mover.tick();
        if let Some(target) = hand.targets.get_mut(hand.joint) {
            *target = place;
        }
        let idle = !goes_on && hand.mover.is_done() && !self.flow.is_active() && !hand.is_homing();
        if idle && self.programmer.is_at_rest() {
            self.state = State::idle(Standing::left(true));
        }
        self.jog.targets
    }

    fn tick_homing(&mut self) {
        let joint = self.jog.joint;
        let rests = self.jog.mover.is_done() && self.programmer.is_at_rest();
        let places = if rests {
            self.programmer.newest_targets(&self.waiting)
        } else {
            self.programmer.present_positions(&self.waiting)
        };
        let here = places.get(joint).copied().unwrap_or_default();
        let bit = if self.jog.probing {
            usize::from(PROBE_BIT)
        } else {
            joint
        };
        let pressed = self.inputs.switches >> bit & 1 == 1;
        let hand = &mut self.jog;
        let Some(homing) = &mut hand.homing else {
            return;
        };
        let outcome = homing.tick(pressed, here, rests, &mut hand.mover);
        if hand.probing {
            self.note_probe(outcome, joint, pressed);
            return;
        }
        match outcome {
            HomingOutcome::Moving => {}
            HomingOutcome::Homed(shift) => {
                self.declare_joint(joint, here.saturating_add(shift));
                self.jog.homed += 1;
                self.home_next();
                self.rest_mover(self.jog.joint);
            }
            HomingOutcome::Failed => self.fail_softly(Fault {
                cause: FaultCause::Homing,
                index: joint as u8,
                value: (here / STEP) as i32,
            }),
        }
    }

    /// The probe may be the joint's switch: pressed together they stop nothing.
    fn guarded_by_hand(&self) -> u8 {
        let probed = self.jog.is_probing() && self.inputs.switches >> PROBE_BIT & 1 == 1;
        self.jog.guarded() & !(u8::from(probed) << self.jog.joint)
    }

    /// Joints whose switch must stop the present motion.
    pub(super) fn guarded_switches(&self) -> u8 {
        match self.state {
            State::Running(_) => self.jog.all_guards(),
            State::Jog { .. } => self.guarded_by_hand(),
            _ => 0,
        }
    }
}

//! Finds a joint's switch: fast towards it, back off, slowly towards it again, and away.
//!
//! ```text
//! (release) -> seek, fast -> back off -> touch, slow -> leave -> homed: shift of the position
//!                                        touch, slow -> cross, slow -> homed, of a joint without ends
//! ```
//! A joint without ends passes its switch (an index mark, a Hall sensor) in every turn: both of its edges are found
//! slowly, in one direction, and the position is that of the middle between them, wherever the search started.
//! Homing works joint by joint in joint space, without a tool-centre transform. Sans-IO: the switch and the motor's
//! true position are inputs of every servo tick, the output goes to a [`JointMove`]. The switch must stay closed
//! for [`SWITCH_SETTLE_TICKS`]; the recorded position is that of its first tick.

use crate::configuration::MachineConfiguration;
use crate::configuration::homing::JointHoming;
use crate::design::SWITCH_SETTLE_TICKS;
use crate::motion::joint_move::{JointMove, MoveLimits};
use crate::steps::STEP;

/// The current phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// The probe's pin is being deployed; then the next phase.
    Deploy,
    /// Away from a switch that was pressed at the start.
    Release,
    /// It is free; coming to rest.
    Released,
    /// Fast towards it.
    Seek,
    /// It was found; coming to rest.
    Found,
    /// Away from it.
    BackOff,
    /// Slowly towards it.
    Touch,
    /// Touched; coming to rest.
    Touched,
    /// Slowly on to its other edge.
    Cross,
    /// That was passed; coming to rest.
    Crossed,
    /// Away from it, so that it is free.
    Leave,
}

/// Result of a servo tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomingOutcome {
    /// In progress.
    Moving,
    /// At rest; add this to the joint's position, 2^-31 steps.
    Homed(i64),
    /// At rest; the switch was not found, or stays pressed.
    Failed,
}

/// Homing of one joint, in 2^-31 steps.
#[derive(Clone, Debug)]
pub struct Homing {
    stage: Stage,
    /// +1 if the switch is at the upper end.
    direction: i64,
    fast: MoveLimits,
    slow: MoveLimits,
    back_off: i64,
    travel_max: i64,
    /// The end of the search: the touch goes no further.
    furthest: i64,
    home: i64,
    pressed_ticks: u32,
    first_pressed: i64,
    /// The edge that was found last.
    edge: i64,
    /// The joint has no ends: both edges count.
    both_edges: bool,
    free_ticks: u32,
    first_free: i64,
    begun: bool,
    /// Time for the probe's pin to go out; 0 without one.
    pin_ticks: u32,
    pin_left: u32,
    pin_is_out: bool,
    /// What follows when it is out.
    next: Stage,
}

impl Homing {
    /// `None` if the machine does not have the joint.
    // Once for homing and probing: kilobytes of soft doubles.
    #[inline(never)]
    pub fn new(homing: &JointHoming, machine: &MachineConfiguration) -> Option<Self> {
        let joint = machine.joints.get(usize::from(homing.joint))?;
        let position = |natural: f64| (natural * joint.steps_per_unit * STEP as f64) as i64;
        let limits = |speed: f64| MoveLimits::new(joint, speed, machine.servo_hz);
        Some(Self {
            stage: Stage::Seek,
            direction: if homing.towards_max { 1 } else { -1 },
            fast: limits(homing.fast_natural_s),
            slow: limits(homing.slow_natural_s),
            back_off: position(homing.back_off_natural),
            travel_max: position(homing.travel_max_natural),
            furthest: 0,
            home: position(homing.position_natural),
            pressed_ticks: 0,
            first_pressed: 0,
            edge: 0,
            both_edges: joint.is_endless(),
            free_ticks: 0,
            first_free: 0,
            begun: false,
            pin_ticks: 0,
            pin_left: 0,
            pin_is_out: false,
            next: Stage::Seek,
        })
    }

    /// With a switch that is a mark, of which both edges count, or not.
    #[must_use]
    pub fn with_mark(mut self, is_mark: bool) -> Self {
        self.both_edges = is_mark;
        self
    }

    /// With a probe whose pin needs this time to deploy, before each touch.
    #[must_use]
    pub fn with_pin(mut self, ticks: u32) -> Self {
        self.pin_ticks = ticks;
        self
    }

    /// The probe's pin is to be out.
    pub fn pin_is_out(&self) -> bool {
        self.pin_is_out
    }

    /// One servo tick: `pressed` is the switch, `here` the motor's position, `rests` that it does
    /// not move. Commands the mover.
    pub fn tick(
        &mut self,
        pressed: bool,
        here: i64,
        rests: bool,
        mover: &mut JointMove,
    ) -> HomingOutcome {
        let tripped = self.settled(pressed, here);
        let freed = self.both_edges && self.settled_free(pressed, here);
        if !self.begun {
            self.begun = true;
            // A pin's pulses are no switch that is pressed.
            if pressed && self.pin_ticks == 0 {
                self.enter(Stage::Release, here, mover);
            } else {
                self.approach(Stage::Seek, here, mover);
            }
            return HomingOutcome::Moving;
        }
        match self.stage {
            Stage::Deploy if self.pin_left > 0 => self.pin_left -= 1,
            Stage::Deploy if pressed => return HomingOutcome::Failed,
            Stage::Deploy => self.enter(self.next, here, mover),
            Stage::Seek if tripped => {
                mover.brake();
                self.edge = self.first_pressed;
                self.pin_is_out = false;
                self.stage = Stage::Found;
            }
            Stage::Touch if tripped => {
                mover.brake();
                self.edge = self.first_pressed;
                self.pin_is_out = false;
                self.stage = Stage::Touched;
            }
            // Out of a switch that was pressed at the start, however wide it is.
            Stage::Release if freed => {
                mover.brake();
                self.stage = Stage::Released;
            }
            Stage::Cross if freed => {
                mover.brake();
                self.stage = Stage::Crossed;
            }
            _ if !rests => {}
            Stage::Seek | Stage::Touch | Stage::Cross => return HomingOutcome::Failed,
            Stage::Found => self.enter(Stage::BackOff, here, mover),
            // A narrow one was passed while it came to rest.
            Stage::Touched if self.both_edges && freed => return self.homed_in_middle(),
            Stage::Touched if self.both_edges => self.enter(Stage::Cross, here, mover),
            Stage::Touched => {
                self.home -= self.edge;
                self.enter(Stage::Leave, here, mover);
            }
            Stage::Crossed => return self.homed_in_middle(),
            Stage::Released => self.enter(Stage::Seek, here, mover),
            Stage::Release | Stage::BackOff | Stage::Leave if pressed => {
                return HomingOutcome::Failed;
            }
            Stage::Release => self.enter(Stage::Seek, here, mover),
            Stage::BackOff => self.approach(Stage::Touch, here, mover),
            Stage::Leave => return HomingOutcome::Homed(self.home),
        }
        HomingOutcome::Moving
    }

    /// True once the switch has been pressed long enough.
    fn settled(&mut self, pressed: bool, here: i64) -> bool {
        if !pressed {
            self.pressed_ticks = 0;
            return false;
        }
        if self.pressed_ticks == 0 {
            self.first_pressed = here;
        }
        self.pressed_ticks = self.pressed_ticks.saturating_add(1);
        self.pressed_ticks >= SWITCH_SETTLE_TICKS
    }

    /// True once the switch has been free long enough after it was pressed.
    fn settled_free(&mut self, pressed: bool, here: i64) -> bool {
        if pressed {
            self.free_ticks = 0;
            return false;
        }
        if self.free_ticks == 0 {
            self.first_free = here;
        }
        self.free_ticks = self.free_ticks.saturating_add(1);
        self.free_ticks >= SWITCH_SETTLE_TICKS
    }

    /// The shift that puts the middle of the switch where it is to be.
    fn homed_in_middle(&self) -> HomingOutcome {
        let width = self.first_free.saturating_sub(self.edge);
        HomingOutcome::Homed(self.home - self.edge - width / 2)
    }

    /// Enters a stage that ends in a touch, as soon as the probe's pin is out.
    fn approach(&mut self, stage: Stage, here: i64, mover: &mut JointMove) {
        if self.pin_ticks == 0 {
            self.enter(stage, here, mover);
            return;
        }
        mover.begin(here, 0, self.slow);
        self.pin_left = self.pin_ticks;
        self.pin_is_out = true;
        self.next = stage;
        self.stage = Stage::Deploy;
    }

    fn enter(&mut self, stage: Stage, here: i64, mover: &mut JointMove) {
        self.stage = stage;
        if stage == Stage::Seek {
            self.furthest = here.saturating_add(self.travel_max * self.direction);
        }
        let (way, limits) = match stage {
            Stage::Seek => (self.travel_max, self.fast),
            // Twice the distance back: the switch must be there.
            Stage::Touch => {
                let left = self.furthest.saturating_sub(here) * self.direction;
                (left.min(2 * self.back_off), self.slow)
            }
            // A switch that is pressed over a full turn is not valid.
            Stage::Release if self.both_edges => (-self.travel_max, self.slow),
            Stage::Cross => (self.travel_max, self.slow),
            Stage::Release => (-2 * self.back_off, self.slow),
            // Back to before its edge: a narrow one has been passed.
            Stage::BackOff if self.both_edges => {
                let passed = here.saturating_sub(self.edge) * self.direction;
                (-passed - self.back_off, self.fast)
            }
            _ => (-self.back_off, self.fast),
        };
        mover.begin(here, way * self.direction, limits);
    }
}

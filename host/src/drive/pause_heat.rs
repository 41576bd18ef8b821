//! Limits how long a pause keeps heaters on: a print that was paused and forgotten does not heat all
//! night.
//!
//! In: statuses, the commanded targets, time in microseconds. Out: a notice that the pause keeps heating, a
//! notice that this is over, with the commands that switch off; the commands that heat again before the job
//! continues. The pause itself continues. Not covered: a lower temperature of hot ends during a pause, which
//! the board handles.

use crate::drive::heat_owner::{HeatOwner, off};
use headway_protocol::message::{Control, DeviceState, HEATERS_MAX, Status};

/// Default time for which a pause keeps heaters on, min.
pub const PAUSE_HEAT_MAX_MIN: f64 = 120.0;
const US_PER_MIN: f64 = 60e6;
/// Time for an order and the status that shows it, many times over.
const ASK_AGAIN_US: u64 = 5_000_000;
/// Periods of a board's heat loop, many times over.
const LAPSED_US: u64 = 1_000_000;

/// What a pause does to the heaters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PauseNews {
    /// It has begun, and heaters stay on: heater and target, tenths of a degree.
    Keeps(Vec<(usize, u16)>),
    /// It is too long: the commands that switch off.
    Ends(Vec<Control>),
    /// Somebody else has resumed the job with its heaters off: the commands that make it wait for them.
    Again(Vec<Control>),
    /// The board did not hear this host for long and has switched everything off: the same.
    Returns(Vec<Control>),
}

/// Watches the pauses of one stream.
#[derive(Clone, Debug)]
pub struct PauseHeat {
    most_us: u64,
    since_us: Option<u64>,
    /// Targets of this pause, tenths of a degree.
    kept_decidegrees: [u16; HEATERS_MAX],
    /// What was switched off and is to be heated again.
    cut_decidegrees: [u16; HEATERS_MAX],
    /// Targets were ordered again after a silence: not before this time once more.
    asked_us: u64,
    /// Since when the board waits with everything off.
    lapsed_us: Option<u64>,
}

impl PauseHeat {
    /// Heat ends after this many minutes of pause.
    pub fn new(most_min: f64) -> PauseHeat {
        PauseHeat {
            most_us: (most_min.max(0.0) * US_PER_MIN) as u64,
            since_us: None,
            kept_decidegrees: [0; HEATERS_MAX],
            cut_decidegrees: [0; HEATERS_MAX],
            asked_us: 0,
            lapsed_us: None,
        }
    }

    /// How long a pause keeps its heat, min.
    pub fn most_min(&self) -> f64 {
        self.most_us as f64 / US_PER_MIN
    }

    /// Handles a status.
    pub fn look(&mut self, now_us: u64, status: &Status, owner: &HeatOwner) -> Option<PauseNews> {
        let again = self.after_silence(now_us, status, owner);
        if !again.is_empty() {
            return Some(PauseNews::Returns(again));
        }
        if status.state != DeviceState::Paused {
            self.since_us = None;
            // A job that was ended meanwhile heats nothing.
            let goes_on = matches!(
                status.state,
                DeviceState::Running
                    | DeviceState::Filling
                    | DeviceState::Starved
                    | DeviceState::Heating
            );
            let again = self.take_resume();
            return (goes_on && !again.is_empty()).then_some(PauseNews::Again(again));
        }
        let Some(since_us) = self.since_us else {
            self.since_us = Some(now_us);
            for (heater, kept) in self.kept_decidegrees.iter_mut().enumerate() {
                let reported = status.heaters.get(heater);
                let reported = reported.map_or(0, |heater| heater.target_decidegrees);
                // A hot end in standby reports less than what was ordered.
                *kept = reported.max(owner.target_decidegrees(heater));
            }
            let hot = (0..).zip(self.kept_decidegrees);
            let hot: Vec<_> = hot.filter(|(_, target)| *target > 0).collect();
            return (!hot.is_empty()).then_some(PauseNews::Keeps(hot));
        };
        let is_hot = self.kept_decidegrees.iter().any(|target| *target > 0);
        if !is_hot || now_us < since_us.saturating_add(self.most_us) {
            return None;
        }
        let mut ends = Vec::new();
        for heater in 0..HEATERS_MAX {
            let kept = std::mem::take(&mut self.kept_decidegrees[heater]);
            if kept > 0 {
                self.cut_decidegrees[heater] = kept;
                ends.push(off(heater as u8));
            }
        }
        Some(PauseNews::Ends(ends))
    }

    /// A board that waits for heaters with all of them off has lost its host in the stream (`HostSilent` without one):
    /// it goes on once all targets are ordered again. Not again before that can have arrived.
    fn after_silence(&mut self, now_us: u64, status: &Status, owner: &HeatOwner) -> Vec<Control> {
        let waits = status.state == DeviceState::Heating;
        let mut targets = status
            .heaters
            .iter()
            .map(|heater| heater.target_decidegrees);
        let was_cut = self.cut_decidegrees.iter().any(|target| *target > 0);
        if !waits || targets.any(|target| target > 0) || was_cut {
            self.lapsed_us = None;
            return Vec::new();
        }
        // Orders of this host show in a status only after a period of the board's heat loop.
        let since_us = *self.lapsed_us.get_or_insert(now_us);
        if now_us < self.asked_us.max(since_us + LAPSED_US) {
            return Vec::new();
        }
        let targets = (0..HEATERS_MAX).map(|heater| owner.target_decidegrees(heater));
        let again: Vec<_> = wait_for((0..).zip(targets)).collect();
        if !again.is_empty() {
            self.asked_us = now_us + ASK_AGAIN_US;
        }
        again
    }

    /// A heater command during a pause: it restarts the time for which a pause keeps heaters on.
    pub fn note(&mut self, now_us: u64, control: &Control) {
        let Control::Heat {
            heater,
            decidegrees,
            ..
        } = *control
        else {
            return;
        };
        let (heater, since_us) = (usize::from(heater), &mut self.since_us);
        if let (Some(since_us), true) = (since_us, heater < HEATERS_MAX) {
            *since_us = now_us;
            self.kept_decidegrees[heater] = decidegrees;
            self.cut_decidegrees[heater] = 0;
        }
    }

    /// The job is to continue: the heaters that were switched off have to be heated before, and
    /// waited for.
    pub fn take_resume(&mut self) -> Vec<Control> {
        let cut = std::mem::take(&mut self.cut_decidegrees);
        wait_for((0..).zip(cut)).collect()
    }
}

/// The commands that heat, and make the stream wait for it.
fn wait_for(targets: impl Iterator<Item = (u8, u16)>) -> impl Iterator<Item = Control> {
    let on = targets.filter(|(_, decidegrees)| *decidegrees > 0);
    on.map(|(heater, decidegrees)| Control::Heat {
        heater,
        decidegrees,
        wait: true,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use headway_protocol::message::HeaterStatus;

    const MIN_US: u64 = 60_000_000;

    fn status(state: DeviceState, targets: [u16; 2]) -> Status {
        let heater = |target_decidegrees| HeaterStatus {
            target_decidegrees,
            ..HeaterStatus::default()
        };
        Status {
            session: 1,
            state,
            sigma_permille: 0,
            override_percent: 100,
            flow_percent: 100,
            spans_done: 0,
            queue_knots: 0,
            queue_events: 0,
            referenced: 0,
            switches: 0,
            counts_steps: Default::default(),
            heaters: targets.into_iter().map(heater).collect(),
            fan_permille: 0,
            fault: None,
            drivers: Default::default(),
            probe: Default::default(),
        }
    }

    fn heat(heater: u8, decidegrees: u16) -> Control {
        Control::Heat {
            heater,
            decidegrees,
            wait: true,
        }
    }

    /// Goal: a pause says that it keeps heat, ends it after its time and not before, and heats again with the
    /// job. Method: statuses by hand, also of a hot end in standby and of a resume by somebody else.
    #[test]
    fn heat_ends_with_its_time_and_comes_back_with_the_job() {
        let mut owner = HeatOwner::default();
        owner.note(&heat(0, 2100));
        for by_us in [true, false] {
            let mut pause = PauseHeat::new(120.0);
            let hot = status(DeviceState::Paused, [1600, 600]);
            assert_eq!(
                pause.look(0, &status(DeviceState::Running, [2100, 600]), &owner),
                None
            );
            let keeps = PauseNews::Keeps(vec![(0, 2100), (1, 600)]);
            assert_eq!(pause.look(MIN_US, &hot, &owner), Some(keeps));
            assert_eq!(pause.look(121 * MIN_US - 1, &hot, &owner), None);
            let ends = PauseNews::Ends(vec![off(0), off(1)]);
            assert_eq!(pause.look(121 * MIN_US, &hot, &owner), Some(ends));
            let cold = status(DeviceState::Paused, [0, 0]);
            assert_eq!(pause.look(500 * MIN_US, &cold, &owner), None);
            let again = vec![heat(0, 2100), heat(1, 600)];
            if by_us {
                assert_eq!(pause.take_resume(), again);
            }
            let running = status(DeviceState::Running, [0, 0]);
            let news = pause.look(501 * MIN_US, &running, &owner);
            assert_eq!(news, (!by_us).then_some(PauseNews::Again(again)));
        }
    }

    /// Goal: a host that comes back after the board had given it up orders all its targets, once, and nothing that a
    /// person has switched off. Method: statuses by hand.
    #[test]
    fn a_host_that_returns_orders_its_targets_again() {
        let mut owner = HeatOwner::default();
        owner.note(&heat(0, 2100));
        owner.note(&heat(1, 600));
        let again = PauseNews::Returns(vec![heat(0, 2100), heat(1, 600)]);
        let mut pause = PauseHeat::new(120.0);
        let lapsed = status(DeviceState::Heating, [0, 0]);
        assert_eq!(pause.look(0, &lapsed, &owner), None);
        assert_eq!(pause.look(LAPSED_US - 1, &lapsed, &owner), None);
        assert_eq!(pause.look(LAPSED_US, &lapsed, &owner), Some(again.clone()));
        let next_us = LAPSED_US + ASK_AGAIN_US;
        assert_eq!(pause.look(next_us - 1, &lapsed, &owner), None);
        assert_eq!(pause.look(next_us, &lapsed, &owner), Some(again));
        // One that is off by itself was switched off by somebody.
        let one = status(DeviceState::Heating, [2100, 0]);
        assert_eq!(pause.look(MIN_US, &one, &owner), None);
        for state in [
            DeviceState::Idle,
            DeviceState::Faulted,
            DeviceState::Running,
        ] {
            let cold = status(state, [0, 0]);
            assert_eq!(pause.look(2 * MIN_US, &cold, &owner), None);
        }
        let nothing = HeatOwner::default();
        assert_eq!(pause.look(3 * MIN_US, &lapsed, &nothing), None);
    }

    /// Goal: a job that is ended in a pause does not heat again. Method: heat that has ended, then an abort.
    #[test]
    fn a_job_that_is_ended_in_a_pause_heats_nothing() {
        let (mut pause, owner) = (PauseHeat::new(1.0), HeatOwner::default());
        let hot = status(DeviceState::Paused, [2100, 600]);
        pause.look(0, &hot, &owner);
        assert!(pause.look(MIN_US, &hot, &owner).is_some());
        for state in [
            DeviceState::Aborting,
            DeviceState::Idle,
            DeviceState::Running,
        ] {
            assert_eq!(pause.look(2 * MIN_US, &status(state, [0, 0]), &owner), None);
        }
    }

    /// Goal: what is ordered in a pause holds, with its own time. Method: a heater ordered off and another on.
    #[test]
    fn an_order_in_the_pause_is_not_undone() {
        let mut pause = PauseHeat::new(10.0);
        let owner = HeatOwner::default();
        let hot = status(DeviceState::Paused, [2100, 600]);
        pause.look(0, &hot, &owner);
        pause.note(5 * MIN_US, &off(0));
        assert_eq!(pause.look(14 * MIN_US, &hot, &owner), None);
        let ends = pause.look(15 * MIN_US, &hot, &owner);
        assert_eq!(ends, Some(PauseNews::Ends(vec![off(1)])));
        pause.note(16 * MIN_US, &heat(1, 500));
        assert_eq!(pause.take_resume(), []);
        // Nothing hot is nothing to speak of.
        let mut cold = PauseHeat::new(10.0);
        assert_eq!(
            cold.look(0, &status(DeviceState::Paused, [0, 0]), &owner),
            None
        );
    }
}

//! Heaters and fans that a host has switched on: it owns them until another host takes them over.
//!
//! In: commands as they are sent and as they are accepted. Out: the commands that switch everything off. A command
//! counts from the time at which it is sent, since it may arrive although no answer does; a command to switch off
//! counts when it is accepted, and only if it was the last one sent. Not covered: who sends the commands, and when.

use headway_protocol::message::{Control, HEATERS_MAX};

/// Heaters and fan of one host, and its permission to extrude cold.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HeatOwner {
    /// Targets ordered last, tenths of a degree; 0 is not ours.
    targets_decidegrees: [u16; HEATERS_MAX],
    fan: bool,
    /// The extruder may turn cold.
    cold: bool,
    /// Commands of each heater, of the fan and of the cold-extrusion permission that were sent and
    /// not accepted yet.
    given: [u8; HEATERS_MAX + 2],
}

/// Indices of fan and permission after those of the heaters.
const FAN: usize = HEATERS_MAX;
const COLD: usize = HEATERS_MAX + 1;

/// Which of them a command is about.
fn place_of(control: &Control) -> Option<usize> {
    match *control {
        Control::Heat { heater, .. } => Some(usize::from(heater)).filter(|own| *own < HEATERS_MAX),
        Control::Fan(_) => Some(FAN),
        Control::ExtrudeCold(_) => Some(COLD),
        _ => None,
    }
}

impl HeatOwner {
    /// A command is about to be given.
    pub fn note(&mut self, control: &Control) {
        if let Some(place) = place_of(control) {
            self.given[place] = self.given[place].saturating_add(1);
        }
        match *control {
            Control::Heat {
                heater,
                decidegrees,
                ..
            } if decidegrees > 0 => self.set(heater, decidegrees),
            Control::Fan(permille) if permille > 0 => self.fan = true,
            Control::ExtrudeCold(true) => self.cold = true,
            _ => {}
        }
    }

    /// The board has accepted a command: the host no longer owns what it switched off, unless a later command,
    /// still in transit, may switch it on again. Commands are accepted in the order in which they are sent; a
    /// refused one still counts as sent: anything owned without need is switched off once more at the end.
    pub fn taken(&mut self, control: &Control) {
        let Some(place) = place_of(control) else {
            return;
        };
        self.given[place] = self.given[place].saturating_sub(1);
        if self.given[place] > 0 {
            return;
        }
        match *control {
            Control::Heat {
                heater,
                decidegrees: 0,
                ..
            } => self.set(heater, 0),
            Control::Fan(0) => self.fan = false,
            Control::ExtrudeCold(false) => self.cold = false,
            _ => {}
        }
    }

    /// A new conversation begins: commands of the last one will no longer be accepted.
    pub fn begin(&mut self) {
        self.given = [0; HEATERS_MAX + 2];
    }

    fn set(&mut self, heater: u8, decidegrees: u16) {
        if let Some(target) = self.targets_decidegrees.get_mut(usize::from(heater)) {
            *target = decidegrees;
        }
    }

    /// Heaters are no longer this host's.
    pub fn hand_over_heaters(&mut self) {
        self.targets_decidegrees = [0; HEATERS_MAX];
    }

    /// The last commanded target, tenths of a degree; 0 if there is none.
    pub fn target_decidegrees(&self, heater: usize) -> u16 {
        self.targets_decidegrees.get(heater).copied().unwrap_or(0)
    }

    /// True where nothing was switched on.
    pub fn is_empty(&self) -> bool {
        self.all_off().is_empty()
    }

    /// The commands that switch off everything.
    pub fn all_off(&self) -> Vec<Control> {
        let heaters = (0..).zip(&self.targets_decidegrees);
        let on = heaters.filter(|(_, target)| **target > 0);
        let heaters = on.map(|(heater, _)| off(heater));
        let fan = self.fan.then_some(Control::Fan(0));
        let guard = self.cold.then_some(Control::ExtrudeCold(false));
        heaters.chain(fan).chain(guard).collect()
    }
}

/// The command that switches a heater off.
pub fn off(heater: u8) -> Control {
    Control::Heat {
        heater,
        decidegrees: 0,
        wait: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: what is given is owned, what is taken off is not, and nothing else. Method: commands by hand.
    #[test]
    fn what_was_given_is_owned_until_its_off_is_taken() {
        let mut owner = HeatOwner::default();
        assert!(owner.is_empty() && owner.all_off().is_empty());
        let on = Control::Heat {
            heater: 1,
            decidegrees: 600,
            wait: true,
        };
        owner.note(&on);
        owner.note(&Control::Fan(500));
        // An order to switch off that may never arrive changes nothing.
        owner.note(&off(1));
        owner.note(&Control::Fan(0));
        assert_eq!(owner.all_off(), [off(1), Control::Fan(0)]);
        owner.taken(&on);
        assert_eq!(owner.target_decidegrees(1), 600);
        owner.taken(&off(1));
        assert_eq!(owner.all_off(), [Control::Fan(0)]);
        owner.taken(&Control::Fan(500));
        owner.taken(&Control::Fan(0));
        assert!(owner.is_empty());
        owner.note(&Control::ExtrudeCold(true));
        assert_eq!(owner.all_off(), [Control::ExtrudeCold(false)]);
        owner.taken(&Control::ExtrudeCold(true));
        owner.note(&Control::ExtrudeCold(false));
        owner.taken(&Control::ExtrudeCold(false));
        assert!(owner.is_empty());
    }

    /// Goal: an answer to an older order disowns nothing. Method: off and on again before either is taken; found by
    /// schedule 6533 of two hosts, whose second one ended in order and left a heater on.
    #[test]
    fn an_off_that_is_taken_late_leaves_a_later_on_owned() {
        let on = Control::Heat {
            heater: 0,
            decidegrees: 280,
            wait: false,
        };
        let mut owner = HeatOwner::default();
        owner.note(&on);
        owner.taken(&on);
        owner.note(&off(0));
        owner.note(&on);
        owner.taken(&off(0));
        assert_eq!(owner.all_off(), [off(0)]);
        owner.taken(&on);
        assert_eq!(owner.all_off(), [off(0)]);
        // What was lost with its line is not waited for in the next conversation.
        owner.note(&on);
        owner.begin();
        owner.note(&off(0));
        owner.taken(&off(0));
        assert!(owner.is_empty());
    }
}

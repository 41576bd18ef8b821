//! Levels of a board's inputs -> switches by joint, probe, emergency input.
//!
//! ```text
//! levels of the inputs, a bit each -> senses -> roles -> Inputs: switches by joint, emergency
//! ```
//! In: a [`Wiring`] of the settings, and the board's own inputs. Out: an [`InputMap`] for the servo tick.
//! Not covered: roles of step pins, heaters and fans, which the board defines.

use crate::configuration::JOINTS_MAX;
use crate::configuration::homing::HomingConfiguration;
use crate::configuration::wiring::{BoardInputs, NO_INPUT, Wiring};
use crate::motion::inputs::Inputs;
use crate::motion::probe_pin::ProbePin;
use headway_protocol::message::PROBE_BIT;

/// The joint whose switch may be the probe.
const Z: usize = 2;

impl Wiring {
    /// The probe's pin, if there is one.
    pub fn pin(&self) -> ProbePin {
        ProbePin {
            fitted: self.probe_servo,
            is_switch_of_z: self.probe_input.is_none(),
            ..ProbePin::default()
        }
    }

    /// For the servo tick of a board.
    #[inline(never)]
    pub fn map(&self, board: &BoardInputs) -> InputMap {
        let emergency = self.emergency_input.unwrap_or(board.emergency);
        let mut switches = self.switch_inputs;
        for input in &mut switches {
            if *input >= board.count || *input == emergency {
                *input = NO_INPUT;
            }
        }
        InputMap {
            switches,
            emergency,
            open: self.open_inputs,
            probe: self.probe_input.unwrap_or(switches[Z]),
        }
    }
}

/// From levels to roles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputMap {
    switches: [u8; JOINTS_MAX],
    emergency: u8,
    open: u16,
    probe: u8,
}

impl InputMap {
    /// Only joints that have a switch read one: the input of another joint may be its driver's diagnosis pin, or
    /// nothing.
    pub fn with_switches_of(mut self, homing: &HomingConfiguration) -> Self {
        for (joint, input) in self.switches.iter_mut().enumerate() {
            let mut switches = homing.joints.iter();
            if !switches.any(|switch| usize::from(switch.joint) == joint) {
                *input = NO_INPUT;
            }
        }
        self
    }

    /// The emergency input.
    pub fn emergency(&self) -> u8 {
        self.emergency
    }

    /// Whether an input is low while pressed.
    pub fn is_open(&self, input: u8) -> bool {
        bit(self.open, input)
    }

    /// Roles of these levels, bit i = input i, 1 = high.
    #[inline]
    pub fn inputs(&self, levels: u16) -> Inputs {
        let pressed = levels ^ self.open;
        let mut switches = 0;
        for (joint, input) in self.switches.iter().enumerate() {
            switches |= u8::from(bit(pressed, *input)) << joint;
        }
        switches |= u8::from(bit(pressed, self.probe)) << PROBE_BIT;
        Inputs {
            switches,
            emergency: bit(pressed, self.emergency),
        }
    }
}

/// True if this bit is set; false beyond the last.
#[inline]
fn bit(bits: u16, number: u8) -> bool {
    u32::from(bits).checked_shr(number.into()).unwrap_or(0) & 1 == 1
}

#[cfg(test)]
mod tests {
    //! Goal: each input acts in its role and sense alone, and a wiring that cannot be is refused. Method: every
    //! level of nine inputs, against a table worked out by hand; a board that has four.
    use super::*;
    use crate::board::built_in::built_in_planar;
    use crate::configuration::wiring::WrongWiring;

    const BIG: BoardInputs = BoardInputs {
        count: 9,
        emergency: 8,
        emergency_mask: 0x1ff,
    };

    #[test]
    fn every_input_acts_in_its_role_alone() {
        // Z at a probe on input 8, normally open; emergency on 7; Y none; C on 0 by X's side.
        let wiring = Wiring {
            switch_inputs: [0, NO_INPUT, 8, 3, 4, 5, 6],
            emergency_input: Some(7),
            open_inputs: 1 << 8 | 1 << 3,
            ..Wiring::STANDARD
        };
        assert_eq!(wiring.check_for(&built_in_planar(), &BIG), Ok(()));
        let map = wiring.map(&BIG);
        assert!(map.is_open(8) && !map.is_open(7) && map.emergency() == 7);
        for levels in 0..1u16 << 9 {
            let high = |input: u16| levels >> input & 1 == 1;
            let expected = [
                high(0),
                false,
                !high(8),
                !high(3),
                high(4),
                high(5),
                high(6),
            ];
            let found = map.inputs(levels);
            let by_joint: [bool; 7] =
                core::array::from_fn(|joint| found.switches >> joint & 1 == 1);
            assert_eq!(by_joint, expected, "{levels:b}");
            assert_eq!(found.emergency, high(7));
            // Z's switch is the probe, unless that has an input of its own.
            assert_eq!(found.switches >> 7 == 1, !high(8));
        }
        let apart = Wiring {
            switch_inputs: [0, 1, 2, 3, 4, NO_INPUT, 6],
            probe_input: Some(5),
            ..wiring
        };
        assert_eq!(apart.check_for(&built_in_planar(), &BIG), Ok(()));
        let map = apart.map(&BIG);
        for levels in 0..1u16 << 9 {
            let found = map.inputs(levels);
            assert_eq!(found.switches >> 7 == 1, levels >> 5 & 1 == 1);
            assert_eq!(found.switches >> 2 & 1 == 1, levels >> 2 & 1 == 1);
            assert_eq!(found.switches >> 5 & 1, 0);
        }
        // The board's own: joint m at input m, the last one stops.
        let map = Wiring::STANDARD.map(&BIG);
        for levels in 0..1u16 << 9 {
            let found = map.inputs(levels);
            let z = levels as u8 >> 2 & 1;
            assert_eq!(found.switches, levels as u8 & 0x7f | z << 7);
            assert_eq!(found.emergency, levels >> 8 & 1 == 1);
        }
    }

    #[test]
    fn only_a_joint_with_a_switch_reads_its_input() {
        let machine = built_in_planar();
        let standard = HomingConfiguration::standard(&machine);
        let map = Wiring::STANDARD.map(&BIG).with_switches_of(&standard);
        // X, Y and Z have switches; the nozzle's input may be its driver's diagnosis pin.
        for levels in 0..1u16 << 9 {
            let all = Wiring::STANDARD.map(&BIG).inputs(levels);
            let found = map.inputs(levels);
            assert_eq!(found.switches, all.switches & 0b1000_0111, "{levels:b}");
            assert_eq!(found.emergency, all.emergency);
        }
        let none = HomingConfiguration::none();
        let map = Wiring::STANDARD.map(&BIG).with_switches_of(&none);
        assert_eq!(map.inputs(0xff).switches & 0x7f, 0);
    }

    #[test]
    fn a_small_board_has_fewer_and_says_so() {
        let small = BoardInputs {
            count: 4,
            emergency: 3,
            emergency_mask: 0b1011,
        };
        let machine = built_in_planar();
        assert_eq!(Wiring::STANDARD.check_for(&machine, &small), Ok(()));
        // Its emergency input is no switch of the nozzle's.
        let found = Wiring::STANDARD.map(&small).inputs(0b1111);
        assert_eq!((found.switches, found.emergency), (0b1000_0111, true));
        for (wiring, wrong) in [
            (
                Wiring {
                    emergency_input: Some(2),
                    ..Wiring::STANDARD
                },
                WrongWiring::Emergency,
            ),
            (
                Wiring {
                    emergency_input: Some(9),
                    ..Wiring::STANDARD
                },
                WrongWiring::Emergency,
            ),
            (
                Wiring {
                    emergency_input: Some(1),
                    ..Wiring::STANDARD
                },
                WrongWiring::Switch(1),
            ),
            (
                Wiring {
                    switch_inputs: [0, 1, 3, 3, 4, 5, 6],
                    ..Wiring::STANDARD
                },
                WrongWiring::Switch(2),
            ),
            (
                Wiring {
                    switch_inputs: [6, 1, 2, 3, 4, 5, 6],
                    ..Wiring::STANDARD
                },
                WrongWiring::Switch(0),
            ),
            (
                Wiring {
                    probe_input: Some(3),
                    ..Wiring::STANDARD
                },
                WrongWiring::Probe,
            ),
            (
                Wiring {
                    probe_input: Some(4),
                    ..Wiring::STANDARD
                },
                WrongWiring::Probe,
            ),
        ] {
            assert_eq!(wiring.check_for(&machine, &small), Err(wrong), "{wiring:?}");
        }
        let nowhere = Wiring {
            emergency_input: Some(200),
            ..Wiring::STANDARD
        };
        assert_eq!(nowhere.check(&machine), Err(WrongWiring::Emergency));
        let found = nowhere.map(&small).inputs(u16::MAX);
        assert!(!found.emergency);
    }
}

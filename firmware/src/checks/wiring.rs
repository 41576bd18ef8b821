//! Inputs: whether a board has those that the settings name, and each has one role.

use crate::configuration::MachineConfiguration;
use crate::configuration::wiring::{BoardInputs, INPUTS_MAX, NO_INPUT, Wiring, WrongWiring};

impl Wiring {
    /// Whether it is an input at all, whatever board.
    ///
    /// # Errors
    /// [`WrongWiring`], the first that is found.
    pub fn check(&self, machine: &MachineConfiguration) -> Result<(), WrongWiring> {
        let any = BoardInputs {
            count: INPUTS_MAX,
            emergency: NO_INPUT,
            emergency_mask: u16::MAX,
        };
        self.check_for(machine, &any)
    }

    /// Whether a board can run it.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn check_for(
        &self,
        machine: &MachineConfiguration,
        board: &BoardInputs,
    ) -> Result<(), WrongWiring> {
        let bit = |input: u8| u32::from(board.emergency_mask).checked_shr(input.into());
        if let Some(input) = self.emergency_input
            && (input >= board.count || bit(input).unwrap_or(0) & 1 == 0)
        {
            return Err(WrongWiring::Emergency);
        }
        let emergency = self.emergency_input.unwrap_or(board.emergency);
        if let Some(input) = self.probe_input
            && (input >= board.count || input == emergency)
        {
            return Err(WrongWiring::Probe);
        }
        let switches = self.switch_inputs.iter().take(machine.joints.len());
        for (joint, input) in switches.enumerate() {
            // The standard ones beyond a small board's inputs have no switch.
            let is_standard = usize::from(*input) == joint;
            let is_there = *input < board.count || *input == NO_INPUT || is_standard;
            let is_asked = self.emergency_input.is_some() || !is_standard;
            let is_taken = *input == emergency && *input != NO_INPUT && is_asked;
            if !is_there || is_taken {
                return Err(WrongWiring::Switch(joint));
            }
        }
        Ok(())
    }
}

//! Names of the boards that firmware is built for: settings name one if its chip does not distinguish it from
//! others.
//!
//! In: the name in a record of settings, and the results of the board's own checks. Out: which of its pins it may
//! drive. Not covered: the pins themselves, which the board defines.

use super::drivers::DriversConfiguration;
use headway_protocol::message::{Fault, FaultCause};
use serde::{Deserialize, Serialize};

/// A board, under its maker's name. The order is that of the record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BoardName {
    /// BTT Octopus v1.0.
    Octopus10,
    /// BTT Octopus v1.1.
    Octopus11,
    /// Fysetc Spider v1.0 and v1.1.
    Spider11,
    /// Fysetc Spider v2.2.
    Spider22,
}

impl BoardName {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self::Octopus10,
        Self::Octopus11,
        Self::Spider11,
        Self::Spider22,
    ];

    /// As a machine file has it.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Octopus10 => "octopus-1.0",
            Self::Octopus11 => "octopus-1.1",
            Self::Spider11 => "spider-1.1",
            Self::Spider22 => "spider-2.2",
        }
    }

    /// Of a machine file's text.
    pub fn of_text(text: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|name| name.text() == text)
    }
}

/// The fault of a board that has not been named: `value` is 0.
pub const UNNAMED: Fault = Fault {
    cause: FaultCause::Board,
    index: 3,
    value: 0,
};

/// What a board may drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    /// The chip or its crystal is another board's: nothing, all pins stay inputs.
    Foreign,
    /// Several boards have this chip: only pins with the same use on all of them.
    Unnamed,
    /// Every pin.
    Named,
}

impl Known {
    /// From the fault of a chip or crystal that does not fit, and whether the board's name is known or not needed.
    pub fn of(wrong_board: Option<Fault>, is_named: bool) -> Self {
        match (wrong_board, is_named) {
            (Some(_), _) => Self::Foreign,
            (None, false) => Self::Unnamed,
            (None, true) => Self::Named,
        }
    }

    /// The drivers that may be spoken to: it is unknown what is connected to another board's pins.
    pub fn of_board(self, drivers: DriversConfiguration) -> DriversConfiguration {
        match self {
            Self::Foreign => DriversConfiguration::none(),
            Self::Unnamed | Self::Named => drivers,
        }
    }
}

#[cfg(test)]
mod tests {
    //! Goal: a name is read as it is written, and a board that is not known for sure drives less. Method: all names,
    //! and all that a board can find out about itself.
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for name in BoardName::ALL {
            assert_eq!(BoardName::of_text(name.text()), Some(name));
        }
        for text in ["octopus-pro-1.1", "octopus", "Octopus-1.1", ""] {
            assert_eq!(BoardName::of_text(text), None);
        }
    }

    #[test]
    fn a_name_does_not_make_another_chip_known() {
        let wrong_chip = Some(Fault {
            index: 0,
            ..UNNAMED
        });
        assert_eq!(Known::of(wrong_chip, true), Known::Foreign);
        assert_eq!(Known::of(wrong_chip, false), Known::Foreign);
        assert_eq!(Known::of(None, false), Known::Unnamed);
        assert_eq!(Known::of(None, true), Known::Named);
    }
}

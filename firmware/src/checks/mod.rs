//! Checks whether configurations can be run: for the types in `configuration`.
//!
//! In: the contents of a machine file or a record of settings. Out: the first invalid number, with its place. The
//! host checks before it plans, a board before it accepts settings, by the same code. Not covered: limits of a board
//! that are not in its settings (`settings::BoardLimits`).

mod drivers;
mod heat;
mod homing;
mod kinematics;
mod machine;
mod wiring;

use crate::configuration::WrongNumber;

/// The first of them that is not right.
fn first_wrong(numbers: &[(bool, u8, f64)]) -> Option<WrongNumber> {
    let wrong = numbers.iter().find(|(is_right, _, _)| !is_right)?;
    Some((wrong.1, wrong.2))
}

fn is_positive(value: &f64) -> bool {
    *value > 0.0 && value.is_finite()
}

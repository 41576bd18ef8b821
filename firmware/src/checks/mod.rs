//! Which configurations can be run: the checks of the nouns in `configuration`.
//!
//! In: what a machine file or a record of settings says. Out: the first number that cannot be, with its place. The host asks
//! before it plans, a board before it takes settings, by the very same code. Left out: what of a board is not in
//! its settings (`settings::BoardLimits`).

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

//! Why something is refused, in words.

/// What is wrong, where, and the remedy, in one line that is made where the fault is found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Refusal(pub String);

/// A `Refusal`, written as for `format!`.
macro_rules! refusal {
    ($($text:tt)*) => { $crate::text::refusal::Refusal(format!($($text)*)) };
}
pub(crate) use refusal;

//! The commands that a page may send to a running print: none of them heats.

use headway_protocol::message::Control;
use std::ops::RangeInclusive;

/// A line as a command; `None` if it is not one.
pub(crate) fn order(line: &str) -> Option<Control> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words[..] {
        ["pause"] => Some(Control::Pause),
        ["resume"] => Some(Control::Resume),
        ["abort"] => Some(Control::Abort),
        ["stop"] => Some(Control::EmergencyStop),
        ["override", text] => percent(text, 1..=200).map(Control::Override),
        ["flow", text] => percent(text, 10..=200).map(Control::FlowOverride),
        _ => None,
    }
}

/// A whole percentage within a range.
pub(crate) fn percent(text: &str, range: RangeInclusive<u16>) -> Option<u16> {
    text.parse().ok().filter(|percent| range.contains(percent))
}

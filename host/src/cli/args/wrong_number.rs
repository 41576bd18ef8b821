//! What is said of a value of an option that is no number, in place of the parser's words.

use clap::error::{ContextKind, ContextValue, ErrorKind};

/// The message, if the error is of that kind: the number that is most likely meant, written as it has to be.
pub(crate) fn told(error: &clap::Error) -> Option<String> {
    let text = |kind: ContextKind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.as_str()),
        _ => None,
    };
    let source = std::error::Error::source(error)?.to_string();
    let is_whole = source.starts_with("invalid digit");
    if error.kind() != ErrorKind::ValueValidation
        || !(is_whole || source.starts_with("invalid float"))
    {
        return None;
    }
    let (option, value) = (
        text(ContextKind::InvalidArg)?,
        text(ContextKind::InvalidValue)?,
    );
    let end = value.find(|c: char| !(c.is_ascii_digit() || ".,+-".contains(c)));
    let number = value[..end.unwrap_or(value.len())].replace(',', ".");
    let remedy = match (number.parse::<f64>(), is_whole) {
        (Ok(number), true) => format!("write a whole number, as in {}", number.round().max(0.0)),
        (Ok(_), false) => format!("write {number}"),
        (Err(_), true) => "write a whole number, as in 2".to_string(),
        (Err(_), false) => "write a number, as in 0.2".to_string(),
    };
    Some(format!("'{value}' is no value of '{option}': {remedy}"))
}

//! Misspelt names: finds the known one that is meant.
//!
//! Files that people write may carry keys of their own, but one that looks like a known key is most
//! likely that key: if it were ignored, a hole would be missing or an inch read as a millimetre.
//! Distance: Damerau-Levenshtein, ignoring case.

/// Known names shorter than this are near within one edit, others within two: of five letters two
/// make another word (`notes`, `holes`).
const LONG: usize = 6;

/// The known name that `name` is not but most likely means.
pub(crate) fn near_name<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    if known.contains(&name) {
        return None;
    }
    // Longer ones are near to nothing, and cost the square of their length.
    let name = (name.chars().count() <= 32).then(|| name.to_lowercase())?;
    let edits = |known: &str| strsim::damerau_levenshtein(&name, known);
    let most = |known: &str| if known.len() < LONG { 1 } else { 2 };
    let near = known.iter().filter(|known| edits(known) <= most(known));
    near.min_by_key(|known| edits(known)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelt_names_are_near_and_others_are_not() {
        let known = ["name", "units", "exterior", "holes"];
        for (name, near) in [
            ("hole", Some("holes")),
            ("Holes", Some("holes")),
            ("hoels", Some("holes")),
            ("unit", Some("units")),
            ("UNITS", Some("units")),
            ("interior", Some("exterior")),
            ("Name", Some("name")),
            ("holes", None),
            ("notes", None),
            ("note", None),
            ("points", None),
            ("about", None),
            ("valid", None),
            ("source", None),
            ("licence", None),
            ("", None),
        ] {
            assert_eq!(near_name(name, &known), near, "{name}");
        }
        assert_eq!(near_name(&"e".repeat(1_000_000), &known), None);
    }
}

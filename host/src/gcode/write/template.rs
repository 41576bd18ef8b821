//! Start and end blocks: a text with named fields in braces.
//!
//! In: the text and the fields' values. Out: the block. `{name}` is a field, `{{` and `}}` are braces.

/// A field that is not known.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "line {line} of the block: the field {{{field}}} is not known; there are {known}; write {{{{ for a brace"
)]
pub struct FieldError {
    /// Line of the text, from 1.
    pub line: usize,
    /// What it is called.
    pub field: String,
    /// The known ones.
    pub known: String,
}

/// The block with its fields filled in, ended by a new line.
///
/// # Errors
/// [`FieldError`], the first.
pub fn filled(text: &str, fields: &[(&str, String)]) -> Result<String, FieldError> {
    let mut block = String::new();
    for (index, line) in text.lines().enumerate() {
        let mut rest = line;
        while let Some(at) = rest.find(['{', '}']) {
            block.push_str(&rest[..at]);
            rest = &rest[at..];
            if let Some(after) = rest.strip_prefix("{{") {
                block.push('{');
                rest = after;
            } else if let Some(after) = rest.strip_prefix('}') {
                block.push('}');
                rest = after.strip_prefix('}').unwrap_or(after);
            } else {
                let end = rest.find('}').unwrap_or(rest.len());
                let field = &rest[1..end];
                let known = fields.iter().find(|(name, _)| *name == field);
                let Some((_, value)) = known else {
                    let names: Vec<&str> = fields.iter().map(|(name, _)| *name).collect();
                    return Err(FieldError {
                        line: index + 1,
                        field: field.chars().take(40).collect(),
                        known: names.join(", "),
                    });
                };
                block.push_str(value);
                rest = rest.get(end + 1..).unwrap_or_default();
            }
        }
        block.push_str(rest);
        block.push('\n');
    }
    Ok(block)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_filled_in() {
        let fields = [("x", "1.5".to_string()), ("name", "a".to_string())];
        assert_eq!(
            filled("G1 X{x} ; {name}\n{{b}}", &fields).as_deref(),
            Ok("G1 X1.5 ; a\n{b}\n")
        );
        let error = filled("G28\nG1 X{y}", &fields)
            .expect_err("unknown")
            .to_string();
        assert!(
            error.contains("line 2") && error.contains("{y}") && error.contains("x, name"),
            "{error}"
        );
        assert!(filled("{open", &fields).is_err());
    }
}

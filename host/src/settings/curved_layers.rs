//! Which layers of a part are curved, and how that is written.
//!
//! In: `skin` or `skin:M`. Out: [`CurvedLayers`].

use std::str::FromStr;

/// Curved layers of a skin, where nobody says how many, and most that may be asked for.
const SKIN_LAYERS: u32 = 3;
const SKIN_LAYERS_MAX: u32 = 100;

/// Which layers are curved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CurvedLayers {
    /// So many on top of flat ones.
    Skin(u32),
}

/// A text that names no curved layers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "--curved-layers {text}: curved layers are a skin over flat ones; write skin:M with M from 1 to {SKIN_LAYERS_MAX}, as \
     in skin:{SKIN_LAYERS}"
)]
pub struct CurvedLayersTextError {
    /// The text.
    pub text: String,
}

impl FromStr for CurvedLayers {
    type Err = CurvedLayersTextError;

    fn from_str(text: &str) -> Result<CurvedLayers, CurvedLayersTextError> {
        let count = match text.split_once(':') {
            None if text == "skin" => Some(SKIN_LAYERS),
            Some(("skin", layers)) => layers.parse().ok(),
            _ => None,
        };
        let count = count.filter(|count| (1..=SKIN_LAYERS_MAX).contains(count));
        count
            .map(CurvedLayers::Skin)
            .ok_or_else(|| CurvedLayersTextError {
                text: text.chars().take(40).collect(),
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: a skin is read with its number of layers, and whatever else is refused with what to write. Method: texts.
    #[test]
    fn a_skin_is_read_and_nothing_else() {
        assert_eq!("skin:7".parse(), Ok(CurvedLayers::Skin(7)));
        assert_eq!("skin".parse(), Ok(CurvedLayers::Skin(SKIN_LAYERS)));
        for text in [
            "", "skin:", "skin:0", "skin:101", "all", "auto", "Skin", "skin:1.5",
        ] {
            let error = CurvedLayers::from_str(text).unwrap_err();
            assert!(error.to_string().contains("skin:3"), "{error}");
        }
    }
}

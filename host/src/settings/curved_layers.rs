//! Which layers of a part are curved, and how that is written.
//!
//! In: `auto`, `all`, `skin` or `skin:M`. Out: [`CurvedLayers`].

use std::fmt;
use std::str::FromStr;

/// Curved layers of a skin, where nobody says how many, and most that may be asked for.
pub const SKIN_LAYERS: u32 = 3;
pub const SKIN_LAYERS_MAX: u32 = 100;

/// Which layers are curved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CurvedLayers {
    /// All or a skin, by the stair error that is left and the time that it takes.
    #[default]
    Auto,
    /// All of them.
    All,
    /// So many on top of flat ones.
    Skin(u32),
}

/// A text that names no curved layers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "--curved-layers {text}: write auto, all, skin or skin:M with M from 1 to {SKIN_LAYERS_MAX}, as in skin:3"
)]
pub struct CurvedLayersTextError {
    /// The text.
    pub text: String,
}

impl FromStr for CurvedLayers {
    type Err = CurvedLayersTextError;

    fn from_str(text: &str) -> Result<CurvedLayers, CurvedLayersTextError> {
        let count = |text: &str| {
            let count = text.parse().ok();
            count.filter(|count| (1..=SKIN_LAYERS_MAX).contains(count))
        };
        let named = match text.split_once(':') {
            None if text == "auto" => Some(CurvedLayers::Auto),
            None if text == "all" => Some(CurvedLayers::All),
            None if text == "skin" => Some(CurvedLayers::Skin(SKIN_LAYERS)),
            Some(("skin", layers)) => count(layers).map(CurvedLayers::Skin),
            _ => None,
        };
        named.ok_or_else(|| CurvedLayersTextError {
            text: text.chars().take(40).collect(),
        })
    }
}

impl fmt::Display for CurvedLayers {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            CurvedLayers::Auto => f.write_str("auto"),
            CurvedLayers::All => f.write_str("all"),
            CurvedLayers::Skin(count) => write!(f, "skin:{count}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        for asked in [CurvedLayers::Auto, CurvedLayers::All, CurvedLayers::Skin(7)] {
            assert_eq!(asked.to_string().parse(), Ok(asked));
        }
        assert_eq!("skin".parse(), Ok(CurvedLayers::Skin(SKIN_LAYERS)));
        for text in [
            "", "skin:", "skin:0", "skin:101", "all:2", "Auto", "skin:1.5",
        ] {
            let error = CurvedLayers::from_str(text).unwrap_err();
            assert!(error.to_string().contains("skin:3"), "{error}");
        }
    }
}

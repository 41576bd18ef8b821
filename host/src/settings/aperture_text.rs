//! Apertures as the user writes them: `ellipse:AxB` (semi-axes, mm) and `circle:R` (radius, mm).

use crate::geometry::aperture::Aperture;

/// Why a description is not an aperture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ApertureTextError {
    /// No `kind:size`.
    #[error("aperture '{text}': write ellipse:AxB (semi-axes in mm) or circle:R (radius in mm)")]
    Form {
        /// What was given.
        text: String,
    },
    /// A shape that is planned for, but not there yet.
    #[error(
        "aperture '{text}': {kind} is not supported yet; use ellipse:AxB or circle:R (semi-axes in mm)"
    )]
    NotYet {
        /// What was given.
        text: String,
        /// Its kind.
        kind: String,
    },
    /// A size is not a number, or not positive.
    #[error("aperture '{text}': '{size}' is not a size in mm greater than 0")]
    Size {
        /// What was given.
        text: String,
        /// The part at fault.
        size: String,
    },
    /// Semi-axes in the wrong order.
    #[error(
        "aperture '{text}': the first semi-axis lies along tool X and must not be the smaller one; \
         write ellipse:{minor}x{major}"
    )]
    Order {
        /// What was given.
        text: String,
        /// First semi-axis.
        major: f64,
        /// Second semi-axis.
        minor: f64,
    },
}

/// Reads `ellipse:AxB` or `circle:R`.
pub fn parse_aperture(text: &str) -> Result<Aperture, ApertureTextError> {
    let form = || ApertureTextError::Form { text: text.into() };
    let (kind, sizes) = text.split_once(':').ok_or_else(form)?;
    let number = |size: &str| -> Result<f64, ApertureTextError> {
        match size.trim().parse::<f64>() {
            Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
            _ => Err(ApertureTextError::Size {
                text: text.into(),
                size: size.trim().into(),
            }),
        }
    };
    match kind.trim() {
        "circle" => {
            let radius_mm = number(sizes)?;
            Ok(Aperture::Ellipse {
                major_mm: radius_mm,
                minor_mm: radius_mm,
            })
        }
        "ellipse" => {
            let (first, second) = sizes.split_once(['x', 'X']).ok_or_else(form)?;
            let (major_mm, minor_mm) = (number(first)?, number(second)?);
            if major_mm < minor_mm {
                return Err(ApertureTextError::Order {
                    text: text.into(),
                    major: major_mm,
                    minor: minor_mm,
                });
            }
            Ok(Aperture::Ellipse { major_mm, minor_mm })
        }
        kind @ ("stadium" | "rect" | "polygon") => Err(ApertureTextError::NotYet {
            text: text.into(),
            kind: kind.into(),
        }),
        _ => Err(form()),
    }
}

/// Writes what [`parse_aperture`] reads.
pub fn aperture_text(aperture: &Aperture) -> String {
    match *aperture {
        Aperture::Ellipse { major_mm, minor_mm } if major_mm == minor_mm => {
            format!("circle:{major_mm}")
        }
        Aperture::Ellipse { major_mm, minor_mm } => format!("ellipse:{major_mm}x{minor_mm}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_back() {
        for text in ["ellipse:0.6x0.2", "circle:0.4", "ellipse:12x3.25"] {
            let aperture = parse_aperture(text).expect(text);
            assert_eq!(aperture_text(&aperture), text);
        }
        assert_eq!(
            parse_aperture("ellipse:0.6X0.2"),
            parse_aperture(" ellipse: 0.6 x 0.2 ")
        );
    }

    #[test]
    fn refusals_name_the_fault() {
        for (text, part) in [
            ("0.6x0.2", "write ellipse:AxB"),
            ("ellipse:0.6", "write ellipse:AxB"),
            ("ellipse:0.2x0.6", "write ellipse:0.6x0.2"),
            ("ellipse:0.6x0", "'0' is not a size"),
            ("ellipse:0.6xnan", "'nan' is not a size"),
            ("circle:-1", "'-1' is not a size"),
            ("stadium:3x1", "stadium is not supported yet"),
            ("star:3", "write ellipse:AxB"),
        ] {
            let message = parse_aperture(text).expect_err(text).to_string();
            assert!(message.contains(part), "{text}: {message}");
        }
    }
}

//! Which part of a mesh is a surface to print on.
//!
//! In: the text of an option. Out: a [`SurfaceRegion`].

/// Which triangles of a surface are meant.
#[derive(Clone, Debug, PartialEq)]
pub enum SurfaceRegion {
    /// Those of a group, object, component or volume of that name.
    Group(String),
    /// Triangles of which all corners have that colour.
    Colour([u8; 3]),
    /// Triangles whose normal is tilted from Z by no more than that.
    Normal {
        /// The tilt.
        most_rad: f64,
    },
}

impl SurfaceRegion {
    /// Reads `group:NAME`, `colour:#RRGGBB` or `normal:DEG`, as in `normal:60`; `None` for anything else.
    pub fn parse(text: &str) -> Option<SurfaceRegion> {
        let (kind, rest) = text.split_once(':')?;
        match kind {
            "group" => (!rest.is_empty()).then(|| SurfaceRegion::Group(rest.to_string())),
            "colour" | "color" => {
                let digits = rest.strip_prefix('#').filter(|digits| digits.len() == 6)?;
                let [_, colour @ ..] = u32::from_str_radix(digits, 16).ok()?.to_be_bytes();
                Some(SurfaceRegion::Colour(colour))
            }
            "normal" => {
                let most_deg = rest.parse::<f64>().ok();
                let most_deg = most_deg.filter(|deg| (0.0..=180.0).contains(deg))?;
                Some(SurfaceRegion::Normal {
                    most_rad: most_deg.to_radians(),
                })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_read_and_others_refused() {
        let group = SurfaceRegion::parse("group:top:left");
        assert_eq!(group, Some(SurfaceRegion::Group("top:left".to_string())));
        let colour = Some(SurfaceRegion::Colour([0xff, 0x80, 0]));
        assert_eq!(SurfaceRegion::parse("colour:#ff8000"), colour);
        assert!(matches!(
            SurfaceRegion::parse("normal:180"),
            Some(SurfaceRegion::Normal { .. })
        ));
        for wrong in [
            "",
            "top",
            "group:",
            "colour:ff8000",
            "colour:#ff80",
            "normal:181",
            "normal:x",
        ] {
            assert_eq!(SurfaceRegion::parse(wrong), None, "{wrong}");
        }
    }
}

//! An outline that is drawn on a surface in space: polygon JSON whose points have three coordinates.
//!
//! In: the file's bytes and [`ReadOptions`]. Out: rings of points in mm, `None` for an outline of the plane. Not
//! covered: whether they are on a surface; the projection onto a mesh checks that.

use super::ReadOptions;
use super::polygon::{SpacePoints, space_points};
use crate::text::refusal::Refusal;
use nalgebra::Vector3;

/// An outline in space, mm.
#[derive(Clone, Debug, PartialEq)]
pub struct SpaceOutline {
    /// Name for headers and pictures.
    pub name: String,
    /// The exterior, and the holes in it.
    pub rings: Vec<Vec<Vector3<f64>>>,
}

/// Reads an outline in space; `name` is used if the file has none.
///
/// # Errors
/// [`Refusal`].
pub fn read_in_space(
    bytes: &[u8],
    name: &str,
    options: &ReadOptions,
) -> Result<Option<SpaceOutline>, Refusal> {
    let Some(SpacePoints { own_name, rings }) = space_points(bytes, options)? else {
        return Ok(None);
    };
    let rings = rings.into_iter().map(|mut ring: Vec<Vector3<f64>>| {
        if ring.len() > 1 && ring.first() == ring.last() {
            ring.pop();
        }
        ring.iter_mut().for_each(|point| *point *= options.scale);
        ring
    });
    Ok(Some(SpaceOutline {
        name: own_name.unwrap_or_else(|| name.to_string()),
        rings: rings.collect(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_in_space_are_read_and_others_left() {
        let text = br#"{"units": "cm", "exterior": [[0, 0, 1], [1, 0, 1], [1, 1, 2], [0, 0, 1]]}"#;
        let options = ReadOptions {
            scale: 2.0,
            ..ReadOptions::default()
        };
        let outline = read_in_space(text, "patch", &options).unwrap().unwrap();
        assert_eq!(outline.name, "patch");
        assert_eq!(outline.rings.len(), 1);
        assert_eq!(outline.rings[0].len(), 3);
        assert_eq!(outline.rings[0][2], Vector3::new(20.0, 20.0, 40.0));
        let flat = br#"{"units": "mm", "exterior": [[0, 0], [1, 0], [1, 1]]}"#;
        assert_eq!(read_in_space(flat, "flat", &options).unwrap(), None);
        let mixed = br#"{"units": "mm", "exterior": [[0, 0, 0], [1, 0], [1, 1, 0]]}"#;
        assert!(read_in_space(mixed, "mixed", &options).is_err());
    }
}

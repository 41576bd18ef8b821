//! Pieces of a part with build directions of their own, and how they are written.
//!
//! In: `auto`, or TOML with a table `[[piece]]` for each. Out: [`Directions`]; what `auto` found as TOML. Places and
//! directions are in the coordinates of the input.

use crate::text::refusal::{Refusal, refusal};
use serde::Deserialize;
use std::fmt::Write;
use std::str::FromStr;

/// Most pieces besides the rest that a file may name.
pub const CUTS_MAX: usize = 16;
/// Farthest place from the origin, as for meshes, mm.
const FAR_MAX_MM: f64 = 1e5;
/// Directions shorter than this are none.
const DIRECTION_MIN: f64 = 1e-6;
/// The first line of a file that `auto` writes.
pub const FIRST_LINE: &str = "# Headway directions, found by auto";

/// A piece: what lies above a plane, connected near a place of it.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PieceCut {
    /// From the tip into the head: the plane's normal, of any length.
    pub direction: [f64; 3],
    /// A place on the plane, below the piece.
    pub at_mm: [f64; 3],
}

/// Where the pieces come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Directions {
    /// From a search.
    Auto,
    /// From a file, in the order of printing, after the rest.
    Given(Vec<PieceCut>),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    piece: Vec<PieceCut>,
}

impl FromStr for Directions {
    type Err = Refusal;

    /// `auto`, or the text of a file.
    fn from_str(text: &str) -> Result<Directions, Refusal> {
        if text == "auto" {
            return Ok(Directions::Auto);
        }
        let file: File = toml::from_str(text).map_err(|error| {
            refusal!(
                "{}: write a table [[piece]] for each piece, with direction = [x, y, z] and at_mm = [x, y, z]",
                error.to_string().trim_end()
            )
        })?;
        let count = file.piece.len();
        if !(1..=CUTS_MAX).contains(&count) {
            return Err(refusal!(
                "{count} tables [[piece]]: write 1 to {CUTS_MAX}; what none of them takes is printed first, upright"
            ));
        }
        for (number, piece) in (1..).zip(&file.piece) {
            piece
                .check()
                .map_err(|why| refusal!("piece {number}: {why}"))?;
        }
        Ok(Directions::Given(file.piece))
    }
}

impl PieceCut {
    fn check(&self) -> Result<(), Refusal> {
        let [x, y, z] = self.direction;
        let length = x.hypot(y).hypot(z);
        if !(length.is_finite() && length > DIRECTION_MIN) {
            return Err(refusal!(
                "direction = [{x}, {y}, {z}] has no length: write the direction from the tip into the head, as in [1, 0, 1]"
            ));
        }
        if z < -1e-9 * length {
            return Err(refusal!(
                "direction = [{x}, {y}, {z}] leads into the bed: write one whose z is not negative"
            ));
        }
        match self.at_mm.iter().all(|mm| mm.abs() <= FAR_MAX_MM) {
            true => Ok(()),
            false => Err(refusal!(
                "at_mm = {:?}: write a place of the part in mm, no farther than {FAR_MAX_MM} from the origin",
                self.at_mm
            )),
        }
    }
}

/// The text of a file with these pieces.
pub fn to_toml(cuts: &[PieceCut]) -> String {
    let mut text = format!(
        "{FIRST_LINE}. Without this line it is yours, and is not replaced.\n\
         # Pieces in the order of printing, after the rest, which stands on the bed: each is what lies above the plane\n\
         # through at_mm across direction, connected there. Cut from the last to the first.\n"
    );
    for PieceCut { direction, at_mm } in cuts {
        let [[a, b, c], [x, y, z]] = [direction, at_mm].map(|of| of.map(|number| number + 0.0));
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n[[piece]]\ndirection = [{a:.6}, {b:.6}, {c:.6}]\nat_mm = [{x:.3}, {y:.3}, {z:.3}]\n"
        );
    }
    text
}

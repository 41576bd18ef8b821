//! Headings along the beads of G-code, chosen by the time that the nozzle needs to turn.
//!
//! ```text
//! lines --bands, nodes--> headings allowed at each node --smooth--> headings --> HeadingTrack
//! (mm, mm/s)              (rad)                                     (rad)        (rad by mm)
//! ```
//! The nozzle prints a bead of the file's width at 90° - alpha from the travel, with 2 e(alpha) = width, on either
//! side; long straight legs have exactly that. Turning by 90° at a corner takes the nozzle longer than the tip needs
//! for some millimetres, so the turn begins before the corner and ends after it, while the bead stays nearly as
//! wide: within an eighth of the file's width at some distance from the corner (`FAR_SHARE`), within a third close
//! to it (`NEAR_SHARE`), and of any width only right at it, or on a short link of an infill or a support, over which
//! the heading is held. Travel between passes is free for turning.
//!
//! In: legs of passes without those of length 0, in printing order. Out: a [`HeadingTrack`] for each pass. Not
//! covered: the effect of the tip's limits, and volumes, which are the file's.

mod bands;
mod nodes;
mod sides;
mod smooth;
#[cfg(test)]
mod tests;

use crate::geometry::aperture::Aperture;
use crate::geometry::hermite::hermite;
use crate::settings::Settings;
use nodes::Node;

/// Share by which a bead may be wider or narrower than the file's on a long straight leg (numbers), at some
/// distance from corners, and near them.
const EXACT_SHARE: f64 = 0.0003;
const FAR_SHARE: f64 = 1.0 / 8.0;
const NEAR_SHARE: f64 = 1.0 / 3.0;

/// What steps of the nodes and rounding may add to a share, in figures.
const ROUNDING_SHARE: f64 = 0.01;

/// The legs of a pass.
#[derive(Clone, Debug)]
pub struct BeadLines {
    /// Directions of travel in the plane, rad; straight up that of the leg before.
    pub travel_rad: Vec<f64>,
    /// Lengths, mm.
    pub length_mm: Vec<f64>,
    /// Widths of the beads, mm.
    pub widths_mm: Vec<f64>,
    /// Requested tip speeds, mm/s.
    pub speeds_mm_s: Vec<f64>,
    /// Infill and supports: the width of their links does not matter.
    pub is_inside: Vec<bool>,
    /// Time of the travel to it, s.
    pub arrival_s: f64,
}

/// Headings along a pass.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeadingTrack {
    /// Places along the lines, rising, mm.
    places_mm: Vec<f64>,
    headings_rad: Vec<f64>,
    /// Rates of change, rad/mm.
    slopes: Vec<f64>,
    /// Length whose bead differs from the file's.
    pub off: WidthOff,
}

/// Length of beads that are wider or narrower than the file's, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WidthOff {
    /// By more than an eighth.
    pub eighth_mm: f64,
    /// By more than a third.
    pub third_mm: f64,
    /// The longest connected stretch of that.
    pub longest_mm: f64,
}

impl WidthOff {
    /// Adds the lengths of another pass.
    pub fn add(&mut self, other: &WidthOff) {
        self.eighth_mm += other.eighth_mm;
        self.third_mm += other.third_mm;
        self.longest_mm = self.longest_mm.max(other.longest_mm);
    }
}

/// Headings of passes that the nozzle enters with `start_rad`.
pub fn bead_headings(
    passes: &[BeadLines],
    start_rad: f64,
    settings: &Settings,
) -> Vec<HeadingTrack> {
    let aperture = &settings.aperture;
    let legs = bands::leg_bands(passes, start_rad, aperture);
    let nodes: Vec<Vec<Node>> = passes
        .iter()
        .zip(&legs)
        .map(|(lines, legs)| nodes::nodes(lines, legs, aperture))
        .collect();
    let headings_rad = smooth::smoothed(passes, &nodes, start_rad, settings);
    let mut rest_rad = headings_rad.as_slice();
    let tracks = passes.iter().zip(&nodes).map(|(lines, nodes)| {
        let (own_rad, others_rad) = rest_rad.split_at(nodes.len());
        rest_rad = others_rad;
        let off = off(lines, nodes, own_rad, aperture);
        let places_mm = nodes.iter().map(|node| node.place_mm).collect();
        HeadingTrack::through(places_mm, own_rad.to_vec(), off)
    });
    tracks.collect()
}

impl HeadingTrack {
    fn through(places_mm: Vec<f64>, headings_rad: Vec<f64>, off: WidthOff) -> HeadingTrack {
        let last = places_mm.len().saturating_sub(1);
        let step = |i: usize| {
            let way_mm = (places_mm[i + 1] - places_mm[i]).max(f64::MIN_POSITIVE);
            (way_mm, (headings_rad[i + 1] - headings_rad[i]) / way_mm)
        };
        let slope = |i: usize| match i {
            _ if last == 0 => 0.0,
            0 => step(0).1,
            _ if i == last => step(last - 1).1,
            _ => {
                // Of the parabola through three nodes.
                let ([before_mm, before], [after_mm, after]) =
                    (<[f64; 2]>::from(step(i - 1)), <[f64; 2]>::from(step(i)));
                (before * after_mm + after * before_mm) / (before_mm + after_mm)
            }
        };
        let slopes = (0..places_mm.len()).map(slope).collect();
        HeadingTrack {
            places_mm,
            headings_rad,
            slopes,
            off,
        }
    }

    /// At a place along the lines: a cubic from node to node.
    pub fn at(&self, place_mm: f64) -> f64 {
        let Some(&last_rad) = self.headings_rad.last() else {
            return 0.0;
        };
        let after = self.places_mm.partition_point(|at_mm| *at_mm <= place_mm);
        if after == 0 {
            return self.headings_rad[0];
        }
        if after == self.places_mm.len() {
            return last_rad;
        }
        let way_mm = self.places_mm[after] - self.places_mm[after - 1];
        let t = (place_mm - self.places_mm[after - 1]) / way_mm;
        let [from, to] = [self.headings_rad[after - 1], self.headings_rad[after]];
        let [leaves, comes] = [after - 1, after].map(|i| self.slopes[i] * way_mm);
        hermite(t, [from, to], [leaves, comes])
    }
}

/// How much of the beads is how much wider or narrower.
fn off(lines: &BeadLines, nodes: &[Node], headings_rad: &[f64], aperture: &Aperture) -> WidthOff {
    let share = |node: &Node, heading_rad: f64| {
        let width_mm = lines.widths_mm[node.leg];
        let laid_mm = bands::width_mm(heading_rad - lines.travel_rad[node.leg], aperture);
        // The nozzle cannot lay a bead wider or narrower than itself.
        let asked_mm = width_mm.clamp(2.0 * aperture.minor_mm(), 2.0 * aperture.major_mm());
        (laid_mm / asked_mm - 1.0).abs()
    };
    let mut sum = WidthOff::default();
    let mut piece_mm = 0.0;
    for (pair, headings) in nodes.windows(2).zip(headings_rad.windows(2)) {
        let way_mm = pair[1].place_mm - pair[0].place_mm;
        // The middle of a step, on the leg where it ends.
        let share = share(&pair[1], 0.5 * (headings[0] + headings[1]));
        if share > FAR_SHARE + ROUNDING_SHARE {
            sum.eighth_mm += way_mm;
        }
        if share > NEAR_SHARE + ROUNDING_SHARE {
            sum.third_mm += way_mm;
            piece_mm += way_mm;
            sum.longest_mm = sum.longest_mm.max(piece_mm);
        } else {
            piece_mm = 0.0;
        }
    }
    sum
}

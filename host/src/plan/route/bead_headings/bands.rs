//! Headings that each leg of a pass may have.
//!
//! In: lines, the nozzle. Out: [`LegBands`], angles counted on along the pass. A leg that is shorter than both its
//! neighbours and short beside the nozzle is a link, if it belongs to an infill or a support: the heading is held
//! over it, from the one neighbour's to the other's.

use super::sides::{Choice, Range, least_turning};
use super::{Arrival, BeadLines, FAR_SHARE, NEAR_SHARE};
use crate::geometry::aperture::Aperture;
use std::f64::consts::{FRAC_PI_2, PI};

/// Longest link, in semi-axes a: 3 mm of a nozzle of 1.2 mm. Supports lie 2.5 mm apart.
const LINK_SHARE: f64 = 5.0;
/// Angles closer than this to 0° or 90° are these: the range goes on behind them.
const EDGE_RAD: f64 = 0.01;
/// Narrowest range, rad: its middle ± 1°.
const RANGE_MIN_RAD: f64 = 0.035;

/// Headings of a leg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegBands {
    /// Anywhere on it.
    pub far: Range,
    /// Beside its corners.
    pub near: Range,
    /// A link, over which the heading is held.
    pub is_link: bool,
}

/// Width that the nozzle lays whose long axis is at this angle from the travel.
pub fn width_mm(off_travel_rad: f64, aperture: &Aperture) -> f64 {
    // The extent is that across the travel: alpha counts from the normal.
    let across = crate::geometry::Vector2::new(0.0, 1.0);
    2.0 * aperture.extent_mm(off_travel_rad, across)
}

/// Angle of the long axis from the travel for a bead of this width, from 0 to 90°.
fn off_travel_rad(width_mm: f64, aperture: &Aperture) -> f64 {
    FRAC_PI_2 - aperture.angle_of_extent_rad(0.5 * width_mm)
}

/// Angles from the travel for beads of `width_mm` less and more `share`.
fn angles_rad(width_mm: f64, share: f64, aperture: &Aperture) -> [f64; 2] {
    let [low, high] =
        [1.0 - share, 1.0 + share].map(|share| off_travel_rad(share * width_mm, aperture));
    let low = if low < EDGE_RAD { 0.0 } else { low };
    let high = if high > FRAC_PI_2 - EDGE_RAD {
        FRAC_PI_2
    } else {
        high
    };
    match high - low < RANGE_MIN_RAD {
        true if low > 0.0 && high < FRAC_PI_2 => {
            let middle = 0.5 * (low + high);
            [middle - 0.5 * RANGE_MIN_RAD, middle + 0.5 * RANGE_MIN_RAD]
        }
        true if low > 0.0 => [high - 0.5 * RANGE_MIN_RAD, high],
        true => [low, low + 0.5 * RANGE_MIN_RAD],
        false => [low, high],
    }
}

/// The range that holds these angles from the travel, on the side of the positive ones: it goes on through the travel
/// and through the normal where it reaches them.
fn range_of([low, high]: [f64; 2]) -> Range {
    let from = if low == 0.0 { -high } else { low };
    let to = if high == FRAC_PI_2 { PI - low } else { high };
    Range::new(from, to)
}

/// What a leg of a width may have, both sides of the travel where these are two.
fn choices(width_mm: f64, travel_rad: f64, aperture: &Aperture) -> Vec<Choice> {
    let width_mm = width_mm.clamp(2.0 * aperture.minor_mm(), 2.0 * aperture.major_mm());
    let far_angles = angles_rad(width_mm, FAR_SHARE, aperture);
    let near_angles = angles_rad(width_mm, NEAR_SHARE, aperture);
    let [far, near] = [far_angles, near_angles].map(range_of);
    let is_one = far_angles[0] == 0.0 || far_angles[1] == FRAC_PI_2;
    let mirrored = |range: Range| Range::new(-range.high_rad, -range.low_rad);
    let at = |far: Range, near: Range| Choice {
        far: far.shifted(travel_rad),
        near: near.hull(&far).shifted(travel_rad),
    };
    let mut found = vec![at(far, near)];
    if !is_one {
        found.push(at(mirrored(far), mirrored(near)));
    }
    found
}

/// Links of a pass.
fn links(lines: &BeadLines, longest_mm: f64) -> Vec<bool> {
    let lengths = &lines.length_mm;
    let count = lengths.len();
    let is_link = |leg: usize| {
        let longer = |other: usize| lengths[other] > lengths[leg];
        let is_short = (leg == 0 || longer(leg - 1)) && (leg + 1 >= count || longer(leg + 1));
        count > 1 && lines.is_inside[leg] && lengths[leg] <= longest_mm && is_short
    };
    (0..count).map(is_link).collect()
}

/// Headings of all legs.
pub fn leg_bands(
    lines: &BeadLines,
    arrival: Option<Arrival>,
    aperture: &Aperture,
) -> Vec<LegBands> {
    let is_link = links(lines, LINK_SHARE * aperture.major_mm());
    let of_leg =
        |leg: usize| choices(lines.widths_mm[leg], lines.travel_rad[leg], aperture);
    let legs = || 0..lines.length_mm.len();
    let kept: Vec<Vec<Choice>> = legs().filter(|leg| !is_link[*leg]).map(of_leg).collect();
    let period_rad = aperture.period_rad();
    let start_rad = arrival.map(|arrival| arrival.heading_rad);
    let mut chosen = least_turning(&kept, start_rad, period_rad).into_iter();
    let mut found: Vec<Option<LegBands>> = legs()
        .map(|leg| {
            let choice = if is_link[leg] { None } else { chosen.next() };
            choice.map(|choice| LegBands {
                far: choice.far,
                near: choice.near,
                is_link: false,
            })
        })
        .collect();
    for leg in legs().filter(|leg| is_link[*leg]) {
        let beside = [leg.checked_sub(1), Some(leg + 1)];
        let beside = beside.map(|other| found.get(other?).copied().flatten());
        let held = held(&beside, &of_leg(leg), period_rad);
        found[leg] = Some(held);
    }
    found.into_iter().flatten().collect()
}

/// Headings of a link: its neighbours', its own and all between them.
fn held(beside: &[Option<LegBands>; 2], own: &[Choice], period_rad: f64) -> LegBands {
    let neighbours = beside.iter().flatten().map(|bands| bands.near);
    let between = neighbours.reduce(|a, b| a.hull(&b));
    let range = match (between, own.first()) {
        (Some(between), Some(own)) => {
            let own = own.nearest_to(between.middle_rad(), period_rad);
            between.hull(&own.near)
        }
        (Some(between), None) => between,
        (None, own) => own.map_or(Range::new(0.0, period_rad), |own| own.near),
    };
    LegBands {
        far: range,
        near: range,
        is_link: true,
    }
}

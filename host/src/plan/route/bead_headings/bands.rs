//! Headings that each leg of a pass may have.
//!
//! In: lines, the nozzle. Out: [`LegBands`], with angles unwrapped along the pass. A leg that is shorter than both
//! its neighbours and short relative to the nozzle is a link, if it belongs to an infill or a support: the heading
//! is held over it, from one neighbour's to the other's.

use super::sides::{Choice, Range, least_turning};
use super::{BeadLines, EXACT_SHARE, FAR_SHARE, NEAR_SHARE};
use crate::geometry::aperture::Aperture;
use std::f64::consts::{FRAC_PI_2, PI};

/// Longest link, in semi-axes a: 3 mm of a nozzle of 1.2 mm. Supports are 2.5 mm apart.
const LINK_SHARE: f64 = 5.0;
/// Angles closer than this to 0° or 90° count as these: the range continues beyond them.
const EDGE_RAD: f64 = 0.01;
/// Narrowest range, rad: the tolerance of headings.
const RANGE_MIN_RAD: f64 = 4e-4;
/// Straight legs of more than twice this have their exact width away from their ends, in semi-axes a: 3 mm of a
/// nozzle of 1.2 mm.
pub const TURN_REACH_SHARE: f64 = 5.0;

/// Headings of a leg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegBands {
    /// The permitted headings.
    pub choice: Choice,
    /// A link, over which the heading is held.
    pub is_link: bool,
}

/// Bead width of the nozzle with its long axis at this angle from the travel.
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

/// The range that holds these angles from the travel, on the side of the positive ones: it continues through the
/// travel and through the normal if it reaches them.
fn range_of([low, high]: [f64; 2]) -> Range {
    let from = if low == 0.0 { -high } else { low };
    let to = if high == FRAC_PI_2 { PI - low } else { high };
    Range::new(from, to)
}

/// What a leg of a width may have, both sides of the travel where these are two; `is_long` has a straight middle.
fn choices(width_mm: f64, travel_rad: f64, is_long: bool, aperture: &Aperture) -> Vec<Choice> {
    let width_mm = width_mm.clamp(2.0 * aperture.minor_mm(), 2.0 * aperture.major_mm());
    let shares = [EXACT_SHARE, FAR_SHARE, NEAR_SHARE];
    let angles = shares.map(|share| angles_rad(width_mm, share, aperture));
    let [exact, far, near] = angles.map(range_of);
    let far = far.hull(&exact);
    let mirrored = |range: &Range| Range::new(-range.high_rad, -range.low_rad);
    let at = |ranges: [Range; 3]| {
        let [exact, far, near] = ranges.map(|range| range.shifted(travel_rad));
        Choice {
            exact: if is_long { exact } else { far },
            far,
            near: near.hull(&far),
        }
    };
    let mut found = vec![at([exact, far, near])];
    let decides = if is_long { angles[0] } else { angles[1] };
    if decides[0] > 0.0 && decides[1] < FRAC_PI_2 {
        found.push(at([&exact, &far, &near].map(mirrored)));
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

/// Headings of all legs of all passes.
pub fn leg_bands(passes: &[BeadLines], start_rad: f64, aperture: &Aperture) -> Vec<Vec<LegBands>> {
    let major_mm = aperture.major_mm();
    let period_rad = aperture.period_rad();
    let of_leg = |lines: &BeadLines, leg: usize| {
        let is_long = lines.length_mm[leg] > 2.0 * TURN_REACH_SHARE * major_mm;
        choices(
            lines.widths_mm[leg],
            lines.travel_rad[leg],
            is_long,
            aperture,
        )
    };
    let links: Vec<Vec<bool>> = passes
        .iter()
        .map(|lines| links(lines, LINK_SHARE * major_mm))
        .collect();
    let mut kept = Vec::new();
    for (lines, is_link) in passes.iter().zip(&links) {
        let of_pass = (0..is_link.len()).filter(|leg| !is_link[*leg]);
        kept.extend(of_pass.map(|leg| of_leg(lines, leg)));
    }
    let mut chosen = least_turning(&kept, start_rad, period_rad).into_iter();
    let bands = passes.iter().zip(&links).map(|(lines, is_link)| {
        let mut found: Vec<Option<LegBands>> = is_link
            .iter()
            .map(|is_link| if *is_link { None } else { chosen.next() })
            .map(|choice| {
                choice.map(|choice| LegBands {
                    choice,
                    is_link: false,
                })
            })
            .collect();
        for leg in (0..is_link.len()).filter(|leg| is_link[*leg]) {
            let beside = [leg.checked_sub(1), Some(leg + 1)];
            let beside = beside.map(|other| found.get(other?).copied().flatten());
            found[leg] = Some(held(&beside, &of_leg(lines, leg), period_rad));
        }
        found.into_iter().flatten().collect()
    });
    bands.collect()
}

/// Headings of a link: its neighbours', its own and all between them.
fn held(beside: &[Option<LegBands>; 2], own: &[Choice], period_rad: f64) -> LegBands {
    let neighbours = beside.iter().flatten().map(|bands| bands.choice.near);
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
        choice: Choice {
            exact: range,
            far: range,
            near: range,
        },
        is_link: true,
    }
}

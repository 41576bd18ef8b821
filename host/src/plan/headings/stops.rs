//! Headings of a path -> where they fit between the stops of the joint that turns the nozzle.
//!
//! In: unwrapped headings along any path (rad), the stops, the aperture's period: headings a period apart print the same
//! bead, so a path may be entered at any of them. Out: the heading in which it is entered, or the places where it is cut:
//! as few as possible, and of those the cheapest. The tool is upright, or the joint follows the heading whatever it leans.

use crate::geometry::frame::Frame;
use crate::settings::Settings;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

/// What rounding may take from a whole number of periods.
const ROUNDING: f64 = 1e-9;

/// Stops of the joint that turns the nozzle as headings, rad.
pub fn heading_range(settings: &Settings) -> [f64; 2] {
    if let Some(wrist) = &settings.wrist {
        return wrist.headings_rad;
    }
    settings
        .heading_joint()
        .map_or([f64::NEG_INFINITY, f64::INFINITY], |joint| {
            [joint.position_min, joint.position_max]
        })
}

/// The heading equal to `heading_rad` for the deposit (modulo the aperture's period) that is nearest
/// to `from_rad`.
pub fn nearest_heading(heading_rad: f64, from_rad: f64, period_rad: f64) -> f64 {
    heading_rad + ((from_rad - heading_rad) / period_rad).round() * period_rad
}

/// The heading in which a path with these headings is entered: of those equal to its first for the deposit the nearest to
/// `from_rad` from which all of it stays between the stops. If there is none, the nearest of all: the check of the joints'
/// ranges then names the joint.
pub fn entry_heading(
    headings_rad: impl IntoIterator<Item = f64>,
    from_rad: f64,
    settings: &Settings,
) -> f64 {
    let mut headings_rad = headings_rad.into_iter();
    let first_rad = headings_rad.next().unwrap_or(from_rad);
    let period_rad = settings.aperture.period_rad();
    let nearest_rad = nearest_heading(first_rad, from_rad, period_rad);
    let [least_rad, most_rad] = range_of(headings_rad.map(|rad| rad - first_rad).chain([0.0]));
    let [low_rad, high_rad] = heading_range(settings);
    // Away from the stops by what segments may be off, if that can be.
    for slack_rad in [settings.tolerances.heading_rad, 0.0] {
        let low_rad = low_rad - least_rad + slack_rad;
        let high_rad = high_rad - most_rad - slack_rad;
        if (low_rad..=high_rad).contains(&nearest_rad) {
            return nearest_rad;
        }
        let periods = |to_rad: f64| (to_rad - first_rad) / period_rad;
        let lowest_rad = first_rad + (periods(low_rad) - ROUNDING).ceil() * period_rad;
        let highest_rad = first_rad + (periods(high_rad) + ROUNDING).floor() * period_rad;
        if lowest_rad <= highest_rad {
            return nearest_rad.clamp(lowest_rad, highest_rad);
        }
    }
    nearest_rad
}

fn range_of(headings_rad: impl Iterator<Item = f64>) -> [f64; 2] {
    headings_rad.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], at| {
        [least.min(at), most.max(at)]
    })
}

/// The stops, and how far apart headings are that print the same.
#[derive(Clone, Copy, Debug)]
pub struct Stops {
    range_rad: [f64; 2],
    period_rad: f64,
}

impl Stops {
    /// Of the nozzle, as headings in the plane.
    pub fn of(settings: &Settings) -> Stops {
        Stops::seen_from(&Frame::IDENTITY, settings)
    }

    /// The stops as headings of a frame.
    pub fn seen_from(frame: &Frame, settings: &Settings) -> Stops {
        let [one_rad, other_rad] = heading_range(settings).map(|rad| frame.angle_in(rad));
        Stops {
            range_rad: [one_rad.min(other_rad), one_rad.max(other_rad)],
            period_rad: settings.aperture.period_rad(),
        }
    }

    /// True where headings fit between the stops, some periods away.
    pub fn headings_fit(&self, headings_rad: impl Iterator<Item = f64>, room_rad: f64) -> bool {
        self.fit(range_of(headings_rad), room_rad)
    }

    /// True where headings from the least to the most fit between the stops, some periods away.
    fn fit(&self, [least_rad, most_rad]: [f64; 2], room_rad: f64) -> bool {
        let [low_rad, high_rad] = self.range_rad;
        let first = ((low_rad + room_rad - least_rad) / self.period_rad - ROUNDING).ceil();
        let last = ((high_rad - room_rad - most_rad) / self.period_rad + ROUNDING).floor();
        first <= last
    }

    /// For each heading the earliest one before it from which all up to it fit; `None` if one does
    /// not fit with its predecessor.
    pub fn fits_from(&self, headings: &[f64], room_rad: f64) -> Option<Vec<usize>> {
        // Headings that are the least, the most of all after them.
        let (mut least, mut most) = (VecDeque::new(), VecDeque::new());
        let (mut from, mut fits_from) = (0, Vec::with_capacity(headings.len()));
        for (number, &heading_rad) in headings.iter().enumerate() {
            for (ends, sign) in [(&mut least, 1.0), (&mut most, -1.0)] {
                while ends
                    .back()
                    .is_some_and(|&end: &usize| sign * (headings[end] - heading_rad) >= 0.0)
                {
                    ends.pop_back();
                }
                ends.push_back(number);
            }
            while !self.fit([headings[least[0]], headings[most[0]]], room_rad) {
                from += 1;
                if from >= number.max(1) {
                    return None;
                }
                for ends in [&mut least, &mut most] {
                    while ends[0] < from {
                        ends.pop_front();
                    }
                }
            }
            fits_from.push(from);
        }
        Some(fits_from)
    }
}

/// Of the sets with the fewest cuts the cheapest one. Pieces share the place at a cut; one that
/// ends with a place begins at `fits_from` or later.
pub fn cheapest_cuts(fits_from: &[usize], cost: impl Fn(usize) -> i64) -> Vec<usize> {
    // For each place the cuts and what they cost if there is one here, and where the one before
    // it is.
    let mut cut_at: Vec<(Reverse<(u32, i64)>, usize)> = vec![(Reverse((0, 0)), 0)];
    let mut before: BinaryHeap<(Reverse<(u32, i64)>, usize)> = BinaryHeap::new();
    for (number, &from) in fits_from.iter().enumerate().skip(1) {
        before.push((cut_at[number - 1].0, number - 1));
        while before.peek().is_some_and(|&(_, cut)| cut < from) {
            before.pop();
        }
        let Some(&(Reverse((cuts, costs)), last)) = before.peek() else {
            return Vec::new();
        };
        let own = cost(number);
        cut_at.push((Reverse((cuts + 1, costs + own)), last));
    }
    let mut cuts = Vec::new();
    let mut at = cut_at.last().map_or(0, |&(_, last)| last);
    while at > 0 {
        cuts.push(at);
        at = cut_at[at].1;
    }
    cuts.reverse();
    cuts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: the fewest cuts, and of those the cheapest. Method: windows and costs by hand.
    #[test]
    fn the_cheapest_of_the_fewest_cuts_are_chosen() {
        let cheapest = |room: usize, costs: &[i64]| {
            let fits_from: Vec<usize> = (0..costs.len()).map(|i| i.saturating_sub(room)).collect();
            cheapest_cuts(&fits_from, |cut| costs[cut])
        };
        assert_eq!(cheapest(9, &[5; 10]), [0usize; 0]);
        assert_eq!(cheapest(6, &[9, 9, 9, 2, 9, 1, 9, 0, 9, 9]), [5]);
        // After a cut at 1 the next is at 5 at the latest.
        assert_eq!(cheapest(4, &[9, 0, 9, 4, 9, 9, 9, 3, 9, 9]), [3, 7]);
        assert_eq!(cheapest(4, &[0; 0]), [0usize; 0]);
    }
}

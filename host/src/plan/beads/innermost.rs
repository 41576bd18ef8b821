//! The innermost beads share out the gap or the overlap that they leave between them.
//!
//! In: the passes of a channel, and what bounds it. Out: the same passes, their contacts with the
//! extents that close the gap, their headings found again. Rounds of a damped iteration: a bead that
//! widens turns, and its neighbour sees that in the next round. Only the sections about contacts
//! that take part are found again; a plate's loops meet the axis at their corners alone.

use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::EdgeIndex;
use crate::plan::beads::channel_walls::Laid;
use crate::plan::beads::field::Field;
use crate::plan::beads::passes::{Lengths, PassSettings};
use crate::plan::headings::profile::{Ahead, all_ahead, lap_turn, refined, smooth};
use crate::plan::pass::{Contact, LayerPass, Placement};
use rayon::prelude::*;

/// Rounds.
const ROUNDS: usize = 5;
/// Share of a gap that each of its two beads takes in a round.
const GAP_SHARE: f64 = 0.25;
/// Most that a bead widens or narrows by in a round, against b.
const STEP_MAX_SHARE: f64 = 0.3;
/// A change of the extent that is none, against b: a fifth of a micrometre.
const STILL_SHARE: f64 = 1e-3;
/// Path to either side of a contact that takes part on which headings are found again, against a:
/// half of it goes over to what was there.
const MARGIN_SHARE: f64 = 8.0;
/// Share of a pass above which all of it is found again.
const WHOLE_SHARE: f64 = 0.7;

/// What bounds a channel whose inner wall is the medial axis in places.
pub struct Innermost<'a> {
    /// Its number from the wall, 1 the outermost.
    pub channel: usize,
    /// The channel field.
    pub field: &'a Field,
    /// Its outer wall.
    pub walls: &'a EdgeIndex,
    /// What is asked of the passes.
    pub settings: &'a PassSettings,
    /// Lengths in proportion to the aperture.
    pub lengths: Lengths,
}

/// A section of a pass that is found again in every round.
struct Section {
    /// Its first placement; it may go on beyond the last one of a closed pass.
    from: usize,
    count: usize,
    /// What lies ahead of its contacts, once it is known.
    ahead: Option<Vec<Ahead>>,
}

/// In each round gives each half of the gap (or overlap) that two innermost beads leave between them
/// to the width that is wanted of either, and finds their headings again.
pub fn relax(found: &mut [LayerPass], innermost: &Innermost) {
    let mut sections: Vec<Option<Vec<Section>>> = (0..found.len()).map(|_| None).collect();
    for _ in 0..ROUNDS {
        let is_done = |own: &Option<Vec<Section>>| own.as_ref().is_some_and(Vec::is_empty);
        if sections.iter().all(is_done) {
            return;
        }
        let mut laid = Laid::new(&innermost.settings.aperture);
        for (run, pass) in found.iter().enumerate() {
            laid.add(run as u32, &pass.placements, pass.closed);
        }
        let passes = found.par_iter_mut().zip(&mut sections).enumerate();
        passes.for_each(|(run, (pass, sections))| match sections {
            None => {
                let all: Vec<usize> = (0..pass.placements.len()).collect();
                let moved = innermost.share_out(pass, run, &all, &laid);
                let mut own = innermost.sections_about(&moved, pass.closed);
                innermost.find_again(pass, &mut own);
                *sections = Some(own);
            }
            Some(own) => {
                let count = pass.placements.len();
                let numbers = own.iter().flat_map(|s| s.from..s.from + s.count);
                let numbers: Vec<usize> = numbers.map(|number| number % count).collect();
                innermost.share_out(pass, run, &numbers, &laid);
                innermost.find_again(pass, own);
            }
        });
    }
}

impl Innermost<'_> {
    /// Sets the extents that close the gaps at these contacts of a pass; for each of them whether it
    /// takes part.
    fn share_out(
        &self,
        pass: &mut LayerPass,
        run: usize,
        numbers: &[usize],
        laid: &Laid,
    ) -> Vec<bool> {
        let count = pass.placements.len();
        let (a, b) = (
            self.settings.aperture.major_mm(),
            self.settings.aperture.minor_mm(),
        );
        let extent_mm = |i: usize| {
            let contact = pass.placements[i].contact;
            if contact.length_mm <= 0.0 || !self.meets_axis(&contact) {
                return None;
            }
            let gap_mm = laid.facing_gap_mm(&contact, run as u32, i, count, pass.closed)?;
            let missing_mm = gap_mm + self.settings.overlap * 2.0 * contact.extent_mm;
            let step_mm = (GAP_SHARE * missing_mm).clamp(-STEP_MAX_SHARE * b, STEP_MAX_SHARE * b);
            Some((contact.extent_mm + step_mm).clamp(b, a))
        };
        let extents: Vec<Option<f64>> = numbers.par_iter().map(|&i| extent_mm(i)).collect();
        let numbered = numbers.iter().zip(extents);
        numbered
            .map(|(&i, extent_mm)| {
                let Some(extent_mm) = extent_mm else {
                    return false;
                };
                let contact = &mut pass.placements[i].contact;
                let step_mm = extent_mm - contact.extent_mm;
                contact.extent_mm = extent_mm;
                step_mm.abs() > STILL_SHARE * b
            })
            .collect()
    }

    /// True where the channel's inner wall is the medial axis: the field falls again behind it.
    fn meets_axis(&self, contact: &Contact) -> bool {
        let along = |t: f64| self.field.at(contact.point + contact.normal * t);
        let width = 2.0 * contact.extent_mm;
        let beyond = (1..=8).map(|i| along(width + 0.5 * self.lengths.grid_mm * i as f64));
        beyond.fold(f64::NEG_INFINITY, f64::max) < self.channel as f64 + 0.3
    }

    /// The sections about the contacts that moved, none of which meet; all of the pass where they
    /// would be most of it.
    fn sections_about(&self, moved: &[bool], closed: bool) -> Vec<Section> {
        let count = moved.len();
        let section = |from: usize, count: usize| Section {
            from,
            count,
            ahead: None,
        };
        let margin = self.margin();
        let mut taken = vec![false; count];
        for i in (0..count).filter(|&i| moved[i]) {
            let (low, high) = (i as isize - margin as isize, i + margin);
            for k in low..=high as isize {
                if closed {
                    taken[k.rem_euclid(count as isize) as usize] = true;
                } else if (0..count as isize).contains(&k) {
                    taken[k as usize] = true;
                }
            }
        }
        let all = taken.iter().filter(|taken| **taken).count();
        if all == 0 {
            return Vec::new();
        }
        if all as f64 > WHOLE_SHARE * count as f64 {
            return vec![section(0, count)];
        }
        // Begun where nothing moves, so that no section is cut in two.
        let begin = if closed {
            (0..count).find(|&i| !taken[i]).unwrap_or(0)
        } else {
            0
        };
        let mut found: Vec<Section> = Vec::new();
        for k in 0..count {
            let i = (begin + k) % count;
            if !taken[i] {
                continue;
            }
            match found.last_mut() {
                Some(last) if last.from + last.count == begin + k => last.count += 1,
                _ => found.push(section(begin + k, 1)),
            }
        }
        found
    }

    fn margin(&self) -> usize {
        let margin_mm = MARGIN_SHARE * self.settings.aperture.major_mm();
        (margin_mm / self.lengths.contact_mm).ceil() as usize
    }

    /// The placements of the sections again, for what their contacts want now.
    fn find_again(&self, pass: &mut LayerPass, sections: &mut [Section]) {
        let count = pass.placements.len();
        let closed = pass.closed;
        if let [whole] = sections
            && whole.count == count
        {
            let mut again = self.placements_again(&pass.placements, closed, &mut whole.ahead);
            smooth(&mut again, closed, &self.settings.aperture);
            pass.placements = again;
            return;
        }
        let headings: Vec<f64> = pass.placements.iter().map(|p| p.at.heading_rad).collect();
        let lap_rad = match closed {
            true => lap_turn(&headings, self.settings.aperture.period_rad()),
            false => 0.0,
        };
        for section in sections {
            let numbers = || section.from..section.from + section.count;
            // Beyond the last placement the heading goes on into the next lap.
            let laps_rad = |number: usize| lap_rad * (number / count) as f64;
            let before: Vec<Placement> = numbers()
                .map(|number| {
                    let mut placement = pass.placements[number % count];
                    placement.at.heading_rad += laps_rad(number);
                    placement
                })
                .collect();
            let mut again = self.placements_again(&before, false, &mut section.ahead);
            smooth(&mut again, false, &self.settings.aperture);
            for (k, number) in numbers().enumerate() {
                // The ends of an open pass are free.
                let from_start = if !closed && section.from == 0 {
                    usize::MAX
                } else {
                    k
                };
                let is_last = !closed && section.from + section.count == count;
                let from_end = if is_last {
                    usize::MAX
                } else {
                    section.count - 1 - k
                };
                let share = from_start.min(from_end) as f64 / (0.5 * self.margin() as f64);
                let mut placement = again[k];
                placement.at = between(before[k].at, again[k].at, share.min(1.0));
                placement.at.heading_rad -= laps_rad(number);
                pass.placements[number % count] = placement;
            }
        }
    }

    /// The placements on a run's contacts again. `ahead` is kept from the first time on: their places
    /// stay.
    fn placements_again(
        &self,
        before: &[Placement],
        closed: bool,
        ahead: &mut Option<Vec<Ahead>>,
    ) -> Vec<Placement> {
        let contacts: Vec<Contact> = before.iter().map(|placement| placement.contact).collect();
        let (aperture, walls) = (&self.settings.aperture, self.walls);
        let ahead = ahead.get_or_insert_with(|| all_ahead(&contacts, aperture, walls));
        refined(
            &contacts,
            closed,
            before,
            ahead,
            self.settings.turn_weight_mm2,
            aperture,
            walls,
        )
    }
}

/// From one placement to another that hardly differs.
fn between(from: Configuration, to: Configuration, share: f64) -> Configuration {
    Configuration {
        center: from.center + (to.center - from.center) * share,
        heading_rad: from.heading_rad + (to.heading_rad - from.heading_rad) * share,
    }
}

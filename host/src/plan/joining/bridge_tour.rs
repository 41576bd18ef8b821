//! Tours: closed paths through passes that bridges have joined.
//!
//! In: passes and the bridges between them. Out: one pass for each tour, its headings (rad)
//! unwrapped.

use crate::geometry::clearance::Configuration;
use crate::plan::headings::runs::unwrap_headings;
use crate::plan::joining::bridge_cost::Bridge;
use crate::plan::pass::{LayerPass, Placement};

/// A closed path through one or several passes.
#[derive(Default)]
pub struct Tour {
    stops: Vec<Stop>,
}

/// One place of a tour.
#[derive(Clone, Copy, PartialEq)]
enum Stop {
    /// Placement of a pass, by their numbers.
    Pass(usize, usize),
    /// On a bridge.
    Bridge(Configuration),
    /// Nothing is printed between the one before and the next; a tour has at most one.
    Break,
}

impl Tour {
    /// Of one pass, by its number.
    pub fn of(number: usize, pass: &LayerPass) -> Tour {
        let mut stops: Vec<Stop> = Vec::new();
        stops.extend((0..pass.placements.len()).map(|i| Stop::Pass(number, i)));
        if !pass.closed {
            stops.push(Stop::Break);
        }
        Tour { stops }
    }

    /// The tour as a path that begins and ends where pass `number` is opened, and the one of the
    /// two `ends` with which it begins; `None` if that stretch has been used before.
    fn opened(
        &self,
        number: usize,
        ends: [usize; 2],
        pass: &LayerPass,
    ) -> Option<(Vec<Stop>, usize)> {
        let place = |end: usize| {
            let stop = Stop::Pass(number, ends[end]);
            self.stops.iter().position(|other| *other == stop)
        };
        let (first, last) = (place(0)?, place(1)?);
        let (total, count) = (self.stops.len(), pass.placements.len());
        let at_gap = !pass.closed && ends == [count - 1, 0];
        let between = if at_gap {
            2
        } else {
            (ends[1] + count - ends[0]) % count
        };
        let begin = if (last + total - first) % total == between {
            1
        } else if (first + total - last) % total == between {
            0
        } else {
            return None;
        };
        let mut stops = self.stops.clone();
        stops.rotate_left([first, last][begin]);
        let taken = stops.split_off(total + 1 - between);
        let free = taken.iter().all(|stop| match stop {
            Stop::Pass(of, _) => *of == number,
            Stop::Bridge(_) => false,
            Stop::Break => at_gap,
        });
        free.then_some((stops, begin))
    }

    /// True if it has been merged into another tour.
    pub fn is_empty(&self) -> bool {
        self.stops.is_empty()
    }

    /// Both tours and the bridge as one; `None` if the bridge's ends were used before, or both
    /// tours are open.
    pub fn joined(&self, other: &Tour, bridge: &Bridge, passes: &[LayerPass]) -> Option<Tour> {
        let opened = |tour: &Tour, side: usize| {
            let number = bridge.loops[side];
            tour.opened(number, bridge.ends[side], &passes[number])
        };
        let (mut stops, begin) = opened(self, 0)?;
        let (mut theirs, their_begin) = opened(other, 1)?;
        // The connection out starts at the end of this tour, the connection back leads to its
        // beginning.
        let end = 1 - begin;
        let entry = end ^ usize::from(bridge.crossed);
        if their_begin != entry {
            theirs.reverse();
        }
        let breaks = stops
            .iter()
            .chain(&theirs)
            .filter(|stop| **stop == Stop::Break);
        if breaks.count() > 1 {
            return None;
        }
        let on_bridge = |at: &Configuration| Stop::Bridge(*at);
        stops.extend(bridge.ways[end].iter().map(on_bridge));
        stops.extend(theirs);
        stops.extend(bridge.ways[begin].iter().rev().map(on_bridge));
        Some(Tour { stops })
    }

    /// The tour as a pass, replacing `pass`, its first one; headings are unwrapped.
    pub fn pass(&self, pass: &LayerPass, passes: &[LayerPass], period_rad: f64) -> LayerPass {
        let mut stops = self.stops.clone();
        let gap = stops.iter().position(|stop| *stop == Stop::Break);
        if let Some(gap) = gap {
            stops.rotate_left(gap + 1);
        }
        let mut placements: Vec<Placement> = Vec::with_capacity(stops.len());
        for stop in stops {
            let placement = match stop {
                Stop::Pass(number, i) => passes[number].placements[i],
                Stop::Bridge(at) => Placement {
                    at,
                    feasible: true,
                    contact: placements.last().unwrap_or(&pass.placements[0]).contact,
                },
                Stop::Break => continue,
            };
            placements.push(placement);
        }
        unwrap_headings(&mut placements, period_rad);
        LayerPass {
            placements,
            closed: gap.is_none(),
            then: pass.then.clone(),
            ..*pass
        }
    }
}

//! Ranges of headings, and which of several each leg takes.
//!
//! In: for each leg the ranges that lay its bead, relative to any period of the nozzle. Out: one range a leg, its
//! angle counted on, so that the sum of turning from range to range is least (shortest path).

/// A range of headings, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    pub low_rad: f64,
    pub high_rad: f64,
}

impl Range {
    pub fn new(low_rad: f64, high_rad: f64) -> Range {
        Range { low_rad, high_rad }
    }

    pub fn middle_rad(&self) -> f64 {
        0.5 * (self.low_rad + self.high_rad)
    }

    pub fn shifted(&self, by_rad: f64) -> Range {
        Range::new(self.low_rad + by_rad, self.high_rad + by_rad)
    }

    /// What holds both.
    pub fn hull(&self, other: &Range) -> Range {
        Range::new(
            self.low_rad.min(other.low_rad),
            self.high_rad.max(other.high_rad),
        )
    }

    /// How far the ranges overlap, rad; negative, how far they are apart.
    pub fn overlap_rad(&self, other: &Range) -> f64 {
        self.high_rad.min(other.high_rad) - self.low_rad.max(other.low_rad)
    }
}

/// Headings of a leg: anywhere on it, and beside its corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    pub far: Range,
    pub near: Range,
}

impl Choice {
    fn shifted(&self, by_rad: f64) -> Choice {
        Choice {
            far: self.far.shifted(by_rad),
            near: self.near.shifted(by_rad),
        }
    }

    /// The same counted on from an angle.
    pub fn nearest_to(&self, angle_rad: f64, period_rad: f64) -> Choice {
        let turns = ((angle_rad - self.far.middle_rad()) / period_rad).round();
        self.shifted(turns * period_rad)
    }
}

/// What turning between the middles of ranges costs beside turning from range to range.
const MIDDLE_SHARE: f64 = 0.05;

/// The cost of going from one range to another one, in any period.
fn cost(from: &Choice, to: &Choice, period_rad: f64) -> f64 {
    let to = to.nearest_to(from.far.middle_rad(), period_rad);
    let apart_rad = (-from.far.overlap_rad(&to.far)).max(0.0);
    let middles_rad = (from.far.middle_rad() - to.far.middle_rad()).abs();
    apart_rad + MIDDLE_SHARE * middles_rad
}

/// One choice a leg, counted on along the pass from `start_rad`.
pub fn least_turning(
    choices: &[Vec<Choice>],
    start_rad: Option<f64>,
    period_rad: f64,
) -> Vec<Choice> {
    let at_start = |choice: &Choice| {
        start_rad.map_or(0.0, |rad| {
            let at = Range::new(rad, rad);
            cost(&Choice { far: at, near: at }, choice, period_rad)
        })
    };
    let Some(first) = choices.first() else {
        return Vec::new();
    };
    let mut sums: Vec<f64> = first.iter().map(at_start).collect();
    let mut came_from: Vec<Vec<usize>> = vec![vec![0; first.len()]];
    for pair in choices.windows(2) {
        let mut next = Vec::with_capacity(pair[1].len());
        let mut came = Vec::with_capacity(pair[1].len());
        for to in &pair[1] {
            let by = pair[0].iter().zip(&sums).enumerate();
            let by = by.map(|(i, (from, sum))| (i, sum + cost(from, to, period_rad)));
            let least = by.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0));
            came.push(least.0);
            next.push(least.1);
        }
        sums = next;
        came_from.push(came);
    }
    let least = sums.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
    let mut chosen = least.map_or(0, |(i, _)| i);
    let mut picks = vec![chosen; choices.len()];
    for leg in (1..choices.len()).rev() {
        chosen = came_from[leg][chosen];
        picks[leg - 1] = chosen;
    }
    let mut at_rad = start_rad.unwrap_or(first[picks[0]].far.middle_rad());
    let legs = choices.iter().zip(&picks).map(|(of_leg, pick)| {
        let choice = of_leg[*pick].nearest_to(at_rad, period_rad);
        at_rad = choice.far.middle_rad();
        choice
    });
    legs.collect()
}

//! Runs: the parts of a ring of contacts, or of a profile, that can be printed.
//!
//! In: contacts or placements in order, whether they close a ring. Out: runs with their placements,
//! mm and rad, each open or closed. Not covered: parts where no bead fits, which stay uncovered.

use crate::geometry::aperture::Aperture;
use crate::plan::headings::profile::smooth;
use crate::plan::pass::{Contact, Placement};

/// Runs of contacts whose channel is wide enough for a bead.
pub fn printable_runs(contacts: &[Contact], aperture: &Aperture) -> Vec<(Vec<Contact>, bool)> {
    let least_mm = WIDTH_SHARE_MIN * aperture.minor_mm();
    let mut printable: Vec<bool> = contacts.iter().map(|c| c.extent_mm >= least_mm).collect();
    bridge_short(&mut printable, contacts, BRIDGE_SHARE * aperture.major_mm());
    let kept: Vec<(Contact, bool)> = contacts
        .iter()
        .zip(&printable)
        .map(|(c, &p)| {
            let mut c = *c;
            if p {
                c.extent_mm = c.extent_mm.max(least_mm);
            }
            (c, p)
        })
        .collect();
    split_cyclic(&kept, true, |c| c.1)
        .into_iter()
        .map(|(run, closed)| (run.into_iter().map(|c| c.0).collect(), closed))
        .collect()
}

/// Keeps thin stretches no longer than `length_mm` between printable ones: the bead continues past
/// a corner, where the channel is briefly too narrow.
fn bridge_short(printable: &mut [bool], contacts: &[Contact], length_mm: f64) {
    let count = printable.len();
    let Some(first) = printable.iter().position(|&p| p) else {
        return;
    };
    let mut thin: Vec<usize> = Vec::new();
    for step in 1..=count {
        let i = (first + step) % count;
        if !printable[i] {
            thin.push(i);
            continue;
        }
        let stretch_mm: f64 = thin.iter().map(|&n| contacts[n].length_mm).sum();
        let is_short = stretch_mm <= length_mm;
        for n in thin.drain(..) {
            printable[n] = is_short;
        }
    }
}

/// Least half-width of a channel for a bead in it, relative to b.
const WIDTH_SHARE_MIN: f64 = 0.7;

/// Longest thin stretch through which a bead continues, relative to a.
const BRIDGE_SHARE: f64 = 2.5;

/// Splits a profile where no heading fits, and smooths what remains.
pub fn feasible_runs(
    placements: Vec<Placement>,
    closed: bool,
    aperture: &Aperture,
) -> Vec<(Vec<Placement>, bool)> {
    let mut runs = split_cyclic(&placements, closed, |p| p.feasible);
    for (run, closed) in &mut runs {
        unwrap_headings(run, aperture.period_rad());
        smooth(run, *closed, aperture);
    }
    runs
}

/// Removes placements that do not fit from the ends of an open run: a heading that fitted when the run
/// was made may not fit after its width has been redistributed.
pub fn trim_ends(run: &mut Vec<Placement>) {
    let fits = |placement: &Placement| placement.feasible;
    run.truncate(run.iter().rposition(fits).map_or(0, |last| last + 1));
    let first = run.iter().position(fits).unwrap_or(0);
    run.drain(..first);
}

/// Removes whole periods between neighbours: a run cut out of a loop may pass the loop's seam,
/// where the heading of a complete lap is added; joined passes differ by any number.
pub fn unwrap_headings(run: &mut [Placement], period_rad: f64) {
    for i in 1..run.len() {
        let step_rad = run[i].at.heading_rad - run[i - 1].at.heading_rad;
        run[i].at.heading_rad -= (step_rad / period_rad).round() * period_rad;
    }
}

/// Maximal runs of a (cyclic) sequence that satisfy `keep`; a fully kept cycle stays closed.
fn split_cyclic<T: Clone>(
    items: &[T],
    closed: bool,
    keep: impl Fn(&T) -> bool,
) -> Vec<(Vec<T>, bool)> {
    let count = items.len();
    if items.iter().all(&keep) {
        return if count == 0 {
            Vec::new()
        } else {
            vec![(items.to_vec(), closed)]
        };
    }
    let first = if closed {
        items.iter().position(|i| !keep(i)).unwrap_or(0)
    } else {
        0
    };
    let mut runs = Vec::new();
    let mut run: Vec<T> = Vec::new();
    for step in 0..count {
        let item = &items[(first + step) % count];
        if keep(item) {
            run.push(item.clone());
        } else if !run.is_empty() {
            runs.push((std::mem::take(&mut run), false));
        }
    }
    if !run.is_empty() {
        runs.push((run, false));
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::pass::test_passes::run;

    /// Goal: what does not fit goes from the ends alone. Method: a run of eleven, of which the first
    /// two, one inside and the last do not fit; one of which none does.
    #[test]
    fn what_does_not_fit_goes_from_the_ends() {
        let whole = run([0.0, 0.0], [1.0, 0.0]).placements;
        let with = |unfit: &dyn Fn(usize) -> bool| {
            let mut trimmed = whole.clone();
            for (number, placement) in trimmed.iter_mut().enumerate() {
                placement.feasible = !unfit(number);
            }
            trim_ends(&mut trimmed);
            trimmed
        };
        let trimmed = with(&|number| [0, 1, 5, 10].contains(&number));
        let places = |run: &[Placement]| run.iter().map(|p| p.at).collect::<Vec<_>>();
        assert_eq!(places(&trimmed), places(&whole[2..10]));
        assert!(with(&|_| true).is_empty());
    }
}

//! The regions of each kind of layer, some side by side.
//!
//! In: how many regions each kind has, and how one is made. Out: all of them, `[kind][region]`, whatever the number of
//! threads.

use crate::plan::layers::region_plan::RegionPlan;
use crate::plan::progress::{SIDE_BY_SIDE, Stopped};
use rayon::prelude::*;
use std::cmp::Ordering;

/// The regions of all kinds, `counts` of them, the kind in the middle first: those before and after it start from their
/// neighbour towards it. Those of one region of all kinds come together, so that a prism's kinds run side by side.
///
/// # Errors
/// [`Stopped`].
pub fn from_the_middle(
    counts: &[usize],
    make: impl Fn(usize, usize, &[RegionPlan]) -> Result<RegionPlan, Stopped> + Sync,
) -> Result<Vec<Vec<RegionPlan>>, Stopped> {
    let mut made: Vec<Vec<RegionPlan>> = vec![Vec::new(); counts.len()];
    let middle = counts.len() / 2;
    for away in 0..=middle {
        let kinds = [middle.checked_sub(away), Some(middle + away)];
        let mut kinds: Vec<usize> = kinds.into_iter().flatten().collect();
        kinds.retain(|&kind| kind < counts.len());
        kinds.dedup();
        let next_to = |kind: usize| match kind.cmp(&middle) {
            Ordering::Less => made[kind + 1].as_slice(),
            Ordering::Equal => &[],
            Ordering::Greater => made[kind - 1].as_slice(),
        };
        let own: Vec<usize> = kinds.iter().map(|&kind| counts[kind]).collect();
        let found = of_each_kind(&own, |number, region| {
            make(kinds[number], region, next_to(kinds[number]))
        })?;
        for (kind, regions) in kinds.into_iter().zip(found) {
            made[kind] = regions;
        }
    }
    Ok(made)
}

/// The results for each region of each kind, `[kind][region]`, `counts` of them, some in parallel:
/// those of the first regions of all kinds first, so that a prism's kinds run together.
fn of_each_kind<U: Send>(
    counts: &[usize],
    make: impl Fn(usize, usize) -> Result<U, Stopped> + Sync,
) -> Result<Vec<Vec<U>>, Stopped> {
    let most = counts.iter().max().copied().unwrap_or(0);
    let mut made: Vec<Vec<U>> = counts.iter().map(|_| Vec::new()).collect();
    let all: Vec<(usize, usize)> = (0..most)
        .flat_map(|region| (0..counts.len()).map(move |kind| (kind, region)))
        .filter(|&(kind, region)| region < counts[kind])
        .collect();
    for some in all.chunks(SIDE_BY_SIDE) {
        let found = some
            .par_iter()
            .map(|&(kind, region)| Ok((kind, make(kind, region)?)));
        let found: Vec<(usize, U)> = found.collect::<Result<_, Stopped>>()?;
        for (kind, of_region) in found {
            made[kind].push(of_region);
        }
    }
    Ok(made)
}

//! An estimate of how often the edges of rings cross, made before they are evaluated.
//!
//! A drawn outline crosses itself nowhere, or in some places by mistake. A scribble of n long edges
//! crosses itself up to n²/2 times, and finding or repairing all of that takes excessive time and
//! memory. A sample of pairs distinguishes the two at once: an estimate, the same for the same rings,
//! within a tenth where it matters. Not covered: how edges touch (`validity`).

use super::edge_index::Edge;
use super::predicates::orientation;
use std::cmp::Ordering;

/// Pairs of edges sampled.
const SAMPLE: usize = 200_000;
/// Fewer edges than this cannot cross too often.
const EDGES_MIN: usize = 2000;

/// About how many pairs of these edges cross; 0 for few edges.
pub fn crossings_about(edges: &[Edge]) -> f64 {
    let count = edges.len();
    if count < EDGES_MIN {
        return 0.0;
    }
    // Knuth's linear congruential generator (MMIX): the sample is a fixed one.
    let mut state = 1u64;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        &edges[(state >> 33) as usize % count]
    };
    let crossing = (0..SAMPLE).filter(|_| crosses(next(), next())).count();
    let share = crossing as f64 / SAMPLE as f64;
    share * 0.5 * (count as f64).powi(2)
}

/// True where the insides of two edges meet in one point.
pub fn crosses(e: &Edge, f: &Edge) -> bool {
    let apart = |e0: f64, e1: f64, f0: f64, f1: f64| e0.max(e1) < f0.min(f1);
    if apart(e.a.x, e.b.x, f.a.x, f.b.x)
        || apart(f.a.x, f.b.x, e.a.x, e.b.x)
        || apart(e.a.y, e.b.y, f.a.y, f.b.y)
        || apart(f.a.y, f.b.y, e.a.y, e.b.y)
    {
        return false;
    }
    let parted = |by: &Edge, of: &Edge| {
        let sides = [of.a, of.b].map(|p| orientation(by.a, by.b, p));
        sides[0] != sides[1] && !sides.contains(&Ordering::Equal)
    };
    parted(e, f) && parted(f, e)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point2;
    use crate::test_shapes::random_numbers;

    /// Goal: the estimate is right where it matters, and nothing where nothing crosses. Method: random
    /// chords of a square (0.23 of all pairs cross) and a comb of long teeth.
    #[test]
    fn scribbles_are_told_from_combs() {
        let mut random = random_numbers(7);
        let points: Vec<Point2> = (0..4000).map(|_| Point2::new(random(), random())).collect();
        let edges = |points: &[Point2]| -> Vec<Edge> {
            let pairs = points.windows(2);
            pairs.map(|w| Edge { a: w[0], b: w[1] }).collect()
        };
        let scribble = edges(&points);
        let pairs = (0..400).flat_map(|i| (0..i).map(move |j| (i, j)));
        let some: Vec<(usize, usize)> = pairs.collect();
        let crossing = some
            .iter()
            .filter(|(i, j)| crosses(&scribble[*i], &scribble[*j]))
            .count();
        let share = crossing as f64 / some.len() as f64;
        let wanted = share * 0.5 * (scribble.len() as f64).powi(2);
        let found = crossings_about(&scribble);
        assert!((found / wanted - 1.0).abs() < 0.1, "{found} {wanted}");
        let comb: Vec<Point2> = (0..4000)
            .map(|i| Point2::new(f64::from(i) * 1e-3, f64::from(i % 2)))
            .collect();
        assert_eq!(crossings_about(&edges(&comb)), 0.0);
        assert_eq!(crossings_about(&scribble[..EDGES_MIN - 1]), 0.0);
    }
}

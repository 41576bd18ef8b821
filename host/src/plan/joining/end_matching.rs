//! Which ends of passes are joined: as many as possible, at a low cost.
//!
//! The cheapest join comes first (greedy), each end once. If an end remains whose neighbours are
//! all used, joins are exchanged along a short alternating path to another remaining end (C. Berge
//! 1957), the cheapest found: three ends that meet in each of two corners must not leave one
//! unmatched in both.
//!
//! In: pairs of ends and the cost of joining them (mm²). Out: the numbers of the pairs to join. Not
//! covered: the least cost among all maximum matchings; exchanges are of three joins at most.

use std::collections::{BTreeMap, BTreeSet};

/// An end of a pass: its number, and 0 for the start or 1 for the end.
pub type End = (usize, usize);

/// A pair of ends that could be joined, with its cost.
pub type Pair = ([End; 2], f64);

/// Joins given up along one alternating path, at most.
const EXCHANGED_MAX: usize = 3;

/// The numbers of the pairs to join, each end in one at most. Of equal cost the first.
pub fn matched(pairs: &[Pair]) -> Vec<usize> {
    let mut matching = Matching::of(pairs);
    let mut order: Vec<usize> = (0..pairs.len()).collect();
    order.sort_by(|&i, &j| pairs[i].1.total_cmp(&pairs[j].1).then(i.cmp(&j)));
    for number in order {
        if pairs[number].0.iter().all(|end| matching.is_over(end)) {
            matching.join(number);
        }
    }
    for exchanged in 1..=EXCHANGED_MAX {
        let ends: Vec<End> = matching.pairs_of.keys().copied().collect();
        for end in ends {
            if !matching.is_over(&end) {
                continue;
            }
            let mut search = AlternatingPath {
                matching: &matching,
                seen: BTreeSet::from([end]),
                path: Vec::new(),
                best: None,
            };
            search.go_on(end, exchanged, 0.0);
            for number in search.best.map_or(Vec::new(), |best| best.1) {
                matching.exchange(number);
            }
        }
    }
    let mut taken: Vec<usize> = matching.taken.values().copied().collect();
    taken.sort_unstable();
    taken.dedup();
    taken
}

/// Pairs by their ends, and which of them are chosen.
struct Matching<'a> {
    pairs: &'a [Pair],
    pairs_of: BTreeMap<End, Vec<usize>>,
    taken: BTreeMap<End, usize>,
}

impl Matching<'_> {
    fn of(pairs: &[Pair]) -> Matching<'_> {
        let mut pairs_of: BTreeMap<End, Vec<usize>> = BTreeMap::new();
        for (number, (ends, _)) in pairs.iter().enumerate() {
            for &end in ends {
                pairs_of.entry(end).or_default().push(number);
            }
        }
        Matching {
            pairs,
            pairs_of,
            taken: BTreeMap::new(),
        }
    }

    fn is_over(&self, end: &End) -> bool {
        !self.taken.contains_key(end)
    }

    fn join(&mut self, number: usize) {
        for end in self.pairs[number].0 {
            self.taken.insert(end, number);
        }
    }

    /// Chooses a pair, or gives it up. Along a path, pairs are given up before others use their
    /// ends.
    fn exchange(&mut self, number: usize) {
        let ends = self.pairs[number].0;
        if ends.iter().all(|end| self.taken.get(end) == Some(&number)) {
            for end in ends {
                self.taken.remove(&end);
            }
        } else {
            self.join(number);
        }
    }

    fn other(&self, number: usize, end: End) -> End {
        let [a, b] = self.pairs[number].0;
        if a == end { b } else { a }
    }
}

/// The cheapest alternating path from an end that is over to another one.
struct AlternatingPath<'a> {
    matching: &'a Matching<'a>,
    seen: BTreeSet<End>,
    path: Vec<usize>,
    /// Its additional cost, and its pairs: those given up, then those chosen.
    best: Option<(f64, Vec<usize>)>,
}

impl AlternatingPath<'_> {
    /// Tries the pairs of `end`, which is unmatched or was given up, with this many joins left to
    /// give up.
    fn go_on(&mut self, end: End, exchanges: usize, cost: f64) {
        let matching = self.matching;
        for &number in &matching.pairs_of[&end] {
            let met = matching.other(number, end);
            if !self.seen.insert(met) {
                continue;
            }
            let cost = cost + matching.pairs[number].1;
            self.path.push(number);
            match matching.taken.get(&met) {
                None => {
                    if self.best.as_ref().is_none_or(|best| cost < best.0) {
                        self.best = Some((cost, self.in_order()));
                    }
                }
                Some(&joined) if exchanges > 0 => {
                    let freed = matching.other(joined, met);
                    if self.seen.insert(freed) {
                        self.path.push(joined);
                        self.go_on(freed, exchanges - 1, cost - matching.pairs[joined].1);
                        self.path.pop();
                        self.seen.remove(&freed);
                    }
                }
                Some(_) => {}
            }
            self.path.pop();
            self.seen.remove(&met);
        }
    }

    /// Every second pair of the path is given up.
    fn in_order(&self) -> Vec<usize> {
        let given_up = self.path.iter().skip(1).step_by(2);
        given_up
            .chain(self.path.iter().step_by(2))
            .copied()
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Most pairs that can be taken, and the least cost of so many, by trying all sets.
    fn brute_force(pairs: &[Pair]) -> (usize, f64) {
        let mut best = (0, 0.0);
        for set in 0u32..1 << pairs.len() {
            let chosen = (0..pairs.len()).filter(|n| set >> n & 1 == 1);
            let chosen: Vec<usize> = chosen.collect();
            let ends: BTreeSet<End> = chosen.iter().flat_map(|&n| pairs[n].0).collect();
            let cost: f64 = chosen.iter().map(|&n| pairs[n].1).sum();
            let count = chosen.len();
            if ends.len() == 2 * count && (count > best.0 || count == best.0 && cost < best.1) {
                best = (count, cost);
            }
        }
        best
    }

    /// Goal: as many pairs as can be, each end once, at little more than the least cost. Method: 400
    /// random sets of up to 12 pairs among 8 passes, against all subsets.
    #[test]
    fn as_many_ends_as_can_be_are_joined() {
        let mut state = 7u64;
        let mut random = move |below: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
            ((state >> 33) % below) as usize
        };
        let (mut cost_sum, mut least_sum) = (0.0, 0.0);
        for round in 0..400 {
            let count = 1 + random(12);
            let pairs: Vec<Pair> = (0..count)
                .filter_map(|_| {
                    let [a, b] = [0; 2].map(|_| (random(8), random(2)));
                    (a != b).then(|| ([a.min(b), a.max(b)], 0.01 * random(100) as f64))
                })
                .collect();
            let taken = matched(&pairs);
            let ends: BTreeSet<End> = taken.iter().flat_map(|&n| pairs[n].0).collect();
            assert_eq!(ends.len(), 2 * taken.len(), "{round}");
            let (most, least_cost) = brute_force(&pairs);
            assert_eq!(taken.len(), most, "{round}: {pairs:?}");
            cost_sum += taken.iter().map(|&n| pairs[n].1).sum::<f64>();
            least_sum += least_cost;
        }
        assert!(
            cost_sum < 1.1 * least_sum,
            "{cost_sum} against {least_sum} at best"
        );
    }

    /// Goal: of ends in a row the greedy choice of the middle pair leaves both outer ones over;
    /// they are joined all the same. Method: four ends, the middle pair the cheapest.
    #[test]
    fn a_cheap_pair_in_the_middle_is_given_up() {
        let [a, b, c, d] = [(0, 0), (1, 0), (2, 0), (3, 1)];
        let pairs = [([a, b], 0.5), ([b, c], 0.1), ([c, d], 0.6)];
        assert_eq!(matched(&pairs), vec![0, 2]);
        assert_eq!(matched(&pairs[..2]), vec![1]);
    }
}

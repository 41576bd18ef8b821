//! The cheapest choice of links of a graph with a price on every node with an odd number of chosen
//! links.
//!
//! First each link is chosen if that alone is cheaper. This leaves odd nodes; two of them become even
//! when all links along a path between them are flipped. The cheapest set of paths is a matching of
//! the odd nodes (J. Edmonds and E. Johnson, 1973, on T-joins), where an unmatched node pays its
//! price. Costs are integers inside: with sums of floats the order of the links would decide between
//! equals.
//!
//! In: links as pairs of nodes, the cost of choosing each, the price of an odd node (any one unit).
//! Out: for each link whether it is chosen. Not covered: the optimum of components with more than
//! 300 odd nodes, which are matched in parts.

use crate::geometry::union_find::root;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// Steps of one unit of cost.
const STEPS: f64 = (1u64 << 20) as f64;
/// Highest cost of a link, so that sums over ten million of them fit.
const COST_MAX: f64 = 1e5;
/// Most odd nodes that are matched together, since that takes the third power of their number. Larger
/// components are divided where paths are most expensive.
const PART_MAX: usize = 300;
/// Number of nearest odd nodes to which paths are searched from each.
const NEAREST: usize = 24;

/// The links to choose. `links` are pairs of nodes below `count`, `costs` the cost of choosing each
/// (negative for a saving), `odd_cost` the price of each odd node. The sum is minimal if no more than
/// 300 odd nodes are connected and 24 of them are near each other; among equals few links change.
pub fn cheapest_links(count: usize, links: &[[u32; 2]], costs: &[f64], odd_cost: f64) -> Vec<bool> {
    let costs: Vec<i64> = costs.iter().map(|&cost| whole(cost)).collect();
    let mut chosen: Vec<bool> = costs.iter().map(|&cost| cost < 0).collect();
    let mut near = vec![Vec::new(); count];
    for (number, &[p, q]) in links.iter().enumerate() {
        near[p as usize].push(number);
        near[q as usize].push(number);
    }
    let is_odd = |node: usize| near[node].iter().filter(|&&link| chosen[link]).count() % 2 == 1;
    let odd: Vec<usize> = (0..count).filter(|&node| is_odd(node)).collect();
    let chains = chains(links, &near, &chosen, &costs);
    let mut at_node: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (number, chain) in chains.iter().enumerate() {
        for node in chain.ends {
            at_node.entry(node).or_default().push(number);
        }
    }
    let ways = Ways {
        chains,
        at_node,
        odd,
        cost_max: 2 * whole(odd_cost),
    };
    for [from, to] in ways.cheapest_pairs() {
        for link in ways.links_between(from, to) {
            chosen[link] = !chosen[link];
        }
    }
    chosen
}

/// Links between two key nodes, all chosen or none.
struct Chain {
    ends: [usize; 2],
    links: Vec<usize>,
    /// What changing all of them costs.
    cost: i64,
}

impl Chain {
    fn other(&self, node: usize) -> usize {
        self.ends[usize::from(self.ends[0] == node)]
    }
}

/// The chains between key nodes: joints, ends, and nodes where a chosen link meets another one.
/// `near` are the links at each node.
fn chains(links: &[[u32; 2]], near: &[Vec<usize>], chosen: &[bool], costs: &[i64]) -> Vec<Chain> {
    let is_key = |node: usize| match near[node][..] {
        [p, q] => chosen[p] != chosen[q],
        _ => true,
    };
    let mut taken = vec![false; links.len()];
    let mut found = Vec::new();
    for start in (0..near.len()).filter(|&node| is_key(node)) {
        for &first in &near[start] {
            if taken[first] {
                continue;
            }
            let mut chain = Chain {
                ends: [start; 2],
                links: Vec::new(),
                cost: 0,
            };
            let (mut at, mut link) = (start, first);
            // Ends at a key node: no link is followed twice.
            while !std::mem::replace(&mut taken[link], true) {
                chain.links.push(link);
                chain.cost += costs[link].abs();
                let [p, q] = links[link].map(|node| node as usize);
                at = if p == at { q } else { p };
                match near[at][..] {
                    [p, q] if !is_key(at) => link = if p == link { q } else { p },
                    _ => break,
                }
            }
            chain.ends[1] = at;
            found.push(chain);
        }
    }
    found
}

/// The paths between odd nodes.
struct Ways {
    chains: Vec<Chain>,
    /// The chains at each key node.
    at_node: BTreeMap<usize, Vec<usize>>,
    /// The odd nodes, rising.
    odd: Vec<usize>,
    /// A path must cost less: the price of its two odd nodes.
    cost_max: i64,
}

/// Two odd nodes by their numbers among these, and the cost of the path between them.
type Pair = (i64, [usize; 2]);

impl Ways {
    /// The odd nodes to be matched together.
    fn cheapest_pairs(&self) -> Vec<[usize; 2]> {
        let mut pairs: Vec<Pair> = Vec::new();
        for from in 0..self.odd.len() {
            let near = self.search(from, |reached| reached.len() > NEAREST).reached;
            let to = near.into_iter().filter(|&(_, to)| to != from);
            pairs.extend(to.map(|(cost, to)| (cost, [from.min(to), from.max(to)])));
        }
        pairs.sort_unstable();
        pairs.dedup();
        let mut taken = Vec::new();
        for pairs in self.parts(&pairs) {
            taken.extend(self.matched(&pairs));
        }
        taken
    }

    /// The pairs of each part that hangs together, the cheapest joined first as long as it is small
    /// enough.
    fn parts(&self, pairs: &[Pair]) -> Vec<Vec<Pair>> {
        let mut part: Vec<usize> = (0..self.odd.len()).collect();
        let mut sizes = vec![1; part.len()];
        for (_, pair) in pairs {
            let [p, q] = pair.map(|node| root(&mut part, node));
            if p != q && sizes[p] + sizes[q] <= PART_MAX {
                part[p.max(q)] = p.min(q);
                sizes[p.min(q)] = sizes[p] + sizes[q];
            }
        }
        let mut parts: BTreeMap<usize, Vec<Pair>> = BTreeMap::new();
        for pair in pairs {
            let [p, q] = pair.1.map(|node| root(&mut part, node));
            if p == q {
                parts.entry(p).or_default().push(*pair);
            }
        }
        parts.into_values().collect()
    }

    /// The pairs with the largest saving over the cost of their paths, each node in one at most.
    fn matched(&self, pairs: &[Pair]) -> Vec<[usize; 2]> {
        let mut nodes: Vec<usize> = pairs.iter().flat_map(|pair| pair.1).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let count = nodes.len();
        let place = |node: usize| nodes.partition_point(|&n| n < node);
        let mut saved = vec![0i64; count * count];
        for &(cost, pair) in pairs {
            let [p, q] = pair.map(place);
            saved[p * count + q] = self.cost_max - cost;
            saved[q * count + p] = self.cost_max - cost;
        }
        let mates = integer_blossom::max_weight_matching(&saved, count);
        let pairs = pairs.iter().map(|pair| pair.1);
        let is_taken = |&[p, q]: &[usize; 2]| mates[place(p)] == Some(place(q));
        pairs.filter(is_taken).collect()
    }

    /// The links of the cheapest path between two odd nodes.
    fn links_between(&self, from: usize, to: usize) -> Vec<usize> {
        let is_there = |reached: &[(i64, usize)]| reached.last().is_some_and(|last| last.1 == to);
        let best = self.search(from, is_there).best;
        let (mut at, mut links) = (self.odd[to], Vec::new());
        while let Some(&(_, Some(number))) = best.get(&at) {
            let chain: &Chain = &self.chains[number];
            links.extend(&chain.links);
            at = chain.other(at);
        }
        links
    }

    /// The cheapest paths from an odd node (E. Dijkstra, 1959) until `is_enough` accepts the nodes
    /// reached.
    fn search(&self, from: usize, is_enough: impl Fn(&[(i64, usize)]) -> bool) -> Reached {
        let start = self.odd[from];
        let mut search = Reached {
            best: BTreeMap::from([(start, (0, None))]),
            reached: Vec::new(),
        };
        let mut waiting = BinaryHeap::from([Reverse((0, start))]);
        while let Some(Reverse((cost, node))) = waiting.pop() {
            if search.best.get(&node).is_some_and(|best| best.0 < cost) {
                continue;
            }
            if let Ok(number) = self.odd.binary_search(&node) {
                search.reached.push((cost, number));
                if is_enough(&search.reached) {
                    break;
                }
            }
            for &number in self.at_node.get(&node).into_iter().flatten() {
                let (next, cost) = (
                    self.chains[number].other(node),
                    cost + self.chains[number].cost,
                );
                let best = search.best.get(&next);
                if cost < self.cost_max && best.is_none_or(|best| cost < best.0) {
                    search.best.insert(next, (cost, Some(number)));
                    waiting.push(Reverse((cost, next)));
                }
            }
        }
        search
    }
}

/// What a search found.
struct Reached {
    /// For each key node the cost of the path to it and the last chain of it.
    best: BTreeMap<usize, (i64, Option<usize>)>,
    /// The odd nodes by rising cost: cost and number.
    reached: Vec<(i64, usize)>,
}

fn whole(cost: f64) -> i64 {
    (cost.clamp(-COST_MAX, COST_MAX) * STEPS).round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// A graph with what its links cost.
    struct Graph {
        count: usize,
        links: Vec<[u32; 2]>,
        costs: Vec<f64>,
        odd_cost: f64,
    }

    impl Graph {
        fn cheapest(&self) -> Vec<bool> {
            cheapest_links(self.count, &self.links, &self.costs, self.odd_cost)
        }

        fn cost(&self, chosen: &[bool]) -> f64 {
            let mut degrees = vec![0; self.count];
            let mut sum = 0.0;
            for (link, cost) in (self.links.iter().zip(&self.costs))
                .zip(chosen)
                .filter_map(|(link, &chosen)| chosen.then_some(link))
            {
                sum += cost;
                for &node in link {
                    degrees[node as usize] += 1;
                }
            }
            let odd = degrees.iter().filter(|&degree| degree % 2 == 1).count();
            sum + self.odd_cost * odd as f64
        }

        fn least_by_brute_force(&self) -> f64 {
            let count = self.links.len();
            let sets = 0..1u32 << count;
            let chosen = |set: u32| (0..count).map(|n| set >> n & 1 == 1).collect::<Vec<_>>();
            sets.map(|set| self.cost(&chosen(set)))
                .fold(f64::INFINITY, f64::min)
        }
    }

    /// Goal: no choice is cheaper, on trees, loops and meshes. Method: every choice on 600 random graphs
    /// of up to 13 links among up to 9 nodes, costs in halves so that many are equal.
    #[test]
    fn no_choice_costs_less() {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let mut mended = 0;
        for _ in 0..600 {
            let count: usize = random.random_range(2..=9);
            let links = (0..random.random_range(0..=13))
                .map(|_| [0, 1].map(|_| random.random_range(0..count as u32)));
            let links: Vec<[u32; 2]> = links.filter(|[p, q]| p != q).collect();
            let half = |steps: i32| f64::from(steps) / 2.0;
            let graph = Graph {
                count,
                costs: (0..links.len())
                    .map(|_| half(random.random_range(-8..9)))
                    .collect(),
                links,
                odd_cost: half(random.random_range(0..9)),
            };
            let chosen = graph.cheapest();
            assert_eq!(graph.cost(&chosen), graph.least_by_brute_force());
            let alone = graph.costs.iter().map(|&cost| cost < 0.0);
            mended += usize::from(!alone.eq(chosen));
        }
        assert!(mended > 200, "{mended} graphs with ways");
    }

    /// Goal: which numbers the nodes and links have does not matter to the cost. Method: a ladder of 8
    /// rungs, renumbered in 20 ways.
    #[test]
    fn numbers_do_not_matter() {
        let mut random = Pcg64Mcg::seed_from_u64(7);
        let rails = (0..14u32).map(|n| [n, n + 2]);
        let rungs = (0..8u32).map(|n| [2 * n, 2 * n + 1]);
        let links: Vec<[u32; 2]> = rails.chain(rungs).collect();
        let costs: Vec<f64> = (0..links.len())
            .map(|_| random.random_range(-3.0..3.0))
            .collect();
        let graph = Graph {
            count: 16,
            links,
            costs,
            odd_cost: 1.1,
        };
        let least = graph.cost(&graph.cheapest());
        for shift in 0..20 {
            let node = |n: u32| (n * 5 + shift) % 16;
            let turned = Graph {
                count: 16,
                links: graph
                    .links
                    .iter()
                    .rev()
                    .map(|&[p, q]| [node(q), node(p)])
                    .collect(),
                costs: graph.costs.iter().rev().copied().collect(),
                odd_cost: graph.odd_cost,
            };
            let cost = turned.cost(&turned.cheapest());
            assert!(
                (cost - least).abs() < 1e-4,
                "{shift}: {cost} against {least}"
            );
        }
    }

    /// Goal: a lattice larger than any that is planned is done in a moment, though its odd nodes hang
    /// together. Method: a mesh of 100 x 100 joints with random costs; far cheaper than each link by
    /// itself, and no link alone can be changed for less.
    #[test]
    fn a_large_mesh_is_done() {
        let (side, mut random) = (100u32, Pcg64Mcg::seed_from_u64(6));
        let all = || 0..side * side;
        let right = all().filter(|n| (n + 1) % side != 0).map(|n| [n, n + 1]);
        let below = all()
            .filter(|n| n + side < side * side)
            .map(|n| [n, n + side]);
        let links: Vec<[u32; 2]> = right.chain(below).collect();
        let costs: Vec<f64> = (0..links.len())
            .map(|_| random.random_range(-2.0..2.0))
            .collect();
        let graph = Graph {
            count: (side * side) as usize,
            links,
            costs,
            odd_cost: 3.0,
        };
        let mut chosen = graph.cheapest();
        let least = graph.cost(&chosen);
        let alone: Vec<bool> = graph.costs.iter().map(|&cost| cost < 0.0).collect();
        assert!(least < graph.cost(&alone) - 2.0 * side as f64 * side as f64 / 4.0);
        for n in (0..chosen.len()).step_by(211) {
            chosen[n] = !chosen[n];
            assert!(least <= graph.cost(&chosen) + 1e-3, "{n}");
            chosen[n] = !chosen[n];
        }
    }
}

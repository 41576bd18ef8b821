//! The cheapest labelling of a graph with two labels, exactly.
//!
//! Each node has a cost for either label, each link one for the two labels at its ends, where the
//! same label at both never costs more together than different ones do. Nodes of two neighbours at
//! most go first, each into the costs of these; what is left, joints of three neighbours and more, is
//! a minimum cut (V. Kolmogorov and R. Zabih, 2004, for costs of this kind; the cut itself by Dinitz).
//! Costs are whole numbers inside: sums of floats would let the order of the nodes choose among equals.

use petgraph::algo::dinics;
use petgraph::graph::{DiGraph, NodeIndex};
use std::collections::{BTreeMap, VecDeque};

/// Steps of one unit of cost.
const STEPS: f64 = (1u64 << 20) as f64;
/// Highest cost of a node or link, so that sums over ten million of them fit.
pub const COST_MAX: f64 = 1e5;

/// Cost of a link for each label of the one node and each of the other.
type Table = [[i64; 2]; 2];

/// A graph whose nodes are to be labelled `false` or `true`.
pub struct TwoLabels {
    /// Cost of either label of each node.
    own: Vec<[i64; 2]>,
    /// For each node its neighbours, and the tables with its own label first.
    links: Vec<BTreeMap<usize, Table>>,
}

/// A node that went into the costs of its neighbours.
struct Gone {
    node: usize,
    own: [i64; 2],
    links: BTreeMap<usize, Table>,
}

impl TwoLabels {
    /// Nodes with these costs, \[`false`, `true`\], each cut to ±[`COST_MAX`]; no links.
    pub fn new(costs: &[[f64; 2]]) -> TwoLabels {
        TwoLabels {
            own: costs.iter().map(|own| own.map(whole)).collect(),
            links: vec![BTreeMap::new(); costs.len()],
        }
    }

    /// Makes different labels of two nodes cost `cost` (not negative) more.
    pub fn link(&mut self, p: usize, q: usize, cost: f64) {
        let cost = whole(cost.max(0.0));
        if p != q {
            self.add(p, q, [[0, cost], [cost, 0]]);
        }
    }

    /// The labels that cost least together. Of equals `false` is preferred.
    pub fn cheapest(mut self) -> Vec<bool> {
        let mut labels = vec![false; self.own.len()];
        // No label is better anywhere, no link asks for it.
        if self.own.iter().all(|own| own[0] <= own[1]) {
            return labels;
        }
        let (gone, left) = self.reduced();
        for (node, label) in left.iter().zip(self.cut(&left)) {
            labels[*node] = label;
        }
        for Gone { node, own, links } in gone.into_iter().rev() {
            let cost = |label: usize| -> i64 {
                let near = links.iter();
                let near = near.map(|(&n, table)| table[label][usize::from(labels[n])]);
                own[label] + near.sum::<i64>()
            };
            labels[node] = cost(1) < cost(0);
        }
        labels
    }

    fn add(&mut self, p: usize, q: usize, table: Table) {
        let turned = [[table[0][0], table[1][0]], [table[0][1], table[1][1]]];
        for (from, to, table) in [(p, q, table), (q, p, turned)] {
            let sum = self.links[from].entry(to).or_default();
            for (sum, add) in sum.iter_mut().flatten().zip(table.iter().flatten()) {
                *sum += add;
            }
        }
    }

    /// Puts nodes of two neighbours at most into the costs of these, one after the other; also those
    /// that are left.
    fn reduced(&mut self) -> (Vec<Gone>, Vec<usize>) {
        let mut waiting: VecDeque<usize> = (0..self.own.len()).collect();
        let mut is_gone = vec![false; self.own.len()];
        let mut gone = Vec::new();
        while let Some(node) = waiting.pop_front() {
            if is_gone[node] || self.links[node].len() > 2 {
                continue;
            }
            is_gone[node] = true;
            let links = std::mem::take(&mut self.links[node]);
            for &near in links.keys() {
                self.links[near].remove(&node);
                waiting.push_back(near);
            }
            let own = self.own[node];
            let least = |s: [i64; 2]| (own[0] + s[0]).min(own[1] + s[1]);
            let mut near = links.iter();
            match (near.next(), near.next()) {
                (Some((&u, to_u)), Some((&v, to_v))) => {
                    let cost = |x: usize, y: usize| {
                        least([to_u[0][x] + to_v[0][y], to_u[1][x] + to_v[1][y]])
                    };
                    self.add(u, v, [[cost(0, 0), cost(0, 1)], [cost(1, 0), cost(1, 1)]]);
                }
                (Some((&u, to_u)), None) => {
                    for x in [0, 1] {
                        self.own[u][x] += least([to_u[0][x], to_u[1][x]]);
                    }
                }
                _ => {}
            }
            gone.push(Gone { node, own, links });
        }
        let left = (0..is_gone.len()).filter(|&node| !is_gone[node]).collect();
        (gone, left)
    }

    /// The labels of the nodes that are left, by a minimum cut.
    fn cut(&self, left: &[usize]) -> Vec<bool> {
        if left.is_empty() {
            return Vec::new();
        }
        let number = |node: usize| NodeIndex::new(left.partition_point(|&n| n < node));
        let mut network: DiGraph<(), u64> = DiGraph::with_capacity(left.len() + 2, 3 * left.len());
        for _ in 0..left.len() + 2 {
            network.add_node(());
        }
        let ends = [NodeIndex::new(left.len()), NodeIndex::new(left.len() + 1)];
        // `true` is the first side of the cut. What it costs more at a node by itself:
        let mut more: Vec<i64> = left
            .iter()
            .map(|&n| self.own[n][1] - self.own[n][0])
            .collect();
        for &node in left {
            for (&near, table) in self.links[node].range(node + 1..) {
                let [[neither, second], [first, both]] = *table;
                more[number(node).index()] += first - neither;
                more[number(near).index()] += both - first;
                let apart = (first + second - neither - both).max(0);
                network.add_edge(number(near), number(node), apart.unsigned_abs());
            }
        }
        for (at, &more) in more.iter().enumerate() {
            let at = NodeIndex::new(at);
            let (from, to) = if more >= 0 {
                (at, ends[1])
            } else {
                (ends[0], at)
            };
            network.add_edge(from, to, more.unsigned_abs());
        }
        let is_true = first_side(&network, ends);
        (0..left.len()).map(|at| is_true[at]).collect()
    }
}

/// The nodes on the first side of the least cut between the two `ends` of which it is the smallest.
fn first_side(network: &DiGraph<(), u64>, ends: [NodeIndex; 2]) -> Vec<bool> {
    let (_, flows) = dinics(network, ends[0], ends[1]);
    let mut onward = vec![Vec::new(); network.node_count()];
    for edge in network.edge_indices() {
        if let (Some((p, q)), Some(&most)) =
            (network.edge_endpoints(edge), network.edge_weight(edge))
        {
            let flow = flows[edge.index()];
            if flow < most {
                onward[p.index()].push(q);
            }
            if flow > 0 {
                onward[q.index()].push(p);
            }
        }
    }
    let mut is_first = vec![false; network.node_count()];
    is_first[ends[0].index()] = true;
    let mut waiting = vec![ends[0]];
    while let Some(at) = waiting.pop() {
        for &next in &onward[at.index()] {
            if !std::mem::replace(&mut is_first[next.index()], true) {
                waiting.push(next);
            }
        }
    }
    is_first
}

fn whole(cost: f64) -> i64 {
    (cost.clamp(-COST_MAX, COST_MAX) * STEPS).round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// A graph with its links: \[p, q\] and what different labels there cost.
    struct Graph {
        costs: Vec<[f64; 2]>,
        links: Vec<([usize; 2], f64)>,
    }

    impl Graph {
        fn cheapest(&self) -> Vec<bool> {
            let mut labels = TwoLabels::new(&self.costs);
            for &([p, q], cost) in &self.links {
                labels.link(p, q, cost);
            }
            labels.cheapest()
        }

        fn cost(&self, labels: &[bool]) -> f64 {
            let own = self.costs.iter().zip(labels);
            let own: f64 = own.map(|(own, &label)| own[usize::from(label)]).sum();
            let apart = self
                .links
                .iter()
                .filter(|([p, q], _)| labels[*p] != labels[*q]);
            own + apart.map(|link| link.1).sum::<f64>()
        }

        fn least_by_brute_force(&self) -> f64 {
            let count = self.costs.len();
            let labels = |set: u32| (0..count).map(|n| set >> n & 1 == 1).collect::<Vec<_>>();
            let all = (0..1u32 << count).map(|set| self.cost(&labels(set)));
            all.fold(f64::INFINITY, f64::min)
        }
    }

    /// Goal: no labelling is cheaper, on trees, loops and meshes. Method: every labelling of 400 random
    /// graphs of up to 12 nodes, costs in halves so that many are equal.
    #[test]
    fn no_labelling_costs_less() {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let mut joined = 0;
        for _ in 0..400 {
            let count: usize = random.random_range(1..=12);
            let halves = |random: &mut Pcg64Mcg| f64::from(random.random_range(0..9u8)) / 2.0;
            let costs = (0..count)
                .map(|_| [0, 1].map(|_| halves(&mut random)))
                .collect();
            let links = (0..random.random_range(0..=3 * count)).map(|_| {
                let ends = [0, 1].map(|_| random.random_range(0..count));
                (ends, halves(&mut random))
            });
            let links = links.filter(|(ends, _)| ends[0] != ends[1]).collect();
            let graph = Graph { costs, links };
            let labels = graph.cheapest();
            assert_eq!(graph.cost(&labels), graph.least_by_brute_force());
            joined += usize::from(graph.links.len() > 2 * count);
        }
        assert!(joined > 50, "{joined} graphs with a core");
    }

    /// Goal: of equals `false`, whatever the order of the nodes. Method: rings of four nodes, cheaper
    /// with either label at either of two sides by the same.
    #[test]
    fn of_equals_false_is_chosen() {
        for turn in 0..4 {
            let mut costs = vec![[0.0, 0.0]; 4];
            costs[turn] = [1.0, 0.0];
            costs[(turn + 2) % 4] = [0.0, 1.0];
            let links = (0..4).map(|n| ([n, (n + 1) % 4], 9.0)).collect();
            assert_eq!(Graph { costs, links }.cheapest(), [false; 4], "{turn}");
        }
    }

    /// Goal: a lattice as large as any that is planned is done in a moment. Method: a mesh of 100 x 100
    /// joints with random costs; cheaper than all alike and than each as it would by itself, and no
    /// node's label alone can be changed for less.
    #[test]
    fn a_large_mesh_is_cut() {
        let (side, mut random) = (100, Pcg64Mcg::seed_from_u64(6));
        let cost = |_| [0, 1].map(|_| f64::from(random.random_range(0..16u8)) / 4.0);
        let costs: Vec<[f64; 2]> = (0..side * side).map(cost).collect();
        let right = (0..side * side).filter(|n| (n + 1) % side != 0);
        let right = right.map(|n| ([n, n + 1], 0.75));
        let below = (0..side * (side - 1)).map(|n| ([n, n + side], 0.75));
        let links = right.chain(below).collect();
        let own: Vec<bool> = costs.iter().map(|own| own[1] < own[0]).collect();
        let graph = Graph { costs, links };
        let mut labels = graph.cheapest();
        let least = graph.cost(&labels);
        for eye in [own, vec![false; side * side], vec![true; side * side]] {
            assert!(least < graph.cost(&eye));
        }
        for n in (0..side * side).step_by(37) {
            labels[n] = !labels[n];
            assert!(least <= graph.cost(&labels));
            labels[n] = !labels[n];
        }
    }
}

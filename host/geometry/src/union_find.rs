//! Union-find: each member has a parent, the representative is its own.
//!
//! Callers choose which representative stays (the lowest number, the largest disk): the order of
//! the groups then does not depend on that of the unions, unlike with union by rank.

/// The representative of `v`, with path halving.
pub fn root(parent: &mut [usize], mut v: usize) -> usize {
    while parent[v] != v {
        parent[v] = parent[parent[v]];
        v = parent[v];
    }
    v
}

//! Sets that are joined: each member knows a parent, the representative is its own.
//!
//! Callers choose which representative stays (the lowest number, the largest disk): groups are then
//! gone through in an order that does not depend on that of the unions, which a set that joins by
//! rank does not offer.

/// The representative of `v`, with path halving.
pub fn root(parent: &mut [usize], mut v: usize) -> usize {
    while parent[v] != v {
        parent[v] = parent[parent[v]];
        v = parent[v];
    }
    v
}

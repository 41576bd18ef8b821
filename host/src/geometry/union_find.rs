//! Sets that are joined: each member knows a parent, the representative is its own.

/// The representative of `v`, with path halving.
pub fn root(parent: &mut [usize], mut v: usize) -> usize {
    while parent[v] != v {
        parent[v] = parent[parent[v]];
        v = parent[v];
    }
    v
}

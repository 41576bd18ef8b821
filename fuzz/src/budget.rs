//! How much work an input may make: a step is an allocation, or 64 bytes of one.

/// Steps for an input.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// Whatever its size.
    pub base: usize,
    /// For each of its bytes.
    pub per_byte: usize,
}

/// Readers alone.
pub const READERS: Budget = Budget {
    base: 1_000_000,
    per_byte: 2_000,
};

/// G-code, planned and packed: `X9` may be a crossing of the whole machine at 1 mm/s, which is the slowest that
/// has a tick of its own.
pub const GCODE: Budget = Budget {
    base: 50_000_000,
    per_byte: 1_000_000,
};

impl Budget {
    /// Steps for so many bytes.
    pub fn of(self, bytes: usize) -> usize {
        self.base + self.per_byte * bytes
    }
}

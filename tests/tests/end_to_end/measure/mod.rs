//! Scans of printed layers: what they tell of the machine, and what is refused.

mod laid_beads;
mod scans;

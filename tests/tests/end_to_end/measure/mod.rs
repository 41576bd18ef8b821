//! Scans of printed layers: what they tell of the machine, and what is refused.

mod scans;

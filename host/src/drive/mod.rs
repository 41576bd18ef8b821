//! Moves finished segments: sender, link, simulator. Never imports `plan`.

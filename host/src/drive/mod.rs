//! Moves finished segments: sender, link, simulator. Never imports `plan`.

pub mod link;
pub mod sender;
pub mod sender_state;

//! joining

pub mod bridge_cost;
pub mod bridge_tour;
pub mod bridges;
pub mod chains;
pub mod end_matching;
pub mod gap_fill;
pub mod links;
pub mod order;
pub mod printed_order;
pub mod seam;

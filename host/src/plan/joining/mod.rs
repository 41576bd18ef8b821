//! Joining: passes in printing order, with as few interruptions of flow as is worthwhile.
//!
//! ```text
//! LayerPass --chains, end_matching--> ends that meet become one pass
//!           --bridges (bridge_cost, bridge_tour)--> loops side by side become one
//!           --order, seam--> in printing order, loops opened --links--> joined where they follow
//!           --gap_fill--> moves into what is still open
//!           --infill_links--> sparse lines joined along the walls
//! ```
//!
//! `printed_order` is this pipeline. All in mm and rad, in the region's own frame. Not covered:
//! travel between passes that stay separate (`route`).

pub mod bridge_cost;
pub mod bridge_tour;
pub mod bridges;
pub mod chains;
pub mod end_matching;
pub mod gap_fill;
pub mod infill_links;
pub mod links;
pub mod order;
pub mod printed_order;
pub mod seam;

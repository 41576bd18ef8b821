//! Figures and pictures of a plan and of its simulation.

//! Frames (under construction).

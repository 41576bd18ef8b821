//! Messages (under construction).

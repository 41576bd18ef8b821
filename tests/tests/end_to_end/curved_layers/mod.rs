//! Parts in curved layers: their stairs, what they lay, what is refused.

mod picture;
mod printed;
mod refused;
mod stairs;
mod upright;
mod whole;

//! Plans on curved ground: what they cover, what is refused, and their figures.

mod covered;
mod joined;
mod patches;
mod refused;
mod shapes;

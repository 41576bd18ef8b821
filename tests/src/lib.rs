//! What the end-to-end tests in `tests/` share: [`rig`] (host, link and firmware on a virtual
//! clock), [`gear`] (the six-axis job that bytes are measured with), [`layer_oracle`] (coverage from the knots alone).

pub mod gear;
pub mod layer_oracle;
pub mod rig;

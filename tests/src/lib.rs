//! What the end-to-end tests in `tests/` share: [`rig`] (host, link and firmware on a virtual
//! clock), [`gear`] (the six-axis job that bytes are measured with).

pub mod gear;
pub mod rig;

//! The example machine files that are built in: what `headway machine new` starts from.
//!
//! Their ranges and limits are honest ones for machines of their kind; their calibration values are to be replaced.

/// A kind of machine with an example file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MachineExample {
    /// A table that tilts and turns.
    Trunnion,
    /// A six-joint arm.
    Arm6,
    /// A head that turns (C) and then tilts (B).
    HeadCb,
    /// A table that tilts (B) and turns (C).
    TableBc,
    /// A head whose nozzle leans by a fixed angle and that turns (C).
    TiltedHead,
    /// A table that turns (C) under X.
    Polar,
}

impl MachineExample {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Trunnion,
        Self::Arm6,
        Self::HeadCb,
        Self::TableBc,
        Self::TiltedHead,
        Self::Polar,
    ];

    /// The machine file.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Trunnion => include_str!("../../machines/trunnion.toml"),
            Self::Arm6 => include_str!("../../machines/arm-small.toml"),
            Self::HeadCb => include_str!("../../machines/head-cb.toml"),
            Self::TableBc => include_str!("../../machines/table-bc.toml"),
            Self::TiltedHead => include_str!("../../machines/tilted-head.toml"),
            Self::Polar => include_str!("../../machines/polar.toml"),
        }
    }
}

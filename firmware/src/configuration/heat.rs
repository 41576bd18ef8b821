//! Settings of the heaters: sensors, limits, heated parts, gains of their regulators.
//!
//! In: numbers of the machine file or a board's own, °C, W, W/K, J/(mm³ K). Out: a checked configuration.
//! Physical constants of the built-in hot end are those that Marlin's model predictive control measured
//! on an E3D V6 with 40 W (`MPC_BLOCK_HEAT_CAPACITY` and its neighbours in `Configuration.h`), its gains
//! those of Klipper's board files (22.2, 1.08, 114 of 255). Not covered: the pin assignment.

use crate::configuration::sensor::Sensor;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most heaters of a board: two hot ends and a bed.
pub const HEATERS_MAX: usize = 3;

/// Control period, s: a tenth of the shortest lag of a heater.
pub const PERIOD_S: f32 = 0.1;

/// Margin of the hottest target below the limit: Marlin's `HOTEND_OVERSHOOT`, five times our
/// largest overshoot, so that regulation never triggers the guard.
pub const TARGET_MARGIN_K: f32 = 15.0;

/// Default of the lowest temperature of a hot end at which melt may move, °C: Klipper's
/// `min_extrude_temp` and Marlin's `EXTRUDE_MINTEMP`, below which no usual filament melts.
pub const EXTRUDE_MIN_C: f32 = 170.0;

fn extrude_min_c() -> f32 {
    EXTRUDE_MIN_C
}

/// The heated part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum HeaterRole {
    /// A nozzle: melts, is cooled by flow and part fan, has a fan of its own.
    HotEnd,
    /// The bed under the part.
    Bed,
}

/// Heat balance of the heated body: P = (T - ambient) (loss + fan loss + flow melt).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plant {
    /// Power at full duty, W.
    pub power_w: f32,
    /// Loss to the air, W/K.
    pub loss_w_k: f32,
    /// What the part fan adds to it at full speed, W/K.
    pub fan_loss_w_k: f32,
    /// Heat carried away by melt, J/(mm³ K).
    pub melt_j_mm3_k: f32,
    /// Measured on this machine: only then can its power be checked.
    pub measured: bool,
}

/// Gains of a regulator, of full duty.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gains {
    /// Proportional, 1/K.
    pub proportional: f32,
    /// Integral, 1/(K s).
    pub integral: f32,
    /// Derivative of the reading, s/K.
    pub derivative: f32,
}

/// One heater with its sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeaterConfiguration {
    /// The part that it heats.
    pub role: HeaterRole,
    /// What its temperature is read with.
    pub sensor: Sensor,
    /// Temperature above which it is switched off until the fault is cleared, °C.
    pub limit_c: f32,
    /// Heat balance.
    pub plant: Plant,
    /// Gains.
    pub gains: Gains,
    /// Of a hot end: the lowest temperature at which melt may move, °C; 0 for other heaters. It is a
    /// section of its own in a record of settings, so that boards that do not know it can read the rest.
    #[serde(skip, default = "extrude_min_c")]
    pub extrude_min_c: f32,
}

/// All heaters of a board.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HeatConfiguration {
    /// Heaters in the order of their numbers.
    pub heaters: Vec<HeaterConfiguration, HEATERS_MAX>,
    /// The hot end's fan has a tachometer.
    pub fan_tells_turns: bool,
}

/// A number of this heater is out of its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeaterRange(pub usize);

impl HeaterConfiguration {
    /// A 40 W hot end with the usual thermistor.
    pub const HOT_END: Self = Self {
        role: HeaterRole::HotEnd,
        sensor: Sensor::GENERIC_3950,
        limit_c: 290.0,
        plant: Plant {
            power_w: 40.0,
            loss_w_k: 0.068,
            fan_loss_w_k: 0.029,
            // 5.6 mJ/K for a mm of 1.75 mm PLA.
            melt_j_mm3_k: 0.00233,
            measured: false,
        },
        gains: Gains {
            proportional: 0.0871,
            integral: 0.00424,
            derivative: 0.447,
        },
        extrude_min_c: EXTRUDE_MIN_C,
    };

    /// A 300 W bed of 300 x 300 mm with the usual thermistor.
    pub const BED: Self = Self {
        role: HeaterRole::Bed,
        sensor: Sensor::GENERIC_3950,
        limit_c: 135.0,
        plant: Plant {
            power_w: 300.0,
            // Both sides, 10 W/(m² K).
            loss_w_k: 1.8,
            fan_loss_w_k: 0.0,
            melt_j_mm3_k: 0.0,
            measured: false,
        },
        gains: Gains {
            proportional: 0.2,
            integral: 0.0012,
            derivative: 1.6,
        },
        extrude_min_c: EXTRUDE_MIN_C,
    };

    /// The highest permitted target, °C.
    pub fn target_max_c(&self) -> f32 {
        self.limit_c - TARGET_MARGIN_K
    }

    /// The lowest temperature at which melt may move through it, °C; `None` if no melt flows
    /// through it.
    pub fn melt_from_c(&self) -> Option<f32> {
        let passes = self.role == HeaterRole::HotEnd && self.extrude_min_c > 0.0;
        passes.then_some(self.extrude_min_c)
    }
}

impl HeatConfiguration {
    /// No heater at all.
    pub const fn none() -> Self {
        Self {
            heaters: Vec::new(),
            fan_tells_turns: false,
        }
    }

    /// A hot end and a bed.
    pub fn standard() -> Self {
        let heaters = [HeaterConfiguration::HOT_END, HeaterConfiguration::BED];
        Self {
            heaters: heaters.into_iter().collect(),
            fan_tells_turns: false,
        }
    }
}

//! Keys of a machine file that a scan would change.
//!
//! In: estimates, the settings that the layer was printed with. Out: keys with their old and new values, where a value
//! is off by more than twice its error. Not covered: the nozzle's offset and zero, which are set at the head; starts and
//! stops, of which a scan tells the sign and not the size.

use super::Measured;
use crate::settings::Settings;
use serde::Serialize;

/// Standard errors from which a value counts as another.
const ERRORS: f64 = 2.0;

/// A key with another value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Change {
    /// Group of the machine file.
    pub group: &'static str,
    /// Key in it.
    pub key: &'static str,
    /// As the layer was printed.
    pub old: f64,
    /// As the scan has it.
    pub new: f64,
}

/// The keys that change.
pub(super) fn changes(measured: &Measured, settings: &Settings) -> Vec<Change> {
    let extruder = &settings.machine.extruder;
    let off = |name: &str, as_asked: f64| {
        let mut estimates = measured.estimates.iter();
        let found = estimates.find(|of| of.name == name)?;
        let is_off = |value: &f64| (value - as_asked).abs() > ERRORS * found.error;
        found.value.filter(is_off)
    };
    let mut changes = Vec::new();
    let mut change = |group, key, old: f64, new: f64, unit: f64| {
        let new = (new / unit).round() * unit;
        // A multiple of the unit, without the rounding of its product.
        let new = (new * 1e6).round() / 1e6;
        if new != old {
            changes.push(Change {
                group,
                key,
                old,
                new,
            });
        }
    };
    if let Some(found) = off("flow_factor", 1.0) {
        let old = settings.flow_factor;
        change("flow", "factor", old, (old / found).clamp(0.01, 10.0), 1e-4);
    }
    let has_curve = !settings.machine.curves.advance.is_empty();
    let old = extruder.pressure_advance_s;
    if let Some(found) = off("lag_s", old).filter(|_| !has_curve) {
        change("extruder", "pressure_advance_s", old, found, 1e-4);
    }
    changes
}

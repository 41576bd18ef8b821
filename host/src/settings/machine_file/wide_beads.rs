//! Keys of wide beads in `[print]` and `[flow]`, read and written; jobs carry what is asked for only.

use super::File;
use super::write::number;
use crate::settings::wide_beads::WideBeads;
use std::fmt::Write;

impl File {
    /// What wide beads ask for.
    pub(super) fn wide_beads(&self, default: &WideBeads) -> WideBeads {
        let (print, flow) = (&self.print, &self.flow);
        let ratio = print.outer_inner_ratio_max;
        WideBeads {
            outer_inner_ratio_max: ratio.unwrap_or(default.outer_inner_ratio_max),
            layer_time_max_s: print.layer_time_max_s.unwrap_or(default.layer_time_max_s),
            pump_start_mm: flow.pump_start_mm.unwrap_or(default.pump_start_mm),
            pump_stop_mm: flow.pump_stop_mm.unwrap_or(default.pump_stop_mm),
            continuous_z: print.continuous_z.unwrap_or(default.continuous_z),
        }
    }
}

/// The keys of `[print]`.
pub(super) fn write_print(text: &mut String, wide: &WideBeads) -> std::fmt::Result {
    write_asked(text, "outer_inner_ratio_max", wide.outer_inner_ratio_max)?;
    write_asked(text, "layer_time_max_s", wide.layer_time_max_s)?;
    if wide.continuous_z {
        writeln!(text, "continuous_z = true")?;
    }
    Ok(())
}

/// The keys of `[flow]`.
pub(super) fn write_flow(text: &mut String, wide: &WideBeads) -> std::fmt::Result {
    write_asked(text, "pump_start_mm", wide.pump_start_mm)?;
    write_asked(text, "pump_stop_mm", wide.pump_stop_mm)
}

/// A number of which 0 asks for nothing.
fn write_asked(text: &mut String, key: &str, value: f64) -> std::fmt::Result {
    if value == 0.0 {
        return Ok(());
    }
    writeln!(text, "{key} = {}", number(value))
}

//! What a file asks of checks that a controller makes of its own, beside the limits of its axes.
//!
//! In: the moves as they were written. Out: the settings with which the controller takes all of them. Sources:
//! Klipper's `check_move` of an extruder, Marlin's `PREVENT_LENGTHY_EXTRUDE`, ends of axes that count on. Leaves out
//! the user's own start and end blocks.

use super::dialect::Dialect;
use super::limits::{AXES, EXTRUDER};

/// Klipper's `nozzle_diameter` where it is left as it comes, mm: moves with less filament than of this length of the
/// largest bead are not checked.
const NOZZLE_MM: f64 = 0.4;
/// Klipper's `max_extrude_only_distance` where none is set, mm.
const EXTRUDE_ONLY_MM: f64 = 50.0;
/// Marlin's `EXTRUDE_MAXLENGTH` where it is left as it comes, mm.
const EXTRUDE_MAXLENGTH_MM: f64 = 200.0;

/// What the moves of a file have at most.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Demands {
    /// Cross-section of a bead as Klipper checks it, mm².
    pub cross_section_mm2: f64,
    /// Filament of a move that goes backwards, or along neither X nor Y, mm.
    pub extrude_only_mm: f64,
    /// Filament of any move, mm.
    pub extrusion_mm: f64,
    /// Places of the heading, degrees.
    pub heading_deg: [f64; 2],
    /// Places of the extruder where they are counted on, mm.
    pub extruder_mm: [f64; 2],
}

impl Demands {
    /// A move by so much of each axis, with a length of X Y Z, filament of a cross-section, and its end's heading.
    pub(super) fn add(&mut self, by: &[f64; AXES], way_mm: f64, filament_mm2: f64, heading: f64) {
        let pushed_mm = by[EXTRUDER];
        self.extrusion_mm = self.extrusion_mm.max(pushed_mm.abs());
        if pushed_mm < 0.0 || (by[0] == 0.0 && by[1] == 0.0) {
            self.extrude_only_mm = self.extrude_only_mm.max(pushed_mm.abs());
        } else {
            let mm2 = pushed_mm * filament_mm2 / way_mm.max(NOZZLE_MM);
            self.cross_section_mm2 = self.cross_section_mm2.max(mm2);
        }
        let grow = |[least, most]: &mut [f64; 2], to: f64| {
            (*least, *most) = (least.min(to), most.max(to));
        };
        grow(&mut self.heading_deg, heading);
    }

    /// Places that the extruder reaches.
    pub(super) fn extruder_at(&mut self, at_mm: f64) {
        let [least, most] = self.extruder_mm;
        self.extruder_mm = [least.min(at_mm), most.max(at_mm)];
    }

    /// The settings of a controller that the file needs, by name with their unit.
    pub fn settings(&self, dialect: Dialect) -> Vec<(&'static str, Vec<f64>)> {
        let up = |value: f64| vec![(100.0 * value).ceil() / 100.0];
        let heading = ("heading_range_deg", self.heading_deg.to_vec());
        match dialect {
            Dialect::Klipper => vec![
                ("max_extrude_cross_section_mm2", up(self.cross_section_mm2)),
                ("max_extrude_only_distance_mm", up(self.extrude_only_mm)),
            ],
            Dialect::RepRapFirmware => vec![heading],
            Dialect::Marlin => vec![("extrude_maxlength_mm", up(self.extrusion_mm)), heading],
            Dialect::LinuxCnc | Dialect::GrblHal => {
                vec![heading, ("extruder_range_mm", self.extruder_mm.to_vec())]
            }
        }
    }

    /// Those that a controller as it comes would refuse the file by, as a sentence.
    pub fn note(&self, dialect: Dialect) -> Option<String> {
        let value = |name: &str| {
            let settings = self.settings(dialect);
            let found = settings.into_iter().find(|(own, _)| own.starts_with(name));
            found.map_or(0.0, |(_, values)| values[0])
        };
        let mut told = Vec::new();
        if dialect == Dialect::Klipper {
            let (area, only) = ("max_extrude_cross_section", "max_extrude_only_distance");
            told.push(format!(
                "{area}: {} (mm², with a nozzle_diameter of {NOZZLE_MM} or more)",
                value(area)
            ));
            if self.extrude_only_mm > EXTRUDE_ONLY_MM {
                told.push(format!("{only}: {} (mm)", value(only)));
            }
        } else if dialect == Dialect::Marlin && self.extrusion_mm > EXTRUDE_MAXLENGTH_MM {
            told.push(format!(
                "EXTRUDE_MAXLENGTH {} (mm)",
                value("extrude_maxlength")
            ));
        }
        let section = match dialect {
            Dialect::Klipper => " in [extruder]",
            _ => "",
        };
        let text = told.join(" and ");
        (!told.is_empty()).then(|| format!("the file needs at least {text}{section}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: each controller's own checks have their values. Method: by hand: 1 mm of filament of 2.405 mm² along 1 mm; a
    /// tiny move, of which Klipper lets 0.4 mm of the largest bead pass; a climb, a push and a retraction.
    #[test]
    fn settings_are_those_that_each_controller_checks() {
        let mut demands = Demands::default();
        let mut add = |[x, z, e]: [f64; 3], heading: f64| {
            let by = [x, 0.0, z, 0.0, 0.0, 0.0, e];
            demands.add(&by, x.hypot(z), 2.405, heading);
        };
        add([1.0, 0.0, 1.0], 350.0);
        add([0.01, 0.0, 0.4], -20.0);
        add([0.0, 1.0, 2.0], 0.0);
        add([0.0, 0.0, 210.0], 0.0);
        add([1.0, 0.0, -60.0], 0.0);
        let of = |dialect| demands.settings(dialect);
        assert_eq!(of(Dialect::Klipper)[0].1, [2.41]);
        assert_eq!(of(Dialect::Klipper)[1].1, [210.0]);
        assert_eq!(of(Dialect::Marlin)[0].1, [210.0]);
        assert_eq!(of(Dialect::RepRapFirmware)[0].1, [-20.0, 350.0]);
        let note = |dialect| demands.note(dialect).unwrap_or_default();
        assert!(note(Dialect::Klipper).contains("max_extrude_only_distance: 210 (mm)"));
        assert!(note(Dialect::Marlin).contains("EXTRUDE_MAXLENGTH 210"));
        assert_eq!(note(Dialect::GrblHal), "");
    }
}

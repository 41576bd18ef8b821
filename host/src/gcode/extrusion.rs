//! How E is meant where no line says it: relative or absolute, mm of filament or mm³.
//!
//! In: what was counted while the file was read as firmwares begin (absolute, mm), and its figure of the used
//! filament. Out: [`Taken`], with the reason. The figure decides where one reading agrees with it and the
//! others do not; without one E is relative where the beads' E do not rise, or where it falls now and then
//! and beads are alike only so. A file that says M82 or M83 before its first E is read as it says.

use super::flavour::{Declared, Used};
use std::f64::consts::PI;

/// A reading agrees with the file's figure within this share; another one is far from it.
const AGREES: f64 = 0.05;
const IS_FAR: f64 = 0.2;
/// Beads of which so many pairs, and at least half of them, have an E that does not rise are relative.
const PAIRS_MIN: usize = 2;
/// Widest bead that relative E may mean, mm² of filament a mm: thirty times the usual. Absolute E of a
/// whole file is more.
const AREA_MAX_MM2: f64 = 5.0;

/// Beads are alike where the logarithm of their cross-section has a deviation below this, and below this share of
/// what the other reading has; so many of them, of which at least this share falls.
const ALIKE: f64 = 0.5;
const ALIKE_SHARE: f64 = 0.5;
const ALIKE_PAIRS_MIN: usize = 4;
const ALIKE_FALLS_MIN: f64 = 0.1;

/// Mean and spread of the beads' E a mm, as logarithms (Welford, 1962).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Spread {
    fn take(&mut self, e: f64, length_mm: f64) {
        if e <= 0.0 || length_mm <= 0.0 {
            return;
        }
        let value = (e / length_mm).ln();
        self.count += 1.0;
        let beside = value - self.mean;
        self.mean += beside / self.count;
        self.squares += beside * (value - self.mean);
    }

    fn deviation(&self) -> f64 {
        (self.squares / self.count.max(1.0)).sqrt()
    }
}

/// What was counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counted {
    /// Words of E before M82 or M83 were given.
    pub unsaid: usize,
    /// Line of the first.
    pub line: usize,
    /// Beads among them with one before, since G92; those whose E does not rise.
    pub pairs: usize,
    /// See `pairs`.
    pub falls: usize,
    /// All that is extruded, retracts taken off, if those words are absolute and if they are relative, as E
    /// has it.
    pub sums: [f64; 2],
    /// Most that a bead of them has a mm of its length, if they are relative.
    pub area_max: f64,
    /// E of the bead before.
    pub before: Option<f64>,
    /// Beads' E a mm of length, if it is absolute and if it is relative.
    pub spreads: [Spread; 2],
}

/// How E is taken.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Taken {
    /// Relative until a line says otherwise.
    pub relative: bool,
    /// In mm³ until a line says otherwise.
    pub volumetric: bool,
    /// What the user should know of it.
    pub note: Option<String>,
}

impl Counted {
    /// Counts one E of a bead of `length_mm`, given before M82 or M83; `risen` is how far it has come.
    pub fn bead(&mut self, e: f64, risen: f64, length_mm: f64) {
        self.spreads[0].take(risen, length_mm);
        self.spreads[1].take(e, length_mm);
        if let Some(before) = self.before.replace(e) {
            self.pairs += 1;
            self.falls += usize::from(e <= before);
        }
        self.area_max = self.area_max.max(e / length_mm.max(1.0));
    }

    fn are_alike(&self) -> bool {
        let [absolute, relative] = self.spreads.map(|spread| spread.deviation());
        let falls = self.falls as f64 >= ALIKE_FALLS_MIN * self.pairs as f64;
        let is_alike = relative < ALIKE && relative < ALIKE_SHARE * absolute;
        self.pairs >= ALIKE_PAIRS_MIN && falls && is_alike && self.area_max < AREA_MAX_MM2
    }

    fn does_not_rise(&self) -> bool {
        self.pairs >= PAIRS_MIN && 2 * self.falls >= self.pairs && self.area_max < AREA_MAX_MM2
    }
}

/// Decides.
pub fn taken(counted: &Counted, declared: &Declared, filament_mm: f64) -> Taken {
    let as_said = Taken {
        relative: declared.e_relative.unwrap_or(false),
        volumetric: declared.volumetric,
        note: None,
    };
    let mut as_said = as_said;
    if declared.volumetric {
        as_said.note = Some("E is taken in mm³, as the file's flavour has it".to_string());
    }
    let asks_relative = counted.unsaid > 0 && declared.e_relative.is_none();
    if let Some(taken) = by_figure(counted, declared, filament_mm, asks_relative) {
        return taken;
    }
    if asks_relative && (counted.does_not_rise() || counted.are_alike()) {
        let why = match counted.does_not_rise() {
            true => "",
            false => " and they are alike only so",
        };
        return Taken {
            relative: true,
            note: Some(format!(
                "no M82 or M83 says how E is meant (line {}): taken as relative, since E does not rise in \
                 {} of {} beads{why}",
                counted.line, counted.falls, counted.pairs
            )),
            ..as_said
        };
    }
    as_said
}

/// By the figure of the used filament: `None` where it decides nothing.
fn by_figure(
    counted: &Counted,
    declared: &Declared,
    filament_mm: f64,
    asks_relative: bool,
) -> Option<Taken> {
    let used = declared.used?;
    let area_mm2 = 0.25 * PI * filament_mm * filament_mm;
    // How far a reading is from the figure, as a share of it.
    let beside = |relative: bool, volumetric: bool| {
        let sum = counted.sums[usize::from(relative)];
        let wanted = match (used, volumetric) {
            (Used::Length(mm), false) => mm,
            (Used::Length(mm), true) => mm * area_mm2,
            (Used::Volume(mm3), false) => mm3 / area_mm2,
            (Used::Volume(mm3), true) => mm3,
        };
        (sum / wanted - 1.0).abs()
    };
    let said = (declared.e_relative.unwrap_or(false), declared.volumetric);
    if beside(said.0, said.1) < IS_FAR {
        return None;
    }
    let relatives: &[bool] = match asks_relative {
        true => &[false, true],
        false => &[said.0],
    };
    let volumetrics: &[bool] = match declared.volumetric {
        true => &[true],
        false => &[false, true],
    };
    let readings = relatives
        .iter()
        .flat_map(|relative| volumetrics.iter().map(move |v| (*relative, *v)));
    let best = readings.min_by(|a, b| beside(a.0, a.1).total_cmp(&beside(b.0, b.1)))?;
    (beside(best.0, best.1) < AGREES).then(|| Taken {
        relative: best.0,
        volumetric: best.1,
        note: Some(format!(
            "E is taken as {} and in {}: so it agrees with the filament that the file says it uses ({})",
            if best.0 { "relative" } else { "absolute" },
            if best.1 { "mm³" } else { "mm" },
            match used {
                Used::Length(mm) => format!("{mm} mm"),
                Used::Volume(mm3) => format!("{mm3} mm³"),
            }
        )),
    })
}

#[cfg(test)]
mod tests {
    //! Goal: evidence decides, and only where it is clear. Method: counts as files make them.
    use super::*;

    fn counted(beads: &[f64]) -> Counted {
        let mut counted = Counted {
            unsaid: beads.len(),
            line: 1,
            sums: [beads[beads.len() - 1], beads.iter().sum()],
            ..Counted::default()
        };
        let mut before = 0.0;
        for e in beads {
            counted.bead(*e, e - before, 10.0);
            before = *e;
        }
        counted
    }

    #[test]
    fn beads_that_are_alike_only_so_are_relative() {
        let none = Declared::default();
        // Lengths that mostly grow: three of ten fall.
        let beads = [0.4, 0.44, 0.48, 0.44, 0.45, 0.48, 0.43, 0.5, 0.51, 0.5];
        let relative = taken(&counted(&beads), &none, 1.75);
        assert!(
            relative
                .note
                .is_some_and(|note| note.contains("3 of 9 beads and they are alike"))
        );
        // A short absolute file with two wipes.
        let wiped = [0.4, 0.8, 1.2, 1.1, 1.5, 1.9, 2.3, 2.2, 2.7];
        assert!(!taken(&counted(&wiped), &none, 1.75).relative);
    }

    #[test]
    fn beads_that_do_not_rise_are_relative() {
        let none = Declared::default();
        assert!(!taken(&counted(&[1.0, 2.0, 3.0]), &none, 1.75).relative);
        // Two beads are no evidence.
        assert!(!taken(&counted(&[1.0, 1.0]), &none, 1.75).relative);
        let relative = taken(&counted(&[0.5, 0.4, 0.5, 0.4]), &none, 1.75);
        assert!(relative.relative && relative.note.is_some_and(|note| note.contains("line 1")));
        // Wipes of an absolute file: far more filament than a bead can have.
        assert!(!taken(&counted(&[900.0, 899.0, 898.0]), &none, 1.75).relative);
    }

    #[test]
    fn the_used_filament_decides() {
        let used = |used| Declared {
            used: Some(used),
            ..Declared::default()
        };
        let beads = counted(&[1.0, 2.0, 4.0]);
        let relative = taken(&beads, &used(Used::Length(7.0)), 1.75);
        assert!(relative.relative && !relative.volumetric);
        let absolute = taken(&beads, &used(Used::Length(4.0)), 1.75);
        assert_eq!(absolute, Taken::default());
        // 4 mm³ of 1.75 mm filament are 1.66 mm.
        let volumetric = taken(&beads, &used(Used::Length(1.66)), 1.75);
        assert!(volumetric.volumetric && !volumetric.relative);
        // A figure that nothing agrees with decides nothing.
        assert_eq!(
            taken(&beads, &used(Used::Length(99.0)), 1.75),
            Taken::default()
        );
    }
}

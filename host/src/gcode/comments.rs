//! What slicers say in comments: widths, heights, layers, kinds, times, the filament.
//!
//! In: comments in order. Out: [`Comments`] (mm, s). PrusaSlicer and OrcaSlicer (and their relatives)
//! write `TYPE:`, `WIDTH:`, `HEIGHT:`, `LAYER_CHANGE` and their settings; CuraEngine `TYPE:`, `LAYER:`,
//! `TIME_ELAPSED:`. Everything else is for people.

use super::Leg;
use std::f64::consts::FRAC_PI_4;

impl Leg {
    /// Width of the bead: as given, or from what it deposits over its length at a height; `None` without either.
    pub fn bead_mm(&self, length_mm: f64, height_mm: f64, slicer: Slicer) -> Option<f64> {
        let of_volume = self.volume_mm3.map(|volume_mm3| {
            let area_mm2 = volume_mm3 / length_mm;
            match slicer {
                // Cura reckons with rectangles, the others with round sides.
                Slicer::Cura => area_mm2 / height_mm,
                _ => area_mm2 / height_mm + height_mm * (1.0 - FRAC_PI_4),
            }
        });
        self.width_mm.or(of_volume)
    }
}

/// Who wrote the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Slicer {
    /// Nobody that says so.
    #[default]
    Plain,
    /// PrusaSlicer, Slic3r, SuperSlicer.
    PrusaSlicer,
    /// OrcaSlicer, Bambu Studio.
    OrcaSlicer,
    /// CuraEngine.
    Cura,
    /// Headway's own export.
    Headway,
    /// Nobody: the middles of beads were drawn.
    Drawing,
}

/// What holds for the moves that follow.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hint {
    /// Width of the bead.
    pub width_mm: Option<f64>,
    /// Height of the bead.
    pub height_mm: Option<f64>,
    /// Layers begun so far.
    pub layers: u32,
    /// Infill or support: nothing that is seen.
    pub is_inside: bool,
    /// Kind of the beads.
    pub kind: BeadKind,
}

/// Kind of a bead, as slicers tell it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BeadKind {
    /// Nothing is told.
    #[default]
    Unknown,
    /// The outermost perimeter.
    OuterWall,
    /// The same, rough on purpose: fuzzy skin.
    FuzzyWall,
    /// Other perimeters and what fills gaps between them.
    Wall,
    /// Perimeters that hang over open space.
    Overhang,
    /// Filled ground.
    Solid,
    /// What smooths filled ground and lays little.
    Ironing,
    /// Infill with room between its lines.
    Sparse,
    /// Over open space.
    Bridge,
    /// Skirt, brim and purging.
    Skirt,
    /// Supports and what they carry the part with.
    Support,
}

/// What was said.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Comments {
    /// Who wrote it.
    pub slicer: Slicer,
    /// What holds now.
    pub hint: Hint,
    /// The slicer's estimate of the printing time.
    pub estimate_s: Option<f64>,
    /// Least time of a layer.
    pub layer_time_min_s: f64,
    /// Outer walls are rough on purpose: fuzzy skin.
    pub is_fuzzy: bool,
    /// Diameter of the filament.
    pub filament_mm: Option<f64>,
    /// Which of both kinds of layer marks counts: the first that comes. Some files have both for each layer.
    pub counts_changes: Option<bool>,
    /// The extruder's letter, where it is not E.
    pub extruder: Option<u8>,
    /// The letters of A, B and C, where they are others.
    pub turns: Option<[u8; 3]>,
}

/// Begins the first line of what Headway writes, behind the semicolon.
pub(super) const OWN_HEADER: &str = "headway extruder=";
/// Plausible beads and heights, mm.
const SIZES_MM: [f64; 2] = [0.001, 100.0];

impl Slicer {
    /// As notes call it.
    pub fn name(self) -> &'static str {
        match self {
            Slicer::Plain => "plain G-code",
            Slicer::PrusaSlicer => "PrusaSlicer",
            Slicer::OrcaSlicer => "OrcaSlicer",
            Slicer::Cura => "Cura",
            Slicer::Headway => "Headway",
            Slicer::Drawing => "the drawing",
        }
    }
}

impl Comments {
    /// Takes one comment.
    pub fn read(&mut self, text: &str) {
        let own = text.strip_prefix(OWN_HEADER);
        if let Some(letters) = own.filter(|_| self.slicer == Slicer::Plain) {
            self.slicer = Slicer::Headway;
            let of = |text: Option<&str>| -> Vec<u8> {
                text.map_or(Vec::new(), |text| {
                    text.bytes().filter(u8::is_ascii_uppercase).collect()
                })
            };
            let (extruder, turns) = letters.split_once(" turns=").unwrap_or((letters, ""));
            self.extruder = of(Some(extruder)).first().copied();
            self.turns = <[u8; 3]>::try_from(of(Some(turns))).ok();
            return;
        }
        self.detect(text);
        let is_change = text == "LAYER_CHANGE" || text == "CHANGE_LAYER";
        if is_change || text.starts_with("LAYER:") {
            let counts_changes = *self.counts_changes.get_or_insert(is_change);
            self.hint.layers += u32::from(counts_changes == is_change);
        }
        // Simplify3D's settings have a comma.
        if let Some(diameters) = text.strip_prefix("filamentDiameters,") {
            let first = diameters.split('|').next().unwrap_or_default();
            self.filament_mm = size(first).or(self.filament_mm);
        }
        let Some((key, value)) = text.split_once([':', '=']) else {
            return;
        };
        let value = value.trim();
        match key.trim() {
            // Those of Headway's own exports are for viewers.
            "TYPE" | "FEATURE" if self.slicer != Slicer::Headway => {
                self.hint.is_inside = is_inside(value);
                self.hint.kind = bead_kind(value);
            }
            "WIDTH" | "LINE_WIDTH" => self.hint.width_mm = size(value),
            "HEIGHT" | "LAYER_HEIGHT" => self.hint.height_mm = whole_um(value),
            "TIME_ELAPSED" => self.estimate_s = value.parse().ok().filter(|s: &f64| s.is_finite()),
            "slowdown_below_layer_time" | "slow_down_layer_time" | "cool_min_layer_time" => {
                let first = value.split(',').next().unwrap_or_default().parse();
                self.layer_time_min_s =
                    first.ok().filter(|s| (0.0..1e4).contains(s)).unwrap_or(0.0);
            }
            "fuzzy_skin" => self.is_fuzzy = !["none", "disabled_fuzzy"].contains(&value),
            // KISSlicer's is the second, ideaMaker's the third.
            "filament_diameter" | "fiber_dia_mm" | "Filament Diameter #1" => {
                let first = value.split(',').next().unwrap_or_default();
                self.filament_mm = size(first).or(self.filament_mm);
            }
            key if key.starts_with("estimated printing time (normal") => {
                self.estimate_s = duration_s(value).or(self.estimate_s);
            }
            // Orca: "model printing time: 1m 2s; total estimated time: 2m 3s".
            "model printing time" => {
                let total = value.rsplit_once(':').map_or(value, |(_, total)| total);
                self.estimate_s = duration_s(total.trim()).or(self.estimate_s);
            }
            _ => {}
        }
    }

    fn detect(&mut self, text: &str) {
        if self.slicer != Slicer::Plain {
            return;
        }
        let marks = [
            ("OrcaSlicer", Slicer::OrcaSlicer),
            ("BambuStudio", Slicer::OrcaSlicer),
            ("PrusaSlicer", Slicer::PrusaSlicer),
            ("SuperSlicer", Slicer::PrusaSlicer),
            ("Slic3r", Slicer::PrusaSlicer),
            ("Cura_SteamEngine", Slicer::Cura),
        ];
        let is_origin = text.contains("enerated")
            || text.contains("Slicer ")
            || text.starts_with("BambuStudio");
        let found = marks
            .iter()
            .find(|(mark, _)| is_origin && text.contains(mark));
        self.slicer = found.map_or(Slicer::Plain, |(_, slicer)| *slicer);
    }
}

/// Whether a kind of bead is of an infill or a support: `Internal infill`, `Top surface`, `SKIN`, `FILL`, `Support
/// material interface`, `Bridge`.
fn is_inside(kind: &str) -> bool {
    let kind = kind.to_lowercase();
    let kinds = ["fill", "skin", "support", "surface", "bridge"];
    kinds.iter().any(|inside| kind.contains(inside))
}

impl BeadKind {
    /// As reports call it.
    pub fn name(self) -> &'static str {
        match self {
            BeadKind::Unknown => "beads of no kind",
            BeadKind::OuterWall | BeadKind::FuzzyWall => "outer walls",
            BeadKind::Wall => "walls",
            BeadKind::Overhang => "overhang walls",
            BeadKind::Solid => "solid infill",
            BeadKind::Ironing => "ironing",
            BeadKind::Sparse => "sparse infill",
            BeadKind::Bridge => "bridges",
            BeadKind::Skirt => "skirt, brim, prime tower",
            BeadKind::Support => "supports",
        }
    }
}

/// Kind of a bead: `External perimeter`, `WALL-OUTER`, `Internal infill`, `Sparse infill`, `FILL`, `Solid infill`,
/// `Top surface`, `SKIN`, `Bridge infill`, `Skirt/Brim`, `Support material`.
fn bead_kind(kind: &str) -> BeadKind {
    let kind = kind.to_lowercase();
    let is_wall = kind.contains("perimeter") || kind.contains("wall");
    if is_wall && (kind.contains("external") || kind.contains("outer")) {
        return BeadKind::OuterWall;
    }
    let kinds = [
        ("support", BeadKind::Support),
        ("bridge", BeadKind::Bridge),
        ("skirt", BeadKind::Skirt),
        ("brim", BeadKind::Skirt),
        ("prime", BeadKind::Skirt),
        ("wipe", BeadKind::Skirt),
        ("gap", BeadKind::Wall),
        ("solid", BeadKind::Solid),
        ("top", BeadKind::Solid),
        ("bottom", BeadKind::Solid),
        ("skin", BeadKind::Solid),
        ("ironing", BeadKind::Ironing),
        ("overhang", BeadKind::Overhang),
        ("perimeter", BeadKind::Wall),
        ("wall", BeadKind::Wall),
        ("fill", BeadKind::Sparse),
    ];
    let found = kinds.iter().find(|(word, _)| kind.contains(word));
    found.map_or(BeadKind::Unknown, |(_, kind)| *kind)
}

fn size(text: &str) -> Option<f64> {
    let value: f64 = text.trim().parse().ok()?;
    (SIZES_MM[0]..=SIZES_MM[1])
        .contains(&value)
        .then_some(value)
}

/// A height: differences of rounded numbers (`0.199999`) are whole micrometres.
fn whole_um(text: &str) -> Option<f64> {
    size(text).map(|mm| (mm * 1e3).round() / 1e3)
}

/// `1d 2h 3m 4s`.
fn duration_s(text: &str) -> Option<f64> {
    let mut seconds = 0.0;
    let mut found = false;
    for part in text.split_whitespace() {
        let unit = match part.chars().last() {
            Some('d') => 86_400.0,
            Some('h') => 3600.0,
            Some('m') => 60.0,
            Some('s') => 1.0,
            _ => break,
        };
        let number: f64 = part[..part.len() - 1].parse().ok()?;
        seconds += number * unit;
        found = true;
    }
    (found && f64::is_finite(seconds)).then_some(seconds)
}

#[cfg(test)]
mod tests {
    //! Goal: what the three slicers write is understood. Method: comments as they stand in files.
    use super::*;

    fn after(texts: &[&str]) -> Comments {
        let mut comments = Comments::default();
        texts.iter().for_each(|text| comments.read(text));
        comments
    }

    #[test]
    fn comments_of_the_slicers() {
        let prusa = after(&[
            "generated by PrusaSlicer 2.5.0 on 2026-11-20",
            "LAYER_CHANGE",
            "HEIGHT:0.2",
            "TYPE:Perimeter",
            "WIDTH:0.457521",
            "estimated printing time (normal mode) = 1h 2m 3s",
            "filament_diameter = 1.75,1.75",
        ]);
        assert_eq!(prusa.slicer, Slicer::PrusaSlicer);
        assert_eq!(prusa.hint.width_mm, Some(0.457521));
        assert_eq!((prusa.hint.height_mm, prusa.hint.layers), (Some(0.2), 1));
        assert_eq!(prusa.estimate_s, Some(3723.0));
        assert_eq!(prusa.filament_mm, Some(1.75));
        let orca = after(&[
            "generated by OrcaSlicer 2.1.1 on 2026-01-01",
            "CHANGE_LAYER",
            "LINE_WIDTH: 0.42",
            "model printing time: 9m 37s; total estimated time: 15m 42s",
        ]);
        assert_eq!(
            (orca.slicer, orca.hint.width_mm),
            (Slicer::OrcaSlicer, Some(0.42))
        );
        assert_eq!((orca.hint.layers, orca.estimate_s), (1, Some(942.0)));
        let cura = after(&[
            "FLAVOR:Marlin",
            "Generated with Cura_SteamEngine 4.13.0",
            "LAYER:0",
            "TIME_ELAPSED:19.5",
        ]);
        assert_eq!(cura.slicer, Slicer::Cura);
        assert_eq!((cura.hint.layers, cura.estimate_s), (1, Some(19.5)));
        // Who says it first: a slicer's file may quote Headway's header.
        let own = "headway extruder=U turns=ABC";
        let (written, quoted) = (after(&[own]), after(&["Generated by Slic3r 1.3.0", own]));
        assert_eq!(
            (written.slicer, written.extruder),
            (Slicer::Headway, Some(b'U'))
        );
        assert_eq!(
            (quoted.slicer, quoted.extruder),
            (Slicer::PrusaSlicer, None)
        );
        // Both marks of each layer count once, whichever is first.
        let both = ["LAYER_CHANGE", "LAYER:0", "LAYER_CHANGE", "LAYER:1"];
        assert_eq!(after(&both).hint.layers, 2);
        assert_eq!(after(&both[1..]).hint.layers, 2);
        assert_eq!(after(&["HEIGHT:0.199999"]).hint.height_mm, Some(0.2));
        // Pictures and settings in comments are no sizes.
        let odd = after(&["WIDTH:abc", "HEIGHT:1e99", "TIME_ELAPSED:inf"]);
        assert_eq!(odd.hint, Hint::default());
        assert_eq!(odd.estimate_s, None);
    }

    /// Goal: kinds of bead are those that slicers name. Method: the names of PrusaSlicer, Orca and Cura.
    #[test]
    fn kinds_of_bead_have_the_names_of_slicers() {
        let kinds = [
            ("TYPE:External perimeter", BeadKind::OuterWall),
            ("TYPE:WALL-OUTER", BeadKind::OuterWall),
            ("FEATURE: Overhang wall", BeadKind::Overhang),
            ("TYPE:Ironing", BeadKind::Ironing),
            ("FEATURE: Inner wall", BeadKind::Wall),
            ("TYPE:Gap fill", BeadKind::Wall),
            ("TYPE:Solid infill", BeadKind::Solid),
            ("TYPE:Top solid infill", BeadKind::Solid),
            ("FEATURE: Bottom surface", BeadKind::Solid),
            ("TYPE:SKIN", BeadKind::Solid),
            ("TYPE:Internal infill", BeadKind::Sparse),
            ("FEATURE: Sparse infill", BeadKind::Sparse),
            ("TYPE:FILL", BeadKind::Sparse),
            ("TYPE:Bridge infill", BeadKind::Bridge),
            ("TYPE:Skirt/Brim", BeadKind::Skirt),
            ("TYPE:Support material interface", BeadKind::Support),
            ("TYPE:Custom", BeadKind::Unknown),
        ];
        for (comment, kind) in kinds {
            let mut comments = Comments::default();
            comments.read(comment);
            assert_eq!(comments.hint.kind, kind, "{comment}");
        }
    }
}

//! Settings of an object, or of a volume of it, that are followed: walls, density or spacing of the lines, solid layers,
//! speeds by kind, the seam.
//!
//! In: keys and values as PrusaSlicer, OrcaSlicer, Bambu Studio and Cura name them. Out: [`OwnSettings`], and what they make
//! of a job's settings. Leaves out layer heights, which are the whole job's, and speeds in per cent of others.

use super::{Mesh, Point3};
use crate::settings::kinds::{KindSettings, Kinds};
use crate::settings::{Infill, LAYERS_MAX, Seam, SeamPlace, Settings};

/// Most walls, as in machine files.
const WALLS_MAX: f64 = 1000.0;
/// Speeds that are one, mm/s.
const SPEED_MIN_MM_S: f64 = 0.01;
const SPEED_MAX_MM_S: f64 = 1e4;

/// What an object asks for where it differs from the job.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectInfill {
    /// Loops from the outline inwards.
    pub walls: Option<u32>,
    /// Share of the ground inside the walls that the lines cover, per cent.
    pub density_pct: Option<f64>,
    /// From the middle of a line to that of the next.
    pub spacing_mm: Option<f64>,
    /// Solid layers from the bottom up.
    pub bottom_layers: Option<u32>,
    /// Solid layers from the top down.
    pub top_layers: Option<u32>,
}

/// Tip speeds that an object asks for, mm/s, each below the job's own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OwnSpeeds {
    /// Of whatever is not named below.
    pub all: Option<f64>,
    /// Of the outermost loop. Loops are joined in one pass: the slower of these two is that of all loops.
    pub outer_wall: Option<f64>,
    /// Of the other loops.
    pub inner_walls: Option<f64>,
    /// Of solid infill.
    pub solid: Option<f64>,
    /// Of solid infill that is exposed; the slower of these two is that of all solid infill.
    pub top: Option<f64>,
    /// Of sparse infill.
    pub sparse: Option<f64>,
    /// Of lines over open space.
    pub bridge: Option<f64>,
}

/// Where an object's loops begin and end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OwnSeam {
    /// Nearest to where the head is.
    Nearest,
    /// Farthest along the job's direction.
    Aligned,
    /// Farthest along y.
    Rear,
    /// In the sharpest corner.
    Sharpest,
}

/// What an object or a volume of it asks for where it differs from what is around it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OwnSettings {
    /// Walls and lines.
    pub infill: ObjectInfill,
    /// Speeds by kind.
    pub speeds: OwnSpeeds,
    /// The seam, of an object.
    pub seam: Option<OwnSeam>,
}

/// A volume of an object: one of several that are material, a modifier, or a range of heights.
#[derive(Clone, Debug, PartialEq)]
pub struct Zone {
    /// As the project calls it.
    pub name: Option<String>,
    /// Its boundary, closed, mm.
    pub mesh: Mesh,
    /// What it asks for.
    pub own: OwnSettings,
    /// Material: what volumes before it ask for ends where it begins.
    pub is_part: bool,
}

/// An object of a project, with settings of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct PartObject {
    /// As the project calls it.
    pub name: Option<String>,
    /// Least and largest coordinates, mm.
    pub bounds_mm: [Point3; 2],
    /// What it asks for.
    pub own: OwnSettings,
    /// Its volumes with settings of their own: where several are at a place, the last one counts.
    pub zones: Vec<Zone>,
}

impl OwnSpeeds {
    /// Takes a setting; false if it is not one that is followed.
    fn take(&mut self, key: &str, value: &str) -> bool {
        let speed: Option<f64> = value.trim().parse().ok();
        // PrusaSlicer chooses speeds of 0 itself.
        let Some(speed) = speed.filter(|speed| (SPEED_MIN_MM_S..=SPEED_MAX_MM_S).contains(speed))
        else {
            return false;
        };
        let places: &mut [&mut Option<f64>] = match key {
            "speed_print" => &mut [&mut self.all],
            "speed_wall" => &mut [&mut self.outer_wall, &mut self.inner_walls],
            "external_perimeter_speed" | "outer_wall_speed" | "speed_wall_0" => {
                &mut [&mut self.outer_wall]
            }
            "perimeter_speed" | "inner_wall_speed" | "speed_wall_x" => &mut [&mut self.inner_walls],
            "solid_infill_speed" | "internal_solid_infill_speed" | "speed_topbottom" => {
                &mut [&mut self.solid]
            }
            "top_solid_infill_speed" | "top_surface_speed" => &mut [&mut self.top],
            "infill_speed" | "sparse_infill_speed" | "speed_infill" => &mut [&mut self.sparse],
            "bridge_speed" => &mut [&mut self.bridge],
            _ => return false,
        };
        for place in places.iter_mut() {
            **place = Some(speed);
        }
        true
    }

    /// The kinds of the job with these speeds, none above the job's.
    fn over(&self, kinds: &Kinds, most_mm_s: f64) -> Kinds {
        let slower = |one: Option<f64>, other: Option<f64>| match (one, other) {
            (Some(one), Some(other)) => Some(one.min(other)),
            (one, other) => one.or(other),
        };
        let asked = |kind: KindSettings, own: Option<f64>| KindSettings {
            speed_mm_s: own
                .or(self.all)
                .map(|own| own.min(most_mm_s))
                .or(kind.speed_mm_s),
            ..kind
        };
        Kinds {
            walls: asked(kinds.walls, slower(self.outer_wall, self.inner_walls)),
            solid: asked(kinds.solid, slower(self.solid, self.top)),
            sparse: asked(kinds.sparse, self.sparse),
            bridge: asked(kinds.bridge, self.bridge),
            ..*kinds
        }
    }
}

impl OwnSeam {
    fn of(key: &str, value: &str) -> Option<OwnSeam> {
        match (key, value) {
            ("seam_position", "nearest") | ("z_seam_type", "shortest") => Some(OwnSeam::Nearest),
            ("seam_position", "aligned") => Some(OwnSeam::Aligned),
            ("seam_position", "rear" | "back") | ("z_seam_type", "back") => Some(OwnSeam::Rear),
            ("z_seam_type", "sharpest_corner") => Some(OwnSeam::Sharpest),
            _ => None,
        }
    }

    fn over(self, seam: Seam) -> Seam {
        let (place, direction_rad) = match self {
            OwnSeam::Nearest => (SeamPlace::Nearest, seam.direction_rad),
            OwnSeam::Aligned => (SeamPlace::Aligned, seam.direction_rad),
            OwnSeam::Rear => (SeamPlace::Aligned, std::f64::consts::FRAC_PI_2),
            OwnSeam::Sharpest => (SeamPlace::Sharpest, seam.direction_rad),
        };
        Seam {
            place,
            direction_rad,
        }
    }
}

impl OwnSettings {
    /// Takes settings; those that are not followed are left.
    pub fn take_all(&mut self, settings: &[(String, String)], is_object: bool) {
        for (key, value) in settings {
            self.take(key, value, is_object);
        }
    }

    /// Takes a setting of an object, or of a volume; false if it is not one that is followed.
    fn take(&mut self, key: &str, value: &str, is_object: bool) -> bool {
        if let Some(seam) = OwnSeam::of(key, value).filter(|_| is_object) {
            self.seam = Some(seam);
            return true;
        }
        self.infill.take(key, value) || self.speeds.take(key, value)
    }

    /// True if a setting of an object, or of a volume, is followed.
    pub fn follows(key: &str, value: &str, is_object: bool) -> bool {
        OwnSettings::default().take(key, value, is_object)
    }

    /// True if it asks for nothing.
    pub fn is_empty(&self) -> bool {
        *self == OwnSettings::default()
    }

    /// The settings of an object in a job with these; `None` if it asks for lines or solid layers, and there are no walls.
    pub fn over(&self, settings: &Settings) -> Option<Settings> {
        let mut own = settings.clone();
        if !self.infill.is_empty() {
            let widest_mm = 2.0 * settings.aperture.major_mm();
            own.infill = Some(self.infill.over(settings.infill, widest_mm)?);
        }
        own.kinds = self.speeds.over(&settings.kinds, settings.speed_mm_s);
        own.seam = self
            .seam
            .map_or(settings.seam, |seam| seam.over(settings.seam));
        Some(own)
    }

    /// What of it has to do with what is inside the loops.
    pub fn of_lines(&self) -> OwnSettings {
        OwnSettings {
            infill: ObjectInfill {
                walls: None,
                ..self.infill
            },
            ..OwnSettings::default()
        }
    }

    /// What of it has to do with loops: how many there are and how fast.
    pub fn of_walls(&self) -> OwnSettings {
        OwnSettings {
            infill: ObjectInfill {
                walls: self.infill.walls,
                ..ObjectInfill::default()
            },
            ..*self
        }
    }
}

impl ObjectInfill {
    /// Takes a setting; false if it is not one that is followed.
    fn take(&mut self, key: &str, value: &str) -> bool {
        let number: Option<f64> = value.trim().trim_end_matches('%').trim_end().parse().ok();
        let within = |low: f64, high: f64| number.filter(|n| (low..=high).contains(n));
        let count = |low: f64, high: f64| {
            let whole = within(low, high).filter(|n| n.fract() == 0.0);
            whole.map(|n| n as u32)
        };
        let layers = || count(0.0, f64::from(LAYERS_MAX));
        match key {
            "perimeters" | "wall_loops" | "wall_line_count" => {
                self.walls = count(1.0, WALLS_MAX).or(self.walls);
                count(1.0, WALLS_MAX).is_some()
            }
            "fill_density" | "sparse_infill_density" | "infill_sparse_density" => {
                self.density_pct = within(0.0, 100.0).or(self.density_pct);
                within(0.0, 100.0).is_some()
            }
            "infill_line_distance" => {
                let spacing_mm = number.filter(|mm| mm.is_finite() && *mm > 0.0);
                self.spacing_mm = spacing_mm.or(self.spacing_mm);
                spacing_mm.is_some()
            }
            "bottom_solid_layers" | "bottom_shell_layers" | "bottom_layers" => {
                self.bottom_layers = layers().or(self.bottom_layers);
                layers().is_some()
            }
            "top_solid_layers" | "top_shell_layers" | "top_layers" => {
                self.top_layers = layers().or(self.top_layers);
                layers().is_some()
            }
            _ => false,
        }
    }

    /// True if it asks for nothing.
    fn is_empty(&self) -> bool {
        *self == ObjectInfill::default()
    }

    /// The infill of the object in a job with this one and beads of this width; `None` if neither has walls.
    fn over(&self, infill: Option<Infill>, widest_mm: f64) -> Option<Infill> {
        let mut infill = infill.or_else(|| self.walls.map(Infill::solid))?;
        infill.walls = self.walls.unwrap_or(infill.walls);
        let spaced_pct = self
            .spacing_mm
            .map(|mm| (100.0 * widest_mm / mm).min(100.0));
        if let Some(density_pct) = spaced_pct.or(self.density_pct) {
            infill.density_pct = density_pct;
            infill.spacing_mm = None;
        }
        infill.bottom_layers = self.bottom_layers.or(infill.bottom_layers);
        infill.top_layers = self.top_layers.or(infill.top_layers);
        Some(infill)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: keys of each slicer say the same, and what is no possible value is not followed. Method: the keys of three
    /// slicers; values out of range.
    #[test]
    fn keys_of_all_slicers_are_followed() {
        let files = [
            [
                ("perimeters", "3"),
                ("fill_density", "40%"),
                ("bottom_solid_layers", "2"),
                ("top_solid_layers", "0"),
            ],
            [
                ("wall_loops", "3"),
                ("sparse_infill_density", "40%"),
                ("bottom_shell_layers", "2"),
                ("top_shell_layers", "0"),
            ],
            [
                ("wall_line_count", "3"),
                ("infill_sparse_density", "40.0"),
                ("bottom_layers", "2"),
                ("top_layers", "0"),
            ],
        ];
        for file in files {
            let mut own = ObjectInfill::default();
            for (key, value) in file {
                assert!(own.take(key, value), "{key}");
            }
            let infill = own.over(None, 1.2).expect("walls");
            assert_eq!((infill.walls, infill.density_pct), (3, 40.0));
            assert_eq!(
                (infill.bottom_layers, infill.top_layers),
                (Some(2), Some(0))
            );
        }
        for (key, value) in [
            ("perimeters", "0"),
            ("perimeters", "2.5"),
            ("fill_density", "140%"),
            ("top_layers", "many"),
            ("seam_position", "random"),
            ("external_perimeter_speed", "50%"),
            ("bridge_speed", "0"),
            ("fill_pattern", "gyroid"),
        ] {
            assert!(!OwnSettings::follows(key, value, true), "{key}");
        }
        assert!(OwnSettings::follows("seam_position", "rear", true));
        assert!(!OwnSettings::follows("seam_position", "rear", false));
        let mut spaced = ObjectInfill::default();
        assert!(spaced.take("infill_line_distance", "6"));
        assert_eq!(spaced.over(None, 1.2), None);
        let density_pct = spaced
            .over(Some(Infill::solid(2)), 1.2)
            .map(|own| own.density_pct);
        assert_eq!(density_pct, Some(20.0));
    }

    /// Goal: speeds of each slicer hold for the same kinds, none above the job's, and seams are where they are asked for.
    /// Method: the keys of three slicers; speeds of the four kinds by hand.
    #[test]
    fn speeds_and_seams_of_all_slicers_are_followed() {
        let files: [&[(&str, &str)]; 3] = [
            &[
                ("perimeter_speed", "30"),
                ("external_perimeter_speed", "20"),
                ("solid_infill_speed", "25"),
                ("infill_speed", "900"),
                ("bridge_speed", "12"),
                ("seam_position", "rear"),
            ],
            &[
                ("inner_wall_speed", "30"),
                ("outer_wall_speed", "20"),
                ("internal_solid_infill_speed", "40"),
                ("top_surface_speed", "25"),
                ("sparse_infill_speed", "900"),
                ("bridge_speed", "12"),
                ("seam_position", "back"),
            ],
            &[
                ("speed_print", "12"),
                ("speed_wall", "30"),
                ("speed_wall_0", "20"),
                ("speed_topbottom", "25"),
                ("speed_infill", "900"),
                ("z_seam_type", "back"),
            ],
        ];
        let mut job = Settings::default();
        job.kinds.walls.flow_factor = Some(0.9);
        job.kinds.skirt.speed_mm_s = Some(7.0);
        for file in files {
            let mut own = OwnSettings::default();
            for (key, value) in file {
                assert!(own.take(key, value, true), "{key}");
            }
            let settings = own.over(&job).expect("no walls needed");
            let kinds = settings.kinds;
            let speeds = [
                kinds.walls,
                kinds.solid,
                kinds.sparse,
                kinds.bridge,
                kinds.skirt,
            ];
            let speeds = speeds.map(|kind| kind.speed_mm_s.unwrap_or(0.0));
            assert_eq!(speeds, [20.0, 25.0, job.speed_mm_s, 12.0, 7.0]);
            assert_eq!(kinds.walls.flow_factor, Some(0.9));
            let seam = Seam {
                place: SeamPlace::Aligned,
                direction_rad: std::f64::consts::FRAC_PI_2,
            };
            assert_eq!(settings.seam, seam);
            assert_eq!(settings.infill, job.infill);
        }
    }
}

//! Settings of an object that are followed: walls, density or spacing of the lines, solid layers.
//!
//! In: keys and values as PrusaSlicer, OrcaSlicer, Bambu Studio and Cura name them. Out: [`ObjectInfill`], and what it makes
//! of a job's infill. Leaves out speeds, layer heights and seams, which are the whole job's.

use super::{Mesh, Point3};
use crate::settings::{Infill, LAYERS_MAX};

/// Most walls, as in machine files.
const WALLS_MAX: f64 = 1000.0;

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

/// An object of a project, with settings of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct PartObject {
    /// As the project calls it.
    pub name: Option<String>,
    /// Least and largest coordinates, mm.
    pub bounds_mm: [Point3; 2],
    /// What it asks for.
    pub infill: ObjectInfill,
}

impl PartObject {
    /// From its name, the corners of its box and what it asks for.
    pub(super) fn of_corners(
        (name, corners, infill): (Option<String>, Vec<Point3>, ObjectInfill),
    ) -> PartObject {
        let corners = Mesh {
            vertices: corners,
            triangles: Vec::new(),
        };
        PartObject {
            name,
            bounds_mm: corners.bounds_mm(),
            infill,
        }
    }
}

impl ObjectInfill {
    /// Takes a setting; false if it is not one that is followed.
    pub fn take(&mut self, key: &str, value: &str) -> bool {
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

    /// True if a setting is followed.
    pub fn follows(key: &str, value: &str) -> bool {
        ObjectInfill::default().take(key, value)
    }

    /// True if it asks for nothing.
    pub fn is_empty(&self) -> bool {
        *self == ObjectInfill::default()
    }

    /// The infill of the object in a job with this one and beads of this width; `None` if neither has walls.
    pub fn over(&self, infill: Option<Infill>, widest_mm: f64) -> Option<Infill> {
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
            ("seam_position", "rear"),
        ] {
            assert!(!ObjectInfill::follows(key, value), "{key}");
        }
        let mut spaced = ObjectInfill::default();
        assert!(spaced.take("infill_line_distance", "6"));
        assert_eq!(spaced.over(None, 1.2), None);
        let density_pct = spaced
            .over(Some(Infill::solid(2)), 1.2)
            .map(|own| own.density_pct);
        assert_eq!(density_pct, Some(20.0));
    }
}

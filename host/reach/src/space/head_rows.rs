//! The head over a cell, as rows of cells along x.

use super::{EPSILON, Part, Rules};
use crate::Vector3;

/// Rows at one height.
pub(super) struct Plane {
    pub(super) dz: i32,
    pub(super) dy_first: i32,
    pub(super) dy_end: i32,
    /// Of the row `dy_first` in `starts`.
    first: usize,
}

/// The cells that the head contains, counted from the cell under the aperture; planes that are near come first.
pub(super) struct HeadRows {
    pub(super) planes: Vec<Plane>,
    starts: Vec<u32>,
    /// First and last cells; a row has one for each section of the profile that it crosses, at most.
    spans: Vec<[i16; 2]>,
}

/// Whether the head along `axis` contains the middle of a cell some way from the one under the aperture.
#[inline]
pub(super) fn meets(rules: &Rules, axis: &Vector3, voxel_mm: f64, away_mm: &Vector3) -> bool {
    let along_mm = away_mm.dot(axis);
    let height_mm = along_mm - 0.5 * voxel_mm;
    height_mm > rules.slack_mm + EPSILON && {
        let from_axis = away_mm.norm_squared() - along_mm * along_mm;
        from_axis <= rules.head.radius_mm(height_mm).powi(2) + EPSILON
    }
}

impl HeadRows {
    pub(super) fn new(part: &Part, axis: &Vector3, rules: &Rules) -> HeadRows {
        let [nx, ny, nz] = part.size.map(|n| n as i32 - 1);
        let mut rows = HeadRows {
            planes: Vec::new(),
            starts: Vec::new(),
            spans: Vec::new(),
        };
        for dz in (0..=nz).flat_map(|z| [z, -z]).skip(1) {
            rows.planes.push(Plane {
                dz,
                dy_first: -ny,
                dy_end: ny + 1,
                first: rows.starts.len(),
            });
            for dy in -ny..=ny {
                rows.starts.push(rows.spans.len() as u32);
                let mut open = None;
                for dx in -nx..=nx + 1 {
                    let away_mm = Vector3::from([dx, dy, dz].map(f64::from)) * part.voxel_mm;
                    if dx <= nx && meets(rules, axis, part.voxel_mm, &away_mm) {
                        open = open.or(Some(dx as i16));
                    } else if let Some(first) = open.take() {
                        rows.spans.push([first, dx as i16 - 1]);
                    }
                }
            }
            rows.starts.push(rows.spans.len() as u32);
            rows.trim();
        }
        rows
    }

    /// Leaves out the empty rows at both ends of the last plane.
    fn trim(&mut self) {
        let Some(mut plane) = self.planes.pop() else {
            return;
        };
        let is_empty = |dy: i32| self.spans(&plane, dy).is_empty();
        let filled = |dy: &i32| !is_empty(*dy);
        let first = (plane.dy_first..plane.dy_end).find(filled);
        let last = (plane.dy_first..plane.dy_end).rfind(filled);
        if let (Some(first), Some(last)) = (first, last) {
            plane.first += (first - plane.dy_first) as usize;
            [plane.dy_first, plane.dy_end] = [first, last + 1];
            self.planes.push(plane);
        }
    }

    #[inline]
    pub(super) fn spans(&self, plane: &Plane, dy: i32) -> &[[i16; 2]] {
        let row = plane.first + (dy - plane.dy_first) as usize;
        &self.spans[self.starts[row] as usize..self.starts[row + 1] as usize]
    }
}

//! Parts of a mesh on one side of planes.
//!
//! In: a [`Mesh`] with shared vertices, and planes across the axes (mm). Out: [`Clipped`], what lies on the kept side of
//! them, triangles cut along the planes, each with the number of the triangle that it was. Vertices on a cut are shared, so
//! that the rims of the parts are sequences of vertices as those of any patch.

use super::patch::{chosen, parts};
use super::{Mesh, Point3};
use crate::text::refusal::Refusal;
use std::collections::BTreeMap;

/// Vertices this close to a plane lie on it, mm: far below the accuracy of any machine, far above rounding.
const ON_PLANE_MM: f64 = 1e-6;

/// A plane across an axis, and the side of it that is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisPlane {
    /// 0 to 2: x, y, z.
    pub axis: usize,
    /// Where it is on that axis.
    pub at_mm: f64,
    /// What lies below it is kept, otherwise what lies above.
    pub keeps_below: bool,
}

impl AxisPlane {
    /// How far a point is on the other side, mm; negative on the side that is kept.
    pub fn beyond_mm(&self, point: &Point3) -> f64 {
        let over_mm = point[self.axis] - self.at_mm;
        if self.keeps_below { over_mm } else { -over_mm }
    }

    /// The same with so much more kept.
    pub fn moved(self, by_mm: f64) -> AxisPlane {
        let by_mm = if self.keeps_below { by_mm } else { -by_mm };
        AxisPlane {
            at_mm: self.at_mm + by_mm,
            ..self
        }
    }
}

/// A part of a mesh.
#[derive(Clone, Debug, Default)]
pub struct Clipped {
    /// Its triangles, over their own vertices.
    pub mesh: Mesh,
    /// For each of them the triangle that it is a part of.
    pub source: Vec<u32>,
}

impl Clipped {
    /// All of a mesh.
    pub fn whole(mesh: &Mesh) -> Clipped {
        Clipped {
            mesh: mesh.clone(),
            source: (0..mesh.triangles.len() as u32).collect(),
        }
    }

    /// What of it lies on the kept side of a plane.
    pub fn clipped(&self, plane: &AxisPlane) -> Clipped {
        let beyond_mm = |vertex: u32| {
            let beyond_mm = plane.beyond_mm(&self.mesh.vertices[vertex as usize]);
            match beyond_mm.abs() < ON_PLANE_MM {
                true => 0.0,
                false => beyond_mm,
            }
        };
        let mut vertices = self.mesh.vertices.clone();
        let mut cut_at = BTreeMap::<[u32; 2], u32>::new();
        let (mut triangles, mut source) = (Vec::new(), Vec::new());
        for (triangle, &of) in self.mesh.triangles.iter().zip(&self.source) {
            let sides = triangle.map(beyond_mm);
            if sides.iter().all(|side| *side >= 0.0) {
                continue;
            }
            let mut corners: Vec<u32> = Vec::with_capacity(4);
            for k in 0..3 {
                let next = (k + 1) % 3;
                if sides[k] <= 0.0 {
                    corners.push(triangle[k]);
                }
                if sides[k] * sides[next] < 0.0 {
                    let [a, b] = [triangle[k], triangle[next]];
                    let corner = *cut_at.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                        // From the same end whichever triangle comes first.
                        let [low, high] = [a.min(b), a.max(b)];
                        let share = beyond_mm(low) / (beyond_mm(low) - beyond_mm(high));
                        let [p, q] = [low, high].map(|v| self.mesh.vertices[v as usize]);
                        vertices.push(p + share * (q - p));
                        vertices.len() as u32 - 1
                    });
                    corners.push(corner);
                }
            }
            for k in 2..corners.len() {
                triangles.push([corners[0], corners[k - 1], corners[k]]);
                source.push(of);
            }
        }
        let all = Mesh {
            vertices,
            triangles,
        };
        Clipped {
            mesh: chosen(&all, |_| true),
            source,
        }
    }

    /// Its connected parts.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn connected(&self) -> Result<Vec<Clipped>, Refusal> {
        let part_of = parts(&self.mesh, |_| false)?;
        let count = part_of.iter().flatten().max().map_or(0, |last| last + 1);
        let own = |part: u32| {
            let is_own = |triangle: usize| part_of[triangle] == Some(part);
            let source = self.source.iter().enumerate();
            let source = source.filter(|(triangle, _)| is_own(*triangle));
            Clipped {
                mesh: chosen(&self.mesh, is_own),
                source: source.map(|(_, of)| *of).collect(),
            }
        };
        Ok((0..count).map(own).collect())
    }

    /// Length of its edges that lie on a plane, mm.
    pub fn length_on_mm(&self, plane: &AxisPlane) -> f64 {
        let is_on = |vertex: u32| {
            plane.beyond_mm(&self.mesh.vertices[vertex as usize]).abs() < 2.0 * ON_PLANE_MM
        };
        let edges = self
            .mesh
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let on = edges.filter(|[a, b]| is_on(*a) && is_on(*b));
        on.map(|[a, b]| (self.mesh.vertices[b as usize] - self.mesh.vertices[a as usize]).norm())
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::patch::rims;

    /// A sheet of 8 x 8 squares of 1 mm.
    fn sheet() -> Mesh {
        let mut mesh = Mesh::default();
        for k in 0..81 {
            mesh.vertices
                .push(Point3::new(f64::from(k % 9), f64::from(k / 9), 0.0));
        }
        for k in (0..72u32).filter(|k| k % 9 != 8) {
            mesh.triangles.push([k, k + 1, k + 10]);
            mesh.triangles.push([k, k + 10, k + 9]);
        }
        mesh
    }

    fn area_mm2(mesh: &Mesh) -> f64 {
        let areas = (0..mesh.triangles.len()).map(|triangle| {
            let [a, b, c] = mesh.corners(triangle);
            0.5 * (b - a).cross(&(c - a)).norm()
        });
        areas.sum()
    }

    /// Goal: both sides of a plane together are the sheet, each with one rim and its share of the area, wherever the plane
    /// meets vertices. Method: planes between vertices and through them.
    #[test]
    fn both_sides_of_a_plane_are_the_sheet() {
        for at_mm in [2.3, 3.0, 3.0 + 1e-9, 7.999] {
            let below = AxisPlane {
                axis: 0,
                at_mm,
                keeps_below: true,
            };
            let above = AxisPlane {
                keeps_below: false,
                ..below
            };
            let whole = Clipped::whole(&sheet());
            let [low, high] = [below, above].map(|plane| whole.clipped(&plane));
            assert!((area_mm2(&low.mesh) - 8.0 * at_mm).abs() < 1e-5);
            assert!((area_mm2(&low.mesh) + area_mm2(&high.mesh) - 64.0).abs() < 1e-5);
            for part in [low, high] {
                assert_eq!(part.source.len(), part.mesh.triangles.len());
                assert_eq!(rims(&part.mesh).unwrap().len(), 1);
                assert_eq!(part.connected().unwrap().len(), 1);
                assert!((part.length_on_mm(&below) - 8.0).abs() < 1e-9, "{at_mm}");
            }
        }
    }

    /// Goal: what falls apart is counted. Method: a sheet without its middle strip.
    #[test]
    fn parts_that_do_not_touch_are_told_apart() {
        let mesh = sheet();
        let gap = chosen(&mesh, |triangle| !(6..10).contains(&(triangle % 16)));
        let strips = Clipped::whole(&gap).connected().unwrap();
        assert_eq!(strips.len(), 2);
        assert_eq!(
            strips.iter().map(|strip| strip.source.len()).sum::<usize>(),
            96
        );
    }
}

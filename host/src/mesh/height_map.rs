//! A mesh seen from above: the height of its topmost triangle at a point.
//!
//! In: a [`Mesh`], closed or not. Out: heights, mm, and even samples of them. Triangles are found through
//! square buckets in x and y.

use super::Mesh;
use crate::geometry::Point2;
use crate::geometry::polygon::Box2;

/// Buckets for each triangle, about: more are emptier, fewer longer.
const BUCKETS_PER_TRIANGLE: f64 = 0.5;
/// Most buckets along an axis.
const BUCKETS_MAX: f64 = 1024.0;
/// A point this far outside a triangle still counts as on it, as a share of its sides: rounding
/// between two.
const EDGE_SHARE: f64 = 1e-9;

/// A mesh prepared for height queries.
pub struct HeightMap<'a> {
    mesh: &'a Mesh,
    bounds: Box2,
    bucket_mm: f64,
    count: [usize; 2],
    buckets: Vec<Vec<u32>>,
}

impl<'a> HeightMap<'a> {
    /// Sorts the triangles.
    pub fn of(mesh: &'a Mesh) -> HeightMap<'a> {
        let [low, high] = mesh.bounds_mm();
        let bounds = Box2 {
            min: low.xy(),
            max: high.xy(),
        };
        let size = bounds.size();
        let wanted = (BUCKETS_PER_TRIANGLE * mesh.triangles.len() as f64).sqrt();
        let bucket_mm = size.x.max(size.y) / wanted.clamp(1.0, BUCKETS_MAX);
        let count = [size.x, size.y].map(|side| (side / bucket_mm) as usize + 1);
        let mut map = HeightMap {
            mesh,
            bounds,
            bucket_mm,
            count,
            buckets: vec![Vec::new(); count[0] * count[1]],
        };
        for number in 0..mesh.triangles.len() {
            let corners = mesh.corners(number).map(|corner| corner.xy());
            let of = Box2::of(&corners);
            let ([left, bottom], [right, top]) = (map.bucket(of.min), map.bucket(of.max));
            for row in bottom..=top {
                for bucket in &mut map.buckets[row * count[0] + left..=row * count[0] + right] {
                    bucket.push(number as u32);
                }
            }
        }
        map
    }

    fn bucket(&self, p: Point2) -> [usize; 2] {
        let along = (p - self.bounds.min) / self.bucket_mm;
        [0, 1].map(|axis| (along[axis].max(0.0) as usize).min(self.count[axis] - 1))
    }

    /// The box of the mesh from above.
    pub fn bounds(&self) -> Box2 {
        self.bounds
    }

    /// Height of the topmost triangle over a point, mm; `None` if there is none.
    pub fn top_mm(&self, p: Point2) -> Option<f64> {
        if !self.bounds.contains(p) {
            return None;
        }
        let [column, row] = self.bucket(p);
        let triangles = self.buckets[row * self.count[0] + column].iter();
        let heights = triangles.filter_map(|&number| self.height_mm(number as usize, p));
        heights.max_by(f64::total_cmp)
    }

    /// Height of a triangle over a place; `None` if it does not cover the place or is vertical.
    fn height_mm(&self, triangle: usize, p: Point2) -> Option<f64> {
        let [a, b, c] = self.mesh.corners(triangle);
        let (ab, ac, ap) = (b.xy() - a.xy(), c.xy() - a.xy(), p - a.xy());
        let area = ab.perp(&ac);
        let [s, t] = [ap.perp(&ac) / area, ab.perp(&ap) / area];
        let inside = s >= -EDGE_SHARE && t >= -EDGE_SHARE && s + t <= 1.0 + EDGE_SHARE;
        inside.then(|| a.z + s * (b.z - a.z) + t * (c.z - a.z))
    }

    /// Heights on an even grid within a box.
    pub fn samples(&self, within: Box2, step_mm: f64) -> Vec<[f64; 3]> {
        let size = within.size();
        let [columns, rows] =
            [size.x, size.y].map(|side| (side / step_mm).ceil().max(1.0) as usize);
        let places = (0..=rows).flat_map(|row| {
            (0..=columns).map(move |column| {
                let share = [column as f64 / columns as f64, row as f64 / rows as f64];
                Point2::new(
                    within.min.x + share[0] * size.x,
                    within.min.y + share[1] * size.y,
                )
            })
        });
        let on_surface = places.filter_map(|p| Some([p.x, p.y, self.top_mm(p)?]));
        on_surface.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Point3;

    /// Goal: the top is found wherever there is one. Method: a roof of two triangles over a floor.
    #[test]
    fn the_topmost_triangle_counts() {
        let corners = [
            [0.0, 0.0, 0.0],
            [10.0, 0.0, 0.0],
            [0.0, 10.0, 0.0],
            [0.0, 0.0, 5.0],
            [4.0, 0.0, 9.0],
            [0.0, 4.0, 5.0],
        ];
        let mesh = Mesh {
            vertices: corners.map(|[x, y, z]| Point3::new(x, y, z)).to_vec(),
            triangles: vec![[0, 1, 2], [3, 4, 5]],
        };
        let map = HeightMap::of(&mesh);
        assert_eq!(map.top_mm(Point2::new(1.0, 1.0)), Some(6.0));
        assert_eq!(map.top_mm(Point2::new(5.0, 1.0)), Some(0.0));
        assert_eq!(map.top_mm(Point2::new(9.0, 9.0)), None);
        assert_eq!(map.top_mm(Point2::new(-1.0, 1.0)), None);
        let samples = map.samples(map.bounds(), 1.0);
        // The floor's triangle with its diagonal.
        assert_eq!(samples.len(), 66);
    }
}

//! A patch of triangles flattened without shear: the least-squares conformal map of its vertices.
//!
//! In: vertices (mm) and triangles of one connected patch with a rim. Out: a point in the plane for each vertex; the
//! patch keeps its total area. Angles are kept as well as the triangles permit, so that a plan made in the plane has
//! the same angles on the patch, and developable patches are unrolled. Source: Lévy, Petitjean, Ray, Maillot 2002.
//! The map minimises the sum of squares of each triangle's shear, with two distant vertices fixed; the normal
//! equations are ordered by breadth (Cuthill, McKee 1969) and solved within their envelope ([`Envelope`]). Not
//! covered: patches without a rim, and cuts; the caller handles them.

use super::envelope::Envelope;
use super::{Point2, Vector2};
use nalgebra::Vector3;
use std::collections::VecDeque;

/// Area below which a triangle is degenerate, relative to the square of its longest side.
const SLIVER: f64 = 1e-9;

/// Why a patch is not flattened.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FlattenError {
    /// No triangle has an area.
    #[error("the patch has no triangle with an area")]
    Empty,
    /// The patch is not connected.
    #[error("the patch is not connected")]
    NotConnected {
        /// A vertex that the others do not reach.
        vertex: usize,
    },
    /// A triangle is inverted in the plane.
    #[error("the patch folds over itself when it is flattened")]
    FoldsOver {
        /// A vertex of that triangle.
        vertex: usize,
    },
}

/// A triangle in its own plane: corners, and its area.
struct Local {
    corners: [Vector2; 3],
    area_mm2: f64,
}

impl Local {
    /// `None` for a sliver.
    fn of(vertices: &[Vector3<f64>], triangle: [u32; 3]) -> Option<Local> {
        let [a, b, c] = triangle.map(|vertex| vertices[vertex as usize]);
        let (ab, ac) = (b - a, c - a);
        let area_mm2 = 0.5 * ab.cross(&ac).norm();
        let longest = ab.norm_squared().max(ac.norm_squared());
        let longest = longest.max((c - b).norm_squared());
        if area_mm2.is_nan() || area_mm2 <= SLIVER * longest {
            return None;
        }
        let x = ab.norm();
        let corners = [
            Vector2::zeros(),
            Vector2::new(x, 0.0),
            Vector2::new(ac.dot(&ab) / x, 2.0 * area_mm2 / x),
        ];
        Some(Local { corners, area_mm2 })
    }
}

/// Flattens a patch; vertices without a triangle stay at the origin.
///
/// # Errors
/// [`FlattenError`].
pub fn flattened(
    vertices: &[Vector3<f64>],
    triangles: &[[u32; 3]],
) -> Result<Vec<Point2>, FlattenError> {
    let locals: Vec<([u32; 3], Local)> = triangles
        .iter()
        .filter_map(|&triangle| Some((triangle, Local::of(vertices, triangle)?)))
        .collect();
    let order = ordered(vertices.len(), locals.iter().map(|(triangle, _)| *triangle))?;
    let pinned = far_pair(vertices, &order.vertices);
    let system = equations(&locals, &order, pinned);
    let solution = system.solved();
    let apart = (vertices[pinned[1]] - vertices[pinned[0]]).norm();
    let mut flat = vec![Point2::origin(); vertices.len()];
    for (&vertex, place) in order.vertices.iter().zip(solution.chunks_exact(2)) {
        flat[vertex] = Point2::new(apart * place[0], apart * place[1]);
    }
    let area = |[a, b, c]: [u32; 3]| {
        let [a, b, c] = [a, b, c].map(|vertex| flat[vertex as usize]);
        0.5 * (b - a).perp(&(c - a))
    };
    let all_mm2: f64 = locals.iter().map(|(_, local)| local.area_mm2).sum();
    let flat_mm2: f64 = locals.iter().map(|(triangle, _)| area(*triangle)).sum();
    if let Some((triangle, _)) = locals.iter().find(|(triangle, _)| area(*triangle) <= 0.0) {
        return Err(FlattenError::FoldsOver {
            vertex: triangle[0] as usize,
        });
    }
    let scale = (all_mm2 / flat_mm2).sqrt();
    flat.iter_mut().for_each(|place| *place *= scale);
    Ok(flat)
}

/// Vertices in the order of the unknowns, and the place of each.
struct Order {
    vertices: Vec<usize>,
    place: Vec<usize>,
}

fn ordered(count: usize, triangles: impl Iterator<Item = [u32; 3]>) -> Result<Order, FlattenError> {
    let mut beside: Vec<Vec<usize>> = vec![Vec::new(); count];
    for [a, b, c] in triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            beside[from as usize].push(to as usize);
            beside[to as usize].push(from as usize);
        }
    }
    for own in &mut beside {
        own.sort_unstable();
        own.dedup();
    }
    let used = (0..count).filter(|&vertex| !beside[vertex].is_empty());
    let first = used.clone().next().ok_or(FlattenError::Empty)?;
    // From a vertex at one end the fronts stay short.
    let end = *by_breadth(&beside, first).last().unwrap_or(&first);
    let vertices = by_breadth(&beside, end);
    let mut place = vec![usize::MAX; count];
    for (number, &vertex) in vertices.iter().enumerate() {
        place[vertex] = number;
    }
    match used.clone().find(|&vertex| place[vertex] == usize::MAX) {
        Some(vertex) => Err(FlattenError::NotConnected { vertex }),
        None => Ok(Order { vertices, place }),
    }
}

fn by_breadth(beside: &[Vec<usize>], from: usize) -> Vec<usize> {
    let mut is_met = vec![false; beside.len()];
    is_met[from] = true;
    let (mut waiting, mut found) = (VecDeque::from([from]), Vec::new());
    while let Some(vertex) = waiting.pop_front() {
        found.push(vertex);
        let mut next = beside[vertex].clone();
        next.retain(|&other| !is_met[other]);
        next.sort_by_key(|&other| (beside[other].len(), other));
        for other in next {
            is_met[other] = true;
            waiting.push_back(other);
        }
    }
    found
}

/// Two vertices far from each other.
fn far_pair(vertices: &[Vector3<f64>], used: &[usize]) -> [usize; 2] {
    let farthest = |from: usize| {
        let away = |vertex: usize| (vertices[vertex] - vertices[from]).norm_squared();
        let far = used.iter().copied();
        far.max_by(|&a, &b| away(a).total_cmp(&away(b)))
            .unwrap_or(from)
    };
    let one = farthest(used[0]);
    [one, farthest(one)]
}

/// The normal equations of the map that has the pinned vertices at (0, 0) and (1, 0).
fn equations(locals: &[([u32; 3], Local)], order: &Order, pinned: [usize; 2]) -> Envelope {
    let count = 2 * order.vertices.len();
    let mut first: Vec<usize> = (0..count).collect();
    for (triangle, _) in locals {
        let places = triangle.map(|vertex| 2 * order.place[vertex as usize]);
        let least = places.into_iter().min().unwrap_or(0);
        for place in places {
            for row in [place, place + 1] {
                first[row] = first[row].min(least);
            }
        }
    }
    let mut system = Envelope::new(first);
    for (triangle, local) in locals {
        let places = triangle.map(|vertex| order.place[vertex as usize]);
        add_shear(&mut system, places, local);
    }
    for (vertex, at) in pinned.into_iter().zip([[0.0, 0.0], [1.0, 0.0]]) {
        let row = 2 * order.place[vertex];
        system.hold(row, at[0]);
        system.hold(row + 1, at[1]);
    }
    system
}

/// Adds the square of a triangle's shear: of the sum of (opposite side as a complex number) times (place as
/// a complex number), over the root of twice the area.
fn add_shear(system: &mut Envelope, places: [usize; 3], local: &Local) {
    let weights: [Vector2; 3] = std::array::from_fn(|k| {
        let side = local.corners[(k + 2) % 3] - local.corners[(k + 1) % 3];
        side / (2.0 * local.area_mm2).sqrt()
    });
    for (&place, own) in places.iter().zip(&weights) {
        for (&other, its) in places.iter().zip(&weights) {
            let (same, mixed) = (own.dot(its), own.perp(its));
            system.put(2 * place, 2 * other, same);
            system.put(2 * place + 1, 2 * other + 1, same);
            system.put(2 * place, 2 * other + 1, -mixed);
            system.put(2 * place + 1, 2 * other, mixed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(
        count: [usize; 2],
        place: impl Fn(f64, f64) -> Vector3<f64>,
    ) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
        let [nx, ny] = count;
        let vertices = (0..nx * ny).map(|k| place((k % nx) as f64, (k / nx) as f64));
        let mut triangles = Vec::new();
        for j in 0..ny - 1 {
            for i in 0..nx - 1 {
                let corner = |di: usize, dj: usize| ((j + dj) * nx + i + di) as u32;
                triangles.push([corner(0, 0), corner(1, 0), corner(1, 1)]);
                triangles.push([corner(0, 0), corner(1, 1), corner(0, 1)]);
            }
        }
        (vertices.collect(), triangles)
    }

    /// Goal: what can be unrolled keeps all its lengths. Method: a wall of a cylinder of R 10, bent by 200°, whose
    /// facets are flat strips: distances of far vertices against arc lengths of the facets' chords.
    #[test]
    fn a_wall_of_a_cylinder_unrolls() {
        let step = 200f64.to_radians() / 40.0;
        let (vertices, triangles) = sheet([41, 21], |i, j| {
            let (sin, cos) = (i * step).sin_cos();
            Vector3::new(10.0 * cos, 10.0 * sin, j)
        });
        let flat = flattened(&vertices, &triangles).unwrap();
        let chord = 20.0 * (0.5 * step).sin();
        for (k, [i, j]) in [
            (40, [40.0, 0.0]),
            (20 * 41, [0.0, 20.0]),
            (860, [40.0, 20.0]),
        ] {
            let apart = (flat[k] - flat[0]).norm();
            // The solver's rounding.
            assert!(
                (apart - f64::hypot(i * chord, j)).abs() < 1e-6,
                "{k} {apart}"
            );
        }
    }

    /// Goal: angles are kept and scales range little where nothing can be unrolled. Method: a cap of a sphere to 34°
    /// over a square: each triangle's two scales, of which the ratio is the shear.
    #[test]
    fn a_cap_of_a_sphere_is_hardly_sheared() {
        let (vertices, triangles) = sheet([41, 41], |i, j| {
            let (x, y) = (0.5 * (i - 20.0), 0.5 * (j - 20.0));
            Vector3::new(x, y, (625.0 - x * x - y * y).sqrt())
        });
        let flat = flattened(&vertices, &triangles).unwrap();
        let (mut least, mut most, mut sheared) = (f64::INFINITY, 0.0f64, 1.0f64);
        for triangle in &triangles {
            let local = Local::of(&vertices, *triangle).unwrap();
            let [a, b, c] = triangle.map(|vertex| flat[vertex as usize]);
            let to = nalgebra::Matrix2::from_columns(&[b - a, c - a]);
            let from = nalgebra::Matrix2::from_columns(&[local.corners[1], local.corners[2]]);
            let scales = (to * from.try_inverse().unwrap()).singular_values();
            (least, most) = (least.min(scales[1]), most.max(scales[0]));
            sheared = sheared.max(scales[0] / scales[1]);
        }
        // Triangles of 0.5 mm on R 25 bend by 20 mrad; a conformal map of this cap ranges by 1.07 to 1.11.
        assert!(sheared < 1.02, "{sheared}");
        assert!(most / least < 1.12, "{least} {most}");
    }

    #[test]
    fn what_falls_apart_is_refused() {
        let corners = [
            [0.0, 0.0],
            [1.0, 0.0],
            [0.0, 1.0],
            [5.0, 0.0],
            [6.0, 0.0],
            [5.0, 1.0],
        ];
        let vertices = corners.map(|[x, y]| Vector3::new(x, y, 0.0));
        let refused = flattened(&vertices, &[[0, 1, 2], [3, 4, 5]]);
        assert!(matches!(refused, Err(FlattenError::NotConnected { .. })));
        assert_eq!(flattened(&vertices, &[]), Err(FlattenError::Empty));
    }
}

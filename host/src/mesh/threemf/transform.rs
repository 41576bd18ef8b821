//! Transforms of objects: rows as the format has them, a point is a row in front of the matrix.
//!
//! In: points and triangles of objects, transforms of items and components. Out: the same where they are placed, facing outwards.

use super::model::{Object, Transform};
use crate::mesh::{Mesh, Point3};
use std::collections::HashMap;
use std::ops::Range;

fn moved(p: Point3, m: &Transform) -> Point3 {
    let along = |i: usize| p.x * m[i] + p.y * m[3 + i] + p.z * m[6 + i] + m[9 + i];
    Point3::new(along(0), along(1), along(2))
}

/// First `inner`, then `outer`.
pub(super) fn chained(inner: &Transform, outer: &Transform) -> Transform {
    let mut chained = [0.0; 12];
    for row in 0..4 {
        for column in 0..3 {
            let own = (0..3).map(|k| inner[3 * row + k] * outer[3 * k + column]);
            let shift = if row == 3 { outer[9 + column] } else { 0.0 };
            chained[3 * row + column] = own.sum::<f64>() + shift;
        }
    }
    chained
}

/// True where a transform is a mirror image: outside becomes inside.
fn mirrors(m: &Transform) -> bool {
    let rows = nalgebra::Matrix3::from_row_slice(&m[..9]);
    rows.determinant() < 0.0
}

/// Adds triangles of an object as they are placed.
pub(super) fn append(
    mesh: &mut Mesh,
    object: &Object,
    triangles: Range<usize>,
    transform: &Transform,
) {
    let is_mirrored = mirrors(transform);
    let mut numbers: HashMap<u32, u32> = HashMap::new();
    for triangle in &object.triangles[triangles] {
        let [a, b, c] = triangle.map(|vertex| {
            *numbers.entry(vertex).or_insert_with(|| {
                let p = object.vertices[vertex as usize];
                mesh.vertices.push(moved(p, transform));
                mesh.vertices.len() as u32 - 1
            })
        });
        let triangle = if is_mirrored { [a, c, b] } else { [a, b, c] };
        mesh.triangles.push(triangle);
    }
}

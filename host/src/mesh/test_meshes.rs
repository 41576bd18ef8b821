//! Meshes for tests, made by formula.

use super::{Mesh, Point3};
use std::f64::consts::TAU;

/// A box from its corner and size.
pub(super) fn cuboid([x, y, z]: [f64; 3], [dx, dy, dz]: [f64; 3]) -> Mesh {
    let corner = |i: usize| {
        let of = |axis: usize, low: f64, size: f64| low + (i >> axis & 1) as f64 * size;
        Point3::new(of(0, x, dx), of(1, y, dy), of(2, z, dz))
    };
    let faces: [[u32; 4]; 6] = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    Mesh {
        vertices: (0..8).map(corner).collect(),
        triangles: faces.into_iter().flat_map(halves).collect(),
    }
}

/// A body of revolution about z from its profile (radius, z), bottom to top, its ends on the axis;
/// `around` corners to a turn.
pub(super) fn revolved(profile: &[[f64; 2]], around: u32) -> Mesh {
    let mut mesh = Mesh::default();
    let count = profile.len() as u32;
    for &[radius, z] in profile {
        for k in 0..around {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(around)).sin_cos();
            mesh.vertices
                .push(Point3::new(radius * cos, radius * sin, z));
        }
    }
    let at = |row: u32, k: u32| row * around + k % around;
    for row in 0..count - 1 {
        for k in 0..around {
            let (a, b) = (at(row, k), at(row, k + 1));
            let (c, d) = (at(row + 1, k + 1), at(row + 1, k));
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// A torus about z.
pub(super) fn torus(ring_mm: f64, tube_mm: f64, around: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..around {
        let (sin, cos) = (TAU * f64::from(i) / f64::from(around)).sin_cos();
        for j in 0..around {
            let (s, c) = (TAU * f64::from(j) / f64::from(around)).sin_cos();
            let radius = ring_mm + tube_mm * c;
            mesh.vertices
                .push(Point3::new(radius * cos, radius * sin, tube_mm * s));
        }
    }
    let at = |i: u32, j: u32| (i % around) * around + j % around;
    for i in 0..around {
        for j in 0..around {
            let (a, b) = (at(i, j), at(i + 1, j));
            let (c, d) = (at(i + 1, j + 1), at(i, j + 1));
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// Both together.
pub(super) fn joined(mut one: Mesh, other: &Mesh) -> Mesh {
    let first = one.vertices.len() as u32;
    one.vertices.extend(&other.vertices);
    let others = other.triangles.iter();
    one.triangles
        .extend(others.map(|triangle| triangle.map(|vertex| first + vertex)));
    one
}

/// As a binary STL holds it.
pub(super) fn to_stl(mesh: &Mesh) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for triangle in 0..mesh.triangles.len() {
        bytes.extend([0; 12]);
        for x in mesh.corners(triangle).iter().flat_map(|p| p.iter()) {
            bytes.extend((*x as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

/// As a text STL holds it.
pub(super) fn to_ascii_stl(mesh: &Mesh) -> String {
    let mut text = String::from("solid part\n");
    for triangle in 0..mesh.triangles.len() {
        text += "facet normal 0 0 0\nouter loop\n";
        for p in mesh.corners(triangle) {
            text += &format!("vertex {} {} {}\n", p.x, p.y, p.z);
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid part\n"
}

/// As an OBJ holds it.
pub(super) fn to_obj(mesh: &Mesh) -> String {
    let mut text = String::new();
    for p in &mesh.vertices {
        text += &format!("v {} {} {}\n", p.x, p.y, p.z);
    }
    for [a, b, c] in &mesh.triangles {
        text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
    }
    text
}

/// A 3MF package of this model text.
pub(super) fn to_3mf(model: &str) -> Vec<u8> {
    to_package(&[("3D/3dmodel.model", model.as_bytes())])
}

/// A package of these files.
pub(super) fn to_package(files: &[(&str, impl AsRef<[u8]>)]) -> Vec<u8> {
    use std::io::Write;
    let mut package = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    for (name, text) in files {
        package.start_file(*name, options).expect("memory");
        package.write_all(text.as_ref()).expect("memory");
    }
    package.finish().expect("memory").into_inner()
}

/// The mesh as an object of a 3MF model.
pub(super) fn object_3mf(id: u32, mesh: &Mesh) -> String {
    let vertex = |p: &Point3| format!("<vertex x=\"{}\" y=\"{}\" z=\"{}\"/>", p.x, p.y, p.z);
    let triangle = |t: &[u32; 3]| {
        format!(
            "<triangle v1=\"{}\" v2=\"{}\" v3=\"{}\"/>",
            t[0], t[1], t[2]
        )
    };
    let vertices: String = mesh.vertices.iter().map(vertex).collect();
    let triangles: String = mesh.triangles.iter().map(triangle).collect();
    format!(
        "<object id=\"{id}\" type=\"model\"><mesh><vertices>{vertices}</vertices><triangles>{triangles}\
         </triangles></mesh></object>"
    )
}

/// A model of these resources and items.
pub(super) fn model_3mf(unit: &str, objects: &str, items: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><model unit=\"{unit}\" \
         xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\"><resources>{objects}\
         </resources><build>{items}</build></model>"
    )
}

//! Ground by formulas, meshes of it, outlines and machines.

use headway::geometry::Point2;
use headway::geometry::polygon::{Region, Ring};
use headway::input::Target;
use headway::mesh::{Mesh, Point3};
use headway::settings::{Settings, machine_file};
use headway_tests::ground_oracle::{Ground, Vec3};
use std::f64::consts::TAU;
use std::path::Path;

/// Heights over a plane, and where an outline lies on it.
pub struct Shape {
    pub name: &'static str,
    pub height: fn(f64, f64) -> f64,
    pub shift: [f64; 2],
    /// Sides of the mesh.
    pub box_mm: [[f64; 2]; 2],
}

const AROUND: [[f64; 2]; 2] = [[-15.0, -15.0], [15.0, 15.0]];

pub fn shapes() -> Vec<Shape> {
    let shape = |name, height: fn(f64, f64) -> f64| Shape {
        name,
        height,
        shift: [0.0, 0.0],
        box_mm: AROUND,
    };
    vec![
        shape("plane", |_, _| 0.0),
        Shape {
            shift: [5.3, 0.0],
            box_mm: [[-18.5, -15.0], [18.5, 15.0]],
            ..shape("arch", |x, _| (400.0 - x * x).sqrt())
        },
        shape("dome", |x, y| (625.0 - x * x - y * y).sqrt()),
        shape("saddle", |x, y| (x * x - y * y) / 40.0),
        shape("sine", |x, _| 1.5 * (TAU * x / 20.0).sin()),
        Shape {
            shift: [15.0, 0.0],
            box_mm: [[1.5, -15.0], [30.0, 15.0]],
            ..shape("cone", |x, y| 30.0 - 0.7 * x.hypot(y))
        },
        shape("free", |x, y| {
            let bump = (-((x - 4.0).powi(2) + (y + 2.0).powi(2)) / 60.0).exp();
            2.0 * bump + 1.2 * (x / 6.0).sin() * (y / 7.0).cos() + 0.05 * x
        }),
    ]
}

impl Shape {
    pub fn ground(&self) -> Ground {
        let height = self.height;
        Ground::new(move |x, y| Vec3::new(x, y, height(x, y)))
    }

    pub fn mesh(&self) -> Mesh {
        let [low, high] = self.box_mm;
        let counts = [0, 1].map(|k| ((high[k] - low[k]) / 0.2).round() as usize);
        let height = self.height;
        sheet(counts, false, |s, t| {
            let (x, y) = (
                low[0] + s * (high[0] - low[0]),
                low[1] + t * (high[1] - low[1]),
            );
            Vec3::new(x, y, height(x, y))
        })
    }

    pub fn outline(&self, name: &str) -> Region {
        let shift = nalgebra::Vector2::from(self.shift);
        outline(name).shifted(shift)
    }
}

/// A square with a hole, or an L.
pub fn outline(name: &str) -> Region {
    match name {
        "square" => Region {
            exterior: ring(&[[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0]]),
            holes: vec![circle([2.0, 1.0], 4.0, 96, -1.0)],
        },
        _ => Region {
            exterior: ring(&[
                [-10.0, -10.0],
                [10.0, -10.0],
                [10.0, -3.0],
                [-2.0, -3.0],
                [-2.0, 10.0],
                [-10.0, 10.0],
            ]),
            holes: Vec::new(),
        },
    }
}

pub fn ring(points: &[[f64; 2]]) -> Ring {
    Ring {
        points: points.iter().map(|&p| Point2::from(p)).collect(),
    }
}

pub fn circle(middle: [f64; 2], radius_mm: f64, corners: i32, turns: f64) -> Ring {
    let corner = |k: i32| {
        let (sin, cos) = (turns * TAU * f64::from(k) / f64::from(corners)).sin_cos();
        Point2::new(middle[0] + radius_mm * cos, middle[1] + radius_mm * sin)
    };
    Ring {
        points: (0..corners).map(corner).collect(),
    }
}

pub fn target(region: Region) -> Target {
    Target {
        name: "patch".to_string(),
        regions: vec![region],
    }
}

/// A sheet of triangles over the unit square; one that closes has its first column again at its end.
pub fn sheet(counts: [usize; 2], closes: bool, place: impl Fn(f64, f64) -> Vec3) -> Mesh {
    let [nx, ny] = counts;
    let columns = if closes { nx } else { nx + 1 };
    let mut mesh = Mesh::default();
    for j in 0..=ny {
        for i in 0..columns {
            let p = place(i as f64 / nx as f64, j as f64 / ny as f64);
            mesh.vertices.push(Point3::new(p.x, p.y, p.z));
        }
    }
    let corner = |i: usize, j: usize| (j * columns + i % columns) as u32;
    for j in 0..ny {
        for i in 0..nx {
            let [a, b, c, d] = [
                corner(i, j),
                corner(i + 1, j),
                corner(i + 1, j + 1),
                corner(i, j + 1),
            ];
            mesh.triangles.push([a, b, c]);
            mesh.triangles.push([a, c, d]);
        }
    }
    mesh
}

pub fn machine(name: &str) -> Settings {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../examples/machines/{name}.toml"));
    machine_file::from_toml(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// The gantry, its z as fast as x and y.
pub fn fast_gantry() -> Settings {
    let mut settings = machine("gantry");
    let x = settings.machine.joints[0];
    let z = &mut settings.machine.joints[2];
    z.steps_per_unit = x.steps_per_unit;
    (z.speed_max, z.acceleration_max, z.jerk_max) = (x.speed_max, x.acceleration_max, x.jerk_max);
    settings
}

//! A closed mesh and obstacles -> cells: those whose middle is inside, by the crossings of vertical lines with the mesh.

use crate::mesh::{LoadedMesh, Mesh};
use crate::settings::obstacles::Obstacles;
use crate::text::refusal::{Refusal, refusal};
use headway_reach::Vector3;
use headway_reach::space::Part;

/// Lines are this share of a voxel beside the middles of cells, so that they pass no edge of what is drawn on round numbers.
const BESIDE: [f64; 2] = [1.234e-4, 2.345e-4];

pub(in crate::pipeline) struct Voxels {
    pub(in crate::pipeline) part: Part,
    pub(in crate::pipeline) low_mm: Vector3,
}

/// Where cells are.
struct Frame {
    size: [usize; 3],
    low_mm: Vector3,
    voxel_mm: f64,
}

impl Voxels {
    /// On a grid about the middle of the part's box, and from its lowest point up; larger where obstacles are, which are
    /// `offset_mm` from the part's coordinates.
    pub(in crate::pipeline) fn new(
        mesh: &LoadedMesh,
        obstacles: &Obstacles,
        offset_mm: Vector3,
        voxel_mm: f64,
    ) -> Result<Voxels, Refusal> {
        let [low, high] = mesh.bounds_mm().map(|p| p.coords);
        let points: Vec<Vector3> = obstacles
            .points
            .iter()
            .map(|p| p.at_mm - offset_mm)
            .collect();
        let least = points.iter().fold(low, |least, p| least.inf(p));
        let most = points.iter().fold(high, |most, p| most.sup(p));
        let count = |mm: f64| (mm / voxel_mm - 1e-6).ceil().max(0.0);
        let mut low_mm = low;
        for axis in 0..2 {
            let spare_mm = count(high[axis] - low[axis]) * voxel_mm - (high[axis] - low[axis]);
            low_mm[axis] -= 0.5 * spare_mm + voxel_mm * count(low[axis] - least[axis]);
        }
        let cells = (most - low_mm).map(count);
        if cells.max() > super::SIDE_MAX || cells.product() > super::BOX_MAX {
            return Err(refusal!(
                "part and obstacles make a grid that is too large: give a larger --voxel than {voxel_mm:.3}"
            ));
        }
        let frame = Frame {
            size: [cells.x, cells.y, cells.z].map(|n| n as usize),
            low_mm,
            voxel_mm,
        };
        let mut inside = frame.inside(&mesh.mesh);
        for carved in &mesh.carved {
            let [solid, cut] = [&carved.solid, &carved.cut].map(|mesh| frame.inside(mesh));
            let with = solid.iter().zip(cut).map(|(solid, cut)| *solid && !cut);
            inside
                .iter_mut()
                .zip(with)
                .for_each(|(is, with)| *is |= with);
        }
        let [nx, ny, _] = frame.size;
        let number = |[x, y, z]: [usize; 3]| (z * ny + y) * nx + x;
        let part = Part::new(frame.size, voxel_mm, |cell| inside[number(cell)]);
        let part = part.map_err(|_| {
            refusal!("no voxel of {voxel_mm:.3} mm is inside the part: give a smaller --voxel")
        })?;
        let mut stands = vec![false; inside.len()];
        for point in &points {
            let cell = ((point - low_mm) / voxel_mm).map(f64::floor);
            let is_in = |axis: usize| (0.0..frame.size[axis] as f64).contains(&cell[axis]);
            if (0..3).all(is_in) {
                stands[number([0, 1, 2].map(|axis| cell[axis] as usize))] = true;
            }
        }
        let part = part.with_obstacles(|cell| stands[number(cell)]);
        Ok(Voxels { part, low_mm })
    }

    /// Middle of a cell, the part's coordinates.
    pub(in crate::pipeline) fn middle_mm(&self, cell: [u16; 3]) -> Vector3 {
        let middle = Vector3::from(cell.map(f64::from)).add_scalar(0.5);
        self.low_mm + self.part.voxel_mm() * middle
    }

    /// The tip that prints a cell along a unit vector, the part's coordinates.
    pub(in crate::pipeline) fn tip_mm(&self, cell: [u16; 3], direction: &Vector3) -> Vector3 {
        self.middle_mm(cell) + 0.5 * self.part.voxel_mm() * direction
    }

    /// The part's cell at a place in its coordinates, or where there is none those beside it.
    pub(in crate::pipeline) fn cells_near(&self, place_mm: Vector3) -> Vec<usize> {
        let at = ((place_mm - self.low_mm) / self.part.voxel_mm()).map(|n| n.floor() as i64);
        let cells = self.part.cells();
        let cell = |x: i64, y: i64, z: i64| {
            let key = [z, y, x];
            let of = |cell: &[u16; 3]| [2, 1, 0].map(|axis| i64::from(cell[axis]));
            cells.binary_search_by_key(&key, of).ok()
        };
        if let Some(own) = cell(at.x, at.y, at.z) {
            return vec![own];
        }
        let near = || -1..=1i64;
        let beside = near().flat_map(|z| near().flat_map(move |y| near().map(move |x| [x, y, z])));
        beside
            .filter_map(|[x, y, z]| cell(at.x + x, at.y + y, at.z + z))
            .collect()
    }
}

impl Frame {
    /// By cell: whether the mesh winds about its middle.
    fn inside(&self, mesh: &Mesh) -> Vec<bool> {
        let [nx, ny, nz] = self.size;
        // By line: heights at which it enters (1) or leaves (-1).
        let mut crossings: Vec<Vec<(f64, i32)>> = vec![Vec::new(); nx * ny];
        for triangle in 0..mesh.triangles.len() {
            let corners = mesh.corners(triangle);
            self.cross(
                corners.map(|p| (p.coords - self.low_mm) / self.voxel_mm),
                &mut crossings,
            );
        }
        let mut inside = vec![false; nx * ny * nz];
        for (line, crossings) in crossings.iter_mut().enumerate() {
            crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (mut winding, mut next) = (0, 0);
            for z in 0..nz {
                while next < crossings.len() && crossings[next].0 < z as f64 + 0.5 {
                    winding += crossings[next].1;
                    next += 1;
                }
                inside[z * nx * ny + line] = winding > 0;
            }
        }
        inside
    }

    /// Adds where lines cross a triangle, in voxels from the grid's corner.
    fn cross(&self, [a, b, c]: [Vector3; 3], crossings: &mut [Vec<(f64, i32)>]) {
        let [ab, ac] = [b - a, c - a];
        let area = ab.x * ac.y - ab.y * ac.x;
        let [low, high] = [a.inf(&b).inf(&c), a.sup(&b).sup(&c)];
        let lines = |axis: usize| {
            let first = (low[axis] - 1.0).max(0.0) as usize;
            first..((high[axis] + 1.0).max(0.0) as usize).min(self.size[axis])
        };
        for (y, x) in lines(1).flat_map(|y| lines(0).map(move |x| (y, x))) {
            let p = [
                x as f64 + 0.5 + BESIDE[0] - a.x,
                y as f64 + 0.5 + BESIDE[1] - a.y,
            ];
            let u = (p[0] * ac.y - p[1] * ac.x) / area;
            let v = (ab.x * p[1] - ab.y * p[0]) / area;
            if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
                let sign = if area < 0.0 { 1 } else { -1 };
                crossings[y * self.size[0] + x].push((a.z + u * ab.z + v * ac.z, sign));
            }
        }
    }
}

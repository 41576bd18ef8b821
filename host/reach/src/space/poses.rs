//! Which poses the aperture, the bed, the joints and obstacles permit, and which cells they lay.

use super::grid::{NONE, Part, Standing};
use super::head_rows::HeadRows;
use super::{LeftOut, Rules};
use crate::Vector3;

/// What rounding may decide.
const EPSILON: f64 = 1e-9;

/// Poses by cell of the part.
pub(super) struct Poses {
    /// By direction: the aperture's cells at each heading, the one in the middle first.
    footprints: Vec<Vec<Vec<isize>>>,
    /// By cell, then direction: headings at which the aperture is within the part. Empty where it covers one cell only.
    fits: Vec<u16>,
    /// Directions of poses over a cell that are permitted, a bit each.
    permitted: Vec<u128>,
    /// Directions of permitted poses that lay a cell.
    layable: Vec<u128>,
    /// By cell: how many of the conditions the best pose that lays it keeps, in the order of [`LeftOut`].
    kept: Vec<u8>,
}

impl Poses {
    pub(super) fn new(
        part: &Part,
        directions: &[Vector3],
        rules: &Rules,
        heads: &[HeadRows],
    ) -> Poses {
        let cells = part.cells().len();
        let footprints: Vec<_> = directions
            .iter()
            .map(|n| footprints(part, n, rules))
            .collect();
        let one_cell = footprints
            .iter()
            .flatten()
            .all(|cells: &Vec<isize>| cells.len() == 1);
        let mut poses = Poses {
            footprints,
            fits: vec![
                0;
                if one_cell {
                    0
                } else {
                    cells * directions.len()
                }
            ],
            permitted: vec![0; cells],
            layable: vec![0; cells],
            kept: vec![0; cells],
        };
        let mut obstacles = Standing::new(part);
        for &cell in part.obstacles() {
            obstacles.put(part, cell);
        }
        for (direction, axis) in directions.iter().enumerate() {
            for (pose, &cell) in part.cells().iter().enumerate() {
                let fits = poses.fit(part, cell, direction);
                if fits == 0 {
                    continue;
                }
                let kept = if !over_bed(part, axis, rules, cell[2]) {
                    1
                } else if !(rules.allowed)(cell, direction) {
                    2
                } else if obstacles.first_in(cell, &heads[direction]).is_some() {
                    3
                } else {
                    4
                };
                poses.note(part, pose, direction, fits, kept);
            }
        }
        poses
    }

    /// Headings at which the aperture is within the part.
    fn fit(&self, part: &Part, cell: [u16; 3], direction: usize) -> u16 {
        let at = part.at(cell);
        let is_in = |by: &isize| part.cell_at(at.wrapping_add_signed(*by)) != NONE;
        let footprints = (0..).zip(&self.footprints[direction]);
        let fitting = footprints.filter(|(_, cells)| cells.iter().all(is_in));
        fitting.fold(0, |mask, (bit, _): (u32, _)| mask | 1 << bit)
    }

    fn note(&mut self, part: &Part, pose: usize, direction: usize, fits: u16, kept: u8) {
        let bit = if kept == 4 { 1 << direction } else { 0 };
        self.permitted[pose] |= bit;
        if !self.fits.is_empty() {
            self.fits[pose * self.footprints.len() + direction] = fits;
        }
        let at = part.at(part.cells()[pose]);
        let footprints = self.footprints[direction].iter().enumerate();
        for (_, cells) in footprints.filter(|(heading, _)| fits >> heading & 1 == 1) {
            for by in cells {
                let cell = part.cell_at(at.wrapping_add_signed(*by)) as usize;
                self.layable[cell] |= bit;
                self.kept[cell] = self.kept[cell].max(kept);
            }
        }
    }

    /// Directions along which a permitted pose lays a cell.
    #[inline]
    pub(super) fn layable(&self, cell: u32) -> u128 {
        self.layable[cell as usize]
    }

    /// Why no permitted pose lays a cell along the usable directions.
    pub(super) fn refused(&self, cell: usize, usable: u128) -> Option<LeftOut> {
        if self.layable[cell] & usable != 0 {
            return None;
        }
        Some(match self.kept[cell] {
            0 => LeftOut::Aperture,
            1 => LeftOut::Bed,
            2 => LeftOut::Joints,
            3 => LeftOut::Obstacle,
            _ => LeftOut::Support,
        })
    }

    /// The permitted poses that lay a cell along a direction, the one over the cell first.
    pub(super) fn over<'a>(
        &'a self,
        part: &'a Part,
        cell: u32,
        direction: usize,
    ) -> impl Iterator<Item = u32> + 'a {
        let at = part.at(part.cells()[cell as usize]);
        let footprints = self.footprints[direction].iter().enumerate();
        let all =
            footprints.flat_map(move |(heading, cells)| cells.iter().map(move |by| (heading, *by)));
        // The first offset of each heading is the cell itself: one of these is enough.
        let seen = move |&(heading, by): &(usize, isize)| {
            let pose = part.cell_at(at.wrapping_add_signed(-by));
            let fits = |pose: u32| match self
                .fits
                .get(pose as usize * self.footprints.len() + direction)
            {
                Some(fits) => fits >> heading & 1 == 1,
                None => self.fits.is_empty(),
            };
            pose != NONE && self.permitted[pose as usize] >> direction & 1 == 1 && fits(pose)
        };
        all.filter(seen)
            .map(move |(_, by)| part.cell_at(at.wrapping_add_signed(-by)))
    }
}

/// The aperture's cells at each heading, different ones only.
fn footprints(part: &Part, axis: &Vector3, rules: &Rules) -> Vec<Vec<isize>> {
    let [u, w] = across(axis);
    let voxel_mm = part.voxel_mm();
    let reach = (rules.aperture.reach_mm / voxel_mm).ceil() as i16;
    let near = || -reach..=reach;
    let mut all: Vec<Vec<isize>> = Vec::new();
    for heading_rad in &rules.aperture.headings_rad {
        let (sin, cos) = heading_rad.sin_cos();
        let mut cells = vec![0];
        for offset in near().flat_map(|z| near().flat_map(move |y| near().map(move |x| [x, y, z])))
        {
            let away = Vector3::from(offset.map(f64::from)) * voxel_mm;
            let [a, b] = [away.dot(&u), away.dot(&w)];
            let is_in = away.dot(axis).abs() < 0.5 * voxel_mm - EPSILON
                && (rules.aperture.contains)([a * cos + b * sin, b * cos - a * sin]);
            if is_in && offset != [0; 3] {
                cells.push(part.delta(offset));
            }
        }
        if !all.contains(&cells) {
            all.push(cells);
        }
    }
    all
}

/// The tool's x and y after the smallest turn from Z to its axis.
fn across(n: &Vector3) -> [Vector3; 2] {
    if n.z < -0.999_999 {
        return [Vector3::x(), -Vector3::y()];
    }
    let f = 1.0 / (1.0 + n.z);
    [
        Vector3::new(1.0 - n.x * n.x * f, -n.x * n.y * f, -n.x),
        Vector3::new(-n.x * n.y * f, 1.0 - n.y * n.y * f, -n.y),
    ]
}

/// Whether the head over a cell is above the bed: one that never ends is not where its axis points down.
fn over_bed(part: &Part, axis: &Vector3, rules: &Rules, z: u16) -> bool {
    let tip_mm = part.voxel_mm() * (f64::from(z) + 0.5 + 0.5 * axis.z);
    axis.z >= -EPSILON && tip_mm - rules.head.below_tip_mm(axis) >= -rules.slack_mm - EPSILON
}

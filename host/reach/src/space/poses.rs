//! Which poses the aperture, the bed, the joints and obstacles permit, and which cells they lay.

use super::grid::{Grid, NONE, Standing};
use super::head_rows::HeadRows;
use super::{EPSILON, LeftOut, Part, Rules, bits};
use crate::Vector3;

/// Poses by cell of the part; directions are a bit each.
pub(super) struct Poses {
    /// By direction: the aperture's cells at each heading, its middle first.
    footprints: Vec<Vec<Vec<isize>>>,
    /// By cell, then direction: headings at which the aperture is within the part. Empty where it is one cell everywhere.
    fits: Vec<u16>,
    /// Directions of permitted poses over a cell.
    permitted: Vec<u128>,
    /// Directions of permitted poses that lay a cell.
    pub(super) layable: Vec<u128>,
    /// By cell: how many conditions the best pose that lays it keeps, in the order of [`LeftOut`].
    kept: Vec<u8>,
}

impl Poses {
    pub(super) fn new(
        (part, grid): (&Part, &Grid),
        directions: &[Vector3],
        rules: &Rules,
        heads: &[HeadRows],
    ) -> Poses {
        let cells = part.cells.len();
        let footprints = directions.iter().map(|n| footprints(part, grid, n, rules));
        let footprints: Vec<_> = footprints.collect();
        let is_small = footprints.iter().flatten().all(|cells| cells.len() == 1);
        let mut poses = Poses {
            footprints,
            fits: vec![
                0;
                if is_small {
                    0
                } else {
                    cells * directions.len()
                }
            ],
            permitted: vec![0; cells],
            layable: vec![0; cells],
            kept: vec![0; cells],
        };
        let mut obstacles = Standing::new(grid);
        for &cell in &part.obstacles {
            obstacles.turn(grid, grid.place(cell));
        }
        for (pose, &cell) in part.cells.iter().enumerate() {
            for (direction, axis) in directions.iter().enumerate() {
                let fits = poses.fitting(grid, pose, direction);
                let kept = if fits == 0 {
                    continue;
                } else if !is_over_bed(part, axis, rules, cell[2]) {
                    1
                } else if !(rules.allowed)(cell, direction) {
                    2
                } else if obstacles.in_head(grid, cell, &heads[direction]).is_some() {
                    3
                } else {
                    4
                };
                poses.note(grid, pose, direction, fits, kept);
            }
        }
        poses
    }

    /// Headings at which the aperture is within the part.
    fn fitting(&self, grid: &Grid, pose: usize, direction: usize) -> u128 {
        if self.fits.is_empty() {
            return 1;
        }
        let place = grid.places[pose];
        let is_in = |step: &isize| grid.cell(place, *step) != NONE;
        let footprints = (0..).zip(&self.footprints[direction]);
        let fitting = footprints.filter(|(_, cells)| cells.iter().all(is_in));
        fitting.fold(0, |mask, (bit, _): (u32, _)| mask | 1 << bit)
    }

    fn note(&mut self, grid: &Grid, pose: usize, direction: usize, fits: u128, kept: u8) {
        let bit = u128::from(kept == 4) << direction;
        self.permitted[pose] |= bit;
        if !self.fits.is_empty() {
            self.fits[pose * self.footprints.len() + direction] = fits as u16;
        }
        for heading in bits(fits) {
            for step in &self.footprints[direction][heading] {
                let cell = grid.cell(grid.places[pose], *step) as usize;
                self.layable[cell] |= bit;
                self.kept[cell] = self.kept[cell].max(kept);
            }
        }
    }

    /// Which condition no pose that lays a cell keeps.
    pub(super) fn refused(&self, cell: usize) -> LeftOut {
        match self.kept[cell] {
            0 => LeftOut::Aperture,
            1 => LeftOut::Bed,
            2 => LeftOut::Joints,
            3 => LeftOut::Obstacle,
            _ => LeftOut::Support,
        }
    }

    /// The permitted poses that lay a cell along a direction, the one over the cell first.
    pub(super) fn over<'a>(
        &'a self,
        grid: &'a Grid,
        cell: u32,
        direction: usize,
    ) -> impl Iterator<Item = u32> + 'a {
        let footprints = self.footprints[direction].iter().enumerate();
        let all = footprints.flat_map(|(heading, cells)| cells.iter().map(move |s| (heading, *s)));
        all.filter_map(move |(heading, step)| {
            let pose = grid.cell(grid.places[cell as usize], -step);
            let number = (pose != NONE).then_some(pose as usize)?;
            let fits = self.fits.get(number * self.footprints.len() + direction);
            let fits = fits.is_none_or(|fits| fits >> heading & 1 == 1);
            (fits && self.permitted[number] >> direction & 1 == 1).then_some(pose)
        })
    }
}

/// The aperture's cells at each heading, different ones only.
fn footprints(part: &Part, grid: &Grid, n: &Vector3, rules: &Rules) -> Vec<Vec<isize>> {
    // The tool's x and y after the smallest turn from Z to its axis.
    let f = 1.0 / (1.0 + n.z);
    let [u, w] = match n.z < -0.999_999 {
        true => [Vector3::x(), -Vector3::y()],
        false => [
            Vector3::new(1.0 - n.x * n.x * f, -n.x * n.y * f, -n.x),
            Vector3::new(-n.x * n.y * f, 1.0 - n.y * n.y * f, -n.y),
        ],
    };
    let reach = (rules.aperture.reach_mm / part.voxel_mm).ceil() as i16;
    let mut all: Vec<Vec<isize>> = Vec::new();
    for heading_rad in &rules.aperture.headings_rad {
        let (sin, cos) = heading_rad.sin_cos();
        let mut cells = vec![0];
        for offset in super::cube(reach) {
            let away = Vector3::from(offset.map(f64::from)) * part.voxel_mm;
            let [a, b] = [away.dot(&u), away.dot(&w)];
            if offset != [0; 3]
                && away.dot(n).abs() < 0.5 * part.voxel_mm - EPSILON
                && (rules.aperture.contains)([a * cos + b * sin, b * cos - a * sin])
            {
                cells.push(grid.step(offset));
            }
        }
        if !all.contains(&cells) {
            all.push(cells);
        }
    }
    all
}

/// Whether the head is above the bed; one that never ends is not where its axis points down.
fn is_over_bed(part: &Part, axis: &Vector3, rules: &Rules, z: u16) -> bool {
    let tip_mm = part.voxel_mm * (f64::from(z) + 0.5 + 0.5 * axis.z);
    let low_mm = tip_mm - rules.head.below_tip_mm(axis);
    axis.z >= -EPSILON && low_mm >= -rules.slack_mm - EPSILON
}

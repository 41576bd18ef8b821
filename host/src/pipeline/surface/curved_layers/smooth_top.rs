//! A smooth surface through the top of a piece, on which a flat nozzle lies.
//!
//! In: heights of a piece's cells (mm). Out: a [`SplineSurface`] through them. Where the flat end of the nozzle would dip
//! into a hollow fold, or its ends would hang over a ridge, the heights about that fold are means over a disk: weighed by
//! 1 / sqrt(R² - r²), whose projection onto any line is even, so that a fold of angle d bends evenly over the disk's
//! width 2R, and a flat end of radius r dips by d r² / 4R. What is smooth before stays as it is.

use super::Job;
use super::top_grid::{Piece, TopGrid};
use crate::geometry::Vector2;
use crate::geometry::chart::{Chart, sharpest_bend_per_mm};
use crate::geometry::polygon::Box2;
use crate::geometry::spline_surface::SplineSurface;
use std::sync::Arc;

/// Pitch of a smooth top, of the unit, and how far it goes on beyond a piece, of the nozzle's half length.
const PITCH: f64 = 0.5;
const AROUND: f64 = 7.0;
/// How deep the flat end of a nozzle may dip, and how far the ends of its aperture may hang, of a layer; a plan on a surface is
/// refused at half a layer.
const DIP: f64 = 0.45;
const HANG: f64 = 0.4;
/// Radii of the disks that are tried, of the flat end's.
const DISKS: [f64; 8] = [0.6, 0.68, 0.76, 0.85, 1.0, 1.2, 1.5, 2.0];
/// Directions in which a dip is looked for.
const DIRECTIONS: usize = 8;

/// A piece of the top and the smooth surface that is followed there.
pub struct FollowedTop {
    /// Its cells.
    pub piece: Piece,
    /// Heights above the bed, mm.
    pub surface: Arc<SplineSurface>,
}

impl FollowedTop {
    /// Of a piece.
    pub fn of(job: &Job, piece: Piece) -> FollowedTop {
        FollowedTop {
            surface: Arc::new(smooth_top(job, &piece)),
            piece,
        }
    }
}

/// A smooth top through the cells of a piece.
fn smooth_top(job: &Job, piece: &Piece) -> SplineSurface {
    let grid = &job.grid;
    let around_mm = AROUND * job.settings.aperture.major_mm();
    let corners = piece.cells.iter().map(|&cell| grid.place(cell));
    let bounds = Box2::of(&corners.collect::<Vec<_>>()).grown(around_mm);
    let pitch_mm = (PITCH * job.settings.aperture.unit_mm()).max(2.0 * grid.step_mm);
    let through = |heights: &[f64]| {
        let cells = piece.cells.iter().zip(heights);
        let points = cells.map(|(&cell, &z_mm)| {
            let at = grid.place(cell);
            [at.x, at.y, z_mm]
        });
        let points: Vec<[f64; 3]> = points.collect();
        let fitted = SplineSurface::on_grid(&points, bounds, pitch_mm);
        // There are points: a piece has cells.
        fitted.unwrap_or_else(|| SplineSurface::level(bounds, pitch_mm))
    };
    let flat_end = FlatEnd::of(job);
    let own: Vec<f64> = piece.cells.iter().map(|&cell| grid.z_mm[cell]).collect();
    let raw = through(&own);
    let off = |surface: &SplineSurface| {
        let off = piece
            .cells
            .iter()
            .filter(|&&cell| !flat_end.lies(grid, cell, surface));
        off.count()
    };
    let folds = piece
        .cells
        .iter()
        .map(|&cell| flat_end.is_fold(grid, cell, &raw));
    let folds: Vec<bool> = folds.collect();
    // The surface with the fewest places on which the nozzle does not lie: the planner of surfaces refuses what is left.
    let mut best = (off(&raw), raw.clone());
    let wanted = flat_end.disk(
        piece.cells.iter().map(|&cell| bend_at(grid, cell, &raw)),
        pitch_mm,
    );
    let wanted = DISKS.iter().position(|disk| *disk >= wanted);
    for disk in &DISKS[wanted.unwrap_or(DISKS.len() - 1)..] {
        if best.0 == 0 {
            break;
        }
        let disk_mm = disk * flat_end.tip_mm;
        let about = cells_about(grid, piece, &folds, disk_mm + grid.step_mm);
        let means = Means::of(grid, piece, &raw, disk_mm);
        let cells = piece.cells.iter().zip(&own).zip(about);
        let heights = cells.map(|((&cell, &z_mm), is_about)| match is_about {
            true => means.at(cell),
            false => z_mm,
        });
        let surface = through(&heights.collect::<Vec<_>>());
        let count = off(&surface);
        if count < best.0 {
            best = (count, surface);
        }
    }
    best.1
}

/// What has to lie on the surface.
struct FlatEnd {
    tip_mm: f64,
    dip_mm: f64,
    bend_max_per_mm: f64,
}

impl FlatEnd {
    fn of(job: &Job) -> FlatEnd {
        let major_mm = job.settings.aperture.major_mm();
        let head = job.settings.head.as_ref();
        let tip_mm = head.map_or(0.0, |head| head.profile().tip_radius_mm());
        FlatEnd {
            tip_mm: major_mm.max(tip_mm),
            dip_mm: DIP * job.layer_mm,
            bend_max_per_mm: 2.0 * HANG * job.layer_mm / (major_mm * major_mm),
        }
    }

    /// About the disk that the sharpest of the bends of a surface needs, of the flat end's radius: a spline bends over a fold
    /// within its pitch.
    fn disk(&self, bends_per_mm: impl Iterator<Item = f64>, pitch_mm: f64) -> f64 {
        let fold = bends_per_mm.fold(0.0, f64::max) * pitch_mm;
        fold * self.tip_mm / (4.0 * self.dip_mm)
    }

    /// Whether a surface bends so much over a cell that an even bend like that would not do.
    fn is_fold(&self, grid: &TopGrid, cell: usize, surface: &SplineSurface) -> bool {
        let bend = bend_at(grid, cell, surface);
        bend > 2.0 * self.dip_mm / (self.tip_mm * self.tip_mm) || bend > self.bend_max_per_mm
    }

    /// Whether it lies on a surface over a cell.
    fn lies(&self, grid: &TopGrid, cell: usize, surface: &SplineSurface) -> bool {
        let at = grid.place(cell);
        let jet = SplineSurface::jet(surface, at.x, at.y);
        let bend = bend_at(grid, cell, surface);
        let lean = (1.0 + jet.slope[0].powi(2) + jet.slope[1].powi(2)).sqrt();
        bend <= self.bend_max_per_mm
            && (0..DIRECTIONS).all(|k| {
                let turn = k as f64 / DIRECTIONS as f64 * std::f64::consts::TAU;
                let step = self.tip_mm * Vector2::new(turn.cos(), turn.sin());
                let to = SplineSurface::jet(surface, at.x + step.x, at.y + step.y).z_mm;
                let rise_mm = step.x * jet.slope[0] + step.y * jet.slope[1];
                (to - jet.z_mm - rise_mm) / lean <= self.dip_mm
            })
    }
}

/// How sharply a surface bends over a cell, 1/mm.
fn bend_at(grid: &TopGrid, cell: usize, surface: &SplineSurface) -> f64 {
    let at = grid.place(cell);
    sharpest_bend_per_mm(&Chart::jet(surface, at)).abs()
}

/// The cells of a piece that are so near to some of them.
fn cells_about(grid: &TopGrid, piece: &Piece, is_off: &[bool], near_mm: f64) -> Vec<bool> {
    let off = piece.cells.iter().zip(is_off);
    let off = Piece {
        cells: off
            .filter(|(_, is_off)| **is_off)
            .map(|(cell, _)| *cell)
            .collect(),
    };
    let (_, away) = grid.distances_mm(&off, 0);
    piece
        .cells
        .iter()
        .map(|&cell| away[cell] <= near_mm)
        .collect()
}

/// Means over disks of a piece; beside it the top goes on as its surface does.
struct Means<'a> {
    grid: &'a TopGrid,
    is_of_piece: Vec<bool>,
    beside: &'a SplineSurface,
    disk: f64,
}

impl Means<'_> {
    fn of<'a>(
        grid: &'a TopGrid,
        piece: &Piece,
        beside: &'a SplineSurface,
        disk_mm: f64,
    ) -> Means<'a> {
        let mut is_of_piece = vec![false; grid.z_mm.len()];
        for &cell in &piece.cells {
            is_of_piece[cell] = true;
        }
        Means {
            grid,
            is_of_piece,
            beside,
            disk: disk_mm / grid.step_mm,
        }
    }

    /// Mean height about a cell.
    fn at(&self, cell: usize) -> f64 {
        let [columns, rows] = self.grid.count.map(|count| count as isize);
        let (i, j) = (cell as isize % columns, cell as isize / columns);
        let middle = self.grid.place(cell);
        let reach = self.disk.floor() as isize;
        let (mut sum, mut weights) = (0.0, 0.0);
        for dj in -reach..=reach {
            for di in -reach..=reach {
                let rest = self.disk * self.disk - (di * di + dj * dj) as f64;
                if rest < 0.0 {
                    continue;
                }
                let (k, l) = (i + di, j + dj);
                let is_inside = (0..columns).contains(&k) && (0..rows).contains(&l);
                let other = (l * columns + k) as usize;
                let z_mm = match is_inside && self.is_of_piece[other] {
                    true => self.grid.z_mm[other],
                    false => {
                        let at = middle + self.grid.step_mm * Vector2::new(di as f64, dj as f64);
                        SplineSurface::jet(self.beside, at.x, at.y).z_mm
                    }
                };
                let weight = 1.0 / rest.max(0.5).sqrt();
                sum += weight * z_mm;
                weights += weight;
            }
        }
        sum / weights
    }
}

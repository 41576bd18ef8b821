//! The layer from above as cells: which station covers each first, which is nearest beside it, and how far the edge is.
//!
//! In: a [`Layer`], a [`Nozzle`]. Out: a raster of owners and of signed distances from the covered ground, mm, positive
//! inside. Material is laid on the ground that the nozzle newly covers, as the plan's flow has it. Near the edge a distance is
//! that of the nearest pose's outline, elsewhere by chamfers (Borgefors, 1986), within 8 %.

use super::layer::{Layer, Sample};
use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::text::refusal::{Refusal, refusal};
use std::f64::consts::SQRT_2;

/// Cells across the narrowest bead.
const CELLS_ACROSS: f64 = 8.0;
/// Most cells: 12 bytes each, in two rasters at once.
const CELLS_MAX: f64 = 2e7;
/// Outside of the raster.
const FAR_MM: f64 = 1e3;
/// Marks a cell beside the covered ground.
const BESIDE: u32 = 1 << 31;

/// The nozzle as it really is, against what the job takes it for.
#[derive(Clone, Copy, Debug, Default)]
pub struct Nozzle {
    /// Its centre from the axis of the heading, in the tool's frame.
    pub centre_mm: Vector2,
    /// Its heading where the machine takes it for 0.
    pub heading_rad: f64,
    /// By how much its beads are wider.
    pub wider_mm: f64,
}

/// How deep a point of the tool's frame is below the outline, mm, negative outside: by the support in the direction of the level
/// through the point, exact on the outline and to third order beside it. Deep inside, any depth that is beyond what is near.
fn depth_mm(aperture: &Aperture, p: Vector2) -> f64 {
    match aperture {
        Aperture::Ellipse { major_mm, minor_mm } => {
            let (u, v) = (p.x / major_mm, p.y / minor_mm);
            if u * u + v * v < 0.2 {
                return *minor_mm;
            }
            // Normal of the level, not of unit length.
            let (x, y) = (u / major_mm, v / minor_mm);
            let support = (x * x * major_mm * major_mm + y * y * minor_mm * minor_mm).sqrt();
            (support - x * p.x - y * p.y) / (x * x + y * y).sqrt()
        }
        Aperture::Rounded(shape) => -shape.signed_distance_mm(p),
    }
}

/// The raster.
pub struct Ground {
    /// Side of a cell.
    pub cell_mm: f64,
    /// Its lower left corner.
    pub low_mm: Vector2,
    /// Columns and rows.
    pub size: [usize; 2],
    /// How far beside the covered ground cells have owners.
    pub margin_mm: f64,
    owners: Vec<u32>,
    /// From the edge of the covered ground.
    pub distance_mm: Vec<f32>,
    /// Heading of the pose whose outline is nearest.
    headings_rad: Vec<f32>,
}

impl Ground {
    /// Of a layer.
    ///
    /// # Errors
    /// A `Refusal` if the layer has too many cells.
    pub fn of(layer: &Layer, nozzle: &Nozzle) -> Result<Ground, Refusal> {
        let reach_mm = layer.aperture.reach_mm();
        let room_mm = 5.0 * reach_mm;
        let samples = layer.passes.iter().flat_map(|pass| &pass.samples);
        let first = layer.passes[0].samples[0].at_mm;
        let (low, high) = samples.fold((first, first), |(low, high), s| {
            (low.inf(&s.at_mm), high.sup(&s.at_mm))
        });
        let cell_mm = 2.0 * layer.aperture.minor_mm() / CELLS_ACROSS;
        let low_mm = low - Vector2::repeat(room_mm);
        let size = (high - low_mm).add_scalar(room_mm) / cell_mm;
        if size.x * size.y > CELLS_MAX {
            return Err(refusal!(
                "the layer is {:.0} x {:.0} mm, too large for its beads of {:.2} mm: measure a smaller part",
                high.x - low.x,
                high.y - low.y,
                2.0 * layer.aperture.minor_mm()
            ));
        }
        let size = [size.x as usize + 1, size.y as usize + 1];
        let cells = size[0] * size[1];
        let mut ground = Ground {
            cell_mm,
            low_mm,
            size,
            margin_mm: layer.aperture.minor_mm(),
            owners: vec![0; cells],
            distance_mm: vec![f32::NEG_INFINITY; cells],
            headings_rad: vec![0.0; cells],
        };
        for (number, station) in layer.stations.iter().enumerate() {
            let samples = layer.samples_of(station);
            for pair in samples.windows(2) {
                ground.sweep(
                    layer.aperture,
                    nozzle,
                    &pair[0],
                    &pair[1],
                    number as u32 + 1,
                );
            }
        }
        // Farther from the edge, nearer outlines may not have been looked at.
        let near_mm = (0.7 * ground.margin_mm) as f32;
        let far = ground.distances();
        for (distance, far) in ground.distance_mm.iter_mut().zip(far) {
            if distance.abs() > near_mm {
                *distance = far;
            }
        }
        ground.spread();
        Ok(ground)
    }

    /// The cells that the nozzle newly covers from one sample to the next, and how deep they are in it.
    fn sweep(
        &mut self,
        aperture: &Aperture,
        nozzle: &Nozzle,
        from: &Sample,
        to: &Sample,
        owner: u32,
    ) {
        let reach_mm = aperture.reach_mm() + self.margin_mm;
        let turned_mm = reach_mm * (to.heading_rad - from.heading_rad).abs();
        let moved_mm = (to.at_mm - from.at_mm).norm() + turned_mm;
        let steps = (moved_mm / (0.5 * self.cell_mm)).ceil().max(1.0);
        for step in 1..=steps as u32 {
            let share = f64::from(step) / steps;
            let asked_rad = from.heading_rad + share * (to.heading_rad - from.heading_rad);
            let heading_rad = asked_rad + nozzle.heading_rad;
            let (sin, cos) = heading_rad.sin_cos();
            let centre = nozzle.centre_mm;
            let centre = Vector2::new(
                centre.x * cos - centre.y * sin,
                centre.x * sin + centre.y * cos,
            );
            let at = from.at_mm.lerp(&to.at_mm, share) + centre - self.low_mm;
            let range = |at: f64, axis: Vector2| {
                let half = |axis| aperture.support_mm(heading_rad, axis) + 0.8 * self.margin_mm;
                let [low, high] = [at - half(-axis), at + half(axis)];
                (low / self.cell_mm) as usize..=(high / self.cell_mm) as usize
            };
            let (columns, rows) = (range(at.x, Vector2::x()), range(at.y, Vector2::y()));
            for row in rows {
                let y = (row as f64 + 0.5) * self.cell_mm - at.y;
                for column in columns.clone() {
                    let x = (column as f64 + 0.5) * self.cell_mm - at.x;
                    let own = row * self.size[0] + column;
                    let in_tool = Vector2::new(x * cos + y * sin, y * cos - x * sin);
                    let depth_mm = depth_mm(aperture, in_tool) + 0.5 * nozzle.wider_mm;
                    if depth_mm as f32 > self.distance_mm[own] {
                        self.distance_mm[own] = depth_mm as f32;
                        self.headings_rad[own] = heading_rad as f32;
                    }
                    if self.owners[own] == 0 && depth_mm >= 0.0 {
                        self.owners[own] = owner;
                    }
                }
            }
        }
    }

    /// Signed distances of the cells from the edge: to the nearest cell of the other kind, less half a cell.
    fn distances(&self) -> Vec<f32> {
        let [columns, rows] = self.size;
        let (side, corner) = (self.cell_mm as f32, (self.cell_mm * SQRT_2) as f32);
        let mut field = vec![1e9f32; columns * rows];
        let through = [
            (1, side),
            (columns - 1, corner),
            (columns, side),
            (columns + 1, corner),
        ];
        let mut pass = |at: usize, is_back: bool| {
            let is_covered = self.owners[at] > 0;
            for (by, through) in through {
                let from = if is_back { at + by } else { at - by };
                let is_other = (self.owners[from] > 0) != is_covered;
                let distance = through + if is_other { 0.0 } else { field[from] };
                if distance < field[at] {
                    field[at] = distance;
                }
            }
        };
        let inner = columns + 1..columns * (rows - 1) - 1;
        for at in inner.clone() {
            pass(at, false);
        }
        for at in inner.rev() {
            pass(at, true);
        }
        for (distance, owner) in field.iter_mut().zip(&self.owners) {
            *distance = (*distance - 0.5 * side) * if *owner > 0 { 1.0 } else { -1.0 };
        }
        field
    }

    /// Cells beside the covered ground get the nearest owner, up to the margin.
    fn spread(&mut self) {
        let columns = self.size[0];
        let mut rim: Vec<usize> = (0..self.owners.len())
            .filter(|at| self.owners[*at] > 0)
            .collect();
        // Steps along sides and corners by turns go in octagons.
        for round in 0..(1.2 * self.margin_mm / self.cell_mm).ceil() as usize {
            let mut next = Vec::new();
            for &at in &rim {
                let sides = [at - 1, at + 1, at - columns, at + columns];
                let corners = [
                    at - columns - 1,
                    at - columns + 1,
                    at + columns - 1,
                    at + columns + 1,
                ];
                let corners = &corners[..if round % 2 == 0 { 0 } else { 4 }];
                for &beside in sides.iter().chain(corners) {
                    if self.owners[beside] == 0 {
                        self.owners[beside] = self.owners[at] | BESIDE;
                        next.push(beside);
                    }
                }
            }
            rim = next;
        }
    }

    /// The cell of a place.
    pub fn cell(&self, at_mm: Vector2) -> Option<usize> {
        let x = (at_mm.x - self.low_mm.x) / self.cell_mm;
        let y = (at_mm.y - self.low_mm.y) / self.cell_mm;
        let is_inside =
            x >= 0.0 && y >= 0.0 && (x as usize) < self.size[0] && (y as usize) < self.size[1];
        is_inside.then(|| y as usize * self.size[0] + x as usize)
    }

    /// The middle of a cell.
    pub fn middle(&self, cell: usize) -> Vector2 {
        let [column, row] = [cell % self.size[0], cell / self.size[0]];
        self.low_mm + Vector2::new(column as f64 + 0.5, row as f64 + 0.5) * self.cell_mm
    }

    /// The station that owns a cell, and whether it covers it.
    pub fn owner(&self, cell: usize) -> Option<(usize, bool)> {
        let owner = self.owners[cell];
        (owner > 0)
            .then_some(((owner & !BESIDE) as usize, owner & BESIDE == 0))
            .map(|(number, covers)| (number - 1, covers))
    }

    /// Heading of the nozzle where it left the edge that is nearest to a cell.
    pub fn heading_rad(&self, cell: usize) -> f64 {
        f64::from(self.headings_rad[cell])
    }

    /// Signed distance from the edge at the middle of the cell there, mm; far outside beyond the raster.
    pub fn near_mm(&self, at_mm: Vector2) -> f64 {
        self.cell(at_mm)
            .map_or(-FAR_MM, |cell| f64::from(self.distance_mm[cell]))
    }

    /// The same between the cells' middles.
    pub fn distance_at(&self, at_mm: Vector2) -> f64 {
        let half = 0.5 * self.cell_mm;
        let Some(at) = self.cell(at_mm - Vector2::new(half, half)) else {
            return -FAR_MM;
        };
        let from = (at_mm - self.middle(at)) / self.cell_mm;
        let d = |by: usize| {
            self.distance_mm
                .get(at + by)
                .map_or(-FAR_MM, |d| f64::from(*d))
        };
        let along = |by: usize| d(by) * (1.0 - from.x) + d(by + 1) * from.x;
        along(0) * (1.0 - from.y) + along(self.size[0]) * from.y
    }

    /// How it changes there.
    pub fn slope_at(&self, at_mm: Vector2) -> Vector2 {
        let h = self.cell_mm;
        let along =
            |by: Vector2| (self.distance_at(at_mm + by) - self.distance_at(at_mm - by)) / (2.0 * h);
        Vector2::new(along(Vector2::new(h, 0.0)), along(Vector2::new(0.0, h)))
    }
}

//! A divided part -> the layers of each piece along its own direction.
//!
//! In: a mesh, cuts, and the piece of each voxel. Out: sections at half the height of each layer, mm, in the piece's frame. A
//! section's region above a later cut is taken away if most voxels there belong to that cut's piece: the plane decides where, to
//! the last digit, voxels only which piece.

use super::frame::Frame;
use crate::geometry::boolean::{difference, intersection};
use crate::geometry::polygon::{Box2, Region, Ring};
use crate::geometry::{Point2, Vector2};
use crate::mesh::layers::{SlicedPart, TargetLayer};
use crate::mesh::slice::Slicer;
use crate::mesh::{LoadedMesh, Mesh};
use crate::pipeline::reach::Voxels;
use crate::settings::{LAYERS_MAX, Settings};
use crate::text::refusal::{Refusal, refusal};
use nalgebra::Vector3;
use rayon::prelude::*;

/// A middle that is this near below the top cuts nothing but rounding, mm.
const HAIR_MM: f64 = 1e-5;
/// A region smaller than this is rounding of a cut, of the aperture's.
const SLIVER_SHARE: f64 = 1e-3;
/// Most places of a region, along either side of its box, whose voxels are asked.
const ASKED_MAX: f64 = 40.0;

/// A cut in the part's coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PartCut {
    /// Unit.
    pub(super) direction: Vector3<f64>,
    /// The plane's distance from the origin, mm.
    pub(super) level_mm: f64,
}

/// A part and its pieces.
pub(super) struct Divided<'a> {
    pub(super) mesh: &'a LoadedMesh,
    pub(super) voxels: &'a Voxels,
    /// By cell of the part.
    pub(super) owners: Vec<u8>,
    pub(super) cuts: Vec<PartCut>,
    /// By piece: what hangs of it upright, and as it is printed.
    pub(super) hanging_mm2: Vec<[f64; 2]>,
}

impl Divided<'_> {
    /// The frame of a piece; 0 is the rest.
    pub(super) fn frame(&self, piece: usize) -> Frame {
        let cut = piece.checked_sub(1).map(|cut| &self.cuts[cut]);
        Frame::of(&cut.map_or(Vector3::z(), |cut| cut.direction))
    }

    /// The layers of a piece.
    ///
    /// # Errors
    /// Too many of them.
    pub(super) fn layers(&self, piece: usize, settings: &Settings) -> Result<SlicedPart, Refusal> {
        let frame = self.frame(piece);
        let mesh: Mesh = frame.mesh(&self.mesh.mesh);
        let [low, high] = mesh.bounds_mm();
        let low_mm = piece
            .checked_sub(1)
            .map_or(low.z, |cut| self.cuts[cut].level_mm);
        let height_mm = settings.layer_height_mm;
        let count = ((high.z - HAIR_MM - low_mm) / height_mm - 0.5)
            .ceil()
            .max(0.0);
        if count > f64::from(LAYERS_MAX) {
            return Err(refusal!(
                "{count:.0} layers of {height_mm} mm, more than {LAYERS_MAX}: give a larger --layer-height"
            ));
        }
        let levels = (0..count as u32).map(|number| low_mm + height_mm * (f64::from(number) + 0.5));
        let levels: Vec<f64> = levels.collect();
        let sections = Slicer::new(&mesh).sections(&levels);
        let least_mm2 = SLIVER_SHARE * settings.aperture.area_mm2();
        let layer = |(number, section): (usize, crate::mesh::slice::Section)| TargetLayer {
            number: number as u32,
            height_mm,
            top_mm: levels[number] + 0.5 * height_mm,
            regions: self.own(piece, frame, levels[number], section.regions, least_mm2),
        };
        let layers = sections.into_par_iter().enumerate().map(layer);
        let mut layers: Vec<TargetLayer> = layers.collect();
        let last = layers.iter().rposition(|layer| !layer.regions.is_empty());
        layers.truncate(last.map_or(0, |last| last + 1));
        Ok(SlicedPart {
            wanted: 0..layers.len() as u32,
            layers,
            notes: Vec::new(),
        })
    }

    /// What of a section is the piece's own.
    fn own(
        &self,
        piece: usize,
        frame: Frame,
        level_mm: f64,
        mut regions: Vec<Region>,
        least_mm2: f64,
    ) -> Vec<Region> {
        for later in (piece..self.cuts.len()).rev() {
            if regions.is_empty() {
                break;
            }
            let above = self.above(&self.cuts[later], frame, level_mm, &regions);
            let is_theirs = |region: &Region| self.is_of(region, frame, level_mm, later + 1);
            let taken: Vec<Region> = above.into_iter().filter(is_theirs).collect();
            if !taken.is_empty() {
                regions = difference(&regions, &taken);
                regions.retain(|region| region.area_mm2() >= least_mm2);
            }
        }
        if piece > 0 {
            regions.retain(|region| self.is_of(region, frame, level_mm, piece));
        }
        regions
    }

    /// What of regions of a level lies above a cut.
    fn above(&self, cut: &PartCut, frame: Frame, level_mm: f64, regions: &[Region]) -> Vec<Region> {
        let normal = frame.of_part(cut.direction);
        let along = Vector2::new(normal.x, normal.y);
        let over_mm = |p: Point2| p.coords.dot(&along) + normal.z * level_mm - cut.level_mm;
        let boxes = regions
            .iter()
            .flat_map(|region| [region.bounds().min, region.bounds().max]);
        let bounds = Box2::of(&boxes.collect::<Vec<_>>());
        let middle = bounds.min + 0.5 * bounds.size();
        let reach_mm = bounds.size().norm() + 1.0;
        let Some(across) = along.try_normalize(1e-9) else {
            let is_above = over_mm(middle) > 0.0;
            return if is_above {
                regions.to_vec()
            } else {
                Vec::new()
            };
        };
        // The cut's line passes nearest to the box's middle here.
        let from = middle - across * (over_mm(middle) / along.norm());
        if (from - middle).norm() > reach_mm {
            let is_above = over_mm(middle) > 0.0;
            return if is_above {
                regions.to_vec()
            } else {
                Vec::new()
            };
        }
        let aside = Vector2::new(-across.y, across.x) * (2.0 * reach_mm);
        let ahead = across * (3.0 * reach_mm);
        let half = Region {
            exterior: Ring {
                points: vec![
                    from - aside,
                    from - aside + ahead,
                    from + aside + ahead,
                    from + aside,
                ],
            },
            holes: Vec::new(),
        };
        intersection(regions, &[half])
    }

    /// Whether most voxels of a region belong to a piece.
    fn is_of(&self, region: &Region, frame: Frame, level_mm: f64, piece: usize) -> bool {
        let bounds = region.bounds();
        let size = bounds.size();
        let steps = [size.x, size.y].map(|mm| {
            let count = mm / (0.5 * self.voxels.part.voxel_mm());
            count.ceil().clamp(1.0, ASKED_MAX) as u32
        });
        let share = |step: u32, of: u32| (f64::from(step) + 0.5) / f64::from(of);
        let grid = (0..steps[1]).flat_map(|j| (0..steps[0]).map(move |i| (i, j)));
        let grid = grid.map(|(i, j)| {
            let [x, y] = [share(i, steps[0]) * size.x, share(j, steps[1]) * size.y];
            bounds.min + Vector2::new(x, y)
        });
        let inside: Vec<Point2> = grid.filter(|p| region.contains(*p)).collect();
        let places = match inside.is_empty() {
            true => &region.exterior.points,
            false => &inside,
        };
        let mut votes = [0usize; 2];
        for at in places {
            let place = frame.to_part(Vector3::new(at.x, at.y, level_mm));
            for cell in self.voxels.cells_near(place) {
                votes[usize::from(usize::from(self.owners[cell]) == piece)] += 1;
            }
        }
        votes[1] > votes[0]
    }
}

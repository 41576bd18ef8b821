//! Curved layers of a part: tops that are not flat lose their stairs.
//!
//! ```text
//! Mesh --seen from above--> TopGrid --pieces--> smooth tops --skin--> [PartLayer] --> stair error
//! (mm, on the bed)          (mm)                (mm)                  (flat or curved, regions)
//!   --planned in the plane or in a chart--> moves --one after another--> Route --> as for surfaces
//! ```
//! In: a closed mesh (mm, input coordinates). Out: a [`Plan`] whose layers follow each other as one job: flat layers with so
//! many curved ones over them (`skin`). Leaves out: supports, keep-outs, copies, layers of several heights; curved layers
//! are solid.

mod laid_layer;
pub mod layer_shape;
mod level_zones;
mod one_job;
mod sections;
mod skin;
mod smooth_top;
mod stair_error;
mod top_grid;
mod upright;

pub use crate::settings::curved_layers::CurvedLayers;
pub use upright::EdgeDepth;

use super::laid_ground::open_places;
use crate::geometry::polygon::Region;
use crate::mesh::slice::Slicer;
use crate::mesh::{Mesh, Point3};
use crate::pipeline::open_ground::OpenGround;
use crate::pipeline::{Plan, PlanError};
use crate::plan::judge::ground_sweep::LayerSwept;
use crate::plan::layers::hollow::SPAN_BEADS_MAX;
use crate::plan::layers::shells::overhangs;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::progress::Progress;
use crate::settings::{LAYERS_MAX, Settings};
use crate::text::refusal::{Refusal, refusal};
use layer_shape::PartLayer;
use rayon::prelude::*;
use smooth_top::FollowedTop;
use top_grid::{Piece, TopGrid};

/// Least area of a piece of the top, of the nozzle's half length squared: room for a few beads.
const PIECE_AREA: f64 = 16.0;
/// What curved layers come to.
#[derive(Clone, Debug, Default)]
pub struct CurvedFigures {
    /// Layers that are flat, and that are curved.
    pub layers: [u32; 2],
    /// Volume between the printed top and the part's, with flat layers and as planned, mm³.
    pub stair_error_mm3: [f64; 2],
    /// Least and greatest thickness of curved layers, of the nominal one.
    pub thickness: [f64; 2],
    /// Steepest slope of one, rad.
    pub slope_max_rad: f64,
    /// How deep the nozzle's edge gets below the top of the layer that it prints, where the head stays upright.
    pub edge_depth: Option<EdgeDepth>,
    /// What of the part hangs farther than half a bead over what is below, mm², and the worst place, input coordinates.
    pub hanging: Option<(f64, [f64; 3])>,
    /// What was covered of curved layers.
    pub swept: Vec<LayerSwept>,
    /// Boundary that is not reached, input coordinates.
    pub unreachable: Vec<UnreachableRun>,
}

impl CurvedFigures {
    /// Open places of curved layers, the largest first.
    pub fn open_ground(&self) -> Vec<OpenGround> {
        open_places(&self.swept)
    }
}

/// A part on its way.
struct Job<'a> {
    mesh: Mesh,
    grid: TopGrid,
    layer_mm: f64,
    /// Where the mesh stood, mm.
    bed_mm: f64,
    settings: &'a Settings,
}

/// A part divided into layers.
#[derive(Clone, Debug)]
pub struct DividedPart {
    /// Its layers, in the order that they are printed in; heights are those above the bed, mm.
    pub layers: Vec<PartLayer>,
    /// What they come to.
    pub figures: CurvedFigures,
}

/// Plans a part in curved layers.
///
/// # Errors
/// [`PlanError`], of the layers a `Refusal`.
pub fn plan_curved_layers(
    mesh: &Mesh,
    asked: CurvedLayers,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    settings.check()?;
    let bed_mm = mesh.bounds_mm()[0].z;
    let divided = divided(mesh, asked, settings)?;
    one_job::planned(&divided.layers, bed_mm, divided.figures, settings, progress)
}

/// Divides a part into layers, some of them curved; nothing is planned.
///
/// # Errors
/// A `Refusal`.
pub fn divided(
    mesh: &Mesh,
    CurvedLayers::Skin(skin_layers): CurvedLayers,
    settings: &Settings,
) -> Result<DividedPart, Refusal> {
    let job = Job::of(mesh, settings)?;
    job.check_settings()?;
    let pieces = job.pieces()?.into_par_iter();
    let tops: Vec<FollowedTop> = pieces.map(|piece| FollowedTop::of(&job, piece)).collect();
    let layers = skin::layers_with_skin(&job, &tops, skin_layers)?;
    let bounds = stair_error::bounds(&job.grid, &layers, job.layer_mm);
    let curved = layers.iter().filter(|layer| layer.is_curved()).count() as u32;
    Ok(DividedPart {
        figures: CurvedFigures {
            layers: [layers.len() as u32 - curved, curved],
            stair_error_mm3: [
                stair_error::of_flat_layers(&job.grid, job.layer_mm),
                stair_error::of_layers(&job.grid, &layers),
            ],
            thickness: bounds.thickness,
            slope_max_rad: bounds.slope.atan(),
            hanging: job.hanging(),
            ..CurvedFigures::default()
        },
        layers,
    })
}

impl<'a> Job<'a> {
    fn of(mesh: &Mesh, settings: &'a Settings) -> Result<Job<'a>, Refusal> {
        let bed_mm = mesh.bounds_mm()[0].z;
        let vertices = mesh.vertices.iter();
        let mesh = Mesh {
            vertices: vertices
                .map(|p| Point3::new(p.x, p.y, p.z - bed_mm))
                .collect(),
            triangles: mesh.triangles.clone(),
        };
        let grid = TopGrid::of(&mesh, settings.aperture.unit_mm());
        let layer_mm = settings.layer_height_mm;
        let layers = (grid.highest_mm() / layer_mm).round();
        if layers > f64::from(LAYERS_MAX) {
            return Err(refusal!(
                "--curved-layers: {layers} layers, and a job has at most {LAYERS_MAX}: use a greater --layer-height"
            ));
        }
        Ok(Job {
            mesh,
            grid,
            layer_mm,
            bed_mm,
            settings,
        })
    }

    /// Tangent of the steepest slope that is followed.
    fn slope_max(&self) -> f64 {
        let head = self.settings.head.as_ref();
        let free_tilt_rad = head.map_or(FREE_TILT_UNKNOWN_RAD, |head| head.free_tilt_rad());
        match self.settings.tilts() {
            true => free_tilt_rad.tan().min(SLOPE_MAX),
            false => {
                let slope_max = level_zones::slope_max(&self.settings.aperture, self.layer_mm);
                // A flat end that is wider than the aperture goes into what is printed beside it.
                let of_tip = head.map_or(f64::INFINITY, |head| {
                    head.tip_slack_mm(self.layer_mm) / head.profile().tip_radius_mm().max(1e-9)
                });
                slope_max.min(of_tip).min(SLOPE_MAX)
            }
        }
    }

    /// What hangs, as flat layers would have it.
    fn hanging(&self) -> Option<(f64, [f64; 3])> {
        let count = (self.grid.highest_mm() / self.layer_mm + 0.5).floor() as u32;
        let middles = (0..count).map(|number| self.layer_mm * (f64::from(number) + 0.5));
        let sections = Slicer::new(&self.mesh).sections(&middles.collect::<Vec<_>>());
        let outlines: Vec<&[Region]> = sections.iter().map(|s| s.regions.as_slice()).collect();
        let reach_mm = self.settings.aperture.major_mm();
        let hanging = overhangs(&outlines, |_| Vec::new(), |_| Vec::new(), reach_mm);
        let all_mm2: f64 = hanging.iter().map(|of_layer| of_layer.area_mm2).sum();
        let worst = hanging.iter().enumerate();
        let worst = worst.max_by(|a, b| a.1.area_mm2.total_cmp(&b.1.area_mm2));
        let (number, worst) = worst.filter(|(_, worst)| worst.area_mm2 > 0.0)?;
        let z_mm = self.bed_mm + self.layer_mm * number as f64;
        Some((all_mm2, [worst.at.x, worst.at.y, z_mm]))
    }

    fn pieces(&self) -> Result<Vec<Piece>, Refusal> {
        let area_min_mm2 = PIECE_AREA * self.settings.aperture.major_mm().powi(2);
        let pieces = self
            .grid
            .pieces(self.slope_max(), area_min_mm2, self.layer_mm);
        match pieces.is_empty() {
            true => Err(refusal!(
                "--curved-layers: the part has no top that curved layers follow: tops are flat at whole layers, steeper than \
                 {:.1}°, or smaller than {area_min_mm2:.1} mm²; leave --curved-layers out",
                self.slope_max().atan().to_degrees()
            )),
            false => Ok(pieces),
        }
    }

    /// Whether the settings go with curved layers, and the inside that is asked for can be had.
    fn check_settings(&self) -> Result<(), Refusal> {
        if self.settings.wide_beads.continuous_z {
            return Err(refusal!(
                "--curved-layers: layers that follow the top do not rise along a bead: leave --continuous-z out, or \
                 --curved-layers"
            ));
        }
        let least_pct = 100.0 / SPAN_BEADS_MAX;
        match &self.settings.infill {
            Some(infill) if infill.density_pct < least_pct => Err(refusal!(
                "--curved-layers: an infill of {} % does not hold solid layers above it, and no bridges are made under curved \
                 ones: give --infill-density {least_pct:.0} or more",
                infill.density_pct
            )),
            _ => Ok(()),
        }
    }
}

/// Free tilt of a head whose shape is not in the machine file, rad, and the steepest slope that is followed whatever the head.
const FREE_TILT_UNKNOWN_RAD: f64 = 30.0 * std::f64::consts::PI / 180.0;
const SLOPE_MAX: f64 = 1.0;

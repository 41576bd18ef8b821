//! Curved layers of a part: tops that are not flat lose their stairs.
//!
//! ```text
//! Mesh --seen from above--> TopGrid --pieces--> smooth tops --skin or field--> [PartLayer] --> stair error
//! (mm, on the bed)          (mm)                (mm)                         (flat or curved, regions)
//!   --planned in the plane or in a chart--> moves --one after another--> Route --> as for surfaces
//! ```
//! In: a closed mesh (mm, input coordinates). Out: a [`Plan`] whose layers follow each other as one job. **Skin**: flat layers with so
//! many curved ones over them ([`skin`]). Leaves out: supports, keep-outs, copies, layers of several heights; the inside is solid.

mod error;
mod laid_layer;
mod layer_shape;
mod one_job;
mod sections;
mod skin;
mod stair_error;
mod top_grid;

pub use error::CurvedLayersError;

use crate::geometry::polygon::Box2;
use crate::geometry::spline_surface::SplineSurface;
use crate::mesh::{Mesh, Point3};
use crate::open_ground::OpenGround;
use crate::plan::judge::ground_sweep::LayerSwept;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::progress::Progress;
use crate::settings::{LAYERS_MAX, Settings};
use crate::{Plan, PlanError};
use super::laid_ground::open_places;
use layer_shape::PartLayer;
use stair_error::Bounds;
use top_grid::{Piece, TopGrid};

/// Least area of a piece of the top, of the nozzle's half length squared: room for a few beads.
const PIECE_AREA: f64 = 16.0;
/// A smooth top is as coarse as it may be while it is this near to the mesh, of a layer; its least pitches, of the unit, the first at
/// which the nozzle lies in its hollows; pieces of a spline's coarsest grid; and how far it goes on beyond a piece, of the
/// nozzle's half length.
const NEAR: f64 = 0.01;
const PITCHES: [f64; 3] = [0.9, 1.2, 1.6];
const COARSEST: f64 = 4.0;
const AROUND: f64 = 12.0;
/// How deep the ends of a flat nozzle, or of its tip, may be in a hollow, of a layer.
const HOLLOW_SHARE: f64 = 0.45;
/// Curved layers of a skin, where nobody says how many.
pub const SKIN_LAYERS: u32 = 3;

/// Which layers are curved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CurvedLayers {
    /// All or a skin, by the stair error that is left.
    #[default]
    Auto,
    /// All of them.
    All,
    /// So many on top of flat ones.
    Skin(u32),
}

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
pub struct Job<'a> {
    mesh: Mesh,
    grid: TopGrid,
    layer_mm: f64,
    settings: &'a Settings,
}

/// A part divided.
struct Divided {
    layers: Vec<PartLayer>,
    stair_error_mm3: f64,
    bounds: Bounds,
}

/// Plans a part in curved layers.
///
/// # Errors
/// [`PlanError`], of the layers [`CurvedLayersError`].
pub fn plan_curved_layers(
    mesh: &Mesh,
    asked: CurvedLayers,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    settings.check()?;
    let bed_mm = mesh.bounds_mm()[0].z;
    let job = Job::of(mesh, bed_mm, settings)?;
    let divided = job.divided(asked)?;
    let flat_mm3 = stair_error::of_flat_layers(&job.grid, job.layer_mm);
    let curved = divided.layers.iter().filter(|layer| layer.is_curved()).count() as u32;
    let figures = CurvedFigures {
        layers: [divided.layers.len() as u32 - curved, curved],
        stair_error_mm3: [flat_mm3, divided.stair_error_mm3],
        thickness: divided.bounds.thickness,
        slope_max_rad: divided.bounds.slope.atan(),
        ..CurvedFigures::default()
    };
    one_job::planned(&divided.layers, bed_mm, figures, settings, progress)
}

impl<'a> Job<'a> {
    fn of(mesh: &Mesh, bed_mm: f64, settings: &'a Settings) -> Result<Job<'a>, CurvedLayersError> {
        let vertices = mesh.vertices.iter();
        let mesh = Mesh {
            vertices: vertices.map(|p| Point3::new(p.x, p.y, p.z - bed_mm)).collect(),
            triangles: mesh.triangles.clone(),
        };
        let grid = TopGrid::of(&mesh, settings.aperture.unit_mm());
        let layer_mm = settings.layer_height_mm;
        let layers = (grid.highest_mm() / layer_mm).round();
        if layers > f64::from(LAYERS_MAX) {
            let most = LAYERS_MAX;
            return Err(CurvedLayersError::TooManyLayers { layers, most });
        }
        Ok(Job {
            mesh,
            grid,
            layer_mm,
            settings,
        })
    }

    /// Tangent of the steepest slope that is followed.
    fn slope_max(&self) -> f64 {
        let head = self.settings.head.as_ref();
        let free_tilt_rad = head.map_or(FREE_TILT_UNKNOWN_RAD, |head| head.free_tilt_rad());
        free_tilt_rad.tan().min(SLOPE_MAX)
    }

    /// The sharpest hollow that nozzle and tip lie in.
    fn hollow_max_per_mm(&self) -> f64 {
        let head = self.settings.head.as_ref();
        let tip_mm = head.map_or(0.0, |head| head.profile().tip_radius_mm());
        let half_mm = self.settings.aperture.major_mm().max(tip_mm);
        2.0 * HOLLOW_SHARE * self.layer_mm / (half_mm * half_mm)
    }

    fn pieces(&self) -> Result<Vec<Piece>, CurvedLayersError> {
        let area_min_mm2 = PIECE_AREA * self.settings.aperture.major_mm().powi(2);
        let pieces = self.grid.pieces(self.slope_max(), area_min_mm2, self.layer_mm);
        match pieces.is_empty() {
            true => Err(CurvedLayersError::NoCurvedTop {
                slope_max_deg: self.slope_max().atan().to_degrees(),
                area_min_mm2,
            }),
            false => Ok(pieces),
        }
    }

    fn divided(&self, asked: CurvedLayers) -> Result<Divided, CurvedLayersError> {
        let pieces = self.pieces()?;
        let layers = match asked {
            CurvedLayers::Skin(count) => skin::layers_with_skin(self, &pieces, count)?,
            CurvedLayers::Auto | CurvedLayers::All => {
                skin::layers_with_skin(self, &pieces, SKIN_LAYERS)?
            }
        };
        Ok(self.judged(layers))
    }

    fn judged(&self, layers: Vec<PartLayer>) -> Divided {
        Divided {
            stair_error_mm3: stair_error::of_layers(&self.grid, &layers),
            bounds: stair_error::bounds(&self.grid, &layers, self.layer_mm),
            layers,
        }
    }
}

/// Free tilt of a head whose shape is not in the machine file, rad, and the steepest slope that is followed whatever the head.
const FREE_TILT_UNKNOWN_RAD: f64 = 30.0 * std::f64::consts::PI / 180.0;
const SLOPE_MAX: f64 = 1.0;

/// A smooth surface through places of a piece: where a flat nozzle would not lie in its hollows, a coarser one.
fn fitted(points: &[[f64; 3]], job: &Job) -> SplineSurface {
    let around_mm = AROUND * job.settings.aperture.major_mm();
    let corners = points.iter().map(|p| [p[0], p[1]].into());
    let bounds = Box2::of(&corners.collect::<Vec<_>>()).grown(around_mm);
    let finest_mm = (PITCHES[0] * job.settings.aperture.unit_mm()).max(2.0 * job.grid.step_mm);
    let near_mm = NEAR * job.layer_mm;
    let mut finest = None;
    for pitch in PITCHES {
        let pitch_mm = finest_mm * pitch / PITCHES[0];
        // A box as wide as the pitch times a power of two: halving leads to the pitch itself.
        let size = bounds.size();
        let halvings = (size.x.max(size.y) / (COARSEST * pitch_mm)).log2().ceil();
        let side_mm = COARSEST * pitch_mm * halvings.exp2();
        let wide = bounds.grown(0.5 * (side_mm - size.x.max(size.y)).max(0.0));
        let Some(fitted) = SplineSurface::through(points, wide, near_mm, 0.99 * pitch_mm) else {
            continue;
        };
        let hollow = points.iter().map(|p| hollow_per_mm(&fitted.surface, p));
        if hollow.fold(0.0, f64::max) <= job.hollow_max_per_mm() {
            return fitted.surface;
        }
        finest.get_or_insert(fitted.surface);
    }
    // There are points: a piece has cells.
    finest.unwrap_or_else(|| SplineSurface::level(bounds, finest_mm))
}

/// The sharpest hollow bend at a place, 1/mm, about: of the heights, whose slopes are gentle.
fn hollow_per_mm(surface: &SplineSurface, p: &[f64; 3]) -> f64 {
    let [xx, xy, yy] = surface.jet(p[0], p[1]).bend;
    0.5 * (xx + yy) + (0.5 * (xx - yy)).hypot(xy)
}

//! A surface that is cut into patches, planned one by one and joined to one job.
//!
//! ```text
//! Mesh --divide--> [Share] --chart, each reaching over its seams--> [PlannedPatch] --route in the chart, on the surface-->
//! (mm)             (mm)                                            (mm)
//!   [RouteMove] --join, layer by layer--> [RouteMove] --as for one patch--> Plan
//!   (mm, rad, mm³)
//! ```
//! In: a mesh with rims (mm, input coordinates). Out: a [`Plan`]. Seams are planes across the axes; the ground of each patch
//! reaches over them by [`OVER_SEAM`], so that beads of both overlap there. What is covered is measured on each patch's
//! own share with the passes of all of them. Not covered: outlines drawn on such a mesh, skirts.

mod divide;
mod join;

use super::laid_ground::{Seams, in_space, region_within};
use super::patch_ground::{charted, normals};
use super::{ChartJob, Held, OnSurface, PlacedRoute, Routed, passes_of, placed};
use crate::geometry::chart::PatchChart;
use crate::geometry::conformal::FlattenError;
use crate::geometry::polygon::Region;
use crate::geometry::validity::validate;
use crate::job::SegmentStream;
use crate::job::transform::PartTransform;
use crate::mesh::Mesh;
use crate::mesh::patch::rims;
use crate::mesh::split::Clipped;
use crate::pipeline::surface::error::{SurfaceError, not_flat};
use crate::pipeline::{Plan, PlanError};
use crate::plan::judge::figures::Swept;
use crate::plan::judge::ground_sweep::{CurvedGround, Joined, LayerSwept, sweep_ground};
use crate::plan::judge::measure::measure;
use crate::plan::motion::segments::lay_segments_with_progress;
use crate::plan::progress::Progress;
use crate::settings::Settings;
use crate::text::refusal::refusal;
use divide::{Share, divided, from_seam_mm, ground_of};
use join::Join;

/// How far the ground of a patch reaches over a seam, of the nozzle's half length.
const OVER_SEAM: f64 = 0.02;
/// Ground beside a patch that its chart covers as well, of the nozzle's reach.
const BESIDE: f64 = 2.0;

/// A patch on its way.
struct PlannedPatch {
    share: Share,
    laid: OnSurface,
    /// Its share of the ground, in the chart.
    region: Vec<Region>,
    routed: Routed,
}

/// A patch before it is planned.
struct Ground {
    laid: OnSurface,
    job: ChartJob,
    /// Its share of the ground, in the chart.
    region: Vec<Region>,
}

/// Plans a mesh in patches; `None` where it needs none, or where no patches are found.
///
/// # Errors
/// [`PlanError`], of the surface [`SurfaceError`].
pub fn planned(
    mesh: &Mesh,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Option<Plan>, PlanError> {
    let margin_mm = BESIDE * settings.aperture.reach_mm();
    let shares = divided(mesh, margin_mm)?;
    let Some(shares) = shares.filter(|shares| shares.len() > 1) else {
        return Ok(None);
    };
    if settings.skirt.loops > 0 || settings.skirt.brim_loops > 0 {
        let patches = shares.len();
        return Err(SurfaceError::Refused(refusal!(
            "the surface is cut into {patches} patches, around which no skirt or brim is \
             planned: leave it out, or print the surface in parts that flatten"
        ))
        .into());
    }
    // What cannot be laid is found before any of it is planned.
    let grounds = shares.iter().map(|share| laid_share(mesh, share, settings));
    let grounds = grounds.collect::<Result<Vec<_>, _>>()?;
    let mut patches = Vec::with_capacity(shares.len());
    for (share, ground) in shares.into_iter().zip(grounds) {
        let routed = ground.job.routed(&ground.laid, settings, progress)?;
        patches.push(PlannedPatch {
            share,
            laid: ground.laid,
            region: ground.region,
            routed,
        });
    }
    let mut join = Join::over(mesh, normals(mesh), settings);
    for layer in 0..settings.layers {
        for (number, patch) in patches.iter().enumerate() {
            join.add(number, &patch.routed.moves, layer)?;
        }
    }
    laid_out(mesh, patches, join, settings, progress).map(Some)
}

/// The chart of a share, what is planned in it, and the share itself in the chart.
fn laid_share(mesh: &Mesh, share: &Share, settings: &Settings) -> Result<Ground, SurfaceError> {
    let margin_mm = BESIDE * settings.aperture.reach_mm();
    let (ground, _) = ground_of(mesh, &share.own, margin_mm);
    let (chart, _) = charted(&ground, settings)?;
    let over = over_seams(mesh, share, settings)?;
    let region = region_in(&over.mesh, &chart)?;
    let mut job = ChartJob {
        around: vec![region.clone()],
        regions: vec![region],
        keep_out: Vec::new(),
        kept_out_mm2: 0.0,
    };
    let off = (chart.off_mm, chart.off_at_mm.into());
    let laid = OnSurface::on(chart, off, &mut job, settings)?;
    let own = region_in(&share.own.mesh, &laid.chart)?;
    Ok(Ground {
        laid,
        job,
        region: vec![own],
    })
}

/// The share with what it reaches over its seams.
fn over_seams(mesh: &Mesh, share: &Share, settings: &Settings) -> Result<Clipped, SurfaceError> {
    let by_mm = OVER_SEAM * settings.aperture.major_mm();
    let planes = share.planes.iter().map(|plane| plane.moved(by_mm));
    let all = planes.fold(Clipped::whole(mesh), |all, plane| all.clipped(&plane));
    // Of what lies between these planes the part that has the most of its triangles.
    let shared = |part: &Clipped| {
        let is_own = |of: &&u32| share.own.source.binary_search(of).is_ok();
        part.source.iter().filter(is_own).count()
    };
    let parts = all.connected()?.into_iter();
    let best = parts.max_by_key(shared);
    Ok(best.unwrap_or_else(|| share.own.clone()))
}

/// A part of the mesh as a region of a chart.
fn region_in(part: &Mesh, chart: &PatchChart) -> Result<Region, SurfaceError> {
    let rims = rims(part)?;
    let rings = rims.iter().map(|rim| {
        let points = rim
            .iter()
            .map(|vertex| part.vertices[*vertex as usize].coords);
        in_space(&points.collect::<Vec<_>>(), chart)
    });
    let at_mm = part
        .vertices
        .first()
        .copied()
        .unwrap_or_default()
        .coords
        .into();
    let not_flat = not_flat(FlattenError::Empty, at_mm);
    let region = region_within(rings.collect()).filter(|region| validate(region).is_ok());
    region.ok_or(not_flat)
}

/// The motion of joined patches, and what it covers.
fn laid_out(
    mesh: &Mesh,
    patches: Vec<PlannedPatch>,
    join: Join,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    let PlacedRoute {
        route,
        transform,
        found_place,
        singular,
        touches,
    } = placed(&join.moves, (mesh, Held::Sheet), settings)?;
    let (stream, motion) = lay_segments_with_progress(&route, settings, progress)?;
    let (mut figures, measured) = measure(&stream, &[], &[], &transform, settings, progress);
    figures.passes = passes_of(&route);
    let judged = judged(
        &patches,
        &join.patch_of_pass,
        (&stream, &transform),
        settings,
    );
    let seams = Seams {
        patches: patches.len(),
        length_mm: seam_mm(&patches),
        open_mm2: open_at_seams_mm2(&patches, &judged, settings),
    };
    let mut layers: Vec<LayerSwept> = judged.into_iter().flatten().collect();
    layers.sort_by_key(|layer| layer.layer);
    let numbers: Vec<u32> = layers.iter().map(|swept| swept.layer).collect();
    let swept: Vec<Swept> = layers.iter().map(|layer| layer.swept).collect();
    figures.set_shares(&numbers, &swept);
    let mut left_out = Vec::new();
    let mut grounds = Vec::new();
    for mut patch in patches {
        left_out.append(&mut patch.routed.left_out);
        patch.laid.unreachable = patch.routed.unreachable;
        grounds.push(patch.laid);
    }
    let together = OnSurface::together(grounds);
    Ok(Plan {
        transform,
        found_place,
        singular,
        touches,
        on_surface: together.map(|together| OnSurface {
            layers,
            seams: Some(seams),
            ..together
        }),
        left_out,
        route,
        stream,
        motion,
        measured,
        figures,
        ..Plan::default()
    })
}

/// What is covered of each patch's share, layer by layer.
fn judged(
    patches: &[PlannedPatch],
    patch_of_pass: &[usize],
    (stream, transform): (&SegmentStream, &PartTransform),
    settings: &Settings,
) -> Vec<Vec<LayerSwept>> {
    let of_patches = patches.iter().enumerate().map(|(number, patch)| {
        let of_pass = |pass: u32| patch_of_pass.get(pass as usize).copied();
        let is_beside = |pass: u32| of_pass(pass).is_some_and(|of| of != number);
        let ground = CurvedGround {
            chart: &*patch.laid.chart,
            scale: &patch.laid.scale,
            regions: &patch.laid.regions,
            transform,
            lowest_layer: 0,
            joined: Some(Joined {
                share: &patch.region,
                is_beside: &is_beside,
            }),
        };
        sweep_ground(
            stream,
            &ground,
            |pass| of_pass(pass) == Some(number),
            settings,
        )
    });
    of_patches.collect()
}

/// Length of the seams, each counted once.
fn seam_mm(patches: &[PlannedPatch]) -> f64 {
    let of_patches = patches.iter().flat_map(|patch| {
        let share = &patch.share;
        let planes = share.planes.iter();
        planes.map(|plane| share.own.length_on_mm(plane))
    });
    0.5 * of_patches.sum::<f64>()
}

/// Open ground no farther from a seam than half a nozzle is long.
fn open_at_seams_mm2(
    patches: &[PlannedPatch],
    judged: &[Vec<LayerSwept>],
    settings: &Settings,
) -> f64 {
    let near_mm = settings.aperture.major_mm();
    let of_patches = patches.iter().zip(judged).flat_map(|(patch, layers)| {
        let open = layers.iter().flat_map(|layer| &layer.open);
        let near = open.filter(|place| from_seam_mm(&patch.share, place.at_mm.into()) < near_mm);
        near.map(|place| place.area_mm2)
    });
    of_patches.sum()
}

//! A mesh and a machine -> how much of the part can be printed at most, before any planning ([`headway_reach::space`]).
//!
//! ```text
//! mesh --voxels--> cells ---+
//! machine --joints--> mask -+--space--> by tilt: found, at most --left_out--> the largest places left out, and why
//! aperture, head, obstacles +
//! ```
//! Lengths in mm, angles in rad; places in the part's coordinates. Leaves out what is smaller than a voxel.

mod joints;
mod left_out;
mod voxels;

use crate::geometry::Vector2;
use crate::geometry::polygon::Box2;
use crate::job::transform::PartTransform;
use crate::mesh::{LoadedMesh, Mesh};
use crate::pipeline::pieces::pieces_found;
use crate::settings::Settings;
use crate::text::refusal::{Refusal, refusal};
use headway_reach::Vector3;
use headway_reach::profile::HeadProfile;
use headway_reach::space::{self, LeftOut, POSES_MAX, Reach, Rules, Space};
pub(super) use joints::Joints;
pub use left_out::LeftOutPlace;
use rayon::prelude::*;
use serde::Serialize;
pub(super) use voxels::Voxels;

/// Voxels of the part's box where no size is given.
const BOX_VOXELS: f64 = 1e5;
/// Most voxels along an axis, and of a box.
const SIDE_MAX: f64 = 1000.0;
const BOX_MAX: f64 = 1.2e7;
/// Share of a voxel that is under the flat end, not in the head: less, and rounding on the grid blocks poses.
pub(super) const SLACK_SHARE: f64 = 0.3;
/// Self-support where the material does not say it.
const SELF_SUPPORT_DEG: f64 = 45.0;
/// Headings in half a turn.
pub(super) const HEADINGS: u32 = 8;

/// What is asked.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReachOptions {
    /// Side of a voxel; `None`: 100,000 in the part's box.
    pub voxel_mm: Option<f64>,
    /// Largest tilt; `None`: what the joints permit.
    pub tilt_max_rad: Option<f64>,
}

/// Shares up to a tilt.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ReachLevel {
    /// The largest tilt.
    pub tilt_deg: f64,
    /// What an order that works prints, per cent of the part.
    pub found_pct: f64,
    /// No order prints more, per cent of the part.
    pub bound_pct: f64,
}

/// A direction of an order, from the tip into the head.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ReachDirection {
    /// From Z.
    pub tilt_deg: f64,
    /// From X, counter-clockwise.
    pub azimuth_deg: f64,
    /// Of the order's steps.
    pub share_pct: f64,
}

/// How much of a part can be printed with material laid voxel by voxel: no plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartReach {
    /// What the aperture alone covers, per cent of the part.
    pub aperture_pct: f64,
    /// Up to that tilt an order by height is free of collisions.
    pub free_tilt_deg: f64,
    /// Found without tilt.
    pub upright_pct: f64,
    /// Found with all tilts that are permitted.
    pub found_pct: f64,
    /// No order prints more.
    pub bound_pct: f64,
    /// By tilt, the lowest first.
    pub levels: Vec<ReachLevel>,
    /// Those of the last order, the most frequent first.
    pub directions: Vec<ReachDirection>,
    /// The largest places that it leaves out.
    pub left_out: Vec<LeftOutPlace>,
    /// Into which `plan --directions auto` divides it; `None`: head and table do not tilt, or the search is too large.
    pub pieces: Option<usize>,
    /// Side of a voxel.
    pub voxel_mm: f64,
    /// What was assumed.
    pub notes: Vec<String>,
    /// Cells of the grid along x, y, z.
    #[serde(skip)]
    pub(crate) size: [usize; 3],
    /// Cells, each with the first level that prints it.
    #[serde(skip)]
    pub(crate) cells: Vec<([u16; 3], Option<usize>)>,
}

/// The reach of a closed mesh on a machine.
///
/// # Errors
/// A `Refusal`: the part is outside the work area, or the voxel does not fit.
pub fn part_reach(
    mesh: &LoadedMesh,
    settings: &Settings,
    options: &ReachOptions,
) -> Result<PartReach, Refusal> {
    let [low, high] = mesh.bounds_mm();
    let [min, max] = [low.xy(), high.xy()];
    let transform = PartTransform::choose_box(Box2 { min, max }, [low.z, high.z], settings)?;
    let offset_mm = Vector3::from(transform.offset_mm);
    let head = settings.head.as_ref();
    let profile = head.map_or_else(HeadProfile::line, |head| head.profile());
    let box_mm = [low.coords, high.coords];
    let joints = Joints::new(settings, box_mm.map(|corner| corner + offset_mm), HEADINGS);
    let tilt_rad = options.tilt_max_rad.unwrap_or(f64::INFINITY);
    let tilt_rad = tilt_rad.min(joints.tilt_max_rad());
    let axes = space::directions(tilt_rad, profile.free_tilt_rad());
    let volume_mm3: f64 = mesh.solids().map(Mesh::volume_mm3).sum();
    let voxel_mm = checked_voxel_mm(options.voxel_mm, high - low, volume_mm3, axes.len())?;
    let voxels = Voxels::new(mesh, &settings.obstacles, offset_mm, voxel_mm)?;
    let permitted = joints.permitted(&axes);
    let aperture = &settings.aperture;
    let turn = |n: u32| aperture.period_rad() * f64::from(n) / f64::from(HEADINGS);
    let rules = Rules {
        head: &profile,
        slack_mm: SLACK_SHARE * voxel_mm,
        self_support_rad: self_support_rad(settings),
        aperture: space::Aperture {
            headings_rad: (0..HEADINGS).map(turn).collect(),
            reach_mm: aperture.reach_mm(),
            contains: &|[x, y]| aperture.contains_in_tool(Vector2::new(x, y)),
        },
        allowed: &|cell, direction| {
            let tip_mm = || voxels.tip_mm(cell, &axes[direction]) + offset_mm;
            permitted[direction].unwrap_or_else(|| joints.permit(tip_mm(), &axes[direction]))
        },
    };
    let part = &voxels.part;
    let tables = Space::new(part, &axes, &rules);
    let tables = tables.map_err(|_| {
        refusal!("a voxel of {voxel_mm:.3} mm makes too many of the part: give a larger --voxel")
    })?;
    let tilts = levels(tilt_rad, profile.free_tilt_rad());
    let up_to = |&tilt_rad: &f64| {
        let is_in = |axis: &Vector3| axis.z >= (tilt_rad + 1e-6).cos();
        let bits = (0..).zip(&axes).filter(|(_, axis)| is_in(axis));
        tables.reach(bits.fold(0, |mask, (bit, _): (u32, _)| mask | 1 << bit))
    };
    let mut reaches: Vec<Reach> = tilts.par_iter().map(up_to).collect();
    keep_larger(&mut reaches);
    let mut notes = Vec::new();
    if head.is_none() {
        notes.push(
            "the machine file has no [head]: nothing but the aperture's centre line is checked"
                .to_string(),
        );
    }
    let free_tilt_rad = profile.free_tilt_rad();
    Ok(PartReach {
        pieces: pieces_found(mesh, settings),
        notes,
        ..of_levels(&tilts, &reaches, &axes, &voxels, free_tilt_rad)
    })
}

/// The angle of self-support of the material.
pub(super) fn self_support_rad(settings: &Settings) -> f64 {
    let given = settings.material.and_then(|own| own.self_support_deg);
    given.unwrap_or(SELF_SUPPORT_DEG).to_radians()
}

/// What a smaller tilt can do, a larger one can.
fn keep_larger(reaches: &mut [Reach]) {
    for level in 1..reaches.len() {
        if reaches[level].steps.len() < reaches[level - 1].steps.len() {
            let smaller = reaches[level - 1].clone();
            reaches[level].steps = smaller.steps;
            reaches[level].left_out = smaller.left_out;
        }
    }
}

fn of_levels(
    tilts: &[f64],
    reaches: &[Reach],
    axes: &[Vector3],
    voxels: &Voxels,
    free_tilt_rad: f64,
) -> PartReach {
    let part = &voxels.part;
    let count = part.cells().len();
    let pct = |cells: usize| 100.0 * cells as f64 / count as f64;
    let level = |(tilt_rad, reach): (&f64, &Reach)| ReachLevel {
        tilt_deg: tilt_rad.to_degrees(),
        found_pct: pct(reach.steps.len()),
        bound_pct: pct(reach.at_most.iter().filter(|laid| **laid).count()),
    };
    let levels: Vec<ReachLevel> = tilts.iter().zip(reaches).map(level).collect();
    let [first, last] = [levels[0], levels[levels.len() - 1]];
    let reach = &reaches[reaches.len() - 1];
    let by_aperture = |why: &&Option<LeftOut>| **why == Some(LeftOut::Aperture);
    let mut uses = vec![0; axes.len()];
    for step in &reach.steps {
        uses[usize::from(step.direction)] += 1;
    }
    let used = axes.iter().zip(uses).filter(|(_, uses)| *uses > 0);
    let direction = |(axis, uses): (&Vector3, usize)| ReachDirection {
        tilt_deg: axis.z.clamp(-1.0, 1.0).acos().to_degrees(),
        azimuth_deg: axis.y.atan2(axis.x).to_degrees(),
        share_pct: 100.0 * uses as f64 / reach.steps.len() as f64,
    };
    let mut directions: Vec<ReachDirection> = used.map(direction).collect();
    directions.sort_by(|a, b| b.share_pct.total_cmp(&a.share_pct));
    let cells = part.cells().iter().enumerate();
    let lowest = |cell: usize| {
        reaches
            .iter()
            .position(|reach| reach.left_out[cell].is_none())
    };
    PartReach {
        aperture_pct: 100.0 - pct(reach.left_out.iter().filter(by_aperture).count()),
        free_tilt_deg: free_tilt_rad.to_degrees(),
        upright_pct: first.found_pct,
        found_pct: last.found_pct,
        bound_pct: last.bound_pct,
        levels,
        directions,
        left_out: left_out::places(voxels, &reach.left_out),
        pieces: None,
        voxel_mm: part.voxel_mm(),
        notes: Vec::new(),
        size: part.size(),
        cells: cells.map(|(cell, &at)| (at, lowest(cell))).collect(),
    }
}

/// The tilts of the table: none, half of all, the head's free one, all.
fn levels(tilt_rad: f64, free_tilt_rad: f64) -> Vec<f64> {
    let mut tilts = vec![0.0, 0.5 * tilt_rad, free_tilt_rad.min(tilt_rad), tilt_rad];
    tilts.sort_by(f64::total_cmp);
    tilts.dedup_by(|a, b| (*a - *b).abs() < 0.02);
    tilts
}

/// The voxel that was asked for, or the usual one, if the grid is not too large.
fn checked_voxel_mm(
    asked_mm: Option<f64>,
    size_mm: Vector3,
    volume_mm3: f64,
    directions: usize,
) -> Result<f64, Refusal> {
    let fits = |voxel_mm: f64| {
        let poses = volume_mm3 / voxel_mm.powi(3) * directions as f64;
        let voxels = size_mm.iter().map(|mm| mm / voxel_mm + 18.0);
        let rows = 4.0 * size_mm.y * size_mm.z / voxel_mm.powi(2) * directions as f64;
        poses.max(rows) < 0.95 * POSES_MAX as f64
            && size_mm.max() < SIDE_MAX * voxel_mm
            && voxels.product::<f64>() < BOX_MAX
    };
    let mut fitting_mm = (size_mm.product() / BOX_VOXELS).cbrt();
    // Each round has a quarter fewer.
    while !fits(fitting_mm) && fitting_mm < size_mm.max() {
        fitting_mm *= 1.1;
    }
    match asked_mm {
        None => Ok(fitting_mm),
        Some(mm) if !(mm.is_finite() && mm > 0.0) || mm > size_mm.max() => Err(refusal!(
            "--voxel {mm}: give a size in mm, above 0 and no larger than the part"
        )),
        Some(mm) if fits(mm) => Ok(mm),
        Some(mm) => {
            let mut finest_mm = fitting_mm;
            while fits(0.98 * finest_mm) {
                finest_mm *= 0.98;
            }
            let finest_mm = (finest_mm * 1000.0).ceil() / 1000.0;
            Err(refusal!(
                "--voxel {mm} makes the grid too large: {finest_mm} fits"
            ))
        }
    }
}

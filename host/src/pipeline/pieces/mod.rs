//! A part in pieces with build directions of their own (3+2 axes).
//!
//! ```text
//! mesh, FILE or search --cuts--> piece of each voxel --sections--> layers of each piece, along its direction
//!   --planned flat--> moves in the piece's frame --leaned--> one after another, travel clear of what stands --> Route
//! ```
//! In: a closed mesh (mm, input coordinates), [`Directions`], settings. Out: a [`Plan`] whose layers count on from piece to
//! piece, the rest first. The search and the pieces' voxels are in [`headway_reach::space`]. Leaves out keep-outs, copies,
//! layers of several heights, and how well a bead holds on a face that is cut.

mod flat;
mod frame;
mod one_job;
mod sections;

use crate::geometry::polygon::Box2;
use crate::job::transform::PartTransform;
use crate::mesh::{LoadedMesh, Mesh};
use crate::pipeline::open_ground::OpenGround;
use crate::pipeline::reach::{HEADINGS, Joints, SLACK_SHARE, Voxels, self_support_rad};
use crate::pipeline::{Plan, PlanError};
use crate::plan::layers::skirt::skirt_reach_mm;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::plan::progress::Progress;
use crate::report::figures::PieceFigures;
use crate::settings::Settings;
use crate::settings::directions::{Directions, PieceCut, to_toml};
use crate::settings::obstacles::Obstacles;
use crate::text::refusal::{Refusal, refusal};
use headway_reach::Vector3;
use headway_reach::profile::HeadProfile;
use headway_reach::space::{self, Aperture, Cut, CutError, Facet, Rules};
use sections::{Divided, PartCut};
use std::f64::consts::FRAC_PI_2;

/// Voxels of the part's box.
const BOX_VOXELS: f64 = 6e4;
/// Most pieces that are searched for, the rest included.
const PIECES_MAX: usize = 5;
/// Longest side of a facet, voxels.
const FACET_VOXELS: f64 = 1.5;
/// Cells of a piece at which joints are asked for.
const JOINTS_ASKED: usize = 200;

/// What pieces come to.
#[derive(Clone, Debug, Default)]
pub struct PartPieces {
    /// The cuts, as a file names them, in the order of printing.
    pub cuts: Vec<PieceCut>,
    /// Each piece, the rest first.
    pub figures: Vec<PieceFigures>,
    /// Open places of all pieces, seen from above, the largest first.
    pub open: Vec<OpenGround>,
    /// Boundary of all pieces that is not reached, seen from above.
    pub unreachable: Vec<UnreachableRun>,
}

/// Plans a part in pieces.
///
/// # Errors
/// [`PlanError`]; a `Refusal` for cuts that make no pieces, and directions that the machine cannot take.
pub fn plan_pieces(
    mesh: &LoadedMesh,
    directions: &Directions,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    settings.check()?;
    check_settings(settings)?;
    let placed = Placed::of(mesh, settings)?;
    let cuts = match directions {
        Directions::Given(cuts) => cuts.clone(),
        Directions::Auto => placed.found(settings)?,
    };
    let divided = placed.divided(&cuts, settings)?;
    one_job::planned(&divided, cuts, placed.transform, settings, progress)
}

/// Into how many pieces a part is divided; `None` where it cannot be.
pub(super) fn pieces_found(mesh: &LoadedMesh, settings: &Settings) -> Option<usize> {
    check_settings(settings).ok()?;
    let cuts = Placed::of(mesh, settings).ok()?.found(settings).ok()?;
    Some(1 + cuts.len())
}

/// Whether the machine and its file go with pieces.
fn check_settings(settings: &Settings) -> Result<(), Refusal> {
    if !settings.tilts() {
        return Err(refusal!(
            "--directions: this machine's head and table do not tilt: use a machine with five axes or an arm (-m), or leave \
             --directions out"
        ));
    }
    match settings.wide_beads.continuous_z {
        true => Err(refusal!(
            "--directions: the layers of pieces do not rise along a bead: leave --continuous-z out, or --directions"
        )),
        false => Ok(()),
    }
}

/// A part on the machine, as voxels.
struct Placed<'a> {
    mesh: &'a LoadedMesh,
    voxels: Voxels,
    transform: PartTransform,
}

impl<'a> Placed<'a> {
    fn of(mesh: &'a LoadedMesh, settings: &Settings) -> Result<Placed<'a>, Refusal> {
        let [low, high] = mesh.bounds_mm();
        let [min, max] = [low.xy(), high.xy()];
        let bounds = Box2 { min, max }.grown(skirt_reach_mm(settings));
        let stacked = Settings {
            layers: 2,
            ..settings.clone()
        };
        let transform = PartTransform::choose_box(bounds, [low.z, high.z], &stacked)?;
        let voxel_mm = ((high - low).product() / BOX_VOXELS).cbrt();
        let offset_mm = Vector3::from(transform.offset_mm);
        let voxels = Voxels::new(mesh, &Obstacles::default(), offset_mm, voxel_mm)?;
        Ok(Placed {
            mesh,
            voxels,
            transform,
        })
    }

    /// What the search and the figures go by: `judge` gets the rules, and the small triangles of the surface.
    fn ruled<T>(
        &self,
        axes: &[Vector3],
        settings: &Settings,
        judge: impl FnOnce(&Rules, &[Facet]) -> T,
    ) -> T {
        let (voxels, offset_mm) = (&self.voxels, Vector3::from(self.transform.offset_mm));
        let voxel_mm = voxels.part.voxel_mm();
        let head = settings.head.as_ref();
        let profile = head.map_or_else(HeadProfile::line, |head| head.profile());
        let joints = self.joints(settings);
        let permitted = joints.permitted(axes);
        let rules = Rules {
            head: &profile,
            slack_mm: SLACK_SHARE * voxel_mm,
            self_support_rad: self_support_rad(settings),
            aperture: Aperture {
                headings_rad: vec![0.0],
                reach_mm: settings.aperture.reach_mm(),
                contains: &|_| true,
            },
            allowed: &|cell, direction| {
                let tip_mm = || voxels.tip_mm(cell, &axes[direction]) + offset_mm;
                permitted[direction].unwrap_or_else(|| joints.permit(tip_mm(), &axes[direction]))
            },
        };
        judge(&rules, &facets(&self.mesh.mesh, voxels.low_mm, voxel_mm))
    }

    fn joints<'b>(&self, settings: &'b Settings) -> Joints<'b> {
        let offset_mm = Vector3::from(self.transform.offset_mm);
        let corners = self
            .mesh
            .bounds_mm()
            .map(|corner| corner.coords + offset_mm);
        Joints::new(settings, corners, HEADINGS)
    }

    /// The cuts of a search, with the digits that a file has.
    fn found(&self, settings: &Settings) -> Result<Vec<PieceCut>, Refusal> {
        let head = settings.head.as_ref();
        let free_tilt_rad = head.map_or(FRAC_PI_2, |head| head.free_tilt_rad());
        let axes = space::directions(self.joints(settings).tilt_max_rad(), free_tilt_rad);
        let cuts = self.ruled(&axes, settings, |rules, facets| {
            let part = &self.voxels.part;
            part.best_cuts(
                &axes,
                rules,
                facets,
                settings.layer_height_mm,
                PIECES_MAX - 1,
            )
        });
        let cuts = cuts.map_err(|_| {
            refusal!("--directions auto: the part is too long and thin for the search: name its pieces in a file")
        })?;
        let of_part = cuts.iter().map(|cut| PieceCut {
            direction: cut.direction.into(),
            at_mm: (cut.at_mm + self.voxels.low_mm).into(),
        });
        let cuts: Vec<PieceCut> = of_part.collect();
        if cuts.is_empty() {
            return Ok(cuts);
        }
        match to_toml(&cuts).parse()? {
            Directions::Given(cuts) => Ok(cuts),
            Directions::Auto => Ok(Vec::new()),
        }
    }

    fn divided(&self, cuts: &[PieceCut], settings: &Settings) -> Result<Divided<'_>, Refusal> {
        let on_grid = |cut: &PieceCut| Cut {
            direction: Vector3::from(cut.direction).normalize(),
            at_mm: Vector3::from(cut.at_mm) - self.voxels.low_mm,
        };
        let in_part = |cut: &PieceCut| {
            let direction = Vector3::from(cut.direction).normalize();
            let level_mm = direction.dot(&Vector3::from(cut.at_mm));
            PartCut {
                direction,
                level_mm,
            }
        };
        let of_grid: Vec<Cut> = cuts.iter().map(on_grid).collect();
        let owners = self.voxels.part.divided(&of_grid);
        let owners = owners.map_err(|(number, why)| wrong_cut(&cuts[number], number, why))?;
        let hanging_mm2 = self.ruled(&[], settings, |rules, facets| {
            self.voxels.part.hanging(&owners, &of_grid, facets, rules)
        });
        let divided = Divided {
            mesh: self.mesh,
            voxels: &self.voxels,
            owners,
            hanging_mm2,
            cuts: cuts.iter().map(in_part).collect(),
        };
        self.check_joints(&divided, cuts, settings)?;
        Ok(divided)
    }

    /// Refuses a direction in which the joints do not reach the piece.
    fn check_joints(
        &self,
        divided: &Divided,
        cuts: &[PieceCut],
        settings: &Settings,
    ) -> Result<(), Refusal> {
        let offset_mm = Vector3::from(self.transform.offset_mm);
        let joints = self.joints(settings);
        for (number, (cut, of)) in cuts.iter().zip(&divided.cuts).enumerate() {
            let owners = divided.owners.iter().enumerate();
            let own = owners.filter(|(_, owner)| usize::from(**owner) == number + 1);
            let own: Vec<usize> = own.map(|(cell, _)| cell).collect();
            let every = own.len() / JOINTS_ASKED + 1;
            let place = |cell: &usize| self.voxels.middle_mm(self.voxels.part.cells()[*cell]);
            let mut asked = own.iter().step_by(every).map(place);
            let refused = asked.find(|at| !joints.permit(at + offset_mm, &of.direction));
            if let Some(at) = refused {
                return Err(refusal!(
                    "--directions: piece {}: no joints within their ranges have the tool along {:?} with its tip near \
                     ({:.1}, {:.1}, {:.1}) mm: choose another direction, or place the part elsewhere (--at)",
                    number + 1,
                    cut.direction,
                    at.x,
                    at.y,
                    at.z
                ));
            }
        }
        Ok(())
    }
}

/// Small triangles of the surface, mm from the grid's corner.
fn facets(mesh: &Mesh, low_mm: Vector3, voxel_mm: f64) -> Vec<Facet> {
    let longest_mm = FACET_VOXELS * voxel_mm;
    let mut facets = Vec::new();
    for triangle in 0..mesh.triangles.len() {
        let mut waiting = vec![mesh.corners(triangle).map(|p| p.coords - low_mm)];
        while let Some([a, b, c]) = waiting.pop() {
            let sides = [(b - c).norm(), (c - a).norm(), (a - b).norm()];
            let longest = if sides[0] >= sides[1].max(sides[2]) {
                0
            } else if sides[1] >= sides[2] {
                1
            } else {
                2
            };
            if sides[longest] > longest_mm {
                // Turned so that the longest side is that from b to c.
                let [a, b, c] = [[a, b, c], [b, c, a], [c, a, b]][longest];
                let middle = 0.5 * (b + c);
                waiting.extend([[a, b, middle], [a, middle, c]]);
                continue;
            }
            let across = (b - a).cross(&(c - a));
            if let Some(normal) = across.try_normalize(0.0) {
                facets.push(Facet {
                    middle_mm: (a + b + c) / 3.0,
                    normal,
                    area_mm2: 0.5 * across.norm(),
                });
            }
        }
    }
    facets
}

fn wrong_cut(cut: &PieceCut, number: usize, why: CutError) -> Refusal {
    let (piece, [x, y, z]) = (number + 1, cut.at_mm);
    match why {
        CutError::Misses => refusal!(
            "--directions: piece {piece}: nothing of the part lies above the cut near ({x}, {y}, {z}) mm: write a place at_mm in \
             the part, on the plane below the piece"
        ),
        CutError::InTheAir => refusal!(
            "--directions: piece {piece}: without it the rest of the part is in separate pieces, or off the bed: cut nearer to \
             its end, or let what it carries be a later piece"
        ),
    }
}

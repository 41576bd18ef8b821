//! The plan of a target, with all intermediate results.

use super::layer_time::SlowedLayers;
use super::pieces::PartPieces;
use super::roofs::Roofs;
use super::stack::LeftOut;
use super::surface::OnSurface;
use super::surface::curved_layers::CurvedFigures;
use crate::geometry::polygon::Region;
use crate::job::SegmentStream;
use crate::job::transform::PartTransform;
use crate::plan::judge::figures::{PlanFigures, Swept};
use crate::plan::judge::measure::Measured;
use crate::plan::judge::region_raster::swept_area_mm2;
use crate::plan::judge::touches::Touches;
use crate::plan::layers::PlanePass;
use crate::plan::layers::layer_groups::{LayerGroup, RegionPrint};
use crate::plan::layers::region_plan::RegionPlan;
use crate::plan::layers::skirt::SkirtPlan;
use crate::plan::motion::best_place::FoundPlace;
use crate::plan::motion::segments::MotionReport;
use crate::plan::motion::singular::SingularPlaces;
use crate::plan::route::lean::Leaned;
use crate::plan::route::moves::Route;
use crate::plan::route::told_headings::HeadingJumps;
use crate::plan::route::waypoint_curve::rounding::RoundedCorners;

/// A planned target, with all intermediates.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    /// Position of the part on the machine.
    pub transform: PartTransform,
    /// What neither aperture nor nozzle body enters, input coordinates.
    pub keep_out: Vec<Region>,
    /// Area of the target lost to that.
    pub kept_out_mm2: f64,
    /// Regions of a part that are not printed.
    pub left_out: Vec<LeftOut>,
    /// The skirt printed around the regions before them, on the first layer.
    pub skirt: Option<SkirtPlan>,
    /// The layer groups, in the order of their first layers.
    pub kinds: Vec<LayerGroup>,
    /// Every printing of a region, in order.
    pub prints: Vec<RegionPrint>,
    /// The printed curves, machine coordinates, in order.
    pub curves: Vec<PlanePass>,
    /// For each curve the number of its printing, or [`crate::plan::layers::layer_groups::OFF_REGIONS`].
    pub print_of_curve: Vec<usize>,
    /// The position found for a run of waypoints, if one was requested.
    pub found_place: Option<FoundPlace>,
    /// The tilts of the tool axis of a run of waypoints for clearance, if any.
    pub leaned: Option<Leaned>,
    /// Where two rotary axes line up on a run of waypoints, and how that is passed.
    pub singular: SingularPlaces,
    /// What became of the corners of a run of waypoints.
    pub rounded: RoundedCorners,
    /// How headings of a run of waypoints change.
    pub jumps: HeadingJumps,
    /// Touches of the head with table and print on a run of waypoints, where its shape is known.
    pub touches: Option<Touches>,
    /// Its surface, if there is one.
    pub on_surface: Option<OnSurface>,
    /// Results for its curved layers, if it has any.
    pub curved_layers: Option<CurvedFigures>,
    /// Its pieces with directions of their own, if it has any.
    pub pieces: Option<PartPieces>,
    /// Bridges that span much.
    pub roofs: Roofs,
    /// Layers that were slowed to last long enough.
    pub slowed: SlowedLayers,
    /// Everything the head does.
    pub route: Route,
    /// Travels between passes that leave the regions.
    pub outline_crossings: usize,
    /// The stream for the controller.
    pub stream: SegmentStream,
    /// What the stream reaches of the limits.
    pub motion: MotionReport,
    /// What was swept of each printing, and coverage rasters.
    pub measured: Measured,
    /// What the plan is judged on, over all regions and layers.
    pub figures: PlanFigures,
}

impl Plan {
    /// True where most layers are in no plane of the bed's.
    pub fn is_in_space(&self) -> bool {
        self.curved_layers.is_some() || self.pieces.is_some()
    }

    /// The regions of the first layer's group; none for a run of waypoints.
    pub fn regions(&self) -> &[RegionPlan] {
        self.kinds.first().map_or(&[], |kind| &kind.regions)
    }

    /// The region that a printing prints.
    pub fn region_of(&self, print: &RegionPrint) -> &RegionPlan {
        &self.kinds[print.kind].regions[print.region]
    }

    /// What was swept on all layers of a kind.
    pub fn swept_of_kind(&self, kind: usize) -> Swept {
        let prints = self.prints.iter().zip(&self.measured.swept);
        Swept::sum(
            prints
                .filter(|(print, _)| print.kind == kind)
                .map(|(_, swept)| swept),
        )
    }

    /// The area that infill lines are to cover, and its swept part, mm², over the layers of one
    /// group or all; `None` if there is none.
    pub fn infill_area_mm2(&self, kind: Option<usize>) -> Option<[f64; 2]> {
        self.ground_area_mm2(kind, |region| &region.open)
    }

    /// The same for the area that is open on purpose between the lines of a sparse infill.
    pub fn sparse_area_mm2(&self, kind: Option<usize>) -> Option<[f64; 2]> {
        self.ground_area_mm2(kind, |region| &region.sparse)
    }

    /// An area of the regions, and its swept part.
    fn ground_area_mm2(
        &self,
        kind: Option<usize>,
        ground: impl Fn(&RegionPlan) -> &[Region],
    ) -> Option<[f64; 2]> {
        let rasters = self.prints.iter().zip(&self.measured.rasters);
        let areas: Vec<[f64; 2]> = rasters
            .map(|(print, raster)| {
                let open = ground(self.region_of(print));
                let is_asked = kind.is_none_or(|kind| print.kind == kind);
                let raster = raster.as_ref().filter(|_| is_asked);
                raster.map_or([0.0; 2], |raster| swept_area_mm2(raster, open))
            })
            .collect();
        let prints = self.prints.iter();
        let prints = prints.filter(|print| kind.is_none_or(|kind| print.kind == kind));
        let [ground, swept] = prints.fold([0.0; 2], |sum, print| {
            let area = areas[print.like];
            [sum[0] + area[0], sum[1] + area[1]]
        });
        (ground > 0.0).then_some([ground, swept])
    }
}

//! Travel between passes: around keep-outs, inside the part, or straight.
//!
//! All in machine coordinates. Avoiding the outline is optional: if no path inside is found the
//! head moves straight. Keep-outs are not: without a path around them planning fails.
//!
//! In: keep-outs, regions, two placements (mm, rad). Out: straight legs over corners (mm), or an
//! error with the place.

use crate::geometry::clearance::Configuration;
use crate::geometry::polygon::Region;
use crate::geometry::{Point2, Vector2};
use crate::job::MotionState;
use crate::plan::route::keep_out::{Detours, Way};
use crate::plan::route::moves::Route;
use crate::plan::route::shortest_path::TravelRouter;
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y};

/// Clearance of paths inside from the outline, as a share of b: passes keep all of it but for the
/// tolerance.
const INSIDE_SHARE: f64 = 0.9;

/// Why there is no path between two passes.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TravelError {
    /// The keep-outs have too many corners to route around.
    #[error("the keep-outs have more corners than can be routed around: draw them more coarsely")]
    TooManyCorners,
    /// No path around the keep-outs.
    #[error(
        "no way around the keep-outs from ({:.3}, {:.3}) to ({:.3}, {:.3}) mm: move them, or print \
         the parts one by one",
        from_mm[0], from_mm[1], to_mm[0], to_mm[1]
    )]
    Blocked {
        /// Where the head is.
        from_mm: [f64; 2],
        /// Where it should go.
        to_mm: [f64; 2],
    },
}

impl TravelError {
    /// The same, its places moved to other coordinates.
    pub fn shifted(self, by: Vector2) -> TravelError {
        let moved = |at: [f64; 2]| [at[0] + by.x, at[1] + by.y];
        match self {
            TravelError::Blocked { from_mm, to_mm } => TravelError::Blocked {
                from_mm: moved(from_mm),
                to_mm: moved(to_mm),
            },
            TravelError::TooManyCorners => self,
        }
    }
}

/// Finds the path of every travel.
#[derive(Clone, Debug, Default)]
pub struct TravelWays {
    detours: Option<Detours>,
    grounds: Vec<TravelRouter>,
}

impl TravelWays {
    /// Around the keep-outs, and inside the regions if requested. Regions with too many corners for
    /// a router are crossed straight.
    ///
    /// # Errors
    /// [`TravelError::TooManyCorners`].
    pub fn new(
        keep_out: &[Region],
        regions: &[Region],
        settings: &Settings,
    ) -> Result<TravelWays, TravelError> {
        let detours = if keep_out.is_empty() {
            None
        } else {
            Some(Detours::new(keep_out, settings).ok_or(TravelError::TooManyCorners)?)
        };
        let clearance_mm = INSIDE_SHARE * settings.aperture.minor_mm();
        let grounds = if settings.avoid_crossing {
            let routers = regions.iter();
            routers
                .filter_map(|region| TravelRouter::new(region.rings(), true, clearance_mm))
                .collect()
        } else {
            Vec::new()
        };
        Ok(TravelWays { detours, grounds })
    }

    /// The path from one placement to another.
    ///
    /// # Errors
    /// [`TravelError::Blocked`].
    pub fn way(&mut self, from: Configuration, to: Configuration) -> Result<Way, TravelError> {
        for ground in &mut self.grounds {
            let Some(corners) = ground.way(from.center, to.center) else {
                continue;
            };
            let ends = ([from.center], [to.center]);
            let all: Vec<Point2> = ends
                .0
                .into_iter()
                .chain(corners.clone())
                .chain(ends.1)
                .collect();
            if self
                .detours
                .as_ref()
                .is_none_or(|detours| detours.is_clear(&all))
            {
                // Rounding takes a little of the clearance, which keep-outs have not to spare.
                return Ok(Way {
                    corners,
                    rounded: self.detours.is_none(),
                    ..Way::default()
                });
            }
        }
        match &mut self.detours {
            None => Ok(Way::default()),
            Some(detours) => detours.way(from, to).ok_or(TravelError::Blocked {
                from_mm: [from.center.x, from.center.y],
                to_mm: [to.center.x, to.center.y],
            }),
        }
    }
}

/// Number of travels between passes that leave the regions.
pub fn outline_crossings(route: &Route, regions: &[Region]) -> usize {
    let grounds: Vec<TravelRouter> = regions
        .iter()
        .map(|region| TravelRouter::ground_of(region.rings(), true, 0.0))
        .collect();
    let (mut crossings, mut printed, mut crosses) = (0, false, false);
    for route_move in &route.moves {
        let points = route_move.curve.control.iter();
        match route_move.state {
            MotionState::Travel if printed => {
                let way: Vec<Point2> = points
                    .map(|c| Point2::new(c[CHANNEL_X], c[CHANNEL_Y]))
                    .collect();
                let inside = |ground: &TravelRouter| {
                    way.windows(2)
                        .all(|leg| ground.is_free(leg[0]) && ground.sees(leg[0], leg[1]))
                };
                crosses |= !grounds.iter().any(inside);
            }
            MotionState::Print => {
                crossings += usize::from(crosses);
                (printed, crosses) = (true, false);
            }
            _ => {}
        }
    }
    crossings
}

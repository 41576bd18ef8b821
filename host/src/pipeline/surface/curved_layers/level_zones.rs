//! Zones of a curved layer on which a nozzle that stays upright keeps one heading.
//!
//! In: the top of a layer and what of it is printed (mm, seen from above), the nozzle. Out: [`Zone`]s that share the ground
//! out. On a slope of tangent g whose level lines run at an angle d to the long axis the nozzle's edge lies g sqrt(a² sin² d +
//! b² cos² d) in the layer. Where that is little at any heading, headings are free; elsewhere the nozzle keeps one along the
//! level lines about there. Of the headings in steps of [`STEP_RAD`], and of free ones, the next zone is always that with the
//! most of the ground that is left. Leaves out nozzles that are no ellipses: they have one zone, with free headings.

use super::layer_shape::LevelSurface;
use super::sections::above;
use super::top_grid::TopGrid;
use crate::geometry::aperture::Aperture;
use crate::geometry::boolean::{difference, filled, intersection};
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::repair::FillRule;
use crate::geometry::{Point2, Vector2};
use std::f64::consts::{FRAC_PI_2, PI};

/// How deep the end of a nozzle that stays upright may be in a slope, of a layer: in the mean beads are then half as far off
/// the slope as the stairs of flat layers, a quarter of a layer.
pub const HANG_SHARE: f64 = 0.3;
/// Headings that are tried.
const HEADINGS: usize = 36;
const STEP_RAD: f64 = PI / HEADINGS as f64;
/// What a zone with one heading may exceed the bound by: 1.1 is 9° beside the level line on the steepest slope. Beyond a piece
/// the top goes on a little steeper, which takes the others.
const ROOM: [f64; 4] = [1.1, 1.3, 1.7, 2.5];
/// The same for what is too small for a zone of its own.
const SMALL_ROOM: f64 = 1.8;
/// Step of the grid, of the nozzle's half length, as long as there are no more than this along an axis.
const GRID: f64 = 0.5;
const STEPS_MAX: f64 = 240.0;
/// Least area of a piece of a zone, of the nozzle's half length times its half width.
const PIECE_AREA: f64 = 16.0;

/// Ground with one heading.
#[derive(Clone, Debug)]
pub struct Zone {
    /// The ground.
    pub regions: Vec<Region>,
    /// Direction of the nozzle's long axis; `None` where it is free.
    pub heading_rad: Option<f64>,
}

/// Tangent of the steepest slope on which the edge of a nozzle that stays upright is no deeper in the layer than it may.
pub fn slope_max(aperture: &Aperture, layer_mm: f64) -> f64 {
    let half_mm = match aperture {
        Aperture::Ellipse { minor_mm, .. } => *minor_mm,
        Aperture::Rounded(_) => aperture.major_mm(),
    };
    HANG_SHARE * layer_mm / half_mm
}

/// Shares the ground of a layer out.
pub fn zones(
    top: &LevelSurface,
    regions: &[Region],
    aperture: &Aperture,
    layer_mm: f64,
) -> Vec<Zone> {
    let is_ellipse = matches!(aperture, Aperture::Ellipse { .. }) && !aperture.is_round();
    let slopes = Slopes::of(top, regions, aperture, layer_mm);
    let whole = |heading_rad: Option<f64>| {
        let regions = regions.to_vec();
        vec![Zone {
            regions,
            heading_rad,
        }]
    };
    if !is_ellipse || slopes.is_free_everywhere() {
        return whole(None);
    }
    let mut sharing = Sharing {
        slopes,
        left: regions.to_vec(),
        zones: Vec::new(),
    };
    for room in ROOM {
        sharing.share_out(room, PIECE_AREA * aperture.major_mm() * aperture.minor_mm());
    }
    sharing.rest(top);
    sharing.zones
}

/// Slopes over a grid.
struct Slopes<'a> {
    grid: TopGrid,
    slopes: Vec<Vector2>,
    /// Cells of the ground that is left.
    is_left: Vec<bool>,
    aperture: &'a Aperture,
    bound_mm: f64,
}

impl<'a> Slopes<'a> {
    fn of(
        top: &LevelSurface,
        regions: &[Region],
        aperture: &'a Aperture,
        layer_mm: f64,
    ) -> Slopes<'a> {
        let corners: Vec<Point2> = regions
            .iter()
            .map(Region::bounds)
            .flat_map(|b| [b.min, b.max])
            .collect();
        let bounds = Box2::of(&corners);
        let size = bounds.size();
        let step_mm = (size.x.max(size.y) / STEPS_MAX).max(GRID * aperture.major_mm());
        let bounds = bounds.grown(1.5 * step_mm);
        let size = bounds.size();
        let grid = TopGrid {
            low: bounds.min,
            step_mm,
            count: [size.x, size.y].map(|side| (side / step_mm).ceil() as usize + 1),
            z_mm: Vec::new(),
        };
        let cells = 0..grid.count[0] * grid.count[1];
        let slopes = cells.map(|cell| Vector2::from(top.jet(grid.place(cell)).slope));
        let slopes: Vec<Vector2> = slopes.collect();
        let mut slopes = Slopes {
            is_left: Vec::new(),
            grid,
            slopes,
            aperture,
            bound_mm: HANG_SHARE * layer_mm,
        };
        slopes.is_left = slopes.within(regions);
        slopes
    }

    fn within(&self, regions: &[Region]) -> Vec<bool> {
        let edges = regions.iter().flat_map(Region::edges);
        let edges: Vec<Edge> = edges.map(|(a, b)| Edge { a, b }).collect();
        let cells = 0..self.slopes.len();
        if edges.is_empty() {
            return vec![false; self.slopes.len()];
        }
        let index = EdgeIndex::new(edges, 4.0 * self.grid.step_mm);
        cells
            .map(|cell| index.contains(self.grid.place(cell)))
            .collect()
    }

    /// How deep the nozzle's edge is in the layer over a slope, of what it may be.
    fn depth(&self, slope: Vector2, heading_rad: Option<f64>) -> f64 {
        let steep = slope.norm();
        let half_mm = match heading_rad {
            Some(heading_rad) if steep > 0.0 => self.aperture.extent_mm(heading_rad, slope / steep),
            _ => self.aperture.major_mm(),
        };
        steep * half_mm / self.bound_mm
    }

    fn is_free_everywhere(&self) -> bool {
        let cells = self.slopes.iter().zip(&self.is_left);
        let mut left = cells.filter(|(_, is_left)| **is_left);
        left.all(|(slope, _)| self.depth(*slope, None) <= 1.0)
    }
}

/// Ground being shared out.
struct Sharing<'a> {
    slopes: Slopes<'a>,
    left: Vec<Region>,
    zones: Vec<Zone>,
}

impl Sharing<'_> {
    /// Takes zone after zone, the largest first, until no cell is left on which some heading keeps the bound times `room`.
    fn share_out(&mut self, room: f64, area_min_mm2: f64) {
        let headings = (0..HEADINGS).map(|k| Some(STEP_RAD * k as f64));
        let mut candidates: Vec<Option<f64>> = std::iter::once(None).chain(headings).collect();
        while !candidates.is_empty() {
            let cells_of = |heading_rad: &Option<f64>| {
                let cells = self.slopes.slopes.iter().zip(&self.slopes.is_left);
                let left = cells.filter(|(_, is_left)| **is_left);
                let room = heading_rad.map_or(1.0, |_| room);
                left.filter(|(slope, _)| self.slopes.depth(**slope, *heading_rad) <= room)
                    .count()
            };
            let counts: Vec<usize> = candidates.iter().map(cells_of).collect();
            let most = counts.iter().copied().max().unwrap_or(0);
            if most == 0 {
                return;
            }
            let best = counts.iter().position(|count| *count == most);
            let tried = candidates.remove(best.unwrap_or(0));
            let heading_rad = tried.map(|tried_rad| self.level_rad(tried_rad, room));
            self.take(heading_rad, room, area_min_mm2);
        }
    }

    /// The heading along which the slopes that one serves are least, by their squares: that of a ramp's level lines exactly.
    fn level_rad(&self, heading_rad: f64, room: f64) -> f64 {
        let cells = self.slopes.slopes.iter().zip(&self.slopes.is_left);
        let left = cells.filter(|(_, is_left)| **is_left);
        let served =
            left.filter(|(slope, _)| self.slopes.depth(**slope, Some(heading_rad)) <= room);
        // The direction of steepest slopes, doubled so that up and down are the same.
        let steep = served.fold(Vector2::zeros(), |sum, (slope, _)| {
            sum + Vector2::new(
                slope.x * slope.x - slope.y * slope.y,
                2.0 * slope.x * slope.y,
            )
        });
        match steep.norm() > 0.0 {
            true => 0.5 * steep.y.atan2(steep.x) + FRAC_PI_2,
            false => heading_rad,
        }
    }

    /// Takes what of the ground that is left a heading serves, but for small pieces.
    fn take(&mut self, heading_rad: Option<f64>, room: f64, area_min_mm2: f64) {
        let room = heading_rad.map_or(1.0, |_| room);
        let spare = self.slopes.slopes.iter();
        let spare = spare.map(|slope| room - self.slopes.depth(*slope, heading_rad));
        let served = above(&self.slopes.grid, &spare.collect::<Vec<_>>(), &[0.0]);
        let mut regions = intersection(&self.left, &served.concat());
        regions.retain(|region| region.area_mm2() >= area_min_mm2);
        if regions.is_empty() {
            return;
        }
        self.left = difference(&self.left, &regions);
        self.slopes.is_left = self.slopes.within(&self.left);
        self.zones.push(Zone {
            regions,
            heading_rad,
        });
    }

    /// What is left, small pieces: each goes to the zone beside it whose heading serves it best, or, where none will do, gets the
    /// heading of the level line in its middle.
    fn rest(&mut self, top: &LevelSurface) {
        for region in std::mem::take(&mut self.left) {
            let bounds = region.bounds();
            let slope = top.jet(nalgebra::center(&bounds.min, &bounds.max)).slope;
            let slope = Vector2::from(slope);
            let depth = |zone: &Zone| self.slopes.depth(slope, zone.heading_rad);
            let mut order: Vec<usize> = (0..self.zones.len()).collect();
            order.retain(|&zone| depth(&self.zones[zone]) <= SMALL_ROOM);
            order.sort_by(|&p, &q| depth(&self.zones[p]).total_cmp(&depth(&self.zones[q])));
            let joined = order.iter().find_map(|&zone| {
                let own = &self.zones[zone].regions;
                let rings = own.iter().flat_map(Region::rings).chain(region.rings());
                let joined = filled(rings, FillRule::Positive);
                (joined.len() <= own.len()).then_some((zone, joined))
            });
            match joined {
                Some((zone, joined)) => self.zones[zone].regions = joined,
                None => self.zones.push(Zone {
                    regions: vec![region],
                    heading_rad: Some(slope.x.atan2(-slope.y)),
                }),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::polygon::Ring;
    use crate::geometry::spline_surface::SplineSurface;
    use crate::geometry::test_shapes::ELLIPSE;
    use std::sync::Arc;

    const LAYER_MM: f64 = 0.2;

    fn square(half_mm: f64) -> Region {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        Region {
            exterior: Ring {
                points: corners
                    .map(|[x, y]| Point2::new(half_mm * x, half_mm * y))
                    .to_vec(),
            },
            holes: Vec::new(),
        }
    }

    fn surface(half_mm: f64, height: impl Fn(f64, f64) -> f64) -> LevelSurface {
        let steps = 4 * half_mm as i32;
        let places = (-steps..=steps).flat_map(|j| (-steps..=steps).map(move |i| [i, j]));
        let points = places.map(|place| {
            let [x, y] = place.map(|k| 0.25 * 1.25 * f64::from(k));
            [x, y, height(x, y)]
        });
        let points: Vec<[f64; 3]> = points.collect();
        let corners = [-1.25 * half_mm, 1.25 * half_mm].map(|side| Point2::new(side, side));
        let base = SplineSurface::on_grid(&points, Box2::of(&corners), 0.5).unwrap();
        LevelSurface {
            base: Arc::new(base),
            offset_mm: 0.0,
        }
    }

    /// Goal: a ramp, however it is turned, is one zone with the heading of its level lines, and a gentle one leaves headings
    /// free. Method: slopes of 15° in several directions, and of 5°.
    #[test]
    fn a_ramp_is_one_zone_along_its_level_lines() {
        for turn_rad in [0.0, 0.3, 1.2, 2.5, 4.0] {
            let up = Vector2::new(f64::cos(turn_rad), f64::sin(turn_rad));
            let ramp = |tangent: f64| surface(8.0, |x, y| tangent * up.dot(&Vector2::new(x, y)));
            let steep = zones(&ramp(0.268), &[square(8.0)], &ELLIPSE, LAYER_MM);
            assert_eq!(steep.len(), 1, "{turn_rad}");
            let heading_rad = steep[0].heading_rad.unwrap();
            let off = up.dot(&Vector2::new(heading_rad.cos(), heading_rad.sin()));
            assert!(off.abs() < 1e-4, "{turn_rad} {heading_rad}");
            let gentle = zones(&ramp(0.087), &[square(8.0)], &ELLIPSE, LAYER_MM);
            assert!(gentle.len() == 1 && gentle[0].heading_rad.is_none());
        }
    }

    /// Goal: zones share the ground out, without gap or overlap, and on each the nozzle's edge is within the bound. Method: a
    /// dome that reaches the steepest slope at its rim; areas are summed, places are looked up, the depth is formula.
    #[test]
    fn zones_of_a_dome_share_it_out_within_the_bound() {
        let (radius_mm, half_mm) = (60.0f64, 12.0);
        let dome = surface(half_mm, |x, y| {
            (radius_mm * radius_mm - x * x - y * y).sqrt()
        });
        let ground = square(half_mm);
        let zones = zones(&dome, std::slice::from_ref(&ground), &ELLIPSE, LAYER_MM);
        assert!((2..30).contains(&zones.len()), "{}", zones.len());
        let all = zones.iter().flat_map(|zone| &zone.regions);
        let area_mm2: f64 = all.map(Region::area_mm2).sum();
        assert!(
            (area_mm2 / ground.area_mm2() - 1.0).abs() < 1e-6,
            "{area_mm2}"
        );
        let (mut found, mut deepest) = (0, 0.0f64);
        for i in 0..80 {
            for j in 0..80 {
                let [x, y] = [i, j].map(|k| (f64::from(k) - 39.4) * 0.3);
                let at = Point2::new(x, y);
                let own = zones
                    .iter()
                    .find(|zone| zone.regions.iter().any(|r| r.contains(at)));
                let Some(own) = own else { continue };
                found += 1;
                let z = (radius_mm * radius_mm - x * x - y * y).sqrt();
                let (gx, gy) = (-x / z, -y / z);
                let depth_mm = match own.heading_rad {
                    None => 0.6 * gx.hypot(gy),
                    Some(h) => {
                        let (along, across) =
                            (gx * h.cos() + gy * h.sin(), gy * h.cos() - gx * h.sin());
                        (0.6 * along).hypot(0.2 * across)
                    }
                };
                deepest = deepest.max(depth_mm);
            }
        }
        assert!(found > 6300, "{found}");
        // 0.3 of a layer, 1.1 times; a grid of 0.3 mm and corners of 17° add a little.
        assert!((0.05..0.075).contains(&deepest), "{deepest}");
    }
}

//! The start of a region from the plan of the layer next to its own, where their outlines are nearly the same.
//!
//! Most layers of a part are like the next one: a wall that leans moves by some um, a twisted one turns. The passes of that
//! layer are moved with the outline, and the optimiser does the rest; which beads there are and how they are joined stays.
//!
//! In: the region's walls and frame (mm), the planned region. Out: the optimiser's unknowns on the new ground; `None` where
//! the outlines differ by more than the optimiser brings back. Not covered: a number of beads that no longer fits, which
//! the objective shows ([`crate::plan::layers::optimised_passes::RegionJob::resumed`]).

use crate::geometry::aperture::Aperture;
use crate::geometry::boolean::filled;
use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::frame::Frame;
use crate::geometry::plane_curve::PlaneControl;
use crate::geometry::polygon::Region;
use crate::geometry::repair::FillRule;
use crate::geometry::{Point2, Vector2};
use crate::plan::layers::optimised_passes::Solution;
use nalgebra::{Matrix3, Vector3};

/// Most that the outlines differ after the move, against b.
const APART_SHARE: f64 = 0.5;
/// Places on the outlines by which the move is found, and rounds of that.
const PLACES: usize = 400;
const ROUNDS: usize = 6;
/// Outlines this near to each other need no better move, against b.
const SAME_SHARE: f64 = 1e-4;

/// Walls in a region's own coordinates.
#[derive(Clone, Copy, Debug)]
pub struct PlacedWalls<'a> {
    /// The edges, in the frame.
    pub walls: &'a EdgeIndex,
    /// The frame about the contour's local origin.
    pub frame: Frame,
    /// The local origin, input coordinates.
    pub offset: Vector2,
}

/// The move that keeps everything where it is in input coordinates, out of a frame.
fn in_place(from: &PlacedWalls, to: &PlacedWalls) -> Frame {
    let place = |p: Point2| {
        to.frame
            .point_in(from.frame.point_out(p) + from.offset - to.offset)
    };
    Frame {
        centre: place(Point2::origin()),
        turn_rad: to.frame.angle_in(from.frame.angle_out(0.0)),
        is_mirrored: from.frame.is_mirrored != to.frame.is_mirrored,
    }
}

/// A move followed by a small turn about a place and a shift.
fn followed_by(first: Frame, about: Point2, turn_rad: f64, shift: Vector2) -> Frame {
    let turn = Frame {
        turn_rad,
        ..Frame::IDENTITY
    };
    Frame {
        centre: about + turn.vector_out(first.centre - about) + shift,
        turn_rad: first.turn_rad + turn_rad,
        ..first
    }
}

/// The outline of a planned region moved onto that of another one.
struct Fit<'a> {
    from: &'a EdgeIndex,
    to: &'a EdgeIndex,
    /// Out of it a place moves.
    by: Frame,
}

/// A planned region, as far as another may start from it.
#[derive(Clone, Debug)]
pub struct WarmStart {
    /// Beads along the walls; `None` for loops throughout.
    pub walls: Option<u32>,
    /// The passes as they are optimised, in its frame.
    pub solution: Solution,
    /// The area inside the walls, in its frame.
    pub open: Vec<Region>,
}

impl WarmStart {
    /// It moved onto the new walls; `None` where the outlines differ too much.
    pub fn moved(
        &self,
        from: &PlacedWalls,
        to: &PlacedWalls,
        aperture: &Aperture,
    ) -> Option<WarmStart> {
        let apart_max_mm = APART_SHARE * aperture.minor_mm();
        let starts = [in_place(from, to), Frame::IDENTITY];
        let mut fits = starts.iter().filter_map(|&start| {
            let fit = Fit {
                from: from.walls,
                to: to.walls,
                by: start,
            };
            let fit = fit.settled(aperture)?;
            fit.is_within(apart_max_mm, aperture).then_some(fit)
        });
        let fit = fits.next()?;
        let mut moved = self.clone();
        for begun in &mut moved.solution.begun {
            for control in &mut begun.unknown.control {
                *control = fit.control(*control);
            }
        }
        let passes = moved.solution.passes.iter_mut();
        for placement in passes.flat_map(|pass| &mut pass.placements) {
            let contact = &mut placement.contact;
            contact.point = fit.by.point_out(contact.point);
            contact.normal = fit.by.vector_out(contact.normal);
        }
        for ring in moved.open.iter_mut().flat_map(Region::rings_mut) {
            for point in &mut ring.points {
                *point = fit.beside_the_wall(*point);
            }
            // Mirrored, it runs the other way round.
            if fit.by.is_mirrored {
                ring.points.reverse();
            }
        }
        moved.open = filled(
            moved.open.iter().flat_map(Region::rings),
            FillRule::Positive,
        );
        Some(moved)
    }
}

impl Fit<'_> {
    /// The move by which the distances from the one outline to the other are least, by tangents (Chen and Medioni, 1992).
    fn settled(mut self, aperture: &Aperture) -> Option<Self> {
        let places = places_on(self.from, PLACES, aperture);
        let middle = self.to.bounds().min + self.to.bounds().size() / 2.0;
        let reach_mm = self.to.bounds().size().norm();
        for _ in 0..ROUNDS {
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            let mut most_mm: f64 = 0.0;
            for &place in &places {
                let at = self.by.point_out(place);
                let nearest = self.to.nearest(at)?;
                let across = self.to.edges()[nearest.edge].normal();
                let arm = at - middle;
                // Shifts and turns of about the same size.
                let row = Vector3::new(across.perp(&-arm) / reach_mm, across.x, across.y);
                let off_mm = across.dot(&(nearest.foot - at));
                most_mm = most_mm.max(nearest.distance_mm);
                normal += row * row.transpose();
                right += row * off_mm;
            }
            if most_mm < SAME_SHARE * aperture.minor_mm() {
                break;
            }
            // What the outline does not determine, such as a circle's turn, stays.
            normal += Matrix3::identity() * (1e-6 * normal.trace());
            let step = normal.cholesky()?.solve(&right);
            let shift = Vector2::new(step.y, step.z);
            self.by = followed_by(self.by, middle, step.x / reach_mm, shift);
        }
        Some(self)
    }

    /// True if no place of either outline is farther from the other.
    fn is_within(&self, apart_mm: f64, aperture: &Aperture) -> bool {
        let there = places_on(self.from, usize::MAX, aperture);
        let is_near = |edges: &EdgeIndex, at: Point2| edges.nearest_within(at, apart_mm).is_some();
        if !there
            .iter()
            .all(|&p| is_near(self.to, self.by.point_out(p)))
        {
            return false;
        }
        let here = places_on(self.to, usize::MAX, aperture);
        here.iter()
            .all(|&p| is_near(self.from, self.by.point_in(p)))
    }

    /// A control point moved, and then by as much as the wall next to it.
    fn control(&self, control: PlaneControl) -> PlaneControl {
        let at = self.beside_the_wall(Point2::new(control[0], control[1]));
        [at.x, at.y, self.by.angle_out(control[2])]
    }

    fn beside_the_wall(&self, at: Point2) -> Point2 {
        let shift = self.from.nearest(at).and_then(|wall| {
            let foot = self.by.point_out(wall.foot);
            Some(self.to.nearest(foot)?.foot - foot)
        });
        self.by.point_out(at) + shift.unwrap_or_default()
    }
}

/// Places along all edges, at most a apart, or every so many that they are at most twice `count`.
fn places_on(walls: &EdgeIndex, count: usize, aperture: &Aperture) -> Vec<Point2> {
    let step_mm = aperture.major_mm();
    let all: Vec<Point2> = (walls.edges().iter())
        .flat_map(|edge| {
            let parts = (edge.length_mm() / step_mm).ceil().max(1.0);
            (0..parts as usize).map(move |i| edge.a + (edge.b - edge.a) * (i as f64 / parts))
        })
        .collect();
    let every = (all.len() / count).max(1);
    all.into_iter().step_by(every).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::coverage::Cell;
    use crate::geometry::test_shapes::region;
    use crate::plan::coverage::raster::{same_bead_mm, within_walls};
    use crate::plan::layers::inside::Inside;
    use crate::plan::layers::region_plan::RegionPlan;
    use crate::plan::layers::region_plan::region_work::RegionWork;
    use crate::plan::outline::contour::{Contour, SIMPLIFY_MM};
    use crate::plan::pass::LayerPass;
    use crate::settings::{Infill, Settings};

    /// A plate with a notch and a hole, larger by `by_mm` all around, turned and shifted.
    fn plate(by_mm: f64, turn_rad: f64, shift: [f64; 2]) -> Region {
        let (low, high) = (-by_mm, 12.0 + by_mm);
        let outline: [[f64; 2]; 8] = [
            [low, low],
            [high, low],
            [high, 8.0 + by_mm],
            [7.0 + by_mm, 8.0 + by_mm],
            [7.0 + by_mm, 5.0 + by_mm],
            [5.0 - by_mm, 5.0 + by_mm],
            [5.0 - by_mm, 8.0 + by_mm],
            [low, 8.0 + by_mm],
        ];
        let hole: [[f64; 2]; 4] = [
            [9.0 + by_mm, 3.0 + by_mm],
            [9.0 + by_mm, 5.0 - by_mm],
            [11.0 - by_mm, 5.0 - by_mm],
            [11.0 - by_mm, 3.0 + by_mm],
        ];
        placed(&[&outline, &hole], turn_rad, shift)
    }

    /// A frame of one bead or two.
    fn frame(width_mm: f64) -> Region {
        let (far, near) = (5.0 + 0.5 * width_mm, 5.0 - 0.5 * width_mm);
        let outline = [[-far, -far], [far, -far], [far, far], [-far, far]];
        let hole = [[-near, -near], [-near, near], [near, near], [near, -near]];
        placed(&[&outline, &hole], 0.0, [0.0; 2])
    }

    fn placed(rings: &[&[[f64; 2]]], turn_rad: f64, shift: [f64; 2]) -> Region {
        let (sin, cos) = turn_rad.sin_cos();
        let place = |p: &[f64; 2]| {
            let turned = [p[0] * cos - p[1] * sin, p[0] * sin + p[1] * cos];
            [turned[0] + shift[0], turned[1] + shift[1]]
        };
        let rings: Vec<Vec<[f64; 2]>> = (rings.iter())
            .map(|ring| ring.iter().map(place).collect())
            .collect();
        let rings: Vec<&[[f64; 2]]> = rings.iter().map(Vec::as_slice).collect();
        region(&rings)
    }

    fn planned(outline: &Region, settings: &Settings, next_to: &[RegionPlan]) -> RegionPlan {
        let contour = Contour::of_region(outline, SIMPLIFY_MM).expect("contour");
        let work = RegionWork::begin(contour, None, settings).expect("axis");
        let inside = Inside {
            infill: settings.infill,
            ..Inside::default()
        };
        work.planned(&inside, next_to)
    }

    /// Share of the area that is to be covered that is, and length of the passes of the walls, mm.
    fn covered(plan: &RegionPlan, settings: &Settings) -> (f64, f64) {
        let walls = plan.passes.iter().filter(|pass| !pass.kind.is_line());
        let walls: Vec<LayerPass> = walls.cloned().collect();
        let aperture = &settings.aperture;
        let raster = within_walls(
            &walls,
            &plan.walls,
            aperture,
            1_000_000,
            same_bead_mm(aperture),
        );
        let count = |kind: fn(&Cell) -> bool| raster.cells.iter().filter(|c| kind(c)).count();
        let gaps = count(|cell| matches!(cell, Cell::Gap));
        let inside = count(|cell| !matches!(cell, Cell::Outside));
        let length_mm = walls.iter().map(LayerPass::length_mm).sum();
        (1.0 - gaps as f64 / inside as f64, length_mm)
    }

    /// True if the plan began from the other's: its objective is compared with that of the plan that began without.
    fn began_from(plan: &RegionPlan, other: &RegionPlan) -> bool {
        let reference = |plan: &RegionPlan| Some(plan.warm_start.as_ref()?.solution.cost_s_mm2);
        reference(plan).is_some() && reference(plan) == reference(other)
    }

    /// Goal: a layer like the one next to it gets that one's passes, which lie as well on it as those made for it alone.
    /// Method: a plate with a notch and a hole, and the same smaller, turned and shifted, with loops throughout and with
    /// two walls; coverage and path of the walls, and the same number of passes. Turned by half a turn it is alike in its
    /// own frame only.
    #[test]
    fn a_layer_like_the_next_gets_its_passes() {
        let walled = Settings {
            infill: Some(Infill {
                density_pct: 20.0,
                ..Infill::solid(2)
            }),
            ..Settings::default()
        };
        for settings in [Settings::default(), walled] {
            let first = planned(&plate(0.0, 0.0, [0.0; 2]), &settings, &[]);
            for (by_mm, turn_rad, shift) in [
                (0.02, 0.0, [0.0, 0.0]),
                (-0.02, 0.02, [0.3, -0.2]),
                (0.01, 3.1, [70.0, -0.2]),
            ] {
                let outline = plate(by_mm, turn_rad, shift);
                let own = planned(&outline, &settings, std::slice::from_ref(&first));
                let alone = planned(&outline, &settings, &[]);
                assert!(began_from(&own, &first), "{by_mm} {turn_rad}");
                assert!(!began_from(&alone, &first));
                let [own_covered, alone_covered] =
                    [&own, &alone].map(|plan| covered(plan, &settings));
                // Walls beside sparse lines have no fixed inner edge.
                let less = if settings.infill.is_some() {
                    0.02
                } else {
                    2e-3
                };
                assert!(
                    own_covered.0 > alone_covered.0 - less,
                    "{own_covered:?} {alone_covered:?}"
                );
                let longer = own_covered.1 / alone_covered.1;
                assert!((0.98..1.02).contains(&longer), "{longer}");
                let walls = |plan: &RegionPlan| {
                    let loops = plan.passes.iter().filter(|pass| !pass.kind.is_line());
                    loops.count()
                };
                assert_eq!(walls(&own), walls(&alone));
                assert!(own.curves.iter().zip(&own.passes).all(|(curve, pass)| {
                    let is_known = !pass.kind.is_line();
                    curve.is_some() == is_known
                }));
            }
        }
    }

    /// Goal: where another number of beads is needed, or the outline is another, a layer is planned without the next one's
    /// passes. Method: a frame of one bead whose wall becomes 0.15 mm wider, a plate 0.3 mm larger, one without the
    /// hole, loops next to walls with lines.
    #[test]
    fn another_outline_is_planned_alone() {
        let settings = Settings::default();
        let one_bead = planned(&frame(1.19), &settings, &[]);
        let two_beads = planned(&frame(1.34), &settings, std::slice::from_ref(&one_bead));
        assert!(!began_from(&two_beads, &one_bead));
        let first = planned(&plate(0.0, 0.0, [0.0; 2]), &settings, &[]);
        let larger = plate(0.3, 0.0, [0.0; 2]);
        let mut whole = plate(0.0, 0.0, [0.0; 2]);
        whole.holes.clear();
        for outline in [larger, whole] {
            let own = planned(&outline, &settings, std::slice::from_ref(&first));
            assert!(!began_from(&own, &first));
        }
        let walled = Settings {
            infill: Some(Infill {
                density_pct: 20.0,
                ..Infill::solid(2)
            }),
            ..Settings::default()
        };
        let own = planned(
            &plate(0.0, 0.0, [0.0; 2]),
            &walled,
            std::slice::from_ref(&first),
        );
        assert!(!began_from(&own, &first));
    }
}

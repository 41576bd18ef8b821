//! The start of a region from the plan of the layer next to its own, where their outlines are nearly the same.
//!
//! Most layers of a part are like the next one: a wall that leans moves by some um, a twisted one turns. The passes of that
//! layer are moved with the outline, and the optimiser does the rest; which beads there are and how they are joined stays.
//!
//! In: the region's walls and frame (mm), the planned region. Out: the optimiser's unknowns on the new ground; `None` where
//! the outlines differ by more than the optimiser brings back. Not covered: a number of beads that no longer fits, which
//! the objective shows ([`super::optimised_passes::RegionJob::resumed`]).

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

/// A turn about the origin after a mirroring, and a shift.
#[derive(Clone, Copy, Debug)]
struct Move {
    sign: f64,
    turn_rad: f64,
    shift: Vector2,
}

impl Move {
    const NONE: Move = Move {
        sign: 1.0,
        turn_rad: 0.0,
        shift: Vector2::new(0.0, 0.0),
    };

    /// The one that keeps everything where it is in input coordinates.
    fn in_place(from: &PlacedWalls, to: &PlacedWalls) -> Move {
        let place = |p: Point2| to.frame.point_in(from.frame.point_out(p) + from.offset - to.offset);
        let turn = |rad: f64| to.frame.angle_in(from.frame.angle_out(rad));
        Move {
            sign: (turn(1.0) - turn(0.0)).signum(),
            turn_rad: turn(0.0),
            shift: place(Point2::origin()).coords,
        }
    }

    fn vector(&self, v: Vector2) -> Vector2 {
        let (sin, cos) = self.turn_rad.sin_cos();
        let y = self.sign * v.y;
        Vector2::new(v.x * cos - y * sin, v.x * sin + y * cos)
    }

    fn point(&self, p: Point2) -> Point2 {
        Point2::from(self.vector(p.coords) + self.shift)
    }

    fn heading_rad(&self, heading_rad: f64) -> f64 {
        self.sign * heading_rad + self.turn_rad
    }

    /// The same followed by a small turn about a centre and a shift.
    fn followed_by(&self, centre: Point2, turn_rad: f64, shift: Vector2) -> Move {
        let (sin, cos) = turn_rad.sin_cos();
        let from = self.shift - centre.coords;
        let turned = Vector2::new(from.x * cos - from.y * sin, from.x * sin + from.y * cos);
        Move {
            turn_rad: self.turn_rad + turn_rad,
            shift: turned + centre.coords + shift,
            ..*self
        }
    }
}

/// The outline of a planned region moved onto that of another one.
struct Fit<'a> {
    from: &'a EdgeIndex,
    to: &'a EdgeIndex,
    by: Move,
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
        let starts = [Move::in_place(from, to), Move::NONE];
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
            contact.point = fit.by.point(contact.point);
            contact.normal = fit.by.vector(contact.normal);
        }
        for ring in moved.open.iter_mut().flat_map(Region::rings_mut) {
            for point in &mut ring.points {
                *point = fit.beside_the_wall(*point);
            }
            // Mirrored, it runs the other way round.
            if fit.by.sign < 0.0 {
                ring.points.reverse();
            }
        }
        moved.open = filled(moved.open.iter().flat_map(Region::rings), FillRule::Positive);
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
                let at = self.by.point(place);
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
            self.by = self
                .by
                .followed_by(middle, step.x / reach_mm, Vector2::new(step.y, step.z));
        }
        Some(self)
    }

    /// True if no place of either outline is farther from the other.
    fn is_within(&self, apart_mm: f64, aperture: &Aperture) -> bool {
        let there = places_on(self.from, usize::MAX, aperture);
        let is_near = |edges: &EdgeIndex, at: Point2| edges.nearest_within(at, apart_mm).is_some();
        if !there.iter().all(|&p| is_near(self.to, self.by.point(p))) {
            return false;
        }
        let back = |p: Point2| {
            let v = p.coords - self.by.shift;
            let (sin, cos) = self.by.turn_rad.sin_cos();
            Point2::new(v.x * cos + v.y * sin, self.by.sign * (v.y * cos - v.x * sin))
        };
        let here = places_on(self.to, usize::MAX, aperture);
        here.iter().all(|&p| is_near(self.from, back(p)))
    }

    /// A control point moved, and then by as much as the wall next to it.
    fn control(&self, control: PlaneControl) -> PlaneControl {
        let at = self.beside_the_wall(Point2::new(control[0], control[1]));
        [at.x, at.y, self.by.heading_rad(control[2])]
    }

    fn beside_the_wall(&self, at: Point2) -> Point2 {
        let shift = self.from.nearest(at).and_then(|wall| {
            let foot = self.by.point(wall.foot);
            Some(self.to.nearest(foot)?.foot - foot)
        });
        self.by.point(at) + shift.unwrap_or_default()
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

//! The area that earlier beads really cover gives the outer wall of the next bead channel.
//!
//! A bead misses the inner wall of its channel where it cannot be wide enough (the distance across
//! a corner is longer) or where its heading lags. If the next channel still started from the level
//! curve, that miss would remain as a gap or an overlap. So its wall is moved onto the edge of the
//! swept area, while its own inner wall stays the level curve: errors are passed on once and
//! corrected, they do not accumulate, and the jitter of one bead is not amplified by the next.
//!
//! In: placements of earlier beads, a level curve (mm). Out: the level curve moved onto the edge of
//! what they sweep (mm), at most 0.8 a. Not covered: area beyond that, which the figures show as
//! uncovered.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::{Configuration, Turned};
use crate::geometry::point_grid::{ByCell, cell_of};
use crate::geometry::polygon::Ring;
use crate::geometry::{Point2, Vector2};
use crate::plan::headings::contacts::resampled;
use crate::plan::pass::Placement;
use crate::plan::pass::sweep::poses_between;
use rayon::prelude::*;

/// How far a wall moves out where the bead before fell short, and in where that bead reached too far, against the
/// major semi-axis.
const MOVED_SHARE: f64 = 0.8;
/// A chord whose middle is further inside than this (times b) belongs to a bead of the other side.
const OWN_SIDE_SHARE: f64 = 0.25;
/// Far above the rounding of places, mm.
const ROUNDING_MM: f64 = 1e-6;
/// Rounds of [1 2 1] / 4 over the shifts and over the moved wall.
const SHIFT_ROUNDS: usize = 2;

/// The apertures of all beads so far, hashed by position.
#[derive(Clone, Debug)]
pub struct Laid {
    aperture: Aperture,
    cell_mm: f64,
    cells: ByCell<Vec<Turned>>,
}

impl Laid {
    /// No beads yet.
    pub fn new(aperture: &Aperture) -> Laid {
        Laid {
            aperture: *aperture,
            cell_mm: aperture.reach_mm(),
            cells: ByCell::default(),
        }
    }

    fn push(&mut self, at: Configuration) {
        self.cells
            .entry(cell_of(at.center, self.cell_mm))
            .or_default()
            .push(at.into());
    }

    /// Adds a run, with poses between its placements so dense that their union is the sweep.
    pub fn add(&mut self, placements: &[Placement], closed: bool) {
        let count = placements.len();
        for i in 0..count {
            let own = placements[i].at;
            self.push(own);
            let next = match i + 1 {
                n if n < count => placements[n].at,
                _ if closed => placements[0].at,
                _ => continue,
            };
            for at in poses_between(&self.aperture, own, next) {
                self.push(at);
            }
        }
    }

    /// Visits the poses near `p` that may cut the line along `normal`, with bounds of their chords:
    /// least and largest distance along it, mm.
    fn for_poses(&self, p: Point2, normal: Vector2, mut visit: impl FnMut(&Turned, [f64; 2])) {
        let (column, row) = cell_of(p, self.cell_mm);
        let reach_mm = self.aperture.reach_mm();
        let own_cell = Point2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
        let from_middle = p - own_cell * self.cell_mm;
        for (dr, dc) in (-2..=2).flat_map(|dr| (-2..=2).map(move |dc| (dr, dc))) {
            // Cells whose poses are all off the line, 0.71 of a cell around the middle.
            let middle = Vector2::new(f64::from(dc), f64::from(dr)) * self.cell_mm;
            if (from_middle - middle).perp(&normal).abs() > reach_mm + 0.75 * self.cell_mm {
                continue;
            }
            for pose in self
                .cells
                .get(&(column + dc, row + dr))
                .into_iter()
                .flatten()
            {
                let offset = p - pose.center;
                // Most are off the line.
                if offset.perp(&normal).abs() > reach_mm {
                    continue;
                }
                let along_mm = -offset.dot(&normal);
                let half_mm = reach_mm + ROUNDING_MM;
                visit(pose, [along_mm - half_mm, along_mm + half_mm]);
            }
        }
    }

    /// Least and largest distance from `p` along `normal` at which the line is in a pose, mm.
    fn chord_mm(&self, pose: &Turned, p: Point2, normal: Vector2) -> Option<[f64; 2]> {
        let offset = p - pose.center;
        self.aperture.chord_mm(pose.turn, offset, normal)
    }

    /// Extent of the beads on the outer side from `p` along `normal`, mm; `None` if none meets the
    /// line.
    pub fn edge_mm(&self, p: Point2, normal: Vector2) -> Option<f64> {
        let own_side = OWN_SIDE_SHARE * self.aperture.minor_mm();
        let mut edge: Option<f64> = None;
        self.for_poses(p, normal, |pose, [low, high]| {
            if low >= own_side || edge.is_some_and(|edge| high <= edge) {
                return;
            }
            if let Some([from, to]) = self.chord_mm(pose, p, normal)
                && 0.5 * (from + to) < own_side
                && from < own_side
            {
                edge = Some(edge.map_or(to, |e| e.max(to)));
            }
        });
        edge
    }

    /// The level curve moved onto the edge of the covered area, by at most `MOVED_SHARE`,
    /// and from there back into it by `overlap_mm` (a function of a point and the normal there).
    pub fn moved_wall(
        &self,
        ring: &Ring,
        step_mm: f64,
        overlap_mm: impl Fn(Point2, Vector2) -> f64 + Sync,
    ) -> Ring {
        let points = &ring.points;
        let count = points.len();
        if count < 8 {
            return ring.clone();
        }
        let moved_mm = MOVED_SHARE * self.aperture.major_mm();
        let normals: Vec<Vector2> = (0..count)
            .map(|i| {
                let along = points[(i + 2) % count] - points[(i + count - 2) % count];
                Vector2::new(-along.y, along.x)
                    .try_normalize(1e-12)
                    .unwrap_or(Vector2::zeros())
            })
            .collect();
        let mut shifts: Vec<f64> = (0..count)
            .into_par_iter()
            .map(|i| {
                let edge_mm = self.edge_mm(points[i], normals[i]);
                let edge_mm = edge_mm.unwrap_or(-moved_mm);
                edge_mm.clamp(-moved_mm, moved_mm) - overlap_mm(points[i], normals[i])
            })
            .collect();
        for _ in 0..SHIFT_ROUNDS {
            shifts = (0..count)
                .map(|i| {
                    (shifts[(i + count - 1) % count] + 2.0 * shifts[i] + shifts[(i + 1) % count])
                        / 4.0
                })
                .collect();
        }
        let moved = Ring {
            points: (0..count)
                .map(|i| points[i] + normals[i] * shifts[i])
                .collect(),
        };
        resampled(&moved, step_mm, SHIFT_ROUNDS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::edge_index::{Edge, EdgeIndex};
    use crate::geometry::test_shapes::ELLIPSE as APERTURE;
    use crate::plan::headings::profile::{TURN_WEIGHT_MM4, profile};
    use crate::plan::pass::Contact;

    /// Contacts along a straight wall on the x axis, the inside above: beads of 2 x 0.35 mm up to
    /// x = 6 mm, of 2 x 0.5 mm beyond.
    fn widening() -> Vec<Contact> {
        (0..120)
            .map(|i| Contact {
                point: Point2::new(0.1 * (f64::from(i) + 0.5), 0.0),
                normal: Vector2::y(),
                length_mm: 0.1,
                extent_mm: if i < 60 { 0.35 } else { 0.5 },
                on_axis: false,
            })
            .collect()
    }

    /// Goal: a bead widens where its inner side is to be wider, not where the turned aperture
    /// touches the wall 0.7 mm away. Method: the swept edge by chords of every pose; it crosses the
    /// mean of both widths near the step, and has them away from it.
    #[test]
    fn the_inner_edge_follows_the_wanted_width() {
        let contacts = widening();
        let wall = Edge {
            a: Point2::new(-5.0, 0.0),
            b: Point2::new(20.0, 0.0),
        };
        let far = Edge {
            a: Point2::new(20.0, 9.0),
            b: Point2::new(-5.0, 9.0),
        };
        let walls = EdgeIndex::new(vec![wall, far], 1.0);
        let placements = profile(&contacts, false, TURN_WEIGHT_MM4, &APERTURE, &walls);
        let mut laid = Laid::new(&APERTURE);
        laid.add(&placements, false);
        let edge_mm = |x: f64| {
            let p = Point2::new(x, 0.8);
            laid.edge_mm(p, Vector2::y()).expect("a bead") + 0.8
        };
        for x in [2.0, 3.0, 4.0] {
            assert!((edge_mm(x) - 0.7).abs() < 0.02, "{}", edge_mm(x));
        }
        for x in [8.0, 9.0, 10.0] {
            assert!((edge_mm(x) - 1.0).abs() < 0.02, "{}", edge_mm(x));
        }
        let crossing = (400..800)
            .map(|i| 0.01 * f64::from(i))
            .find(|&x| edge_mm(x) >= 0.85)
            .expect("the bead widens");
        assert!((crossing - 6.0).abs() < 0.2, "{crossing}");
    }

    /// Goal: the wall of the next channel moves onto what was laid, no further than allowed.
    /// Method: a ring of round beads of radius 0.3 mm on a circle of 5 mm, and level circles a
    /// little inside and far inside of its edge at 4.7 mm.
    #[test]
    fn walls_move_onto_the_beads() {
        let round = Aperture::Ellipse {
            major_mm: 0.3,
            minor_mm: 0.3,
        };
        let circle = |radius: f64, count: usize| -> Vec<Point2> {
            (0..count)
                .map(|i| {
                    let angle = std::f64::consts::TAU * i as f64 / count as f64;
                    Point2::new(radius * angle.cos(), radius * angle.sin())
                })
                .collect()
        };
        let placements: Vec<Placement> = circle(5.0, 300)
            .into_iter()
            .map(|center| Placement {
                at: Configuration {
                    center,
                    heading_rad: 0.0,
                },
                feasible: true,
                contact: widening()[0],
            })
            .collect();
        let mut laid = Laid::new(&round);
        laid.add(&placements, true);
        for (radius, expected) in [(4.6, 4.7), (4.8, 4.7), (4.0, 4.24)] {
            let ring = Ring {
                points: circle(radius, 300),
            };
            for p in &laid.moved_wall(&ring, 0.1, |_, _| 0.0).points {
                assert!((p.coords.norm() - expected).abs() < 5e-3, "{radius}: {p}");
            }
        }
    }
}

//! Is a region a polygon in the sense of OGC simple features?
//!
//! Rings simple (no crossing, no touching themselves, no spike), holes inside the exterior and
//! outside each other, rings meeting in single points at most, interior connected. Repeated points
//! are allowed, as is a repeated closing point; orientation is not checked. The check uses exact
//! predicates on the given coordinates, without a tolerance. Cost: a grid, so about linear.

use super::edge_index::{Edge, EdgeIndex};
use super::edge_meeting::{Meeting, meeting};
use super::polygon::{Box2, Region, Ring};
use super::union_find::root;
use super::{Point2, Vector2};
use std::fmt;
use thiserror::Error;

/// A ring of one region, for messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RingName {
    /// The outer boundary.
    Exterior,
    /// The hole of this number, counted from 0.
    Hole(usize),
}

impl fmt::Display for RingName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RingName::Exterior => write!(f, "the exterior"),
            RingName::Hole(number) => write!(f, "hole {number}"),
        }
    }
}

/// The fault of a region, and its place (mm, the input's coordinates).
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ValidityError {
    /// A coordinate is infinite or not a number.
    #[error("point {point} of {ring} is not finite")]
    NotFinite {
        /// Which ring.
        ring: RingName,
        /// Which point, from 0.
        point: usize,
    },
    /// Fewer than three different points.
    #[error("{ring} has only {points} different points; an outline needs three")]
    TooFewPoints {
        /// Which ring.
        ring: RingName,
        /// How many.
        points: usize,
    },
    /// The ring crosses itself, or runs twice along the same line.
    #[error("{ring} crosses itself at ({:.4}, {:.4}) mm; --repair can mend it", at_mm[0], at_mm[1])]
    SelfIntersection {
        /// Which ring.
        ring: RingName,
        /// Where.
        at_mm: [f64; 2],
    },
    /// The ring returns to an earlier point.
    #[error("{ring} touches itself at ({:.4}, {:.4}) mm; --repair can mend it", at_mm[0], at_mm[1])]
    SelfTouch {
        /// Which ring.
        ring: RingName,
        /// Where.
        at_mm: [f64; 2],
    },
    /// The ring runs out to a point and back on itself.
    #[error("{ring} has a spike at ({:.4}, {:.4}) mm; --repair can mend it", at_mm[0], at_mm[1])]
    Spike {
        /// Which ring.
        ring: RingName,
        /// Its tip.
        at_mm: [f64; 2],
    },
    /// Two rings cross, or share a stretch of line.
    #[error(
        "{first} and {second} cross or run together at ({:.4}, {:.4}) mm; --repair can mend it",
        at_mm[0], at_mm[1]
    )]
    RingsCross {
        /// One ring.
        first: RingName,
        /// The other.
        second: RingName,
        /// Where.
        at_mm: [f64; 2],
    },
    /// A hole is outside the exterior, at least at this point.
    #[error("hole {hole} is outside the exterior at ({:.4}, {:.4}) mm", at_mm[0], at_mm[1])]
    HoleOutside {
        /// Which hole.
        hole: usize,
        /// Where.
        at_mm: [f64; 2],
    },
    /// A hole is inside another.
    #[error("hole {hole} is inside hole {outer} at ({:.4}, {:.4}) mm", at_mm[0], at_mm[1])]
    HoleInHole {
        /// The inner one.
        hole: usize,
        /// The outer one.
        outer: usize,
        /// Where.
        at_mm: [f64; 2],
    },
    /// Rings touch so that the interior falls apart.
    #[error(
        "rings touch at ({:.4}, {:.4}) mm and elsewhere so that the inside falls apart; \
         --repair can make separate parts of it", at_mm[0], at_mm[1]
    )]
    Disconnected {
        /// One of the touching points.
        at_mm: [f64; 2],
    },
    /// Edges that are too close together to be checked one by one.
    #[error(
        "its {edges} edges lie so close together that {pairs} pairs of them would have to be compared: simplify the \
         drawing, a micrometre is finer than any bead"
    )]
    Crowded {
        /// How many there are.
        edges: usize,
        /// Pairs of them.
        pairs: u64,
    },
    /// Two regions of one target cross, overlap or share a stretch of boundary.
    #[error(
        "parts {first} and {second} overlap or run together at ({:.4}, {:.4}) mm; \
         --repair can join them", at_mm[0], at_mm[1]
    )]
    RegionsOverlap {
        /// One part, from 0.
        first: usize,
        /// The other.
        second: usize,
        /// Where.
        at_mm: [f64; 2],
    },
}

/// Most pairs of edges that are compared: some seconds. A million edges of a drawing have ten million.
const PAIRS_MAX: u64 = 1_000_000_000;

fn check_crowd(index: &EdgeIndex) -> Result<(), ValidityError> {
    let (edges, pairs) = (index.edges().len(), index.pairs());
    match pairs > PAIRS_MAX {
        true => Err(ValidityError::Crowded { edges, pairs }),
        false => Ok(()),
    }
}

/// Checks one region.
pub fn validate(region: &Region) -> Result<(), ValidityError> {
    let rings = Rings::of(region)?;
    let touches = rings.check_meetings()?;
    rings.check_nesting(&touches)?;
    check_connected(&touches)
}

/// Checks every region, and that no two cross, overlap or share more than points.
pub fn validate_all(regions: &[Region]) -> Result<(), ValidityError> {
    regions.iter().try_for_each(validate)?;
    validate_apart(regions)
}

/// Checks that no two of some regions, each valid by itself, cross, overlap or share more than points.
pub fn validate_apart(regions: &[Region]) -> Result<(), ValidityError> {
    if regions.len() < 2 {
        return Ok(());
    }
    let mut edges = Vec::new();
    let mut region_of = Vec::new();
    for (number, region) in regions.iter().enumerate() {
        for (a, b) in region.edges().filter(|(a, b)| a != b) {
            edges.push(Edge { a, b });
            region_of.push(number);
        }
    }
    let index = EdgeIndex::new(edges, cell_mm_for(regions.iter().flat_map(Region::rings)));
    check_crowd(&index)?;
    let mut found: Option<(usize, usize, Point2)> = None;
    index.for_pairs(|i, j| {
        if found.is_some() || region_of[i] == region_of[j] {
            return;
        }
        if let Meeting::Cross(p) | Meeting::Along(p) = meeting(index.edges()[i], index.edges()[j]) {
            found = Some((region_of[i], region_of[j], p));
        }
    });
    // Nothing crosses: then two regions overlap exactly where the exterior of one is inside the
    // other, with all of its edges.
    for (number, region) in regions.iter().enumerate() {
        if found.is_some() {
            break;
        }
        found = middles_to_ask(&region.exterior)
            .into_iter()
            .find_map(|middle| {
                let around = rings_around(&index, &region_of, middle);
                let other = around.into_iter().find(|&r| r != number);
                other.map(|r| (number, r, middle))
            });
    }
    match found {
        None => Ok(()),
        Some((i, j, p)) => Err(ValidityError::RegionsOverlap {
            first: i.min(j),
            second: i.max(j),
            at_mm: [p.x, p.y],
        }),
    }
}

/// Middles of some of a ring's edges: more than one, since another ring may touch there.
fn middles_to_ask(ring: &Ring) -> Vec<Point2> {
    const ASKED: usize = 5;
    let edges = ring.edges().filter(|(a, b)| a != b);
    let every = ring.points.len().div_ceil(ASKED).max(1);
    let asked = edges.step_by(every);
    asked.map(|(a, b)| a + (b - a) / 2.0).collect()
}

/// Those of some rings, or sets of rings, that wind around `p` an odd number of times, ascending:
/// `of` gives the one that an edge belongs to.
fn rings_around(index: &EdgeIndex, of: &[usize], p: Point2) -> Vec<usize> {
    let mut crossed = Vec::new();
    index.for_crossings(p, |edge| crossed.push(of[edge]));
    crossed.sort_unstable();
    let odd = crossed.chunk_by(|a, b| a == b);
    odd.filter(|same| same.len() % 2 == 1)
        .map(|same| same[0])
        .collect()
}

/// All edges of one region without zero-length ones, in ring order.
struct Rings {
    index: EdgeIndex,
    ring_of: Vec<usize>,
    /// First edge of each ring, and one past the last.
    first: Vec<usize>,
}

/// A point where two rings touch.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RingTouch {
    rings: [usize; 2],
    edges: [usize; 2],
    at: Point2,
}

fn name(ring: usize) -> RingName {
    if ring == 0 {
        RingName::Exterior
    } else {
        RingName::Hole(ring - 1)
    }
}

/// About a mean edge length, so that a cell holds few edges; less where edges are long and crowded,
/// as those of a comb are.
fn cell_mm_for<'a>(rings: impl Iterator<Item = &'a Ring>) -> f64 {
    let (mut length_mm, mut count) = (0.0, 0usize);
    let mut bounds: Option<Box2> = None;
    for ring in rings.filter(|ring| !ring.points.is_empty()) {
        length_mm += ring.perimeter_mm();
        count += ring.points.len();
        let own = Box2::of(&ring.points);
        bounds = Some(bounds.map_or(own, |all| Box2 {
            min: all.min.inf(&own.min),
            max: all.max.sup(&own.max),
        }));
    }
    let size = bounds.map_or(Vector2::zeros(), |bounds| bounds.size());
    let count = count.max(1) as f64;
    let crowded_mm = (size.x * size.y / count).sqrt();
    let mean_mm = length_mm / count;
    match crowded_mm > 0.0 {
        true => mean_mm.min(crowded_mm),
        false => mean_mm,
    }
}

impl Rings {
    fn of(region: &Region) -> Result<Rings, ValidityError> {
        let (mut edges, mut ring_of, mut first) = (Vec::new(), Vec::new(), vec![0]);
        for (ring, points) in region.rings().enumerate() {
            let bad = |p: &Point2| !(p.x.is_finite() && p.y.is_finite());
            if let Some(point) = points.points.iter().position(bad) {
                return Err(ValidityError::NotFinite {
                    ring: name(ring),
                    point,
                });
            }
            let before = edges.len();
            edges.extend(
                points
                    .edges()
                    .filter(|(a, b)| a != b)
                    .map(|(a, b)| Edge { a, b }),
            );
            let count = edges.len() - before;
            if count < 3 {
                return Err(ValidityError::TooFewPoints {
                    ring: name(ring),
                    points: count.max(usize::from(!points.points.is_empty())),
                });
            }
            ring_of.resize(edges.len(), ring);
            first.push(edges.len());
        }
        let index = EdgeIndex::new(edges, cell_mm_for(region.rings()));
        check_crowd(&index)?;
        Ok(Rings {
            index,
            ring_of,
            first,
        })
    }

    /// Edge after this one in its ring.
    fn next(&self, edge: usize) -> usize {
        let ring = self.ring_of[edge];
        if edge + 1 == self.first[ring + 1] {
            self.first[ring]
        } else {
            edge + 1
        }
    }

    /// Every place where edges meet that are not neighbours; the first fault by edge number wins,
    /// so that the answer does not depend on the grid.
    fn check_meetings(&self) -> Result<Vec<RingTouch>, ValidityError> {
        let mut fault: Option<((usize, usize), ValidityError)> = None;
        let mut touches: Vec<RingTouch> = Vec::new();
        self.index.for_pairs(|i, j| {
            if fault.as_ref().is_some_and(|(pair, _)| *pair <= (i, j)) {
                return;
            }
            match self.check_pair(i, j) {
                Ok(None) => {}
                Ok(Some(touch)) => touches.push(touch),
                Err(error) => fault = Some(((i, j), error)),
            }
        });
        touches.sort_by_key(|t| t.edges);
        touches.dedup();
        fault.map_or(Ok(touches), |(_, error)| Err(error))
    }

    fn check_pair(&self, i: usize, j: usize) -> Result<Option<RingTouch>, ValidityError> {
        let (e, f) = (self.index.edges()[i], self.index.edges()[j]);
        let rings = [self.ring_of[i], self.ring_of[j]];
        let ring = name(rings[0]);
        let place = |p: Point2| [p.x, p.y];
        let met = meeting(e, f);
        if rings[0] != rings[1] {
            return match met {
                Meeting::None => Ok(None),
                Meeting::Touch(at) => Ok(Some(RingTouch {
                    rings,
                    edges: [i, j],
                    at,
                })),
                Meeting::Cross(p) | Meeting::Along(p) => Err(ValidityError::RingsCross {
                    first: ring,
                    second: name(rings[1]),
                    at_mm: place(p),
                }),
            };
        }
        let shared = if self.next(i) == j {
            Some(e.b)
        } else if self.next(j) == i {
            Some(f.b)
        } else {
            None
        };
        match (met, shared) {
            (Meeting::None, _) => Ok(None),
            (Meeting::Touch(p), Some(q)) if p == q => Ok(None),
            (Meeting::Along(_), Some(tip)) => Err(ValidityError::Spike {
                ring,
                at_mm: place(tip),
            }),
            (Meeting::Touch(p), _) => Err(ValidityError::SelfTouch {
                ring,
                at_mm: place(p),
            }),
            (Meeting::Cross(p) | Meeting::Along(p), _) => Err(ValidityError::SelfIntersection {
                ring,
                at_mm: place(p),
            }),
        }
    }

    /// Holes inside the exterior and outside each other. Nothing crosses at this stage, so one
    /// point of a hole decides, unless the hole touches: then every piece between touches is
    /// tested.
    fn check_nesting(&self, touches: &[RingTouch]) -> Result<(), ValidityError> {
        let rings = self.first.len() - 1;
        let mut is_touched = vec![false; rings];
        let mut on_edges: Vec<(usize, Point2)> = Vec::with_capacity(2 * touches.len());
        for touch in touches {
            touch.rings.iter().for_each(|&ring| is_touched[ring] = true);
            on_edges.extend(touch.edges.map(|edge| (edge, touch.at)));
        }
        on_edges.sort_by_key(|(edge, _)| *edge);
        for (ring, &is_touched) in is_touched.iter().enumerate().take(rings).skip(1) {
            let last = if is_touched {
                self.first[ring + 1]
            } else {
                self.first[ring] + 1
            };
            for edge in self.first[ring]..last {
                let first = on_edges.partition_point(|(other, _)| *other < edge);
                let here = on_edges[first..].iter().take_while(|on| on.0 == edge);
                for middle in self.piece_middles(edge, here.map(|on| on.1)) {
                    self.check_place(ring, middle)?;
                }
            }
        }
        Ok(())
    }

    /// Middles of the pieces of an edge between the points where other rings touch it.
    fn piece_middles(&self, edge: usize, touched: impl Iterator<Item = Point2>) -> Vec<Point2> {
        let Edge { a, b } = self.index.edges()[edge];
        let mut stops = vec![a, b];
        stops.extend(touched.filter(|p| *p != a && *p != b));
        let along = |p: &Point2| (b - a).dot(&(p - a));
        stops.sort_by(|p, q| along(p).total_cmp(&along(q)));
        stops
            .windows(2)
            .map(|w| w[0] + (w[1] - w[0]) / 2.0)
            .collect()
    }

    fn check_place(&self, ring: usize, p: Point2) -> Result<(), ValidityError> {
        let around = rings_around(&self.index, &self.ring_of, p);
        let at_mm = [p.x, p.y];
        if around.first() != Some(&0) {
            return Err(ValidityError::HoleOutside {
                hole: ring - 1,
                at_mm,
            });
        }
        match around[1..].iter().find(|&&other| other != ring) {
            Some(outer) => Err(ValidityError::HoleInHole {
                hole: ring - 1,
                outer: outer - 1,
                at_mm,
            }),
            None => Ok(()),
        }
    }
}

/// The inside falls apart exactly where rings and touching points, as a graph, hold a cycle.
fn check_connected(touches: &[RingTouch]) -> Result<(), ValidityError> {
    let mut links: Vec<([f64; 2], usize)> = touches
        .iter()
        .flat_map(|t| t.rings.map(|ring| ([t.at.x, t.at.y], ring)))
        .collect();
    links.sort_by(|p, q| {
        p.0[0]
            .total_cmp(&q.0[0])
            .then(p.0[1].total_cmp(&q.0[1]))
            .then(p.1.cmp(&q.1))
    });
    links.dedup();
    let rings = links.iter().map(|l| l.1 + 1).max().unwrap_or(0);
    let mut parent: Vec<usize> = (0..rings + links.len()).collect();
    let mut point_node = rings;
    for (k, (at_mm, ring)) in links.iter().enumerate() {
        if k > 0 && links[k - 1].0 != *at_mm {
            point_node += 1;
        }
        let (a, b) = (root(&mut parent, *ring), root(&mut parent, point_node));
        if a == b {
            return Err(ValidityError::Disconnected { at_mm: *at_mm });
        }
        parent[a.max(b)] = a.min(b);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::{SQUARE, random_numbers, region};

    /// Goal: what OGC allows passes. Method: repeated points, a hole touching the exterior once, on
    /// an edge or on a vertex, three holes that touch in one point, either orientation.
    #[test]
    fn allowed() {
        let valid: [&[&[[f64; 2]]]; 5] = [
            &[&[
                [0.0, 0.0],
                [0.0, 0.0],
                [10.0, 0.0],
                [10.0, 10.0],
                [0.0, 0.0],
            ]],
            &[SQUARE, &[[5.0, 0.0], [6.0, 2.0], [4.0, 2.0]]],
            &[SQUARE, &[[0.0, 0.0], [2.0, 1.0], [1.0, 2.0]]],
            &[
                SQUARE,
                &[[5.0, 5.0], [6.0, 5.5], [6.0, 6.0]],
                &[[5.0, 5.0], [4.0, 5.5], [4.0, 6.0]],
                &[[5.0, 5.0], [4.5, 3.0], [5.5, 3.0]],
            ],
            &[&[[0.0, 0.0], [0.0, 10.0], [10.0, 10.0], [10.0, 0.0]]],
        ];
        for rings in valid {
            assert_eq!(validate(&region(rings)), Ok(()), "{rings:?}");
        }
    }

    /// Goal: every kind of fault is named with its place.
    #[test]
    fn faults_are_named() {
        use RingName::{Exterior, Hole};
        let cases: Vec<(Vec<&[[f64; 2]]>, ValidityError)> = vec![
            (
                vec![&[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]]],
                ValidityError::SelfIntersection {
                    ring: Exterior,
                    at_mm: [2.0, 2.0],
                },
            ),
            (
                vec![&[
                    [0.0, 0.0],
                    [4.0, 0.0],
                    [2.0, 2.0],
                    [4.0, 4.0],
                    [0.0, 4.0],
                    [2.0, 2.0],
                ]],
                ValidityError::SelfTouch {
                    ring: Exterior,
                    at_mm: [2.0, 2.0],
                },
            ),
            (
                vec![&[[0.0, 0.0], [4.0, 0.0], [8.0, 0.0], [5.0, 0.0], [2.0, 5.0]]],
                ValidityError::Spike {
                    ring: Exterior,
                    at_mm: [8.0, 0.0],
                },
            ),
            (
                vec![SQUARE, &[[8.0, 5.0], [12.0, 4.0], [12.0, 6.0]]],
                ValidityError::RingsCross {
                    first: Exterior,
                    second: Hole(0),
                    at_mm: [10.0, 4.5],
                },
            ),
            (
                vec![SQUARE, &[[20.0, 5.0], [22.0, 4.0], [22.0, 6.0]]],
                ValidityError::HoleOutside {
                    hole: 0,
                    at_mm: [21.0, 4.5],
                },
            ),
            (
                vec![
                    SQUARE,
                    &[[1.0, 1.0], [9.0, 1.0], [9.0, 9.0], [1.0, 9.0]],
                    &[[3.0, 3.0], [5.0, 3.0], [4.0, 5.0]],
                ],
                ValidityError::HoleInHole {
                    hole: 1,
                    outer: 0,
                    at_mm: [4.0, 3.0],
                },
            ),
            (
                vec![SQUARE, &[[5.0, 0.0], [6.0, 5.0], [5.0, 10.0], [4.0, 5.0]]],
                ValidityError::Disconnected { at_mm: [5.0, 10.0] },
            ),
            (
                vec![&[[0.0, 0.0], [4.0, 4.0], [0.0, 0.0]]],
                ValidityError::TooFewPoints {
                    ring: Exterior,
                    points: 2,
                },
            ),
            (
                vec![&[[0.0, 0.0], [4.0, 4.0], [0.0, f64::NAN]]],
                ValidityError::NotFinite {
                    ring: Exterior,
                    point: 2,
                },
            ),
        ];
        for (rings, expected) in cases {
            assert_eq!(validate(&region(&rings)), Err(expected));
        }
    }

    /// Goal: a hole that leaves through a vertex, crossing no edge properly, is found. Method: a
    /// kite whose side vertices lie on the exterior's edge, half inside.
    #[test]
    fn crossing_through_touching_points() {
        let kite = region(&[SQUARE, &[[10.0, 4.0], [13.0, 5.0], [10.0, 6.0], [8.0, 5.0]]]);
        assert!(validate(&kite).is_err());
        // The exterior's corner pokes through the middle of the hole's edge.
        let notch = region(&[
            &[
                [0.0, 0.0],
                [10.0, 0.0],
                [10.0, 10.0],
                [5.0, 5.0],
                [0.0, 10.0],
            ],
            &[[4.0, 5.0], [6.0, 5.0], [6.0, 7.0], [4.0, 7.0]],
        ]);
        assert!(validate(&notch).is_err());
    }

    /// Goal: exact on degenerate rings. Method: random rings on a 5 x 5 grid of integers, where
    /// touching, overlapping and spiky ones abound, against a plain integer test of all pairs.
    #[test]
    fn agrees_with_integers() {
        type P = (i64, i64);
        let side =
            |a: P, b: P, c: P| ((b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0)).signum();
        let on = |a: P, b: P, c: P| {
            side(a, b, c) == 0
                && (a.0.min(b.0)..=a.0.max(b.0)).contains(&c.0)
                && (a.1.min(b.1)..=a.1.max(b.1)).contains(&c.1)
        };
        let meet = |a: P, b: P, c: P, d: P| {
            on(a, b, c)
                || on(a, b, d)
                || on(c, d, a)
                || on(c, d, b)
                || (side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0)
        };
        let mut random = random_numbers(17);
        let mut random = || (5.0 * random()) as i64;
        let (mut simple, mut faulty) = (0, 0);
        for round in 0..20_000 {
            let count = 3 + round % 5;
            let mut points: Vec<P> = (0..count).map(|_| (random(), random())).collect();
            points.dedup();
            while points.len() > 1 && points[0] == points[points.len() - 1] {
                points.pop();
            }
            let n = points.len();
            let at = |i: usize| points[i % n];
            let mut expected = n >= 3;
            for i in 0..n {
                for j in i + 1..n {
                    let neighbours = j == i + 1 || (i == 0 && j == n - 1);
                    expected &= if neighbours {
                        // They share one end; neither may hold the other's far end.
                        let (far_i, far_j) = if j == i + 1 {
                            (at(i), at(j + 1))
                        } else {
                            (at(i + 1), at(j))
                        };
                        !on(at(i), at(i + 1), far_j) && !on(at(j), at(j + 1), far_i)
                    } else {
                        !meet(at(i), at(i + 1), at(j), at(j + 1))
                    };
                }
            }
            let exact: Vec<[f64; 2]> = points.iter().map(|p| [p.0 as f64, p.1 as f64]).collect();
            assert_eq!(validate(&region(&[&exact])).is_ok(), expected, "{points:?}");
            simple += u32::from(expected);
            faulty += u32::from(!expected);
        }
        assert!(simple > 2000 && faulty > 2000, "{simple} {faulty}");
    }

    /// Goal: parts of one target may touch in points, no more.
    #[test]
    fn parts() {
        let beside = region(&[&[[10.0, 10.0], [20.0, 10.0], [20.0, 20.0]]]);
        let shared = region(&[&[[10.0, 2.0], [20.0, 5.0], [10.0, 8.0]]]);
        let within = region(&[&[[2.0, 2.0], [4.0, 2.0], [3.0, 4.0]]]);
        let square = region(&[SQUARE]);
        assert_eq!(validate_all(&[square.clone(), beside]), Ok(()));
        for other in [shared, within, square.clone()] {
            let found = validate_all(&[square.clone(), other]);
            assert!(
                matches!(found, Err(ValidityError::RegionsOverlap { .. })),
                "{found:?}"
            );
        }
    }

    /// Goal: agrees with what others say of real and awkward polygons. Method: the reference files
    /// carry a flag; skipped where they are absent.
    #[test]
    fn reference_polygons() {
        let mut checked = 0;
        for folder in ["slices", "polygons", "peer"] {
            let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
            let Ok(files) = std::fs::read_dir(format!("{root}/{folder}")) else {
                assert!(
                    std::env::var_os("HEADWAY_DEMAND_DATA").is_none(),
                    "no reference data"
                );
                println!("skipped: no reference data in {root}/{folder}");
                continue;
            };
            for file in files.map(|f| f.unwrap().path()) {
                if file.extension().is_none_or(|e| e != "json") {
                    continue;
                }
                let text = std::fs::read_to_string(&file).unwrap();
                let json: serde_json::Value = serde_json::from_str(&text).unwrap();
                let ring = |value: &serde_json::Value| -> Vec<[f64; 2]> {
                    serde_json::from_value(value.clone()).unwrap()
                };
                let mut rings = vec![ring(&json["exterior"])];
                rings.extend(json["holes"].as_array().unwrap().iter().map(ring));
                let slices: Vec<&[[f64; 2]]> = rings.iter().map(Vec::as_slice).collect();
                let found = validate(&region(&slices));
                let flag = json["valid"].as_bool().unwrap();
                assert_eq!(found.is_ok(), flag, "{}: {found:?}", file.display());
                if let Err(error) = found {
                    println!("{}: {error}", file.display());
                }
                checked += 1;
            }
        }
        println!("{checked} reference polygons");
    }
}

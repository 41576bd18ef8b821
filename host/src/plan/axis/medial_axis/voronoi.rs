//! The medial axis from the segment Voronoi diagram of the boundary.
//!
//! The diagram comes from boostvoronoi, which is fast but can be silently wrong. So the outline is
//! put on a 100 nm grid, rotated by an odd angle (axis-parallel combs are its weak spot), and every
//! returned vertex and edge is checked against the boundary itself: its distance to its generators
//! must be its distance to the nearest edge. If that fails, another angle is tried. Edges are then
//! rebuilt from their generators in the plane's own coordinates.
//!
//! In: an index of a valid region's edges (mm). Out: the interior axis as vertices and edges with
//! radii (mm), every vertex checked to a few grid units of 100 nm; or an error if no angle gives a
//! correct one. Not covered: the diagram outside the region.

use super::grid::{Grid, GridSegment};
use super::parabola::Parabola;
use super::{AxisEdge, AxisPoint, AxisVertex, Generator, MedialAxis};
use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::union_find::root;
use crate::text::refusal::{Refusal, refusal};
use boostvoronoi::prelude::{Builder, BvError, CellIndex, Diagram, SourceCategory};
use rayon::prelude::*;

/// Angles tried in turn, rad: odd, so that no usual outline is aligned with the grid.
const ANGLES_RAD: [f64; 5] = [0.32, 0.711, 1.137, 0.093, 1.418];
/// Distances may disagree by this many grid units: two of rounding, the rest the diagram's own.
const DISAGREEMENT_UNITS: f64 = 5.0;
/// Vertices closer than this many grid units along an edge are one.
const MERGE_UNITS: f64 = 2.0;
/// Most points of one flattened edge.
const POINTS_MAX: usize = 4096;
/// Largest step of asinh(x/h) along a curved edge, so that object angles may be interpolated.
const ANGLE_STEP: f64 = 0.25;

/// Chord error of the axis, of the aperture's unit.
const FLATTEN: f64 = 1e-3;

/// How finely the axis is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisOptions {
    /// Chord error of flattened parabolas, and error of linearly interpolated radii.
    pub flatten_mm: f64,
}

impl Default for AxisOptions {
    fn default() -> Self {
        AxisOptions {
            flatten_mm: FLATTEN,
        }
    }
}

impl AxisOptions {
    /// For the beads of an aperture.
    pub fn of(aperture: &Aperture) -> AxisOptions {
        AxisOptions {
            flatten_mm: FLATTEN * aperture.unit_mm(),
        }
    }
}

/// An edge of the diagram inside the region.
struct RawEdge {
    v: [usize; 2],
    generators: [Generator; 2],
    /// True for a parabola whose straight chord agrees with the boundary although the parabola does
    /// not.
    is_straight: bool,
}

/// The diagram's interior edges, checked.
struct RawAxis {
    points: Vec<Point2>,
    /// Distance to the boundary of each point at which edges inside the region end.
    clearances_mm: Vec<Option<f64>>,
    edges: Vec<RawEdge>,
    suspects: usize,
    unit_mm: f64,
}

/// See [`MedialAxis::of_edges`].
pub(super) fn interior_axis(
    index: &EdgeIndex,
    options: &AxisOptions,
) -> Result<MedialAxis, Refusal> {
    if index.edges().is_empty() {
        return Err(refusal!("the region has no edges"));
    }
    let mut best: Option<RawAxis> = None;
    let mut reason = String::new();
    // Most outlines need one angle; the others are tried two at a time, and judged in their order.
    let (first, others) = ANGLES_RAD.split_at(1);
    for angles_rad in std::iter::once(first).chain(others.chunks(2)) {
        let attempts: Vec<Result<RawAxis, BvError>> = angles_rad
            .par_iter()
            .map(|&angle_rad| attempt(index, angle_rad))
            .collect();
        for attempt in attempts {
            match attempt {
                Ok(raw) if best.as_ref().is_none_or(|b| raw.suspects < b.suspects) => {
                    best = Some(raw);
                }
                Ok(_) => {}
                Err(error) => reason = error.to_string(),
            }
        }
        if best.as_ref().is_some_and(|best| best.suspects == 0) {
            break;
        }
    }
    let raw = best.ok_or_else(|| {
        refusal!("the medial axis cannot be computed ({reason}); the outline may cross itself")
    })?;
    Ok(assemble(index, raw, options))
}

fn attempt(index: &EdgeIndex, angle_rad: f64) -> Result<RawAxis, BvError> {
    let grid = Grid::new(index, angle_rad);
    let segments = grid.segments(index.edges());
    let lines: Vec<[i32; 4]> = segments
        .iter()
        .map(|s| [s.a[0], s.a[1], s.b[0], s.b[1]])
        .collect();
    let diagram = Builder::<i32>::default()
        .with_segments(lines.iter())?
        .build()?;
    let points: Vec<Point2> = diagram
        .vertices()
        .iter()
        .map(|v| grid.to_plane([v.x(), v.y()]))
        .collect();
    let mut raw = RawAxis {
        clearances_mm: Vec::new(),
        points,
        edges: Vec::new(),
        suspects: 0,
        unit_mm: grid.unit_mm(),
    };
    collect_edges(index, &diagram, grid, &segments, &mut raw)?;
    Ok(raw)
}

/// Adds the diagram's edges inside the region that agree with the boundary; counts those that
/// do not.
fn collect_edges(
    index: &EdgeIndex,
    diagram: &Diagram,
    grid: Grid,
    segments: &[GridSegment],
    raw: &mut RawAxis,
) -> Result<(), BvError> {
    let inside: Vec<Candidate> = diagram
        .edges()
        .par_iter()
        .filter_map(|edge| {
            let found = candidate(index, diagram, grid, segments, &raw.points, edge);
            found.transpose()
        })
        .collect::<Result<_, BvError>>()?;
    let mut is_end = vec![false; raw.points.len()];
    for vertex in inside.iter().flat_map(|candidate| candidate.edge.v) {
        is_end[vertex] = true;
    }
    raw.clearances_mm = is_end
        .into_par_iter()
        .zip(&raw.points)
        .map(|(is_end, &point)| is_end.then(|| clearance_at_mm(index, point)))
        .collect();
    let tolerance_mm = DISAGREEMENT_UNITS * grid.unit_mm();
    let verdicts: Vec<Verdict> = inside
        .par_iter()
        .map(|candidate| candidate.verdict(index, raw, tolerance_mm))
        .collect();
    for (candidate, verdict) in inside.into_iter().zip(verdicts) {
        let is_straight = match verdict {
            Verdict::Agrees => false,
            Verdict::AgreesStraight => true,
            Verdict::Outside => continue,
            Verdict::Suspect => {
                raw.suspects += 1;
                continue;
            }
        };
        raw.edges.push(RawEdge {
            is_straight,
            ..candidate.edge
        });
    }
    Ok(())
}

/// An edge of the diagram whose middle is inside.
struct Candidate {
    edge: RawEdge,
    middle: Point2,
}

/// The diagram's edge, once for it and its twin, if it is one of the axis inside the region.
fn candidate(
    index: &EdgeIndex,
    diagram: &Diagram,
    grid: Grid,
    segments: &[GridSegment],
    points: &[Point2],
    edge: &boostvoronoi::prelude::Edge,
) -> Result<Option<Candidate>, BvError> {
    let twin = edge.twin()?;
    if edge.id().usize() > twin.usize() || !edge.is_primary() {
        return Ok(None);
    }
    let Some(v) = ends(diagram, edge.id())? else {
        return Ok(None);
    };
    let generator = |cell: CellIndex| generator_of(index, diagram, grid, segments, cell);
    let generators = [
        generator(edge.cell()?)?,
        generator(diagram.edge_get_cell(twin)?)?,
    ];
    let edge = RawEdge {
        v,
        generators,
        is_straight: false,
    };
    let middle = middle_of(index.edges(), points, &edge);
    Ok(index.contains(middle).then_some(Candidate { edge, middle }))
}

/// Result of checking a candidate against the boundary.
enum Verdict {
    Agrees,
    /// Only with a straight edge.
    AgreesStraight,
    Outside,
    Suspect,
}

impl Candidate {
    /// Whether ends and middle are as far from the boundary as from what made them.
    fn verdict(&self, index: &EdgeIndex, raw: &RawAxis, tolerance_mm: f64) -> Verdict {
        let agrees = |p: Point2, clearance_mm: f64| {
            self.edge.generators.iter().all(|g| {
                let distance_mm = (g.foot(index.edges(), p) - p).norm();
                (distance_mm - clearance_mm).abs() <= tolerance_mm
            })
        };
        let end = |v: usize| raw.clearances_mm[v].is_some_and(|mm| agrees(raw.points[v], mm));
        if !self.edge.v.into_iter().all(end) {
            return Verdict::Suspect;
        }
        if agrees(self.middle, clearance_at_mm(index, self.middle)) {
            return Verdict::Agrees;
        }
        // The grid turns an edge a few units long by whole degrees, and far off its line is
        // another's: the parabola of the true edge bulges, the diagram's hardly does.
        let [from, to] = self.edge.v.map(|v| raw.points[v]);
        let middle = nalgebra::center(&from, &to);
        if !index.contains(middle) {
            Verdict::Outside
        } else if agrees(middle, clearance_at_mm(index, middle)) {
            Verdict::AgreesStraight
        } else {
            Verdict::Suspect
        }
    }
}

/// What the cell belongs to, in the plane's own coordinates.
fn generator_of(
    index: &EdgeIndex,
    diagram: &Diagram,
    grid: Grid,
    segments: &[GridSegment],
    cell: CellIndex,
) -> Result<Generator, BvError> {
    let (source, category) = diagram.cell(cell)?.source_index_2();
    let segment = segments[source.usize()];
    let end = match category {
        SourceCategory::Segment => return Ok(Generator::Edge(segment.source)),
        SourceCategory::SegmentEnd => segment.b,
        _ => segment.a,
    };
    let on_grid = grid.to_plane([f64::from(end[0]), f64::from(end[1])]);
    let Edge { a, b } = index.edges()[segment.source];
    // The true vertex, not its rounded image; a cut has none.
    let near = |p: Point2| (p - on_grid).norm() <= grid.unit_mm();
    let exact = if near(a) {
        a
    } else if near(b) {
        b
    } else {
        on_grid
    };
    Ok(Generator::Vertex(exact))
}

fn ends(
    diagram: &Diagram,
    edge: boostvoronoi::prelude::EdgeIndex,
) -> Result<Option<[usize; 2]>, BvError> {
    let v0 = diagram.edge_get_vertex0(edge)?;
    let v1 = diagram.edge_get_vertex1(edge)?;
    Ok(v0.zip(v1).map(|(v0, v1)| [v0.usize(), v1.usize()]))
}

fn clearance_at_mm(index: &EdgeIndex, p: Point2) -> f64 {
    index.nearest(p).map_or(f64::INFINITY, |n| n.distance_mm)
}

/// A point in the middle of an edge, on the axis.
fn middle_of(edges: &[Edge], points: &[Point2], edge: &RawEdge) -> Point2 {
    let ends = edge.v.map(|v| points[v]);
    match Parabola::of(edges, &edge.generators) {
        Some(parabola) => {
            let [x0, x1] = ends.map(|p| parabola.abscissa(p));
            parabola.point((x0 + x1) / 2.0)
        }
        None => ends[0] + (ends[1] - ends[0]) / 2.0,
    }
}

/// Points between the two ends, ends included.
fn flattened(edges: &[Edge], edge: &RawEdge, ends: [Point2; 2], flatten_mm: f64) -> Vec<Point2> {
    let steps = |x: [f64; 2], h: f64, step: f64| -> Vec<f64> {
        let s = x.map(|x| (x / h).asinh());
        let count = ((s[1] - s[0]).abs() / step)
            .ceil()
            .clamp(1.0, POINTS_MAX as f64);
        let at = |i: usize| h * (s[0] + (s[1] - s[0]) * i as f64 / count).sinh();
        (1..count as usize).map(at).collect()
    };
    let inner: Vec<Point2> = if edge.is_straight {
        Vec::new()
    } else if let Some(parabola) = Parabola::of(edges, &edge.generators) {
        let x = ends.map(|p| parabola.abscissa(p));
        // Chord error (dx)²/8h with dx = sqrt(h² + x²) ds, that is y ds²/4.
        let reach = x[0].abs().max(x[1].abs());
        let rise = (reach * reach + parabola.height * parabola.height) / (2.0 * parabola.height);
        let step = (4.0 * flatten_mm / rise).sqrt().min(ANGLE_STEP);
        steps(x, parabola.height, step)
            .into_iter()
            .map(|x| parabola.point(x))
            .collect()
    } else if let [Generator::Vertex(p), Generator::Vertex(q)] = edge.generators {
        // Straight, but the radius sqrt(h² + x²) is not linear along it.
        let (half, middle) = ((q - p).norm() / 2.0, p + (q - p) / 2.0);
        let along = (ends[1] - ends[0]).normalize();
        if half <= 1e-9 || !along.x.is_finite() {
            return ends.to_vec();
        }
        let x = ends.map(|e| along.dot(&(e - middle)));
        let step = (8.0 * flatten_mm / half).sqrt().min(ANGLE_STEP);
        let start = ends[0];
        steps(x, half, step)
            .into_iter()
            .map(|t| start + along * (t - x[0]))
            .collect()
    } else {
        Vec::new()
    };
    std::iter::once(ends[0])
        .chain(inner)
        .chain([ends[1]])
        .collect()
}

/// A point of the axis from its generators.
fn axis_point(edges: &[Edge], generators: &[Generator; 2], point: Point2) -> AxisPoint {
    let feet = generators.map(|g| g.foot(edges, point));
    let spokes = feet.map(|f| f - point);
    let object_angle_rad = match *generators {
        // Constant along a bisector, and defined where the radius is 0.
        [Generator::Edge(e), Generator::Edge(f)] => edges[e]
            .normal()
            .dot(&edges[f].normal())
            .clamp(-1.0, 1.0)
            .acos(),
        _ => spokes[0]
            .perp(&spokes[1])
            .atan2(spokes[0].dot(&spokes[1]))
            .abs(),
    };
    AxisPoint {
        point,
        radius_mm: spokes[0].norm().min(spokes[1].norm()),
        object_angle_rad,
        feet,
    }
}

/// Merges vertices closer than the grid's resolution, and builds the graph.
fn assemble(index: &EdgeIndex, raw: RawAxis, options: &AxisOptions) -> MedialAxis {
    let merge_mm = MERGE_UNITS * raw.unit_mm;
    let mut parent: Vec<usize> = (0..raw.points.len()).collect();
    for edge in &raw.edges {
        let [p, q] = edge.v.map(|v| raw.points[v]);
        if (q - p).norm() <= merge_mm {
            let (a, b) = (root(&mut parent, edge.v[0]), root(&mut parent, edge.v[1]));
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut axis = MedialAxis {
        dropped_edges: raw.suspects,
        ..MedialAxis::default()
    };
    let mut number_of = vec![usize::MAX; raw.points.len()];
    for edge in &raw.edges {
        let roots = edge.v.map(|v| root(&mut parent, v));
        let long = (raw.points[edge.v[1]] - raw.points[edge.v[0]]).norm() > merge_mm;
        if roots[0] == roots[1] && !long {
            continue;
        }
        for r in roots {
            if number_of[r] == usize::MAX {
                number_of[r] = axis.vertices.len();
                let point = raw.points[r];
                let known_mm = raw.clearances_mm[r];
                let radius_mm = known_mm.unwrap_or_else(|| clearance_at_mm(index, point));
                axis.vertices.push(AxisVertex {
                    point,
                    radius_mm,
                    feet: Vec::new(),
                });
            }
        }
        let ends = roots.map(|r| raw.points[r]);
        let points: Vec<AxisPoint> = flattened(index.edges(), edge, ends, options.flatten_mm)
            .into_iter()
            .map(|p| axis_point(index.edges(), &edge.generators, p))
            .collect();
        let [v0, v1] = roots.map(|r| number_of[r]);
        for (vertex, end) in [(v0, points.first()), (v1, points.last())] {
            for foot in end.iter().flat_map(|p| p.feet) {
                let feet = &mut axis.vertices[vertex].feet;
                if feet.iter().all(|f| (f - foot).norm() > merge_mm) {
                    feet.push(foot);
                }
            }
        }
        axis.edges.push(AxisEdge {
            v0,
            v1,
            points,
            generators: edge.generators,
        });
    }
    axis.link();
    axis
}

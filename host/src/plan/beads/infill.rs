//! Straight lines over the area that the walls leave uncovered, with the heading across the travel.
//!
//! Lines run at the infill's angle, one bead wide. A solid infill divides each connected area into
//! equal rows and turns the nozzle so that its bead is as wide as a row; a sparse one prints the
//! widest bead at even spacing, on one grid for the complete layer. A line extends as far as the
//! aperture at its heading fits: the centres at which an edge touches the aperture form an
//! interval, found exactly for every edge, and the line is free between these intervals.
//!
//! Input: regions (mm, local). Output: open passes, unordered. Not covered: the linking of rows.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::{Box2, Region, Ring};
use crate::geometry::{Point2, Vector2};
use crate::plan::axis::medial_axis::{AxisOptions, MedialAxis};
use crate::plan::axis::pruned_axis::Axis;
use crate::plan::beads::passes::{PassSettings, passes};
use crate::plan::pass::{Contact, LayerPass, PassKind, Placement};
use crate::settings::Infill;
use rayon::prelude::*;
use std::f64::consts::FRAC_PI_2;

/// How far the flanks of a line may reach into the walls, against a: the walls' inner edge waves by
/// about this much, and a row that touches it would be cut at every wave.
const FLANK_SHARE: f64 = 0.04;
/// The same for a bridge: its rows go from anchor to anchor or hang, and nothing fills what one leaves open.
const BRIDGE_FLANK_SHARE: f64 = 0.3;
/// Shortest line against b: less would be a blot.
const LENGTH_SHARE_MIN: f64 = 1.0;
/// Distance of placements along a line, against b.
const STEP_SHARE: f64 = 2.0;
/// Most rows of one layer; the rest stays open, which the figures show.
const ROWS_MAX: f64 = 1e6;
/// Rounds of the search for the end of a blocked interval: to 1e-9 of the edge.
const SEARCH_ROUNDS: usize = 48;

/// Mean width of an area, relative to a, below which a solid infill is printed in loops: lines
/// across it would be little more than their two ends.
const LOOPS_SHARE: f64 = 6.0;
/// Share of its box above which such an area is a straight strip, which gets lines along it.
const STRIP_SHARE_MIN: f64 = 0.8;
/// Sides of a strip whose directions are tried, the longest.
const SIDES_TRIED: usize = 24;

/// All passes inside the walls: lines, and where a solid infill has too little room for lines across it, lines along
/// straight strips and loops elsewhere.
pub fn infill_passes(
    regions: &[Region],
    infill: &Infill,
    settings: &PassSettings,
) -> Vec<LayerPass> {
    let lines = |regions: &[Region], infill: &Infill| {
        infill_lines(
            regions,
            &settings.aperture,
            infill,
            settings.overlap,
            FLANK_SHARE,
        )
    };
    let (mut for_lines, mut found) = (Vec::new(), Vec::new());
    for region in regions {
        let is_strip = infill.is_solid() && is_narrow(region, &settings.aperture);
        let own = match is_strip {
            true => strip_passes(region, infill, settings, &lines),
            false => Vec::new(),
        };
        if own.is_empty() {
            for_lines.push(region.clone());
        }
        found.extend(own);
    }
    found.extend(lines(&for_lines, infill));
    found
}

/// Passes of an area with too little room for lines across it: lines along it where it is straight, else loops; none if
/// neither fits.
fn strip_passes(
    strip: &Region,
    infill: &Infill,
    settings: &PassSettings,
    lines: &impl Fn(&[Region], &Infill) -> Vec<LayerPass>,
) -> Vec<LayerPass> {
    if let Some(angle_rad) = strip_angle_rad(strip, &settings.aperture) {
        let along = Infill {
            angle_rad,
            ..*infill
        };
        let along = lines(std::slice::from_ref(strip), &along);
        if !along.is_empty() {
            return along;
        }
    }
    loops_of(strip, settings)
}

/// Parallel lines over open space, all in the direction `angle_rad`.
pub fn bridge_lines(regions: &[Region], angle_rad: f64, settings: &PassSettings) -> Vec<LayerPass> {
    let infill = Infill {
        angle_rad,
        ..Infill::solid(0)
    };
    let (aperture, flanks) = (&settings.aperture, BRIDGE_FLANK_SHARE);
    let mut lines = infill_lines(regions, aperture, &infill, settings.overlap, flanks);
    for line in &mut lines {
        line.kind = PassKind::Bridge;
    }
    lines
}

/// Parallel lines over the lines of a sparse infill, all in the direction `angle_rad`, and the loops of areas with too
/// little room for them.
pub fn roof_lines(
    regions: &[Region],
    angle_rad: f64,
    settings: &PassSettings,
) -> (Vec<LayerPass>, Vec<LayerPass>) {
    let infill = Infill {
        angle_rad,
        ..Infill::solid(0)
    };
    let passes = infill_passes(regions, &infill, settings).into_iter();
    let (mut lines, loops): (Vec<LayerPass>, _) = passes.partition(|pass| pass.kind.is_line());
    for line in &mut lines {
        line.kind = PassKind::Roof;
    }
    (lines, loops)
}

/// Twice the area over the perimeter: the width of a strip.
fn is_narrow(region: &Region, aperture: &Aperture) -> bool {
    let perimeter_mm: f64 = region.rings().map(Ring::perimeter_mm).sum();
    2.0 * region.area_mm2() < LOOPS_SHARE * aperture.major_mm() * perimeter_mm
}

/// Direction of a straight strip that takes two lines or more: along it. Of one that a bead fills, the bead on its axis
/// has its width.
fn strip_angle_rad(region: &Region, aperture: &Aperture) -> Option<f64> {
    if !region.holes.is_empty() {
        return None;
    }
    let mut sides: Vec<Vector2> = region.exterior.edges().map(|(a, b)| b - a).collect();
    sides.sort_by(|p, q| q.norm().total_cmp(&p.norm()));
    let extent_mm = |axis: Vector2| {
        let along = region.exterior.points.iter().map(|p| p.coords.dot(&axis));
        let [low, high] = along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], t| {
            [low.min(t), high.max(t)]
        });
        high - low
    };
    let boxes = sides.iter().take(SIDES_TRIED).filter_map(|side| {
        let along = side.try_normalize(1e-12)?;
        let width_mm = extent_mm(Vector2::new(-along.y, along.x));
        Some((along, width_mm, extent_mm(along)))
    });
    // Of equal widths the first: rounding must not choose.
    let narrowest = boxes.reduce(|best, own| if own.1 < best.1 - 1e-9 { own } else { best });
    let (along, width_mm, length_mm) = narrowest?;
    let is_straight = region.area_mm2() >= STRIP_SHARE_MIN * width_mm * length_mm;
    let takes_two = width_mm > 2.0 * (1.0 + FLANK_SHARE) * aperture.major_mm();
    (is_straight && takes_two).then(|| along.y.atan2(along.x))
}

/// The area filled along its outline; nothing where it has no medial axis.
fn loops_of(region: &Region, settings: &PassSettings) -> Vec<LayerPass> {
    let walls = EdgeIndex::of_region(region, settings.aperture.major_mm());
    let axis = MedialAxis::of_edges(&walls, &AxisOptions::of(&settings.aperture));
    axis.map_or(Vec::new(), |axis| {
        let axis = Axis::of_medial_axis(&axis, &settings.aperture);
        passes(region, &walls, &axis, settings)
    })
}

/// The lines of an infill.
struct Lines<'a> {
    aperture: &'a Aperture,
    /// Unit vectors along the lines and across them, to the left.
    along: Vector2,
    across: Vector2,
    /// How far the flanks may reach into the walls, against a.
    flank_share: f64,
}

/// One row: its height across the lines, and how the nozzle is turned there.
#[derive(Clone, Copy)]
struct Row {
    height_mm: f64,
    heading_rad: f64,
    half_mm: f64,
}

/// Lines over the regions; `overlap` is the wanted overlap of neighbours, share of the bead width.
fn infill_lines(
    regions: &[Region],
    aperture: &Aperture,
    infill: &Infill,
    overlap: f64,
    flank_share: f64,
) -> Vec<LayerPass> {
    if infill.density_pct <= 0.0 {
        return Vec::new();
    }
    let (sin, cos) = infill.angle_rad.sin_cos();
    let lines = Lines {
        aperture,
        along: Vector2::new(cos, sin),
        across: Vector2::new(-sin, cos),
        flank_share,
    };
    regions
        .iter()
        .flat_map(|region| {
            let walls = EdgeIndex::of_region(region, aperture.major_mm());
            let rows = if infill.is_solid() {
                lines.solid_rows(region, overlap)
            } else {
                lines.sparse_rows(region, infill.density_pct)
            };
            let passes: Vec<LayerPass> = rows
                .par_iter()
                .flat_map_iter(|&row| lines.passes_of_row(row, &walls))
                .collect();
            passes
        })
        .collect()
}

impl Lines<'_> {
    /// Least and largest coordinate of the region across the lines.
    fn heights_mm(&self, region: &Region) -> [f64; 2] {
        let heights = region.exterior.points.iter();
        heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| {
            let height = p.coords.dot(&self.across);
            [low.min(height), high.max(height)]
        })
    }

    /// Equal rows that tile the region's height, each over the one before by `overlap` of its width.
    fn solid_rows(&self, region: &Region, overlap: f64) -> Vec<Row> {
        let [low, high] = self.heights_mm(region);
        let (a, b) = (self.aperture.major_mm(), self.aperture.minor_mm());
        let pitch_share = 1.0 - overlap;
        // A height that is a whole number of rows but for the waves of the walls is that number.
        let beyond_the_first = ((high - low) / (2.0 * a) - 1.0) / pitch_share;
        let count = (beyond_the_first + 1.0 - FLANK_SHARE).ceil();
        let count = count.clamp(1.0, ROWS_MAX);
        let width_mm = (high - low) / (1.0 + (count - 1.0) * pitch_share);
        let half_mm = (0.5 * width_mm).clamp(b, a);
        (0..count as usize)
            .map(|i| self.row(low + width_mm * (0.5 + i as f64 * pitch_share), half_mm))
            .collect()
    }

    /// Rows of the widest bead, on a grid through the layer's origin.
    fn sparse_rows(&self, region: &Region, density_pct: f64) -> Vec<Row> {
        let [low, high] = self.heights_mm(region);
        let a = self.aperture.major_mm();
        let pitch_mm = 2.0 * a * 100.0 / density_pct;
        let first = (low / pitch_mm - 0.5).ceil();
        let count = (high / pitch_mm - 0.5 - first + 1.0).floor();
        (0..count.clamp(0.0, ROWS_MAX) as usize)
            .map(|i| self.row((first + i as f64 + 0.5) * pitch_mm, a))
            .collect()
    }

    fn row(&self, height_mm: f64, half_mm: f64) -> Row {
        let line_rad = self.along.y.atan2(self.along.x);
        Row {
            height_mm,
            heading_rad: line_rad + FRAC_PI_2 - self.aperture.angle_of_extent_rad(half_mm),
            half_mm,
        }
    }

    /// The lines of one row, between the edges that cross it.
    fn passes_of_row(&self, row: Row, walls: &EdgeIndex) -> Vec<LayerPass> {
        let on_line = Point2::from(self.across * row.height_mm);
        let origin = self
            .aperture
            .center_on_axis(row.heading_rad, on_line, self.across);
        let mut blocked = self.blocked_mm(origin, row.heading_rad, walls);
        blocked.sort_by(|p, q| p[0].total_cmp(&q[0]));
        let mut passes = Vec::new();
        let Some(mut end) = blocked.first().map(|interval| interval[1]) else {
            return passes;
        };
        for [from, to] in blocked {
            let middle = origin + self.along * (0.5 * (end + from));
            let length_mm = from - end;
            if length_mm >= LENGTH_SHARE_MIN * self.aperture.minor_mm() && walls.contains(middle) {
                passes.push(self.pass(row, origin, [end, from]));
            }
            end = end.max(to);
        }
        passes
    }

    /// For each edge near the line the coordinates along it at which the aperture touches it.
    fn blocked_mm(&self, origin: Point2, heading_rad: f64, walls: &EdgeIndex) -> Vec<[f64; 2]> {
        let flank_mm = self.flank_share * self.aperture.major_mm();
        let reach = |side: f64| {
            let support = self.aperture.support_mm(heading_rad, self.across * side);
            (support - flank_mm).max(0.5 * support)
        };
        let (below, above) = (reach(-1.0), reach(1.0));
        let mut blocked = Vec::new();
        let mut visit = |edge: &Edge| {
            let local = |p: Point2| {
                let d = p - origin;
                Vector2::new(d.dot(&self.along), d.dot(&self.across))
            };
            let (p, q) = (local(edge.a), local(edge.b));
            if let Some(part) = clipped(p, q, -below, above) {
                blocked.extend(self.blocked_by(part, heading_rad));
            }
        };
        let strip = self.strip(origin, below.max(above), walls.bounds());
        walls.for_edges_in(strip, |number| visit(&walls.edges()[number]));
        blocked
    }

    /// The box that holds the part of the line within `bounds`.
    fn strip(&self, origin: Point2, half_mm: f64, bounds: Box2) -> Box2 {
        // Along the line the box is that of its crossings with the grown bounds.
        let grown = bounds.grown(half_mm);
        let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..2 {
            let (at, step) = (origin[axis], self.along[axis]);
            if step.abs() > 1e-9 {
                let (s, t) = ((grown.min[axis] - at) / step, (grown.max[axis] - at) / step);
                (from, to) = (from.max(s.min(t)), to.min(s.max(t)));
            }
        }
        let ends = [origin + self.along * from, origin + self.along * to];
        Box2::of(&ends).grown(half_mm)
    }

    /// The interval of centres at which the aperture touches the edge part `p`-`q` (coordinates
    /// along and across the line). Touching points make an interval for each point of the edge,
    /// with a convex lower and a concave upper end along it.
    fn blocked_by(&self, [p, q]: [Vector2; 2], heading_rad: f64) -> Option<[f64; 2]> {
        let chord = |t: f64| {
            let s = p + (q - p) * t;
            let from = self.along * s.x + self.across * s.y;
            self.aperture.chord_mm(heading_rad, from, -self.along)
        };
        let low = |t: f64| chord(t).map_or(f64::INFINITY, |c| c[0]);
        let high = |t: f64| chord(t).map_or(f64::INFINITY, |c| -c[1]);
        let interval = [least(low), -least(high)];
        (interval[0] <= interval[1]).then_some(interval)
    }

    fn pass(&self, row: Row, origin: Point2, [from, to]: [f64; 2]) -> LayerPass {
        let step_mm = STEP_SHARE * self.aperture.minor_mm();
        let steps = ((to - from) / step_mm).ceil().max(2.0) as usize;
        let placements = (0..=steps)
            .map(|i| {
                let center = origin + self.along * (from + (to - from) * i as f64 / steps as f64);
                Placement {
                    at: Configuration {
                        center,
                        heading_rad: row.heading_rad,
                    },
                    feasible: true,
                    contact: Contact {
                        point: center,
                        normal: self.across,
                        length_mm: (to - from) / steps as f64,
                        extent_mm: row.half_mm,
                        on_axis: true,
                    },
                }
            })
            .collect();
        LayerPass {
            kind: PassKind::Infill,
            channel: 0,
            closed: false,
            placements,
            then: Vec::new(),
        }
    }
}

/// The part of a segment whose second coordinate is strictly between `low` and `high`.
fn clipped(p: Vector2, q: Vector2, low: f64, high: f64) -> Option<[Vector2; 2]> {
    let rise = q.y - p.y;
    if rise.abs() < 1e-12 {
        return (p.y > low && p.y < high).then_some([p, q]);
    }
    let at = |y: f64| (y - p.y) / rise;
    let (s, t) = (
        at(low).min(at(high)).max(0.0),
        at(low).max(at(high)).min(1.0),
    );
    (s < t).then(|| [p + (q - p) * s, p + (q - p) * t])
}

/// The least value of a convex function over [0, 1], by ternary search; ends included.
fn least(f: impl Fn(f64) -> f64) -> f64 {
    let (mut from, mut to) = (0.0, 1.0);
    for _ in 0..SEARCH_ROUNDS {
        let (s, t) = ((2.0 * from + to) / 3.0, (from + 2.0 * to) / 3.0);
        if f(s) <= f(t) {
            to = t;
        } else {
            from = s;
        }
    }
    f(0.0).min(f(1.0)).min(f(0.5 * (from + to)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::clearance::scaled_clearance;
    use crate::geometry::test_shapes::{ELLIPSE, region};

    /// A notched plate with a hole, nothing in it parallel to the lines.
    fn plate() -> Region {
        region(&[
            &[
                [0.0, 0.0],
                [20.0, 1.0],
                [18.0, 9.0],
                [12.0, 4.0],
                [9.0, 12.0],
                [-1.0, 10.0],
            ],
            &[[4.0, 4.0], [4.5, 7.0], [6.0, 6.5], [5.5, 4.2]],
        ])
    }

    /// Goal: a narrow straight strip is filled by straight lines along it that cover it, however it lies; one that a bead
    /// fills, bent and pointed ones by loops. Method: strips of 14 mm turned by several angles, their rows counted by
    /// hand; an L, a triangle.
    #[test]
    fn straight_strips_are_filled_along() {
        let aperture = ELLIPSE;
        let settings = PassSettings {
            aperture,
            overlap: 0.0,
            one_pass: false,
            law: crate::settings::HeadingLaw::Tangent,
            turn_weight_mm4: crate::plan::headings::profile::TURN_WEIGHT_MM4,
        };
        let solid = Infill::solid(1);
        let strip = |width_mm: f64, turn_rad: f64| {
            let turn = nalgebra::Rotation2::new(turn_rad);
            let mut strip =
                region(&[&[[0.0, 0.0], [14.0, 0.0], [14.0, width_mm], [0.0, width_mm]]]);
            for point in &mut strip.exterior.points {
                *point = turn * *point;
            }
            strip
        };
        for (width_mm, rows) in [(2.0, 2), (3.2, 3), (4.5, 4)] {
            for turn_deg in [0.0, 31.0, 90.0f64] {
                let strip = strip(width_mm, turn_deg.to_radians());
                let lines = infill_passes(&[strip], &solid, &settings);
                assert_eq!(lines.len(), rows, "{width_mm} {turn_deg}");
                for line in &lines {
                    assert_eq!(line.kind, PassKind::Infill);
                    let ends = [line.placements.first(), line.placements.last()];
                    let [from, to] = ends.map(|end| end.expect("an end").at.center);
                    let along = to - from;
                    let off_deg = along.y.atan2(along.x).to_degrees() - turn_deg;
                    assert!(
                        off_deg
                            .rem_euclid(180.0)
                            .min(180.0 - off_deg.rem_euclid(180.0))
                            < 1e-6
                    );
                    assert!(along.norm() > 14.0 - 2.0 * aperture.major_mm());
                }
            }
        }
        let ell = [
            [0.0, 0.0],
            [14.0, 0.0],
            [14.0, 2.0],
            [2.0, 2.0],
            [2.0, 14.0],
            [0.0, 14.0],
        ];
        let triangle = [[0.0, 0.0], [14.0, 0.0], [0.0, 4.0]];
        for other in [region(&[&ell]), region(&[&triangle]), strip(1.1, 0.3)] {
            let loops = infill_passes(&[other], &solid, &settings);
            assert!(!loops.is_empty());
            assert!(loops.iter().all(|pass| pass.kind != PassKind::Infill));
        }
    }

    /// Goal: no placement cuts, and every line goes on until it would. Method: the clearance query
    /// at every placement, and at a step of 5 µm beyond either end; several angles and apertures.
    #[test]
    fn lines_end_where_the_aperture_meets_a_wall() {
        let stadium = crate::geometry::rounded_polygon::RoundedPolygon::stadium(1.2, 0.4);
        let mut lines_seen = 0;
        for aperture in [ELLIPSE, Aperture::Rounded(stadium)] {
            for angle_deg in [0.0_f64, 30.0, 77.0, 120.0] {
                let infill = Infill {
                    density_pct: 60.0,
                    angle_rad: angle_deg.to_radians(),
                    ..Infill::solid(1)
                };
                let plate = plate();
                let walls = EdgeIndex::of_region(&plate, 1.0);
                let clear = |at: Configuration| scaled_clearance(&aperture, at, &walls, 1.5);
                // What the flanks may take: 4 % of a, at b along an edge.
                let least = 1.0 - 0.04 * 0.6 / 0.2;
                for pass in infill_lines(
                    std::slice::from_ref(&plate),
                    &aperture,
                    &infill,
                    0.0,
                    FLANK_SHARE,
                ) {
                    lines_seen += 1;
                    let placements = &pass.placements;
                    for placement in placements {
                        assert!(walls.contains(placement.at.center));
                        assert!(clear(placement.at) > least, "{}", clear(placement.at));
                    }
                    let n = placements.len();
                    for (end, before) in [(n - 1, n - 2), (0, 1)] {
                        let (end, before) = (placements[end].at, placements[before].at);
                        let step = (end.center - before.center).normalize() * 0.005;
                        let beyond = Configuration {
                            center: end.center + step,
                            ..end
                        };
                        assert!(clear(beyond) < 1.0, "{angle_deg}: {}", clear(beyond));
                    }
                }
            }
        }
        assert!(lines_seen > 60, "{lines_seen}");
    }

    /// Goal: a solid infill tiles a box with equal rows, the nozzle tilted to their width; a sparse
    /// one covers its share. Method: 10 x 5 mm at 0°: five rows of 1 mm for the ellipse of 1.2 mm;
    /// spacing at 30 %.
    #[test]
    fn rows_have_the_width_of_their_beads() {
        let plate = region(&[&[[0.0, 0.0], [10.0, 0.0], [10.0, 5.0], [0.0, 5.0]]]);
        let infill = Infill {
            angle_rad: 0.0,
            ..Infill::solid(1)
        };
        let rows = infill_lines(
            std::slice::from_ref(&plate),
            &ELLIPSE,
            &infill,
            0.0,
            FLANK_SHARE,
        );
        assert_eq!(rows.len(), 5);
        for (i, row) in rows.iter().enumerate() {
            let at = row.placements[0].at;
            assert!((at.center.y - (i as f64 + 0.5)).abs() < 1e-9);
            let half_mm = ELLIPSE.extent_mm(at.heading_rad, Vector2::y());
            assert!((half_mm - 0.5).abs() < 1e-9, "{half_mm}");
        }
        let sparse = Infill {
            density_pct: 30.0,
            ..infill
        };
        let rows = infill_lines(&[plate], &ELLIPSE, &sparse, 0.0, FLANK_SHARE);
        assert_eq!(rows.len(), 1, "4 mm apart");
        let none = Infill {
            density_pct: 0.0,
            ..infill
        };
        assert!(infill_lines(&[self::plate()], &ELLIPSE, &none, 0.0, FLANK_SHARE).is_empty());
    }
}

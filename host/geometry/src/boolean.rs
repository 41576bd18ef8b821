//! Unions, differences and fills of rings, by i_overlay.
//!
//! Coordinates are rounded to a fine integer grid (the box's size / 2^30 or better). Results are
//! valid regions in the sense of [`super::validity`]: exteriors counter-clockwise, holes clockwise,
//! nothing crosses.

use super::Point2;
use super::polygon::{Region, Ring};
use super::repair::FillRule;
use super::validity::validate_all;
use i_overlay::core::fill_rule::FillRule as OverlayFillRule;
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::core::solver::{Precision, Solver};
use i_overlay::float::overlay::{FloatOverlay, OverlayOptions};
use i_overlay::mesh::float::outline::offset::OutlineOffset;
use i_overlay::mesh::float::stroke::offset::StrokeOffset;
use i_overlay::mesh::float::style::{LineCap, LineJoin, OutlineStyle, StrokeStyle};

type Paths = Vec<Vec<[f64; 2]>>;

/// What the rings enclose by the fill rule.
pub fn filled<'a>(rings: impl Iterator<Item = &'a Ring>, rule: FillRule) -> Vec<Region> {
    overlaid(&paths(rings), &Vec::new(), OverlayRule::Subject, rule)
}

/// The area of `from` outside all of `cut`.
pub fn difference(from: &[Region], cut: &[Region]) -> Vec<Region> {
    overlaid(
        &paths(from.iter().flat_map(Region::rings)),
        &paths(cut.iter().flat_map(Region::rings)),
        OverlayRule::Difference,
        FillRule::NonZero,
    )
}

/// The area in both.
pub fn intersection(one: &[Region], other: &[Region]) -> Vec<Region> {
    overlaid(
        &paths(one.iter().flat_map(Region::rings)),
        &paths(other.iter().flat_map(Region::rings)),
        OverlayRule::Intersect,
        FillRule::NonZero,
    )
}

/// The area within `by_mm` of the regions; arcs become chords that are inside them by at most
/// 1.3e-4 of `by_mm`.
pub fn grown(regions: &[Region], by_mm: f64) -> Vec<Region> {
    if by_mm <= 0.0 {
        return regions.to_vec();
    }
    offset(regions, by_mm, LineJoin::Round(ARC_STEP_RAD))
}

/// The regions with their edges moved outwards by `by_mm`, inwards where it is negative; arcs are as coarse as what beads
/// sweep, which takes a tenth of the time.
pub fn moved(regions: &[Region], by_mm: f64) -> Vec<Region> {
    offset(regions, by_mm, LineJoin::Round(SWEPT_STEP_RAD))
}

/// The regions with their edges moved outwards by `by_mm`, inwards where it is negative; corners stay sharp.
pub fn mitred(regions: &[Region], by_mm: f64) -> Vec<Region> {
    offset(regions, by_mm, LineJoin::Miter(MITRE_MIN_RAD))
}

/// What a disk of this width sweeps along lines; `is_cut_at_ends` leaves out its half beyond either end.
pub fn swept(lines: &[Vec<Point2>], width_mm: f64, is_cut_at_ends: bool) -> Vec<Region> {
    let cap = || match is_cut_at_ends {
        true => LineCap::Butt,
        false => LineCap::Round(SWEPT_STEP_RAD),
    };
    let style = || {
        StrokeStyle::new(width_mm)
            .line_join(LineJoin::Round(SWEPT_STEP_RAD))
            .start_cap(cap())
            .end_cap(cap())
    };
    let lines = lines.iter().map(|line| line.iter().map(|p| [p.x, p.y]));
    let lines: Paths = lines.map(Iterator::collect).collect();
    let shapes = lines.stroke_fixed_scale_as::<i64>(style(), false, OFFSET_CELLS_PER_MM);
    let shapes = shapes.unwrap_or_else(|_| lines.stroke_as::<i64>(style(), false));
    shapes.into_iter().filter_map(region_of).collect()
}

fn offset(regions: &[Region], by_mm: f64, join: LineJoin<f64>) -> Vec<Region> {
    let style = OutlineStyle::new(by_mm).line_join(join);
    let rings = paths(regions.iter().flat_map(Region::rings));
    // Too large for this grid: the finest that holds it.
    let shapes = rings.outline_fixed_scale_as::<i64>(&style, OFFSET_CELLS_PER_MM);
    let shapes = shapes.unwrap_or_else(|_| rings.outline_as::<i64>(&style));
    shapes.into_iter().filter_map(region_of).collect()
}

/// Cells of the grid of offsets in a mm. Their crossings are resolved from one cell on, which cannot be chosen, and the finest
/// grid has cells of 2^-53 mm for 100 mm, far below the rounding of a coordinate: edges that nearly coincide then cross
/// anew in every round.
const OFFSET_CELLS_PER_MM: f64 = (1_u64 << 30) as f64;

/// Angle of one chord of an arc: the least that the offsetting takes.
const ARC_STEP_RAD: f64 = 0.01 * std::f64::consts::PI;
/// The same of what a bead sweeps: its edge is off by a micrometre.
const SWEPT_STEP_RAD: f64 = 0.05 * std::f64::consts::PI;
/// Sharpest corner that a moved edge keeps: slicers cut sharper ones off as well.
const MITRE_MIN_RAD: f64 = 0.35;

fn paths<'a>(rings: impl Iterator<Item = &'a Ring>) -> Paths {
    let finite = |p: &&Point2| p.x.is_finite() && p.y.is_finite();
    rings
        .map(|ring| ring.points.iter().filter(finite))
        .map(|points| points.map(|p| [p.x, p.y]).collect())
        .collect()
}

/// Within which squared distance a rounded crossing becomes the end of an edge, as a power of two of cells of the
/// overlay's grid, and what the power grows by with every round. The grid has 2^61 cells across all rings, a
/// double 2^53 steps: 2^15 cells are a hundred steps of the largest coordinate, several times what turning and shifting rounds.
/// Edges that all pass through nearly one point (the outlines of a wavy wall's layers), or that nearly coincide (what
/// differs between the layers of a twisted gear), cross each other there anew in every round until that distance is
/// larger than what separates them: with rounds of a factor of two a layer of a herringbone gear takes a minute.
const SNAP: Precision = Precision {
    start: 30,
    progression: 8,
};

fn overlaid(subject: &Paths, clip: &Paths, what: OverlayRule, rule: FillRule) -> Vec<Region> {
    let mut found = overlaid_once(subject, clip, what, rule, false);
    if validate_all(&found).is_err() {
        // A vertex that touches an edge lost its partner as needless: keep such points.
        found = overlaid_once(subject, clip, what, rule, true);
    }
    found
}

fn overlaid_once(
    subject: &Paths,
    clip: &Paths,
    what: OverlayRule,
    rule: FillRule,
    keep_collinear: bool,
) -> Vec<Region> {
    let mut options = OverlayOptions::<f64, i64>::ogc();
    options.preserve_output_collinear = keep_collinear;
    let rule = match rule {
        FillRule::EvenOdd => OverlayFillRule::EvenOdd,
        FillRule::NonZero => OverlayFillRule::NonZero,
        FillRule::Positive => OverlayFillRule::Positive,
    };
    let shapes = FloatOverlay::<[f64; 2], i64>::from_subj_and_clip_custom(
        subject,
        clip,
        options,
        Solver::with_precision(SNAP),
    )
    .overlay(what, rule);
    let hair_mm = HAIR_SHARE * extent_mm(subject).max(extent_mm(clip));
    let regions = shapes.into_iter().filter_map(region_of);
    regions
        .filter(|region| !is_hair(&region.exterior, hair_mm))
        .collect()
}

/// Thinner than this against the extent of all rings is what rounding leaves where outlines should
/// meet: valid, but without area.
const HAIR_SHARE: f64 = 1e-9;

fn is_hair(ring: &Ring, thickness_mm: f64) -> bool {
    2.0 * ring.signed_area_mm2().abs() <= thickness_mm * ring.perimeter_mm()
}

/// Farthest coordinate from that of the first point.
fn extent_mm(paths: &Paths) -> f64 {
    let mut points = paths.iter().flatten();
    let Some(first) = points.next() else {
        return 0.0;
    };
    let away = |p: &[f64; 2]| (p[0] - first[0]).abs().max((p[1] - first[1]).abs());
    points.map(away).fold(0.0, f64::max)
}

fn region_of(shape: Paths) -> Option<Region> {
    let mut rings = shape.into_iter().map(|points| {
        let points = points.into_iter().map(Point2::from).collect();
        let mut ring = Ring { points };
        ring.begin_at_extreme();
        ring
    });
    let exterior = rings.next()?;
    Some(Region {
        exterior,
        holes: rings.collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::region;
    use std::f64::consts::TAU;
    use std::time::Instant;

    fn square(x: f64, y: f64, size: f64) -> Region {
        let corners = [[x, y], [x + size, y], [x + size, y + size], [x, y + size]];
        Region {
            exterior: Ring {
                points: corners.map(Point2::from).to_vec(),
            },
            holes: Vec::new(),
        }
    }

    /// Goal: a cut through the middle leaves two parts, one in the middle a hole, one beside it
    /// nothing changed. Method: areas and counts by hand.
    #[test]
    fn differences_of_squares() {
        let part = square(0.0, 0.0, 10.0);
        let from = std::slice::from_ref(&part);
        let holed = difference(from, &[square(4.0, 4.0, 2.0)]);
        assert_eq!((holed.len(), holed[0].holes.len()), (1, 1));
        assert!((holed[0].area_mm2() - 96.0).abs() < 1e-6);
        let wide = Region {
            exterior: Ring {
                points: [[-1.0, 4.0], [11.0, 4.0], [11.0, 6.0], [-1.0, 6.0]]
                    .map(Point2::from)
                    .to_vec(),
            },
            holes: Vec::new(),
        };
        let halves = difference(from, &[wide]);
        assert_eq!(halves.len(), 2);
        assert!(halves.iter().all(|h| (h.area_mm2() - 40.0).abs() < 1e-6));
        assert_eq!(difference(from, &[square(20.0, 0.0, 5.0)]).len(), 1);
        assert!(difference(from, &[square(-1.0, -1.0, 12.0)]).is_empty());
    }

    /// Goal: growing keeps the distance, closes narrow gaps and crosses nothing. Method: two
    /// squares 1 mm apart grown by 0.4 and 0.6 mm; every corner of the result at its distance.
    #[test]
    fn grown_squares_join() {
        let parts = [square(0.0, 0.0, 5.0), square(6.0, 0.0, 5.0)];
        for (by_mm, count) in [(0.4, 2), (0.6, 1)] {
            let found = grown(&parts, by_mm);
            assert_eq!(found.len(), count, "{by_mm}");
            assert_eq!(validate_all(&found), Ok(()));
            let distance_mm = |p: &Point2| {
                let edges = parts.iter().flat_map(Region::edges);
                let far = edges.map(|(a, b)| {
                    let t = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
                    (p - (a + (b - a) * t)).norm()
                });
                far.fold(f64::INFINITY, f64::min)
            };
            for p in found.iter().flat_map(Region::rings).flat_map(|r| &r.points) {
                assert!((distance_mm(p) - by_mm).abs() < 1.3e-4 * by_mm, "{p}");
            }
        }
    }

    /// Goal: a hair that rounding leaves is no region of its own, a thin strip is (found on a blade
    /// whose two sides meet in a point: its plan was refused for a triangle of 4e-15 mm). Method: a
    /// square and beside it the triangle as found; a strip of 1 nm.
    #[test]
    fn hairs_are_no_ground() {
        let x = [63.51555538247339, 63.515555382473394];
        let hair = [[x[0], 2.7e-15], [x[1], -1.8e-15], [x[1], 1.8e-15]];
        let strip = [[63.0, 0.0], [68.0, 0.0], [68.0, 1e-6], [63.0, 1e-6]];
        for (points, count) in [(&hair[..], 1), (&strip[..], 2)] {
            let own = Ring {
                points: points.iter().map(|p| Point2::from(*p)).collect(),
            };
            let body = square(0.0, 0.0, 50.0).exterior;
            let found = filled([&body, &own].into_iter(), FillRule::NonZero);
            assert_eq!(found.len(), count, "{found:?}");
        }
    }

    /// Goal: edges that all but meet in one point are overlaid at once (found on layer 66 of a wavy vase: a
    /// minute and 600 MB). Method: slivers between its layers and a corner of its outline, as found; they
    /// have nothing in common.
    #[test]
    fn edges_through_nearly_one_point_are_overlaid_at_once() {
        let one: [&[[f64; 2]]; 9] = [
            &[
                [19.09031112727304, 11.416980238353768],
                [19.354020731653367, 11.296544444212186],
                [19.170294642971044, 11.381846546997195],
            ],
            &[
                [19.08836573179098, 11.415895737552773],
                [19.356261528090588, 11.295504065845785],
                [19.170294642971044, 11.381846546997195],
            ],
            &[
                [19.086017159039375, 11.414586604279386],
                [19.439942364279887, 11.256651928182869],
                [19.170294642971044, 11.381846546997195],
                [18.008767079420625, 12.25668579101001],
            ],
            &[
                [19.49675936183121, 11.23027239003552],
                [19.170294642971044, 11.381846546997195],
                [18.694565502529738, 11.604023265541096],
            ],
            &[
                [19.537468144359828, 11.211371727770223],
                [19.170294642971044, 11.381846546997195],
                [19.091686328394346, 11.417746850341935],
            ],
            &[
                [20.4682020736767, 10.088277079910508],
                [20.44637731307538, 10.155789515111696],
                [20.302817052203455, 10.497724346820295],
            ],
            &[
                [19.441213853700802, 11.253929949745777],
                [19.57988572811331, 11.19167768695554],
                [19.17087143113248, 11.38157875028207],
            ],
            &[
                [-25.2014362006077, 5.21446416483546],
                [-25.205502917737945, 5.143033597968732],
                [-25.311391448131364, 4.78762056937647],
            ],
            &[
                [25.25706298698878, 3.5961412064863527],
                [25.242490939865796, 3.828778730295994],
                [25.079245798709948, 4.220629472971149],
            ],
        ];
        let other: [&[[f64; 2]]; 1] = [&[
            [-21.932078405132472, -14.65923830383667],
            [-21.89291330023741, -14.750007385315671],
            [-21.840659103827218, -14.833431163216861],
        ]];
        let (send, receive) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let of = |rings: &[&[[f64; 2]]]| -> Vec<Region> {
                rings.iter().map(|ring| region(&[ring])).collect()
            };
            send.send(intersection(&of(&one), &of(&other)))
        });
        let longest = std::time::Duration::from_secs(20);
        let found = receive.recv_timeout(longest).expect("no end to it");
        assert_eq!(found, []);
    }

    /// Goal: what winds backwards encloses nothing by the positive rule. Method: a ring with a
    /// small backward loop of its own.
    #[test]
    fn backward_loops_vanish() {
        let ring = Ring {
            points: [[0.0, 0.0], [6.0, 0.0], [5.0, -1.0], [5.0, 4.0], [0.0, 4.0]]
                .map(Point2::from)
                .to_vec(),
        };
        let found = filled([&ring].into_iter(), FillRule::Positive);
        assert_eq!(found.len(), 1);
        assert!((found[0].area_mm2() - 20.0).abs() < 1e-6);
    }

    /// The outline of a twisted gear's layer where it cuts the facets of its mesh: two points on each of 408 columns.
    fn twisted_layer(layer: f64) -> Vec<Region> {
        const COLUMNS: usize = 408;
        let corner = |z_mm: f64, column: usize| {
            let at_rad = (column % COLUMNS) as f64 / COLUMNS as f64 * TAU;
            let radius_mm = 18.0 + 1.5 * (24.0 * at_rad).cos().clamp(-0.7, 0.7);
            let twist_rad = 25f64.to_radians().tan() * (5.0 - (z_mm - 5.0).abs()) / 18.0;
            let (sin, cos) = (at_rad + twist_rad).sin_cos();
            Point2::new(100.0 + radius_mm * cos, 90.0 + radius_mm * sin)
        };
        let z_mm = (layer - 0.5) * 0.2;
        let (low_mm, share) = ((z_mm / 0.25).floor() * 0.25, (z_mm / 0.25).fract());
        let cuts = (0..COLUMNS).flat_map(|column| {
            let low = corner(low_mm, column);
            [column, column + 1].map(|up| low + (corner(low_mm + 0.25, up) - low) * share)
        });
        let points = cuts.collect();
        vec![Region {
            exterior: Ring { points },
            holes: Vec::new(),
        }]
    }

    /// Goal: outlines that nearly coincide are overlaid at once (found on a herringbone gear: a minute for one layer).
    /// Method: what layers around one leave of it, taken from it together; its area against that of the same in
    /// turn, its time against that of making the pieces (it was 150 times that).
    #[test]
    fn layers_of_a_twisted_gear_are_overlaid_at_once() {
        let own = twisted_layer(8.0);
        let begun = Instant::now();
        let others = [9.0, 10.0, 11.0, 12.0, 13.0, 7.0, 6.0, 5.0, 4.0].map(twisted_layer);
        let open: Vec<Vec<Region>> = others.iter().map(|other| difference(&own, other)).collect();
        let making_s = begun.elapsed().as_secs_f64();
        let all: Vec<Region> = open.iter().flatten().cloned().collect();
        let begun = Instant::now();
        let common = difference(&own, &all);
        let taking_s = begun.elapsed().as_secs_f64();
        let in_turn = open.iter().fold(own, |left, open| difference(&left, open));
        let area_mm2 = |regions: &[Region]| regions.iter().map(Region::area_mm2).sum::<f64>();
        let [common_mm2, in_turn_mm2] = [&common, &in_turn].map(|regions| area_mm2(regions));
        assert!(
            (common_mm2 - in_turn_mm2).abs() < 1e-6,
            "{common_mm2} {in_turn_mm2}"
        );
        assert!(taking_s < 60.0 * making_s, "{taking_s} s, {making_s} s");
    }
}

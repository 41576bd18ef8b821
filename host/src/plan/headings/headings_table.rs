//! The headings table: heading law and F(p) at every boundary sample.
//!
//! Input: a region in mm, an aperture, a spacing. Output: one row for each midpoint of equal parts, no
//! longer than the spacing, of each edge, ring by ring in the region's order; exact edge normals and the
//! unpruned r. See docs/design/heading-law.md. The same rows for any number of threads.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::tangent_disk::tangent_disk_radius_mm;
use crate::geometry::{Point2, Vector2};
use crate::plan::feasible::feasible_angles;
use crate::plan::headings::heading_law::{law_angle_rad, weight};
use crate::settings::{HeadingLaw, PassMode};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::io::{self, Write};

/// Header of the CSV.
pub const HEADER: &str = "x_mm,y_mm,nx,ny,r_mm,weight,law_alpha_deg,min_alpha_deg,alpha_deg,\
reachable,center_x_mm,center_y_mm,phi_rad";

/// Candidates whose distances from the law differ by less than this are equally near, rad.
const TIE_RAD: f64 = 1e-6;

/// Maximum number of parts of one edge, whatever the requested spacing.
const PIECES_MAX: f64 = 1e6;

/// Parameters of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingsRequest {
    /// The aperture.
    pub aperture: Aperture,
    /// Longest part of an edge.
    pub spacing_mm: f64,
    /// Which weight.
    pub pass: PassMode,
    /// Which law.
    pub law: HeadingLaw,
}

/// One boundary sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingRow {
    /// The sample.
    pub point: Point2,
    /// Inward unit normal of its edge.
    pub normal: Vector2,
    /// Radius of the largest disk inside that touches here.
    pub radius_mm: f64,
    /// The weight w.
    pub weight: f64,
    /// The law's |alpha|.
    pub law_alpha_rad: f64,
    /// The feasible heading; `None` if F(p) is empty.
    pub reached: Option<HeadingChoice>,
}

/// The heading chosen where a sample is reachable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingChoice {
    /// Smallest |alpha| in F(p).
    pub min_alpha_rad: f64,
    /// The angle in F(p) nearest to the law's, signed, in (-90°, 90°] (in (-180°, 180°] for a
    /// polygon without that symmetry); of several equally near ones the one that turns least along
    /// the ring.
    pub alpha_rad: f64,
    /// Aperture centre, and heading unwrapped along the ring.
    pub configuration: Configuration,
}

/// A sample with the headings equally near to the law's.
struct Sample {
    row: HeadingRow,
    min_alpha_rad: f64,
    candidates: Vec<Candidate>,
}

#[derive(Clone, Copy)]
struct Candidate {
    alpha_rad: f64,
    configuration: Configuration,
}

/// All rows, in the order of the rings' edges.
pub fn headings_table(region: &Region, request: &HeadingsRequest) -> Vec<HeadingRow> {
    let bounds = region.bounds();
    let offset = (bounds.min.coords + bounds.max.coords) / 2.0;
    let local = |ring: &Ring| Ring {
        points: ring.points.iter().map(|p| p - offset).collect(),
    };
    let region = Region {
        exterior: local(&region.exterior),
        holes: region.holes.iter().map(local).collect(),
    };
    let index = EdgeIndex::of_region(&region, request.aperture.major_mm());
    let mut rows = Vec::new();
    for ring in region.rings() {
        let places = ring_samples(ring, request.spacing_mm);
        let samples: Vec<Sample> = places
            .into_par_iter()
            .map(|(p, normal)| sample_at(&index, request, p, normal))
            .collect();
        rows.extend(
            chosen(request, samples)
                .into_iter()
                .map(|row| moved(row, offset)),
        );
    }
    rows
}

/// Midpoints of equal pieces of each edge, with the edge's inward normal.
fn ring_samples(ring: &Ring, spacing_mm: f64) -> Vec<(Point2, Vector2)> {
    let mut samples = Vec::new();
    for (a, b) in ring.edges() {
        let edge = Edge { a, b };
        let length_mm = edge.length_mm();
        if length_mm <= 0.0 {
            continue;
        }
        // A length that is a multiple but for rounding takes no further piece.
        let pieces = (length_mm / spacing_mm * (1.0 - 1e-12))
            .ceil()
            .clamp(1.0, PIECES_MAX) as usize;
        for k in 0..pieces {
            let t = (k as f64 + 0.5) / pieces as f64;
            samples.push((a + (b - a) * t, edge.normal()));
        }
    }
    samples
}

fn sample_at(index: &EdgeIndex, request: &HeadingsRequest, p: Point2, normal: Vector2) -> Sample {
    let aperture = &request.aperture;
    let radius_mm = tangent_disk_radius_mm(index, p, normal);
    let law = law_angle_rad(aperture, radius_mm, request.pass, request.law);
    let angles = feasible_angles(aperture, index, p, normal);
    let mut candidates: Vec<Candidate> = Vec::new();
    let mut least = f64::INFINITY;
    // A shape without 180° symmetry prints the same bead when reversed.
    let turned: &[f64] = if aperture.period_rad() > PI {
        &[0.0, PI]
    } else {
        &[0.0]
    };
    for wanted in turned.iter().flat_map(|t| [t + law, t - law]) {
        let Some(found) = angles.nearest_rad(wanted) else {
            continue;
        };
        let off = aperture.wrapped_rad(found - wanted).abs();
        if off < least - TIE_RAD {
            candidates.clear();
            least = off;
        }
        let known = |c: &Candidate| aperture.wrapped_rad(c.alpha_rad - found).abs() < TIE_RAD;
        if off <= least + TIE_RAD && !candidates.iter().any(known) {
            candidates.push(Candidate {
                alpha_rad: found,
                configuration: angles.placement(aperture, p, normal, found),
            });
        }
    }
    Sample {
        row: HeadingRow {
            point: p,
            normal,
            radius_mm,
            weight: weight(aperture, radius_mm, request.pass),
            law_alpha_rad: law,
            reached: None,
        },
        min_alpha_rad: angles.min_abs_rad().unwrap_or(f64::NAN),
        candidates,
    }
}

/// Chooses signs so that the heading turns least around the ring: a cyclic shortest path over at
/// most four candidates a sample, solved once for each candidate of the first reachable sample.
fn chosen(request: &HeadingsRequest, samples: Vec<Sample>) -> Vec<HeadingRow> {
    let reachable: Vec<usize> = (0..samples.len())
        .filter(|&i| !samples[i].candidates.is_empty())
        .collect();
    let heading = |i: usize, c: usize| {
        let s = &samples[reachable[i]];
        s.row.normal.y.atan2(s.row.normal.x) + s.candidates[c].alpha_rad
    };
    let turn = |i: usize, c: usize, j: usize, d: usize| {
        let turn_rad = heading(j, d) - heading(i, c);
        request.aperture.wrapped_rad(turn_rad).abs()
    };
    let choices = |i: usize| samples[reachable[i]].candidates.len();
    let mut best: Option<(f64, Vec<usize>)> = None;
    for start in 0..reachable.first().map_or(0, |_| choices(0)) {
        let mut costs = vec![f64::INFINITY; choices(0)];
        costs[start] = 0.0;
        let mut from: Vec<Vec<usize>> = Vec::with_capacity(reachable.len());
        for j in 1..reachable.len() {
            let (mut next, mut back) = (Vec::new(), Vec::new());
            for d in 0..choices(j) {
                let reach = |c: usize| costs[c] + turn(j - 1, c, j, d);
                let c = (0..costs.len())
                    .min_by(|&c, &e| reach(c).total_cmp(&reach(e)))
                    .unwrap_or(0);
                next.push(reach(c));
                back.push(c);
            }
            costs = next;
            from.push(back);
        }
        let last = reachable.len() - 1;
        let closed = |c: usize| costs[c] + turn(last, c, 0, start);
        let end = (0..costs.len())
            .min_by(|&c, &e| closed(c).total_cmp(&closed(e)))
            .unwrap_or(0);
        if best.as_ref().is_none_or(|(cost, _)| closed(end) < *cost) {
            let mut picks = vec![end];
            for back in from.iter().rev() {
                picks.push(back[picks[picks.len() - 1]]);
            }
            picks.reverse();
            best = Some((closed(end), picks));
        }
    }
    let picks = best.map_or(Vec::new(), |(_, picks)| picks);
    let mut rows: Vec<HeadingRow> = samples.iter().map(|s| s.row).collect();
    let mut heading_before: Option<f64> = None;
    for (&i, pick) in reachable.iter().zip(picks) {
        let Sample {
            min_alpha_rad,
            candidates,
            ..
        } = &samples[i];
        let Candidate {
            alpha_rad,
            mut configuration,
        } = candidates[pick];
        if let Some(before) = heading_before {
            let period_rad = request.aperture.period_rad();
            let turns = ((configuration.heading_rad - before) / period_rad).round();
            configuration.heading_rad -= turns * period_rad;
        }
        heading_before = Some(configuration.heading_rad);
        rows[i].reached = Some(HeadingChoice {
            min_alpha_rad: *min_alpha_rad,
            alpha_rad,
            configuration,
        });
    }
    rows
}

fn moved(mut row: HeadingRow, offset: Vector2) -> HeadingRow {
    row.point += offset;
    if let Some(choice) = &mut row.reached {
        choice.configuration.center += offset;
    }
    row
}

/// Writes the rows as CSV: header line, decimal points, empty cells where a row is unreachable.
pub fn write_csv(mut out: impl Write, rows: &[HeadingRow]) -> io::Result<()> {
    writeln!(out, "{HEADER}")?;
    for row in rows {
        write!(
            out,
            "{:.9},{:.9},{:.12},{:.12},{:.9},{:.9},{:.7},",
            row.point.x,
            row.point.y,
            row.normal.x,
            row.normal.y,
            row.radius_mm,
            row.weight,
            row.law_alpha_rad.to_degrees()
        )?;
        match &row.reached {
            None => writeln!(out, ",,0,,,")?,
            Some(choice) => writeln!(
                out,
                "{:.7},{:.7},1,{:.9},{:.9},{:.9}",
                choice.min_alpha_rad.to_degrees(),
                choice.alpha_rad.to_degrees(),
                choice.configuration.center.x,
                choice.configuration.center.y,
                choice.configuration.heading_rad
            )?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::clearance::scaled_clearance;
    use crate::geometry::test_shapes::{ELLIPSE, region};

    fn request(pass: PassMode) -> HeadingsRequest {
        HeadingsRequest {
            aperture: ELLIPSE,
            spacing_mm: 0.25,
            pass,
            law: HeadingLaw::Tangent,
        }
    }

    /// Goal: the formulas of a straight passage to 0.01°. Method: long
    /// passages, turned and far from the origin; samples away from the ends.
    #[test]
    fn straight_passage_formulas() {
        let (a2, b2) = (0.36, 0.04);
        let mut checked = 0;
        for half_width_mm in [0.25f64, 0.4, 0.55, 0.7, 1.0, 1.15] {
            let turn = |x: f64, y: f64| {
                let (sin, cos) = 0.7f64.sin_cos();
                [5000.0 + x * cos - y * sin, -3000.0 + x * sin + y * cos]
            };
            let w = 2.0 * half_width_mm;
            let strip = region(&[&[turn(0.0, 0.0), turn(40.0, 0.0), turn(40.0, w), turn(0.0, w)]]);
            for pass in [PassMode::One, PassMode::Two] {
                let e = if pass == PassMode::One {
                    half_width_mm
                } else {
                    half_width_mm / 2.0
                };
                if !(0.2..=0.6).contains(&e) {
                    continue;
                }
                let expected = ((e * e - b2) / (a2 - b2)).sqrt().acos().to_degrees();
                for row in headings_table(&strip, &request(pass)) {
                    let center = Point2::from(turn(20.0, half_width_mm));
                    if (row.point - center).norm() > 15.0 {
                        continue;
                    }
                    assert!((row.radius_mm - half_width_mm).abs() < 1e-8);
                    let alpha = row.reached.unwrap().alpha_rad.abs().to_degrees();
                    assert!(
                        (alpha - expected).abs() < 0.01,
                        "{half_width_mm} {alpha} {expected}"
                    );
                    checked += 1;
                }
            }
        }
        assert!(checked > 500);
    }

    /// Goal: every reachable row touches its sample and stays inside; headings do not jump needlessly.
    #[test]
    fn rows_are_consistent() {
        let shape = region(&[&[
            [0.0, 0.0],
            [8.0, 0.0],
            [8.0, 2.0],
            [3.0, 1.4],
            [2.0, 6.0],
            [0.0, 6.0],
        ]]);
        let rows = headings_table(&shape, &request(PassMode::Two));
        let index = EdgeIndex::of_region(&shape, 0.6);
        let mut reached = 0;
        for row in &rows {
            let Some(choice) = row.reached else { continue };
            reached += 1;
            let aperture = request(PassMode::Two).aperture;
            let clear = scaled_clearance(&aperture, choice.configuration, &index, 2.0);
            assert!((clear - 1.0).abs() < 1e-7, "{clear}");
            assert!(choice.min_alpha_rad <= choice.alpha_rad.abs() + 1e-9);
        }
        assert!(reached * 10 > rows.len() * 9, "{reached} of {}", rows.len());
    }

    /// Goal: the file's form. Method: a shape with unreachable samples (a spike), fields counted.
    #[test]
    fn csv_form() {
        let spike = region(&[&[[0.0, 0.0], [20.0, 0.5], [0.0, 1.0]]]);
        let rows = headings_table(&spike, &request(PassMode::Two));
        let mut text = Vec::new();
        write_csv(&mut text, &rows).unwrap();
        let text = String::from_utf8(text).unwrap();
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some(HEADER));
        let (mut yes, mut no) = (0, 0);
        for line in lines {
            let cells: Vec<&str> = line.split(',').collect();
            assert_eq!(cells.len(), 13, "{line}");
            match cells[9] {
                "1" => yes += 1,
                "0" => {
                    no += 1;
                    assert!(
                        [7, 8, 10, 11, 12].iter().all(|&k| cells[k].is_empty()),
                        "{line}"
                    );
                }
                other => panic!("reachable is {other}"),
            }
        }
        assert!(yes > 50 && no > 50, "{yes} {no}");
    }
}

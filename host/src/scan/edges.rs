//! The edges of a scan against those of the swept nozzle: how the scan lies to a few micrometres, and where the nozzle really is.
//!
//! In: points that lie on the layer to about a tenth of a bead, a layer. Out: the points moved, the nozzle's centre, heading
//! and width with standard errors, the raster of that nozzle, edges by station. Gauss-Newton: the sweep's outline is an
//! envelope, so its distance from a point changes by the support function of the pose whose outline it is
//! (docs/design/measure.md). Points count as inside or outside only; the raster is swept anew for the nozzle of the round
//! before, so that nothing is linear in the result.

use super::cloud::Point;
use super::fit::{Row, robust};
use super::ground::{Ground, Nozzle};
use super::layer::Layer;
use crate::geometry::Vector2;
use crate::text::refusal::Refusal;

/// Share of the layer's height from which a point is on a bead: from above, even a round edge is as high as half of its bead,
/// which may be thinner than asked; as far from that as from the bed, noise takes as many points as it gives.
const EDGE_SHARE: f64 = 0.3;
/// How far to both sides of an edge points count, of the narrowest bead's half width: a round each. Wide enough for what is
/// off first, then near, where distances are exact.
const RAMPS: [f64; 4] = [0.5, 0.5, 0.25, 0.25];
/// Least points of an edge at a station.
const EDGE_POINTS: u32 = 8;
/// Fewest edges of a fit.
const EDGES_LEAST: usize = 30;
/// Motion, centre, width, heading.
const COLUMNS: usize = 7;

/// A turn about a point of the scan that comes to lie on one of the job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Counter-clockwise.
    pub turn_rad: f64,
    /// Where the point is that it turns about.
    pub from_mm: Vector2,
    /// And where it comes to lie.
    pub to_mm: Vector2,
}

impl Motion {
    /// Where a point comes to lie.
    pub fn of(&self, p: Vector2) -> Vector2 {
        turned(self.turn_rad, p - self.from_mm) + self.to_mm
    }

    /// The same turned farther about its point, then moved.
    pub fn by(&self, turn_rad: f64, shift_mm: Vector2) -> Motion {
        Motion {
            turn_rad: self.turn_rad + turn_rad,
            to_mm: self.to_mm + shift_mm,
            ..*self
        }
    }
}

fn turned(turn_rad: f64, p: Vector2) -> Vector2 {
    let (sin, cos) = turn_rad.sin_cos();
    Vector2::new(p.x * cos - p.y * sin, p.x * sin + p.y * cos)
}

/// What the edges tell.
pub struct Edges {
    /// By which the points were moved.
    pub motion: Motion,
    /// The nozzle.
    pub nozzle: Nozzle,
    /// Standard errors of its centre and width, mm, and of its heading, rad.
    pub error: [f64; 4],
    /// Its raster.
    pub ground: Ground,
    /// By station, how far the left and the right edge are outside of the asked ones, mm; `None` where no free edge is seen.
    pub off_mm: Vec<[Option<f64>; 2]>,
}

/// The points of an edge along a station.
#[derive(Clone, Copy, Default)]
struct Tally {
    points: u32,
    columns: [f64; COLUMNS],
    off_mm: f64,
}

/// Moves the points onto the edges.
///
/// # Errors
/// A `Refusal` of the raster.
pub fn fitted(points: &mut [Point], layer: &Layer) -> Result<Edges, Refusal> {
    let stations = &layer.stations;
    let middle = stations.iter().map(|s| s.at_mm).sum::<Vector2>() / stations.len() as f64;
    let mut motion = Motion {
        turn_rad: 0.0,
        from_mm: middle,
        to_mm: middle,
    };
    let mut nozzle = Nozzle::default();
    let mut ground = Ground::of(layer, &nozzle)?;
    let is_near = |p: &&Point| ground.near_mm(place(p)).abs() < 2.0 * ground.margin_mm;
    let near: Vec<Point> = points.iter().filter(is_near).copied().collect();
    let mut error = [f64::INFINITY; 4];
    // What is about as large as a nozzle, or an eighth of a turn, is no error of calibration any more.
    let (most_mm, most_rad) = (0.5 * layer.aperture.major_mm(), 0.4);
    let prior = [most_mm, most_mm, 0.1, most_mm, most_mm, most_mm, most_rad];
    for ramp in RAMPS {
        let tallies = tallies(&near, &motion, layer, &ground, ramp);
        let rows: Vec<Row<COLUMNS>> = tallies.iter().flatten().filter_map(mean).collect();
        if rows.len() < EDGES_LEAST {
            break;
        }
        let fit = robust(&rows, prior);
        let [x, y, turn_rad, cx, cy, wider_mm, heading_rad] = fit.value;
        motion = motion.by(turn_rad, Vector2::new(x, y));
        // Never out of the raster's room.
        let within = |x: f64| x.clamp(-2.0 * most_mm, 2.0 * most_mm);
        nozzle.centre_mm = (nozzle.centre_mm + Vector2::new(cx, cy)).map(within);
        nozzle.wider_mm = within(nozzle.wider_mm + wider_mm);
        nozzle.heading_rad += heading_rad;
        error.copy_from_slice(&fit.error[3..]);
        ground = Ground::of(layer, &nozzle)?;
    }
    let own = [
        nozzle.centre_mm.x,
        nozzle.centre_mm.y,
        nozzle.wider_mm,
        nozzle.heading_rad,
    ];
    let off = |tally: &Tally| {
        let (columns, off_mm) = mean(tally)?;
        Some(
            off_mm
                + columns[3..]
                    .iter()
                    .zip(own)
                    .map(|(a, b)| a * b)
                    .sum::<f64>(),
        )
    };
    let tallies = tallies(&near, &motion, layer, &ground, RAMPS[RAMPS.len() - 1]);
    let off_mm = tallies.iter().map(|sides| [off(&sides[0]), off(&sides[1])]);
    let off_mm = off_mm.collect();
    for point in points.iter_mut() {
        let at = motion.of(place(point));
        (point[0], point[1]) = (at.x as f32, at.y as f32);
    }
    Ok(Edges {
        motion,
        nozzle,
        error,
        ground,
        off_mm,
    })
}

/// From above.
pub fn place(point: &Point) -> Vector2 {
    Vector2::new(f64::from(point[0]), f64::from(point[1]))
}

fn mean(tally: &Tally) -> Option<Row<COLUMNS>> {
    let by = 1.0 / f64::from(tally.points);
    (tally.points >= EDGE_POINTS).then(|| (tally.columns.map(|sum| sum * by), tally.off_mm * by))
}

/// Sums over the points near free edges, by station and side: how the edge's distance changes, and by how much it is off.
fn tallies(
    points: &[Point],
    motion: &Motion,
    layer: &Layer,
    ground: &Ground,
    ramp: f64,
) -> Vec<[Tally; 2]> {
    let mut tallies = vec![[Tally::default(); 2]; layer.stations.len()];
    let (ramp_mm, free_mm) = (ramp * ground.margin_mm, 0.5 * ground.margin_mm);
    for point in points {
        let p = motion.of(place(point));
        let distance_mm = ground.distance_at(p);
        let Some(cell) = ground.cell(p).filter(|_| distance_mm.abs() < ramp_mm) else {
            continue;
        };
        let Some((number, _)) = ground.owner(cell) else {
            continue;
        };
        let slope = ground.slope_at(p);
        let out = -slope / slope.norm().max(f64::MIN_POSITIVE);
        let edge = p + out * distance_mm;
        // Nothing else is printed beside it, and it is no hairline gap.
        let is_free = ground.distance_at(edge + out * (2.0 * free_mm)) < -1.5 * free_mm
            && ground.distance_at(edge - out * free_mm) > 0.5 * free_mm;
        let station = &layer.stations[number];
        if !is_free || station.ends != [false; 2] {
            continue;
        }
        let heading_rad = ground.heading_rad(cell);
        let (sin, cos) = heading_rad.sin_cos();
        let turned = |by: f64| layer.aperture.support_mm(heading_rad + by, out);
        let r = p - motion.to_mm;
        let columns = [
            slope.x,
            slope.y,
            slope.y * r.x - slope.x * r.y,
            out.x * cos + out.y * sin,
            out.y * cos - out.x * sin,
            0.5,
            (turned(1e-4) - turned(-1e-4)) / 2e-4,
        ];
        let is_inside = f64::from(point[2]) - layer.base_mm > EDGE_SHARE * layer.height_mm;
        let tally = &mut tallies[number][usize::from(station.along.perp(&out) < 0.0)];
        tally.points += 1;
        tally.off_mm += if is_inside { ramp_mm } else { -ramp_mm } - distance_mm;
        for (sum, column) in tally.columns.iter_mut().zip(columns) {
            *sum += column;
        }
    }
    tallies
}

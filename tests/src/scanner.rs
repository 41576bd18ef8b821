//! A scanner of layers that are printed by a machine that is not quite what its file says, with a model of beads of its own.
//!
//! In: a stream, a [`Truth`] about the machine, a [`Scanner`]. Out: points, mm, in the scanner's own frame. Every servo tick
//! of the wire's spline ([`crate::segment_oracle`]) stamps an ellipse onto the points of the scan; material that arrives goes
//! to what a piece of path covers first, in a section that is a stadium: upright at the edge up to half of its height, round
//! above. Knows nothing of `headway::scan`.

use crate::segment_oracle::Oracle;
use headway::job::{MotionState, SegmentStream};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const HZ: f64 = 2000.0;
/// Path of a piece that has one height, and of the pieces where flow starts and stops.
const PIECE_MM: f64 = 0.3;
const END_MM: f64 = 1.0;

/// What the machine really does.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    pub semi_axes_mm: [f64; 2],
    pub height_mm: f64,
    /// Advance of the machine and its window, s.
    pub advance_s: f64,
    pub window_s: f64,
    /// What of the asked volume arrives.
    pub flow: f64,
    /// By how much beads are wider than the nozzle.
    pub wider_mm: f64,
    /// The nozzle's centre from the axis, in the tool's frame.
    pub centre_mm: [f64; 2],
    /// The heading when the machine takes it for 0.
    pub heading_rad: f64,
    /// Time constant of the material.
    pub lag_s: f64,
    /// More where passes start and stop.
    pub start_mm3: f64,
    pub stop_mm3: f64,
}

impl Truth {
    /// A machine as its file says.
    pub fn of(settings: &headway::settings::Settings) -> Truth {
        let extruder = &settings.machine.extruder;
        Truth {
            semi_axes_mm: [settings.aperture.major_mm(), settings.aperture.minor_mm()],
            height_mm: settings.layer_height_mm,
            advance_s: extruder.pressure_advance_s,
            window_s: 1e-3 * extruder.pressure_advance_window_ms,
            flow: 1.0,
            wider_mm: 0.0,
            centre_mm: [0.0; 2],
            heading_rad: 0.0,
            lag_s: extruder.pressure_advance_s,
            start_mm3: 0.0,
            stop_mm3: 0.0,
        }
    }
}

/// How it is scanned.
#[derive(Clone, Copy, Debug)]
pub struct Scanner {
    pub spacing_mm: f64,
    pub noise_mm: f64,
    pub dropouts: f64,
    pub tilt_rad: f64,
    pub turn_rad: f64,
    pub shift_mm: [f64; 3],
    pub warp_mm: f64,
    pub rim_mm: f64,
    pub seed: u64,
}

impl Default for Scanner {
    fn default() -> Scanner {
        Scanner {
            spacing_mm: 0.05,
            noise_mm: 0.03,
            dropouts: 0.1,
            tilt_rad: 1f64.to_radians(),
            turn_rad: 5f64.to_radians(),
            shift_mm: [2.4, -1.8, 3.0],
            warp_mm: 0.05,
            rim_mm: 4.0,
            seed: 1,
        }
    }
}

/// A pose of the real nozzle in the scanner's frame, and what arrives until the next.
struct Tick {
    at: [f64; 2],
    heading: f64,
    path_mm: f64,
    arrives_mm3: f64,
}

/// What each tick of a pass brings: with advance, through a lag of first order.
fn arriving(volumes_mm3: &[f64], truth: &Truth) -> Vec<f64> {
    let rates: Vec<f64> = volumes_mm3
        .windows(2)
        .map(|pair| (pair[1] - pair[0]) * HZ)
        .collect();
    let half = (0.5 * truth.window_s * HZ) as i64;
    let rate = |k: i64| {
        if k < 0 {
            0.0
        } else {
            rates.get(k as usize).copied().unwrap_or(0.0)
        }
    };
    let decay = (-1.0 / (HZ * truth.lag_s)).exp();
    let mut pressure = 0.0;
    let mut arrives: Vec<f64> = (0..rates.len() as i64)
        .map(|k| {
            let advance = truth.advance_s * (rate(k + half) - rate(k - half)) / truth.window_s;
            pressure = decay * pressure + (1.0 - decay) * (rate(k) + advance);
            truth.flow * pressure / HZ
        })
        .collect();
    arrives.push(0.0);
    arrives
}

fn passes(
    stream: &SegmentStream,
    offset_mm: [f64; 3],
    layer: u32,
    truth: &Truth,
    scanner: &Scanner,
) -> Vec<Vec<Tick>> {
    let oracle = Oracle::new(stream);
    let marks = stream
        .marks
        .iter()
        .filter(|mark| mark.layer == layer && mark.state == MotionState::Print);
    let turned = |turn: f64, [x, y]: [f64; 2]| {
        [
            x * turn.cos() - y * turn.sin(),
            x * turn.sin() + y * turn.cos(),
        ]
    };
    let pass = |mark: &headway::job::Mark| {
        let poses: Vec<[f64; 7]> = (mark.start_tick..=mark.end_tick)
            .map(|tick| oracle.at(tick as f64, 0))
            .collect();
        let volumes: Vec<f64> = poses.iter().map(|pose| pose[6]).collect();
        let arrives = arriving(&volumes, truth);
        let mut path_mm = 0.0;
        let mut last = [poses[0][0], poses[0][1]];
        let tick = |(pose, arrives_mm3): (&[f64; 7], f64)| {
            path_mm += (pose[0] - last[0]).hypot(pose[1] - last[1]);
            last = [pose[0], pose[1]];
            let heading = pose[5] + truth.heading_rad;
            let centre = turned(heading, truth.centre_mm);
            let at = [0, 1].map(|k| pose[k] - offset_mm[k] + centre[k]);
            let at = turned(scanner.turn_rad, at);
            Tick {
                at: [0, 1].map(|k| at[k] + scanner.shift_mm[k]),
                heading: heading + scanner.turn_rad,
                path_mm,
                arrives_mm3,
            }
        };
        poses.iter().zip(arrives).map(tick).collect()
    };
    marks.map(pass).collect()
}

/// Points of a layer on a bed, in a raster of rows.
pub fn scan(
    stream: &SegmentStream,
    offset_mm: [f64; 3],
    layer: u32,
    truth: &Truth,
    scanner: &Scanner,
) -> Vec<[f64; 3]> {
    let passes = passes(stream, offset_mm, layer, truth, scanner);
    let reach = truth.semi_axes_mm[0] + truth.wider_mm;
    let all = || passes.iter().flatten();
    let low = [0, 1]
        .map(|k| all().map(|t| t.at[k]).fold(f64::INFINITY, f64::min) - reach - scanner.rim_mm);
    let high = [0, 1]
        .map(|k| all().map(|t| t.at[k]).fold(f64::NEG_INFINITY, f64::max) + reach + scanner.rim_mm);
    let step = scanner.spacing_mm;
    let size = [0, 1].map(|k| ((high[k] - low[k]) / step) as usize + 1);
    // The first piece over each point, from 1, and the depth inside the swept ground.
    let mut piece_of = vec![0usize; size[0] * size[1]];
    let mut depth = vec![0f64; size[0] * size[1]];
    let mut volumes = vec![0.0];
    let axes = truth.semi_axes_mm.map(|axis| axis + 0.5 * truth.wider_mm);
    for pass in &passes {
        let length_mm = pass.last().map_or(0.0, |tick| tick.path_mm);
        let mut begun_mm = f64::NEG_INFINITY;
        for (number, tick) in pass.iter().enumerate() {
            let (first, last) = (tick.path_mm < END_MM, tick.path_mm > length_mm - END_MM);
            let is_new = number == 0
                || !first
                    && (tick.path_mm - begun_mm >= PIECE_MM || begun_mm == 0.0)
                    && !(last && begun_mm > length_mm - END_MM);
            if is_new {
                volumes.push(if number == 0 { truth.start_mm3 } else { 0.0 });
                begun_mm = tick.path_mm;
            }
            let piece = volumes.len() - 1;
            volumes[piece] += tick.arrives_mm3;
            stamp(
                tick,
                piece,
                axes,
                (low, size, step),
                &mut piece_of,
                &mut depth,
            );
        }
        *volumes.last_mut().expect("a piece") += truth.stop_mm3;
    }
    let radius = 0.5 * truth.height_mm;
    let share = |depth: f64| {
        let out = 1.0 - (depth / radius).min(1.0);
        0.5 + 0.5 * (1.0 - out * out).sqrt()
    };
    let mut grounds = vec![0.0; volumes.len()];
    for (piece, depth) in piece_of.iter().zip(&depth) {
        grounds[*piece] += share(*depth) * step * step;
    }
    // What finds no ground of its own goes to the next piece.
    let mut heights = vec![0.0; volumes.len()];
    let mut over = 0.0;
    for piece in 1..volumes.len() {
        let volume = volumes[piece] + over;
        let has_ground = grounds[piece] > 0.3 * step;
        over = if has_ground { 0.0 } else { volume };
        heights[piece] = if has_ground {
            volume / grounds[piece]
        } else {
            truth.height_mm
        };
    }
    let z = |index: usize| {
        if piece_of[index] == 0 {
            0.0
        } else {
            heights[piece_of[index]] * share(depth[index])
        }
    };
    placed(low, size, scanner, z)
}

/// The points that an ellipse covers.
fn stamp(
    tick: &Tick,
    piece: usize,
    [a, b]: [f64; 2],
    (low, size, step): ([f64; 2], [usize; 2], f64),
    piece_of: &mut [usize],
    depth: &mut [f64],
) {
    let (sin, cos) = tick.heading.sin_cos();
    let half = [(a * cos).hypot(b * sin), (a * sin).hypot(b * cos)];
    let from = [0, 1].map(|k| ((tick.at[k] - half[k] - low[k]) / step).ceil() as usize);
    let to = [0, 1].map(|k| ((tick.at[k] + half[k] - low[k]) / step) as usize);
    for row in from[1]..=to[1] {
        for column in from[0]..=to[0] {
            let x = low[0] + column as f64 * step - tick.at[0];
            let y = low[1] + row as f64 * step - tick.at[1];
            let [u, v] = [(x * cos + y * sin) / a, (y * cos - x * sin) / b];
            let level = u.hypot(v);
            if level <= 1.0 {
                let index = row * size[0] + column;
                if piece_of[index] == 0 {
                    piece_of[index] = piece;
                }
                // Distance from the edge to first order, which is exact there.
                let slope = (u / a).hypot(v / b) / level.max(1e-9);
                depth[index] = depth[index].max((1.0 - level) / slope.max(1.0 / a));
            }
        }
    }
}

/// Heights as points with noise, warp, tilt and drop-outs.
fn placed(
    low: [f64; 2],
    size: [usize; 2],
    scanner: &Scanner,
    z: impl Fn(usize) -> f64,
) -> Vec<[f64; 3]> {
    let mut random = Pcg64::seed_from_u64(scanner.seed);
    let mut points = Vec::new();
    let (sin, cos) = scanner.tilt_rad.sin_cos();
    // About an axis aslant.
    let (ax, ay) = (0.6, 0.8);
    let middle = [0, 1].map(|k| low[k] + 0.5 * scanner.spacing_mm * size[k] as f64);
    for index in 0..size[0] * size[1] {
        let [column, row] = [index % size[0], index / size[0]];
        let gaussian: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        if random.random::<f64>() < scanner.dropouts {
            continue;
        }
        let [x, y] =
            [(0, column), (1, row)].map(|(k, number)| low[k] + number as f64 * scanner.spacing_mm);
        let [dx, dy] = [x - middle[0], y - middle[1]];
        let warp = scanner.warp_mm * (dx * dx + 0.5 * dy * dy) / 400.0;
        let z = z(index) + warp + scanner.noise_mm * gaussian;
        // Rodrigues' turn about (ax, ay, 0).
        let along = (ax * dx + ay * dy) * (1.0 - cos);
        points.push([
            middle[0] + dx * cos + ay * z * sin + ax * along,
            middle[1] + dy * cos - ax * z * sin + ay * along,
            scanner.shift_mm[2] + z * cos + (ax * dy - ay * dx) * sin,
        ]);
    }
    points
}

/// Rows of x, y, z.
pub fn csv(points: &[[f64; 3]]) -> String {
    let rows = points
        .iter()
        .map(|[x, y, z]| format!("{x:.4},{y:.4},{z:.4}\n"));
    "x,y,z\n".to_string() + &rows.collect::<String>()
}

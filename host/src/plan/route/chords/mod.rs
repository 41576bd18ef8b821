//! The chords of an exported motion -> its original curves.
//!
//! In: moves of a file that Headway wrote for a controller: straight ones and arcs between points of a smooth motion,
//! each with its duration, headings and volumes (mm, deg, mm³, s). Out: [`ChordMove`]s from rest to rest, which pass
//! through these points and last at least as long as the file's moves. Their parameter is the file's time, over which
//! the motion is smooth; the head rests where no smooth motion within a chord's tolerance turns so far. Not covered:
//! tilts, and beads without a volume.

mod fit;
mod speeds;

use crate::gcode::{GcodePass, Leg, Place};
use crate::settings::Settings;
use fit::{BEAD_SHARES, Passed, TRAVEL_SHARES, chord_weight, fitted};
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS,
};
use speeds::{fastest_within, peak_mm_s};
use std::f64::consts::PI;

/// The distance of a motion from its chord is an eighth of chord times turn. The dialects' moves are within 3 µm and
/// 0.04° of it; what turns further than this allows, both with their roundings, is a corner at rest, mm.
const BESIDE_MM: f64 = 0.008;
/// Radius about the tip at which a turn of the heading counts as a distance: 0.05° count as 5 µm, as in the
/// requirements on exported files.
const TURN_MM: f64 = 5.7;
/// Parts of each of few moves.
const PARTS_MIN: usize = 4;
/// By how much the parts of long moves grow.
const PART_GROWTH: f64 = 1.6;

type Point = [f64; CHANNELS];

/// A curve from rest to rest in file coordinates.
pub struct ChordMove {
    /// Control points.
    pub control: Vec<Point>,
    /// The fastest that the tip may go, by the path's parameter, rising, mm/s.
    pub speeds_mm_s: Vec<[f64; 2]>,
    /// The time of its moves, s.
    pub least_s: f64,
}

/// Consecutive moves of a file.
pub struct Chords {
    moves: Vec<FileMove>,
    chord_shares: [f64; 2],
}

/// One move of the file: a chord, or an arc of several.
struct FileMove {
    line: usize,
    /// From its start to its end.
    points: Vec<Point>,
    seconds: f64,
}

impl Chords {
    /// The beads of a pass; `None` if the file gives no volumes.
    pub fn of_pass(pass: &GcodePass, flow_factor: f64) -> Option<Chords> {
        let (first, others) = pass.points.split_first()?;
        Chords::of(
            first,
            others.iter().zip(&pass.legs),
            flow_factor,
            BEAD_SHARES,
        )
    }

    /// The travel from a position to a pass, without its first `skipped` legs.
    pub fn of_travel(from: &Place, pass: &GcodePass, skipped: usize) -> Option<Chords> {
        let places = pass.travel.iter().chain(pass.points.first());
        let legs = places.zip(&pass.travel_legs).skip(skipped);
        Chords::of(from, legs, 0.0, TRAVEL_SHARES)
    }

    fn of<'a>(
        from: &Place,
        legs: impl Iterator<Item = (&'a Place, &'a Leg)>,
        flow_factor: f64,
        chord_shares: [f64; 2],
    ) -> Option<Chords> {
        let mut at = point(from, from.axis_and_heading().1, 0.0);
        let mut moves: Vec<FileMove> = Vec::new();
        for (place, leg) in legs {
            let volume_mm3 = at[CHANNEL_VOLUME] + leg.volume_mm3? * flow_factor;
            let to = point(place, at[CHANNEL_HEADING], volume_mm3);
            let [x, y, z, turned_mm] = way(&at, &to);
            let length_mm = length(&[x, y, z, 0.0]);
            // What only turns has its feed in degrees.
            let fed = match length_mm > 0.0 {
                true => length_mm,
                false => (turned_mm / TURN_MM).abs().to_degrees(),
            };
            if fed == 0.0 {
                continue;
            }
            let seconds = fed / leg.speed_mm_s;
            match moves.last_mut().filter(|last| last.line == leg.line) {
                Some(of_arc) => {
                    of_arc.points.push(to);
                    of_arc.seconds += seconds;
                }
                None => moves.push(FileMove {
                    line: leg.line,
                    points: vec![at, to],
                    seconds,
                }),
            }
            at = to;
        }
        (!moves.is_empty()).then_some(Chords {
            moves,
            chord_shares,
        })
    }

    /// Its curves from rest to rest; `None` if its times are not those of a smooth motion.
    pub fn curves(&self, settings: &Settings) -> Option<Vec<ChordMove>> {
        let goes_on = |before: &FileMove, after: &FileMove| !rests_between(before, after);
        let pieces = self.moves.chunk_by(goes_on);
        pieces
            .map(|moves| Piece { moves }.curve(self.chord_shares, settings))
            .collect()
    }
}

fn point(place: &Place, near_rad: f64, volume_mm3: f64) -> Point {
    let heading_rad = place.axis_and_heading().1;
    let turns = ((near_rad - heading_rad) / (2.0 * PI)).round();
    let mut point = [0.0; CHANNELS];
    point[CHANNEL_X..=CHANNEL_Z].copy_from_slice(&place.tip_mm);
    point[CHANNEL_HEADING] = heading_rad + 2.0 * PI * turns;
    point[CHANNEL_VOLUME] = volume_mm3;
    point
}

/// Tip and heading from one point to another, mm.
fn way(from: &Point, to: &Point) -> [f64; 4] {
    [
        to[CHANNEL_X] - from[CHANNEL_X],
        to[CHANNEL_Y] - from[CHANNEL_Y],
        to[CHANNEL_Z] - from[CHANNEL_Z],
        TURN_MM * (to[CHANNEL_HEADING] - from[CHANNEL_HEADING]),
    ]
}

fn length(way: &[f64; 4]) -> f64 {
    way.iter().map(|part| part * part).sum::<f64>().sqrt()
}

/// True where no smooth motion turns from one move to the next.
fn rests_between(before: &FileMove, after: &FileMove) -> bool {
    let [.., from, at] = before.points.as_slice() else {
        return true;
    };
    let (before, after) = (way(from, at), way(at, &after.points[1]));
    let (before_mm, after_mm) = (length(&before), length(&after));
    let dot: f64 = before.iter().zip(&after).map(|(a, b)| a * b).sum();
    let turn_rad = (dot / (before_mm * after_mm)).clamp(-1.0, 1.0).acos();
    before_mm.min(after_mm) * turn_rad / 8.0 > BESIDE_MM
}

impl FileMove {
    fn ways(&self) -> impl Iterator<Item = [f64; 4]> {
        self.points.windows(2).map(|pair| way(&pair[0], &pair[1]))
    }

    /// Of tip and heading, mm.
    fn way_mm(&self) -> f64 {
        self.ways().map(|way| length(&way)).sum()
    }

    fn tip_mm(&self) -> f64 {
        self.ways()
            .map(|[x, y, z, _]| length(&[x, y, z, 0.0]))
            .sum()
    }

    /// The point at a distance from its start, and the direction there.
    fn at(&self, mut way_mm: f64) -> (Point, [f64; 4]) {
        let last = self.points.len() - 2;
        for (i, way) in self.ways().enumerate() {
            let length_mm = length(&way);
            if way_mm <= length_mm || i == last {
                let share = way_mm / length_mm;
                let [from, to] = [self.points[i], self.points[i + 1]];
                let point = std::array::from_fn(|c| from[c] + share * (to[c] - from[c]));
                return (point, way.map(|part| part / length_mm));
            }
            way_mm -= length_mm;
        }
        (self.points[0], [0.0; 4])
    }
}

/// Moves from rest to rest.
struct Piece<'a> {
    moves: &'a [FileMove],
}

impl Piece<'_> {
    fn curve(&self, chord_shares: [f64; 2], settings: &Settings) -> Option<ChordMove> {
        let passed = self.passed();
        let control = fitted(&passed, self.moves.len() + 1, chord_shares, settings)?;
        let per_unit = (control.len() - 1) as f64 / passed[passed.len() - 1].at;
        let places = passed.iter().filter(|of| of.along.is_none());
        let places: Vec<f64> = places.map(|of| of.at * per_unit).collect();
        let last = self.moves.len() - 1;
        let fastest = self.moves.iter().enumerate().map(|(i, of)| {
            let rests = usize::from(i == 0) + usize::from(i == last);
            let mean_mm_s = of.tip_mm() / of.seconds;
            peak_mm_s(
                mean_mm_s,
                of.seconds,
                rests,
                settings.tip_acceleration_mm_s2,
            )
        });
        let ways_mm: Vec<f64> = self.moves.iter().map(FileMove::tip_mm).collect();
        let within_mm = 2.0 * settings.aperture.major_mm();
        let fastest = fastest_within(&fastest.collect::<Vec<_>>(), &ways_mm, within_mm);
        let of_moves = places.windows(2).zip(fastest);
        Some(ChordMove {
            control,
            speeds_mm_s: of_moves
                .flat_map(|(ends, speed_mm_s)| [0, 1].map(|end| [ends[end], speed_mm_s]))
                .collect(),
            least_s: self.moves.iter().map(|of| of.seconds).sum(),
        })
    }

    /// The speed in the middle of tip and heading at each end of a move, mm/s, and the parameter's steps. The parameter is
    /// time, but does not come to rest where the head does.
    fn paces(&self, ways_mm: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut steps: Vec<f64> = self.moves.iter().map(|of| of.seconds).collect();
        let means: Vec<f64> = ways_mm.iter().zip(&steps).map(|(w, s)| w / s).collect();
        let last = steps.len() - 1;
        let mut paces = vec![means[0]];
        for i in 1..=last {
            let (before_s, after_s) = (steps[i - 1], steps[i]);
            // Of the parabola through three places; at most such that the path between two of them stays
            // increasing.
            let pace = (means[i - 1] * after_s + means[i] * before_s) / (before_s + after_s);
            paces.push(pace.min(3.0 * means[i - 1].min(means[i])));
        }
        paces.push(means[last]);
        if last > 0 {
            (paces[0], paces[last + 1]) = (paces[1], paces[last]);
            steps[0] = ways_mm[0] / paces[0];
            steps[last] = ways_mm[last] / paces[last];
        }
        (paces, steps)
    }

    /// What the curve passes.
    fn passed(&self) -> Vec<Passed> {
        let ways_mm: Vec<f64> = self.moves.iter().map(FileMove::way_mm).collect();
        let (paces, steps) = self.paces(&ways_mm);
        let place = |at, point| Passed {
            at,
            point,
            along: None,
            weight: 1.0,
        };
        let mut at = 0.0;
        let mut all = vec![place(at, self.moves[0].points[0])];
        for (i, of) in self.moves.iter().enumerate() {
            let step = steps[i];
            // Parts begin with the length of the adjacent move, and grow towards the middle.
            let beside = |other: Option<usize>| {
                let other = other.and_then(|other| steps.get(other));
                other.map_or(1.0, |other| other.min(step) / step)
            };
            let ends = [beside(i.checked_sub(1)), beside(Some(i + 1))];
            let chords = of.points.len() - 1;
            // Few moves have few places: points between them hold the curve.
            let longest = match self.moves.len() < PARTS_MIN {
                true => 1.0 / PARTS_MIN.max(chords) as f64,
                false => 1.0 / chords as f64,
            };
            let parts = parts(ends, longest);
            let shortest = ends[0].min(ends[1]).min(longest);
            for (k, q) in parts.iter().copied().enumerate() {
                let [from, to] = [paces[i], paces[i + 1]].map(|pace| pace * step / ways_mm[i]);
                let r = 1.0 - q;
                let share = q * (r * r * from + q * (3.0 - 2.0 * q) - q * r * to);
                let (point, along) = of.at(share * ways_mm[i]);
                let before = k.checked_sub(1).map_or(0.0, |k| parts[k]);
                let after = parts.get(k + 1).copied().unwrap_or(1.0);
                all.push(Passed {
                    at: at + q * step,
                    point,
                    along: Some(along),
                    weight: chord_weight((q - before).min(after - q) / shortest),
                });
            }
            at += step;
            all.push(place(at, of.points[chords]));
        }
        all
    }
}

/// Inner ends of parts of 1, which begin and end with these lengths and grow to the middle, up to `longest`.
fn parts([first, last]: [f64; 2], longest: f64) -> Vec<f64> {
    let (mut from_start, mut from_end) = (Vec::new(), Vec::new());
    let (mut low, mut high) = (0.0, 1.0);
    let (mut next, mut before) = (first.min(longest), last.min(longest));
    // While the rest is longer than both adjacent parts.
    while high - low > PART_GROWTH * next.min(before) + f64::EPSILON {
        if next <= before {
            low += next;
            from_start.push(low);
            next = (next * PART_GROWTH).min(longest);
        } else {
            high -= before;
            from_end.push(high);
            before = (before * PART_GROWTH).min(longest);
        }
    }
    from_start.extend(from_end.into_iter().rev());
    from_start
}

//! Rounds the corners of a run of waypoints: of the tip's path, of the tool axis and of the
//! heading.
//!
//! In: poses (mm, rad) over the chord length of the tip, where the path has corners, tolerances. Out: channels as
//! functions of that length with continuous third derivatives: splines that end at the corners, and around each
//! corner a correction. With x = (s - corner) / half from -1 to 1, where value, first and second derivative of the
//! splines jump by 0, J1 and J2, it is
//!
//! ```text
//! J1 half   (g(x) - |x|) / 2          g(x) = (5 + 15 x² - 5 x⁴ + x⁶) / 16
//! J2 half² (q(x) - x |x| / 4)         q(x) = x (5 + 15 x² - 5 x⁴ + x⁶) / 64
//! ```
//! g and q join |x| and x |x| / 4 with three continuous derivatives. So the sum has no jump up to the second
//! derivative, nothing changes outside the window, and its distance from the splines is known beforehand: at most
//! 5/32 |J1| half + 0.0076 |J2| half². The splines end in parabolas: their third derivative is 0 there. For straight
//! legs that turn by t the radius in the middle is 1.7 tolerance / tan²(t/2). Not covered: time: whether a small
//! rounding is faster than a rest depends on the machine.

use super::chord_spline::Spline;
use crate::settings::Settings;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_X, CHANNEL_Z, CHANNELS,
};
use std::f64::consts::PI;
use std::ops::RangeInclusive;

/// Turns of the path below this are not corners, whatever their neighbours.
const BLUNT_RAD: f64 = PI / 36.0;
/// How much the rate of the axis' turning changes at a corner, rad/mm: a degree a millimetre. At 60 mm/s that is
/// 60 °/s more, which rotary axes take some 20 ms for, or a millimetre.
const AXIS_CORNER_RAD_MM: f64 = PI / 180.0;
/// Ratio of a corner's turn to that of the neighbouring waypoints: a circle of few chords has none.
const ALONE: f64 = 4.0;
/// Largest values of the corrections: 5/32, and of the second rounded up.
const OF_SLOPE: f64 = 5.0 / 32.0;
const OF_BEND: f64 = 0.0076;
/// Shorter windows are no rounding, mm.
const HALF_MIN_MM: f64 = 0.02;
/// Deviations of an angle below this are ignored, rad.
const NONE_RAD: f64 = 1e-6;
/// Corners are counted from this deviation on, mm and rad: what a curve's segments may be off.
const TOLD: f64 = 1e-4;

/// The tip's channels, those of the axis, that of the heading.
pub const TIP: RangeInclusive<usize> = CHANNEL_X..=CHANNEL_Z;
const AXIS: RangeInclusive<usize> = CHANNEL_TILT_X..=CHANNEL_TILT_Y;
const HEADING: RangeInclusive<usize> = CHANNEL_HEADING..=CHANNEL_HEADING;

type Point = [f64; CHANNELS];

/// What became of the corners of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RoundedCorners {
    /// Corners of the path that are rounded, and by how much at most, mm.
    pub path: usize,
    /// See `path`.
    pub path_off_mm: f64,
    /// Corners of the tool axis that are rounded, and by how much at most, rad.
    pub axis: usize,
    /// See `axis`.
    pub axis_off_rad: f64,
    /// By how much a heading that is given is off at most at corners of the path, rad.
    pub heading_off_rad: f64,
    /// Corners of the path where the head still comes to rest.
    pub rests: usize,
}

impl RoundedCorners {
    /// With those of another stretch.
    pub fn and(self, other: RoundedCorners) -> RoundedCorners {
        RoundedCorners {
            path: self.path + other.path,
            path_off_mm: self.path_off_mm.max(other.path_off_mm),
            axis: self.axis + other.axis,
            axis_off_rad: self.axis_off_rad.max(other.axis_off_rad),
            heading_off_rad: self.heading_off_rad.max(other.heading_off_rad),
            rests: self.rests + other.rests,
        }
    }

    /// The settings with the rest of the axis's tolerance.
    pub fn left_of(&self, settings: &Settings) -> Settings {
        Settings {
            axis_tolerance_rad: (settings.axis_tolerance_rad - self.axis_off_rad).max(0.0),
            ..settings.clone()
        }
    }
}

/// Permitted deviations, mm and rad.
#[derive(Clone, Copy, Debug)]
pub struct CornerTolerances {
    /// The tip; 0: nothing is rounded.
    pub tip_mm: f64,
    /// The tool axis, and a heading that is given.
    pub angle_rad: f64,
}

impl CornerTolerances {
    /// From the settings. Half of the axis's tolerance is reserved for leading past singular directions, so
    /// that both together stay within it.
    pub fn of(settings: &Settings) -> CornerTolerances {
        CornerTolerances {
            tip_mm: settings.tolerances.corner_mm,
            angle_rad: 0.5 * settings.axis_tolerance_rad,
        }
    }
}

/// Splines of some channels from corner to corner, and what rounds the corners.
struct Rounded {
    channels: RangeInclusive<usize>,
    splines: Vec<Spline>,
    corrections: Vec<Correction>,
}

/// Around one corner.
#[derive(Clone, Copy, Debug)]
struct Correction {
    at_mm: f64,
    half_mm: f64,
    slope_jump: Point,
    bend_jump: Point,
}

/// The channels of a stretch of waypoints over the chord length, C² throughout.
pub struct RoundedSpline {
    /// Through all waypoints: the channels that have no corners.
    whole: Spline,
    rounded: Vec<Rounded>,
}

impl RoundedSpline {
    /// Without corners.
    pub fn smooth(whole: Spline) -> RoundedSpline {
        RoundedSpline {
            whole,
            rounded: Vec::new(),
        }
    }

    /// Chord length at each waypoint, mm.
    pub fn knots(&self) -> &[f64] {
        &self.whole.knots
    }

    /// Chord length of all of it, mm.
    pub fn length(&self) -> f64 {
        self.whole.length()
    }

    /// Channels at a chord length.
    pub fn value(&self, s: f64) -> Point {
        let mut value = self.whole.value(s);
        for rounded in &self.rounded {
            let own = rounded.value(s);
            rounded.channels.clone().for_each(|c| value[c] = own[c]);
        }
        value
    }

    /// Their derivatives by it.
    pub fn slope(&self, s: f64) -> Point {
        let mut slope = self.whole.slope(s);
        for rounded in &self.rounded {
            let own = rounded.slope(s);
            rounded.channels.clone().for_each(|c| slope[c] = own[c]);
        }
        slope
    }
}

impl Rounded {
    fn value(&self, s: f64) -> Point {
        let mut value = self.spline(s).value(s);
        if let Some(correction) = self.correction(s) {
            let by = correction.value(s);
            (0..CHANNELS).for_each(|c| value[c] += by[c]);
        }
        value
    }

    fn slope(&self, s: f64) -> Point {
        let mut slope = self.spline(s).slope(s);
        if let Some(correction) = self.correction(s) {
            let by = correction.slope(s);
            (0..CHANNELS).for_each(|c| slope[c] += by[c]);
        }
        slope
    }

    /// The spline there; at a corner the one that begins.
    fn spline(&self, s: f64) -> &Spline {
        let begun = self.splines.partition_point(|spline| spline.knots[0] <= s);
        &self.splines[begun.saturating_sub(1)]
    }

    /// The windows of neighbours do not overlap.
    fn correction(&self, s: f64) -> Option<&Correction> {
        let next = self
            .corrections
            .partition_point(|correction| correction.at_mm + correction.half_mm <= s);
        let correction = self.corrections.get(next)?;
        (s > correction.at_mm - correction.half_mm).then_some(correction)
    }
}

impl Correction {
    fn value(&self, s: f64) -> Point {
        let half = self.half_mm;
        let x = (s - self.at_mm) / half;
        let square = x * x;
        let g = (5.0 + square * (15.0 + square * (square - 5.0))) / 16.0;
        let of_slope = 0.5 * half * (g - x.abs());
        let of_bend = half * half * 0.25 * x * (g - x.abs());
        std::array::from_fn(|c| of_slope * self.slope_jump[c] + of_bend * self.bend_jump[c])
    }

    fn slope(&self, s: f64) -> Point {
        let half = self.half_mm;
        let x = (s - self.at_mm) / half;
        let square = x * x;
        let g = (5.0 + square * (15.0 + square * (square - 5.0))) / 16.0;
        let g_slope = x * (30.0 + square * (6.0 * square - 20.0)) / 16.0;
        // At the corner the spline is the one that begins.
        let side = if x < 0.0 { -1.0 } else { 1.0 };
        let of_slope = 0.5 * (g_slope - side);
        let of_bend = half * 0.25 * (g - 2.0 * x.abs() + x * g_slope);
        std::array::from_fn(|c| of_slope * self.slope_jump[c] + of_bend * self.bend_jump[c])
    }

    /// Length of the correction in these channels at its largest.
    fn off(&self, channels: &RangeInclusive<usize>) -> f64 {
        let looks = (-20..=20).map(|look| {
            let by = self.value(self.at_mm + self.half_mm * f64::from(look) / 20.0);
            norm(&by, channels)
        });
        looks.fold(0.0, f64::max)
    }
}

fn norm(point: &Point, channels: &RangeInclusive<usize>) -> f64 {
    let squares = channels.clone().map(|c| point[c] * point[c]);
    squares.sum::<f64>().sqrt()
}

/// Half of the longest window in which jumps of this size are off by no more than the tolerance.
fn half_mm(slope_jump: f64, bend_jump: f64, tolerance: f64) -> f64 {
    let linear = OF_SLOPE * slope_jump;
    let root = (linear * linear + 4.0 * OF_BEND * bend_jump * tolerance).sqrt();
    2.0 * tolerance / (linear + root).max(f64::MIN_POSITIVE)
}

/// A stretch of waypoints between rests: the waypoints at which it turns without a rest, and their
/// poses.
pub struct Stretch<'a> {
    /// Poses at the waypoints.
    pub poses: &'a [Point],
    /// Chord length at each, mm.
    pub knots: &'a [f64],
    /// Inner waypoints at which the path turns by too much for a spline through them.
    pub corners: &'a [usize],
}

/// Corners that cannot be rounded within the tolerances, by their waypoints, rising.
#[derive(Clone, Debug, PartialEq)]
pub struct MustRest(pub Vec<usize>);

impl Stretch<'_> {
    /// The channels with all corners rounded, and the result for each corner.
    ///
    /// # Errors
    /// [`MustRest`] with the corners that cannot be rounded.
    pub fn rounded(
        &self,
        tolerances: CornerTolerances,
    ) -> Result<(RoundedSpline, RoundedCorners), MustRest> {
        let mut told = RoundedCorners::default();
        let (mut rounded, mut rests) = (Vec::new(), Vec::new());
        let blunt = self.alone(&TIP, BLUNT_RAD, true);
        let axis_corners = self.alone(&AXIS, AXIS_CORNER_RAD_MM, false);
        for (channels, own, tolerance) in [
            (TIP, blunt, tolerances.tip_mm),
            (AXIS, axis_corners, tolerances.angle_rad),
            (HEADING, Vec::new(), tolerances.angle_rad),
        ] {
            let part = self.part(channels.clone(), &own, tolerance);
            rests.extend(self.too_short(&part));
            let offs = part.corrections.iter().map(|each| each.off(&channels));
            let offs: Vec<f64> = offs.collect();
            let most = offs.iter().copied().fold(0.0, f64::max);
            let count = offs.iter().filter(|off| **off > TOLD).count();
            if channels == TIP {
                (told.path, told.path_off_mm) = (count, most);
            } else if channels == AXIS {
                (told.axis, told.axis_off_rad) = (count, most);
            } else {
                told.heading_off_rad = most;
            }
            if most > 0.0 {
                rounded.push(part);
            }
        }
        if !rests.is_empty() {
            rests.sort_unstable();
            rests.dedup();
            return Err(MustRest(rests));
        }
        let whole = Spline::over(self.knots.to_vec(), self.poses);
        Ok((RoundedSpline { whole, rounded }, told))
    }

    /// Waypoints at which these channels turn by more than `least` and far more than at their neighbours:
    /// directions by their angle, others by the change of their rate.
    fn alone(&self, channels: &RangeInclusive<usize>, least: f64, is_angle: bool) -> Vec<usize> {
        let rates: Vec<Point> = (1..self.poses.len()).map(|i| self.rate(i)).collect();
        let turn = |i: usize| match rates.get(i.wrapping_sub(1)).zip(rates.get(i)) {
            Some((before, after)) => {
                let change: Point = std::array::from_fn(|c| after[c] - before[c]);
                let change = norm(&change, channels);
                match is_angle {
                    true => 2.0 * (0.5 * change).min(1.0).asin(),
                    false => change,
                }
            }
            None => 0.0,
        };
        let is_alone = |i: &usize| {
            let beside = turn(i - 1).max(turn(i + 1));
            turn(*i) > least && turn(*i) > ALONE * beside
        };
        let last = self.poses.len() - 1;
        (1..last).filter(is_alone).collect()
    }

    /// Change by the chord before a waypoint, a mm.
    fn rate(&self, i: usize) -> Point {
        let chord_mm = self.knots[i] - self.knots[i - 1];
        std::array::from_fn(|c| (self.poses[i][c] - self.poses[i - 1][c]) / chord_mm)
    }

    /// These channels, with corners where the path has them and at their own; a corner that a spline passes as gently
    /// by itself does not count.
    fn part(&self, channels: RangeInclusive<usize>, own: &[usize], tolerance: f64) -> Rounded {
        // What the fit of the curve may be off is no deviation.
        let tolerance = tolerance.max(NONE_RAD);
        let mut breaks: Vec<usize> = self.corners.iter().chain(own).copied().collect();
        breaks.sort_unstable();
        breaks.dedup();
        let first = self.broken(&breaks, &channels, tolerance);
        breaks.retain(|at| {
            let chords_mm = self.knots[at + 1] - self.knots[at - 1];
            let mut found = first.corrections.iter();
            let is_gentle =
                found.any(|each| each.at_mm == self.knots[*at] && 2.0 * each.half_mm >= chords_mm);
            is_gentle || self.corners.contains(at)
        });
        self.broken(&breaks, &channels, tolerance)
    }

    /// The path's corners without a window.
    fn too_short(&self, part: &Rounded) -> Vec<usize> {
        let is_short = |at: &usize| {
            let mut found = part.corrections.iter();
            found.any(|each| each.at_mm == self.knots[*at] && each.half_mm < HALF_MIN_MM)
        };
        self.corners.iter().copied().filter(is_short).collect()
    }

    fn broken(
        &self,
        breaks: &[usize],
        channels: &RangeInclusive<usize>,
        tolerance: f64,
    ) -> Rounded {
        let last = self.poses.len() - 1;
        let mut ends = vec![0];
        ends.extend_from_slice(breaks);
        ends.push(last);
        let spline = |ends: &[usize]| {
            let [from, to] = [ends[0], ends[1]];
            Spline::over(self.knots[from..=to].to_vec(), &self.poses[from..=to])
        };
        let splines: Vec<Spline> = ends.windows(2).map(spline).collect();
        let corrections = splines.windows(2).zip(ends.windows(3));
        let corrections = corrections.map(|(sides, ends)| {
            let at_mm = self.knots[ends[1]];
            let [before, after] = [ends[0], ends[2]].map(|i| (self.knots[i] - at_mm).abs());
            // Between two corners each has half of the distance, next to a rest all of it.
            let before = if ends[0] == 0 { before } else { 0.5 * before };
            let after = if ends[2] == last { after } else { 0.5 * after };
            let jump = |of: fn(&Spline, f64) -> Point| -> Point {
                let [left, right] = [of(&sides[0], at_mm), of(&sides[1], at_mm)];
                std::array::from_fn(|c| right[c] - left[c])
            };
            let (slope_jump, bend_jump) = (jump(Spline::slope), jump(Spline::bend));
            let jumps = [slope_jump, bend_jump].map(|jump| norm(&jump, channels));
            Correction {
                at_mm,
                half_mm: half_mm(jumps[0], jumps[1], tolerance)
                    .min(before)
                    .min(after),
                slope_jump,
                bend_jump,
            }
        });
        Rounded {
            channels: channels.clone(),
            corrections: corrections.collect(),
            splines,
        }
    }
}

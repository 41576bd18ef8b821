//! A pass of waypoints -> parts from rest to rest, with the corners within them rounded.
//!
//! In: the waypoints of a pass (mm), the part's offset, the tolerances. Out: [`Piece`]s whose neighbours share a
//! waypoint, and the treatment of each corner. Without a tolerance every corner is a rest. With one the head
//! rests where it turns in place, where the path turns sharply, and where a corner cannot be rounded within the
//! tolerance.

use super::chord_spline::Spline;
use super::rounding::{CornerTolerances, MustRest, RoundedCorners, RoundedSpline, Stretch};
use super::{CORNER_RAD, pose};
use crate::input::waypoints::{SAME_PLACE_MM, Waypoint};
use crate::settings::Settings;
use headway_protocol::units::CHANNELS;
use std::f64::consts::{FRAC_PI_2, PI};

/// Turns of the path above this are left to a rest: rounded they are spikes around which the head creeps.
const SHARP_RAD: f64 = 2.0 * PI / 3.0;
/// The same for a nozzle across the travel: at a rest it is turned by the lesser angle.
const SHARP_ACROSS_RAD: f64 = FRAC_PI_2 + 0.01;
/// Corners that cannot be rounded make others longer: so often that is tried.
const ROUNDS: usize = 4;

type Point = [f64; CHANNELS];

/// A part of a pass between two rests.
pub struct Piece<'a> {
    /// Its waypoints.
    pub points: &'a [Waypoint],
    /// Their poses on the machine.
    pub poses: Vec<Point>,
    /// The intended curve between them; `None` for a turn in place.
    pub spline: Option<RoundedSpline>,
}

/// The parts of a pass of two waypoints or more.
pub fn pieces<'a>(
    points: &'a [Waypoint],
    offset_mm: [f64; 3],
    settings: &Settings,
) -> (Vec<Piece<'a>>, RoundedCorners) {
    let poses: Vec<Point> = points.iter().map(|point| pose(point, offset_mm)).collect();
    let tolerances = CornerTolerances::of(settings);
    let mut told = RoundedCorners::default();
    let mut pieces = Vec::new();
    let is_rounded = tolerances.tip_mm > 0.0;
    let turned = points.iter().any(|point| point.heading_rad.is_none());
    let sharp_rad = match (is_rounded, turned && !settings.aperture.is_round()) {
        (false, _) => CORNER_RAD,
        (true, false) => SHARP_RAD,
        (true, true) => SHARP_ACROSS_RAD,
    };
    let pass = Pass { points, poses };
    let (rests, sharp) = pass.rests(sharp_rad);
    told.rests = if is_rounded { sharp } else { 0 };
    for ends in rests.windows(2) {
        let [from, to] = [ends[0], ends[1]];
        if is_rounded && to - from > 1 {
            let (own, became) = pass.rounded(from, to, tolerances);
            pieces.extend(own);
            told = told.and(became);
        } else {
            pieces.push(pass.plain(from, to));
        }
    }
    (pieces, told)
}

struct Pass<'a> {
    points: &'a [Waypoint],
    poses: Vec<Point>,
}

impl<'a> Pass<'a> {
    /// The waypoints at which the head rests, both ends among them, and how many of them are sharp turns.
    fn rests(&self, sharp_rad: f64) -> (Vec<usize>, usize) {
        let last = self.points.len() - 1;
        let (mut rests, mut sharp) = (vec![0], 0);
        for i in 1..last {
            let stands = self.chord_mm(i - 1) < SAME_PLACE_MM || self.chord_mm(i) < SAME_PLACE_MM;
            let is_sharp = !stands && self.turn_rad(i) > sharp_rad;
            sharp += usize::from(is_sharp);
            if stands || is_sharp {
                rests.push(i);
            }
        }
        rests.push(last);
        (rests, sharp)
    }

    /// From a waypoint to the next one.
    fn chord_mm(&self, i: usize) -> f64 {
        (self.points[i + 1].tip_mm - self.points[i].tip_mm).norm()
    }

    fn turn_rad(&self, i: usize) -> f64 {
        let chord = |i: usize| self.points[i + 1].tip_mm - self.points[i].tip_mm;
        chord(i - 1).angle(&chord(i))
    }

    /// A piece without corners.
    fn plain(&self, from: usize, to: usize) -> Piece<'a> {
        let (points, poses) = (&self.points[from..=to], self.poses[from..=to].to_vec());
        let on_the_spot = to == from + 1 && self.chord_mm(from) < SAME_PLACE_MM;
        Piece {
            points,
            spline: (!on_the_spot).then(|| RoundedSpline::smooth(Spline::through(&poses))),
            poses,
        }
    }

    /// A stretch with its corners rounded, in as many pieces as it takes.
    fn rounded(
        &self,
        from: usize,
        to: usize,
        tolerances: CornerTolerances,
    ) -> (Vec<Piece<'a>>, RoundedCorners) {
        let (mut pieces, mut told) = (Vec::new(), RoundedCorners::default());
        // Stretches that are left, the first one last.
        let mut left = vec![(from, to, ROUNDS)];
        while let Some((from, to, rounds)) = left.pop() {
            match self.try_rounded(from, to, rounds, tolerances) {
                Ok((piece, became)) => {
                    pieces.push(piece);
                    told = told.and(became);
                }
                Err(MustRest(rests)) => {
                    told.rests += rests.len();
                    let mut ends = vec![from];
                    ends.extend(rests.iter().map(|at| from + at));
                    ends.push(to);
                    let parts = ends.windows(2).rev();
                    left.extend(parts.map(|ends| (ends[0], ends[1], rounds.saturating_sub(1))));
                }
            }
        }
        (pieces, told)
    }

    fn try_rounded(
        &self,
        from: usize,
        to: usize,
        rounds: usize,
        tolerances: CornerTolerances,
    ) -> Result<(Piece<'a>, RoundedCorners), MustRest> {
        let inner = from + 1..to;
        let corners = inner.filter(|i| self.turn_rad(*i) > CORNER_RAD);
        let corners: Vec<usize> = corners.map(|i| i - from).collect();
        if rounds == 0 && !corners.is_empty() {
            return Err(MustRest(corners));
        }
        let piece = self.plain(from, to);
        let Some(knots) = piece.spline.as_ref().map(RoundedSpline::knots) else {
            return Ok((piece, RoundedCorners::default()));
        };
        let stretch = Stretch {
            poses: &piece.poses,
            knots,
            corners: &corners,
        };
        let (spline, told) = stretch.rounded(tolerances)?;
        let spline = Some(spline);
        Ok((Piece { spline, ..piece }, told))
    }
}

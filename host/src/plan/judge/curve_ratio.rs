//! The ratio of deposited material on the outside of a curve to that on the inside.
//!
//! In: the finished stream, the settings. Out: the worst ratio with its place, and the length of path above the
//! requested bound. With the bead's width w across the path and the path's radius R the ratio is (R + w/2) / (R -
//! w/2) (Liu et al., 2020, for concrete: tears from 1.20 on). Not covered: the effect of the nozzle's own
//! rotation on the edges, and tilted tools, whose path is projected from above.

use crate::geometry::Vector2;
use crate::job::{MotionState, SegmentStream};
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_X, CHANNEL_Y, CHANNEL_Z};

/// Upper bound of reported ratios: the inside is at rest or moves back.
pub const RATIO_MAX: f64 = 100.0;
/// Directions are compared over steps of at least this share of the bead's width: so a corner in which the head stops
/// counts, and effects of quantisation do not.
const STEP_SHARE: f64 = 0.1;
/// Points of a span that are evaluated.
const PLACES: u32 = 4;
/// Speed below which the direction is undefined, mm/s, for a bead 1 mm wide.
const SPEED_MIN_SHARE_S: f64 = 0.01;

/// The worst of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurveRatio {
    /// Outside by inside; 1 where all is straight, at most [`RATIO_MAX`].
    pub ratio_max: f64,
    /// Where that is, machine coordinates.
    pub at_mm: [f64; 3],
    /// The layer of that place, from 0.
    pub layer: u32,
    /// Path above the bound of the settings.
    pub over_mm: f64,
}

impl CurveRatio {
    /// Nothing but straight beads.
    pub const STRAIGHT: CurveRatio = CurveRatio {
        ratio_max: 1.0,
        at_mm: [0.0; 3],
        layer: 0,
        over_mm: 0.0,
    };

    /// Of a stream and another one, printed one after the other.
    pub fn with(self, other: CurveRatio) -> CurveRatio {
        let worse = match other.ratio_max > self.ratio_max {
            true => other,
            false => self,
        };
        CurveRatio {
            over_mm: self.over_mm + other.over_mm,
            ..worse
        }
    }

    /// Of the printing moves of a stream.
    pub fn of(stream: &SegmentStream, settings: &Settings) -> CurveRatio {
        let servo_hz = f64::from(settings.machine.servo_hz);
        let mut walk = Walk::new(settings);
        for (span, mark) in stream.marked_spans() {
            let pass = mark.filter(|mark| mark.state == MotionState::Print);
            walk.is_printing(pass.map(|mark| (mark.layer, mark.pass)));
            let ticks = f64::from(span.duration_ticks);
            if pass.is_none() {
                continue;
            }
            for place in 0..PLACES {
                let t = ticks * f64::from(place) / f64::from(PLACES);
                let position = span.position(t);
                let velocity = span.velocity(t, servo_hz);
                walk.visit(&Visit {
                    at_mm: [CHANNEL_X, CHANNEL_Y, CHANNEL_Z].map(|channel| position[channel]),
                    heading_rad: position[CHANNEL_HEADING],
                    velocity_mm_s: Vector2::new(velocity[CHANNEL_X], velocity[CHANNEL_Y]),
                });
            }
        }
        walk.found
    }
}

/// A place of the path.
struct Visit {
    at_mm: [f64; 3],
    heading_rad: f64,
    velocity_mm_s: Vector2,
}

/// The last place that directions are compared with.
#[derive(Clone, Copy)]
struct Last {
    at_mm: [f64; 3],
    direction: Vector2,
}

struct Walk<'a> {
    settings: &'a Settings,
    bound: f64,
    /// The layer and number of the pass that is printed.
    pass: Option<(u32, Option<u32>)>,
    last: Option<Last>,
    found: CurveRatio,
}

impl<'a> Walk<'a> {
    fn new(settings: &'a Settings) -> Self {
        let asked = settings.wide_beads.outer_inner_ratio_max;
        Walk {
            settings,
            bound: if asked > 0.0 { asked } else { f64::INFINITY },
            pass: None,
            last: None,
            found: CurveRatio::STRAIGHT,
        }
    }

    /// Sets the present pass; the first state of a pass is compared with nothing.
    fn is_printing(&mut self, pass: Option<(u32, Option<u32>)>) {
        if pass != self.pass {
            self.last = None;
            self.pass = pass;
        }
    }

    fn visit(&mut self, visit: &Visit) {
        let aperture = &self.settings.aperture;
        let speed_mm_s = visit.velocity_mm_s.norm();
        if speed_mm_s < SPEED_MIN_SHARE_S * aperture.minor_mm() {
            return;
        }
        let direction = visit.velocity_mm_s / speed_mm_s;
        let now = Last {
            at_mm: visit.at_mm,
            direction,
        };
        let Some(last) = self.last else {
            self.last = Some(now);
            return;
        };
        let way_mm = (0..2)
            .map(|axis| (now.at_mm[axis] - last.at_mm[axis]).powi(2))
            .sum::<f64>()
            .sqrt();
        let across = Vector2::new(-direction.y, direction.x);
        let width_mm = 2.0 * aperture.extent_mm(visit.heading_rad, across);
        if way_mm < STEP_SHARE * width_mm {
            return;
        }
        let turn_rad = last
            .direction
            .perp(&direction)
            .atan2(last.direction.dot(&direction));
        let half = 0.5 * width_mm * turn_rad.abs() / way_mm;
        let ratio = match half < 1.0 {
            true => ((1.0 + half) / (1.0 - half)).min(RATIO_MAX),
            false => RATIO_MAX,
        };
        if ratio > self.found.ratio_max {
            self.found.ratio_max = ratio;
            self.found.at_mm = visit.at_mm;
            self.found.layer = self.pass.map_or(0, |(layer, _)| layer);
        }
        if ratio > self.bound {
            self.found.over_mm += way_mm;
        }
        self.last = Some(now);
    }
}

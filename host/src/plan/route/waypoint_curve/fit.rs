//! The intended curve -> a uniform B-spline that agrees with it.
//!
//! In: poses by the chord length (mm, rad), tolerances. Out: control points of even spans, halved until the spline
//! is within the tolerances. Spans are even also where a corner is rounded in a short window: the first time law
//! would treat a varying parameter speed as bends of the path (30 % more time on a zigzag).

use super::chord_spline::through_samples;
use super::{Curve, Point};
use crate::plan::route::moves::PathCurve;
use crate::settings::Settings;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_X, CHANNEL_Z,
};

/// Share of the tip's, axis' and heading's tolerance that the B-spline may be off the spline.
pub const CURVE_SHARE: f64 = 0.1;
/// Longest span of the B-spline to begin with, mm: a fraction of any aperture.
const SPAN_MM: f64 = 0.5;
impl Curve<'_> {
    /// Even samples over the length, ends included.
    fn samples(&self, spans: usize, near_rad: f64) -> Vec<Point> {
        let mut near_rad = near_rad;
        (0..=spans)
            .map(|k| {
                let pose = self.pose(self.spline.length() * k as f64 / spans as f64, near_rad);
                near_rad = pose[CHANNEL_HEADING];
                pose
            })
            .collect()
    }

    /// The B-spline in even spans, as many as necessary; `None` if these are too many.
    pub fn fit(&self, points: usize, near_rad: f64, spans_max: usize) -> Option<PathCurve> {
        let mut spans = (self.spline.length() / SPAN_MM)
            .ceil()
            .max(2.0 * points as f64);
        while spans <= spans_max as f64 {
            let control = through_samples(&self.samples(spans as usize, near_rad));
            let fitted = PathCurve { control };
            if self.agrees(&fitted) {
                return Some(fitted);
            }
            spans *= 2.0;
        }
        None
    }

    /// True if the B-spline is as near as it must be: in the middle of its spans, and where the
    /// spline's own pieces meet.
    fn agrees(&self, fitted: &PathCurve) -> bool {
        let spans = fitted.span_count();
        let per_mm = spans as f64 / self.spline.length();
        let middles = (0..spans).map(|span| span as f64 + 0.5);
        let knots = self.spline.knots().iter().map(|s| s * per_mm);
        middles.chain(knots).all(|u| {
            let at = fitted.evaluate(u).value;
            let meant = self.pose(u / per_mm, at[CHANNEL_HEADING]);
            is_near(&at, &meant, self.settings)
        })
    }
}

fn is_near(at: &Point, meant: &Point, settings: &Settings) -> bool {
    let off = |from: usize, to: usize| {
        (from..=to)
            .map(|channel| (at[channel] - meant[channel]).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    let tolerances = &settings.tolerances;
    off(CHANNEL_X, CHANNEL_Z) <= CURVE_SHARE * tolerances.tip_mm
        && off(CHANNEL_TILT_X, CHANNEL_TILT_Y) <= CURVE_SHARE * tolerances.axis_rad
        && off(CHANNEL_HEADING, CHANNEL_HEADING) <= CURVE_SHARE * tolerances.heading_rad
}

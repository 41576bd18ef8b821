//! Waypoint curves -> the route: approach, prime, print, retract, leave; and the flow along them.
//!
//! The head lifts, crosses and turns above everything, lowers straight down, and leaves straight
//! up. The deposited volume follows the front of the aperture as in planar printing, in the plane
//! that the tool sees: each step of the tip is turned by the tool axis until the axis points up.

use crate::job::MotionState;
use crate::plan::route::build_route::{event_duration_s, nearest_heading};
use crate::plan::route::flow::fresh_ground::FreshShares;
use crate::plan::route::flow::{Bead, FlowPose};
use crate::plan::route::moves::{PathCurve, Route, Stretch, StretchEvent};
use crate::plan::route::waypoint_curve::upright;
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Z, CHANNELS};
use nalgebra::Vector3;

/// Poses in each span from which the deposited volume is integrated.
const DEPOSIT_STEPS: usize = 2;

type Point = [f64; CHANNELS];

/// The route along the curves of one pass; `start` is the pose at rest before it (machine
/// coordinates). Headings of the curves may be shifted by the aperture's period.
pub fn waypoint_route(mut curves: Vec<PathCurve>, start: Point, settings: &Settings) -> Route {
    let Some(&first) = curves.first().and_then(|curve| curve.control.first()) else {
        return Route::default();
    };
    let heading = nearest_heading(
        first[CHANNEL_HEADING],
        start[CHANNEL_HEADING],
        settings.aperture.period_rad(),
    );
    let turn = heading - first[CHANNEL_HEADING];
    for point in curves.iter_mut().flat_map(|curve| &mut curve.control) {
        point[CHANNEL_HEADING] += turn;
    }
    add_flow(&mut curves, start[CHANNEL_VOLUME], settings);
    let top = |points: &[Point]| {
        points
            .iter()
            .map(|p| p[CHANNEL_Z])
            .fold(start[CHANNEL_Z], f64::max)
    };
    let above = curves
        .iter()
        .map(|c| top(&c.control))
        .fold(start[CHANNEL_Z], f64::max)
        + settings.lift_mm;
    let mut route = Route::default();
    approach(&mut route, start, curves[0].control[0], above);
    print(&mut route, curves, settings);
    if let Some(end) = route
        .stretches
        .last()
        .and_then(|s| s.curve.control.last().copied())
    {
        let mut up = end;
        up[CHANNEL_Z] = above;
        line(&mut route, end, up);
    }
    route
}

fn stretch(state: MotionState, control: Vec<Point>) -> Stretch {
    Stretch {
        state,
        layer: 0,
        pass: None,
        curve: PathCurve { control },
        dwell_s: 0.0,
        event: None,
    }
}

/// A straight travel; nothing where it would not move.
fn line(route: &mut Route, from: Point, to: Point) {
    if from != to {
        route
            .stretches
            .push(stretch(MotionState::Travel, vec![from, to]));
    }
}

/// Up, across while turning, down.
fn approach(route: &mut Route, start: Point, first: Point, above: f64) {
    let (mut lifted, mut over) = (start, first);
    lifted[CHANNEL_Z] = above;
    over[CHANNEL_Z] = above;
    line(route, start, lifted);
    line(route, lifted, over);
    line(route, over, first);
}

/// Prime, all curves as one pass, retract.
fn print(route: &mut Route, curves: Vec<PathCurve>, settings: &Settings) {
    let pr = settings.prime_retract;
    let prime_s = event_duration_s(pr.prime_mm3, pr.prime_rate_mm3_s);
    let retract_s = event_duration_s(pr.retract_mm3, pr.retract_rate_mm3_s);
    if prime_s > 0.0 {
        route.stretches.push(Stretch {
            dwell_s: (prime_s - pr.prime_lead_s).max(0.0),
            event: Some(StretchEvent::PrimeAtStart {
                volume_mm3: pr.prime_mm3,
                duration_s: prime_s,
            }),
            ..stretch(MotionState::Prime, vec![curves[0].control[0]])
        });
    }
    let count = curves.len();
    let lead_s = pr.retract_lead_s.min(retract_s);
    for (number, curve) in curves.into_iter().enumerate() {
        let retract = StretchEvent::RetractBeforeEnd {
            volume_mm3: pr.retract_mm3,
            duration_s: retract_s,
            lead_s,
        };
        let is_last = number + 1 == count;
        route.stretches.push(Stretch {
            pass: Some(0),
            event: (is_last && retract_s > 0.0).then_some(retract),
            ..stretch(MotionState::Print, curve.control)
        });
    }
    let end = route
        .stretches
        .last()
        .and_then(|s| s.curve.control.last().copied());
    if let Some(end) = end
        && retract_s > lead_s
    {
        route.stretches.push(Stretch {
            dwell_s: retract_s - lead_s,
            ..stretch(MotionState::Retract, vec![end])
        });
    }
}

/// Fills in the volume channel of all curves, one after the other.
fn add_flow(curves: &mut [PathCurve], start_mm3: f64, settings: &Settings) {
    let mut poses = Vec::new();
    let mut at = [0.0; 2];
    let mut before: Option<Point> = None;
    for curve in curves.iter() {
        let spans = curve.span_count();
        let skipped = usize::from(before.is_some());
        for k in skipped..=spans * DEPOSIT_STEPS {
            let pose = curve.evaluate(k as f64 / DEPOSIT_STEPS as f64).value;
            if let Some(before) = before {
                at = developed(at, &before, &pose);
            }
            before = Some(pose);
            poses.push(FlowPose {
                centre_mm: at,
                heading_rad: pose[CHANNEL_HEADING],
            });
        }
    }
    let volume = Bead::of(settings).deposit(&poses, &FreshShares::all(poses.len()));
    let mut next = 0;
    for curve in curves.iter_mut() {
        for (i, point) in curve.control.iter_mut().enumerate() {
            let k = next + i * DEPOSIT_STEPS;
            point[CHANNEL_VOLUME] = start_mm3 + volume.get(k).copied().unwrap_or(0.0);
        }
        next += curve.control.len().saturating_sub(1) * DEPOSIT_STEPS;
    }
}

/// Where a step leads in the plane that the tool sees.
fn developed(at: [f64; 2], from: &Point, to: &Point) -> [f64; 2] {
    let middle: Point = std::array::from_fn(|c| 0.5 * (from[c] + to[c]));
    let step = upright(&middle) * Vector3::from_fn(|i, _| to[CHANNEL_X + i] - from[CHANNEL_X + i]);
    [at[0] + step.x, at[1] + step.y]
}

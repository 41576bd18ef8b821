//! Waypoint curves -> the route: approach, prime, print, retract, leave; and the flow along them.
//!
//! The head lifts, crosses and turns above everything, lowers straight down, and leaves straight up. Between two
//! passes it retreats along its axis, crosses while the axis turns, and descends along the new axis: close to the
//! print if the head's shape is clear of it ([`crate::plan::route::clear_travel`]), otherwise around a ball that
//! contains the complete job. On machines whose joints follow the complete pose (turning tables, arms) it also begins
//! and leaves along the axis. The deposited volume follows the front of the aperture as in planar printing, in the
//! tool's plane: each step of the tip is rotated so that the tool axis points up.

use crate::geometry::Point2;
use crate::geometry::clearance::Configuration;
use crate::input::waypoints::PassAsked;
use crate::job::MotionState;
use crate::plan::headings::stops::{entry_heading, nearest_heading};
use crate::plan::route::build_route::event_duration_s;
use crate::plan::route::clear_travel::{Legs, PrintedSoFar, UPRIGHT_RAD, crossing, moved_to};
use crate::plan::route::flow::Bead;
use crate::plan::route::flow::fresh_ground::FreshShares;
use crate::plan::route::gcode_route::PUSH_SHARE;
use crate::plan::route::moves::{MoveEvent, PathCurve, Route, RouteMove, tilt, tip, way_mm};
use crate::plan::route::waypoint_curve::upright;
use crate::plan::route::wide_beads::pump::stopped_early;
use crate::settings::{PrimeRetract, Settings};
use headway_firmware::configuration::Kinematics;
use headway_firmware::kinematics::follows_pose;
use headway_firmware::kinematics::pose::tool_axis;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Z, CHANNELS};
use nalgebra::Vector3;

/// Poses in each span from which the deposited volume is integrated.
const DEPOSIT_STEPS: usize = 2;
/// The same where its section is known: chords of a span that bends by 10° are 0.1 % short.
const SECTION_STEPS: usize = 4;

/// The table is empty before.
const NO_TOP: f64 = f64::NEG_INFINITY;

/// What becomes of the curves' volume channel.
#[derive(Clone, Copy)]
enum Volumes {
    /// The flow is found.
    Laid,
    /// It is the flow.
    Known,
    /// Nothing flows.
    None,
}

type Point = [f64; CHANNELS];

/// The route along the curves of all passes; `start` is the pose at rest before it (machine
/// coordinates), `asked` the requests of its passes, in order. Headings of the curves may be shifted by
/// the aperture's period, unless they are to be kept.
pub fn waypoint_route(
    passes: Vec<Vec<PathCurve>>,
    asked: &[PassAsked],
    start: Point,
    settings: &Settings,
) -> Route {
    along(
        passes,
        asked,
        start,
        settings,
        NO_TOP,
        Volumes::Laid,
        &mut |route, curves, pass| {
            let asked = asked.get(pass as usize).copied().unwrap_or_default();
            let length_mm = curves.iter().map(|curve| way_mm(&curve.control)).sum();
            let usual = settings.starts_and_ends(volume_of(&curves), length_mm);
            let stop_mm = settings.wide_beads.pump_stop_mm;
            print(
                route,
                curves,
                pass,
                pushes(&asked, usual, settings),
                stop_mm,
            );
        },
    )
}

/// The route along pieces of moves that already have flow and events: adds the moves to the first and from the last of them,
/// above `top_mm` if the head comes from above, and the travel from piece to piece, clear of what is printed. `curves` replace
/// those of all moves with motion, in order. What is added belongs to the layer before it, so that layers only rise.
pub fn complete_route(
    pieces: &[&[RouteMove]],
    curves: Vec<Vec<PathCurve>>,
    top_mm: f64,
    start: Point,
    settings: &Settings,
) -> Route {
    let mut route = along(
        curves,
        &[],
        start,
        settings,
        top_mm,
        Volumes::Known,
        &mut |route, curves, piece| {
            let moves = pieces[piece as usize];
            let mut curves = curves.into_iter().peekable();
            let mut here = curves
                .peek()
                .and_then(|curve| curve.control.first().copied());
            for route_move in moves {
                let curve = match (has_motion(route_move), here) {
                    (true, _) => curves.next(),
                    (false, here) => here.map(|here| PathCurve {
                        control: vec![here],
                    }),
                };
                let Some(curve) = curve else { break };
                here = curve.control.last().copied();
                route.moves.push(RouteMove {
                    curve,
                    ..route_move.clone()
                });
            }
        },
    );
    let mut layer = 0;
    for own in &mut route.moves {
        layer = own.layer.max(layer);
        own.layer = layer;
    }
    route
}

/// True where a move is no dwell.
pub fn has_motion(route_move: &RouteMove) -> bool {
    route_move.curve.control.len() > 1
}

/// The same path without flow: to check whether the joints can follow.
pub fn waypoint_way(passes: Vec<Vec<PathCurve>>, start: Point, settings: &Settings) -> Route {
    along(
        passes,
        &[],
        start,
        settings,
        NO_TOP,
        Volumes::None,
        &mut |route, curves, pass| {
            print(route, curves, pass, settings.prime_retract, 0.0);
        },
    )
}

fn along(
    mut passes: Vec<Vec<PathCurve>>,
    asked: &[PassAsked],
    start: Point,
    settings: &Settings,
    top_mm: f64,
    volumes: Volumes,
    lay: &mut dyn FnMut(&mut Route, Vec<PathCurve>, u32),
) -> Route {
    let period_rad = settings.aperture.period_rad();
    let mut clear = Clearance::around(&passes, settings.lift_mm);
    clear.top_mm = clear.top_mm.max(top_mm + settings.lift_mm);
    let first = passes
        .iter()
        .flatten()
        .find_map(|curve| curve.control.first());
    let Some(&first) = first else {
        return Route::default();
    };
    // Where every joint follows the pose the job begins on the first pass's axis: which joints an upright
    // tool would have is not determined on a table or a head that turns, and a leaning nozzle is never upright.
    let kinematics = &settings.machine.kinematics;
    let starts_leaning =
        matches!(kinematics, Kinematics::Axes { axes, .. } if !axes.is_determined_upright());
    let from_above = !follows_pose(kinematics) && !starts_leaning;
    let mut here = start;
    if !from_above {
        here = clear.off(&first);
        here[CHANNEL_HEADING] = nearest_heading(first[CHANNEL_HEADING], 0.0, period_rad);
        here[CHANNEL_VOLUME] = start[CHANNEL_VOLUME];
    }
    let mut route = Route::default();
    let mut printed = PrintedSoFar::nothing(settings);
    for (number, curves) in passes.iter_mut().enumerate() {
        if curves.iter().all(|curve| curve.control.is_empty()) {
            continue;
        }
        if !asked.get(number).is_some_and(|asked| asked.keeps_heading) {
            let turn = entry_turn(curves, here[CHANNEL_HEADING], settings);
            change(curves, |point| point[CHANNEL_HEADING] += turn);
        }
        match volumes {
            Volumes::Laid if asked.get(number).is_some_and(|asked| asked.has_sections) => {
                add_sections(curves, here[CHANNEL_VOLUME], settings.flow_factor);
            }
            Volumes::Laid => add_flow(curves, here[CHANNEL_VOLUME], settings),
            Volumes::Known => {}
            Volumes::None => change(curves, |point| point[CHANNEL_VOLUME] = 0.0),
        }
        let begin = curves[0].control[0];
        match (number, from_above) {
            (0, true) => approach(&mut route, start, begin, clear.above(&start)),
            (0, false) => line(&mut route, here, begin),
            _ => clear.travel(&mut route, [here, begin], printed.as_mut()),
        }
        let before = route.moves.len();
        lay(&mut route, std::mem::take(curves), number as u32);
        if let Some(printed) = &mut printed {
            let laid = route.moves[before..].iter();
            let laid = laid.filter(|route_move| route_move.state == MotionState::Print);
            laid.for_each(|route_move| printed.add(&route_move.curve));
        }
        if let Some(end) = end_of(&route) {
            here = end;
        }
    }
    leave(
        &mut route,
        here,
        &clear,
        from_above.then(|| clear.above(&start)),
    );
    route
}

/// By how much a pass is turned so that it begins near a heading and stays between the nozzle's stops, rad.
fn entry_turn(curves: &[PathCurve], from_rad: f64, settings: &Settings) -> f64 {
    let points = curves.iter().flat_map(|curve| &curve.control);
    let mut headings = points.map(|point| point[CHANNEL_HEADING]);
    let entered = entry_heading(headings.clone(), from_rad, settings);
    headings.next().map_or(0.0, |first| entered - first)
}

/// Away from the last pass: along the tool axis, and up to a height where there is one.
fn leave(route: &mut Route, mut here: Point, clear: &Clearance, above_mm: Option<f64>) {
    // A tilted head that moves straight up sweeps over adjacent print.
    if above_mm.is_none() || tilt(&here).norm() > UPRIGHT_RAD {
        let off = clear.off(&here);
        line(route, here, off);
        here = off;
    }
    if let Some(above_mm) = above_mm {
        let mut up = here;
        up[CHANNEL_Z] = up[CHANNEL_Z].max(above_mm);
        line(route, here, up);
    }
}

/// Volume of the curves of a pass.
fn volume_of(curves: &[PathCurve]) -> f64 {
    let ends = [
        curves.first().and_then(|curve| curve.control.first()),
        curves.last().and_then(|curve| curve.control.last()),
    ];
    let [begin, end] = ends.map(|point| point.map_or(0.0, |point| point[CHANNEL_VOLUME]));
    end - begin
}

/// Changes every control point of curves.
fn change(curves: &mut [PathCurve], how: impl Fn(&mut Point)) {
    curves
        .iter_mut()
        .flat_map(|curve| &mut curve.control)
        .for_each(how);
}

fn end_of(route: &Route) -> Option<Point> {
    let last = route.moves.last()?;
    last.curve.control.last().copied()
}

/// The ball that holds all that is printed, with room: outside of it nothing is touched.
struct Clearance {
    centre_mm: Vector3<f64>,
    radius_mm: f64,
    top_mm: f64,
    lift_mm: f64,
}

impl Clearance {
    fn around(passes: &[Vec<PathCurve>], lift_mm: f64) -> Clearance {
        let points = || passes.iter().flatten().flat_map(|curve| &curve.control);
        let (low, high) = points().fold(
            ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]),
            |(low, high), point| {
                let tip = &point[CHANNEL_X..=CHANNEL_Z];
                (
                    std::array::from_fn(|i| f64::min(low[i], tip[i])),
                    std::array::from_fn(|i| f64::max(high[i], tip[i])),
                )
            },
        );
        let centre_mm = 0.5 * (Vector3::from(low) + Vector3::from(high));
        let radius_mm = points()
            .map(|point| (tip(point) - centre_mm).norm())
            .fold(0.0, f64::max);
        Clearance {
            centre_mm,
            radius_mm: radius_mm + lift_mm,
            top_mm: high[2] + lift_mm,
            lift_mm,
        }
    }

    /// Height above everything, the start included.
    fn above(&self, start: &Point) -> f64 {
        self.top_mm.max(start[CHANNEL_Z] + self.lift_mm)
    }

    /// The pose drawn back along its tool axis until it is outside.
    fn off(&self, pose: &Point) -> Point {
        let axis = tool_axis(tilt(pose));
        let from = tip(pose) - self.centre_mm;
        let along = from.dot(&axis);
        let square = along * along - from.norm_squared() + self.radius_mm * self.radius_mm;
        let way_mm = (square.max(0.0).sqrt() - along).max(self.lift_mm);
        moved_to(pose, tip(pose) + way_mm * axis)
    }

    /// Off along the tool axis, across while the axis turns, down along the new axis: close by where that
    /// is known to be clear, otherwise around the ball.
    fn travel(&self, route: &mut Route, ends: [Point; 2], printed: Option<&mut PrintedSoFar>) {
        let [from, to] = ends;
        let around = self.around_the_ball(from, to);
        let legs = match printed {
            Some(printed) => printed.travel(&from, &to, 2.0 * self.radius_mm, around),
            None => around,
        };
        for control in legs {
            travel_along(route, control);
        }
    }

    /// Outside the ball; between upright poses above all of it.
    fn around_the_ball(&self, from: Point, to: Point) -> Legs {
        if tilt(&from).norm() < UPRIGHT_RAD && tilt(&to).norm() < UPRIGHT_RAD {
            let above = from[CHANNEL_Z].max(to[CHANNEL_Z]).max(self.top_mm);
            let [off, over] = [from, to].map(|pose| {
                let mut pose = pose;
                pose[CHANNEL_Z] = above;
                pose
            });
            return [vec![from, off], vec![off, over], vec![over, to]];
        }
        let (off, over) = (self.off(&from), self.off(&to));
        let [out, back] = [&off, &over].map(|pose| tip(pose) - self.centre_mm);
        let around = |share: f64| {
            // Opposite ends have no shortest path: straight up is clear as well.
            let direction = out.lerp(&back, share).try_normalize(1e-3);
            let reach_mm = out.norm() + share * (back.norm() - out.norm());
            self.centre_mm + reach_mm * direction.unwrap_or_else(Vector3::z)
        };
        let across = crossing(&off, &over, out.angle(&back), around);
        [vec![from, off], across, vec![over, to]]
    }
}

fn route_move(state: MotionState, control: Vec<Point>) -> RouteMove {
    RouteMove::new(state, 0, control)
}

/// A travel; nothing where it would not move.
fn travel_along(route: &mut Route, control: Vec<Point>) {
    if control.first() != control.last() {
        route.moves.push(route_move(MotionState::Travel, control));
    }
}

/// A straight one.
fn line(route: &mut Route, from: Point, to: Point) {
    travel_along(route, vec![from, to]);
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
fn print(route: &mut Route, mut curves: Vec<PathCurve>, pass: u32, pr: PrimeRetract, stop_mm: f64) {
    stopped_early(&mut curves, stop_mm);
    let prime_s = event_duration_s(pr.prime_mm3, pr.prime_rate_mm3_s);
    let retract_s = event_duration_s(pr.retract_mm3, pr.retract_rate_mm3_s);
    if prime_s > 0.0 {
        route.moves.push(RouteMove {
            dwell_s: (prime_s - pr.prime_lead_s).max(0.0),
            event: Some(MoveEvent::PrimeAtStart {
                volume_mm3: pr.prime_mm3,
                duration_s: prime_s,
            }),
            ..route_move(MotionState::Prime, vec![curves[0].control[0]])
        });
    }
    let count = curves.len();
    let lead_s = pr.retract_lead_s.min(retract_s);
    for (number, curve) in curves.into_iter().enumerate() {
        let retract = MoveEvent::RetractBeforeEnd {
            volume_mm3: pr.retract_mm3,
            duration_s: retract_s,
            lead_s,
        };
        let is_last = number + 1 == count;
        route.moves.push(RouteMove {
            pass: Some(pass),
            event: (is_last && retract_s > 0.0).then_some(retract),
            ..route_move(MotionState::Print, curve.control)
        });
    }
    if let Some(end) = end_of(route)
        && retract_s > lead_s
    {
        route.moves.push(RouteMove {
            dwell_s: retract_s - lead_s,
            ..route_move(MotionState::Retract, vec![end])
        });
    }
}

/// Fills in the volume channel of all curves, one after the other. Until then it holds the excess of the
/// bead's section over the nozzle's own.
fn add_flow(curves: &mut [PathCurve], start_mm3: f64, settings: &Settings) {
    let mut poses = Vec::new();
    let mut sections: Vec<f64> = Vec::new();
    let mut at = [0.0; 2];
    let mut before: Option<Point> = None;
    for curve in curves.iter() {
        let spans = curve.span_count();
        let skipped = usize::from(before.is_some());
        for k in skipped..=spans * DEPOSIT_STEPS {
            let pose = curve.evaluate(k as f64 / DEPOSIT_STEPS as f64).value;
            if let Some(before) = before {
                at = developed(at, &before, &pose);
                let larger = 0.5 * (before[CHANNEL_VOLUME] + pose[CHANNEL_VOLUME]);
                sections.push(1.0 + larger);
            }
            before = Some(pose);
            poses.push(Configuration {
                center: Point2::from(at),
                heading_rad: pose[CHANNEL_HEADING],
            });
        }
    }
    let fresh = FreshShares {
        steps: sections,
        ..FreshShares::all(poses.len())
    };
    let volume = Bead::of(settings).deposit(&poses, &fresh);
    let mut next = 0;
    for curve in curves.iter_mut() {
        for (i, point) in curve.control.iter_mut().enumerate() {
            let k = next + i * DEPOSIT_STEPS;
            point[CHANNEL_VOLUME] = start_mm3 + volume.get(k).copied().unwrap_or(0.0);
        }
        next += curve.control.len().saturating_sub(1) * DEPOSIT_STEPS;
    }
}

/// The prime and the retract of a pass; `usual` if it requests none.
fn pushes(asked: &PassAsked, usual: PrimeRetract, settings: &Settings) -> PrimeRetract {
    let own = asked.prime_retract.unwrap_or(usual);
    let [prime_mm3, retract_mm3] = asked.pushes_mm3;
    let most_mm3_s = settings.machine.arriving_limits()[0] * PUSH_SHARE * settings.plan_share;
    let rate_mm3_s = |asked: Option<f64>, own_mm3_s: f64| match asked {
        Some(_) if own_mm3_s <= 0.0 => most_mm3_s,
        _ => own_mm3_s,
    };
    PrimeRetract {
        prime_mm3: prime_mm3.unwrap_or(own.prime_mm3),
        prime_rate_mm3_s: rate_mm3_s(prime_mm3, own.prime_rate_mm3_s),
        retract_mm3: retract_mm3.unwrap_or(own.retract_mm3),
        retract_rate_mm3_s: rate_mm3_s(retract_mm3, own.retract_rate_mm3_s),
        ..own
    }
}

/// Fills in the volume channel of all curves from the sections that it holds, mm²: their integral over the tip's
/// path.
fn add_sections(curves: &mut [PathCurve], start_mm3: f64, flow_factor: f64) {
    let mut volume_mm3 = start_mm3;
    for curve in curves.iter_mut() {
        let mut laid = vec![volume_mm3];
        let mut before = curve.evaluate(0.0).value;
        for k in 1..=curve.span_count() * SECTION_STEPS {
            let next = curve.evaluate(k as f64 / SECTION_STEPS as f64).value;
            let section = |pose: &Point| pose[CHANNEL_VOLUME].max(0.0);
            let mean_mm2 = 0.5 * (section(&before) + section(&next));
            volume_mm3 += flow_factor * mean_mm2 * (tip(&next) - tip(&before)).norm();
            if k % SECTION_STEPS == 0 {
                laid.push(volume_mm3);
            }
            before = next;
        }
        for (point, volume_mm3) in curve.control.iter_mut().zip(laid) {
            point[CHANNEL_VOLUME] = volume_mm3;
        }
    }
}

/// Where a step leads in the plane that the tool sees.
fn developed(at: [f64; 2], from: &Point, to: &Point) -> [f64; 2] {
    let middle: Point = std::array::from_fn(|c| 0.5 * (from[c] + to[c]));
    let step = upright(&middle) * Vector3::from_fn(|i, _| to[CHANNEL_X + i] - from[CHANNEL_X + i]);
    [at[0] + step.x, at[1] + step.y]
}

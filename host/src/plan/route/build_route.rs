//! From ordered passes to the route: travel with lift, prime, print, retract.
//!
//! For every pass: travel above its start while the heading turns, lower, prime, print, retract,
//! lift. To a pass that begins right above the end of the previous one the head rises without a
//! retract. Each of these is a rest-to-rest move. All in machine coordinates.
//!
//! In: curves of the passes (mm, rad, mm³) in order, the pose at rest before them. Out: moves with
//! their curves and the volumes of prime and retract (mm³). Not covered: time, which the motion
//! stage finds.

use crate::geometry::Point2;
use crate::geometry::place_scale::ScaleField;
use crate::geometry::plane_curve::configuration;
use crate::job::MotionState;
use crate::plan::headings::stops::{entry_heading, heading_range, nearest_heading};
use crate::plan::layers::PlanePass;
use crate::plan::pass::PassKind;
use crate::plan::route::flow::QUINTIC_PEAK;
use crate::plan::route::flow::pass_volumes::volumes_mm3;
use crate::plan::route::hop::{Hop, is_right_above};
use crate::plan::route::keep_out::Way;
use crate::plan::route::moves::{MoveEvent, Route, RouteMove};
use crate::plan::route::travel::{TravelError, TravelWays};
use crate::settings::Settings;
use crate::settings::kinds::KindSettings;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS,
};

/// Step of the control points of a rounded path, relative to b: corners of at most 30° are then cut
/// by a fifth of that, less than the path's clearance from the outline.
const ROUND_STEP_SHARE: f64 = 0.5;

/// Where the head is while the route is built.
struct Head<'a> {
    settings: &'a Settings,
    at: [f64; CHANNELS],
    route: Route,
}

/// Builds the route; `start` is the pose at rest before it (machine coordinates), or `None` where it begins at rest on
/// its first pass, with no material laid; `first_number` is that of its first pass.
///
/// # Errors
/// If there is no path from one pass to the next.
pub fn build_route(
    passes: &[PlanePass],
    first_number: u32,
    start: Option<[f64; CHANNELS]>,
    ways: &mut TravelWays,
    scale: Option<&ScaleField>,
    settings: &Settings,
) -> Result<Route, TravelError> {
    let mut head = Head {
        settings,
        at: start.unwrap_or_else(|| first_pose(passes, settings)),
        route: Route::default(),
    };
    let volumes_mm3 = volumes_mm3(passes, scale, settings);
    let mut rises = false;
    for (i, (number, volume_mm3)) in (first_number..).zip(&volumes_mm3).enumerate() {
        let pass = &passes[i];
        if rises {
            head.rise(pass);
        } else {
            if i > 0 || start.is_some() {
                head.travel_to(pass, ways)?;
            }
            head.prime(pass, volume_mm3);
        }
        head.print(pass, volume_mm3, number);
        rises = passes
            .get(i + 1)
            .is_some_and(|next| follows_above(pass, next, settings));
        if !rises {
            head.retract(pass.layer);
        }
    }
    Ok(head.route)
}

/// The pose in which the first of these passes begins, of its equal headings the one nearest to 0 that the stops allow.
fn first_pose(passes: &[PlanePass], settings: &Settings) -> [f64; CHANNELS] {
    let mut pose = [0.0; CHANNELS];
    if let Some(pass) = passes.first() {
        let [x, y, _] = pass.control[0];
        pose[CHANNEL_X] = x;
        pose[CHANNEL_Y] = y;
        pose[CHANNEL_Z] = pass.z_mm;
        pose[CHANNEL_HEADING] = entry_heading(headings_rad(pass), 0.0, settings);
    }
    pose
}

/// The travel alone from one pose at rest to another, where a pass of `layer` begins. If no stops bound the heading, it
/// ends at the nearest of those equal to it for the deposit.
///
/// # Errors
/// If there is no path.
pub fn build_link(
    from: [f64; CHANNELS],
    to: [f64; CHANNELS],
    layer: u32,
    ways: &mut TravelWays,
    settings: &Settings,
) -> Result<Route, TravelError> {
    let mut head = Head {
        settings,
        at: from,
        route: Route::default(),
    };
    let is_free = heading_range(settings)
        .iter()
        .all(|stop| stop.is_infinite());
    let own_rad = to[CHANNEL_HEADING];
    let period_rad = settings.aperture.period_rad();
    let place = Place {
        layer,
        at: [to[CHANNEL_X], to[CHANNEL_Y], own_rad],
        z_mm: to[CHANNEL_Z],
        heading_rad: match is_free {
            true => nearest_heading(own_rad, from[CHANNEL_HEADING], period_rad),
            false => own_rad,
        },
    };
    head.travel(&place, ways)?;
    Ok(head.route)
}

/// Where a travel ends.
struct Place {
    layer: u32,
    /// Position and heading of the pass, mm, rad.
    at: [f64; 3],
    z_mm: f64,
    /// The heading in which it is entered: equal to that of the pass for the deposit.
    heading_rad: f64,
}

fn headings_rad(pass: &PlanePass) -> impl Iterator<Item = f64> {
    pass.control.iter().map(|control| control[2])
}

/// True where a pass begins right above the end of the one before it.
fn follows_above(pass: &PlanePass, next: &PlanePass, settings: &Settings) -> bool {
    let (Some(end), Some(begin)) = (pass.control.last(), next.control.first()) else {
        return false;
    };
    let at = |place: &[f64; 3], z_mm: f64| [place[0], place[1], z_mm];
    is_right_above(at(begin, next.z_mm), at(end, pass.z_mm), settings)
}

/// Lifts the head off at the end of a route.
pub fn lift_at_end(route: &mut Route, settings: &Settings) {
    let last = route.moves.last().map(|last| last.layer);
    let (Some(layer), Some(at)) = (last, route.end()) else {
        return;
    };
    let mut head = Head {
        settings,
        at,
        route: std::mem::take(route),
    };
    let up = at[CHANNEL_Z] + settings.lift_mm;
    head.line(MotionState::Travel, layer, &[(CHANNEL_Z, up)]);
    *route = head.route;
}

impl Head<'_> {
    /// A straight move to the given channel values; nothing where it would not move.
    fn line(&mut self, state: MotionState, layer: u32, to: &[(usize, f64)]) {
        let mut target = self.at;
        for &(channel, value) in to {
            target[channel] = value;
        }
        if target == self.at {
            return;
        }
        self.push(state, layer, None, vec![self.at, target], 0.0, None);
    }

    fn push(
        &mut self,
        state: MotionState,
        layer: u32,
        pass: Option<u32>,
        control: Vec<[f64; CHANNELS]>,
        dwell_s: f64,
        event: Option<MoveEvent>,
    ) {
        if let Some(&last) = control.last() {
            self.at = last;
        }
        self.route.moves.push(RouteMove {
            pass,
            dwell_s,
            event,
            ..RouteMove::new(state, layer, control)
        });
    }

    /// To the start of a pass, with the heading turned in the shorter direction.
    fn travel_to(&mut self, pass: &PlanePass, ways: &mut TravelWays) -> Result<(), TravelError> {
        let place = Place {
            layer: pass.layer,
            at: pass.control[0],
            z_mm: pass.z_mm,
            heading_rad: entry_heading(headings_rad(pass), self.at[CHANNEL_HEADING], self.settings),
        };
        self.travel(&place, ways)
    }

    /// Lift, cross with the heading turned, lower: as one curve if there is no obstacle.
    fn travel(&mut self, place: &Place, ways: &mut TravelWays) -> Result<(), TravelError> {
        let heading = place.heading_rad;
        let above = place.z_mm.max(self.at[CHANNEL_Z]) + self.settings.lift_mm;
        let here = configuration([
            self.at[CHANNEL_X],
            self.at[CHANNEL_Y],
            self.at[CHANNEL_HEADING],
        ]);
        let way = ways.way(here, configuration(place.at))?;
        let to = Point2::new(place.at[0], place.at[1]);
        if self.hop(place, &way, to, above, heading) {
            return Ok(());
        }
        self.line(MotionState::Travel, place.layer, &[(CHANNEL_Z, above)]);
        self.cross(place.layer, way, to, heading);
        self.line(MotionState::Travel, place.layer, &[(CHANNEL_Z, place.z_mm)]);
        Ok(())
    }

    /// The travel without a stop; false where it has to be made of straight moves.
    fn hop(&mut self, place: &Place, way: &Way, to: Point2, above: f64, heading: f64) -> bool {
        let straight = way.corners.is_empty();
        if way.out.is_some() || way.back.is_some() || !(straight || way.rounded) {
            return false;
        }
        let mut legs = vec![Point2::new(self.at[CHANNEL_X], self.at[CHANNEL_Y])];
        legs.extend(&way.corners);
        legs.push(to);
        let round_mm = ROUND_STEP_SHARE * self.settings.aperture.minor_mm();
        let hop = Hop {
            start: self.at,
            legs: &legs,
            heading_rad: heading,
            above_mm: above,
            end_mm: place.z_mm,
            step_mm: if straight { f64::INFINITY } else { round_mm },
        };
        let Some(control) = hop.control(self.settings) else {
            return false;
        };
        self.push(MotionState::Travel, place.layer, None, control, 0.0, None);
        true
    }

    /// Along the path's legs, with the heading turned in proportion on those between out and back.
    fn cross(&mut self, layer: u32, way: Way, to: Point2, heading_rad: f64) {
        let move_to = |head: &mut Self, at: Point2, heading_rad: f64| {
            let target = [
                (CHANNEL_X, at.x),
                (CHANNEL_Y, at.y),
                (CHANNEL_HEADING, heading_rad),
            ];
            head.line(MotionState::Travel, layer, &target);
        };
        let from_rad = self.at[CHANNEL_HEADING];
        if let Some(out) = way.out {
            move_to(self, out, from_rad);
        }
        let mut legs = vec![Point2::new(self.at[CHANNEL_X], self.at[CHANNEL_Y])];
        legs.extend(way.corners);
        legs.push(way.back.unwrap_or(to));
        let length_mm =
            |legs: &[Point2]| -> f64 { legs.windows(2).map(|w| (w[1] - w[0]).norm()).sum() };
        let whole_mm = length_mm(&legs);
        for end in 1..legs.len() {
            let share = if end + 1 == legs.len() {
                1.0
            } else {
                length_mm(&legs[..=end]) / whole_mm.max(1e-12)
            };
            move_to(self, legs[end], from_rad + (heading_rad - from_rad) * share);
        }
        move_to(self, to, heading_rad);
    }

    /// Up to a pass that begins right above, turned during the move. Then the head rests until the
    /// material may move: pressure advance reaches ahead by half its window.
    fn rise(&mut self, pass: &PlanePass) {
        let first = pass.control[0];
        let heading = entry_heading(headings_rad(pass), self.at[CHANNEL_HEADING], self.settings);
        let to = [
            (CHANNEL_X, first[0]),
            (CHANNEL_Y, first[1]),
            (CHANNEL_Z, pass.z_mm),
            (CHANNEL_HEADING, heading),
        ];
        self.line(MotionState::Travel, pass.layer, &to);
        let window_ms = self.settings.machine.extruder.pressure_advance_window_ms;
        let ahead_s = 0.5e-3 * window_ms;
        let here = vec![self.at];
        self.push(MotionState::Hold, pass.layer, None, here, ahead_s, None);
    }

    /// Waits until the material is at the aperture, less the lead.
    fn prime(&mut self, pass: &PlanePass, volume_mm3: &[f64]) {
        let legs = pass.control.windows(2);
        let length_mm = legs.map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]));
        let all_mm3 = volume_mm3.last().copied().unwrap_or(0.0);
        let pr = self.settings.starts_and_ends(all_mm3, length_mm.sum());
        let layer = pass.layer;
        let duration_s = event_duration_s(pr.prime_mm3, pr.prime_rate_mm3_s);
        if duration_s > 0.0 {
            let event = MoveEvent::PrimeAtStart {
                volume_mm3: pr.prime_mm3,
                duration_s,
            };
            let dwell_s = (duration_s - pr.prime_lead_s).max(0.0);
            let here = vec![self.at];
            self.push(MotionState::Prime, layer, None, here, dwell_s, Some(event));
        }
    }

    fn print(&mut self, pass: &PlanePass, volume_mm3: &[f64], number: u32) {
        let parts = asked_of(pass, self.settings);
        let control = self.print_control(pass, volume_mm3, &parts);
        let (speeds_mm_s, asked) = self.speeds(&parts);
        let number = Some(number);
        self.push(MotionState::Print, pass.layer, number, control, 0.0, None);
        if let Some(printed) = self.route.moves.last_mut() {
            let share = self.settings.plan_share;
            printed.speed_mm_s = asked.speed_mm_s.map(|speed| speed * share);
            printed.acceleration_mm_s2 = asked.acceleration_mm_s2.map(|bend| bend * share);
            printed.speeds_mm_s = speeds_mm_s;
        }
    }

    /// Speeds by control point where the parts of a pass ask for several, changing within a span; and what holds all along:
    /// the fastest of these, and the least acceleration.
    fn speeds(&self, parts: &[(usize, KindSettings)]) -> (Vec<[f64; 2]>, KindSettings) {
        let speed_mm_s =
            |asked: &KindSettings| asked.speed_mm_s.unwrap_or(self.settings.speed_mm_s);
        let (_, first) = parts[0];
        let all = parts[1..]
            .iter()
            .fold(first, |all, (_, asked)| all.with(*asked));
        if parts
            .iter()
            .all(|(_, asked)| asked.speed_mm_s == first.speed_mm_s)
        {
            return (Vec::new(), all);
        }
        let share = self.settings.plan_share;
        let ends = parts[1..].iter().map(|(from, _)| from.saturating_sub(1));
        let ends = ends.map(Some).chain([None]);
        let speeds = parts.iter().zip(ends).flat_map(|((from, asked), end)| {
            let planned_mm_s = speed_mm_s(asked) * share;
            let end = end
                .filter(|end| end > from)
                .map(|end| [end as f64, planned_mm_s]);
            [[*from as f64, planned_mm_s]].into_iter().chain(end)
        });
        let fastest_mm_s = parts
            .iter()
            .map(|(_, asked)| speed_mm_s(asked))
            .fold(0.0, f64::max);
        let all = KindSettings {
            speed_mm_s: Some(fastest_mm_s),
            ..all
        };
        (speeds.collect(), all)
    }

    /// Pulls the material back: begins before the last pass ends, and rests until it is done.
    fn retract(&mut self, layer: u32) {
        let pr = self.settings.prime_retract;
        let duration_s = event_duration_s(pr.retract_mm3, pr.retract_rate_mm3_s);
        let lead_s = pr.retract_lead_s.min(duration_s);
        if duration_s > 0.0
            && let Some(printed) = self.route.moves.last_mut()
        {
            printed.event = Some(MoveEvent::RetractBeforeEnd {
                volume_mm3: pr.retract_mm3,
                duration_s,
                lead_s,
            });
        }
        if duration_s > lead_s {
            let (here, dwell_s) = (vec![self.at], duration_s - lead_s);
            self.push(MotionState::Retract, layer, None, here, dwell_s, None);
        }
    }

    /// The pass in channel space.
    fn print_control(
        &self,
        pass: &PlanePass,
        volume_mm3: &[f64],
        parts: &[(usize, KindSettings)],
    ) -> Vec<[f64; CHANNELS]> {
        let turn = self.at[CHANNEL_HEADING] - pass.control[0][2];
        let flow_of = |part: usize| parts[part].1.flow_factor.unwrap_or(1.0);
        // What the parts before lay more than at the flow of the one that is printed.
        let (mut part, mut more_mm3) = (0, 0.0);
        let places = pass.control.iter().zip(volume_mm3).enumerate();
        places
            .map(|(index, (&[x, y, heading], volume_mm3))| {
                while parts.get(part + 1).is_some_and(|(from, _)| *from <= index) {
                    more_mm3 += (flow_of(part) - flow_of(part + 1)) * volume_mm3;
                    part += 1;
                }
                let mut point = self.at;
                point[CHANNEL_X] = x;
                point[CHANNEL_Y] = y;
                point[CHANNEL_Z] = pass.z_mm;
                point[CHANNEL_HEADING] = heading + turn;
                point[CHANNEL_VOLUME] += flow_of(part) * volume_mm3 + more_mm3;
                point
            })
            .collect()
    }
}

/// Requests of a pass in addition to the general settings, by the control points from which on they hold.
fn asked_of(pass: &PlanePass, settings: &Settings) -> Vec<(usize, KindSettings)> {
    let parts = [(0, pass.kind)]
        .into_iter()
        .chain(pass.then.iter().copied());
    parts
        .map(|(from, kind)| (from, asked_by(kind, pass.layer, settings)))
        .collect()
}

fn asked_by(kind: PassKind, layer: u32, settings: &Settings) -> KindSettings {
    let kinds = &settings.kinds;
    let own = match kind {
        PassKind::TwoPass | PassKind::OnePass => kinds.walls,
        PassKind::Infill => kinds.solid,
        PassKind::Sparse => kinds.sparse,
        PassKind::Bridge | PassKind::Roof => kinds.bridge,
        PassKind::Skirt => kinds.skirt,
    };
    match layer {
        0 => own.with(kinds.first_layer),
        _ => own,
    }
}

/// Duration of a prime or retract whose peak rate is `rate`: a quintic smooth step peaks at 1.875
/// times its mean rate.
pub fn event_duration_s(volume_mm3: f64, rate_mm3_s: f64) -> f64 {
    if volume_mm3 > 0.0 && rate_mm3_s > 0.0 {
        QUINTIC_PEAK * volume_mm3 / rate_mm3_s
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: a pass is entered at the nearest heading from which it fits between the stops. Method: a
    /// pass that turns by 300° one way, stops 450° either way, headings 180° apart.
    #[test]
    fn passes_are_entered_where_they_fit_between_the_stops() {
        let turn = |deg: f64| f64::to_radians(deg);
        let pass = PlanePass {
            kind: PassKind::TwoPass,
            then: Vec::new(),
            layer: 0,
            z_mm: 0.2,
            control: (0..=30)
                .map(|i| [f64::from(i), 0.0, turn(10.0 * f64::from(i) + 7.0)])
                .collect(),
        };
        let mut settings = Settings::default();
        let entered = |from_deg: f64, settings: &Settings| {
            let heading_rad = entry_heading(headings_rad(&pass), turn(from_deg), settings);
            (heading_rad.to_degrees() * 1e6).round() / 1e6
        };
        for (from_deg, expected_deg) in [(0.0, 7.0), (300.0, 367.0), (1000.0, 1087.0)] {
            assert_eq!(entered(from_deg, &settings), expected_deg);
        }
        settings.machine.joints[3].position_min = turn(-450.0);
        settings.machine.joints[3].position_max = turn(450.0);
        for (from_deg, expected_deg) in [
            (0.0, 7.0),
            (300.0, 7.0),
            (-400.0, -353.0),
            // -533° is nearest, and beyond the stop.
            (-480.0, -353.0),
        ] {
            assert_eq!(entered(from_deg, &settings), expected_deg);
        }
        // Nowhere: the nearest, and the check of the ranges speaks.
        settings.machine.joints[3].position_max = turn(-200.0);
        assert_eq!(entered(0.0, &settings), 7.0);
    }
}

//! Passes of G-code -> the route: the file's own travel between them, prime and retract as events.
//!
//! In: [`GcodePass`]es of some layers (mm, input coordinates), the part's offset, the pose at rest before.
//! Out: [`Route`] in machine coordinates. Travel follows the file, with corners rounded like those of
//! beads, and lifts where the file does; to the first pass the head descends from above. A pass without a
//! prime or retract in the file has none. Not covered: keep-outs and travel inside the part.

use crate::gcode::comments::Slicer;
use crate::gcode::{GcodePass, Place, Push};
use crate::job::MotionState;
use crate::plan::headings::stops::entry_heading;
use crate::plan::route::bead_curve::parts::headings_rad;
use crate::plan::route::bead_curve::{Bead, BeadCurve, BeadMove, travel_control};
use crate::plan::route::bead_headings::{WidthOff, bead_headings};
use crate::plan::route::flow::event_duration_s;
use crate::plan::route::moves::{MoveEvent, Route, RouteMove, way_mm};
use crate::plan::route::told_headings::HeadingJumps;
use crate::settings::Settings;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS,
};
use rayon::prelude::*;

/// Smallest push that is made, mm³.
const PUSH_MIN_MM3: f64 = 1e-3;
/// Time of the move to the first pass, in which the nozzle can turn to any heading, s.
const FIRST_TRAVEL_S: f64 = 1.0;
/// Share of the extruder's limits that pushes use: rounding of their durations to ticks.
pub(super) const PUSH_SHARE: f64 = 0.98;

/// Data for a route in addition to its passes.
#[derive(Clone, Copy, Debug)]
pub struct GcodeWay<'a> {
    /// Who wrote the file.
    pub slicer: Slicer,
    /// The file contains C.
    pub headings_told: bool,
    /// Machine coordinates of the file's origin, mm.
    pub offset_mm: [f64; 3],
    /// Speeds, nozzle, pushes of the machine.
    pub settings: &'a Settings,
}

/// The route of some passes, and the length whose beads are wider and narrower than the nozzle's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GcodeRoute {
    /// What the head does.
    pub route: Route,
    /// Passes in it.
    pub passes: u32,
    /// The numbers of each given pass, first and last of its parts; `None` if it is not printed.
    pub numbers: Vec<Option<[u32; 2]>>,
    /// Length of beads beyond the nozzle, wider and narrower, mm.
    pub beyond_mm: [f64; 2],
    /// Length of beads printed at another width than the file's.
    pub off: WidthOff,
    /// How headings of the file change.
    pub jumps: HeadingJumps,
}

struct Head<'a> {
    way: &'a GcodeWay<'a>,
    at: [f64; CHANNELS],
    made: GcodeRoute,
}

/// Builds the route of `passes` from the pose `start`, with some room before the nozzle's stops; `first_number` is that of
/// the first of them.
pub fn gcode_route(
    passes: &[GcodePass],
    first_number: u32,
    start: [f64; CHANNELS],
    stop_room_rad: f64,
    way: &GcodeWay,
) -> GcodeRoute {
    let curves: Vec<Option<(BeadCurve, Vec<Vec<BeadMove>>)>> = beads(passes, start, way)
        .par_iter()
        .map(|bead| {
            let mut curve = bead.as_ref()?.curve(way.settings);
            let parts = curve.parts(stop_room_rad, way.settings);
            curve.jumps.turned_back = parts.len() - 1;
            Some((curve, parts))
        })
        .collect();
    let mut head = Head {
        way,
        at: start,
        made: GcodeRoute::default(),
    };
    for (pass, curve) in passes.iter().zip(&curves) {
        let Some((curve, parts)) = curve else {
            head.made.numbers.push(None);
            continue;
        };
        let first = first_number + head.made.passes;
        let last = first + parts.len() as u32 - 1;
        head.made.numbers.push(Some([first, last]));
        for (number, part) in (first..).zip(parts) {
            if number == first {
                head.travel(pass, part, number == 0);
            } else {
                head.turn_back(pass.layer, part);
            }
            let own = Some(Push::default());
            let prime = if number == first { pass.prime } else { own };
            let retract = if number == last { pass.retract } else { own };
            head.print(pass.layer, part, number, [prime, retract]);
        }
        head.made.passes += parts.len() as u32;
        head.made.off.add(&curve.off);
        head.made.jumps.add(&curve.jumps);
        for (sum, mm) in head.made.beyond_mm.iter_mut().zip(curve.beyond_mm) {
            *sum += mm;
        }
    }
    head.made
}

/// The beads of passes with their headings; those are chosen together, since travel turns the nozzle as well.
fn beads(passes: &[GcodePass], start: [f64; CHANNELS], way: &GcodeWay) -> Vec<Option<Bead>> {
    let settings = way.settings;
    let mut from = None;
    let mut lines = Vec::new();
    let mut made: Vec<Option<Bead>> = Vec::with_capacity(passes.len());
    for pass in passes {
        let bead = Bead::of(pass, way.slicer, way.headings_told, settings);
        let arrival_s = travel_s(from, pass, settings);
        lines.extend(bead.as_ref().and_then(|bead| bead.lines(arrival_s)));
        made.push(bead);
        from = pass.points.last().copied();
    }
    if lines.is_empty() {
        return made;
    }
    let mut tracks = bead_headings(&lines, start[CHANNEL_HEADING], settings).into_iter();
    let chosen = made.into_iter().map(|bead| {
        let bead = bead?;
        match tracks.next() {
            Some(track) => Some(bead.with_headings(track)),
            None => Some(bead),
        }
    });
    chosen.collect()
}

/// Approximate time of the travel to a pass; the first one may start anywhere.
fn travel_s(from: Option<Place>, pass: &GcodePass, settings: &Settings) -> f64 {
    let Some(from) = from else {
        return FIRST_TRAVEL_S;
    };
    let mut at = from;
    let mut way_mm = 0.0;
    for place in pass.travel.iter().chain(pass.points.first()) {
        way_mm += place.distance_mm(&at);
        at = *place;
    }
    way_mm / settings.travel_speed_mm_s
        + settings.travel_speed_mm_s / settings.tip_acceleration_mm_s2
}

impl Head<'_> {
    fn route_move(
        &mut self,
        state: MotionState,
        layer: u32,
        control: Vec<[f64; CHANNELS]>,
    ) -> &mut RouteMove {
        if let Some(&last) = control.last() {
            self.at = last;
        }
        let moves = &mut self.made.route.moves;
        moves.push(RouteMove::new(state, layer, control));
        let last = moves.len() - 1;
        &mut moves[last]
    }

    fn line(&mut self, layer: u32, to: [f64; CHANNELS]) {
        if to != self.at {
            let control = vec![self.at, to];
            self.route_move(MotionState::Travel, layer, control);
        }
    }

    fn on_machine(&self, tip_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| tip_mm[i] + self.way.offset_mm[i])
    }

    /// To the pass's start: from above at first, otherwise the file's path.
    fn travel(&mut self, pass: &GcodePass, moves: &[BeadMove], is_first: bool) {
        let settings = self.way.settings;
        let heading_rad = entry_heading(headings_rad(moves), self.at[CHANNEL_HEADING], settings);
        let begin = self.on_machine(pass.points[0].tip_mm);
        let mut to = self.at;
        to[CHANNEL_X..=CHANNEL_Z].copy_from_slice(&begin);
        to[CHANNEL_HEADING] = heading_rad;
        if is_first {
            let above = self.at[CHANNEL_Z].max(begin[2]) + settings.lift_mm;
            let (mut up, mut over) = (self.at, to);
            up[CHANNEL_Z] = above;
            over[CHANNEL_Z] = above;
            for place in [up, over, to] {
                self.line(pass.layer, place);
            }
            return;
        }
        let from = self.at;
        let mut tips = vec![[from[CHANNEL_X], from[CHANNEL_Y], from[CHANNEL_Z]]];
        tips.extend(
            pass.travel
                .iter()
                .map(|place| self.on_machine(place.tip_mm)),
        );
        tips.push(begin);
        let way = travel_control(&tips, self.way.settings.aperture.unit_mm());
        if way.len() < 2 {
            self.line(pass.layer, to);
            return;
        }
        let turn_rad = heading_rad - from[CHANNEL_HEADING];
        let mut control: Vec<[f64; CHANNELS]> = way
            .into_iter()
            .map(|(tip_mm, share)| {
                let mut point = from;
                point[CHANNEL_X..=CHANNEL_Z].copy_from_slice(&tip_mm);
                point[CHANNEL_HEADING] += share * turn_rad;
                point
            })
            .collect();
        // To the last digit: the pass begins there.
        if let [first, .., last] = control.as_mut_slice() {
            *first = from;
            *last = to;
        }
        self.route_move(MotionState::Travel, pass.layer, control);
    }

    /// Up, to the heading of the pass's next part, and down again.
    fn turn_back(&mut self, layer: u32, moves: &[BeadMove]) {
        let settings = self.way.settings;
        let mut to = self.at;
        to[CHANNEL_HEADING] = entry_heading(headings_rad(moves), to[CHANNEL_HEADING], settings);
        let above_mm = to[CHANNEL_Z] + settings.lift_mm;
        let (mut up, mut over) = (self.at, to);
        up[CHANNEL_Z] = above_mm;
        over[CHANNEL_Z] = above_mm;
        for place in [up, over, to] {
            self.line(layer, place);
        }
    }

    /// Volume, duration of a push; `None` if there is none.
    fn push(&self, push: Option<Push>, [own_mm3, own_rate_mm3_s]: [f64; 2]) -> Option<(f64, f64)> {
        let push = push?;
        let settings = self.way.settings;
        let volume_mm3 = push.mm3.unwrap_or(own_mm3);
        let [speed_max_mm3_s, acceleration_max_mm3_s2] = settings.machine.arriving_limits();
        let share = PUSH_SHARE * settings.plan_share;
        let most_mm3_s = speed_max_mm3_s * share;
        let asked_mm3_s = match push.rate_mm3_s {
            Some(rate_mm3_s) if rate_mm3_s > 0.0 => rate_mm3_s,
            _ if own_rate_mm3_s > 0.0 => own_rate_mm3_s,
            _ => most_mm3_s,
        };
        let acceleration = acceleration_max_mm3_s2 * share;
        let duration_s = event_duration_s(volume_mm3, asked_mm3_s.min(most_mm3_s), acceleration);
        (volume_mm3 > PUSH_MIN_MM3).then_some((volume_mm3, duration_s))
    }

    /// Prime, print, retract.
    fn print(
        &mut self,
        layer: u32,
        moves: &[BeadMove],
        number: u32,
        [prime, retract]: [Option<Push>; 2],
    ) {
        let first = moves.first().and_then(|of_move| of_move.control.first());
        let first = first.copied().unwrap_or(self.at);
        let of_machine = match self.way.slicer {
            Slicer::Drawing => {
                let last = moves.last().and_then(|of_move| of_move.control.last());
                let volume_mm3 =
                    last.map_or(0.0, |last| last[CHANNEL_VOLUME] - first[CHANNEL_VOLUME]);
                let lengths = moves.iter().map(|of_move| way_mm(&of_move.control));
                self.way.settings.starts_and_ends(volume_mm3, lengths.sum())
            }
            _ => self.way.settings.prime_retract,
        };
        let own = [of_machine.prime_mm3, of_machine.prime_rate_mm3_s];
        let prime = self.push(prime, own);
        let own = [of_machine.retract_mm3, of_machine.retract_rate_mm3_s];
        let retract = self.push(retract, own);
        if let Some((volume_mm3, duration_s)) = prime {
            let route_move = self.route_move(MotionState::Prime, layer, vec![self.at]);
            route_move.dwell_s = (duration_s - of_machine.prime_lead_s).max(0.0);
            route_move.event = Some(MoveEvent::PrimeAtStart {
                volume_mm3,
                duration_s,
            });
        }
        let turn_rad = self.at[CHANNEL_HEADING] - first[CHANNEL_HEADING];
        let start = self.at;
        for (k, of_move) in moves.iter().enumerate() {
            let control = of_move.control.iter().map(|of_file| {
                let mut point = start;
                for (i, channel) in (CHANNEL_X..=CHANNEL_Z).enumerate() {
                    point[channel] = of_file[channel] + self.way.offset_mm[i];
                }
                point[CHANNEL_HEADING] = of_file[CHANNEL_HEADING] + turn_rad;
                point[CHANNEL_VOLUME] += of_file[CHANNEL_VOLUME] - first[CHANNEL_VOLUME];
                point
            });
            let control = control.collect();
            let route_move = self.route_move(MotionState::Print, layer, control);
            route_move.pass = Some(number);
            route_move.speed_mm_s = Some(of_move.speed_mm_s);
            route_move.speeds_mm_s.clone_from(&of_move.speeds_mm_s);
            if let Some((volume_mm3, duration_s)) = retract
                && k + 1 == moves.len()
            {
                let lead_s = of_machine.retract_lead_s.min(duration_s);
                route_move.event = Some(MoveEvent::RetractBeforeEnd {
                    volume_mm3,
                    duration_s,
                    lead_s,
                });
            }
        }
        if let Some((_, duration_s)) = retract {
            let dwell_s = duration_s - of_machine.retract_lead_s.min(duration_s);
            if dwell_s > 0.0 {
                self.route_move(MotionState::Retract, layer, vec![self.at])
                    .dwell_s = dwell_s;
            }
        }
    }
}

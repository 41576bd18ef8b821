//! Layers that follow each other without a rest and rise continuously: a wall of single beads as one move.
//!
//! In: a route (mm, rad, mm³) in which layers are printed one after the other. Out: the route with layers of a single
//! loop joined: the moves between them (retract, lift, travel, prime) are removed, the tip rises evenly along each
//! loop while it goes over from the section below to the loop's own, and the flow is proportional to the bead's thickness.
//! A vase chain begins on a flat surface: its first loop rises from a quarter of the layer's height, so that no bead is
//! thicker than a layer or thinner than a quarter of one. A loop continues where the one below ends: it is reversed if it
//! has the other direction, and begins at its nearest point. Not covered: layers with several passes or an open one, which
//! rest as before; and the last loop's end, which is a step of one layer.

use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::job::MotionState;
use crate::plan::headings::stops::nearest_heading;
use crate::plan::route::moves::{LayerPart, PathCurve, Route, RouteMove, tip, way_mm};
use crate::plan::route::wide_beads::seam::evened;
use crate::settings::Settings;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNEL_Z, CHANNELS,
};
use std::collections::BTreeMap;

type Point = [f64; CHANNELS];

/// Largest distance of a loop's ends, and of the end of one from the start of the next, of the nozzle's length.
const NEAR_SHARE: f64 = 1.0;
/// A loop continues at least this share of a step ahead of the one below.
const AHEAD_SHARE: f64 = 0.7;
/// Thickness of a chain's very beginning, of the layer's.
const BEGIN_SHARE: f64 = 0.25;

/// The route with loops joined; `None` if none are joined.
pub fn joined(route: &Route, settings: &Settings) -> Option<Route> {
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    for printed in prints(route) {
        *counts.entry(route.moves[printed].layer).or_default() += 1;
    }
    let near_mm = NEAR_SHARE * 2.0 * settings.aperture.major_mm();
    let single = |index: usize| {
        let route_move = &route.moves[index];
        counts.get(&route_move.layer) == Some(&1) && is_loop(&route_move.curve.control, near_mm)
    };
    let mut chains: Vec<Vec<Loop>> = Vec::new();
    for index in prints(route) {
        let own = &route.moves[index].curve.control;
        let last = chains.last_mut().and_then(|chain| {
            let before = &chain[chain.len() - 1];
            let are_single = single(before.index) && single(index);
            let control = are_single.then(|| {
                let own = evened(own, false, near_mm, settings);
                gone_on(&before.control, &own, near_mm, settings)
            });
            Some((chain, control??))
        });
        match last {
            Some((chain, control)) => chain.push(Loop { index, control }),
            None => {
                let control = evened(own, true, near_mm, settings);
                chains.push(vec![Loop { index, control }]);
            }
        }
    }
    if chains.iter().all(|chain| chain.len() < 2) {
        return None;
    }
    let mut made = Made::default();
    let mut next = 0;
    for chain in chains.iter().filter(|chain| chain.len() > 1) {
        let (first, last) = (chain[0].index, chain[chain.len() - 1].index);
        made.go_on(&route.moves[next..first]);
        made.chain(route, chain, settings);
        next = last + 1;
    }
    made.go_on(&route.moves[next..]);
    Some(Route { moves: made.moves })
}

/// The moves so far, and the offset of heading and volume of the following ones.
#[derive(Default)]
struct Made {
    moves: Vec<RouteMove>,
    turn_rad: f64,
    volume_mm3: f64,
}

impl Made {
    fn end(&self) -> Option<Point> {
        self.moves.last()?.curve.control.last().copied()
    }

    /// Takes moves over; each begins where the one before it ends.
    fn go_on(&mut self, moves: &[RouteMove]) {
        for of in moves {
            let mut of = of.clone();
            for point in &mut of.curve.control {
                point[CHANNEL_HEADING] += self.turn_rad;
                point[CHANNEL_VOLUME] += self.volume_mm3;
            }
            let begin = of.curve.control.first_mut();
            if let Some((begin, end)) = begin.zip(self.end()) {
                *begin = end;
            }
            self.moves.push(of);
        }
    }

    /// Adds a chain: the moves to it end at its starting height, and the next ones continue from its
    /// end.
    fn chain(&mut self, route: &Route, chain: &[Loop], settings: &Settings) {
        let mut rise = chained(route, chain, settings);
        for point in &mut rise.curve.control {
            point[CHANNEL_HEADING] += self.turn_rad;
            point[CHANNEL_VOLUME] += self.volume_mm3;
        }
        let begin_mm = rise.curve.control[0][CHANNEL_Z];
        for before in self.moves.iter_mut().rev() {
            if let Some(end) = before.curve.control.last_mut() {
                end[CHANNEL_Z] = begin_mm;
            }
            if before.curve.control.len() > 1 {
                break;
            }
        }
        let was = chain[chain.len() - 1].index;
        let (was, is) = (
            route.moves[was].curve.control.last(),
            rise.curve.control.last(),
        );
        if let Some((was, is)) = was.zip(is) {
            self.turn_rad = is[CHANNEL_HEADING] - was[CHANNEL_HEADING];
            self.volume_mm3 = is[CHANNEL_VOLUME] - was[CHANNEL_VOLUME];
        }
        self.moves.push(rise);
    }
}

fn prints(route: &Route) -> impl Iterator<Item = usize> {
    let moves = route.moves.iter().enumerate();
    moves.filter_map(|(index, of)| (of.state == MotionState::Print).then_some(index))
}

/// True where a curve ends near its begin.
fn is_loop(control: &[Point], near_mm: f64) -> bool {
    let (Some(first), Some(last)) = (control.first(), control.last()) else {
        return false;
    };
    let apart_mm = (tip(first) - tip(last)).norm();
    apart_mm <= near_mm && way_mm(control) > 2.0 * near_mm
}

/// A loop of a chain.
struct Loop {
    /// Its move.
    index: usize,
    /// Its control points, from the continuation of the loop below on.
    control: Vec<Point>,
}

/// The next loop, a layer higher, from its continuation of the end of one in its direction: reversed if it has
/// the other direction, beginning at its nearest point; `None` if that is too far.
fn gone_on(
    control: &[Point],
    next: &[Point],
    near_mm: f64,
    settings: &Settings,
) -> Option<Vec<Point>> {
    let [.., before, end] = control else {
        return None;
    };
    let leaves = tip(end) - tip(before);
    let away_mm = |point: &Point| (tip(point) - tip(end)).xy().norm();
    let numbered = next.iter().map(away_mm).enumerate();
    let (nearest, apart_mm) = numbered.min_by(|a, b| a.1.total_cmp(&b.1))?;
    let rises = next[nearest][CHANNEL_Z] > end[CHANNEL_Z];
    if apart_mm > near_mm || !rises {
        return None;
    }
    let count = next.len();
    let enters = tip(&next[(nearest + 1) % count]) - tip(&next[(nearest + count - 1) % count]);
    // The first point ahead: no step back over the last bead.
    let is_behind = |at: usize, control: &[Point]| {
        (tip(&control[at]) - tip(end)).xy().dot(&leaves.xy()) < AHEAD_SHARE * leaves.norm_squared()
    };
    let ahead = |control: &[Point], at: usize| match is_behind(at, control) {
        true => (at + 1) % count,
        false => at,
    };
    match leaves.xy().dot(&enters.xy()) > 0.0 {
        true => Some(begun_at(next, ahead(next, nearest), settings)),
        false => {
            let turned = turned_round(next);
            let first = ahead(&turned, count - 1 - nearest);
            Some(begun_at(&turned, first, settings))
        }
    }
}

/// The same curve from its end to its begin.
fn turned_round(control: &[Point]) -> Vec<Point> {
    let ends = [control.first(), control.last()].map(|p| p.map_or(0.0, |p| p[CHANNEL_VOLUME]));
    let turned = control.iter().rev().map(|point| {
        let mut point = *point;
        point[CHANNEL_VOLUME] = ends[0] + (ends[1] - point[CHANNEL_VOLUME]);
        point
    });
    turned.collect()
}

/// A loop begun at another of its points, over the gap between its end and its begin, with the flow at its begin.
fn begun_at(control: &[Point], first: usize, settings: &Settings) -> Vec<Point> {
    let [start, .., end] = control else {
        return control.to_vec();
    };
    if first == 0 {
        return control.to_vec();
    }
    let turn_rad = turn_to(start, end, settings);
    let gap_mm3 = end[CHANNEL_VOLUME] - start[CHANNEL_VOLUME]
        + section_mm2(start, &control[1]) * (tip(start) - tip(end)).norm();
    let rest = control[..first].iter().map(|point| {
        let mut point = *point;
        point[CHANNEL_HEADING] += turn_rad;
        point[CHANNEL_VOLUME] += gap_mm3;
        point
    });
    control[first..].iter().copied().chain(rest).collect()
}

/// What a step lays a millimetre.
fn section_mm2(from: &Point, to: &Point) -> f64 {
    let step_mm = (tip(to) - tip(from)).norm();
    (to[CHANNEL_VOLUME] - from[CHANNEL_VOLUME]) / step_mm.max(f64::MIN_POSITIVE)
}

/// The turn, equal for the deposit to none, that brings the heading of `begin` nearest to that of `end`.
pub(super) fn turn_to(begin: &Point, end: &Point, settings: &Settings) -> f64 {
    let [own, near] = [begin, end].map(|point| point[CHANNEL_HEADING]);
    nearest_heading(own, near, settings.aperture.period_rad()) - own
}

/// One move of the loops of a chain.
fn chained(route: &Route, chain: &[Loop], settings: &Settings) -> RouteMove {
    let moves: Vec<&RouteMove> = chain.iter().map(|of| &route.moves[of.index]).collect();
    let heights = rises(&moves, settings);
    let mut control: Vec<Point> = Vec::new();
    let (mut parts, mut speeds_mm_s) = (Vec::new(), Vec::new());
    for (number, (of, [from_mm, to_mm])) in moves.iter().zip(&heights).enumerate() {
        // What the loop below is away from the level that this one's height is counted from, at its begin and end.
        let thickness = match number {
            0 => [BEGIN_SHARE, 1.0],
            1 => [1.0 - BEGIN_SHARE, 1.0],
            _ => [1.0; 2],
        };
        let first = control.len();
        let below = number
            .checked_sub(1)
            .map(|below| Below::new(&chain[below].control));
        let rise = Rise {
            heights_mm: [*from_mm, *to_mm],
            thickness,
            below,
        };
        rise.append(&mut control, &chain[number].control, settings);
        if let Some(speed_mm_s) = of.speed_mm_s {
            let ends = [first, control.len() - 1];
            speeds_mm_s.extend(ends.map(|at| [at as f64, speed_mm_s]));
        }
        parts.push(LayerPart {
            layer: of.layer,
            pass: of.pass,
            end_z_mm: *to_mm,
        });
    }
    let last = moves[moves.len() - 1];
    RouteMove {
        curve: PathCurve { control },
        speed_mm_s: None,
        speeds_mm_s,
        event: last.event,
        parts,
        ..moves[0].clone()
    }
}

/// Where the tip is at the begin and the end of each loop.
fn rises(moves: &[&RouteMove], settings: &Settings) -> Vec<[f64; 2]> {
    let top = |of: &RouteMove| of.curve.control[0][CHANNEL_Z];
    let bed_mm = settings.work_area_mm[0][2];
    let first_mm = (top(moves[1]) - top(moves[0])).min(top(moves[0]) - bed_mm);
    let mut from_mm = top(moves[0]) - (1.0 - BEGIN_SHARE) * first_mm.max(0.0);
    let ends = moves.iter().map(|of| top(of));
    ends.map(|to_mm| [std::mem::replace(&mut from_mm, to_mm), to_mm])
        .collect()
}

/// The closed loop below another one.
struct Below<'a> {
    control: &'a [Point],
    edges: EdgeIndex,
}

impl<'a> Below<'a> {
    fn new(control: &'a [Point]) -> Below<'a> {
        let at = |k: usize| tip(&control[k % control.len()]).xy().into();
        let edges: Vec<Edge> = (0..control.len())
            .map(|k| Edge {
                a: at(k),
                b: at(k + 1),
            })
            .collect();
        let cell_mm = way_mm(control) / control.len() as f64;
        Below {
            control,
            edges: EdgeIndex::new(edges, 2.0 * cell_mm),
        }
    }

    /// A point moved towards the nearest one below, and its heading with it, by a share of the way.
    fn moved(&self, point: &Point, share: f64, settings: &Settings) -> Point {
        let Some(nearest) = self.edges.nearest(tip(point).xy().into()) else {
            return *point;
        };
        let count = self.control.len();
        let [a, b] = [nearest.edge, (nearest.edge + 1) % count].map(|k| &self.control[k]);
        let edge = &self.edges.edges()[nearest.edge];
        let along = (nearest.foot - edge.a).norm() / edge.length_mm().max(f64::MIN_POSITIVE);
        let mut under = *a;
        under[CHANNEL_HEADING] +=
            along * (b[CHANNEL_HEADING] + turn_to(b, a, settings) - a[CHANNEL_HEADING]);
        let turn_rad =
            turn_to(&under, point, settings) + under[CHANNEL_HEADING] - point[CHANNEL_HEADING];
        let mut moved = *point;
        moved[CHANNEL_X] += share * (nearest.foot.x - point[CHANNEL_X]);
        moved[CHANNEL_Y] += share * (nearest.foot.y - point[CHANNEL_Y]);
        moved[CHANNEL_HEADING] += share * turn_rad;
        moved
    }
}

/// How a loop rises.
struct Rise<'a> {
    /// Heights at its begin and its end.
    heights_mm: [f64; 2],
    /// Thickness there, of the layer's.
    thickness: [f64; 2],
    below: Option<Below<'a>>,
}

impl Rise<'_> {
    /// Appends a loop that goes over from the one below to its own path and rises along it, its flow by its thickness, its
    /// heading and volume going on from the last.
    fn append(&self, control: &mut Vec<Point>, own: &[Point], settings: &Settings) {
        let begin = own[0];
        let last = control.last().copied();
        let turn_rad = turn_to(&begin, &last.unwrap_or(begin), settings);
        let gap_mm = last.map_or(0.0, |last| (tip(&begin) - tip(&last)).xy().norm());
        let length_mm = way_mm(own) + gap_mm;
        let ([from_mm, to_mm], [thin, thick]) = (self.heights_mm, self.thickness);
        let mut way_mm = 0.0;
        for (k, point) in own.iter().enumerate() {
            let before = own[k.saturating_sub(1)];
            let (step_mm, laid_mm2) = match k {
                0 => (gap_mm, section_mm2(&own[0], &own[1])),
                _ => (
                    (tip(point) - tip(&before)).norm(),
                    section_mm2(&before, point),
                ),
            };
            let thickness = thin + (thick - thin) * (way_mm + 0.5 * step_mm) / length_mm;
            way_mm += step_mm;
            let share = way_mm / length_mm;
            let mut risen = match &self.below {
                Some(below) => below.moved(point, 1.0 - share, settings),
                None => *point,
            };
            risen[CHANNEL_Z] = from_mm + (to_mm - from_mm) * share;
            risen[CHANNEL_HEADING] += turn_rad;
            let from = control.last().unwrap_or(&risen);
            let laid_mm3 = laid_mm2 * (tip(&risen) - tip(from)).norm() * thickness;
            risen[CHANNEL_VOLUME] = laid_mm3
                + control
                    .last()
                    .map_or(begin[CHANNEL_VOLUME], |last| last[CHANNEL_VOLUME]);
            control.push(risen);
        }
    }
}

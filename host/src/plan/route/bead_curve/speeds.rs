//! Speeds along a pass: where it is cut at rest, and where the speed changes within a move.
//!
//! In: legs with their speeds (mm/s) and volumes. Out: groups of stretches of similar speed, each group a move
//! from rest to rest; tip speeds by the path's parameter where a group has several. A pass of hours, such as a
//! vase, is cut at rest as well, because a move is planned as one, with memory for each of its ticks. Not covered:
//! the machine's limits on the speeds.

use super::{BeadMove, Control, Way};
use crate::settings::Settings;

/// Speeds alike to this share are one; runs shorter than this, of the aperture's unit, are no move of their own: they
/// keep their speed within their neighbour's.
const SPEED_SHARE: f64 = 0.1;
const SPEED_RUN: f64 = 2.0;
/// Where the extruder allows less than this, its bound is the leg's speed, mm/s: a crawl is a move of its own.
const CRAWL_MM_S: f64 = 1.0;
/// Path length over which the speed changes, in spans of the curve and as a share of the faster
/// one's.
const CHANGE_SPANS: f64 = 1.0;
const CHANGE_SHARE: f64 = 0.3;
/// Longest move, s: of less than the six hours that are planned in one piece. The ticks of this many seconds, at
/// more than a crawl, take 840 MB.
const MOVE_S_MAX: f64 = 18_000.0;
const TICKED_S_MAX: f64 = 6_000.0;
/// Slower moves have coarser ticks (`coarseness` of the time law).
const TICKED_MM_S: f64 = 2.0;
/// Legs of alike speed, from vertex to vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stretch {
    ends: [usize; 2],
    speed_mm_s: f64,
    length_mm: f64,
    /// Share of the time and ticks permitted for one move.
    load: f64,
}

impl Way {
    /// A leg's share of the time and ticks permitted for one move.
    fn load(&self, leg: usize, settings: &Settings) -> f64 {
        let (length_mm, of_leg) = (self.length_mm[leg], &self.legs[leg]);
        let fastest_mm_s = settings.speed_mm_s * settings.plan_share;
        let flow_mm3_s = settings.flow_max_mm3_s * settings.plan_share;
        let lays_s = of_leg.volume_mm3.unwrap_or(0.0) / flow_mm3_s;
        let seconds = (length_mm / of_leg.speed_mm_s.min(fastest_mm_s)).max(lays_s);
        let ticked_s = seconds.min(length_mm / TICKED_MM_S);
        (seconds / MOVE_S_MAX).max(ticked_s / TICKED_S_MAX)
    }

    /// The leg's speed, or the extruder's where that is a crawl.
    fn speed_mm_s(&self, leg: usize, settings: &Settings) -> f64 {
        let asked_mm_s = self.legs[leg].speed_mm_s;
        let area_mm2 = self.legs[leg].volume_mm3.unwrap_or(0.0) / self.length_mm[leg];
        let flow_mm_s = settings.flow_max_mm3_s * settings.plan_share / area_mm2.max(1e-9);
        match flow_mm_s < CRAWL_MM_S {
            true => asked_mm_s.min(flow_mm_s),
            false => asked_mm_s,
        }
    }

    /// Stretches of one speed, several together where one of them is short: those are one move.
    pub(super) fn speed_runs(&self, settings: &Settings) -> Vec<Vec<Stretch>> {
        let mut stretches: Vec<Stretch> = Vec::new();
        for (leg, length_mm) in self.length_mm.iter().enumerate() {
            let speed_mm_s = self.speed_mm_s(leg, settings);
            let load = self.load(leg, settings);
            let is_alike = |last: &Stretch| {
                let is_as_fast =
                    (last.speed_mm_s - speed_mm_s).abs() <= SPEED_SHARE * last.speed_mm_s;
                is_as_fast && last.load + load <= 1.0
            };
            match stretches.last_mut().filter(|last| is_alike(last)) {
                Some(last) => {
                    last.ends[1] = leg + 1;
                    last.speed_mm_s = last.speed_mm_s.min(speed_mm_s);
                    last.length_mm += length_mm;
                    last.load += load;
                }
                None => stretches.push(Stretch {
                    ends: [leg, leg + 1],
                    speed_mm_s,
                    length_mm: *length_mm,
                    load,
                }),
            }
        }
        let way_mm = |run: &[Stretch]| run.iter().map(|of| of.length_mm).sum::<f64>();
        let mut runs: Vec<Vec<Stretch>> = Vec::new();
        // Of the last run; summed again for each stretch it would grow with the square of their
        // number.
        let (mut run_mm, shortest_mm) = (0.0, SPEED_RUN * settings.aperture.unit_mm());
        for stretch in stretches {
            match runs.last_mut().filter(|_| run_mm < shortest_mm) {
                Some(run) => {
                    run.push(stretch);
                    run_mm += stretch.length_mm;
                }
                None => {
                    runs.push(vec![stretch]);
                    run_mm = stretch.length_mm;
                }
            }
        }
        // A short one at the end.
        if runs.len() > 1
            && let Some(last) = runs.pop_if(|last| way_mm(last) < shortest_mm)
            && let Some(before) = runs.last_mut()
        {
            before.extend(last);
        }
        runs
    }
}

impl Control {
    /// The move of a run.
    pub(super) fn run(&self, run: &[Stretch]) -> Option<BeadMove> {
        let (first, last) = (run.first()?, run.last()?);
        let from = self.vertices[first.ends[0]];
        let to = self.vertices[last.ends[1]];
        let u = |node: usize| (self.vertices[node] - from) as f64;
        let mut speeds_mm_s = Vec::new();
        if run.len() > 1 {
            for (i, of) in run.iter().enumerate() {
                let [begin, end] = of.ends.map(u);
                let change = CHANGE_SPANS.min(CHANGE_SHARE * (end - begin));
                // What is slower keeps its speed to its end.
                let within = |other: Option<&Stretch>| match other {
                    Some(other) if other.speed_mm_s < of.speed_mm_s => change,
                    _ => 0.0,
                };
                let before = i.checked_sub(1).and_then(|before| run.get(before));
                speeds_mm_s.push([begin + within(before), of.speed_mm_s]);
                speeds_mm_s.push([end - within(run.get(i + 1)), of.speed_mm_s]);
            }
        }
        let fastest = run.iter().map(|of| of.speed_mm_s).fold(0.0, f64::max);
        Some(BeadMove {
            control: self.points[from..=to].to_vec(),
            speed_mm_s: fastest,
            speeds_mm_s,
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::gcode::comments::Slicer;
    use crate::gcode::{BeadKind, GcodePass, Leg, Place};
    use crate::plan::route::bead_curve::Bead;
    use crate::settings::Settings;

    /// Squares of 100 mm, so many sides at this speed.
    fn squares(sides: usize, speed_mm_s: f64) -> GcodePass {
        let corners = [[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]];
        let place = |k: usize| Place {
            tip_mm: [corners[k % 4][0], corners[k % 4][1], 0.2],
            turn_deg: [0.0; 3],
        };
        let leg = Leg {
            line: 1,
            speed_mm_s,
            width_mm: Some(0.5),
            height_mm: Some(0.2),
            volume_mm3: Some(10.0),
            is_inside: false,
            kind: BeadKind::Unknown,
        };
        GcodePass {
            layer: 0,
            travel: Vec::new(),
            travel_legs: Vec::new(),
            points: (0..=sides).map(place).collect(),
            legs: vec![leg; sides],
            prime: None,
            retract: None,
        }
    }

    /// Goal: a pass of hours is no move of hours, and what is shorter is one move. Method: sides of 25 s and of 200 s,
    /// by hand: 240 sides of 25 s are 6,000 s; of 200 s each counts as 50 s at 2 mm/s, of which 120 are 6,000 s,
    /// and 90 are 18,000 s.
    #[test]
    fn passes_of_hours_are_cut_at_rest() {
        let settings = Settings::default();
        let moves = |sides: usize, speed_mm_s: f64| {
            let pass = squares(sides, speed_mm_s);
            let bead = Bead::of(&pass, Slicer::Plain, false, &settings).expect("a bead");
            let curve = bead.curve(&settings);
            let ends = curve.moves.windows(2);
            for pair in ends {
                assert_eq!(pair[0].control.last(), pair[1].control.first());
            }
            curve.moves.len()
        };
        assert_eq!(
            (moves(239, 4.0), moves(242, 4.0), moves(600, 4.0)),
            (1, 2, 3)
        );
        assert_eq!((moves(89, 0.5), moves(92, 0.5)), (1, 2));
    }
}

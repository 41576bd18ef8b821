//! Speeds along a pass: where it is cut at rest, and where one speed becomes another within a move.
//!
//! In: legs with their speeds (mm/s) and volumes. Out: runs of stretches of alike speed, each run a move from rest
//! to rest; tip speeds by the path's parameter where a run has several. Leaves out what limits of the machine
//! allow of them.

use super::{BeadMove, Control, Way};
use crate::settings::Settings;

/// Speeds alike to this share are one; runs shorter than this are no move of their own: they keep their speed
/// within their neighbour's.
const SPEED_SHARE: f64 = 0.1;
const SPEED_RUN_MM: f64 = 2.0;
/// Where the extruder allows less than this, its bound is the leg's speed, mm/s: a crawl is a move of its own.
const CRAWL_MM_S: f64 = 1.0;
/// Way in which one speed becomes another one, spans of the curve and share of the faster one's.
const CHANGE_SPANS: f64 = 1.0;
const CHANGE_SHARE: f64 = 0.3;
/// Legs of alike speed, from vertex to vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stretch {
    ends: [usize; 2],
    speed_mm_s: f64,
    length_mm: f64,
}

impl Way {
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
            let is_alike = |last: &Stretch| {
                (last.speed_mm_s - speed_mm_s).abs() <= SPEED_SHARE * last.speed_mm_s
            };
            match stretches.last_mut().filter(|last| is_alike(last)) {
                Some(last) => {
                    last.ends[1] = leg + 1;
                    last.speed_mm_s = last.speed_mm_s.min(speed_mm_s);
                    last.length_mm += length_mm;
                }
                None => stretches.push(Stretch {
                    ends: [leg, leg + 1],
                    speed_mm_s,
                    length_mm: *length_mm,
                }),
            }
        }
        let way_mm = |run: &[Stretch]| run.iter().map(|of| of.length_mm).sum::<f64>();
        let mut runs: Vec<Vec<Stretch>> = Vec::new();
        // Of the last run; summed anew for each stretch it would grow with the square of their number.
        let mut run_mm = 0.0;
        for stretch in stretches {
            match runs.last_mut().filter(|_| run_mm < SPEED_RUN_MM) {
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
            && let Some(last) = runs.pop_if(|last| way_mm(last) < SPEED_RUN_MM)
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

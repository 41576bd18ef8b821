//! One window of a chain: the smoother versions of it, and which of them is worth taking.
//!
//! In: the chains as they are, a run of poses of one. Out: the replacement that saves the most, time
//! saved less the price of the ground that it leaves open or lays twice; none where nothing gains.

use super::chain::{Chain, swept_poses};
use super::local_time::{Knot, duration_s, find_rates, step_s};
use super::smoothing::Smoother;
use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::EdgeIndex;
use crate::plan::coverage::exchange::{CoverageChange, Exchange};
use crate::plan::coverage::raster::Raster;
use crate::plan::curve::plane_curve::{PlaneControl, configuration};
use crate::plan::headings::profile::slide_inside;
use crate::plan::pass::Contact;
use crate::plan::pose_limits::PoseLimits;
use std::ops::Range;

/// Poses about a window whose motion is found anew: enough to brake and to turn back.
const BESIDE: usize = 24;
/// Waves that are smoothed away, against the window.
const WAVES: [f64; 3] = [0.3, 0.8, 2.5];
/// Least time that a shortcut saves, s.
const GAIN_MIN_S: f64 = 1e-3;
/// What a window must take beyond its way at full speed to be looked at, s.
const EXCESS_MIN_S: f64 = 4e-3;
/// Poses as near as this to an earlier one of the window close a loop, mm; a radian counts as
/// [`LOOP_TURN_MM`].
const LOOP_MM: f64 = 0.06;
/// See [`LOOP_MM`].
const LOOP_TURN_MM: f64 = 0.3;
/// Loops of a window that are tried.
const LOOPS_MAX: usize = 3;
/// Slides off the walls of one pose, and what a pose may cut (the layer path takes the rest).
const SLIDES: usize = 3;
/// See [`SLIDES`].
const CUT_SHARE: f64 = 2e-3;
/// A whole window is moved off its wall by up to this, mm, before single poses are.
const SHIFT_MAX_MM: f64 = 0.02;
/// Least of such a move, mm.
const SHIFT_MIN_MM: f64 = 2e-4;
/// Share of the window over which it is moved little by little.
const SHIFT_TAPER: f64 = 0.2;
/// Replacements that are taken off the walls and looked at in full.
const CHECKED_MAX: usize = 3;
/// What covering a place again costs against leaving it open.
const AGAIN_WEIGHT: f64 = 0.5;
/// Farthest that a replacement reaches beyond the poses that it replaces, against a.
const REACH_SHARE: f64 = 0.5;

/// What every window needs.
pub struct ShortcutSearch<'a> {
    /// The nozzle.
    pub aperture: &'a Aperture,
    /// What it keeps inside of.
    pub walls: &'a EdgeIndex,
    /// The machine.
    pub limits: &'a PoseLimits,
    /// s/mm² of ground left open.
    pub price_s_mm2: f64,
    /// How far along its path a bead is the same bead still, mm.
    pub return_mm: f64,
}

/// A run of poses and what to put in their place.
pub struct Shortcut {
    /// Number of the chain.
    pub chain: usize,
    /// The poses that are replaced.
    pub range: Range<usize>,
    /// What replaces them.
    pub poses: Vec<PlaneControl>,
    /// Their contacts.
    pub contacts: Vec<Contact>,
    /// Time saved, s.
    pub saved_s: f64,
    /// What it does to the ground.
    pub change: CoverageChange,
}

/// A replacement before it is known whether it fits.
struct Candidate {
    poses: Vec<PlaneControl>,
    /// Number in the chain of the pose that each stands for.
    numbers: Vec<usize>,
    /// True where all of it lies where the chain lay.
    is_cut: bool,
    gain_s: f64,
}

/// Memory that serves many windows.
#[derive(Default)]
pub struct Scratch {
    exchange: Exchange,
    knots: Vec<Knot>,
    rates: Vec<f64>,
    around: Vec<PlaneControl>,
    swept: Vec<Configuration>,
}

impl ShortcutSearch<'_> {
    /// What the time saved is worth beyond the ground.
    pub fn gain_s(&self, saved_s: f64, change: CoverageChange) -> f64 {
        saved_s - self.price_s_mm2 * (change.opened_mm2 + AGAIN_WEIGHT * change.recovered_mm2)
    }

    /// The best replacement of a run of poses of one of `chains`.
    pub fn best(
        &self,
        chains: &[Chain],
        raster: &Raster,
        number: usize,
        range: Range<usize>,
        scratch: &mut Scratch,
    ) -> Option<Shortcut> {
        let chain = &chains[number];
        if range.len() < 6 || self.excess_s(chain, &range) < EXCESS_MIN_S {
            return None;
        }
        self.look(chain, raster, &range, scratch);
        let mut candidates = self.smoothed(chain, &range);
        candidates.extend(loops_cut(chain, &range));
        for candidate in &mut candidates {
            candidate.gain_s = self
                .valued(chain, raster, &range, candidate, scratch)
                .map_or(0.0, |(saved_s, change)| self.gain_s(saved_s, change));
        }
        // The first of equals.
        candidates.sort_by(|p, q| q.gain_s.total_cmp(&p.gain_s));
        let mut best: Option<(f64, Shortcut)> = None;
        for mut candidate in candidates.into_iter().take(CHECKED_MAX) {
            let least_s = best.as_ref().map_or(GAIN_MIN_S, |best| best.0);
            if candidate.gain_s <= least_s {
                break;
            }
            let fits = candidate.is_cut || self.slid(chain, &mut candidate);
            let Some((saved_s, change)) = fits
                .then(|| self.valued(chain, raster, &range, &candidate, scratch))
                .flatten()
            else {
                continue;
            };
            let gain_s = self.gain_s(saved_s, change);
            if gain_s > least_s {
                let contacts = candidate
                    .numbers
                    .iter()
                    .map(|&i| chain.contacts[i])
                    .collect();
                let shortcut = Shortcut {
                    chain: number,
                    range: range.clone(),
                    poses: candidate.poses,
                    contacts,
                    saved_s,
                    change,
                };
                best = Some((gain_s, shortcut));
            }
        }
        best.map(|(_, shortcut)| shortcut)
    }

    /// What the run takes beyond its way at the tip's speed, s.
    fn excess_s(&self, chain: &Chain, range: &Range<usize>) -> f64 {
        let way_mm: f64 = chain.poses[range.clone()]
            .windows(2)
            .map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]))
            .sum();
        duration_s(&chain.rates[range.clone()]) - self.limits.at_speed_s(way_mm)
    }

    /// Looks at the ground about a run.
    fn look(&self, chain: &Chain, raster: &Raster, range: &Range<usize>, scratch: &mut Scratch) {
        let own = swept_range(chain, range);
        let mut old = Vec::new();
        swept_poses(&chain.poses, own.clone(), &mut old);
        let mut beside = Vec::new();
        for range in chain.beside(own, self.return_mm) {
            swept_poses(&chain.poses, range, &mut beside);
        }
        let reach_mm = REACH_SHARE * self.aperture.major_mm();
        scratch.exchange.look(raster, &old, &beside, reach_mm);
    }

    /// The change of the ground alone, for a shortcut found earlier.
    pub fn change_again(
        &self,
        chain: &Chain,
        raster: &Raster,
        shortcut: &Shortcut,
        scratch: &mut Scratch,
    ) -> CoverageChange {
        self.look(chain, raster, &shortcut.range, scratch);
        self.change_of(chain, raster, &shortcut.range, &shortcut.poses, scratch)
    }

    fn change_of(
        &self,
        chain: &Chain,
        raster: &Raster,
        range: &Range<usize>,
        poses: &[PlaneControl],
        scratch: &mut Scratch,
    ) -> CoverageChange {
        // One pose more to either side, whose place on the curve hangs on its neighbours.
        let before = range.start.saturating_sub(2)..range.start;
        let after = range.end..(range.end + 2).min(chain.poses.len());
        let (lead, tail) = (before.len(), after.len());
        scratch.around.clear();
        scratch.around.extend_from_slice(&chain.poses[before]);
        scratch.around.extend_from_slice(poses);
        scratch.around.extend_from_slice(&chain.poses[after]);
        scratch.swept.clear();
        let count = scratch.around.len();
        let own = lead.saturating_sub(1)..count - tail.saturating_sub(1);
        swept_poses(&scratch.around, own, &mut scratch.swept);
        scratch.exchange.change(raster, &scratch.swept)
    }

    /// Time saved and what it does to the ground; `None` where it saves none.
    fn valued(
        &self,
        chain: &Chain,
        raster: &Raster,
        range: &Range<usize>,
        candidate: &Candidate,
        scratch: &mut Scratch,
    ) -> Option<(f64, CoverageChange)> {
        let saved_s = self.saved_s(chain, range, &candidate.poses, scratch)?;
        (saved_s > GAIN_MIN_S).then(|| {
            (
                saved_s,
                self.change_of(chain, raster, range, &candidate.poses, scratch),
            )
        })
    }

    /// Time that replacing the run saves, with the rates at some distance as they are.
    fn saved_s(
        &self,
        chain: &Chain,
        range: &Range<usize>,
        poses: &[PlaneControl],
        scratch: &mut Scratch,
    ) -> Option<f64> {
        let last = chain.poses.len() - 1;
        let first = range.start.saturating_sub(BESIDE);
        let end = (range.end - 1 + BESIDE).min(last);
        // The knots beside the run hang on two poses of it.
        let low = range.start.saturating_sub(4);
        let high = (range.end + 4).min(chain.poses.len());
        scratch.around.clear();
        scratch
            .around
            .extend_from_slice(&chain.poses[low..range.start]);
        scratch.around.extend_from_slice(poses);
        scratch
            .around
            .extend_from_slice(&chain.poses[range.end..high]);
        let new_low = if low == 0 { 0 } else { 2 };
        let new_high = scratch.around.len() - if high == chain.poses.len() { 0 } else { 2 };
        scratch.knots.clear();
        scratch
            .knots
            .extend_from_slice(&chain.knots[first.min(low + new_low)..low + new_low]);
        let around = &scratch.around;
        let limits = self.limits;
        scratch
            .knots
            .extend((new_low..new_high).map(|i| limits.knot(around, i)));
        let rest = high - if high == chain.poses.len() { 0 } else { 2 };
        scratch
            .knots
            .extend_from_slice(&chain.knots[rest..(end + 1).max(rest)]);
        let ends = [chain.rates[first], chain.rates[end]];
        if !find_rates(&scratch.knots, ends, &mut scratch.rates) {
            return None;
        }
        Some(duration_s(&chain.rates[first..=end]) - duration_s(&scratch.rates))
    }

    /// The run smoothed at several wave lengths: the heading alone, the centre tangent to its contact;
    /// and all channels.
    fn smoothed(&self, chain: &Chain, range: &Range<usize>) -> Vec<Candidate> {
        let poses = &chain.poses[range.clone()];
        let steps = chain.rates[range.clone()].windows(2);
        let step_s: Vec<f64> = steps
            .map(|x| step_s(x[0], x[1]).clamp(2e-4, 0.05))
            .collect();
        let window_s: f64 = step_s.iter().sum();
        let mut candidates = Vec::with_capacity(2 * WAVES.len());
        for wave in WAVES {
            let smoother = Smoother::new(&step_s, wave * window_s);
            let [x, y, heading] =
                [0, 1, 2].map(|c| smoother.smoothed(poses.iter().map(move |p| p[c])));
            let turned = (0..poses.len()).map(|k| {
                let (own, contact) = (poses[k], &chain.contacts[range.start + k]);
                let away_mm = match contact.on_axis {
                    true => 0.0,
                    false => {
                        self.aperture.extent_mm(heading[k], contact.normal)
                            - self.aperture.extent_mm(own[2], contact.normal)
                    }
                };
                let by = contact.normal * away_mm;
                [own[0] + by.x, own[1] + by.y, heading[k]]
            });
            let all = (0..poses.len()).map(|k| [x[k], y[k], heading[k]]);
            for poses in [turned.collect(), all.collect()] {
                candidates.push(Candidate {
                    poses,
                    numbers: range.clone().collect(),
                    is_cut: false,
                    gain_s: 0.0,
                });
            }
        }
        candidates
    }

    /// Takes the poses between the ends off the walls; false where that fails.
    fn slid(&self, chain: &Chain, candidate: &mut Candidate) -> bool {
        let last = candidate.poses.len() - 1;
        let slide = |pose: PlaneControl| {
            slide_inside(
                configuration(pose),
                self.aperture,
                self.walls,
                SLIDES,
                CUT_SHARE,
            )
        };
        let mut most_mm = 0.0f64;
        for &pose in &candidate.poses[1..last] {
            let Some(slid) = slide(pose) else {
                return false;
            };
            most_mm = most_mm.max((slid.center - configuration(pose).center).norm());
        }
        if most_mm == 0.0 {
            return true;
        }
        if most_mm > SHIFT_MIN_MM && most_mm < SHIFT_MAX_MM {
            for (k, pose) in candidate.poses.iter_mut().enumerate() {
                let contact = &chain.contacts[candidate.numbers[k]];
                let share = k as f64 / last as f64;
                let t = (share.min(1.0 - share) / SHIFT_TAPER).min(1.0);
                let by = match contact.on_axis {
                    true => Vector2::zeros(),
                    false => contact.normal * (most_mm * t * t * (3.0 - 2.0 * t)),
                };
                pose[0] += by.x;
                pose[1] += by.y;
            }
        }
        candidate.poses[1..last].iter_mut().all(|pose| {
            slide(*pose).is_some_and(|slid| {
                pose[0] = slid.center.x;
                pose[1] = slid.center.y;
                true
            })
        })
    }
}

/// The run and one pose more to either side: its place on the curve hangs on its neighbours.
pub fn swept_range(chain: &Chain, range: &Range<usize>) -> Range<usize> {
    range.start.saturating_sub(1)..(range.end + 1).min(chain.poses.len())
}

/// The run without loops that it closes.
fn loops_cut(chain: &Chain, range: &Range<usize>) -> Vec<Candidate> {
    let poses = &chain.poses;
    let is_near = |i: usize, j: usize| {
        let [p, q] = [poses[i], poses[j]];
        (p[0] - q[0]).hypot(p[1] - q[1]) + LOOP_TURN_MM * (p[2] - q[2]).abs() < LOOP_MM
    };
    let inner = range.start + 1..range.end - 1;
    let loops = inner.clone().filter_map(|i| {
        let back = (i + 4..inner.end).rev().find(|&j| is_near(i, j))?;
        Some((i, back))
    });
    loops
        .take(LOOPS_MAX)
        .map(|(i, back)| {
            let numbers: Vec<usize> = (range.start..=i).chain(back + 1..range.end).collect();
            Candidate {
                poses: numbers.iter().map(|&i| poses[i]).collect(),
                numbers,
                is_cut: true,
                gain_s: 0.0,
            }
        })
        .filter(|candidate| candidate.poses.len() >= 4)
        .collect()
}

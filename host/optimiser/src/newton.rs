//! The iterations: damped Gauss-Newton steps on one banded system, limits soft at first and then hardened.
//!
//! In: knots and the terms of the objective. Out: better knots. Limits that are hard from the start keep the path
//! in place; soft ones permit another shape, which is then brought within them in steps (continuation).

use super::Effort;
use super::band::{System, WIDTH};
use super::containment::{Containment, Wall};
use super::curve::{At, CHANNELS, Knot, PassKnots, set_phantoms};
use super::curves::Curves;
use super::ground::Ground;
use super::motion::Motion;
use super::moving::Moving;
use super::terms::Terms;
use std::ops::RangeInclusive;

/// Weight of limits, price of poses outside and blur of the area's price: from soft to hard.
const LIMITS: [f64; 2] = [2.0, 100.0];
const OUTSIDE: [f64; 2] = [12e3, 240e3];
const BLUR: [f64; 2] = [0.3, 0.08];
/// Weight of curves beyond their bound, soft at no time (trials on a corner and on a wall as wide as its bead).
const CURVES: f64 = 3000.0;
/// Clearance from walls, in a; and its factor at the hardest level.
const MARGIN: f64 = 1.0 / 1500.0;
const MARGIN_HARD: f64 = 1.5;
/// Share of the iterations that are soft, steps to hard, and the share of the rest in which they are made.
const SOFT_SHARE: f64 = 0.6;
const LEVELS: usize = 6;
const HARDENING_SHARE: f64 = 0.8;
/// Damping at first, its least and its growth and fall; what it adds to the curvature of each channel and the share
/// of the curvature.
const DAMPING: f64 = 0.3;
const DAMPING_MIN: f64 = 1e-5;
const DAMPING_GROWTH: f64 = 6.0;
const DAMPING_FALL: f64 = 0.3;
const DAMPING_SHARE: f64 = 0.01;
const DAMPING_ADDED: [f64; CHANNELS] = [60.0, 60.0, 50.0, 1.0 / 6.0];
/// What keeps pivots from zero.
const PIVOT_ADDED: f64 = 1e-7;
/// Most that a step changes each channel: a, rad, log.
const STEP_MAX: [f64; CHANNELS] = [0.25, 0.25, 0.3, 0.5];
/// Tries of a step with growing damping.
const TRIES: usize = 6;
/// A step is accepted if it is better than the worst of this many values, and at most this far above the best:
/// where the path returns, cost jumps a little.
const REMEMBERED: usize = 4;
const ABOVE_BEST: f64 = 1.1;
const GAIN_MIN: f64 = 1e-7;
/// Share of the ground's cost that a step leaves: a trial that fails with this much is not swept (steps leave more than
/// nine tenths after the first iterations).
const GROUND_LEFT: f64 = 0.8;

/// How hard limits are at one time.
#[derive(Clone, Copy, Debug)]
pub struct Hardness {
    /// Weight of the excess over limits of motion.
    pub limits: f64,
    /// Of the walls.
    pub wall: Wall,
    /// Coverage over which the corner of the area's price is rounded.
    pub blur: f64,
}

impl Hardness {
    /// After this many of [`LEVELS`] steps.
    pub fn at(level: usize) -> Hardness {
        let share = level as f64 / LEVELS as f64;
        let between = |[soft, hard]: [f64; 2]| soft * (hard / soft).powf(share);
        let harder = if level == LEVELS { MARGIN_HARD } else { 1.0 };
        Hardness {
            limits: between(LIMITS),
            wall: Wall {
                weight: between(OUTSIDE),
                margin: harder * MARGIN,
            },
            blur: between(BLUR),
        }
    }

    /// The level of iteration `number` (from 1).
    fn level(number: usize, effort: &Effort) -> usize {
        let count = effort.iterations;
        let soft_share = if effort.is_warm { 0.0 } else { SOFT_SHARE };
        let soft = (count as f64 * soft_share) as usize;
        if number <= soft {
            return 0;
        }
        let rest = ((count - soft) as f64 * HARDENING_SHARE).max(1.0);
        let passed = (number - soft - 1) as f64;
        LEVELS.min(1 + (passed * LEVELS as f64 / rest) as usize)
    }
}

/// The terms of the objective for one region.
pub struct Objectives<'a> {
    /// Seconds and limits.
    pub motion: Motion,
    /// Curves, where they are bounded.
    pub curves: Option<Curves>,
    /// Open and laid twice.
    pub ground: Ground<'a>,
    /// Walls.
    pub containment: Containment<'a>,
}

impl Objectives<'_> {
    /// Value at these knots, if it is below `most`, where the ground costs no less than `ground`; `system` becomes
    /// gradient and curvature where it is given. Motion and walls of spans whose knots all stay do not count. A trial
    /// often fails by the walls, which take a fraction of the sweep's time: they come first. `is_swept` becomes false
    /// where other knots than before are swept.
    fn evaluate(
        &mut self,
        at: &At,
        hardness: &Hardness,
        [ground, most]: [f64; 2],
        mut system: Option<&mut System>,
        is_swept: &mut bool,
    ) -> Option<Terms> {
        let mut terms = self.limits(at, hardness, system.as_deref_mut());
        if terms.sum() + ground >= most {
            return None;
        }
        terms.outside = self.walls(at, hardness);
        if terms.sum() + ground >= most {
            return None;
        }
        *is_swept = false;
        self.ground.sweep(at.knots, at.passes);
        self.add_ground(hardness, &mut terms, system);
        Some(terms)
    }

    /// Value, gradient and curvature at the knots that were swept last.
    fn weigh(&mut self, at: &At, hardness: &Hardness, system: &mut System) -> Terms {
        let mut terms = self.limits(at, hardness, Some(system));
        terms.outside = self.walls(at, hardness);
        self.add_ground(hardness, &mut terms, Some(system));
        terms
    }

    /// Begins a system with time, limits and curves.
    fn limits(&self, at: &At, hardness: &Hardness, mut system: Option<&mut System>) -> Terms {
        let mut terms = Terms::default();
        if let Some(system) = &mut system {
            system.clear();
        }
        let motion = &self.motion;
        motion.add(at, hardness.limits, &mut terms, system.as_deref_mut());
        // They begin within their bound, and a soft bound would let them into a corner from which they do not return.
        if let Some(curves) = &self.curves {
            curves.add(at.knots, at.passes, CURVES, &mut terms, system);
        }
        terms
    }

    fn walls(&mut self, at: &At, hardness: &Hardness) -> f64 {
        self.containment.measure(at, &hardness.wall)
    }

    /// Adds the ground of the last sweep, and hands on what the walls were found to cost.
    fn add_ground(
        &mut self,
        hardness: &Hardness,
        terms: &mut Terms,
        mut system: Option<&mut System>,
    ) {
        self.ground.add(hardness.blur, terms, system.as_deref_mut());
        if let Some(system) = system {
            self.containment.add_measured(system);
        }
    }
}

/// The state between iterations.
pub struct Newton<'a> {
    /// The minimised cost.
    pub objectives: Objectives<'a>,
    /// The passes that the knots belong to.
    pub passes: Vec<PassKnots>,
    /// Where it is.
    pub knots: Vec<Knot>,
    /// Knots that stay where they are.
    stays: Vec<bool>,
    system: System,
    /// What the objective is there.
    pub terms: Terms,
    hardness: Hardness,
    damping: f64,
    recent: Vec<f64>,
    /// Whether the knots are the ones swept last.
    is_swept: bool,
    trial: Trial,
}

/// Buffers of a step that is tried; its system holds the factors of the one before until it is evaluated.
struct Trial {
    knots: Vec<Knot>,
    system: System,
    step: Vec<f64>,
}

impl<'a> Newton<'a> {
    /// At the start.
    pub fn new(
        mut objectives: Objectives<'a>,
        knots: Vec<Knot>,
        passes: Vec<PassKnots>,
        stays: Vec<bool>,
    ) -> Newton<'a> {
        let unknowns = CHANNELS * knots.len();
        let mut system = System::new(unknowns);
        let hardness = Hardness::at(0);
        let at = At {
            knots: &knots,
            passes: &passes,
            stays: &stays,
        };
        objectives.ground.sweep(&knots, &passes);
        let terms = objectives.weigh(&at, &hardness, &mut system);
        prepare(&mut system, &passes, &stays);
        Newton {
            objectives,
            stays,
            passes,
            trial: Trial {
                knots: knots.clone(),
                system: system.clone(),
                step: vec![0.0; unknowns + WIDTH],
            },
            knots,
            system,
            recent: vec![terms.sum()],
            terms,
            hardness,
            damping: DAMPING,
            is_swept: true,
        }
    }

    /// Makes these iterations of all; `watch` sees each.
    pub fn run(
        &mut self,
        numbers: RangeInclusive<usize>,
        effort: &Effort,
        mut watch: impl FnMut(usize, &Terms),
    ) {
        let mut level = 0;
        for number in numbers {
            let wanted = Hardness::level(number, effort);
            if wanted != level {
                level = wanted;
                self.harden(level);
            }
            // Before harder limits and at the end nothing needs the slopes.
            let is_followed =
                number < effort.iterations && Hardness::level(number + 1, effort) == level;
            if !(0..TRIES).any(|_| self.try_step(is_followed)) {
                self.damping = 1.0;
            }
            watch(number, &self.terms);
        }
    }

    /// For each knot whether it stays where it is.
    pub fn stays(&self) -> &[bool] {
        &self.stays
    }

    /// The smaller problem of what still moves, in the state of this one.
    pub fn narrowed(self, part: &Moving) -> Newton<'a> {
        let Newton {
            mut objectives,
            knots,
            damping,
            ..
        } = self;
        let own = part.own(&knots);
        let moving: Vec<Knot> = part.moving(&own).copied().collect();
        objectives.ground.keep_near(&moving, part.reach);
        objectives.containment.forget(own.len());
        Newton {
            damping,
            ..Newton::new(objectives, own, part.passes.clone(), part.stays.clone())
        }
    }

    /// The objective with harder limits.
    fn harden(&mut self, level: usize) {
        self.hardness = Hardness::at(level);
        let at = At {
            knots: &self.knots,
            passes: &self.passes,
            stays: &self.stays,
        };
        if !self.is_swept {
            self.objectives.ground.sweep(at.knots, at.passes);
            self.is_swept = true;
        }
        self.terms = self.objectives.weigh(&at, &self.hardness, &mut self.system);
        prepare(&mut self.system, &self.passes, &self.stays);
        self.damping = self.damping.min(1.0);
        self.recent.clear();
        self.recent.push(self.terms.sum());
    }

    /// Solves, moves and evaluates; takes the step where it is good, or raises the damping. The system of the new
    /// knots is known only if it `is_followed` by another step.
    fn try_step(&mut self, is_followed: bool) -> bool {
        let trial = &mut self.trial;
        if !trial.solve(&self.system, self.damping) {
            self.damping *= DAMPING_GROWTH;
            return false;
        }
        trial.take(&self.knots, &self.passes);
        let worst = self
            .recent
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        let best = self.recent.iter().copied().fold(f64::INFINITY, f64::min);
        let most = worst.min(best * ABOVE_BEST) - GAIN_MIN;
        let at = At {
            knots: &trial.knots,
            passes: &self.passes,
            stays: &self.stays,
        };
        let system = is_followed.then_some(&mut trial.system);
        let bounds = [GROUND_LEFT * self.terms.ground, most];
        let terms =
            self.objectives
                .evaluate(&at, &self.hardness, bounds, system, &mut self.is_swept);
        // False if the value is not a number.
        let Some(terms) = terms.filter(|terms| terms.sum() < most) else {
            self.damping *= DAMPING_GROWTH;
            return false;
        };
        self.is_swept = true;
        if self.recent.len() == REMEMBERED {
            self.recent.remove(0);
        }
        self.recent.push(terms.sum());
        std::mem::swap(&mut self.knots, &mut trial.knots);
        if is_followed {
            std::mem::swap(&mut self.system, &mut trial.system);
            prepare(&mut self.system, &self.passes, &self.stays);
        }
        self.terms = terms;
        self.damping = DAMPING_MIN.max(self.damping * DAMPING_FALL);
        true
    }
}

/// Removes phantoms and fixed knots from the unknowns.
pub fn prepare(system: &mut System, passes: &[PassKnots], stays: &[bool]) {
    for pass in passes {
        let (first, end) = (pass.first, pass.end());
        if pass.free {
            if !pass.cut[0] {
                system.fold(first, [first, first + 1, first + 2]);
            }
            if !pass.cut[1] {
                system.fold(end - 4, [end - 1, end - 2, end - 3]);
            }
        } else {
            for unknown in CHANNELS * first..CHANNELS * end {
                system.pin(unknown);
            }
        }
    }
    for (knot, _) in stays.iter().enumerate().filter(|(_, stays)| **stays) {
        for channel in 0..CHANNELS {
            system.pin(CHANNELS * knot + channel);
        }
    }
}

impl Trial {
    /// The step by the damped system; false if it has no solution.
    fn solve(&mut self, system: &System, damping: f64) -> bool {
        self.system.band.copy_from(&system.band);
        for unknown in 0..self.system.band.unknowns() {
            let diagonal = &mut self.system.band.row_mut(unknown)[0];
            let added = DAMPING_ADDED[unknown % CHANNELS];
            *diagonal += damping * (DAMPING_SHARE * *diagonal + added) + PIVOT_ADDED;
            self.step[unknown] = -system.gradient[unknown];
        }
        if !self.system.band.factor() {
            return false;
        }
        let unknowns = self.system.band.unknowns();
        self.step[unknowns..].fill(0.0);
        self.system.band.solve(&mut self.step);
        true
    }

    /// Moves the knots by the step, each channel at most so far.
    fn take(&mut self, from: &[Knot], passes: &[PassKnots]) {
        let steps = self.step.chunks_exact(CHANNELS);
        for ((knot, was), step) in self.knots.iter_mut().zip(from).zip(steps) {
            for c in 0..CHANNELS {
                knot[c] = was[c] + step[c].clamp(-STEP_MAX[c], STEP_MAX[c]);
            }
        }
        for pass in passes.iter().filter(|pass| pass.free) {
            set_phantoms(&mut self.knots, pass);
        }
    }
}

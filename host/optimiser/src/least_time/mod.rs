//! Least time over a window of a motion: a primal-dual interior-point method.
//!
//! In: the squared rate b(t) as a uniform cubic spline (t the old time, b = (dt_old / dt_new)²), some
//! of its coefficients free, and rows w · (b, b', b'') <= bound, of a jerk <= bound / sqrt(b). Out: the
//! free coefficients with the least time, the sum of 1 / sqrt(b) at the knots. The bound of a jerk row
//! is convex in b, so that its tangent is on the safe side: each step is one of a convex problem.
//! Predictor and corrector after Mehrotra, "On the implementation of a primal-dual interior point
//! method" (1992); the jerk's rows after Verscheure et al., "Time-optimal path tracking for robots"
//! (2009), and Consolini et al. on its jerk. Normal equations have half bandwidth 3. The number of
//! steps is bounded; if they do not converge, the window stays unchanged.

mod rows;

pub use self::rows::{Place, Row, Rows};
use headway_geometry::banded::{Band, Factored};
use std::ops::Range;

/// Newton steps; six to eight are usual.
const STEPS_MAX: usize = 20;
/// Mean complementarity at which the time is within about 0.3 % of the least.
const MEAN_END: f64 = 1e-4;
/// The same where it is solved again for a motion near to this one.
const MEAN_END_ROUGH: f64 = 0.03;
/// Violation at which a row counts as kept; the check of the finished segments is exact.
const VIOLATION_END: f64 = 2e-3;
/// Largest violation of an accepted result if none was worse before.
const VIOLATION_MAX: f64 = 0.01;
/// Slack and complementarity to begin with.
const SLACK_FIRST: f64 = 0.1;
const MEAN_FIRST: f64 = 0.05;
/// Share of the distance to the nearest bound that a step covers.
const STEP_SHARE: f64 = 0.95;
/// Largest share of itself that b loses in a step.
const FALL_MAX: f64 = 0.7;
/// Keeps the equations regular where neither rows nor time depend on a coefficient.
const REGULAR: f64 = 1e-9;
/// Weights of the coefficients from the one before a knot on for b there.
const AT_KNOT: [f64; 4] = [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0, 0.0];

/// The problem: rows over a window of coefficients, of which those in `free` are unknown.
pub struct Window<'a> {
    /// The rows, with places by the window's own coefficients.
    pub rows: &'a Rows,
    /// Coefficients that may change.
    pub free: Range<usize>,
    /// Squared rate below which a result is rejected.
    pub floor: f64,
    /// Whether it is solved again for a motion near to this one.
    pub is_rough: bool,
}

/// An iterate.
struct Iterate {
    coefficients: Vec<f64>,
    /// b at every place.
    b: Vec<f64>,
    rows: Vec<RowState>,
}

/// What an iterate has of a row.
#[derive(Clone, Copy, Default)]
struct RowState {
    /// How far it is beyond its bound, and the slope of that by (b, b', b'').
    excess: f64,
    slope: [f64; 3],
    slack: f64,
    per_slack: f64,
    multiplier: f64,
}

/// A step of an iterate, and how much of it keeps slacks and multipliers positive.
struct Step {
    coefficients: Vec<[f64; 1]>,
    /// Of slack and multiplier of every row.
    rows: Vec<[f64; 2]>,
    primal_share: f64,
    dual_share: f64,
}

/// The free coefficients of least time; `None` if the steps did not converge.
pub fn least_time(window: &Window, coefficients: Vec<f64>) -> Option<Vec<f64>> {
    let mut iterate = Iterate::new(window, coefficients);
    let worst_before = iterate.worst_excess();
    let (mean_end, violation_end) = match window.is_rough {
        true => (MEAN_END_ROUGH, VIOLATION_MAX),
        false => (MEAN_END, VIOLATION_END),
    };
    for _ in 0..STEPS_MAX {
        let step = window.step(&iterate);
        iterate.advance(window, &step);
        if iterate.mean() < mean_end && iterate.worst_excess() < violation_end {
            break;
        }
    }
    let is_finite = iterate.coefficients.iter().all(|value| value.is_finite());
    let is_kept = iterate.worst_excess() < worst_before.max(VIOLATION_MAX);
    let moves = iterate.b.iter().all(|b| *b >= window.floor);
    (is_finite && is_kept && moves).then(|| iterate.coefficients[window.free.clone()].to_vec())
}

impl Iterate {
    fn new(window: &Window, coefficients: Vec<f64>) -> Self {
        let mut iterate = Self {
            coefficients,
            b: vec![0.0; window.rows.places.len()],
            rows: vec![RowState::default(); window.rows.rows.len()],
        };
        iterate.evaluate(window.rows);
        for row in &mut iterate.rows {
            row.set_slack(SLACK_FIRST);
            row.multiplier = MEAN_FIRST * row.per_slack;
        }
        iterate
    }

    fn evaluate(&mut self, rows: &Rows) {
        for (place, b) in rows.places.iter().zip(&mut self.b) {
            let at = place.of(&self.coefficients);
            *b = at[0];
            for row in place.rows.clone() {
                let state = &mut self.rows[row];
                (state.excess, state.slope) = rows.rows[row].excess(&at);
            }
        }
    }

    /// Mean product of slack and multiplier.
    fn mean(&self) -> f64 {
        let products = self.rows.iter().map(|row| row.slack * row.multiplier);
        products.sum::<f64>() / self.rows.len().max(1) as f64
    }

    fn worst_excess(&self) -> f64 {
        self.rows.iter().map(|row| row.excess).fold(0.0, f64::max)
    }

    fn advance(&mut self, window: &Window, step: &Step) {
        let primal = (STEP_SHARE * step.primal_share).min(1.0);
        let dual = (STEP_SHARE * step.dual_share).min(1.0);
        let free = &mut self.coefficients[window.free.clone()];
        for (value, change) in free.iter_mut().zip(&step.coefficients) {
            *value += primal * change[0];
        }
        self.evaluate(window.rows);
        for (row, [slack, multiplier]) in self.rows.iter_mut().zip(&step.rows) {
            row.set_slack(row.slack + primal * slack);
            row.multiplier += dual * multiplier;
        }
    }
}

impl RowState {
    /// A slack; the excess of a jerk's true bound over its tangent is used as well.
    fn set_slack(&mut self, slack: f64) {
        self.slack = slack.max(-self.excess);
        self.per_slack = self.slack.recip();
    }

    /// What slack and excess miss of each other.
    fn missing(&self) -> f64 {
        self.excess + self.slack
    }
}

impl Window<'_> {
    /// Predictor, then the corrector with what the predictor leaves.
    fn step(&self, iterate: &Iterate) -> Step {
        let (band, slope) = self.newton(iterate);
        let band = band.factored();
        let predictor = self.solved(iterate, &band, &slope, |_| 0.0);
        let left = iterate.rows.iter().zip(&predictor.rows);
        let left = left.map(|(row, [slack, multiplier])| {
            (row.slack + predictor.primal_share * slack)
                * (row.multiplier + predictor.dual_share * multiplier)
        });
        let (mean, count) = (iterate.mean(), iterate.rows.len().max(1) as f64);
        let centre = (left.sum::<f64>() / count / mean).clamp(0.0, 1.0).powi(3) * mean;
        self.solved(iterate, &band, &slope, |row| {
            let [slack, multiplier] = predictor.rows[row];
            centre - slack * multiplier
        })
    }

    /// The step to these products of slack and multiplier.
    fn solved(
        &self,
        iterate: &Iterate,
        band: &Factored,
        slope: &[f64],
        products: impl Fn(usize) -> f64,
    ) -> Step {
        let mut right = self.right_side(iterate, slope, &products);
        band.solve(&mut right);
        self.step_of(iterate, right, &products)
    }

    /// The place of a coefficient among the free ones.
    fn free_index(&self, coefficient: usize) -> Option<usize> {
        let index = coefficient.checked_sub(self.free.start)?;
        (index < self.free.len()).then_some(index)
    }

    /// Adds products of four neighbouring coefficients to the band.
    fn add(&self, band: &mut Band, first: usize, products: &[[f64; 4]; 4]) {
        for (k, products) in products.iter().enumerate() {
            if let Some(row) = self.free_index(first + k) {
                for (sum, product) in band.rows[row].iter_mut().zip(&products[k..]) {
                    *sum += product;
                }
            }
        }
    }

    /// Second derivatives of the Lagrangian, and the slope of the time.
    fn newton(&self, iterate: &Iterate) -> (Band, Vec<f64>) {
        let mut band = Band {
            rows: vec![[REGULAR, 0.0, 0.0, 0.0]; self.free.len()],
        };
        for place in &self.rows.places {
            let products = place_products(&iterate.rows[place.rows.clone()]);
            let mut of_basis = [[0.0; 4]; 4];
            for (basis, products) in place.basis.iter().zip(&products) {
                let weights = place.combined(products);
                for (of_basis, basis) in of_basis.iter_mut().zip(basis) {
                    for (sum, weight) in of_basis.iter_mut().zip(&weights) {
                        *sum += basis * weight;
                    }
                }
            }
            self.add(&mut band, place.first, &of_basis);
        }
        let slope = self.time_slope(iterate, &mut band);
        (band, slope)
    }

    /// The slope of the time, its second derivatives added to the band.
    fn time_slope(&self, iterate: &Iterate, band: &mut Band) -> Vec<f64> {
        let mut slope = vec![0.0; self.free.len()];
        let last = iterate.coefficients.len() - 1;
        for knot in self.free.start.max(2) - 1..=self.free.end.min(last - 1) {
            let around = &iterate.coefficients[knot - 1..=knot + 1];
            let b: f64 = around.iter().zip(AT_KNOT).map(|(c, w)| c * w).sum();
            let b = b.max(f64::MIN_POSITIVE);
            let root = b.sqrt();
            let (first, second) = (-0.5 / (b * root), 0.75 / (b * b * root));
            for (k, weight) in AT_KNOT.iter().enumerate() {
                if let Some(index) = self.free_index(knot - 1 + k) {
                    slope[index] += first * weight;
                }
            }
            self.add(
                band,
                knot - 1,
                &AT_KNOT.map(|k| AT_KNOT.map(|l| second * k * l)),
            );
        }
        slope
    }

    /// Right side of the Newton equations for these products of slack and multiplier.
    fn right_side(
        &self,
        iterate: &Iterate,
        slope: &[f64],
        products: impl Fn(usize) -> f64,
    ) -> Vec<[f64; 1]> {
        let mut right: Vec<[f64; 1]> = slope.iter().map(|slope| [-slope]).collect();
        for place in &self.rows.places {
            let mut force = [0.0; 3];
            for index in place.rows.clone() {
                let row = &iterate.rows[index];
                let share = (products(index) + row.multiplier * row.missing()) * row.per_slack;
                for (force, slope) in force.iter_mut().zip(&row.slope) {
                    *force -= share * slope;
                }
            }
            for (k, force) in place.combined(&force).into_iter().enumerate() {
                if let Some(index) = self.free_index(place.first + k) {
                    right[index][0] += force;
                }
            }
        }
        right
    }

    /// The steps of slacks and multipliers that go with a step of the coefficients.
    fn step_of(
        &self,
        iterate: &Iterate,
        coefficients: Vec<[f64; 1]>,
        products: impl Fn(usize) -> f64,
    ) -> Step {
        // Largest falls against what there is.
        let (mut primal_fall, mut dual_fall) = (1.0f64, 1.0f64);
        let mut rows = Vec::with_capacity(iterate.rows.len());
        for (place, b) in self.rows.places.iter().zip(&iterate.b) {
            let change = self.change_at(place, &coefficients);
            primal_fall = primal_fall.max(-change[0] / (FALL_MAX * b));
            for index in place.rows.clone() {
                let row = &iterate.rows[index];
                let [s0, s1, s2] = row.slope;
                let rise = s0 * change[0] + s1 * change[1] + s2 * change[2];
                let slack = -row.missing() - rise;
                let multiplier =
                    (products(index) - row.multiplier * slack) * row.per_slack - row.multiplier;
                primal_fall = primal_fall.max(-slack * row.per_slack);
                dual_fall = dual_fall.max(-multiplier / row.multiplier);
                rows.push([slack, multiplier]);
            }
        }
        Step {
            coefficients,
            rows,
            primal_share: primal_fall.recip(),
            dual_share: dual_fall.recip(),
        }
    }

    fn change_at(&self, place: &Place, coefficients: &[[f64; 1]]) -> [f64; 3] {
        let changes: [f64; 4] = std::array::from_fn(|k| {
            let index = self.free_index(place.first + k);
            index.map_or(0.0, |index| coefficients[index][0])
        });
        place.weighted(&changes)
    }
}

/// The sum of the rows' slopes, squared, by multiplier over slack.
fn place_products(rows: &[RowState]) -> [[f64; 3]; 3] {
    let mut products = [[0.0; 3]; 3];
    for row in rows {
        let weight = row.multiplier * row.per_slack;
        let weighted = row.slope.map(|value| value * weight);
        for (products, one) in products.iter_mut().zip(&row.slope) {
            for (sum, other) in products.iter_mut().zip(&weighted) {
                *sum += one * other;
            }
        }
    }
    products
}

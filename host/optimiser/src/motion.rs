//! Time and limits of the motion, as residuals at a few points of each span.
//!
//! In: knots of pose and speed. Out: value, gradient and Gauss-Newton curvature of the printing time, of the excess
//! over the limits, and of small regularising terms. With w the log of the span's time, q' the derivative by the
//! spline's parameter and e = exp(-w), the velocity is e q', the acceleration e² (q'' - w' q') and the jerk e³ (q''' -
//! 3 w' q'' - w'' q' + 2 w'² q'): path and time law are one problem. Not covered: flow.

use super::band::System;
use super::curve::{At, Basis, CHANNELS, Knot, PACE, PassKnots, Units, all_stay, blend};
use super::terms::Terms;
use crate::pose_limits::PoseLimits;

/// Points of a span at which limits are checked; the first and last just inside it.
const PLACES: usize = 3;
const PLACES_FROM: f64 = 0.02;
/// Orders of derivatives: 1 velocity, 2 acceleration, 3 jerk.
const ORDERS: usize = 4;
/// What the share of a limit may be at full speed: a little more, because spans are not quite even.
const FULL_SPEED_ROOM: f64 = 1.02;
/// Weights of excesses of a limit, against the others: the tip's speed, and jerk.
const TIP_SPEED_WEIGHT: f64 = 2.0;
const JERK_WEIGHT: f64 = 0.3;
/// Weight of changes of pace (w'', and this share of it w'), and of acceleration and jerk against their limits.
const PACE_WEIGHT: f64 = 0.1;
const PACE_BEND: f64 = 4.0;
const PACE_SLOPE: f64 = 0.3;
const SMOOTH_WEIGHT: f64 = 0.01;

/// Inverse limits by order of derivative, in the optimiser's units; 0 if there is no limit.
#[derive(Clone, Copy, Debug, Default)]
struct Order {
    /// Of the tip, in length.
    tip: f64,
    /// Of x, y and heading.
    axes: [f64; 3],
    /// Whether each axis has a limit that the tip's does not already hold.
    binds: [bool; 3],
}

/// Four by four sums over the knots of a span.
type Block = [[f64; 4]; 4];

/// What one span adds, by channels: geometry with itself, with the pace, x with y, the pace with itself.
#[derive(Clone, Copy, Default)]
pub struct SpanSums {
    slope: [[f64; 4]; 3],
    pace_slope: [f64; 4],
    own: [Block; 3],
    with_pace: [Block; 3],
    mixed: Block,
    pace: Block,
}

/// Derivatives of the spline at one place, by the spline's parameter and by time.
struct Place<'a> {
    basis: &'a Basis,
    /// q', q'', q'''.
    d: [Knot; ORDERS],
    /// Powers of e.
    e: [f64; ORDERS],
    /// Velocity, acceleration, jerk.
    by_time: [[f64; 3]; ORDERS],
}

/// The sample points of a span, without its end.
pub fn places() -> [Basis; PLACES] {
    let share = |s: usize| PLACES_FROM + (1.0 - 2.0 * PLACES_FROM) * s as f64 / (PLACES - 1) as f64;
    std::array::from_fn(|s| Basis::at(share(s)))
}

/// The terms of motion.
#[derive(Clone, Debug)]
pub struct Motion {
    orders: [Order; ORDERS],
    places: [Basis; PLACES + 1],
}

impl Motion {
    /// Within these limits.
    pub fn new(limits: &PoseLimits, units: &Units) -> Motion {
        let inverse = |limit: f64, order: i32, length: f64| {
            let scaled = limit * units.time_s.powi(order) / length;
            if scaled > 0.0 && scaled.is_finite() {
                1.0 / scaled
            } else {
                0.0
            }
        };
        let tips = [
            0.0,
            limits.tip_speed_mm_s,
            limits.tip_acceleration_mm_s2,
            0.0,
        ];
        let mut orders = [Order::default(); ORDERS];
        for (order, held) in orders.iter_mut().enumerate().skip(1) {
            held.tip = inverse(tips[order], order as i32, units.length_mm);
            for (m, axis) in limits.axes.iter().enumerate() {
                let limit = [0.0, axis.speed, axis.acceleration, axis.jerk][order];
                let length = if m == 2 { 1.0 } else { units.length_mm };
                let own = inverse(limit, order as i32, length);
                held.binds[m] = own > 0.0 && (m == 2 || own > held.tip);
                held.axes[m] = if m < 2 { own.max(held.tip) } else { own };
            }
        }
        let within = places();
        let end = Basis::at(1.0);
        Motion {
            orders,
            places: std::array::from_fn(|s| within.get(s).copied().unwrap_or(end)),
        }
    }

    /// Adds time, excess over limits weighed by `hardness`, and regularising terms, except for spans whose knots all stay;
    /// slopes where there is a system.
    pub fn add(&self, at: &At, hardness: f64, terms: &mut Terms, mut system: Option<&mut System>) {
        let knots = at.knots;
        for pass in at.passes {
            for knot in pass.span_starts().filter(|&knot| !all_stay(at.stays, knot)) {
                let is_last = knot + 1 == pass.first + pass.spans;
                let mut sums = SpanSums::default();
                let count = PLACES + usize::from(is_last);
                for (s, basis) in self.places[..count].iter().enumerate() {
                    let place = Place::at(basis, &knots[knot..]);
                    sums.add_time(&place, s < PLACES, terms);
                    for order in 1..ORDERS {
                        self.add_order(order, &place, hardness, terms, &mut sums);
                    }
                }
                if let Some(system) = system.as_deref_mut() {
                    sums.scatter(knot, system);
                }
            }
        }
    }

    /// The pace at which the tip passes the middle one of five knots at full speed; `None` where other limits do not permit that.
    pub fn full_speed_pace(&self, around: &[Knot]) -> Option<f64> {
        let way = [0, 1].map(|c| 0.5 * (around[3][c] - around[1][c]));
        let time = (way[0] * way[0] + way[1] * way[1]).sqrt() * self.orders[1].tip;
        let is_within = |span: &[Knot], basis: &Basis| {
            let weights = [&basis.first, &basis.second, &basis.third];
            weights.into_iter().zip(1..).all(|(weights, order)| {
                let value = blend(weights, span);
                let scales = &self.orders[order].axes;
                let shares = (0..3).map(|m| value[m].abs() * scales[m]);
                shares.fold(0.0, f64::max) <= FULL_SPEED_ROOM * time.powi(order as i32)
            })
        };
        let is_free = time > 0.0
            && [&around[..4], &around[1..]].iter().all(|span| {
                let mut places = self.places[..PLACES].iter();
                places.all(|basis| is_within(span, basis))
            });
        is_free.then(|| time.ln())
    }

    /// The printing time of spans of which a knot may move.
    pub fn time(&self, knots: &[Knot], passes: &[PassKnots], stays: &[bool]) -> f64 {
        let spans = passes.iter().flat_map(PassKnots::span_starts);
        let moving = spans.filter(|&knot| !all_stay(stays, knot));
        let of_span = |knot: usize| {
            let pace = |basis: &Basis| blend(&basis.value, &knots[knot..])[PACE];
            let places = self.places[..PLACES].iter();
            places.map(|basis| pace(basis).exp()).sum::<f64>() / PLACES as f64
        };
        moving.map(of_span).sum()
    }

    /// Adds what one order of derivative at one place exceeds, and its regularising term.
    fn add_order(
        &self,
        order: usize,
        place: &Place,
        hardness: f64,
        terms: &mut Terms,
        sums: &mut SpanSums,
    ) {
        let limit = &self.orders[order];
        let value = &place.by_time[order];
        let weight = hardness / PLACES as f64;
        let smooth = SMOOTH_WEIGHT / PLACES as f64;
        let (mut slope, mut curve, mut mixed) = ([0.0; 3], [0.0; 3], 0.0);
        for m in 0..3 {
            let scale = limit.axes[m];
            let share = value[m] * scale;
            let excess = share.abs() - 1.0;
            if excess > 0.0 && limit.binds[m] {
                let weight = if order == 3 {
                    JERK_WEIGHT * weight
                } else {
                    weight
                };
                terms.excess += 0.5 * weight * excess * excess;
                slope[m] += (weight * excess * scale).copysign(share);
                curve[m] += weight * scale * scale;
            }
            if order > 1 {
                terms.smooth += 0.5 * smooth * share * share;
                slope[m] += smooth * share * scale;
                curve[m] += smooth * scale * scale;
            }
        }
        let length = (value[0] * value[0] + value[1] * value[1]).sqrt();
        let excess = length * limit.tip - 1.0;
        if excess > 0.0 {
            let weight = if order == 1 {
                TIP_SPEED_WEIGHT * weight
            } else {
                weight
            };
            let (x, y) = (value[0] / length, value[1] / length);
            let (push, bend) = (weight * excess * limit.tip, weight * limit.tip * limit.tip);
            terms.excess += 0.5 * weight * excess * excess;
            slope[0] += push * x;
            slope[1] += push * y;
            curve[0] += bend * x * x;
            curve[1] += bend * y * y;
            mixed = bend * x * y;
        }
        if curve != [0.0; 3] {
            sums.add_residual(place, order, &slope, &curve, mixed);
        }
    }
}

impl<'a> Place<'a> {
    fn at(basis: &'a Basis, knots: &[Knot]) -> Place<'a> {
        let d = [
            blend(&basis.value, knots),
            blend(&basis.first, knots),
            blend(&basis.second, knots),
            blend(&basis.third, knots),
        ];
        let e1 = (-d[0][PACE]).exp();
        let e = [1.0, e1, e1 * e1, e1 * e1 * e1];
        let (w1, w2) = (d[1][PACE], d[2][PACE]);
        let first = |m: usize| e[1] * d[1][m];
        let second = |m: usize| e[2] * (d[2][m] - w1 * d[1][m]);
        let third = |m: usize| {
            e[3] * (d[3][m] - 3.0 * w1 * d[2][m] - w2 * d[1][m] + 2.0 * w1 * w1 * d[1][m])
        };
        let by_time = [
            [0.0; 3],
            std::array::from_fn(first),
            std::array::from_fn(second),
            std::array::from_fn(third),
        ];
        Place {
            basis,
            d,
            e,
            by_time,
        }
    }

    /// Derivatives of the value of an order: by its own channel's knots, the same for all.
    fn by_own(&self, order: usize) -> [f64; 4] {
        let (w1, w2) = (self.d[1][PACE], self.d[2][PACE]);
        let b = self.basis;
        let e = self.e[order];
        match order {
            1 => std::array::from_fn(|j| e * b.first[j]),
            2 => std::array::from_fn(|j| e * (b.second[j] - w1 * b.first[j])),
            _ => std::array::from_fn(|j| {
                let bend = b.third[j] - 3.0 * w1 * b.second[j];
                e * (bend - w2 * b.first[j] + 2.0 * w1 * w1 * b.first[j])
            }),
        }
    }

    /// Derivatives of the value of an order and channel by the knots' pace.
    fn by_pace(&self, order: usize, m: usize) -> [f64; 4] {
        let (value, e) = (self.by_time[order][m], self.e[order]);
        let w1 = self.d[1][PACE];
        let b = self.basis;
        let (d1, d2) = (self.d[1][m], self.d[2][m]);
        match order {
            1 => std::array::from_fn(|j| -value * b.value[j]),
            2 => std::array::from_fn(|j| -2.0 * value * b.value[j] - e * d1 * b.first[j]),
            _ => std::array::from_fn(|j| {
                let slope = (4.0 * w1 * d1 - 3.0 * d2) * b.first[j] - d1 * b.second[j];
                -3.0 * value * b.value[j] + e * slope
            }),
        }
    }
}

/// Adds the product of a column and a row.
#[inline]
fn add_product(block: &mut Block, column: &[f64; 4], row: &[f64; 4]) {
    for (entries, factor) in block.iter_mut().zip(column) {
        for (entry, other) in entries.iter_mut().zip(row) {
            *entry += factor * other;
        }
    }
}

#[inline]
fn add_scaled(sum: &mut [f64; 4], factor: f64, row: &[f64; 4]) {
    for (entry, other) in sum.iter_mut().zip(row) {
        *entry += factor * other;
    }
}

fn scaled(row: &[f64; 4], factor: f64) -> [f64; 4] {
    row.map(|entry| factor * entry)
}

impl SpanSums {
    /// Printing time, where this place counts for a part of the span, and the terms that keep the pace even.
    fn add_time(&mut self, place: &Place, counts: bool, terms: &mut Terms) {
        let (w1, w2) = (place.d[1][PACE], place.d[2][PACE]);
        let part = 1.0 / PLACES as f64;
        let time = if counts { part / place.e[1] } else { 0.0 };
        let even = PACE_WEIGHT * part;
        terms.time += time;
        terms.smooth += 0.5 * even * (PACE_BEND * w2 * w2 + PACE_SLOPE * w1 * w1);
        let b = place.basis;
        add_scaled(&mut self.pace_slope, time, &b.value);
        add_scaled(&mut self.pace_slope, even * PACE_BEND * w2, &b.second);
        add_scaled(&mut self.pace_slope, even * PACE_SLOPE * w1, &b.first);
        add_product(&mut self.pace, &b.value, &scaled(&b.value, time));
        let bend = scaled(&b.second, even * PACE_BEND);
        add_product(&mut self.pace, &b.second, &bend);
        let slope = scaled(&b.first, even * PACE_SLOPE);
        add_product(&mut self.pace, &b.first, &slope);
    }

    /// A term with this slope and curvature by the value of an order at a place; `mixed` couples x and y.
    fn add_residual(
        &mut self,
        place: &Place,
        order: usize,
        slope: &[f64; 3],
        curve: &[f64; 3],
        mixed: f64,
    ) {
        let own = place.by_own(order);
        let pace: [[f64; 4]; 3] = std::array::from_fn(|m| place.by_pace(order, m));
        for m in 0..3 {
            if curve[m] == 0.0 {
                continue;
            }
            let mut bent = scaled(&pace[m], curve[m]);
            if m < 2 {
                add_scaled(&mut bent, mixed, &pace[1 - m]);
            }
            add_scaled(&mut self.slope[m], slope[m], &own);
            add_scaled(&mut self.pace_slope, slope[m], &pace[m]);
            add_product(&mut self.own[m], &own, &scaled(&own, curve[m]));
            add_product(&mut self.with_pace[m], &own, &bent);
            add_product(&mut self.pace, &pace[m], &bent);
        }
        if mixed != 0.0 {
            add_product(&mut self.mixed, &own, &scaled(&own, mixed));
        }
    }

    /// A term with this slope and curvature by a value whose derivatives by x, y and heading of the four knots are
    /// `rows`. The heading is not coupled with the position: the remaining matrix is still positive.
    pub fn add_rows(&mut self, slope: f64, curve: f64, rows: &[[f64; 4]; 3]) {
        for (m, row) in rows.iter().enumerate() {
            add_scaled(&mut self.slope[m], slope, row);
            add_product(&mut self.own[m], row, &scaled(row, curve));
        }
        add_product(&mut self.mixed, &rows[0], &scaled(&rows[1], curve));
    }

    /// Adds the sums to the rows of the four knots from `knot` on.
    pub fn scatter(&self, knot: usize, system: &mut System) {
        for j in 0..4 {
            let base = CHANNELS * (knot + j);
            for m in 0..3 {
                system.gradient[base + m] += self.slope[m][j];
            }
            system.gradient[base + PACE] += self.pace_slope[j];
            for i in j..4 {
                let ahead = CHANNELS * (i - j);
                for m in 0..3 {
                    let row = system.band.row_mut(base + m);
                    row[ahead] += self.own[m][j][i];
                    row[ahead + PACE - m] += self.with_pace[m][j][i];
                }
                system.band.row_mut(base)[ahead + 1] += self.mixed[j][i];
                let row = system.band.row_mut(base + PACE);
                row[ahead] += self.pace[j][i];
                if i > j {
                    for m in 0..3 {
                        row[ahead + m - PACE] += self.with_pace[m][i][j];
                    }
                    system.band.row_mut(base + 1)[ahead - 1] += self.mixed[i][j];
                }
            }
        }
    }
}

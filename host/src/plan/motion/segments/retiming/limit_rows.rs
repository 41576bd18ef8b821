//! The limits of a fitted motion as rows over the square of its rate.
//!
//! In: a spline with its fit errors, the limits, a stretch of the rate's own spline. Out: rows at
//! points a few ticks apart, including the ends of its spans. At a rate p(t) with b = p², a joint that
//! had q', q'', q''' (by the old time) has the speed q' sqrt(b), the acceleration q'' b + q' b' / 2
//! and the jerk (q''' b + 3/2 q'' b' + 1/2 q' b'') sqrt(b). All rows are scaled to a bound of 1. Not
//! covered: the lag of pressure advance and flow events, which the check slows down.

use super::super::spline::{RestSpline, evaluate};
use super::PaceGrid;
use crate::plan::motion::joint_limits::{JointPoint, MotionLimits, joint_point};
use crate::plan::motion::motion_error::MotionError;
use crate::plan::route::path_curve::CurvePoint;
use headway_optimiser::least_time::{Place, Row, Rows};
use headway_protocol::units::{CHANNEL_VOLUME, CHANNELS};
use nalgebra::Vector3;
use std::ops::Range;

/// Shares of the limits that are aimed at: the fit of the new motion overshoots by the rest.
const SPEED_AIM: f64 = 0.998;
const ACCELERATION_AIM: f64 = 0.978;
const JERK_AIM: f64 = 0.92;
/// Longest piece between two places.
const PIECE_TICKS: f64 = 5.0;
/// Most that one round slows or speeds up, as b.
const SQUARED_PACE_MIN: f64 = 0.3;
const SQUARED_PACE_MAX: f64 = 4.0;
/// Squared rate below which a result is rejected: half of the required one. Steps that did not
/// converge may end near 0 or below, where the motion would never end.
pub const SQUARED_PACE_FLOOR: f64 = 0.5 * SQUARED_PACE_MIN;
/// The pace as it is: (b, b', b'').
const AS_IT_IS: [f64; 3] = [1.0, 0.0, 0.0];
/// Squared pace that is worth the search.
const ROOM: f64 = 1.01;
/// Rows whose weights sum to less cannot bind at any pace within the bounds above.
const WEIGHT_MIN: f64 = 0.5;
/// Factor of the weights of b' and b'' in that sum.
const CHANGE_WEIGHT: f64 = 0.7;
/// Directions around the tip's acceleration in which it is bounded, sine and cosine: 0 and ±20°.
const TIP_DIRECTIONS: [(f64, f64); 3] = [
    (0.0, 1.0),
    (0.342_020_143_325_668_7, 0.939_692_620_785_908_4),
    (-0.342_020_143_325_668_7, 0.939_692_620_785_908_4),
];

/// The rows of a window.
#[derive(Clone, Debug, Default)]
pub struct WindowRows {
    /// Places and rows.
    pub held: Rows,
    /// True where the motion could go faster by a speed limit somewhere, or has to go slower.
    pub have_room: bool,
}

/// A fitted motion.
#[derive(Clone, Copy)]
pub struct Motion<'a> {
    /// Its spline.
    pub spline: &'a RestSpline,
    /// For each span the speed that its fit permits, relative to its current one.
    pub fit_slowing: &'a [f64],
    /// Tick at which each span begins.
    pub first_ticks: &'a [usize],
    /// Requested tip speeds at its ticks; empty if there are none.
    pub asked_at_tick: &'a [f64],
    /// What binds it.
    pub limits: &'a MotionLimits,
}

impl Motion<'_> {
    fn tip_speed_at_mm_s(&self, tick: f64) -> f64 {
        let last = self.asked_at_tick.len().saturating_sub(1).max(1);
        let (asked, share) = (self.asked_at_tick, tick / last as f64);
        self.limits.tip_speed_at_share_mm_s(asked, share)
    }
}

impl WindowRows {
    /// The rows that see a coefficient in `free`, with places by coefficients from `base` on.
    pub fn of_window(
        motion: &Motion,
        grid: &PaceGrid,
        free: &Range<usize>,
        base: usize,
    ) -> Result<Self, MotionError> {
        let mut rows = Self::default();
        let cells = free.start.saturating_sub(3)..free.end;
        let from_tick = cells.start as f64 * grid.knot_ticks;
        let from_span = motion
            .first_ticks
            .partition_point(|&tick| (tick as f64) <= from_tick);
        for span in from_span.saturating_sub(1)..motion.first_ticks.len() {
            let start_tick = motion.first_ticks[span] as f64;
            if grid.place(start_tick).0 >= cells.end {
                break;
            }
            let cubics = motion.spline.span_polynomials(span);
            let ticks = f64::from(motion.spline.durations_ticks[span]);
            let pieces = (ticks / PIECE_TICKS).ceil().max(2.0);
            for piece in 0..=pieces as usize {
                let tick = ticks * piece as f64 / pieces;
                let (first, s) = grid.place(start_tick + tick);
                if !cells.contains(&first) {
                    continue;
                }
                let point = evaluate(&cubics, tick, motion.limits.servo_hz);
                let joints = joint_point(&motion.limits.kinematics, &point)?;
                let from = rows.held.rows.len();
                rows.push_jerk(&joints, motion.limits, grid);
                // What else a span's start has is that of the end before it.
                if piece > 0 {
                    rows.push_accelerations(&point, &joints, motion.limits, grid);
                    let slowing = motion.fit_slowing[span];
                    let tip_mm_s = motion.tip_speed_at_mm_s(start_tick + tick);
                    let share = speed_share(&point, &joints, motion.limits, tip_mm_s);
                    rows.push_pace(share.max(slowing));
                }
                let own = &rows.held.rows[from..];
                rows.have_room |= own.iter().any(|row| row.excess(&AS_IT_IS).0 > 0.0);
                rows.held.places.push(Place {
                    first: first - base,
                    basis: grid.basis(s),
                    rows: from..rows.held.rows.len(),
                });
            }
        }
        Ok(rows)
    }

    /// A row for each sign, where it can bind.
    fn push_both(&mut self, weights: [f64; 3], limit: f64, is_jerk: bool) {
        let weights = weights.map(|weight| weight / limit);
        let [w0, w1, w2] = weights.map(f64::abs);
        if w0 + CHANGE_WEIGHT * (w1 + w2) > WEIGHT_MIN {
            for sign in [1.0, -1.0] {
                self.held.rows.push(Row {
                    weights: weights.map(|weight| sign * weight),
                    is_jerk,
                    bound: 1.0,
                });
            }
        }
    }

    fn push_jerk(&mut self, joints: &JointPoint, limits: &MotionLimits, grid: &PaceGrid) {
        let knot_hz = grid.knot_hz;
        let bounded = limits.bounded([&joints.first, &joints.second, &joints.third]);
        for (limit, [first, second, third]) in bounded {
            let weights = [
                third,
                1.5 * knot_hz * second,
                0.5 * knot_hz * knot_hz * first,
            ];
            self.push_both(weights, limit.jerk_max * JERK_AIM, true);
        }
    }

    fn push_accelerations(
        &mut self,
        point: &CurvePoint,
        joints: &JointPoint,
        limits: &MotionLimits,
        grid: &PaceGrid,
    ) {
        let half_hz = 0.5 * grid.knot_hz;
        for (limit, [first, second]) in limits.bounded([&joints.first, &joints.second]) {
            let weights = [second, half_hz * first, 0.0];
            self.push_both(weights, limit.acceleration_max * ACCELERATION_AIM, false);
        }
        let (first, second) = (point.first[CHANNEL_VOLUME], point.second[CHANNEL_VOLUME]);
        let flow_max = limits.flow_slope_max_mm3_s2() * ACCELERATION_AIM;
        self.push_both([second, half_hz * first, 0.0], flow_max, false);
        // The circle of the tip's accelerations by its tangents around where it is used.
        let (velocity, acceleration) = (tip(&point.first), tip(&point.second));
        let limit = limits.tip_acceleration_mm_s2 * ACCELERATION_AIM;
        let length = acceleration.norm();
        if length < 1e-9 {
            return;
        }
        let along = acceleration / length;
        let across = velocity - along * velocity.dot(&along);
        let across = across.try_normalize(1e-9).unwrap_or_default();
        for (sin, cos) in TIP_DIRECTIONS {
            let direction = along * cos + across * sin;
            let weights = [
                acceleration.dot(&direction) / limit,
                half_hz * velocity.dot(&direction) / limit,
                0.0,
            ];
            if weights[0] + weights[1].abs() > WEIGHT_MIN {
                self.held.rows.push(Row {
                    weights,
                    is_jerk: false,
                    bound: 1.0,
                });
            }
        }
    }

    /// Bounds b on both sides; `speed` is the largest share of a speed limit at the old pace.
    fn push_pace(&mut self, speed: f64) {
        let most = (SPEED_AIM / speed.max(1e-9)).powi(2).min(SQUARED_PACE_MAX);
        self.have_room |= most > ROOM;
        for (weight, bound) in [(1.0 / most, 1.0), (-1.0 / SQUARED_PACE_MIN, -1.0)] {
            self.held.rows.push(Row {
                weights: [weight, 0.0, 0.0],
                is_jerk: false,
                bound,
            });
        }
    }
}

fn tip(channels: &[f64; CHANNELS]) -> Vector3<f64> {
    Vector3::new(channels[0], channels[1], channels[2])
}

/// Largest share of a speed limit: tip, joints, flow and extruder.
fn speed_share(
    point: &CurvePoint,
    joints: &JointPoint,
    limits: &MotionLimits,
    tip_mm_s: f64,
) -> f64 {
    let of_joints = limits.bounded([&joints.first]);
    let share = of_joints
        .map(|(limit, [speed])| speed.abs() / limit.speed_max)
        .fold(tip(&point.first).norm() / tip_mm_s, f64::max);
    share.max(point.first[CHANNEL_VOLUME].abs() / limits.flow_rate_max_mm3_s())
}

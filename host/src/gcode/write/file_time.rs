//! Time that a controller's own planner takes for a file's moves as they are, by the model of [`super::controller_time`].
//!
//! In: passes with their ways and speeds (mm, mm/s), limits. Out: seconds.

use super::controller_time::ControllerTime;
use super::dialect::Dialect;
use super::limits::{AXES, AxisLimits, EXTRUDER};
use crate::gcode::{GcodePass, Leg, Place, Push};

/// Seconds for passes with filament of a cross-section; pushes without a rate have this one, mm³/s.
pub fn file_time_s(
    passes: &[GcodePass],
    dialect: Dialect,
    limits: AxisLimits,
    filament_mm2: f64,
    push_mm3_s: f64,
) -> f64 {
    let mut time = ControllerTime::new(dialect, limits);
    let mut at: Option<Place> = None;
    for pass in passes {
        let mut go = |time: &mut ControllerTime, to: &Place, leg: &Leg| {
            let from = at.replace(*to).unwrap_or(*to);
            let mut by = [0.0; AXES];
            for (by, (to, from)) in by.iter_mut().zip(to.tip_mm.iter().zip(&from.tip_mm)) {
                *by = to - from;
            }
            by[EXTRUDER] = leg.volume_mm3.unwrap_or(0.0).max(0.0) / filament_mm2;
            let tip_mm = to.distance_mm(&from);
            time.add(by, tip_mm, tip_mm / leg.speed_mm_s);
        };
        let push = |time: &mut ControllerTime, push: Option<Push>| {
            let mut by = [0.0; AXES];
            let push = push.unwrap_or_default();
            let mm3 = push.mm3.unwrap_or(0.0);
            by[EXTRUDER] = mm3 / filament_mm2;
            time.add(by, 0.0, mm3 / push.rate_mm3_s.unwrap_or(push_mm3_s));
        };
        let ways = pass.travel.iter().chain(pass.points.first());
        ways.zip(&pass.travel_legs)
            .for_each(|(to, leg)| go(&mut time, to, leg));
        push(&mut time, pass.prime);
        let beads = pass.points.iter().skip(1).zip(&pass.legs);
        beads.for_each(|(to, leg)| go(&mut time, to, leg));
        push(&mut time, pass.retract);
    }
    time.finish().0
}

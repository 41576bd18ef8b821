//! Software PWM: the main loop prepares a period, the servo interrupt outputs it.
//!
//! In: duties, 0 to 1, at 10 Hz. Out: levels of the outputs, one bit each, at each servo tick. A tick
//! without an edge costs a subtraction and a branch; the step interrupt is not involved. A schedule is
//! valid for [`PERIODS_MAX`] periods: if the main loop stalls, every heater goes off.

use super::unit_share;
use heapless::Vec;

/// Outputs.
pub const CHANNELS: usize = 6;
/// Servo ticks of a heater's period: 100 ms at 2 kHz, Klipper's `pwm_cycle_time`, and half a per cent.
pub const HEATER_TICKS: u16 = 200;
/// Of a fan's: 10 ms, Klipper's `cycle_time` of fans. It divides the heaters'.
pub const FAN_TICKS: u16 = 20;
/// Periods that a schedule may be played: one is the rule.
pub const PERIODS_MAX: u8 = 3;
/// Edges of a period: two of every fan's period that are not those of another's, one of every heater.
const EDGES_MAX: usize = (HEATER_TICKS / FAN_TICKS) as usize * (1 + FANS_MAX) + CHANNELS + 1;
/// Fans that are neither off nor full on.
const FANS_MAX: usize = 3;

/// Levels from a servo tick of the period on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Edge {
    /// Ticks until the next.
    ticks: u16,
    levels: u8,
}

/// A period, drawn up.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Schedule {
    edges: Vec<Edge, EDGES_MAX>,
}

impl Schedule {
    /// Of duties and whether each is a fan's.
    pub fn new(duties: &[(f32, bool); CHANNELS]) -> Self {
        let on_ticks = duties.map(|(duty, is_fan)| {
            let period = if is_fan { FAN_TICKS } else { HEATER_TICKS };
            (period, (unit_share(duty) * f32::from(period) + 0.5) as u16)
        });
        let mut edges = Vec::new();
        let mut tick = 0;
        while tick < HEATER_TICKS {
            let mut levels = 0;
            let mut next = HEATER_TICKS;
            for (channel, (period, on)) in on_ticks.iter().enumerate() {
                let begun = tick - tick.checked_rem(*period).unwrap_or(0);
                let is_on = tick - begun < *on;
                levels |= u8::from(is_on) << channel;
                if *on > 0 && on < period {
                    next = next.min(begun + if is_on { *on } else { *period });
                }
            }
            let ticks = next - tick;
            if edges.push(Edge { ticks, levels }).is_err() {
                // Cannot be, by the count; then nothing is on.
                return Self::default();
            }
            tick = next;
        }
        Self { edges }
    }
}

/// Plays schedules, in the servo interrupt.
#[derive(Clone, Debug, Default)]
#[repr(C)]
pub struct SoftPwm {
    left_ticks: u32,
    next_edge: usize,
    periods_left: u8,
    has_next: bool,
    schedule: Schedule,
    next: Schedule,
}

impl SoftPwm {
    /// Uses a schedule for the next periods; it begins at the end of the current one.
    pub fn load(&mut self, schedule: &Schedule) {
        self.next.clone_from(schedule);
        self.has_next = true;
    }

    /// All off from the next tick on, until a schedule is loaded.
    pub fn cut(&mut self) {
        self.schedule.edges.clear();
        self.has_next = false;
        self.left_ticks = 0;
    }

    /// One servo tick: the levels, where they may have changed.
    #[inline(always)]
    pub fn tick(&mut self) -> Option<u8> {
        if self.left_ticks > 1 {
            self.left_ticks -= 1;
            return None;
        }
        Some(self.edge())
    }

    #[inline(never)]
    fn edge(&mut self) -> u8 {
        if self.next_edge >= self.schedule.edges.len() {
            self.begin_period();
        }
        let Some(edge) = self.schedule.edges.get(self.next_edge) else {
            self.left_ticks = 0;
            return 0;
        };
        self.next_edge += 1;
        self.left_ticks = edge.ticks.into();
        edge.levels
    }

    fn begin_period(&mut self) {
        self.next_edge = 0;
        if core::mem::take(&mut self.has_next) {
            core::mem::swap(&mut self.schedule, &mut self.next);
            self.periods_left = PERIODS_MAX;
        } else if self.periods_left == 0 {
            self.schedule.edges.clear();
        }
        self.periods_left = self.periods_left.saturating_sub(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks that each channel is on within so many.
    fn played(pwm: &mut SoftPwm, ticks: u32) -> [u32; CHANNELS] {
        let mut on = [0; CHANNELS];
        let mut levels = 0;
        for _ in 0..ticks {
            levels = pwm.tick().unwrap_or(levels);
            for (channel, on) in on.iter_mut().enumerate() {
                *on += u32::from(levels >> channel & 1);
            }
        }
        on
    }

    #[test]
    fn a_period_has_the_duties_that_were_asked_for() {
        let mut duties = [(0.0, false); CHANNELS];
        for step in 0..=200 {
            let duty = step as f32 / 200.0;
            duties = [
                (duty, false),
                (1.0 - duty, false),
                (duty, true),
                (1.0, true),
                (0.0, true),
                (0.37, true),
            ];
            let mut pwm = SoftPwm::default();
            pwm.load(&Schedule::new(&duties));
            let on = played(&mut pwm, 200);
            assert_eq!([on[0], on[1], on[3], on[4]], [step, 200 - step, 200, 0]);
            assert!(on[2].abs_diff(step) <= 5 && on[5] == 70, "{on:?}");
        }
        assert_eq!(duties[0].0, 1.0);
    }

    #[test]
    fn a_main_loop_that_stays_away_leaves_everything_off() {
        let mut pwm = SoftPwm::default();
        assert_eq!(played(&mut pwm, 100), [0; CHANNELS]);
        let full = Schedule::new(&[(1.0, false); CHANNELS]);
        pwm.load(&full);
        let on = played(&mut pwm, 10_000);
        assert_eq!(on, [u32::from(PERIODS_MAX) * 200; CHANNELS]);
        assert_eq!(played(&mut pwm, 1000), [0; CHANNELS]);
        pwm.load(&full);
        assert_eq!(played(&mut pwm, 50), [50; CHANNELS]);
        pwm.cut();
        assert_eq!(played(&mut pwm, 1000), [0; CHANNELS]);
    }
}

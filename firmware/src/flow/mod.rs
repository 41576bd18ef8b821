//! The extruder's target: e = V + K dV/dt + losses + primes - retracts, in motor steps.
//!
//! In: the volume channel's position, primes and retracts that wait (`event_queue`) or that a rest requires (`hold`).
//! Out: the extruder motor's target, and whether it keeps its limits (`extruder_limits`).
//!
//! - V is the deposited volume, a channel of the motion: exact integer base plus small offset.
//! - dV/dt is the mean over the last window (a box by look-back): (V(t) - V(t - W)) / W, which is that of W/2
//!   ago, so everything else is delayed by that (`steps/delay.rs`), and exactly 0 once V has rested for W. If
//!   a shaper's delay is longer, the advance is delayed too. The window limits the effect of a change of path
//!   rate on the extruder's speed.
//! - Losses: where a share of the flow does not arrive (`[extruder] flow_loss`), the motor turns by as much more,
//!   from its rate of the moment, V' + K V'', so that pauses, overrides and the advance count. Their sum belongs to
//!   V: it is entered with it, and what it has grown by since is added to what comes out of the delay.
//! - Primes and retracts run in real time, along x³ (10 - 15 x + 6 x²), and end exactly on their
//!   integer volume.

pub mod event_queue;
pub mod extruder_limits;
pub mod hold;
mod tick_curve;

use crate::configuration::MachineConfiguration;
use crate::design::{
    ACTIVE_EVENTS_MAX, ADVANCE_WINDOW_TICKS_MAX, FLOW_OVERRIDE_PERCENT_PER_S, LINE_TICKS,
};
use crate::steps::delay::{advance_centre_ticks, window_ticks};
use crate::steps::{ScaledUnits, StepScale, TARGET_SHIFT, Target};
use headway_protocol::control::EVENT_VOLUME_UNITS_MAX;
use headway_protocol::segment::{FlowAction, FlowEvent};
use headway_protocol::units::{CHANNEL_VOLUME, UNITS_PER_NATURAL};
use heapless::Vec;
use tick_curve::TickCurve;

/// Flow as planned.
pub const UNSCALED_Q16: u32 = 1 << 16;
/// Fraction bits of [`Flow::advance_gain`].
const GAIN_BITS: u32 = 20;
/// Fraction bits in the window, which wraps at 32,768 steps, and of the advance.
const WINDOW_BITS: u32 = 16;
const ADVANCE_BITS: u32 = 22;
/// Servo ticks of flow that are kept: the longest window, and the longest wait.
const WINDOW_ROWS: usize = ADVANCE_WINDOW_TICKS_MAX + LINE_TICKS;

/// A prime or retract in progress.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ActiveEvent {
    /// Signed volume in units; the protocol lets no more than a billion through.
    volume_units: i32,
    /// The same, rounded once and for all.
    volume: f32,
    duration_ticks: u32,
    elapsed_ticks: u32,
}

impl ActiveEvent {
    /// Volume moved after `elapsed` ticks, in units.
    fn share_units(&self, elapsed_ticks: u32) -> f32 {
        let x = elapsed_ticks as f32 / self.duration_ticks as f32;
        self.volume * x * x * x * (10.0 + x * (6.0 * x - 15.0))
    }
}

/// The extruder's state.
#[derive(Clone, Debug)]
// Fields that every tick uses are first.
#[repr(C)]
pub struct Flow {
    /// Advance by the increase over the window, 2^-20.
    advance_gain: i32,
    /// A curve is to be followed.
    is_curved: bool,
    window_ticks: usize,
    /// Servo ticks that the advance waits.
    wait_ticks: usize,
    /// Rows of the window in use: both together.
    length: usize,
    newest: usize,
    /// Sum of all events that are over, as a distance.
    settled: Target,
    scaling: FlowScaling,
    curves: Curves,
    active: Vec<ActiveEvent, ACTIVE_EVENTS_MAX>,
    scale: StepScale,
    /// Sum of all events that are over, exact.
    settled_exact: ScaledUnits,
}

/// V over the last window and delay, 2^-16 steps, wrapping: large, and so stored apart from the data of
/// every tick.
#[derive(Clone, Debug)]
pub struct FlowWindow {
    rows: [i32; WINDOW_ROWS],
    /// Sum of the losses, 2^-22 steps, wrapping at 1024.
    lost: [i32; WINDOW_ROWS],
}

impl FlowWindow {
    /// Nothing has flowed.
    pub const NONE: Self = Self {
        rows: [0; WINDOW_ROWS],
        lost: [0; WINDOW_ROWS],
    };
}

/// The advance that is not in proportion, and what the motor turns beyond what is to arrive.
#[derive(Clone, Debug)]
struct Curves {
    /// By the increase over the window.
    advance: TickCurve,
    /// By the motor's way in a tick.
    loss: TickCurve,
    /// Servo ticks from a target's entry to its steps.
    delay_ticks: usize,
    /// Planned place and advance of the last tick's steps.
    place: i32,
    advance_before: i64,
    /// Sum of the losses, 2^-22 steps.
    sum: i64,
}

impl Curves {
    fn new(machine: &MachineConfiguration, servo_hz: u32, wait_ticks: usize, gain: f64) -> Self {
        let (extruder, curves) = (&machine.extruder, &machine.curves);
        let steps = extruder.steps_per_mm3;
        let tick_s = 1.0 / f64::from(servo_hz.max(1));
        let window_s = f64::from(window_ticks(extruder, servo_hz)) * tick_s;
        Self {
            advance: match curves.advance.is_empty() {
                true => TickCurve::straight(gain),
                false => TickCurve::of(&curves.advance_volume(), 0.0, [window_s * steps, steps]),
            },
            loss: TickCurve::of(&curves.asked(), 1.0, [tick_s * steps; 2]),
            delay_ticks: wait_ticks + advance_centre_ticks(extruder, servo_hz) as usize,
            place: 0,
            advance_before: 0,
            sum: 0,
        }
    }
}

/// Flow override: the volume deposited above or below the plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FlowScaling {
    /// There was a request since the last declaration.
    is_asked: bool,
    wanted_q16: u32,
    factor_q16: u32,
    /// Change of the factor in a servo tick.
    slope_q16: u32,
    /// Position deposited in the last tick, once the factor has not been 1.
    last: Option<i64>,
    /// Sum of the additions, 2^-31 steps.
    extra: i64,
}

impl FlowScaling {
    fn new(servo_hz: u32) -> Self {
        let per_s_q16 = FLOW_OVERRIDE_PERCENT_PER_S * UNSCALED_Q16 / 100;
        Self {
            is_asked: false,
            wanted_q16: UNSCALED_Q16,
            factor_q16: UNSCALED_Q16,
            slope_q16: (per_s_q16 / servo_hz.max(1)).max(1),
            last: None,
            extra: 0,
        }
    }

    fn ask(&mut self, wanted_q16: u32) {
        self.wanted_q16 = wanted_q16;
        self.is_asked |= wanted_q16 != UNSCALED_Q16;
    }

    /// The addition to the planned `place`.
    #[inline(never)]
    fn extra(&mut self, place: Target) -> Target {
        let deposited = place.position();
        // A target has 32 bits of whole steps: a position wraps with 63.
        let way = deposited.wrapping_sub(self.last.unwrap_or(deposited)) << 1 >> 1;
        self.last = Some(deposited);
        let up = self.factor_q16.saturating_add(self.slope_q16);
        let down = self.factor_q16.saturating_sub(self.slope_q16);
        // Not `clamp`, which could panic.
        self.factor_q16 = self.wanted_q16.max(down).min(up);
        let surplus_q16 = i64::from(self.factor_q16) - i64::from(UNSCALED_Q16);
        self.extra += (way * surplus_q16) >> 16;
        Target::of_distance(self.extra)
    }

    /// Restarts from a declared position; the factor stays.
    fn settle(&mut self) {
        self.factor_q16 = self.wanted_q16;
        self.is_asked = self.wanted_q16 != UNSCALED_Q16;
        self.last = None;
        self.extra = 0;
    }
}

impl Flow {
    /// At rest, nothing deposited. A window longer than [`ADVANCE_WINDOW_TICKS_MAX`] is cut. The advance
    /// waits for `wait_ticks` ([`crate::steps::delay::Delays`]).
    pub fn new(machine: &MachineConfiguration, servo_hz: u32, wait_ticks: u32) -> Self {
        let extruder = &machine.extruder;
        let window_ticks = window_ticks(extruder, servo_hz) as usize;
        let wait_ticks = (wait_ticks as usize).min(LINE_TICKS);
        let per_tick = extruder.pressure_advance_s * f64::from(servo_hz) / window_ticks as f64;
        let steps_per_unit = extruder.steps_per_mm3 / UNITS_PER_NATURAL[CHANNEL_VOLUME];
        Self {
            scale: StepScale::new(steps_per_unit),
            advance_gain: (per_tick * f64::from(1 << GAIN_BITS) + 0.5) as i32,
            is_curved: !machine.curves.is_none(),
            curves: Curves::new(machine, servo_hz, wait_ticks, per_tick),
            window_ticks,
            wait_ticks,
            length: window_ticks + wait_ticks,
            newest: 0,
            active: Vec::new(),
            settled_exact: ScaledUnits::default(),
            settled: Target::default(),
            scaling: FlowScaling::new(servo_hz),
        }
    }

    /// Flow override in per cent; the change is gradual.
    pub fn set_override(&mut self, percent: u16) {
        let wanted_q16 = (u32::from(percent) * UNSCALED_Q16 + 50) / 100;
        self.scaling.ask(wanted_q16);
    }

    /// Requested flow override, per cent.
    pub fn override_percent(&self) -> u16 {
        ((self.scaling.wanted_q16 * 100 + UNSCALED_Q16 / 2) / UNSCALED_Q16) as u16
    }

    /// Present flow factor, 2^-16.
    #[inline]
    pub fn factor_q16(&self) -> u32 {
        self.scaling.factor_q16
    }

    /// Uses this scale for the volumes of coming events. Only at rest.
    pub fn take_scale(&mut self, scale: StepScale) {
        self.scale = scale;
    }

    /// Declares the deposited volume, without an active event. Only at rest.
    pub fn declare(&mut self, window: &mut FlowWindow, place: Target) {
        self.active.clear();
        self.settled_exact = ScaledUnits::default();
        self.settled = Target::default();
        self.scaling.settle();
        window.rows = [place.coarse(); WINDOW_ROWS];
        window.lost = [0; WINDOW_ROWS];
        let curves = &mut self.curves;
        (curves.place, curves.advance_before, curves.sum) = (place.coarse(), 0, 0);
    }

    /// Begins a prime or retract in this servo tick, before its target. False if too many run already.
    pub fn begin(&mut self, event: &FlowEvent) -> bool {
        self.begin_at(event, 0)
    }

    /// The same after the tick's target, in which nothing has moved yet: so a tick that begins an event
    /// need not compute it.
    pub fn begin_after_target(&mut self, event: &FlowEvent) -> bool {
        self.begin_at(event, 1)
    }

    fn begin_at(&mut self, event: &FlowEvent, elapsed_ticks: u32) -> bool {
        let volume = event.volume_units.min(EVENT_VOLUME_UNITS_MAX) as i32;
        let volume_units = match event.action {
            FlowAction::Prime => volume,
            FlowAction::Retract => -volume,
        };
        let active = ActiveEvent {
            volume_units,
            volume: volume_units as f32,
            duration_ticks: event.duration_ticks.0.max(1),
            elapsed_ticks,
        };
        self.active.push(active).is_ok()
    }

    /// True while a prime or retract runs.
    pub fn is_active(&self) -> bool {
        !self.active.is_empty()
    }

    /// The longest prime or retract in progress, servo ticks; 0 if there is none.
    pub fn longest_active_ticks(&self) -> u32 {
        let durations = self.active.iter().map(|event| event.duration_ticks);
        durations.max().unwrap_or(0)
    }

    /// How long a flow is remembered by pressure advance, servo ticks.
    pub fn memory_ticks(&self) -> u32 {
        let lost_ticks = match self.is_curved {
            true => self.curves.delay_ticks,
            false => 0,
        };
        (self.length + lost_ticks) as u32
    }

    /// Stops all events at once, keeping the volume moved so far.
    pub fn cut(&mut self) {
        if self.active.is_empty() {
            return;
        }
        for event in &self.active {
            // The share that the last tick's target had.
            let units = event.share_units(event.elapsed_ticks.saturating_sub(1)) as i32;
            self.settled_exact = self.scale.advanced(&self.settled_exact, units);
        }
        self.active.clear();
        self.settled = Target::of_distance(self.settled_exact.position);
    }

    /// Target of this servo tick without the advance, and the advance, 2^-22 steps; `planned` is the
    /// current V. To be called exactly once per servo tick.
    #[inline(always)]
    pub fn target(&mut self, window: &mut FlowWindow, planned: Target) -> (Target, i64) {
        let mut place = planned;
        if self.scaling.is_asked {
            place = place.plus(self.scaling.extra(place));
        }
        let gained = self.gained(window, place.coarse());
        let gain = i64::from(self.advance_gain);
        let mut advance = (i64::from(gained) * gain) >> (GAIN_BITS + WINDOW_BITS - ADVANCE_BITS);
        if self.is_curved {
            (place, advance) = self.curved(window, place, gained);
        }
        if !self.active.is_empty() {
            place = place.moved(self.progress());
        }
        (place.plus(self.settled), advance)
    }

    /// Increase of V over the window, 2^-16 steps; `now`: V in the same, wrapping.
    #[inline]
    fn gained(&mut self, window: &mut FlowWindow, now: i32) -> i32 {
        self.newest += 1;
        if self.newest >= self.length {
            self.newest = 0;
        }
        let oldest = &mut window.rows[self.newest % WINDOW_ROWS];
        let before = core::mem::replace(oldest, now);
        let mut due = now;
        if self.wait_ticks != 0 {
            let back = match self.newest.checked_sub(self.wait_ticks) {
                Some(back) => back,
                None => self.newest + self.window_ticks,
            };
            due = window.rows[back % WINDOW_ROWS];
        }
        due.wrapping_sub(before)
    }

    /// Target and advance by the curves: the losses are those of the steps that are made in this tick.
    #[inline(never)]
    fn curved(&mut self, window: &mut FlowWindow, place: Target, gained: i32) -> (Target, i64) {
        let curves = &mut self.curves;
        let advance = curves.advance.at(gained);
        let back = match self.newest.checked_sub(curves.delay_ticks) {
            Some(back) => back,
            None => (self.newest + self.length).wrapping_sub(curves.delay_ticks),
        };
        let due = window.rows[back % WINDOW_ROWS];
        let pushed = advance.wrapping_sub(curves.advance_before) >> (ADVANCE_BITS - WINDOW_BITS);
        let way = due.wrapping_sub(curves.place).wrapping_add(pushed as i32);
        (curves.place, curves.advance_before) = (due, advance);
        if way > 0 {
            // Melt that is pulled back is not lost.
            curves.sum = curves.sum.wrapping_add(curves.loss.at(way));
        }
        let sum = curves.sum as i32;
        window.lost[self.newest % WINDOW_ROWS] = sum;
        let entered = window.lost[back % WINDOW_ROWS];
        let since = i64::from(sum.wrapping_sub(entered));
        let place = place.plus(Target::of_distance(curves.sum << TARGET_SHIFT));
        (place, advance.wrapping_add(since))
    }

    /// Steps of the events in progress; settles those that end, moves all on by a tick.
    #[inline(never)]
    fn progress(&mut self) -> f32 {
        let mut sum = 0.0;
        let (scale, settled) = (&self.scale, &mut self.settled_exact);
        self.active.retain_mut(|event| {
            if event.elapsed_ticks >= event.duration_ticks {
                *settled = scale.advanced(settled, event.volume_units);
                return false;
            }
            sum += event.share_units(event.elapsed_ticks);
            event.elapsed_ticks += 1;
            true
        });
        self.settled = Target::of_distance(settled.position);
        self.scale.steps(sum)
    }
}

#[cfg(test)]
mod tests {
    //! Goal: the extruder ends exactly on its integer volume, advances by K dV/dt, and events
    //! follow their law. Method: known flows tick by tick.
    use super::*;
    use crate::configuration::ExtruderConfiguration;
    use crate::steps::{STEP, count};
    use headway_protocol::units::Ticks;

    fn machine() -> MachineConfiguration {
        let mut machine = crate::board::built_in::emulated_planar();
        machine.extruder = ExtruderConfiguration {
            steps_per_mm3: 400.0,
            speed_max_mm3_s: 50.0,
            acceleration_max_mm3_s2: 2000.0,
            pressure_advance_s: 0.04,
            pressure_advance_window_ms: 40.0,
        };
        machine
    }

    struct Tested {
        flow: Flow,
        window: FlowWindow,
    }

    impl Tested {
        fn new() -> Self {
            Self {
                flow: Flow::new(&machine(), 2000, 0),
                window: FlowWindow::NONE,
            }
        }
    }

    /// Where the motor is to be, advance included, `units` above `base`.
    fn extruded(flow: &mut Tested, base: i64, units: f32) -> i64 {
        let deposited = flow.flow.scale.steps(units);
        let (target, advance) = flow
            .flow
            .target(&mut flow.window, Target::of_position(base).moved(deposited));
        target.position() + (advance << 9)
    }

    fn steps(position: i64) -> f64 {
        position as f64 / STEP as f64
    }

    #[test]
    fn advance_leads_a_steady_flow_by_k_and_vanishes_at_rest() {
        let mut flow = Tested::new();
        let base = 0;
        flow.flow
            .declare(&mut flow.window, Target::of_position(base));
        let mut target = 0;
        for tick in 0..400 {
            // 10 mm³/s = 5000 units a tick.
            target = extruded(&mut flow, base, tick as f32 * 5000.0);
        }
        let deposited_mm3 = 399.0 * 5000.0 * 1e-6;
        let expected = (deposited_mm3 + 0.04 * 10.0) * 400.0;
        assert!((steps(target) - expected).abs() < 1e-3, "{}", steps(target));
        for _ in 0..81 {
            target = extruded(&mut flow, base, 399.0 * 5000.0);
        }
        assert_eq!(
            target,
            Target::of_position(base)
                .moved(flow.flow.scale.steps(399.0 * 5000.0))
                .position()
        );
    }

    #[test]
    fn events_follow_the_smooth_step_and_end_on_their_volume() {
        let mut flow = Tested::new();
        let start = flow.flow.scale.scaled(12_345_678).position;
        flow.flow
            .declare(&mut flow.window, Target::of_position(start));
        let event = |action, volume_units| FlowEvent {
            span: 0,
            offset_ticks: 0,
            action,
            volume_units,
            duration_ticks: Ticks(200),
        };
        assert!(flow.flow.begin(&event(FlowAction::Prime, 1_500_001)));
        let mut middle = 0;
        let mut fastest = 0.0f64;
        let mut last = start;
        for tick in 0..=200 {
            let target = extruded(&mut flow, start, 0.0);
            if tick == 100 {
                middle = target;
            }
            fastest = fastest.max(steps(target - last));
            last = target;
        }
        assert!((steps(middle - start) - 0.75 * 400.0).abs() < 0.01);
        // Peak rate of the law: 1.875 volume / duration.
        assert!(
            (fastest / (1.875 * 600.0 / 200.0) - 1.0).abs() < 1e-3,
            "{fastest}"
        );
        assert!(!flow.flow.is_active());
        assert_eq!(
            count(last),
            ((12.345_678f64 + 1.500_001) * 400.0).round() as i64
        );
        assert!(flow.flow.begin(&event(FlowAction::Retract, 1_500_001)));
        for _ in 0..=200 {
            last = extruded(&mut flow, start, 0.0);
        }
        assert_eq!(last, Target::of_position(start).position());
    }

    #[test]
    fn a_fifth_event_at_once_is_refused() {
        let mut flow = Tested::new();
        let event = FlowEvent {
            span: 0,
            offset_ticks: 0,
            action: FlowAction::Prime,
            volume_units: 1,
            duration_ticks: Ticks(10),
        };
        for _ in 0..ACTIVE_EVENTS_MAX {
            assert!(flow.flow.begin(&event));
        }
        assert!(!flow.flow.begin(&event));
    }

    #[test]
    fn nothing_happens_where_the_counts_of_a_long_print_wrap() {
        // Whole steps have 32 bits: 5.4 litres at 400 steps a mm³.
        let wrap = 1i64 << 62;
        for start in [0, wrap - 40 * STEP, 2 * (wrap - 20 * STEP)] {
            let mut flow = Tested::new();
            flow.flow.set_override(150);
            flow.flow
                .declare(&mut flow.window, Target::of_position(start));
            let mut last = None;
            let mut way = 0.0;
            for tick in 0..2000i64 {
                // A step in four ticks.
                let base = start.wrapping_add(tick * STEP / 4);
                let target = extruded(&mut flow, base, 0.0);
                let moved = target.wrapping_sub(last.unwrap_or(target)) << 1 >> 1;
                assert!(steps(moved).abs() < 1.0, "{start} {tick} {}", steps(moved));
                way += steps(moved);
                last = Some(target);
            }
            // The advance of a flow that began at once is still in it: K times the rate.
            let expected = 1.5 * 1999.0 / 4.0 + 0.04 * 1.5 * 500.0;
            assert!((way - expected).abs() < 1.0, "{way} {expected}");
        }
    }
}

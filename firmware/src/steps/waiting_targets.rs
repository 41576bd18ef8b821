//! The delay line of all motors, for pressure advance and shapers.
//!
//! Its input are the targets of successive servo ticks, its output those of some ticks ago, in the form that
//! a program needs: 2^-22 steps modulo 1024. The advance itself is not delayed: it is added to the output.
//! [`crate::steps::delay`] gives the reason and the delay. For shaped joints the output is a mean of several
//! rows (`shaper.rs`). Rows are of joints; where motors are not the joints, the output is mixed last.

use super::shaper::Shapers;
use super::{FINE_BIAS, TARGET_SHIFT};
use crate::configuration::{MOTORS_MAX, MachineConfiguration};
use crate::design::LINE_TICKS;
use crate::steps::delay::Delays;
use crate::steps::motor_mix::MotorMix;
use crate::steps::shaping::shapes;

/// Rows of the line, a power of two.
pub(super) const ROWS: usize = LINE_TICKS.next_power_of_two();
/// The longest wait, servo ticks.
pub const WAIT_TICKS_MAX: u32 = ROWS as u32 - 1;

/// Fine parts of the targets of one servo tick.
pub(super) type Row = [i32; MOTORS_MAX];

/// Delayed targets: only the rows, which are large and so stored apart from the data of every tick.
#[derive(Clone, Debug)]
pub struct WaitingTargets {
    pub(super) rows: [Row; ROWS],
    pub(super) shapers: Shapers,
    mix: MotorMix,
    /// What came out last, where a motor is shaped or mixed.
    shaped: Row,
}

impl WaitingTargets {
    /// Nothing waits.
    pub const NONE: Self = Self {
        rows: [[0; MOTORS_MAX]; ROWS],
        shapers: Shapers::NONE,
        mix: MotorMix::NONE,
        shaped: [0; MOTORS_MAX],
    };

    /// The line of a machine, nothing in it.
    pub fn new(configuration: &MachineConfiguration, delays: &Delays) -> Self {
        Self {
            shapers: Shapers::new(&shapes(configuration), delays),
            mix: MotorMix::new(&configuration.motors, configuration.joints.len()),
            ..Self::NONE
        }
    }

    /// Everything rests at a row.
    pub(super) fn rest(&mut self, row: Row) {
        self.rows.fill(row);
        self.shapers.rest(&row);
    }

    /// True if a motor's delayed target differs from the entered one.
    pub(super) fn shapes(&self) -> bool {
        !(self.shapers.is_none() && self.mix.is_none())
    }

    /// How far the newest row takes a motor that two joints move, 2^-22 steps.
    fn mixed_way(&self, places: Places) -> u32 {
        let newest = places.newest % ROWS;
        let before = newest.wrapping_sub(1) % ROWS;
        self.mix.way(&self.rows[before], &self.rows[newest])
    }

    /// The delayed targets, shaped and mixed; `None` if a motor that two joints move would go too far, 2^-22
    /// steps.
    #[inline(never)]
    pub(super) fn shaped(&mut self, places: Places, way_max: u32) -> Option<&Row> {
        if self.mixed_way(places) > way_max {
            return None;
        }
        self.shaped = self.rows[places.oldest % ROWS];
        self.shapers
            .follow(&self.rows, places.newest, &mut self.shaped);
        self.mix.mix(&mut self.shaped, FINE_BIAS);
        Some(&self.shaped)
    }

    /// The row to be filled.
    #[inline(always)]
    pub(super) fn newest(&mut self, places: Places) -> &mut Row {
        &mut self.rows[places.newest % ROWS]
    }

    /// The delayed targets.
    #[inline(always)]
    pub(super) fn due(&self, places: Places) -> &Row {
        &self.rows[places.oldest % ROWS]
    }
}

/// The rows of a servo tick.
#[derive(Clone, Copy, Debug)]
pub struct Places {
    newest: usize,
    oldest: usize,
}

/// Where in the rows the newest targets are, and how long they wait.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Line {
    newest: usize,
    wait_ticks: usize,
    /// The advance's addition to the delayed target, 2^-22 steps, and its motor.
    advance: i64,
    advanced: u8,
    /// A motor is shaped or mixed.
    shapes: bool,
    /// Servo ticks until a target has completely left the line.
    settle_ticks: u16,
}

impl Line {
    /// Everything rests.
    pub(super) fn new(advanced: usize, delays: &Delays, shapes: bool) -> Self {
        Self {
            shapes,
            wait_ticks: delays.line_ticks.min(WAIT_TICKS_MAX) as usize,
            settle_ticks: delays.settle_ticks.min(WAIT_TICKS_MAX) as u16,
            advanced: advanced as u8,
            ..Self::default()
        }
    }

    /// True if a motor's delayed target differs from the entered one.
    #[inline(always)]
    pub(super) fn shapes(&self) -> bool {
        self.shapes
    }

    /// Servo ticks after which an entered target has left the line.
    pub(super) fn settle_ticks(&self) -> u32 {
        u32::from(self.settle_ticks)
    }

    /// Begins a servo tick.
    #[inline(always)]
    pub(super) fn begin(&mut self) -> Places {
        let newest = self.newest.wrapping_add(1) % ROWS;
        self.newest = newest;
        let oldest = newest.wrapping_sub(self.wait_ticks) % ROWS;
        Places { newest, oldest }
    }

    /// Takes the servo tick back.
    pub(super) fn take_back(&mut self) {
        self.newest = self.newest.wrapping_sub(1) % ROWS;
    }

    /// The newest row.
    pub(super) fn newest<'a>(&self, waiting: &'a WaitingTargets) -> &'a Row {
        &waiting.rows[self.newest % ROWS]
    }

    /// Enters the target of the motor that has the advance. Returns its delayed target with the
    /// present advance.
    #[inline(always)]
    pub(super) fn exchange(
        &mut self,
        waiting: &mut WaitingTargets,
        places: Places,
        motor: usize,
        fine: i32,
        advance: i64,
    ) -> i32 {
        self.advance = advance;
        waiting.rows[places.newest % ROWS][motor] = fine;
        let due = &mut waiting.rows[places.oldest % ROWS][motor];
        *due = due.wrapping_add(advance as i32);
        *due
    }

    /// Distance of the entered target from the delayed one, 2^-31 steps: except for a tick's
    /// displacement, and a shaper's deviation from the plan.
    #[inline(never)]
    pub(super) fn held(&self, motor: usize, waiting: &WaitingTargets) -> i64 {
        let fine = |back: usize| waiting.rows[self.newest.wrapping_sub(back) % ROWS][motor];
        let way = |back: usize| i64::from(fine(back - 1).wrapping_sub(fine(back)));
        let ways: i64 = (1..self.wait_ticks).map(way).sum();
        let advance = if motor == usize::from(self.advanced) {
            self.advance
        } else {
            0
        };
        (ways - advance) << TARGET_SHIFT
    }
}

/// A position near `about`, both 2^-31 steps, of which the fine part is known.
pub(super) fn position_near(about: i64, fine: i32) -> i64 {
    let biased = about.wrapping_add(super::BIAS) >> TARGET_SHIFT;
    let off = fine.wrapping_sub(biased as i32);
    (biased.wrapping_add(i64::from(off)) << TARGET_SHIFT).wrapping_sub(super::BIAS)
}

#[cfg(test)]
mod tests {
    //! Goal: targets come out in order after their wait, the advance at once, and what is still held is
    //! known. Method: known ways through lines of several lengths.
    use super::*;

    #[test]
    fn targets_come_out_in_order_and_the_advance_at_once() {
        for wait in [0, 1, 40, WAIT_TICKS_MAX] {
            let mut waiting = WaitingTargets::NONE;
            waiting.rows.fill([7; MOTORS_MAX]);
            let delays = Delays {
                line_ticks: wait,
                ..Delays::default()
            };
            let mut line = Line::new(1, &delays, false);
            for tick in 0..1000i32 {
                let places = line.begin();
                waiting.newest(places)[0] = tick;
                let advance = i64::from(tick) * 5;
                let came = line.exchange(&mut waiting, places, 1, tick, advance);
                let due = tick - wait as i32;
                let expected = if due < 0 { 7 } else { due };
                assert_eq!(waiting.due(places)[0], expected, "{wait}");
                assert_eq!(came, expected + tick * 5, "{wait}");
                if due > 0 {
                    let held = i64::from(wait.saturating_sub(1)) << TARGET_SHIFT;
                    assert_eq!(line.held(0, &waiting), held);
                    assert_eq!(line.held(1, &waiting), held - (advance << TARGET_SHIFT));
                }
            }
        }
    }

    #[test]
    fn a_position_is_known_from_its_fine_part_and_about_where_it_is() {
        for position in [0, 1i64 << 40, -(1i64 << 50), (1 << 62) - 512] {
            let exact = position >> TARGET_SHIFT << TARGET_SHIFT;
            let fine = crate::steps::Target::of_position(exact).fine;
            for off in [-500, 0, 300] {
                let about = exact.wrapping_add(off * crate::steps::STEP);
                assert_eq!(position_near(about, fine) >> 9, exact >> 9, "{off}");
            }
        }
    }
}

//! Flow of the job -> changes of a pump's output, each ahead of the flow that it makes.
//!
//! ```text
//! SegmentStream --levels--> flow by stretches (mm³/s, ticks) --ahead--> OutputChange (ticks, units of the output)
//! ```
//! In: a stream, the pump. Out: changes in their order, what is to be told. A stretch has the mean flow of the job in it, so
//! that its volume is right, and is as long as the flow stays in a band. Primes count as flow. Not covered: retracts, since a
//! pump does not run backwards.

use crate::gcode::write::poses::{Poses, event_ticks};
use crate::job::SegmentStream;
use crate::settings::pump::{PumpKind, PumpOutput};
use crate::text::short_number::Short;
use headway_protocol::segment::FlowAction;
use headway_protocol::units::CHANNEL_VOLUME;

/// The flow of a stretch varies by this share of the job's greatest at most,
const BAND_SHARE: f64 = 0.05;
/// none is less than this share of it, which is what rounding leaves of a rest;
const OFF_SHARE: f64 = 1e-3;
/// but it lasts so long, s, some cycles of a controller,
const LEAST_S: f64 = 0.02;
/// and such a share of the pump's lag: what is shorter it does not follow. It runs on through interruptions that are shorter.
const LEAST_SHARE: f64 = 0.5;

/// The output gets another value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutputChange {
    /// When, servo ticks of the job.
    pub tick: u64,
    /// Units of the output; 0 is off.
    pub value: f64,
}

/// From a tick on the flow is so great.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Level {
    from: u64,
    rate_mm3_s: f64,
}

/// What the output does over a job.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OutputChanges {
    /// In their order, ticks rising.
    pub list: Vec<OutputChange>,
    /// For the user.
    pub notes: Vec<String>,
}

impl OutputChanges {
    /// Of a job whose program has its own time (`clock`: seconds of the job and of the program, rising).
    pub fn of(
        stream: &SegmentStream,
        servo_hz: f64,
        pump: &PumpOutput,
        clock: &[[f64; 2]],
    ) -> OutputChanges {
        let events = event_ticks(stream);
        let levels = levels(stream, &events, servo_hz, pump);
        let mut changes = ahead(&levels, servo_hz, pump, clock);
        if events.iter().any(|event| event.1 == FlowAction::Retract) {
            changes.notes.push(
                "the job's retracts are left out, since a pump does not run backwards: set flow.retract_mm3 to 0"
                    .to_string(),
            );
        }
        let clamped = clamped(&levels, stream.layers(), servo_hz, pump);
        changes.notes.extend(clamped);
        changes
    }

    /// Those after one tick and up to another.
    pub(super) fn within(&self, [from, to]: [u64; 2]) -> &[OutputChange] {
        let first = self.list.partition_point(|change| change.tick <= from);
        let end = self.list.partition_point(|change| change.tick <= to);
        &self.list[first..end]
    }
}

/// The changes that make the levels, each so early as the pump needs.
fn ahead(levels: &[Level], servo_hz: f64, pump: &PumpOutput, clock: &[[f64; 2]]) -> OutputChanges {
    let mut list: Vec<OutputChange> = Vec::new();
    let mut missed = [0, 0];
    let mut late_s = 0.0;
    let mut before_mm3_s = 0.0;
    for level in levels {
        let ahead_s = match (before_mm3_s > 0.0, level.rate_mm3_s > 0.0) {
            // It stays off.
            (false, false) => continue,
            (false, true) => pump.start_lead_s,
            (true, false) => pump.stop_lead_s,
            (true, true) => pump.lag_s,
        };
        before_mm3_s = level.rate_mm3_s;
        // Ahead by the program's time, at the job's place.
        let due_s = at(clock, level.from as f64 / servo_hz, [0, 1]) - ahead_s;
        if level.rate_mm3_s > 0.0 {
            late_s = f64::max(late_s, -due_s);
        }
        let tick = ((at(clock, due_s, [1, 0]) * servo_hz).round() as u64).max(1);
        // The later one counts: a pump that is to start again before it would have stopped does not stop.
        while let Some(last) = list.pop_if(|last| last.tick >= tick) {
            missed[usize::from(last.value > 0.0)] += 1;
        }
        let value = value(level.rate_mm3_s, pump);
        if value != list.last().map_or(0.0, |last| last.value) {
            list.push(OutputChange { tick, value });
        }
    }
    let notes = notes(&list, servo_hz, missed, late_s);
    OutputChanges { list, notes }
}

/// Between the rows of a table that rises, from one of its columns to the other.
fn at(table: &[[f64; 2]], x: f64, [from, to]: [usize; 2]) -> f64 {
    let after = table.partition_point(|row| row[from] < x);
    let (Some(high), Some(low)) = (table.get(after.max(1)), table.get(after.max(1) - 1)) else {
        return table.last().map_or(x, |row| row[to]);
    };
    let share = (x - low[from]) / (high[from] - low[from]).max(1e-12);
    low[to] + share.clamp(0.0, 1.0) * (high[to] - low[to])
}

/// Of a flow, mm³/s.
fn value(rate_mm3_s: f64, pump: &PumpOutput) -> f64 {
    match (rate_mm3_s > 0.0, pump.kind, pump.mm3_s_per_unit) {
        (false, ..) => 0.0,
        (true, PumpKind::Analog, Some(per_unit)) => {
            let most = pump.rate_max_mm3_s.unwrap_or(f64::INFINITY);
            rate_mm3_s.max(pump.rate_min_mm3_s).min(most) / per_unit
        }
        _ => 1.0,
    }
}

/// A prime or a retract of [`event_ticks`].
type FlowEvent = (u64, FlowAction, f64, f64);

/// Flow from tick to tick.
struct Flow<'a> {
    poses: Poses<'a>,
    /// Volume in front, mm³.
    before_mm3: f64,
    /// First and last tick and rate of the primes, the last one first.
    primes: Vec<(u64, u64, f64)>,
    servo_hz: f64,
}

impl<'a> Flow<'a> {
    fn new(stream: &'a SegmentStream, events: &[FlowEvent], servo_hz: f64) -> Flow<'a> {
        let primes = events.iter().rev().filter_map(|event| {
            let &(tick, action, volume_mm3, ticks) = event;
            let rate_mm3_s = volume_mm3 * servo_hz / ticks.max(1.0);
            (action == FlowAction::Prime).then_some((tick, tick + ticks as u64, rate_mm3_s))
        });
        let mut poses = Poses::new(stream);
        Flow {
            before_mm3: poses.at(0)[CHANNEL_VOLUME],
            poses,
            primes: primes.collect(),
            servo_hz,
        }
    }

    /// In the tick that ends at one, mm³/s.
    fn until(&mut self, tick: u64) -> f64 {
        let volume_mm3 = self.poses.at(tick)[CHANNEL_VOLUME];
        let laid_mm3_s = (volume_mm3 - self.before_mm3).max(0.0) * self.servo_hz;
        self.before_mm3 = volume_mm3;
        while self.primes.last().is_some_and(|prime| prime.1 < tick) {
            self.primes.pop();
        }
        let primed = self.primes.last().filter(|prime| prime.0 < tick);
        laid_mm3_s + primed.map_or(0.0, |prime| prime.2)
    }
}

/// The stretches of even flow, off and on.
fn levels(
    stream: &SegmentStream,
    events: &[FlowEvent],
    servo_hz: f64,
    pump: &PumpOutput,
) -> Vec<Level> {
    let ticks = stream.marks.last().map_or(0, |mark| mark.end_tick);
    let mut flow = Flow::new(stream, events, servo_hz);
    let most_mm3_s = (1..=ticks).map(|tick| flow.until(tick)).fold(0.0, f64::max);
    let band_mm3_s = match pump.kind {
        PumpKind::Analog => BAND_SHARE * most_mm3_s,
        PumpKind::Digital => f64::INFINITY,
    };
    let off_mm3_s = (0.5 * pump.rate_min_mm3_s).clamp(OFF_SHARE * most_mm3_s, 0.5 * most_mm3_s);
    let least = (LEAST_S.max(LEAST_SHARE * pump.lag_s) * servo_hz).ceil() as u64;
    let mut flow = Flow::new(stream, events, servo_hz);
    let mut levels: Vec<Level> = Vec::new();
    let mut open: Option<Stretch> = None;
    for tick in 1..=ticks {
        let rate_mm3_s = flow.until(tick);
        let runs = rate_mm3_s > off_mm3_s;
        let ends = |of: &Stretch| {
            of.is_on != runs || runs && of.ends(tick, rate_mm3_s, [band_mm3_s, least as f64])
        };
        if let Some(done) = open.take_if(|of| ends(of)) {
            close(&mut levels, &done, least);
        }
        open.get_or_insert_with(|| Stretch::new(tick - 1, runs))
            .add(rate_mm3_s);
    }
    if let Some(done) = open {
        close(&mut levels, &done, least);
    }
    levels.push(Level {
        from: ticks,
        rate_mm3_s: 0.0,
    });
    levels
}

/// Ticks of one level.
struct Stretch {
    from: u64,
    is_on: bool,
    ticks: u64,
    sum_mm3_s: f64,
    range_mm3_s: [f64; 2],
}

impl Stretch {
    fn new(from: u64, is_on: bool) -> Stretch {
        Stretch {
            from,
            is_on,
            ticks: 0,
            sum_mm3_s: 0.0,
            range_mm3_s: [f64::INFINITY, 0.0],
        }
    }

    fn with(&self, rate_mm3_s: f64) -> [f64; 2] {
        let [low, high] = self.range_mm3_s;
        [low.min(rate_mm3_s), high.max(rate_mm3_s)]
    }

    /// True where a flow leaves the band of one that has lasted.
    fn ends(&self, tick: u64, rate_mm3_s: f64, [band_mm3_s, least]: [f64; 2]) -> bool {
        let [low, high] = self.with(rate_mm3_s);
        (tick - 1 - self.from) as f64 >= least && high - low > band_mm3_s
    }

    fn add(&mut self, rate_mm3_s: f64) {
        self.range_mm3_s = self.with(rate_mm3_s);
        self.ticks += 1;
        self.sum_mm3_s += rate_mm3_s;
    }
}

/// Adds a stretch; a short one that is off, or the last one before it, is part of what runs before.
fn close(levels: &mut Vec<Level>, done: &Stretch, least: u64) {
    let ran = levels.last().is_some_and(|last| last.rate_mm3_s > 0.0);
    if !done.is_on && ran && done.ticks < least {
        return;
    }
    let rate_mm3_s = match done.is_on {
        true => done.sum_mm3_s / done.ticks as f64,
        false => 0.0,
    };
    levels.push(Level {
        from: done.from,
        rate_mm3_s,
    });
}

/// How often and how fast it changes, and what is missed.
fn notes(list: &[OutputChange], servo_hz: f64, missed: [u32; 2], late_s: f64) -> Vec<String> {
    let gaps = list.windows(2).map(|pair| pair[1].tick - pair[0].tick);
    let shortest_s = gaps.min().unwrap_or(0) as f64 / servo_hz;
    let stops = list.iter().filter(|change| change.value == 0.0).count();
    let mut notes = vec![format!(
        "the pump's output changes {} times and is off {stops} times of them; the shortest value lasts {:.3} s",
        list.len(),
        shortest_s
    )];
    let [stops, levels] = missed;
    if stops + levels > 0 {
        notes.push(format!(
            "the pump runs on through {stops} interruptions that are shorter than its leads, and skips {levels} values"
        ));
    }
    if late_s > 0.0 {
        notes.push(format!(
            "the pump starts {late_s:.2} s too late for the first bead: give the job a skirt or a purge line"
        ));
    }
    notes
}

/// What the pump's range keeps from being right.
fn clamped(levels: &[Level], layers: u32, servo_hz: f64, pump: &PumpOutput) -> Option<String> {
    let (PumpKind::Analog, Some(per_unit)) = (pump.kind, pump.mm3_s_per_unit) else {
        return None;
    };
    let [mut asked_mm3, mut off_mm3] = [0.0, 0.0];
    for pair in levels.windows(2) {
        let seconds = (pair[1].from - pair[0].from) as f64 / servo_hz;
        let pumped_mm3_s = per_unit * value(pair[0].rate_mm3_s, pump);
        asked_mm3 += pair[0].rate_mm3_s * seconds;
        off_mm3 += (pumped_mm3_s - pair[0].rate_mm3_s).abs() * seconds;
    }
    let share = off_mm3 / f64::max(asked_mm3, 1e-9);
    (share > 1e-3).then(|| {
        format!(
            "{} % of the volume of {layers} layers is pumped at the least or the greatest rate in place of its own: change the \
             speed or the pump's range",
            Short(100.0 * share)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HZ: f64 = 2000.0;

    fn changes(levels: &[(u64, f64)]) -> Vec<(u64, f64)> {
        let pump = PumpOutput {
            mm3_s_per_unit: Some(10.0),
            lag_s: 0.1,
            start_lead_s: 0.4,
            stop_lead_s: 0.05,
            ..PumpOutput::default()
        };
        let level = |&(from, rate_mm3_s): &(u64, f64)| Level { from, rate_mm3_s };
        let levels: Vec<Level> = levels.iter().map(level).collect();
        // A program that takes as long as the job.
        let made = ahead(&levels, HZ, &pump, &[[0.0, 0.0], [10.0, 10.0]]);
        let pairs = made.list.iter().map(|change| (change.tick, change.value));
        pairs.collect()
    }

    /// Goal: each change is ahead by what is asked of it, a job's end leaves the last stop where it is, and a pump that would
    /// start before it stopped runs on. Method: leads of 800, 200 and 100 ticks by hand; a job that ends 100 ticks after its
    /// last bead; a gap of 300 ticks, shorter than a start's lead.
    #[test]
    fn changes_are_ahead_of_the_flow() {
        let one = [(0, 0.0), (2000, 20.0), (3000, 30.0), (4000, 0.0)];
        let due = [(1200, 2.0), (2800, 3.0), (3900, 0.0)];
        assert_eq!(changes(&one), due);
        let ended = [&one[..], &[(4100, 0.0)]].concat();
        assert_eq!(changes(&ended), due);
        let again = [&one[..], &[(4300, 40.0), (6000, 0.0)]].concat();
        assert_eq!(
            changes(&again),
            [(1200, 2.0), (2800, 3.0), (3500, 4.0), (5900, 0.0)]
        );
    }
}

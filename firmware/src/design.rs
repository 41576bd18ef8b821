//! Constants of the design, each with its reason.

/// Servo ticks between the evaluation of a pose and the start of the interval that begins at it:
/// the averaged parabola needs the target one tick ahead of the interval's end (2), and the program
/// is computed during one interval to be played in the next (1).
pub const SERVO_DELAY_TICKS: u32 = 3;

/// Constant delay between a pose's evaluation and its steps, in s. Servo tick k is at k / servo_hz,
/// just before step tick n = k step_hz / servo_hz, which is at n / step_hz. A step is made in the
/// tick before its crossing, half a tick early on average, which is subtracted here.
pub const fn motion_delay_s(servo_hz: u32, step_hz: u32) -> f64 {
    SERVO_DELAY_TICKS as f64 / servo_hz as f64 - 0.5 / step_hz as f64
}

/// Servo ticks of a time; exact for the times and rates in use.
pub const fn ticks_of_ms(ms: u32, servo_hz: u32) -> u32 {
    (ms as u64 * servo_hz as u64 / 1000) as u32
}

/// Share of the step tick rate that a motor may reach before the fault. At 1 a step could be lost
/// to rounding; planning stays below 0.9, which leaves room for the time warp.
pub const STEP_RATE_SHARE_MAX: f64 = 0.98;

/// Offset below n + 1/2 at which a step is due, in 2^-31 steps: 10⁻⁶ step. Positions on the wire
/// are whole units, so exact halves are common; the bias is above the rounding of scale and
/// interval (2^-23 step), so that halves always round up.
pub const STEP_THRESHOLD_BIAS: i64 = 1 << 11;

/// Capacity of the queue in knots: about two seconds of tight curves, and 12 KiB of RAM.
pub const QUEUE_KNOTS: usize = 256;

/// Spans whose polynomials are computed before they begin: at twice the planned rate spans of 6
/// servo ticks take 3, so this is 10 ms, of which the main loop of a board needs 3 for its longest
/// work, a full block of knots; with the current one 2 KiB of RAM.
pub const SPANS_AHEAD: usize = 7;

/// Knots of a block whose loads are computed in one round of a board's main loop: an arm needs some
/// 45,000 instructions for each, and such a part of a round may take 4 ms
/// (`docs/measurements/firmware.md`).
pub const WEIGHED_KNOTS: usize = 4;

/// Entries of the queue whose ceilings are computed under one lock: some 50 instructions each.
pub const CEILINGS_AT_ONCE: usize = 12;

/// Capacity of the queue in flow events: two per pass, so 32 short passes ahead.
pub const QUEUE_EVENTS: usize = 64;

/// Longest window of pressure advance in servo ticks: 128 ms at 2 kHz for 1 KiB of RAM.
pub const ADVANCE_WINDOW_TICKS_MAX: usize = 256;

/// Length of the delay line in servo ticks: half the longest window of pressure advance and the longest
/// shaper, which is `smooth` at 17 Hz; 8 KiB.
pub const LINE_TICKS: usize = 256;

/// Largest path rate: feed override up to 200 %.
pub const PATH_RATE_MAX: f32 = 2.0;

/// sigma² at which ceilings are cut. Well above the largest rate squared: a ceiling cut just there
/// would hide a decrease within the next tick.
pub const CEILING_OPEN: f32 = 4.0 * PATH_RATE_MAX * PATH_RATE_MAX;

/// Largest share of a joint's full acceleration that is assumed for a span by itself. Plans use at
/// most `plan_share` (0.95); the estimate on the device may be higher, and at 1 the warp would have
/// no slope left and would stop a correct plan.
pub const LOAD_ALPHA_MAX: f32 = 0.97;

/// Ratio to a full limit above which a value is refused: joints by their span, the extruder by its
/// motor's targets. Plans keep `plan_share` (at most 1) of a limit exactly; the device's values have
/// errors of f32 and of differences in very short spans, at most 4 %.
pub const LIMIT_MARGIN: f64 = 1.05;

/// The same for the extruder while the path rate is not the plan's, or has lately been: a plan's sum
/// keeps the limit, but a pause, an override or an empty queue shifts the path's part relative to an
/// event's, and the bound for the rate may underestimate pressure advance (`EXTRUDER_ALPHA_MAX`: a plan
/// at 0.95 may reach 1.34 at 200 %).
pub const RAMP_MARGIN: f64 = 1.5;

/// Least beta: below it nothing really moves, and the rate may change at once (4 per tick).
pub const LOAD_BETA_MIN_TICKS: f32 = 0.25;

/// Segment time that must be queued before a stream starts or continues after an empty queue: three
/// times the stopping time from 150 mm/s (80 ms), so that a start is not followed by a stop.
pub const START_QUEUED_MS: u32 = 250;

/// Dwell on the path after which melt is retracted: the ooze of a shorter stop is a smaller fault
/// than a retract and prime.
pub const HOLD_RETRACT_DELAY_MS: u32 = 300;

/// Primes and retracts that can run at the same time.
pub const ACTIVE_EVENTS_MAX: usize = 4;

/// Quiet time after which a stream continues with its queue: a host that sends less than
/// [`START_QUEUED_MS`] and no end intends it.
pub const QUIET_START_MS: u32 = 1000;

/// Room in the queue below which a stream starts in any case: the host cannot send a full block.
pub const START_ROOM_KNOTS: usize = headway_protocol::knot_block::KNOTS_PER_BLOCK_MAX;

/// Period of status reports while a host listens: ten per second update a display for 0.5 KB/s.
pub const STATUS_PERIOD_MS: u32 = 100;

/// Servo ticks that a switch must stay pressed to count: 1.5 ms at 2 kHz, longer than a pulse
/// induced by an adjacent motor wire, shorter than a tenth of a millimetre at 60 mm/s.
pub const SWITCH_SETTLE_TICKS: u32 = 3;

/// Time at rest without a stream after which the motors are released: long enough to check a part
/// and start the next one, short enough that they are not heated all night.
pub const MOTORS_IDLE_S: u32 = 600;

/// Flow override changes by this much per second: at the fastest flow a small part of the
/// extruder's acceleration.
pub const FLOW_OVERRIDE_PERCENT_PER_S: u32 = 100;

/// Knots consumed before credit is sent without a request: half a block.
pub const CREDIT_STEP_KNOTS: u32 = 16;

/// Longest silence of the host that heats or has the machine. Klipper's `MAX_HEAT_TIME` is 5 s, because its host
/// regulates; here the board does, and the time is that in which a person starts the next command.
pub const HOST_SILENT_MS: u32 = 30_000;

/// Least time between two requests to send the same frame again: longer than a round trip.
pub const NAK_PERIOD_MS: u32 = 20;

/// Share of a joint's full acceleration that planned motion and the slope of the path rate use
/// together. The rest covers what a servo tick cannot know: that it ends in another span, and
/// that the rate changes in steps. In 80 random campaigns the overshoot was 0.5 % without it.
pub const WARP_ROOM: f32 = 0.985;

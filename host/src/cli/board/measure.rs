//! `headway board measure`: what a board measures of itself, as text and JSON.

use crate::cli::args::board::MeasureArgs;
use crate::cli::board::talk::Talk;
use crate::cli::error::CliError;
use crate::cli::terminal::console::Console;
use headway_protocol::message::{BoardFigures, TickFigures};
use serde_json::{Value, json};
use std::time::Duration;

pub(crate) fn measure(args: &MeasureArgs, console: &Console) -> Result<(), CliError> {
    let mut talk = Talk::open(&args.port)?;
    let lasts = Duration::from_secs_f64(args.seconds);
    let figures = talk.measure(lasts).map_err(|error| match talk.welcome {
        // A board without a clock of its own refuses the order.
        Some(_) => CliError::Job(format!(
            "{error} (a simulated board does not measure itself)"
        )),
        None => error,
    })?;
    let rates = talk
        .welcome
        .map_or([0, 0], |welcome| [welcome.step_hz, welcome.servo_hz]);
    if args.json {
        return console.result(&format!("{:#}\n", figures_json(&figures)));
    }
    console.result(&figures_text(&figures, rates))
}

fn microseconds(clocks: f64, clock_hz: u32) -> f64 {
    clocks * 1e6 / f64::from(clock_hz.max(1))
}

fn tick_json(tick: &TickFigures) -> Value {
    if tick.count == 0 {
        return Value::Null;
    }
    json!({
        "count": tick.count,
        "min_clocks": tick.min_clocks,
        "mean_clocks": f64::from(tick.mean_milliclocks) / 1e3,
        "max_clocks": tick.max_clocks,
    })
}

fn figures_json(figures: &BoardFigures) -> Value {
    json!({
        "clock_hz": figures.clock_hz,
        "step_tick": tick_json(&figures.step),
        "servo_tick": tick_json(&figures.servo),
        "lock_max_us": microseconds(figures.lock_max_clocks.into(), figures.clock_hz),
        "round_max_us": microseconds(figures.round_max_clocks.into(), figures.clock_hz),
        "stack_used_bytes": figures.stack_used_bytes,
        "stack_bytes": figures.stack_bytes,
        "brown_out_level": figures.brown_out_level,
    })
}

/// Clocks of an interrupt, and the share of its period that the longest takes.
fn tick_text(name: &str, tick: &TickFigures, rate_hz: u32, clock_hz: u32) -> String {
    if tick.count == 0 {
        return format!("{name}: none was measured; measure for longer\n");
    }
    let share = f64::from(tick.max_clocks) * f64::from(rate_hz) / f64::from(clock_hz.max(1));
    format!(
        "{name}: {} min, {:.1} mean, {} max clocks, {:.2} us or {:.0} % of its period ({} measured)\n",
        tick.min_clocks,
        f64::from(tick.mean_milliclocks) / 1e3,
        tick.max_clocks,
        microseconds(tick.max_clocks.into(), clock_hz),
        100.0 * share,
        tick.count
    )
}

fn figures_text(figures: &BoardFigures, [step_hz, servo_hz]: [u32; 2]) -> String {
    let clock_hz = figures.clock_hz;
    format!(
        "clock {:.1} MHz\n{}{}longest lock {:.1} us, longest round of the main loop {:.1} us (measurement included)\n\
         stack {} of {} bytes\n{}",
        f64::from(clock_hz) / 1e6,
        tick_text("step tick", &figures.step, step_hz, clock_hz),
        tick_text("servo tick", &figures.servo, servo_hz, clock_hz),
        microseconds(figures.lock_max_clocks.into(), clock_hz),
        microseconds(figures.round_max_clocks.into(), clock_hz),
        figures.stack_used_bytes,
        figures.stack_bytes,
        brown_out_text(figures.brown_out_level)
    )
}

fn brown_out_text(level: Option<u8>) -> String {
    match level {
        None => String::new(),
        Some(0) => "no brown-out reset: a supply that sags may run the core astray; set level 3 in the chip's option \
                    bytes\n"
            .to_string(),
        Some(level) => format!("brown-out reset at level {level}\n"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_are_told_with_their_share_of_the_period() {
        let figures = BoardFigures {
            clock_hz: 168_000_000,
            step: TickFigures {
                count: 9,
                min_clocks: 120,
                mean_milliclocks: 187_250,
                max_clocks: 336,
            },
            lock_max_clocks: 1680,
            round_max_clocks: 84_000,
            stack_used_bytes: 12_000,
            stack_bytes: 86_016,
            brown_out_level: Some(0),
            ..BoardFigures::default()
        };
        let text = figures_text(&figures, [200_000, 2000]);
        for part in [
            "step tick: 120 min, 187.2 mean, 336 max clocks, 2.00 us or 40 % of its period (9 measured)",
            "servo tick: none was measured",
            "longest lock 10.0 us, longest round of the main loop 500.0 us",
            "stack 12000 of 86016 bytes\nno brown-out reset",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        let json = figures_json(&figures);
        assert_eq!(json["servo_tick"], Value::Null);
        assert_eq!(json["step_tick"]["mean_clocks"], 187.25);
    }
}

//! Orders of heaters and fans in the words of a dialect.
//!
//! In: orders (°C, per cent) at ticks. Out: lines. Klipper, RepRapFirmware and Marlin: M104, M109, M140, M190,
//! M106 with S of 255. Machine tools have outputs: analog 0 is the hot end, 1 the bed, 3 a second hot end, in °C,
//! analog 2 the part fan, 0 to 1; M68 at rest, M67 on the path, where it holds from the next move on and stops
//! nothing; to wait is M66 for the digital input of the heater's number to be high, at most [`WAIT_S`].

use super::dialect::Dialect;
use super::poses::Poses;
use super::{WriteError, WriteOptions, Writer, short};
use crate::job::heat::{BED, HEATER_NAMES, HOT_END, HeatEvent, HeatOrder};
use std::io::Write;

/// Longest wait of M66, s.
const WAIT_S: u32 = 1800;
/// Fans that turn are never told less: S1 is full speed to RepRapFirmware.
const FAN_LEAST: f64 = 2.0;
/// Analog output of the part fan.
const FAN_OUTPUT: u8 = 2;
impl<W: Write> Writer<'_, W> {
    /// A move of the stream, divided where something is ordered.
    pub(super) fn move_with_orders(
        &mut self,
        [mut from, end]: [u64; 2],
        heat: &mut &[HeatEvent],
        poses: &mut Poses,
    ) -> Result<(), WriteError> {
        while let Some(event) = heat.first()
            && event.tick < end
        {
            let tick = event.tick;
            self.route_move([from, tick], poses)?;
            self.orders_until(heat, tick, false)?;
            from = tick;
        }
        self.route_move([from, end], poses)
    }

    /// The orders up to and with a tick that were not written yet.
    pub(super) fn orders_until(
        &mut self,
        heat: &mut &[HeatEvent],
        tick: u64,
        at_rest: bool,
    ) -> Result<(), WriteError> {
        while let Some((event, rest)) = heat.split_first()
            && event.tick <= tick
        {
            *heat = rest;
            let lines = lines(&event.order, self.options.dialect, at_rest);
            self.out.write_all(lines.as_bytes())?;
        }
        Ok(())
    }
}

/// What a start block of the user's own may have switched on and the job does not switch off. Macros may heat
/// without a word of it; a machine tool without outputs refuses theirs.
pub(super) fn last_lines(heat: &[HeatEvent], options: &WriteOptions) -> String {
    let may_heat = options.blocks[0].as_deref().is_some_and(|block| {
        let outputs = ["M67", "M68", "{hot_end_c}", "{bed_c}"];
        !options.dialect.is_machine_tool() || outputs.iter().any(|word| block.contains(word))
    });
    let off = [HOT_END, BED].map(|heater| HeatOrder::target(heater, 0.0));
    let is_told = |off: &&HeatOrder| !heat.iter().any(|event| event.order == **off);
    let off = off.iter().filter(is_told);
    let off = off.filter(|_| may_heat && !options.leave_hot);
    off.map(|order| lines(order, options.dialect, true))
        .collect()
}

/// The orders before the job's first move as lines of a start block, temperatures as fields where they are the field's.
pub(super) fn block_lines(heat: &[HeatEvent], dialect: Dialect) -> String {
    let fields = first_fields(heat);
    let first = heat.iter().take_while(|event| event.tick == 0);
    let line = |event: &HeatEvent| match event.order {
        HeatOrder::Heater {
            heater, celsius, ..
        } if heater <= BED && celsius > 0.0 => {
            let (name, value) = &fields[usize::from(heater != HOT_END)];
            let told = short(celsius, 1);
            let target = match *value == told {
                true => format!("{{{name}}}"),
                false => told,
            };
            lines_with(&event.order, dialect, true, &target)
        }
        order => lines(&order, dialect, true),
    };
    first.map(line).collect()
}

/// The orders that stand before the job's first move and that the start block, `filled` with its fields, has not: a heater
/// that it waits for, or whose temperature it uses as a field, is its own.
pub(super) fn first_lines(heat: &[HeatEvent], options: &WriteOptions, filled: &str) -> String {
    let block = options.blocks[0].as_deref().unwrap_or_default();
    let filled = format!("\n{filled}");
    let first = heat.iter().take_while(|event| event.tick == 0);
    let lines = first.map(|event| (event.order, lines(&event.order, options.dialect, true)));
    let is_told = |(order, lines): &(HeatOrder, String)| {
        let waits = matches!(order, HeatOrder::Heater { heater, .. } if waits(block, *heater));
        !waits && !filled.contains(&format!("\n{lines}"))
    };
    lines.filter(is_told).map(|(_, lines)| lines).collect()
}

/// True where a start block of the user's own has a heater at its temperature when it ends.
fn waits(block: &str, heater: u8) -> bool {
    let (codes, field, input) = match heater {
        HOT_END => (["M109", "M116"], "{hot_end_c}", "P0"),
        BED => (["M190", "M116"], "{bed_c}", "P1"),
        _ => (["M116"; 2], "{}", "P3"),
    };
    block.lines().any(|line| {
        let code = line.split(';').next().unwrap_or_default();
        let words: Vec<&str> = code.split_whitespace().collect();
        match words.as_slice() {
            ["M66", rest @ ..] => rest.contains(&input),
            // Targets that nothing waits for.
            ["M104" | "M140" | "M67" | "M68", ..] => false,
            [first, ..] => codes.contains(first) || code.contains(field),
            [] => false,
        }
    })
}

/// Temperatures and fan before the first move, for the fields of blocks.
pub(super) fn first_fields(heat: &[HeatEvent]) -> [(&'static str, String); 3] {
    let (mut celsius, mut percent) = ([0.0; HEATER_NAMES.len()], 0.0);
    for event in heat.iter().take_while(|event| event.tick == 0) {
        match event.order {
            HeatOrder::Heater {
                heater, celsius: c, ..
            } => celsius[usize::from(heater).min(HEATER_NAMES.len() - 1)] = c,
            HeatOrder::Fan { fan_pct } => percent = fan_pct,
        }
    }
    [
        ("hot_end_c", short(celsius[usize::from(HOT_END)], 1)),
        ("bed_c", short(celsius[usize::from(BED)], 1)),
        ("fan_pct", short(percent, 1)),
    ]
}

/// An order's lines.
fn lines(order: &HeatOrder, dialect: Dialect, at_rest: bool) -> String {
    let target = match *order {
        HeatOrder::Heater { celsius, .. } => short(celsius, 1),
        HeatOrder::Fan { .. } => String::new(),
    };
    lines_with(order, dialect, at_rest, &target)
}

/// The same with a heater's target as it is to be written.
fn lines_with(order: &HeatOrder, dialect: Dialect, at_rest: bool, target: &str) -> String {
    let output = if at_rest { "M68" } else { "M67" };
    match (*order, dialect.is_machine_tool()) {
        (HeatOrder::Fan { fan_pct }, true) => {
            format!("{output} E{FAN_OUTPUT} Q{}\n", short(0.01 * fan_pct, 4))
        }
        (HeatOrder::Fan { fan_pct }, false) => {
            let speed = match fan_pct > 0.0 {
                true => (fan_pct * 255.0 / 100.0).round().max(FAN_LEAST),
                false => 0.0,
            };
            format!("M106 S{}\n", short(speed, 0))
        }
        (HeatOrder::Heater { heater, wait, .. }, true) => {
            // The second hot end leaves its number to the fan.
            let number = if heater > BED { heater + 1 } else { heater };
            match wait {
                true => format!("M68 E{number} Q{target}\nM66 P{number} L3 Q{WAIT_S}\n"),
                false => format!("{output} E{number} Q{target}\n"),
            }
        }
        (HeatOrder::Heater { heater, wait, .. }, false) => {
            let code = match (heater, wait) {
                (BED, false) => "M140",
                (BED, true) => "M190",
                (_, false) => "M104",
                (_, true) => "M109",
            };
            let tool = if heater > BED { " T1" } else { "" };
            format!("{code}{tool} S{target}\n")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_written_as_each_controller_has_them() {
        let bed = HeatOrder::wait_for(BED, 60.0);
        let hot = HeatOrder::target(HOT_END, 207.5);
        let fan = |fan_pct| HeatOrder::Fan { fan_pct };
        for dialect in [Dialect::Klipper, Dialect::RepRapFirmware, Dialect::Marlin] {
            assert_eq!(lines(&bed, dialect, true), "M190 S60\n");
            assert_eq!(lines(&hot, dialect, false), "M104 S207.5\n");
            let second = HeatOrder::target(2, 200.0);
            assert_eq!(lines(&second, dialect, false), "M104 T1 S200\n");
            assert_eq!(lines(&fan(50.0), dialect, false), "M106 S128\n");
            assert_eq!(lines(&fan(0.1), dialect, false), "M106 S2\n");
            assert_eq!(lines(&fan(0.0), dialect, false), "M106 S0\n");
        }
        for dialect in [Dialect::LinuxCnc, Dialect::GrblHal] {
            assert_eq!(lines(&bed, dialect, false), "M68 E1 Q60\nM66 P1 L3 Q1800\n");
            assert_eq!(lines(&hot, dialect, false), "M67 E0 Q207.5\n");
            assert_eq!(lines(&hot, dialect, true), "M68 E0 Q207.5\n");
            assert_eq!(
                lines(&HeatOrder::target(2, 9.0), dialect, true),
                "M68 E3 Q9\n"
            );
            assert_eq!(lines(&fan(50.0), dialect, false), "M67 E2 Q0.5\n");
        }
    }
}

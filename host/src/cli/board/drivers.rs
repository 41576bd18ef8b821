//! Driver figures of a status, as text.

use headway_protocol::message::{DriverFlags, DriverStatus, Status};
use serde_json::{Value, json};
use std::fmt::Write;

/// Active modes and faults, by name, without the usual ones.
fn notes(driver: &DriverStatus) -> Vec<&'static str> {
    (0u32..)
        .zip(DriverFlags::NAMES)
        .filter(|(bit, _)| driver.flags >> bit & 1 == 1 && 1 << bit != DriverFlags::SPOKEN_WITH)
        .map(|(_, name)| name)
        .collect()
}

/// Drivers in the motors' order; `null` for a stand-alone one.
pub(crate) fn drivers_json(status: &Status) -> Vec<Value> {
    let one = |driver: &DriverStatus| {
        if !driver.has(DriverFlags::SPOKEN_WITH) {
            return Value::Null;
        }
        json!({
            "set_up": driver.has(DriverFlags::SET_UP),
            "warm": driver.has(DriverFlags::WARM),
            "off_for_heat": driver.has(DriverFlags::HOT),
            "off_for_short": driver.has(DriverFlags::SHORT),
            "open_load": driver.has(DriverFlags::OPEN_LOAD),
            "low_supply": driver.has(DriverFlags::LOW_SUPPLY),
            "stealth": driver.has(DriverFlags::STEALTH),
            "current_scale": driver.scale,
            "celsius": driver.celsius(),
            "retries": driver.retries,
        })
    };
    status.drivers.iter().map(one).collect()
}

/// A line for each driver that the board speaks with; the motors have numbers, since a board knows no names.
pub(crate) fn drivers_text(status: &Status) -> String {
    let mut text = String::new();
    for (motor, driver) in status.drivers.iter().enumerate() {
        if !driver.has(DriverFlags::SPOKEN_WITH) {
            continue;
        }
        let state = if driver.has(DriverFlags::SET_UP) {
            ""
        } else {
            "NOT SET UP, "
        };
        let notes: Vec<&str> = notes(driver)
            .into_iter()
            .filter(|note| *note != "set up")
            .map(|note| match note {
                "open load" => "warning: open load (is the motor plugged in?)",
                "warm" => "warning: warm",
                "low supply" => "warning: low supply",
                other => other,
            })
            .collect();
        let notes = if notes.is_empty() {
            String::new()
        } else {
            format!(", {}", notes.join(", "))
        };
        let warmth = driver
            .celsius()
            .map_or(String::new(), |c| format!(", {c} °C"));
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "driver {motor}: {state}current {} of 32{warmth}{notes}, {} retries",
            u32::from(driver.scale) + 1,
            driver.retries
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use headway_protocol::message::DeviceState;

    #[test]
    fn a_status_names_each_driver_and_warns() {
        let driver = |flags| DriverStatus {
            flags,
            scale: 25,
            retries: 3,
        };
        let status = Status {
            session: 0,
            state: DeviceState::Idle,
            sigma_permille: 0,
            override_percent: 100,
            flow_percent: 100,
            spans_done: 0,
            queue_knots: 0,
            queue_events: 0,
            referenced: 0,
            switches: 0,
            counts_steps: Default::default(),
            heaters: Default::default(),
            fan_permille: 0,
            fault: None,
            drivers: [driver(0xa3), driver(0), driver(1), driver(0x4203)]
                .into_iter()
                .collect(),
            probe: Default::default(),
        };
        let text = drivers_text(&status);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3, "{text}");
        assert!(lines[0].contains("driver 0: current 26 of 32, warning: open load"));
        assert!(lines[0].ends_with("stealth, 3 retries"));
        assert!(lines[1].starts_with("driver 2: NOT SET UP"));
        // -40 °C and one, from bit 8 on.
        assert!(
            lines[2].contains("current 26 of 32, 25 °C, 3 retries"),
            "{text}"
        );
        let json = drivers_json(&status);
        assert_eq!(
            (&json[0]["celsius"], &json[3]["celsius"]),
            (&Value::Null, &json!(25))
        );
        assert_eq!(json[0]["open_load"], true);
        assert_eq!(json[0]["warm"], false);
        assert_eq!(json[1], Value::Null);
    }
}

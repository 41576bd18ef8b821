//! Commands to a board at rest: mm, degrees and mm³ -> the protocol's commands.

use crate::cli::error::CliError;
use crate::settings::joint_names;
use headway_firmware::configuration::{JointConfiguration, MachineConfiguration};
use headway_firmware::flow::extruder_limits::event_peaks;
use headway_protocol::control::{EVENT_DURATION_TICKS_MAX, EVENT_VOLUME_UNITS_MAX};
use headway_protocol::message::Control;
use headway_protocol::segment::FlowAction;
use headway_protocol::units::Ticks;

/// 10⁻⁶ mm³.
const UNITS_PER_MM3: f64 = 1e6;
/// Share of a limit where no speed is given.
const SPEED_SHARE: f64 = 0.1;

/// The joint with this name or number.
pub(crate) fn joint_number(machine: &MachineConfiguration, text: &str) -> Result<u8, CliError> {
    let names = joint_names(&machine.kinematics);
    let by_name = names
        .iter()
        .position(|name| name.eq_ignore_ascii_case(text));
    let by_number = text
        .parse()
        .ok()
        .filter(|number| *number < machine.joints.len());
    by_name
        .or(by_number)
        .map(|joint| joint as u8)
        .ok_or_else(|| {
            CliError::Usage(format!(
                "joint `{text}`: this machine has {}",
                names.join(", ")
            ))
        })
}

/// Units on the wire per mm or degree: 0.1 µm; µrad of a degree.
fn units_of(joint: &JointConfiguration) -> f64 {
    if joint.rotary {
        1f64.to_radians() * 1e6
    } else {
        1e4
    }
}

/// Position in mm or degrees -> the command.
pub(crate) fn set_joint(
    machine: &MachineConfiguration,
    joint: &str,
    position: f64,
) -> Result<Control, CliError> {
    let number = joint_number(machine, joint)?;
    let units = machine
        .joints
        .get(usize::from(number))
        .map_or(1e4, units_of);
    let position_units = (position * units).round();
    // So written that a NaN does not fit.
    let fits = position_units.abs() <= f64::from(i32::MAX);
    if !fits {
        return Err(CliError::Usage(format!(
            "set-joint {joint} {position}: the position goes up to {:.0}",
            f64::from(i32::MAX) / units
        )));
    }
    Ok(Control::SetJoint {
        joint: number,
        position_units: position_units as i32,
    })
}

/// Distance in mm or degrees -> the command.
pub(crate) fn jog(
    machine: &MachineConfiguration,
    joint: &str,
    distance: f64,
    speed: Option<f64>,
) -> Result<Control, CliError> {
    let number = joint_number(machine, joint)?;
    let Some(limits) = machine.joints.get(usize::from(number)) else {
        return Err(CliError::Usage(format!(
            "joint `{joint}`: this machine has no such joint"
        )));
    };
    let units = units_of(limits);
    let limit = if limits.rotary {
        limits.speed_max.to_degrees()
    } else {
        limits.speed_max
    };
    let speed = speed.unwrap_or(SPEED_SHARE * limit);
    let distance_units = (distance * units).round();
    let speed_units_s = (speed * units).round();
    let distance_fits = distance_units.abs() <= f64::from(i32::MAX);
    if !distance_fits || !(1.0..=f64::from(u32::MAX)).contains(&speed_units_s) || speed > limit {
        return Err(CliError::Usage(format!(
            "jog {joint} {distance} at {speed}: the speed goes up to {limit:.3}, the distance to \
             {:.0}",
            f64::from(i32::MAX) / units
        )));
    }
    Ok(Control::Jog {
        joint: number,
        distance_units: distance_units as i32,
        speed_units_s: speed_units_s as u32,
    })
}

/// Volume in mm³, negative to pull back, and the peak rate in mm³/s -> the command.
pub(crate) fn extrude(
    machine: &MachineConfiguration,
    volume_mm3: f64,
    speed_mm3_s: Option<f64>,
) -> Result<Control, CliError> {
    let extruder = &machine.extruder;
    let limit = extruder.speed_max_mm3_s;
    let speed = speed_mm3_s.unwrap_or(SPEED_SHARE * limit);
    let volume_units = (volume_mm3.abs() * UNITS_PER_MM3).round();
    // The peaks of the same volume in a second.
    let [rate, acceleration] = event_peaks(volume_mm3.abs(), 1.0);
    let by_rate_s = rate / speed;
    let by_acceleration_s = (acceleration / extruder.acceleration_max_mm3_s2).sqrt();
    let duration_ticks = (by_rate_s.max(by_acceleration_s) * f64::from(machine.servo_hz)).ceil();
    // So written that a NaN does not fit.
    let fits = speed > 0.0
        && speed <= limit
        && (1.0..=f64::from(EVENT_VOLUME_UNITS_MAX)).contains(&volume_units)
        && (1.0..=f64::from(EVENT_DURATION_TICKS_MAX)).contains(&duration_ticks);
    if !fits {
        return Err(CliError::Usage(format!(
            "extrude {volume_mm3} at {speed}: the speed goes up to {limit:.3} mm³/s, the volume to {:.0} \
             mm³, and it must be done within {:.0} s",
            f64::from(EVENT_VOLUME_UNITS_MAX) / UNITS_PER_MM3,
            f64::from(EVENT_DURATION_TICKS_MAX) / f64::from(machine.servo_hz)
        )));
    }
    let action = match volume_mm3 > 0.0 {
        true => FlowAction::Prime,
        false => FlowAction::Retract,
    };
    Ok(Control::Extrude {
        action,
        volume_units: volume_units as u32,
        duration_ticks: Ticks(duration_ticks as u32),
    })
}

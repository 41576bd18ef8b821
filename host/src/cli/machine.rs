//! `headway machine new|check|firmware`.

use super::CliError;
use super::args_machine::{KindName, MachineArgs, MachineCommand};
use super::console::Console;
use super::load;
use super::output_file::write_file;
use super::warnings::settings_warnings;
use crate::settings::{Settings, machine_file, motor_rates_hz};
use serde_json::json;

pub(super) fn run(args: &MachineArgs, console: &Console) -> Result<(), CliError> {
    match &args.command {
        MachineCommand::New { kind, name, output } => {
            let mut settings = match kind {
                KindName::Planar => Settings::planar(),
                KindName::Gantry => Settings::gantry(),
            };
            if let Some(name) = name {
                settings.machine_name.clone_from(name);
            }
            settings
                .check()
                .map_err(|error| CliError::Usage(error.to_string()))?;
            console.result_to(output.as_deref(), &machine_file::to_new_toml(&settings))
        }
        MachineCommand::Check { file, json } => {
            let settings = load::machine(file)?;
            console.notes(&settings_warnings(&settings));
            if *json {
                return console.result(&format!("{:#}\n", summary_json(&settings)));
            }
            console.result(&summary_text(&settings))
        }
        MachineCommand::Firmware { file, output } => {
            let settings = load::machine(file)?;
            let machine = settings.machine;
            let unwritten = |problem: postcard::Error| {
                CliError::Job(format!("the machine cannot be written: {problem}"))
            };
            let mut bytes = postcard::to_allocvec(&machine).map_err(unwritten)?;
            if let Some(heaters) = &settings.heaters {
                bytes.extend(postcard::to_allocvec(heaters).map_err(unwritten)?);
            }
            write_file(output, &bytes)?;
            console.result(&format!(
                "{}: machine {:08x}, {} joints\n",
                output.display(),
                machine.hash(),
                machine.joints.len()
            ))
        }
    }
}

fn summary_json(settings: &Settings) -> serde_json::Value {
    let step_hz = f64::from(settings.machine.step_hz);
    let motors: Vec<_> = motor_rates_hz(&settings.machine)
        .into_iter()
        .map(|(motor, rate_hz)| {
            json!({"motor": motor, "rate_max_hz": rate_hz, "tick_share": rate_hz / step_hz})
        })
        .collect();
    json!({
        "name": settings.machine_name,
        "work_area_mm": settings.work_area_mm,
        "servo_hz": settings.machine.servo_hz,
        "step_hz": settings.machine.step_hz,
        "motors": motors,
    })
}

fn summary_text(settings: &Settings) -> String {
    let [low, high] = settings.work_area_mm;
    let mut text = format!(
        "{}: in order\n  work area {} x {} x {} mm, servo {} Hz, step tick {} Hz\n",
        settings.machine_name,
        high[0] - low[0],
        high[1] - low[1],
        high[2] - low[2],
        settings.machine.servo_hz,
        settings.machine.step_hz,
    );
    for (motor, rate_hz) in motor_rates_hz(&settings.machine) {
        let share_pct = 100.0 * rate_hz / f64::from(settings.machine.step_hz);
        text += &format!(
            "  {motor:10} {rate_hz:8.0} steps/s at its top speed, {share_pct:4.1} % of the step tick\n"
        );
    }
    text
}

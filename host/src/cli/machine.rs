//! `headway machine new|check|firmware`.

use crate::cli::args::machine::{KindName, MachineArgs, MachineCommand};
use crate::cli::board::configure::board_settings;
use crate::cli::error::CliError;
use crate::cli::reading::load;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::result_kind::{BOARD_SETTINGS, MACHINE};
use crate::pipeline::findings::settings_warnings::settings_warnings;
use crate::settings::aperture_text::nozzle_text;
use crate::settings::arms::{ARM_MODELS, ArmModel, flange_pose};
use crate::settings::examples::MachineExample;
use crate::settings::{Settings, joint_names, machine_file, motor_rates_hz};
use crate::text::refusal::Refusal;
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::steps::shaping::shapes;
use serde_json::json;
use std::f64::consts::SQRT_2;

/// Joint positions at which an arm's flange is to be compared with what its controller shows, degrees.
const COMPARED_DEG: [[f64; 6]; 4] = [
    [0.0; 6],
    [30.0, -60.0, 60.0, 0.0, 0.0, 0.0],
    [0.0, -90.0, 90.0, 0.0, 45.0, 0.0],
    [-20.0, -70.0, 50.0, 40.0, -30.0, 60.0],
];

pub(crate) fn run(args: &MachineArgs, console: &Console) -> Result<(), CliError> {
    match &args.command {
        MachineCommand::New { arm, .. } if arm.as_deref() == Some("list") => {
            console.result(&arms_text())
        }
        MachineCommand::New {
            kind,
            arm,
            name,
            output,
        } => {
            let settings = match arm {
                Some(arm) => settings_of_arm(arm)?,
                None => settings_of(*kind),
            };
            let mut settings = settings.map_err(|error| CliError::Usage(error.to_string()))?;
            if let Some(name) = name {
                settings.machine_name.clone_from(name);
            }
            settings
                .check()
                .map_err(|error| CliError::Usage(error.to_string()))?;
            let output = output.as_ref();
            let output = output.map(|output| output.file(MACHINE, console));
            let text = machine_file::to_new_toml(&settings);
            console.result_to(output.transpose()?.as_ref(), &text)
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
            let output = output.file(BOARD_SETTINGS, console)?;
            let settings = load::machine(file)?;
            let settings = board_settings(settings);
            let record = settings.encode().map_err(|refusal| {
                CliError::Job(format!(
                    "{}: the firmware refuses: {refusal}",
                    file.display()
                ))
            })?;
            let machine = settings.machine;
            output.write(&record)?;
            console.result(&format!(
                "{}: machine {:08x}, {} joints\n",
                output.path().display(),
                machine.hash(),
                machine.joints.len()
            ))
        }
    }
}

/// The published arms, a line each.
fn arms_text() -> String {
    let lines = ARM_MODELS.iter().map(|model| {
        let reach_m = 1e-3 * model.reach_mm();
        format!("{:22} {}, reach {reach_m:.2} m\n", model.name, model.title)
    });
    lines.collect()
}

/// The machine of a published arm.
fn settings_of_arm(name: &str) -> Result<Result<Settings, Refusal>, CliError> {
    let Some(model) = ArmModel::named(name) else {
        let known: Vec<&str> = ARM_MODELS.iter().map(|model| model.name).collect();
        return Err(CliError::Usage(format!(
            "--arm {}: not known; known are {}; for another one --kind arm6, and its lengths in [arm]",
            name.chars().take(40).collect::<String>(),
            known.join(", ")
        )));
    };
    Ok(model.settings())
}

/// The built-in machine of a kind.
fn settings_of(kind: KindName) -> Result<Settings, Refusal> {
    let example = match kind {
        KindName::Planar => return Ok(Settings::planar()),
        KindName::CoreXy => return Ok(Settings::core_xy()),
        KindName::Gantry => return Ok(Settings::gantry()),
        KindName::Trunnion => MachineExample::Trunnion,
        KindName::Arm6 => MachineExample::Arm6,
        KindName::HeadCb => MachineExample::HeadCb,
        KindName::TableBc => MachineExample::TableBc,
        KindName::TiltedHead => MachineExample::TiltedHead,
        KindName::Polar => MachineExample::Polar,
    };
    machine_file::from_toml(example.text())
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
        "free_tilt_deg": settings.head.as_ref().map(|head| head.free_tilt_rad().to_degrees()),
        "heading_motor": heading_motor_json(settings),
        "shapers": shaper_figures(&settings.machine),
    })
}

/// What the motor of the heading joint reaches at the nozzle.
fn heading_motor_json(settings: &Settings) -> serde_json::Value {
    let Some(motor) = &settings.heading_motor else {
        return serde_json::Value::Null;
    };
    json!({
        "speed_max_deg_s": motor.speed_max_rad_s().map(f64::to_degrees),
        "acceleration_max_deg_s2": motor.acceleration_max_rad_s2().to_degrees(),
        "gear_ratio": motor.gear_ratio,
        "fastest_gear_ratio": motor.fastest_ratio(),
    })
}

/// What a joint's input shaper costs.
#[derive(serde::Serialize)]
struct ShaperFigures {
    joint: &'static str,
    delay_ms: f64,
    length_ms: f64,
    /// Furthest off its plan at the joint's acceleration limit: linear joints.
    #[serde(skip_serializing_if = "Option::is_none")]
    off_plan_um: Option<f64>,
    /// The same of joints that turn.
    #[serde(skip_serializing_if = "Option::is_none")]
    off_plan_mrad: Option<f64>,
    /// What a corner of 90° between two joints like this one loses at most.
    #[serde(skip_serializing_if = "Option::is_none")]
    corner_um: Option<f64>,
}

fn shaper_figures(machine: &MachineConfiguration) -> Vec<ShaperFigures> {
    let tick_s = 1.0 / f64::from(machine.servo_hz);
    let names = joint_names(&machine.kinematics);
    let shapes = shapes(machine);
    let joints = names.iter().zip(&machine.joints).zip(&shapes);
    let figures = joints.filter_map(|((name, joint), shape)| {
        let shape = shape.as_ref()?;
        let variance_s2 = shape.variance_ticks2() * tick_s * tick_s;
        let off_plan = 0.5 * joint.acceleration_max * variance_s2;
        let off_plan_um = (!joint.rotary).then_some(1e3 * off_plan);
        Some(ShaperFigures {
            joint: name,
            delay_ms: 1e3 * tick_s * shape.delay_ticks(),
            length_ms: 1e3 * tick_s * shape.length_ticks(),
            off_plan_um,
            off_plan_mrad: joint.rotary.then_some(1e3 * off_plan),
            corner_um: off_plan_um.map(|off_um| SQRT_2 * off_um),
        })
    });
    figures.collect()
}

fn shapers_text(machine: &MachineConfiguration) -> String {
    let lines = shaper_figures(machine).into_iter().map(|figures| {
        let off = match (figures.off_plan_um, figures.corner_um) {
            (Some(off_um), Some(corner_um)) => {
                format!("{off_um:.1} µm, off a corner of 90° up to {corner_um:.1} µm")
            }
            _ => format!("{:.2} mrad", figures.off_plan_mrad.unwrap_or_default()),
        };
        format!(
            "  shaper of {}: late by {:.1} ms, {:.1} ms long, off its plan by up to {off}\n",
            figures.joint, figures.delay_ms, figures.length_ms
        )
    });
    lines.collect()
}

fn summary_text(settings: &Settings) -> String {
    let [low, high] = settings.work_area_mm;
    let mut text = format!(
        "{}: in order\n  work area {} x {} x {} mm, servo {} Hz, step tick {} Hz\n  {}\n",
        settings.machine_name,
        high[0] - low[0],
        high[1] - low[1],
        high[2] - low[2],
        settings.machine.servo_hz,
        settings.machine.step_hz,
        nozzle_text(&settings.aperture),
    );
    for (motor, rate_hz) in motor_rates_hz(&settings.machine) {
        let share_pct = 100.0 * rate_hz / f64::from(settings.machine.step_hz);
        text += &format!(
            "  {motor:10} {rate_hz:8.0} steps/s at its top speed, {share_pct:4.1} % of the step tick\n"
        );
    }
    if let Some((motor, _)) = settings.heading_motor_text() {
        text += &format!("  {motor}\n");
    }
    if let Some(head) = &settings.head {
        text += &format!(
            "  free tilt {:.1}°: leaning no more, no part of the head but its flat end is below the tip\n",
            head.free_tilt_rad().to_degrees()
        );
    }
    for joints_deg in COMPARED_DEG {
        if let Some([tip_mm, [a, b, c]]) = flange_pose(&settings.machine.kinematics, joints_deg) {
            text += &format!(
                "  joints {joints_deg:?}°: flange at {tip_mm:.1?} mm from the base, turned by {a:.2}, {b:.2}, {c:.2}° about Z, \
                 Y', X''\n"
            );
        }
    }
    text + &shapers_text(&settings.machine)
}

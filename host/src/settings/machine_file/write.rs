//! Writes a machine file with its comments; [`super::from_toml`] reads exactly the same settings.

use super::axes::write_axes;
use super::drivers::write_drivers;
use super::gcode::write_gcode;
use super::head::write_head;
use super::heat::write_heaters;
use super::kinds::write_kinds;
use super::motors::write_motors;
use super::shaper::write_shapers;
use super::switches::write_switches;
use super::wiring::write_wiring;
use crate::settings::check::{axes_joint_names, joint_names, kinematics_name};
use crate::settings::groups::{
    ExtruderKeys, FlowKeys, InfillKeys, MaterialKeys, MeasureKeys, PrintKeys, ProbeKeys, PumpKeys,
    SkirtKeys, TolerancesKeys,
};
pub(super) use crate::settings::keys::{degrees, nice, number, quoted, triple};
use crate::settings::{BOTTOM_LAYERS, Infill, Settings, TOP_LAYERS};
use headway_firmware::configuration::axis_family::AxisFamily;
use headway_firmware::configuration::{Arm, JointConfiguration, Kinematics};
use std::f64::consts::TAU;
use std::fmt::Write;

/// The settings as a commented machine file. What only prints of several layers have is left out
/// where there is one: jobs carry this text.
pub fn to_toml(settings: &Settings) -> String {
    written(settings, false)
}

/// The same with every key, to start from.
pub fn to_new_toml(settings: &Settings) -> String {
    let mut text = written(settings, true);
    if settings.material.is_none() {
        text.push_str(MATERIAL_TO_FILL_IN);
    }
    text
}

/// No temperature is right for every machine.
const MATERIAL_TO_FILL_IN: &str = "
# What is printed. Without it no job heats, and `export --to gcode` and boards with a hot end refuse it.
# A material that is printed cold has a hot_end_c of 0.
# [material]
# hot_end_c = 215
# bed_c = 60
# fan_pct = 100
# The fan is off on the first layer, which may be hotter, slower and, of a mesh, higher ([print] first_layer_height_mm).
# first_layer_hot_end_c = 220
# first_layer_bed_c = 65
# [kinds.first_layer]
# speed_mm_s = 20
";

fn written(settings: &Settings, with_layers: bool) -> String {
    let mut text = String::new();
    let with_layers = with_layers || settings.layers != 1;
    // Writing to a String cannot fail; the results say so by type only.
    let _ = write_machine(&mut text, settings);
    PrintKeys::write(&mut text, settings, with_layers);
    FlowKeys::write(&mut text, settings, with_layers);
    TolerancesKeys::write(&mut text, settings, with_layers);
    write_infill(&mut text, settings.infill.as_ref(), with_layers);
    SkirtKeys::write(&mut text, settings, with_layers);
    let _ = write_kinds(&mut text, &settings.kinds);
    if let Some(material) = &settings.material {
        MaterialKeys::write(&mut text, material, with_layers);
    }
    if let Some(heaters) = &settings.heaters {
        let _ = write_heaters(&mut text, heaters);
    }
    let _ = write_gcode(&mut text, settings);
    let _ = write_drivers(&mut text, settings);
    let _ = write_wiring(&mut text, &settings.wiring, &settings.machine);
    if let Some(switches) = &settings.switches {
        let _ = write_switches(&mut text, switches, &settings.machine);
    }
    if let Some(probe) = &settings.probe {
        ProbeKeys::write(&mut text, probe, with_layers);
    }
    if let Some(pump) = &settings.pump {
        PumpKeys::write(&mut text, pump, with_layers);
    }
    if let Some(measure) = &settings.measure {
        MeasureKeys::write(&mut text, measure, with_layers);
    }
    text
}

fn write_machine(text: &mut String, s: &Settings) -> std::fmt::Result {
    let machine = &s.machine;
    writeln!(
        text,
        "# Headway machine file. Lengths in mm, angles in degrees, volumes in mm³."
    )?;
    writeln!(
        text,
        "# Limits are the machine's own; the plan uses plan_share of each."
    )?;
    writeln!(text, "format = {}", super::FORMAT)?;
    writeln!(text, "name = {}", quoted(&s.machine_name))?;
    if let Some(board) = s.board {
        writeln!(text, "board = {}", quoted(board.text()))?;
    }
    if !matches!(machine.kinematics, Kinematics::Axes { .. }) {
        let name = kinematics_name(&machine.kinematics);
        writeln!(text, "kinematics = \"{name}\"")?;
    }
    write_kinematics(text, &machine.kinematics)?;
    writeln!(text, "servo_hz = {}", machine.servo_hz)?;
    writeln!(
        text,
        "# A whole multiple of servo_hz; no motor may step faster than 90 % of it."
    )?;
    writeln!(text, "step_hz = {}", machine.step_hz)?;
    writeln!(text, "plan_share = {}", number(s.plan_share))?;
    if let Kinematics::Axes { axes, .. } = &machine.kinematics {
        write_axes(text, axes)?;
    }
    writeln!(
        text,
        "\n# Inputs are centred over it unless --at says otherwise.\n[work_area]"
    )?;
    writeln!(text, "min_mm = {}", triple(s.work_area_mm[0]))?;
    writeln!(text, "max_mm = {}", triple(s.work_area_mm[1]))?;
    if let Kinematics::Arm6 { arm, .. } = &machine.kinematics {
        write_arm(text, arm)?;
    }
    let names = joint_names(&machine.kinematics);
    for (number, (name, joint)) in names.iter().zip(&machine.joints).enumerate() {
        let what = joint_comment(&machine.kinematics, name);
        write_joint(text, name, what, joint)?;
        if s.hold >> number & 1 == 1 {
            writeln!(text, "hold = true")?;
        }
    }
    write_motors(text, machine)?;
    write_shapers(text, machine)?;
    ExtruderKeys::write(text, machine, true);
    s.head
        .as_ref()
        .map_or(Ok(()), |head| write_head(text, head))
}

/// What the equations need beside the joints; an arm has a group of its own.
fn write_kinematics(text: &mut String, kinematics: &Kinematics) -> std::fmt::Result {
    match *kinematics {
        Kinematics::Planar | Kinematics::Arm6 { .. } | Kinematics::Axes { .. } => {}
        Kinematics::Gantry { pivot_length_mm } => {
            writeln!(
                text,
                "# From the nozzle tip to the crossing of the A and B axes."
            )?;
            writeln!(text, "pivot_length_mm = {}", number(pivot_length_mm))?;
        }
        Kinematics::Trunnion { centre_mm, .. } => {
            writeln!(
                text,
                "# A point on both axes of the table, with the table level."
            )?;
            writeln!(text, "table_centre_mm = {}", triple(centre_mm))?;
        }
    }
    if kinematics.solution() != 0 {
        writeln!(text, "# Chosen by the planner.")?;
        writeln!(text, "joint_solution = {}", kinematics.solution())?;
    }
    Ok(())
}

/// What a joint is, as a comment; nothing for those that everybody knows.
fn joint_comment(kinematics: &Kinematics, name: &str) -> &'static str {
    match (kinematics, name) {
        (Kinematics::Gantry { .. }, "a") => "\n# Head about X.",
        (Kinematics::Gantry { .. }, "b") => "\n# Head about Y.",
        (Kinematics::Trunnion { .. }, "a") => "\n# Table about X.",
        (Kinematics::Trunnion { .. }, "c") => {
            "\n# Table about its own normal; without ends it turns for ever."
        }
        (Kinematics::Axes { axes, .. }, "a" | "b" | "c") => rotary_comment(axes, name),
        (_, "c" | "h") => "\n# The nozzle about its axis; without ends it turns for ever.",
        (Kinematics::Arm6 { .. }, "j1") => "\n# From the base to the flange.",
        _ => "",
    }
}

/// Whether a rotary axis is in the head or under the part.
fn rotary_comment(axes: &AxisFamily, name: &str) -> &'static str {
    let names = axes_joint_names(axes);
    let is_first = names.iter().take(4).any(|joint| *joint == name);
    let axis = axes.second.as_ref().filter(|_| !is_first);
    if axis.unwrap_or(&axes.first).on_table {
        "\n# The table."
    } else {
        "\n# The head."
    }
}

fn write_arm(text: &mut String, arm: &Arm) -> std::fmt::Result {
    writeln!(
        text,
        "\n# Lengths of the arm (Brandstötter and others, 2014): a1 from the column's axis to the\n\
         # shoulder's, a2 from the elbow's axis to the forearm's, b beside the column, c1 up to the\n\
         # shoulder, c2 upper arm, c3 forearm to the wrist's centre, c4 on to the flange.\n[arm]"
    )?;
    for (name, length_mm) in [
        ("a1", arm.a1_mm),
        ("a2", arm.a2_mm),
        ("b", arm.b_mm),
        ("c1", arm.c1_mm),
        ("c2", arm.c2_mm),
        ("c3", arm.c3_mm),
        ("c4", arm.c4_mm),
    ] {
        writeln!(text, "{name}_mm = {}", number(length_mm))?;
    }
    let list = |values: &[f64]| {
        let values: Vec<String> = values.iter().map(|v| degrees(*v).to_string()).collect();
        format!("[{}]", values.join(", "))
    };
    writeln!(
        text,
        "# Joint = model angle + offset, negated where it is reversed."
    )?;
    writeln!(text, "offset_deg = {}", list(&arm.offset_rad))?;
    let reversed: [bool; 6] = std::array::from_fn(|joint| arm.reversed >> joint & 1 != 0);
    writeln!(text, "reversed = {reversed:?}")?;
    writeln!(text, "# The arm's base in machine axes.")?;
    writeln!(text, "base_mm = {}", triple(arm.base.origin_mm))?;
    writeln!(
        text,
        "base_roll_pitch_yaw_deg = {}",
        list(&arm.base.angles())
    )?;
    writeln!(
        text,
        "# The nozzle's tip in flange axes, and the tool's axes: Z from the tip into the head."
    )?;
    writeln!(text, "tool_mm = {}", triple(arm.tool.origin_mm))?;
    writeln!(
        text,
        "tool_roll_pitch_yaw_deg = {}",
        list(&arm.tool.angles())
    )
}

fn write_joint(
    text: &mut String,
    name: &str,
    what: &str,
    joint: &JointConfiguration,
) -> std::fmt::Result {
    let unit = "mm";
    writeln!(text, "{what}\n[joints.{name}]")?;
    if !joint.rotary {
        writeln!(text, "steps_per_mm = {}", number(joint.steps_per_unit))?;
        writeln!(text, "position_min_mm = {}", number(joint.position_min))?;
        writeln!(text, "position_max_mm = {}", number(joint.position_max))?;
        writeln!(text, "speed_max_{unit}_s = {}", number(joint.speed_max))?;
        writeln!(
            text,
            "acceleration_max_{unit}_s2 = {}",
            number(joint.acceleration_max)
        )?;
        return writeln!(text, "jerk_max_{unit}_s3 = {}", number(joint.jerk_max));
    }
    let steps_per_turn = nice(joint.steps_per_unit * TAU, joint.steps_per_unit, |v| {
        v / TAU
    });
    writeln!(text, "steps_per_turn = {steps_per_turn}")?;
    if joint.position_min.is_finite() {
        writeln!(text, "position_min_deg = {}", degrees(joint.position_min))?;
    }
    if joint.position_max.is_finite() {
        writeln!(text, "position_max_deg = {}", degrees(joint.position_max))?;
    }
    writeln!(text, "speed_max_deg_s = {}", degrees(joint.speed_max))?;
    writeln!(
        text,
        "acceleration_max_deg_s2 = {}",
        degrees(joint.acceleration_max)
    )?;
    writeln!(text, "jerk_max_deg_s3 = {}", degrees(joint.jerk_max))
}

/// Of a part without walls the group is a comment to start from.
fn write_infill(text: &mut String, infill: Option<&Infill>, with_layers: bool) {
    if let Some(infill) = infill {
        return InfillKeys::write(text, infill, with_layers);
    }
    text.push_str(
        "\n# Walls with straight lines inside, in place of beads along the outline all the way in.\n\
         # [infill]\n# walls = 2\n# density_pct = 20\n# angle_deg = 45\n",
    );
    if with_layers {
        text.push_str(&format!(
            "# Solid layers, where there are several.\n# bottom_layers = {BOTTOM_LAYERS}\n\
             # top_layers = {TOP_LAYERS}\n"
        ));
    }
}

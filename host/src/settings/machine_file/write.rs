//! Writes a machine file with its comments; [`super::from_toml`] reads exactly the same settings.

use super::axes::write_axes;
use super::drivers::write_drivers;
use super::gcode::write_gcode;
use super::head::write_head;
use super::heat::{write_heaters, write_material};
use super::kinds::write_kinds;
use super::motors::write_motors;
use super::probe::write_probe;
use super::shaper::write_shapers;
use super::switches::write_switches;
use super::wide_beads::{write_flow, write_print};
use super::wiring::write_wiring;
use crate::settings::aperture_text::aperture_text;
use crate::settings::check::{axes_joint_names, joint_names, kinematics_name};
use crate::settings::{BOTTOM_LAYERS, Settings, TOP_LAYERS, Tolerances};
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
";

fn written(settings: &Settings, with_layers: bool) -> String {
    let mut text = String::new();
    let with_layers = with_layers || settings.layers != 1;
    // Writing to a String cannot fail; the results say so by type only.
    let _ = write_machine(&mut text, settings);
    let _ = write_process(&mut text, settings, with_layers);
    let _ = write_infill(&mut text, settings, with_layers);
    let _ = write_skirt(&mut text, settings);
    let _ = write_kinds(&mut text, &settings.kinds);
    if let Some(material) = &settings.material {
        let _ = write_material(&mut text, material);
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
        let _ = write_probe(&mut text, probe);
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
    for (name, joint) in joint_names(&machine.kinematics).iter().zip(&machine.joints) {
        let what = joint_comment(&machine.kinematics, name);
        write_joint(text, name, what, joint)?;
    }
    write_motors(text, machine)?;
    write_shapers(text, machine)?;
    let e = &machine.extruder;
    writeln!(
        text,
        "\n# Steps count deposited volume. e = V + K dV/dt.\n[extruder]"
    )?;
    writeln!(text, "steps_per_mm3 = {}", number(e.steps_per_mm3))?;
    writeln!(text, "speed_max_mm3_s = {}", number(e.speed_max_mm3_s))?;
    writeln!(
        text,
        "acceleration_max_mm3_s2 = {}",
        number(e.acceleration_max_mm3_s2)
    )?;
    writeln!(
        text,
        "pressure_advance_s = {}",
        number(e.pressure_advance_s)
    )?;
    let window = number(e.pressure_advance_window_ms);
    writeln!(text, "pressure_advance_window_ms = {window}")?;
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

/// What the planner chooses by.
fn write_choices(text: &mut String, s: &Settings) -> std::fmt::Result {
    writeln!(text, "pass = \"{}\"", s.pass_mode.name())?;
    writeln!(text, "law = \"{}\"", s.heading_law.name())?;
    let quality = s.quality.name();
    writeln!(
        text,
        "# What ground left open or laid twice is worth in seconds of printing: fine, standard or fast."
    )?;
    writeln!(text, "quality = \"{quality}\"")
}

fn write_process(text: &mut String, s: &Settings, with_layers: bool) -> std::fmt::Result {
    writeln!(
        text,
        "\n# The command line overrides these (--aperture, --speed, ...).\n[print]"
    )?;
    writeln!(
        text,
        "# ellipse:AxB (semi-axes, the long one along tool X), circle:R, stadium:LxW, rect:LxWxR (full\n\
         # sizes, corner radius) or polygon:FILE (corners about the tool's axis, beside this file)"
    )?;
    writeln!(text, "aperture = \"{}\"", aperture_text(&s.aperture))?;
    if with_layers {
        writeln!(text, "# All of the same outline.\nlayers = {}", s.layers)?;
    }
    writeln!(text, "layer_height_mm = {}", number(s.layer_height_mm))?;
    writeln!(text, "speed_mm_s = {}", number(s.speed_mm_s))?;
    writeln!(text, "travel_speed_mm_s = {}", number(s.travel_speed_mm_s))?;
    writeln!(
        text,
        "tip_acceleration_mm_s2 = {}",
        number(s.tip_acceleration_mm_s2)
    )?;
    writeln!(text, "# Travel moves are lifted by this much.")?;
    writeln!(text, "lift_mm = {}", number(s.lift_mm))?;
    // Jobs carry this text: what is not asked for is left out.
    if s.layer_time_min_s > 0.0 {
        writeln!(text, "layer_time_min_s = {}", number(s.layer_time_min_s))?;
        let slow_mm_s = number(s.slow_speed_min_mm_s);
        writeln!(text, "slow_speed_min_mm_s = {slow_mm_s}")?;
    }
    write_print(text, &s.wide_beads)?;
    writeln!(text, "overlap_pct = {}", number(s.overlap_pct))?;
    write_travel(text, s)?;
    write_choices(text, s)?;
    writeln!(text, "\n[flow]\nfactor = {}", number(s.flow_factor))?;
    writeln!(text, "flow_max_mm3_s = {}", number(s.flow_max_mm3_s))?;
    let change = number(s.flow_rate_of_change_max_mm3_s2);
    writeln!(text, "rate_of_change_max_mm3_s2 = {change}")?;
    let p = &s.prime_retract;
    writeln!(
        text,
        "# Rates are peaks. A retract begins its lead before the pass ends,"
    )?;
    writeln!(
        text,
        "# a pass starts to move its lead before the prime is done."
    )?;
    writeln!(text, "retract_mm3 = {}", number(p.retract_mm3))?;
    writeln!(
        text,
        "retract_rate_mm3_s = {}",
        number(p.retract_rate_mm3_s)
    )?;
    writeln!(text, "retract_lead_s = {}", number(p.retract_lead_s))?;
    writeln!(text, "prime_mm3 = {}", number(p.prime_mm3))?;
    writeln!(text, "prime_rate_mm3_s = {}", number(p.prime_rate_mm3_s))?;
    writeln!(text, "prime_lead_s = {}", number(p.prime_lead_s))?;
    write_flow(text, &s.wide_beads)?;
    write_tolerances(text, &s.tolerances)
}

fn write_tolerances(text: &mut String, t: &Tolerances) -> std::fmt::Result {
    writeln!(
        text,
        "\n[tolerances]\n# How far a placed aperture may leave the outline."
    )?;
    writeln!(text, "outside_mm = {}", number(t.outside_mm))?;
    writeln!(text, "# Finished segments against the path.")?;
    writeln!(text, "tip_mm = {}", number(t.tip_mm))?;
    let mrad = |rad: f64| nice(rad * 1e3, rad, |v| v / 1e3);
    writeln!(text, "axis_mrad = {}", mrad(t.axis_rad))?;
    writeln!(text, "heading_mrad = {}", mrad(t.heading_rad))?;
    writeln!(text, "# Curves of the input become polygons this close.")?;
    writeln!(text, "flatten_mm = {}", number(t.flatten_mm))?;
    // Jobs carry this text: what is not asked for is left out.
    if t.corner_mm > 0.0 {
        writeln!(
            text,
            "# Corners of runs of waypoints are rounded within this; small roundings can take longer than rests."
        )?;
        writeln!(text, "corner_mm = {}", number(t.corner_mm))?;
    }
    Ok(())
}

/// What of the process concerns the way between passes.
fn write_travel(text: &mut String, s: &Settings) -> std::fmt::Result {
    writeln!(
        text,
        "# Of what must keep out of keep-outs, about the tool's axis; 0: the aperture alone."
    )?;
    let body = number(s.nozzle_body_radius_mm);
    writeln!(text, "nozzle_body_radius_mm = {body}")?;
    writeln!(text, "# Travel stays inside the part where there is a way.")?;
    writeln!(text, "avoid_crossing = {}", s.avoid_crossing)?;
    let seam = s.seam.place.name();
    writeln!(
        text,
        "# Where loops begin and end: nearest, aligned or sharpest."
    )?;
    writeln!(text, "seam = \"{seam}\"")?;
    let direction = degrees(s.seam.direction_rad);
    writeln!(text, "seam_direction_deg = {direction}")
}

fn write_infill(text: &mut String, s: &Settings, with_layers: bool) -> std::fmt::Result {
    writeln!(
        text,
        "\n# Walls with straight lines inside, in place of beads along the outline all the way in."
    )?;
    let Some(infill) = &s.infill else {
        writeln!(
            text,
            "# [infill]\n# walls = 2\n# density_pct = 20\n# angle_deg = 45"
        )?;
        if with_layers {
            writeln!(
                text,
                "# Solid layers, where there are several.\n# bottom_layers = {BOTTOM_LAYERS}\n\
                 # top_layers = {TOP_LAYERS}"
            )?;
        }
        return Ok(());
    };
    writeln!(text, "[infill]\nwalls = {}", infill.walls)?;
    writeln!(text, "density_pct = {}", number(infill.density_pct))?;
    writeln!(text, "angle_deg = {}", degrees(infill.angle_rad))?;
    for (key, solid) in [
        ("bottom_layers", infill.bottom_layers),
        ("top_layers", infill.top_layers),
    ] {
        if let Some(solid) = solid {
            writeln!(text, "{key} = {solid}")?;
        }
    }
    Ok(())
}

fn write_skirt(text: &mut String, s: &Settings) -> std::fmt::Result {
    let skirt = &s.skirt;
    writeln!(
        text,
        "\n# Loops around the part, printed before it: at a distance, and touching it (brim).\n[skirt]"
    )?;
    writeln!(text, "loops = {}", skirt.loops)?;
    writeln!(text, "brim_loops = {}", skirt.brim_loops)?;
    writeln!(text, "distance_mm = {}", number(skirt.distance_mm))
}

/// Shortest decimal that reads back as the same number.
pub(super) fn number(value: f64) -> String {
    format!("{value}")
}

pub(super) fn degrees(rad: f64) -> String {
    nice(rad.to_degrees(), rad, f64::to_radians)
}

/// The shortest decimal near `value` that `back` turns into exactly `wanted`: 1080 rather than
/// 1080.0000000000002. Neighbouring floats are tried where rounding never hits.
pub(super) fn nice(value: f64, wanted: f64, back: impl Fn(f64) -> f64) -> String {
    for digits in 0..=15usize {
        let text = format!("{value:.digits$}");
        if text.parse().is_ok_and(|v: f64| back(v) == wanted) {
            return text;
        }
    }
    let (mut low, mut high) = (value, value);
    for _ in 0..8 {
        for near in [low, high] {
            if back(near) == wanted {
                return number(near);
            }
        }
        (low, high) = (low.next_down(), high.next_up());
    }
    number(value)
}

pub(super) fn triple(values: [f64; 3]) -> String {
    format!(
        "[{}, {}, {}]",
        number(values[0]),
        number(values[1]),
        number(values[2])
    )
}

/// A TOML basic string.
pub(super) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_string()).to_string()
}

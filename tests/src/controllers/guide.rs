//! The configuration that the guide prints for each controller -> those of the models: what a reader is told to set is
//! what the models are run with.
//!
//! In: docs/guide/gcode.md. Out: the configurations. A key that is missing there is an error.

use super::{AXES, Printed, grblhal, klipper, linuxcnc, marlin, reprapfirmware};

/// A print by a controller that is set as the guide has it.
///
/// # Errors
/// What it refuses, with the line; a controller or a key that is not known.
pub fn print(controller: &str, guide: &str, text: &str) -> Result<Printed, String> {
    match controller {
        "klipper" => klipper::Klipper::new(self::klipper(guide)?).print(text),
        "reprapfirmware" => {
            reprapfirmware::RepRapFirmware::new(self::reprapfirmware(guide)?).print(text)
        }
        "marlin" => marlin::Marlin::new(self::marlin(guide)?).print(text),
        "linuxcnc" => linuxcnc::LinuxCnc::new(self::linuxcnc(guide)?).print(text),
        "grblhal" => grblhal::GrblHal::new(self::grblhal(guide)?).print(text),
        other => Err(format!("{other} is not known")),
    }
}

/// The block of the guide in which a line begins so.
///
/// # Errors
/// Where there is none.
fn block<'a>(guide: &'a str, begins: &str) -> Result<&'a str, String> {
    let of_fences = guide.split("```").skip(1).step_by(2);
    let mut found = of_fences.filter(|block| block.lines().any(|line| line.starts_with(begins)));
    found
        .next()
        .ok_or(format!("no block of the guide has {begins}"))
}

/// Numbers behind a key, whatever stands between them.
fn numbers(block: &str, key: &str) -> Result<Vec<f64>, String> {
    let lines = block
        .lines()
        .map(|line| line.split([';', '#']).next().unwrap_or("").trim());
    let of_key = |line: &str| {
        let rest = line.strip_prefix(key)?;
        rest.starts_with([' ', '=', ':', '\t'])
            .then(|| rest.to_string())
    };
    let rest = block
        .lines()
        .zip(lines)
        .find_map(|(whole, line)| {
            let whole = whole
                .trim()
                .trim_start_matches("#define")
                .trim_start_matches("//")
                .trim();
            of_key(line).or_else(|| of_key(whole))
        })
        .ok_or(format!("the guide has no {key}"))?;
    let rest = rest
        .split("//")
        .next()
        .unwrap_or("")
        .split(" #")
        .next()
        .unwrap_or("")
        .to_string();
    let words = rest.split(|c: char| !(c.is_ascii_digit() || ".-".contains(c)));
    Ok(words.filter_map(|word| word.parse().ok()).collect())
}

fn number(block: &str, key: &str) -> Result<f64, String> {
    let found = numbers(block, key)?;
    found
        .first()
        .copied()
        .ok_or(format!("{key} of the guide has no number"))
}

fn axes(values: Vec<f64>) -> Result<[f64; AXES], String> {
    values
        .try_into()
        .map_err(|values| format!("{values:?} are not those of seven axes"))
}

/// printer.cfg.
///
/// # Errors
/// What the guide lacks.
pub fn klipper(guide: &str) -> Result<klipper::Config, String> {
    let of = block(guide, "[printer]")?;
    let mut config = klipper::Config {
        velocity_max_mm_s: number(of, "max_velocity")?,
        acceleration_max_mm_s2: number(of, "max_accel")?,
        square_corner_mm_s: number(of, "square_corner_velocity")?,
        cruise_ratio_min: number(of, "minimum_cruise_ratio")?,
        z_max: [number(of, "max_z_velocity")?, number(of, "max_z_accel")?],
        extruder_corner_mm_s: number(of, "instantaneous_corner_velocity")?,
        extrude_only_max: [
            number(of, "max_extrude_only_velocity")?,
            number(of, "max_extrude_only_accel")?,
        ],
        cross_section_max_mm2: number(of, "max_extrude_cross_section")?,
        ..klipper::Config::default()
    };
    let limits = [number(of, "velocity")?, number(of, "accel")?];
    config.steppers.iter_mut().for_each(|(_, of)| *of = limits);
    Ok(config)
}

/// config.g.
///
/// # Errors
/// What the guide lacks.
pub fn reprapfirmware(guide: &str) -> Result<reprapfirmware::Config, String> {
    reprapfirmware::Config::read(block(guide, "M584")?)
}

/// Configuration.h: arrays are X Y Z A B C E.
///
/// # Errors
/// What the guide lacks.
pub fn marlin(guide: &str) -> Result<marlin::Config, String> {
    let of = block(guide, "#define CLASSIC_JERK")?;
    let jerk =
        ["X", "Y", "Z", "I", "J", "K", "E"].map(|axis| number(of, &format!("DEFAULT_{axis}JERK")));
    let jerk: Vec<f64> = jerk.into_iter().collect::<Result<_, _>>()?;
    let is_cut = !of.contains("//#define MIN_SOFTWARE_ENDSTOP_K")
        || !of.contains("//#define MAX_SOFTWARE_ENDSTOP_K");
    Ok(marlin::Config {
        steps: axes(numbers(of, "DEFAULT_AXIS_STEPS_PER_UNIT")?)?,
        speed_max: axes(numbers(of, "DEFAULT_MAX_FEEDRATE")?)?,
        acceleration_max: axes(numbers(of, "DEFAULT_MAX_ACCELERATION")?)?,
        accelerations: [
            number(of, "DEFAULT_ACCELERATION")?,
            number(of, "DEFAULT_RETRACT_ACCELERATION")?,
            number(of, "DEFAULT_TRAVEL_ACCELERATION")?,
        ],
        jerk: Some(axes(jerk)?),
        deviation_mm: 0.013,
        steps_min: number(of, "MIN_STEPS_PER_SEGMENT")?,
        heading_deg: is_cut.then_some([0.0, 360.0]),
    })
}

/// Settings: axes are X Y Z A B C U.
///
/// # Errors
/// What the guide lacks.
pub fn grblhal(guide: &str) -> Result<grblhal::Config, String> {
    let of = block(guide, "$11=")?;
    let of_axes = |first: u32| -> Result<[f64; AXES], String> {
        let each = (0..AXES as u32).map(|axis| number(of, &format!("${}", first + axis)));
        axes(each.collect::<Result<_, _>>()?)
    };
    Ok(grblhal::Config {
        letters: ['X', 'Y', 'Z', 'A', 'B', 'C', 'U'],
        deviation_mm: number(of, "$11")?,
        speed_max_min: of_axes(110)?,
        acceleration_max: of_axes(120)?,
    })
}

/// The INI file: sections of axes in order X Y Z A B C U.
///
/// # Errors
/// What the guide lacks.
pub fn linuxcnc(guide: &str) -> Result<linuxcnc::Config, String> {
    let of = block(guide, "[AXIS_X]")?;
    let section = |letter: char| -> Result<[f64; 2], String> {
        let head = format!("[AXIS_{letter}]");
        let from = of.find(&head).ok_or(format!("the guide has no {head}"))? + head.len();
        let own = of[from..].split('[').next().unwrap_or("");
        Ok([
            number(own, "MAX_VELOCITY")?,
            number(own, "MAX_ACCELERATION")?,
        ])
    };
    let found: Vec<[f64; 2]> = "XYZABCU".chars().map(section).collect::<Result<_, _>>()?;
    let of_u = of.split("[AXIS_U]").nth(1).unwrap_or("");
    Ok(linuxcnc::Config {
        speed_max: axes(found.iter().map(|of| of[0]).collect())?,
        acceleration_max: axes(found.iter().map(|of| of[1]).collect())?,
        extruder_mm: of_u.contains("MAX_LIMIT").then_some([0.0, 100.0]),
        extruder: 'U',
    })
}

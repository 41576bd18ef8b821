//! Patterns of undivided lines: steps, heading, pressure advance, prime, retract.
//!
//! In: the requested pattern, the settings. Out: lines in pattern coordinates (mm, degrees) and instructions.
//! They are read with a ruler or by comparing neighbours. Not covered: patterns in two halves (`verniers`).

use super::error::machine;
use super::line::{Line, length_mm, longer_mm, pitch_mm};
use super::{Asked, CalibrationError, Drawn, values};
use crate::settings::{PrimeRetract, Settings, joint_names};
use headway_firmware::configuration::Kinematics;
use std::f64::consts::TAU;

/// Usual distance of the marks, mm: a steel ruler reads it to 0.2 %.
const MARKS_MM: f64 = 100.0;
/// Usual length of lines, mm.
const LENGTH_MM: f64 = 60.0;
/// Height of the tube, mm: a calliper reads it to 0.5 %.
const TUBE_MM: f64 = 10.0;
/// Places along a turn of the tube.
const TUBE_PLACES: u32 = 48;
/// Turns before the second fan of headings, of a nozzle without stops: 1 % of the steps is 18° then.
const TURNS: u32 = 5;
/// Slow part of the lines for pressure advance, against the fast one.
const SLOW_SHARE: f64 = 0.25;

/// Marks at a known distance along X and Y, a tube of known height and volume.
pub(super) fn steps(asked: &Asked, settings: &Settings) -> Result<Drawn, CalibrationError> {
    if matches!(settings.machine.kinematics, Kinematics::Arm6 { .. }) {
        return Err(machine!(
            "the six joints of an arm are not read off lines one by one: take their steps from gear and motor"
        ));
    }
    let pitch_mm = pitch_mm(settings);
    let tick_mm = 2.0 * pitch_mm;
    let marks_mm = length_mm(asked.length_mm, MARKS_MM, settings);
    let above_mm = tick_mm + pitch_mm;
    let tick = |what: &str, from: [f64; 2], along: [f64; 2], heading_deg| {
        let to = [from[0] + tick_mm * along[0], from[1] + tick_mm * along[1]];
        Line::straight(what, [from, to], heading_deg, settings)
    };
    let height_mm = settings.layer_height_mm;
    let turns = (TUBE_MM / height_mm - 1.0).round().clamp(1.0, 200.0) as u32;
    let top_mm = height_mm * f64::from(turns + 1);
    let lines = vec![
        tick("X mark, left", [0.0, 0.0], [0.0, 1.0], 90.0),
        tick("X mark, right", [marks_mm, 0.0], [0.0, 1.0], 90.0),
        tick("Y mark, front", [0.0, above_mm], [1.0, 0.0], 0.0),
        tick("Y mark, back", [0.0, above_mm + marks_mm], [1.0, 0.0], 0.0),
        tube(
            [tick_mm + 3.0 * pitch_mm, above_mm + 3.0 * pitch_mm],
            turns,
            settings,
        ),
    ];
    Ok(Drawn {
        unit: "mm",
        lines,
        machines: Vec::new(),
        reading: vec![
            format!(
                "X: from the left edge of the left mark to the left edge of the right one it is {marks_mm} mm."
            ),
            format!(
                "Y: from the front edge of the front mark to the front edge of the back one it is {marks_mm} mm."
            ),
            format!("Z: the tube is {top_mm:.2} mm high where its seam ends."),
            "Extruder: weigh all of it; the volume told with the job times the material's density is what it \
             should weigh."
                .to_string(),
        ],
        change: "`steps_per_mm` of `[joints.x]`, `[joints.y]`, `[joints.z]`: times what it should be, by what \
                 you measured. `steps_per_mm3` of `[extruder]`: times the weight it should have, by the weight"
            .to_string(),
    })
}

/// A wall that rises by a layer a turn, at one heading: no turning of the nozzle is needed for it.
fn tube(centre_mm: [f64; 2], turns: u32, settings: &Settings) -> Line {
    let radius_mm = 2.0 * pitch_mm(settings);
    let height_mm = settings.layer_height_mm;
    let places = (0..=turns * TUBE_PLACES).map(|k| {
        let turned = f64::from(k) / f64::from(TUBE_PLACES);
        let (sin, cos) = (TAU * turned).sin_cos();
        [
            centre_mm[0] + radius_mm * cos,
            centre_mm[1] + radius_mm * sin,
            height_mm * (1.0 + turned),
        ]
    });
    let mut line = Line::through("tube", places, 0.0);
    // Below its first turn is the bed.
    let first_turn = TUBE_PLACES as usize;
    for (number, point) in line.points.iter_mut().enumerate() {
        let is_first = number <= first_turn;
        point.height_mm = Some(if is_first { point.tip_mm.z } else { height_mm });
    }
    line
}

/// A fan of headings about the travel, each line with the material of the narrowest bead.
pub(super) fn heading(asked: &Asked, settings: &Settings) -> Result<Drawn, CalibrationError> {
    let aperture = &settings.aperture;
    if aperture.is_round() {
        return Err(machine!(
            "the aperture is round: it lays the same bead whichever way it is turned; a heading is calibrated \
             with the nozzle that needs it (--aperture)"
        ));
    }
    let fan_deg = values(asked, [-30.0, 30.0], 13, [-90.0, 90.0])?;
    let endless = settings.machine.joints.last();
    let endless = endless.is_some_and(|joint| joint.position_max == f64::INFINITY);
    let turns = asked.turns.unwrap_or(if endless { TURNS } else { 0 });
    let (pitch_mm, narrow_mm) = (pitch_mm(settings), 2.0 * aperture.minor_mm());
    let length_mm = length_mm(asked.length_mm, LENGTH_MM, settings);
    let mut row = 0.0;
    let mut line = |what: String, heading_deg: f64, longer_mm: f64| {
        let y_mm = row * pitch_mm;
        row += 1.0;
        let ends = [[0.0, y_mm], [length_mm + longer_mm, y_mm]];
        Line::straight(what, ends, heading_deg, settings)
    };
    let mut lines = vec![
        line("narrowest bead".to_string(), 0.0, 0.0),
        line("widest bead".to_string(), 90.0, 0.0),
    ];
    let fans: &[u32] = if turns > 0 { &[0, turns] } else { &[0] };
    for &turned in fans {
        for (number, &deg) in fan_deg.iter().enumerate() {
            let is_middle = 2 * number + 1 == fan_deg.len();
            let longer_mm = if is_middle { longer_mm(settings) } else { 0.0 };
            let what = match turned {
                0 => "fan".to_string(),
                turned => format!("fan after {turned} turns"),
            };
            let heading_deg = deg + 360.0 * f64::from(turned);
            let laid = line(what, heading_deg, longer_mm);
            lines.push(laid.of_value(deg).with_width(narrow_mm));
        }
    }
    let mut reading = vec![
        format!(
            "The first two lines are the narrowest and the widest bead, {narrow_mm:.2} and {:.2} mm.",
            2.0 * aperture.major_mm()
        ),
        "All lines of a fan carry the same material. The narrowest and highest of them was laid along the \
         opening: where the machine believes the heading to be its value, it really is 0. Where no line \
         stands out, take the middle between two that look alike."
            .to_string(),
    ];
    if turns > 0 {
        reading.push(format!(
            "The second fan was laid after {turns} turns. Read it too: by how many degrees it reads more than \
             the first is what {turns} turns lose."
        ));
    }
    Ok(Drawn {
        unit: "degrees",
        lines,
        machines: Vec::new(),
        reading,
        change: heading_change(turns, settings),
    })
}

/// What to change by the values read off the fans.
fn heading_change(turns: u32, settings: &Settings) -> String {
    let joint = joint_names(&settings.machine.kinematics).last();
    let joint = joint.copied().unwrap_or("c");
    let mut change = format!(
        "No key for the zero: turn the nozzle's joint to the value read (`headway board jog`), then `headway \
         board set-joint {joint} 0`, or turn the nozzle in its seat"
    );
    if turns > 0 {
        change += &format!(
            ". Steps of its joint: new `steps_per_turn` = old times (1 + difference / {}), the difference being \
             the second fan's value less the first's",
            360 * turns
        );
    }
    change
}

/// Lines that are slow, fast and slow again, each by a machine with another pressure advance.
pub(super) fn advance(asked: &Asked, settings: &Settings) -> Result<Drawn, CalibrationError> {
    let now_s = settings.machine.extruder.pressure_advance_s;
    let values = values(asked, [0.0, f64::max(0.06, 2.0 * now_s)], 7, [0.0, 2.0])?;
    let (pitch_mm, length_mm) = (
        pitch_mm(settings),
        length_mm(asked.length_mm, 1.5 * LENGTH_MM, settings),
    );
    let (fast_mm_s, slow_mm_s) = (settings.speed_mm_s, SLOW_SHARE * settings.speed_mm_s);
    // As short as the tip's acceleration makes it, and half as much again.
    let change_mm = 0.75 * (fast_mm_s * fast_mm_s - slow_mm_s * slow_mm_s)
        / settings.tip_acceleration_mm_s2.max(1.0);
    let change_mm = change_mm.clamp(0.02 * length_mm, 0.1 * length_mm);
    let third_mm = length_mm / 3.0;
    let mut lines = Vec::new();
    for x_mm in [third_mm, 2.0 * third_mm] {
        let ends = [[x_mm, -pitch_mm], [x_mm, -0.2 * pitch_mm]];
        lines.push(Line::straight(
            "mark where the speed changes",
            ends,
            90.0,
            settings,
        ));
    }
    let mut machines = Vec::new();
    for (job, &value) in values.iter().enumerate() {
        let mut own = settings.clone();
        own.machine.extruder.pressure_advance_s = value;
        own.check()
            .map_err(|error| machine!("with the value {value}: {error}"))?;
        let y_mm = (job as f64 + 1.0) * pitch_mm;
        let places = [
            (0.0, slow_mm_s),
            (third_mm, slow_mm_s),
            (third_mm + change_mm, fast_mm_s),
            (2.0 * third_mm, fast_mm_s),
            (2.0 * third_mm + change_mm, slow_mm_s),
            (length_mm, slow_mm_s),
        ];
        let at = |&(x_mm, _): &(f64, f64)| [x_mm, y_mm, settings.layer_height_mm];
        let mut line = Line::through("slow, fast, slow", places.iter().map(at), 90.0);
        for (point, (_, speed_mm_s)) in line.points.iter_mut().zip(places) {
            point.speed_mm_s = Some(speed_mm_s);
        }
        line.job = job;
        lines.push(line.of_value(value));
        machines.push((value, own));
    }
    Ok(Drawn {
        unit: "s",
        lines,
        machines,
        reading: vec![
            "Pressure advance is the board's own setting and holds for a whole job: there is a job and a \
             machine file for each value. One after the other: `headway board configure` with the machine \
             file, switch the board off and on, home, stream the job. Each lays its line behind the last."
                .to_string(),
            "The best line is as wide just behind a mark as in the middle between two. Thin behind the first \
             mark and thick behind the second: the value is too small; the other way round: too large."
                .to_string(),
        ],
        change: "`pressure_advance_s` of `[extruder]`".to_string(),
    })
}

/// A line without a value before those that are compared: it begins with whatever the nozzle holds.
fn lead_in(length_mm: f64, settings: &Settings) -> Line {
    let ends = [[0.0, 0.0], [length_mm, 0.0]];
    Line::straight("lead-in, not to be read", ends, 0.0, settings)
}

/// A volume, moved no faster than the machine's own and in no less time: a small one at the full rate would
/// demand more of the motor than a large one.
fn rate_mm3_s(volume_mm3: f64, own_mm3: f64, own_rate_mm3_s: f64) -> f64 {
    match volume_mm3 > 0.0 {
        true => own_rate_mm3_s * f64::min(1.0, volume_mm3 / own_mm3),
        false => own_rate_mm3_s,
    }
}

fn no_volume(key: &str) -> CalibrationError {
    machine!(
        "flow.{key} is 0 in the machine file: begin with an estimate, as with 2 mm³ for a small nozzle"
    )
}

/// Lines with a prime of their own, after the machine's retract.
pub(super) fn prime(asked: &Asked, settings: &Settings) -> Result<Drawn, CalibrationError> {
    let own = settings.prime_retract;
    if own.prime_mm3 <= 0.0 {
        return Err(no_volume("prime_mm3"));
    }
    let values = values(asked, [0.0, 2.0 * own.prime_mm3], 9, [0.0, 1e4])?;
    let with = |value: f64| PrimeRetract {
        prime_mm3: value,
        prime_rate_mm3_s: rate_mm3_s(value, own.prime_mm3, own.prime_rate_mm3_s),
        ..own
    };
    let asked_of: Vec<PrimeRetract> = values.iter().map(|&value| with(value)).collect();
    Ok(Drawn {
        unit: "mm³",
        lines: stepped_lines(asked, &values, &asked_of, settings),
        machines: Vec::new(),
        reading: vec![
            "Look at the left ends, front to back; the longer line is the middle one. The best begins at once \
             and without a blob: a gap says too little, a blob too much."
                .to_string(),
            format!(
                "Every line follows a retract of {} mm³, so that the best prime is about that.",
                own.retract_mm3
            ),
        ],
        change: "`prime_mm3` of `[flow]`".to_string(),
    })
}

/// Lines with a retract of their own, given back by the next one's prime.
pub(super) fn retract(asked: &Asked, settings: &Settings) -> Result<Drawn, CalibrationError> {
    let own = settings.prime_retract;
    if own.retract_mm3 <= 0.0 {
        return Err(no_volume("retract_mm3"));
    }
    if own.prime_mm3 <= 0.0 {
        return Err(no_volume("prime_mm3"));
    }
    let values = values(asked, [0.0, 2.0 * own.retract_mm3], 9, [0.0, 1e4])?;
    let mut before_mm3 = own.prime_mm3;
    let asked_of = values.iter().map(|&value| {
        let prime_mm3 = std::mem::replace(&mut before_mm3, value);
        PrimeRetract {
            prime_mm3,
            prime_rate_mm3_s: rate_mm3_s(prime_mm3, own.prime_mm3, own.prime_rate_mm3_s),
            retract_mm3: value,
            retract_rate_mm3_s: rate_mm3_s(value, own.retract_mm3, own.retract_rate_mm3_s),
            ..own
        }
    });
    let asked_of: Vec<PrimeRetract> = asked_of.collect();
    Ok(Drawn {
        unit: "mm³",
        lines: stepped_lines(asked, &values, &asked_of, settings),
        machines: Vec::new(),
        reading: vec![
            "Look at the right ends and at what hangs between them and the next line's left end, front to \
             back; the longer line is the middle one. The best is the smallest value that ends without a blob \
             and without a string."
                .to_string(),
            "Each line's prime gives back what the one before pulled in: a line that begins with a gap was \
             behind a retract that took more than comes back at once."
                .to_string(),
        ],
        change: "`retract_mm3` of `[flow]`, and `prime_mm3` with it".to_string(),
    })
}

/// A lead-in, and a line for each value with its requests.
fn stepped_lines(
    asked: &Asked,
    values: &[f64],
    asked_of: &[PrimeRetract],
    settings: &Settings,
) -> Vec<Line> {
    let pitch_mm = pitch_mm(settings);
    let length_mm = length_mm(asked.length_mm, LENGTH_MM, settings);
    let mut lines = vec![lead_in(length_mm, settings)];
    for (number, (&value, &prime_retract)) in values.iter().zip(asked_of).enumerate() {
        let y_mm = (number as f64 + 1.0) * pitch_mm;
        let is_middle = 2 * number + 1 == values.len();
        let end_mm = length_mm + if is_middle { longer_mm(settings) } else { 0.0 };
        let ends = [[0.0, y_mm], [end_mm, y_mm]];
        let line = Line::straight("line", ends, 0.0, settings);
        lines.push(line.of_value(value).primed(prime_retract));
    }
    lines
}

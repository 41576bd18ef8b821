//! LinuxCNC's stand-alone interpreter (`rs274`, Debian's `linuxcnc-uspace`) as an oracle.
//!
//! In: G-code. Out: its canonical commands in order. It knows the axes X Y Z A B C.

use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Steps of an arc, rad: a chord of 5 mm is 0.2 µm beside it.
const ARC_STEP_RAD: f64 = 0.02;

/// One canonical command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Canonical {
    /// A straight move to X Y Z, mm, A B C, degrees.
    Straight([f64; 6]),
    /// An arc about a centre in the XY plane, counter-clockwise where it is above 0.
    Arc {
        /// Its end.
        to: [f64; 6],
        /// Centre, mm.
        centre_mm: [f64; 2],
        /// Full and begun turns.
        rotation: i32,
    },
    /// An analog output: number, value, with the motion or at once.
    Output(usize, f64, bool),
}

/// What the interpreter makes of a text; `None` where it is not installed.
///
/// # Panics
/// Where it refuses the text, with what it says.
pub fn canonical(text: &str) -> Option<Vec<Canonical>> {
    static RUNS: AtomicUsize = AtomicUsize::new(0);
    let run = RUNS.fetch_add(1, Ordering::Relaxed);
    let name = format!("headway-rs274-{}-{run}.ngc", std::process::id());
    let file = std::env::temp_dir().join(name);
    std::fs::write(&file, text).expect("a file");
    let ran = Command::new("rs274")
        .arg("-g")
        .arg(&file)
        .current_dir(std::env::temp_dir())
        .output();
    std::fs::remove_file(&file).expect("the file");
    let ran = ran.ok()?;
    let said = String::from_utf8_lossy(&ran.stdout).into_owned();
    let errors = String::from_utf8_lossy(&ran.stderr).into_owned();
    let end = said
        .lines()
        .rev()
        .take(20)
        .collect::<Vec<&str>>()
        .join("\n");
    assert!(ran.status.success(), "{errors}{end}");
    assert!(said.contains("PROGRAM_END"), "{errors}{end}");
    Some(said.lines().filter_map(command).collect())
}

fn command(line: &str) -> Option<Canonical> {
    let (head, numbers) = line.split_once('(')?;
    let numbers: Vec<f64> = numbers
        .trim_end_matches([')', ' '])
        .split(',')
        .filter_map(|number| number.trim().parse().ok())
        .collect();
    match head.rsplit(' ').next()? {
        "STRAIGHT_FEED" | "STRAIGHT_TRAVERSE" => {
            Some(Canonical::Straight(<[f64; 6]>::try_from(numbers).ok()?))
        }
        "ARC_FEED" => {
            let [x, y, cx, cy, rotation, z, a, b, c] = <[f64; 9]>::try_from(numbers).ok()?;
            Some(Canonical::Arc {
                to: [x, y, z, a, b, c],
                centre_mm: [cx, cy],
                rotation: rotation as i32,
            })
        }
        "SET_AUX_OUTPUT_VALUE" => Some(Canonical::Output(
            *numbers.first()? as usize,
            *numbers.get(1)?,
            false,
        )),
        "SET_MOTION_OUTPUT_VALUE" => Some(Canonical::Output(
            *numbers.first()? as usize,
            *numbers.get(1)?,
            true,
        )),
        _ => None,
    }
}

/// The places that a command goes through, its end last; an arc in steps, all axes evenly along it.
pub fn places(command: &Canonical, from: &[f64; 6]) -> Vec<[f64; 6]> {
    let (to, centre_mm, rotation) = match *command {
        Canonical::Straight(to) => return vec![to],
        Canonical::Output(..) => return Vec::new(),
        Canonical::Arc {
            to,
            centre_mm,
            rotation,
        } => (to, centre_mm, rotation),
    };
    let arm = |at: &[f64; 6]| [at[0] - centre_mm[0], at[1] - centre_mm[1]];
    let (arm_from, arm_to) = (arm(from), arm(&to));
    let radius_mm = arm_from[0].hypot(arm_from[1]);
    let begin_rad = arm_from[1].atan2(arm_from[0]);
    let sign = f64::from(rotation.signum());
    let turned = sign * (arm_to[1].atan2(arm_to[0]) - begin_rad);
    let full = f64::from(rotation.abs() - 1) * std::f64::consts::TAU;
    let sweep_rad = turned.rem_euclid(std::f64::consts::TAU) + full;
    let count = (sweep_rad / ARC_STEP_RAD).ceil().max(1.0) as usize;
    let place = |k: usize| {
        let share = k as f64 / count as f64;
        let mut at: [f64; 6] =
            std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]));
        let angle = begin_rad + sign * share * sweep_rad;
        at[0] = centre_mm[0] + radius_mm * angle.cos();
        at[1] = centre_mm[1] + radius_mm * angle.sin();
        at
    };
    (1..=count).map(place).collect()
}

//! Warnings about settings that are valid but hardly intended: mostly a number in another unit.

use crate::settings::{Settings, joint_names};

/// Longest step of a joint against half the aperture's least width: beyond it beads show the steps.
const STEP_SHARE: f64 = 0.25;
/// Longest step of a joint that turns, degrees.
const STEP_DEG: f64 = 2.0;

/// One line for each.
pub(crate) fn settings_warnings(settings: &Settings) -> Vec<String> {
    steep_layers(settings)
        .into_iter()
        .chain(coarse_steps(settings))
        .chain(weak_motor(settings))
        .collect()
}

fn steep_layers(settings: &Settings) -> Option<String> {
    let widest_mm = 2.0 * settings.aperture.major_mm();
    let height_mm = settings.layer_height_mm;
    (height_mm > widest_mm).then(|| {
        format!(
            "the layers are {height_mm} mm high and a bead at most {widest_mm:.3} mm wide: is that so \
             (--layer-height is in mm)?"
        )
    })
}

fn weak_motor(settings: &Settings) -> Option<String> {
    let (motor, is_above) = settings.heading_motor_text()?;
    is_above.then(|| format!("{motor}, which is more: it would lose steps"))
}

fn coarse_steps(settings: &Settings) -> Vec<String> {
    let names = joint_names(&settings.machine.kinematics).iter();
    let joints = names.zip(&settings.machine.joints);
    let coarse = joints.filter_map(|(name, joint)| {
        let (step, most, unit, key) = if joint.rotary {
            let step_deg = (1.0 / joint.steps_per_unit).to_degrees();
            (step_deg, STEP_DEG, "°", "steps_per_turn")
        } else {
            let most_mm = STEP_SHARE * settings.aperture.minor_mm();
            (1.0 / joint.steps_per_unit, most_mm, " mm", "steps_per_mm")
        };
        (step > most).then(|| {
            format!("one step of joint {name} is {step:.3}{unit}: is joints.{name}.{key} right?")
        })
    });
    coarse.collect()
}

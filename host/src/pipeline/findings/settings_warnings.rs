//! Warnings about settings that are valid but hardly intended: mostly a number in another unit.

use super::objections::{Objection, ObjectionKind};
use crate::settings::{Settings, joint_names};
use crate::text::short_number::Short;

/// Highest layer against the narrowest bead, as guides of slicers have it for the nozzle's diameter.
const HEIGHT_SHARE: f64 = 0.8;
/// Longest step of a joint against half the aperture's least width: beyond it beads show the steps.
const STEP_SHARE: f64 = 0.25;
/// Longest step of a joint that turns, degrees.
const STEP_DEG: f64 = 2.0;

/// One line for each.
pub(crate) fn settings_warnings(settings: &Settings) -> Vec<String> {
    coarse_steps(settings)
        .into_iter()
        .chain(weak_motor(settings))
        .collect()
}

/// Layers so high that the narrowest beads are hardly wider than high, which do not hold.
pub(super) fn high_layers(height_mm: f64, settings: &Settings) -> Option<Objection> {
    let narrow_mm = 2.0 * settings.aperture.minor_mm();
    let most_mm = HEIGHT_SHARE * narrow_mm;
    (height_mm > most_mm * (1.0 + 1e-9)).then(|| {
        let [height, narrow, most] = [height_mm, narrow_mm, most_mm].map(Short);
        Objection {
            kind: ObjectionKind::LayerHeight,
            text: format!(
                "HIGH LAYERS: layers of {height} mm are higher than {HEIGHT_SHARE} of the narrowest bead of this nozzle ({narrow} \
                 mm), and such beads do not hold: give layers of at most {most} mm (--layer-height), or a wider nozzle"
            ),
        }
    })
}

/// A flow that the material's `melt_max_mm3_s` does not allow.
pub(crate) fn fast_melt(flow_mm3_s: f64, settings: &Settings) -> Option<Objection> {
    let most_mm3_s = settings.material?.melt_max_mm3_s?;
    let [flow, most] = [flow_mm3_s, most_mm3_s].map(Short);
    (flow_mm3_s > most_mm3_s * (1.0 + 1e-3)).then(|| Objection {
        kind: ObjectionKind::Melt,
        text: format!(
            "MELT: the flow reaches {flow} mm³/s, and the hot end melts {most} mm³/s of this material (melt_max_mm3_s): print \
             slower (--speed), or give a lower flow_max_mm3_s in [flow]"
        ),
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

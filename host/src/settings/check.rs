//! Are the settings possible, and possible together?

use super::drivers::check_drivers;
use super::groups::{
    ExtruderKeys, FlowKeys, InfillKeys, MELT_SPEED_RANGE, MaterialKeys, PrintKeys, STEPS_RANGE,
    SkirtKeys, TolerancesKeys,
};
use super::heat::wrong_heater;
use super::{AXIS_TOLERANCE_MAX_DEG, Settings, TILT_MAX_ASKED_DEG, kinds, wide_beads};
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;
use headway_firmware::configuration::axis_family::{AxisFamily, RotaryAxis};
use headway_firmware::configuration::flow_curves::{CurvePoints, FlowCurves};
use headway_firmware::configuration::{Kinematics, MachineConfiguration};
use headway_firmware::steps::{INTERVAL_TICKS_MAX, INTERVAL_TICKS_MIN};
use std::f64::consts::TAU;

/// Largest share of the step tick rate that a motor may use at its top speed: an integrator of one
/// step a tick loses steps at 1, and the time warp and correction need some room.
pub const STEP_RATE_SHARE_MAX: f64 = 0.9;
/// Longest work area that makes sense, mm: ten times the largest concrete printers.
const LENGTH_MAX_MM: f64 = 100_000.0;

/// Longest name of a machine, characters: it is in every job and message.
pub(super) const NAME_CHARS_MAX: usize = 200;
/// Farthest end of a joint that is an end, mm: 32 bits of the wire's tenths of a micrometre hold 214,748 mm;
const POSITION_MAX_MM: f64 = 2.0e5;
/// and rad: what is beyond is a number in another unit.
const POSITION_MAX_RAD: f64 = 1.0e6;
/// Slowest and fastest of anything that moves, in its own unit and a second: from a tower's creep to
/// what no machine has. Outside of it times and counts leave what numbers hold.
const SPEED_RANGE: [f64; 2] = [1e-4, 1e6];
const ACCELERATION_RANGE: [f64; 2] = [1e-4, 1e9];
const JERK_RANGE: [f64; 2] = [1e-4, 1e13];
/// Servo ticks of a span of the least length.
const SPAN_TICKS_MIN: f64 = 6.0;

/// Longest time from rest to a top speed, or to a top acceleration: slow and heavy machines take
/// some seconds, and what is above is a number in another unit. Motion that never reaches its speed
/// takes for ever, and so does planning it.
pub const RISE_MAX_S: f64 = 60.0;

/// Names of the joints in the kinematics' order, as in the machine file.
pub fn joint_names(kinematics: &Kinematics) -> &'static [&'static str] {
    match kinematics {
        Kinematics::Planar => &["x", "y", "z", "c"],
        Kinematics::Gantry { .. } => &["x", "y", "z", "a", "b", "c"],
        Kinematics::Trunnion { .. } => &["x", "y", "z", "a", "c", "h"],
        Kinematics::Arm6 { arm, .. } if arm.nozzle => &["j1", "j2", "j3", "j4", "j5", "j6", "h"],
        Kinematics::Arm6 { .. } => &["j1", "j2", "j3", "j4", "j5", "j6"],
        Kinematics::Axes { axes, .. } => axes_joint_names(axes),
    }
}

/// The same of linear and rotary axes: A, B, C by the machine axis that each is nearest to, the next letter where two
/// share one.
pub(super) fn axes_joint_names(axes: &AxisFamily) -> &'static [&'static str] {
    const NAMES: [[&[&str]; 4]; 3] = [
        [
            &["x", "y", "z", "a", "h"],
            &[],
            &["x", "y", "z", "a", "b", "h"],
            &["x", "y", "z", "a", "c", "h"],
        ],
        [
            &["x", "y", "z", "b", "h"],
            &["x", "y", "z", "b", "a", "h"],
            &[],
            &["x", "y", "z", "b", "c", "h"],
        ],
        [
            &["x", "y", "z", "c", "h"],
            &["x", "y", "z", "c", "a", "h"],
            &["x", "y", "z", "c", "b", "h"],
            &[],
        ],
    ];
    if axes.polar {
        return &["x", "c", "z", "h"];
    }
    let letter = |axis: &RotaryAxis| {
        let shares = axis.axis.map(f64::abs);
        let larger = |best: usize, next: usize| {
            if shares[next] > shares[best] + 1e-9 {
                next
            } else {
                best
            }
        };
        larger(larger(0, 1), 2)
    };
    let first = letter(&axes.first);
    let second = axes.second.as_ref().map(|second| {
        let second = letter(second);
        if second == first {
            (second + 1) % 3
        } else {
            second
        }
    });
    NAMES[first][second.map_or(0, |second| second + 1)]
}

/// Name of the kinematics, as in the machine file.
pub(crate) fn kinematics_name(kinematics: &Kinematics) -> &'static str {
    match kinematics {
        Kinematics::Planar => "planar",
        Kinematics::Gantry { .. } => "gantry",
        Kinematics::Trunnion { .. } => "trunnion",
        Kinematics::Arm6 { .. } => "arm6",
        Kinematics::Axes { .. } => "axes",
    }
}

impl Settings {
    /// Everything in range and nothing at odds; call it after the last override.
    pub fn check(&self) -> Result<(), Refusal> {
        self.check_name()?;
        self.check_joints()?;
        self.check_extruder()?;
        self.check_step_rates()?;
        self.check_work_area()?;
        self.check_process()?;
        self.check_flow()?;
        self.check_heat()?;
        let can = self.machine.check();
        can.map_err(|error| refusal!("the controller cannot run this machine: {error}"))
    }

    fn check_name(&self) -> Result<(), Refusal> {
        let name = &self.machine_name;
        let chars = name.chars().count();
        let problem = if chars > NAME_CHARS_MAX {
            format!("{chars} characters")
        } else if name.chars().any(char::is_control) {
            "control characters in it".to_string()
        } else {
            return Ok(());
        };
        Err(refusal!(
            "the machine's name has {problem}: give it up to {NAME_CHARS_MAX} printable characters"
        ))
    }

    fn check_joints(&self) -> Result<(), Refusal> {
        let machine = &self.machine;
        let names = joint_names(&machine.kinematics);
        if names.len() != machine.joints.len() {
            return Err(refusal!(
                "kinematics {} has {} joints, but {} are given",
                kinematics_name(&machine.kinematics),
                names.len(),
                machine.joints.len()
            ));
        }
        if let Kinematics::Gantry { pivot_length_mm } = machine.kinematics {
            in_range("pivot_length_mm", pivot_length_mm, 0.0, 10_000.0)?;
        }
        for (name, joint) in names.iter().zip(&machine.joints) {
            let key = |what: &str| format!("joints.{name}.{what}");
            let unit = if joint.rotary { "turn" } else { "mm" };
            let a_unit = if joint.rotary { TAU } else { 1.0 };
            let steps = joint.steps_per_unit * a_unit;
            sensible(&key(&format!("steps_per_{unit}")), steps, STEPS_RANGE)?;
            sensible(&key("speed_max"), joint.speed_max, SPEED_RANGE)?;
            let acceleration = joint.acceleration_max;
            sensible(&key("acceleration_max"), acceleration, ACCELERATION_RANGE)?;
            sensible(&key("jerk_max"), joint.jerk_max, JERK_RANGE)?;
            rises(
                [&key("acceleration_max"), &key("speed_max")],
                [joint.acceleration_max, joint.speed_max],
            )?;
            rises(
                [&key("jerk_max"), &key("acceleration_max")],
                [joint.jerk_max, joint.acceleration_max],
            )?;
            // Infinite ends mean no stop; NaN fails the comparison.
            if joint.position_min >= joint.position_max
                || joint.position_min.is_nan()
                || joint.position_max.is_nan()
            {
                return Err(empty_range(
                    &key("position"),
                    joint.position_min,
                    joint.position_max,
                ));
            }
            let most = if joint.rotary {
                POSITION_MAX_RAD
            } else {
                POSITION_MAX_MM
            };
            let ends = [joint.position_min, joint.position_max];
            for end in ends.into_iter().filter(|end| end.is_finite()) {
                in_range(&key("position"), end, -most, most)?;
            }
        }
        Ok(())
    }

    fn check_extruder(&self) -> Result<(), Refusal> {
        let e = &self.machine.extruder;
        ExtruderKeys::check(&self.machine)?;
        check_flow_curves(&self.machine.curves)?;
        rises(
            [
                "extruder.acceleration_max_mm3_s2",
                "extruder.speed_max_mm3_s",
            ],
            [e.acceleration_max_mm3_s2, e.speed_max_mm3_s],
        )
    }

    fn check_step_rates(&self) -> Result<(), Refusal> {
        let machine = &self.machine;
        let (servo_hz, step_hz) = (machine.servo_hz, machine.step_hz);
        let ticks = step_hz.checked_div(servo_hz).unwrap_or(0);
        let fits = (INTERVAL_TICKS_MIN..=INTERVAL_TICKS_MAX).contains(&ticks);
        if !fits || !step_hz.is_multiple_of(servo_hz) {
            return Err(refusal!(
                "step_hz = {step_hz} must be a whole multiple of servo_hz = {servo_hz}, \
                 {INTERVAL_TICKS_MIN} to {INTERVAL_TICKS_MAX} times"
            ));
        }
        in_range("servo_hz", f64::from(servo_hz), 500.0, 20_000.0)?;
        in_range("step_hz", f64::from(step_hz), 10_000.0, 2_000_000.0)?;
        for (motor, rate_hz) in motor_rates_hz(machine) {
            if rate_hz > STEP_RATE_SHARE_MAX * f64::from(step_hz) {
                return Err(refusal!(
                    "{motor} makes {rate_hz:.0} steps/s at its top speed, more than 90 % of step_hz = {step_hz}: \
                     lower its speed_max or its steps (microsteps), or raise step_hz"
                ));
            }
        }
        Ok(())
    }

    fn check_work_area(&self) -> Result<(), Refusal> {
        let [low, high] = self.work_area_mm;
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            let size = high[axis] - low[axis];
            if size.is_nan() || size <= 0.0 || size > LENGTH_MAX_MM {
                return Err(empty_range(
                    &format!("work_area {name}"),
                    low[axis],
                    high[axis],
                ));
            }
            let joint = &self.machine.joints[axis];
            // Of an arm no joint is an axis, and a polar table has all around it what X has on one side: what they
            // reach is seen along the path.
            let polar =
                matches!(&self.machine.kinematics, Kinematics::Axes { axes, .. } if axes.polar);
            let is_axis = !(joint.rotary || polar && axis < 2);
            if is_axis && (low[axis] < joint.position_min || high[axis] > joint.position_max) {
                return Err(refusal!(
                    "work_area {name} runs from {} to {} mm, beyond the joint's range {} to {} mm",
                    low[axis],
                    high[axis],
                    joint.position_min,
                    joint.position_max
                ));
            }
        }
        Ok(())
    }

    /// The density of lines whose spacing is given; after every change of the aperture.
    pub(super) fn space_lines(&mut self) {
        let widest_mm = 2.0 * self.aperture.major_mm();
        if let Some(infill) = &mut self.infill
            && let Some(spacing_mm) = infill.spacing_mm
        {
            infill.density_pct = 100.0 * widest_mm / spacing_mm;
        }
    }

    fn check_process(&self) -> Result<(), Refusal> {
        let (major, minor) = (self.aperture.major_mm(), self.aperture.minor_mm());
        in_range("print.aperture (long size)", 2.0 * major, 0.02, 1000.0)?;
        in_range(
            "print.aperture (short size)",
            2.0 * minor,
            0.02,
            2.0 * major,
        )?;
        if self.layer_height_mm > 2.0 * major {
            return Err(refusal!(
                "print.layer_height_mm (--layer-height) is {}, but a bead of this aperture is at most {} mm wide: give lower \
                 layers, or a wider nozzle (--aperture; sizes are full ones, in mm)",
                Short(self.layer_height_mm),
                Short(2.0 * major)
            ));
        }
        PrintKeys::check(self)?;
        kinds::check(self)?;
        wide_beads::check(self)?;
        if let Some(infill) = &self.infill {
            if let Some(spacing_mm) = infill.spacing_mm {
                in_range("infill.spacing_mm", spacing_mm, 2.0 * major, LENGTH_MAX_MM)?;
            }
            InfillKeys::check(infill)?;
        }
        SkirtKeys::check(self)?;
        if let Some(head) = &self.head {
            head.check()?;
        }
        in_range("plan_share", self.plan_share, 0.1, 0.99)?;
        TolerancesKeys::check(self)?;
        self.check_corners()
    }

    /// What runs of waypoints may leave their corners by.
    fn check_corners(&self) -> Result<(), Refusal> {
        let (corner_mm, widest_mm) = (self.tolerances.corner_mm, 2.0 * self.aperture.major_mm());
        if !(0.0..=widest_mm).contains(&corner_mm) {
            return Err(refusal!(
                "--corner-tolerance {} (tolerances.corner_mm): write a length in mm from 0, which leaves corners as they \
                 are, to {}, the widest bead of this aperture; 0.2 is usual",
                Short(corner_mm),
                Short(widest_mm)
            ));
        }
        if let Some(tilt_rad) = self.tilt_max_rad {
            in_range("--tilt-max", tilt_rad.to_degrees(), 0.0, TILT_MAX_ASKED_DEG)?;
        }
        let axis_deg = self.axis_tolerance_rad.to_degrees();
        // The last digit of degrees that were given.
        in_range(
            "--axis-tolerance",
            axis_deg,
            0.0,
            AXIS_TOLERANCE_MAX_DEG + 1e-9,
        )
    }

    fn check_heat(&self) -> Result<(), Refusal> {
        if let Some(material) = &self.material {
            MaterialKeys::check(material)?;
        }
        let wrong = self.heaters.as_ref().and_then(wrong_heater);
        if let Some(key) = wrong {
            return Err(refusal!(
                "heaters.{key}: a number is not finite, negative, or above 500 °C"
            ));
        }
        // None of the firmware's boards counts them: the fan would always be stalled.
        let tells = self.heaters.as_ref().is_some_and(|of| of.fan_tells_turns);
        if let (true, Some(board)) = (tells, self.board) {
            let board = board.text();
            return Err(refusal!(
                "heaters.fan_tells_turns: the firmware of {board} counts no pulses of a fan, which would count as stalled: \
                 leave the key out"
            ));
        }
        check_drivers(&self.drivers, &self.machine)?;
        self.check_heading_motor()?;
        self.check_switches()?;
        self.check_probe()?;
        self.check_pump()?;
        self.check_measure()?;
        self.check_wiring()
    }

    fn check_flow(&self) -> Result<(), Refusal> {
        FlowKeys::check(self)?;
        let carried_mm3_s =
            self.span_volume_mm3() / SPAN_TICKS_MIN * f64::from(self.machine.servo_hz);
        let flow_range = [MELT_SPEED_RANGE[0], MELT_SPEED_RANGE[1].min(carried_mm3_s)];
        sensible("flow.flow_max_mm3_s", self.flow_max_mm3_s, flow_range)?;
        rises(
            ["flow.rate_of_change_max_mm3_s2", "flow.flow_max_mm3_s"],
            [self.flow_rate_of_change_max_mm3_s2, self.flow_max_mm3_s],
        )?;
        let p = &self.prime_retract;
        let push_max_mm3 = self.push_max_mm3();
        in_range("flow.retract_mm3", p.retract_mm3, 0.0, push_max_mm3)?;
        in_range("flow.prime_mm3", p.prime_mm3, 0.0, push_max_mm3)?;
        let less_losses = match self.machine.curves.loss.is_empty() {
            true => "",
            false => ", less what extruder.flow_loss takes",
        };
        let limit = self.machine.arriving_limits()[0] * self.plan_share;
        for (key, value) in [
            ("flow.retract_rate_mm3_s", p.retract_rate_mm3_s),
            ("flow.prime_rate_mm3_s", p.prime_rate_mm3_s),
            ("flow.flow_max_mm3_s", self.flow_max_mm3_s),
        ] {
            if value > limit {
                return Err(refusal!(
                    "{key} is {}, more than the {} of extruder.speed_max_mm3_s times plan_share{less_losses}",
                    Short(value),
                    Short(limit)
                ));
            }
        }
        rises(
            ["flow.retract_rate_mm3_s", "flow.retract_mm3"],
            [p.retract_rate_mm3_s, p.retract_mm3],
        )?;
        rises(
            ["flow.prime_rate_mm3_s", "flow.prime_mm3"],
            [p.prime_rate_mm3_s, p.prime_mm3],
        )
    }
}

/// Step rate of every motor at its top speed, by name, the extruder last.
pub fn motor_rates_hz(machine: &MachineConfiguration) -> Vec<(String, f64)> {
    let names = joint_names(&machine.kinematics);
    let joints = names.iter().zip(&machine.joints).enumerate();
    let joints = joints.map(|(place, (name, joint))| {
        let pair = machine.motors.pair.as_ref();
        let pair = pair.filter(|pair| pair.joints.contains(&(place as u8)));
        let Some(pair) = pair else {
            let rate_hz = joint.steps_per_unit * joint.speed_max;
            return (format!("joint {name}"), rate_hz);
        };
        // Both joints move it.
        let [a, b] = pair.joints.map(usize::from);
        let sign = if place == a { '+' } else { '-' };
        let together = machine.joints[a].speed_max + machine.joints[b].speed_max;
        let rate_hz = joint.steps_per_unit * together.min(pair.speed_max);
        (format!("motor {} {sign} {}", names[a], names[b]), rate_hz)
    });
    let e = &machine.extruder;
    joints
        .chain([("extruder".to_string(), e.steps_per_mm3 * e.speed_max_mm3_s)])
        .collect()
}

/// Checks that a number is greater than 0 and within what is sensible.
pub(super) fn sensible(key: &str, value: f64, [low, high]: [f64; 2]) -> Result<(), Refusal> {
    positive(key, value)?;
    in_range(key, value, low, high)
}

fn empty_range(key: &str, low: f64, high: f64) -> Refusal {
    refusal!(
        "{key}: the lower end {} must be below the upper end {}",
        Short(low),
        Short(high)
    )
}

fn positive(key: &str, value: f64) -> Result<(), Refusal> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(refusal!(
        "{key} is {}, but must be finite and greater than 0",
        Short(value)
    ))
}

/// Checks that a rate of change reaches its quantity's limit within [`RISE_MAX_S`]; each with its key.
fn rises(keys: [&str; 2], [change, reached]: [f64; 2]) -> Result<(), Refusal> {
    let rise_s = reached / change;
    if rise_s <= RISE_MAX_S {
        return Ok(());
    }
    let [key, of] = keys;
    Err(refusal!(
        "{key} is so low that it takes {rise_s:.0} s to reach {of}, more than {RISE_MAX_S} s: raise \
         the one or lower the other"
    ))
}

/// The points of the extruder's curves, in a machine file and in a material's.
pub(super) fn check_flow_curves(curves: &FlowCurves) -> Result<(), Refusal> {
    let [loss, advance] = curves.wrong();
    let wrong = |key: &str, points: &CurvePoints, at: usize, must: &str| {
        let [flow, value] = points.get(at).copied().unwrap_or_default();
        refusal!(
            "extruder.{key}: point {}, [{flow}, {value}]: {must}",
            at + 1
        )
    };
    if let Some(at) = loss {
        let must = "flows must rise from above 0, shares lie from -0.5 to 0.9, and of more flow more must arrive";
        return Err(wrong("flow_loss", &curves.loss, at, must));
    }
    advance.map_or(Ok(()), |at| {
        let must = "flows must rise from above 0, and seconds lie from 0 to 5";
        Err(wrong("advance", &curves.advance, at, must))
    })
}

pub(super) fn in_range(key: &str, value: f64, low: f64, high: f64) -> Result<(), Refusal> {
    if value.is_nan() || value < low {
        return Err(refusal!(
            "{key} is {}, but must be at least {}",
            Short(value),
            Short(low)
        ));
    }
    if value > high {
        return Err(refusal!(
            "{key} is {}, but must be at most {}",
            Short(value),
            Short(high)
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::machine_file;

    /// Goal: a tolerance of corners is a length from 0 to the bead's width, and what it is not is told with both; the
    /// axis' has a bound as well. Method: values at and beyond the ends, and a machine file with one.
    #[test]
    fn corner_tolerances_beyond_a_bead_are_refused() {
        let mut settings = Settings::gantry();
        let widest_mm = 2.0 * settings.aperture.major_mm();
        for corner_mm in [0.0, 0.2, widest_mm] {
            settings.tolerances.corner_mm = corner_mm;
            assert_eq!(settings.check(), Ok(()), "{corner_mm}");
            let text = machine_file::to_toml(&settings);
            assert_eq!(text.contains("corner_mm"), corner_mm > 0.0);
            let again = machine_file::from_toml(&text).unwrap();
            assert_eq!(again.tolerances.corner_mm, corner_mm);
        }
        for corner_mm in [-0.1, f64::NAN, f64::INFINITY, widest_mm + 0.01] {
            settings.tolerances.corner_mm = corner_mm;
            let refused = settings.check().unwrap_err().to_string();
            assert!(refused.contains("--corner-tolerance"), "{refused}");
            assert!(refused.contains("1.2, the widest bead"), "{refused}");
        }
        settings.tolerances.corner_mm = 0.0;
        for axis_rad in [-0.01, f64::NAN, 0.2] {
            settings.axis_tolerance_rad = axis_rad;
            let refused = settings.check().unwrap_err().to_string();
            assert!(refused.contains("--axis-tolerance"), "{refused}");
        }
    }

    /// Goal: a limit that is next to zero is told by its key and by what it would have to reach. Method:
    /// each such limit just within a minute, and just beyond it.
    #[test]
    fn limits_next_to_zero_are_refused() {
        type Change = fn(&mut Settings, f64);
        let changes: [(&str, &str, Change); 4] = [
            (
                "joints.c.acceleration_max",
                "joints.c.speed_max",
                |s, share| {
                    let joint = &mut s.machine.joints[3];
                    joint.acceleration_max = share * joint.speed_max;
                    joint.jerk_max = joint.acceleration_max;
                },
            ),
            (
                "joints.x.jerk_max",
                "joints.x.acceleration_max",
                |s, share| {
                    let joint = &mut s.machine.joints[0];
                    joint.jerk_max = share * joint.acceleration_max;
                },
            ),
            (
                "extruder.acceleration_max_mm3_s2",
                "extruder.speed_max_mm3_s",
                |s, share| {
                    let extruder = &mut s.machine.extruder;
                    extruder.acceleration_max_mm3_s2 = share * extruder.speed_max_mm3_s;
                },
            ),
            (
                "flow.rate_of_change_max_mm3_s2",
                "flow.flow_max_mm3_s",
                |s, share| {
                    s.flow_rate_of_change_max_mm3_s2 = share * s.flow_max_mm3_s;
                },
            ),
        ];
        for (key, of, change) in changes {
            let mut settings = Settings::planar();
            change(&mut settings, 1.01 / RISE_MAX_S);
            settings.check().expect(key);
            change(&mut settings, 0.99 / RISE_MAX_S);
            let refused = settings.check().expect_err(key).to_string();
            let text = format!("{key} is so low that it takes 61 s to reach {of}, ");
            assert!(refused.starts_with(&text), "{refused}");
        }
    }

    /// Goal: numbers that no machine has are refused by their key. Method: each of them beyond its
    /// range, as files once brought them.
    #[test]
    fn numbers_beyond_any_machine_are_refused() {
        type Change = fn(&mut Settings);
        let changes: [(&str, Change); 10] = [
            ("joints.c.steps_per_turn", |s| {
                s.machine.joints[3].steps_per_unit = 1e-300;
            }),
            ("joints.x.position", |s| {
                s.machine.joints[0].position_max = 1e308
            }),
            ("joints.c.position", |s| {
                s.machine.joints[3].position_min = -1e300
            }),
            ("joints.x.speed_max", |s| {
                s.machine.joints[0].speed_max = 1e-300
            }),
            ("joints.y.acceleration_max", |s| {
                s.machine.joints[1].acceleration_max = 1e300
            }),
            ("joints.z.jerk_max", |s| {
                s.machine.joints[2].jerk_max = 1e300
            }),
            ("extruder.steps_per_mm3", |s| {
                s.machine.extruder.steps_per_mm3 = 1e-300
            }),
            ("flow.rate_of_change_max_mm3_s2", |s| {
                s.flow_rate_of_change_max_mm3_s2 = 1e300
            }),
            ("flow.prime_rate_mm3_s", |s| {
                s.prime_retract.prime_rate_mm3_s = 1e-300
            }),
            ("the machine's name", |s| {
                s.machine_name = "n".repeat(5_000_000)
            }),
        ];
        for (key, change) in changes {
            let mut settings = Settings::planar();
            change(&mut settings);
            let message = settings.check().expect_err(key).to_string();
            assert!(
                message.contains(key) && message.len() < 300,
                "{key}: {message}"
            );
        }
        let mut settings = Settings::planar();
        settings.machine_name = "a\u{1b}[31m".to_string();
        let refused = settings.check().expect_err("a name").to_string();
        assert!(
            refused.starts_with("the machine's name has control characters in it: "),
            "{refused}"
        );
        settings.machine_name = "Äpfel 3".to_string();
        // No stop is no number.
        settings.machine.joints[3].position_max = f64::INFINITY;
        settings.check().expect("in order");
    }
}

//! RAPID's data types: aggregates and names to targets, speeds, zones.
//!
//! In: expressions and the data that are in sight. Out: numbers in mm, degrees, seconds. Source: the data types
//! confdata, jointtarget, orient, robtarget, speeddata, zonedata and the function NOrient with their predefined data,
//! after ABB's "RAPID Instructions, Functions and Data types" (3HAC050917), not held against the manual's own text. Not
//! covered: vmax, vrot and vlin, declared targets, speeds, zones and tools.

use super::super::{Configuration, Target, rotation_of_quaternion};
use super::syntax::{Declaration, Expression};

/// How far the sum of an orientation's squares may be from 1.
const NORMALIZATION_ERROR: f64 = 0.00001;
/// An external axis that is not used.
const UNUSED: f64 = 9e9_f32 as f64;
/// Speeds of the tip in the predefined speeddata, mm/s.
const SPEEDS_MM_S: [u32; 25] = [
    5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 2500,
    3000, 4000, 5000, 6000, 7000,
];
/// Turning speed of all predefined speeddata, degrees/s.
const TURN_SPEED_DEG_S: f64 = 500.0;
/// Zones of the predefined zonedata but z0, mm.
const ZONES_MM: [u32; 13] = [1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200];
const ZONE_0_MM: f64 = 0.3;

/// Number after the letter of a predefined name: v100, z10.
fn predefined(name: &str, letter: char, known: &[u32]) -> Option<f64> {
    let name = name.to_lowercase();
    let mut named = known
        .iter()
        .filter(|value| format!("{letter}{value}") == name);
    named.next().copied().map(f64::from)
}

/// Zone of the tip's path of predefined zonedata, mm; 0 where it stops.
fn predefined_zone_mm(name: &str) -> Option<f64> {
    match name.to_lowercase().as_str() {
        "fine" => Some(0.0),
        "z0" => Some(ZONE_0_MM),
        other => predefined(other, 'z', &ZONES_MM),
    }
}

/// Whether a name is one of the predefined speeds or zones.
pub fn is_predefined(name: &str) -> bool {
    predefined(name, 'v', &SPEEDS_MM_S).is_some() || predefined_zone_mm(name).is_some()
}

/// Zone of the tip's path, mm; 0 where it stops.
pub fn zone_mm(expression: &Expression) -> Result<f64, String> {
    let zone_mm = match expression {
        Expression::Name(name) => predefined_zone_mm(name),
        // finep, then the tip's path, and zones of orientation and axes, which are not read.
        Expression::Aggregate(parts) if parts.len() == 7 => match (&parts[0], &parts[1]) {
            (Expression::Name(fine), Expression::Number(zone_mm)) if fine == "FALSE" => {
                Some(*zone_mm)
            }
            _ => None,
        },
        _ => None,
    };
    zone_mm.ok_or_else(|| format!("{expression:?} is no zone"))
}

/// A string; the path of the controller's drive is predefined.
pub fn text(expression: &Expression) -> Result<String, String> {
    match expression {
        Expression::Text(text) => Ok(text.clone()),
        Expression::Name(name) if name.eq_ignore_ascii_case("diskhome") => Ok("HOME:".into()),
        other => Err(format!("{other:?} is no string")),
    }
}

fn parts<'e>(from: &'e Expression, what: &str, count: usize) -> Result<&'e [Expression], String> {
    match from {
        Expression::Aggregate(parts) if parts.len() == count => Ok(parts),
        _ => Err(format!("a {what} has {count} components in brackets")),
    }
}

/// Data in sight of a routine.
pub struct Sight<'a> {
    /// File of the routine.
    pub file: &'a str,
    /// Data of the loaded modules.
    pub data: Vec<&'a [Declaration]>,
}

impl<'a> Sight<'a> {
    /// The declaration of a name (any case).
    pub fn declaration(&self, name: &str) -> Option<&'a Declaration> {
        let mut all = self.data.iter().flat_map(|data| data.iter());
        all.find(|data| data.name.eq_ignore_ascii_case(name))
    }

    /// A number.
    pub fn number(&self, expression: &Expression) -> Result<f64, String> {
        match expression {
            Expression::Number(value) => Ok(*value),
            Expression::Name(name) => {
                let data = self.declaration(name);
                data.and_then(|data| data.value)
                    .ok_or_else(|| format!("{name} is not known as a number"))
            }
            other => Err(format!("{other:?} is no number")),
        }
    }

    fn numbers<const N: usize>(&self, from: &Expression, what: &str) -> Result<[f64; N], String> {
        let mut numbers = [0.0; N];
        for (number, part) in numbers.iter_mut().zip(parts(from, what, N)?) {
            *number = self.number(part)?;
        }
        Ok(numbers)
    }

    fn orientation(&self, expression: &Expression) -> Result<[[f64; 3]; 3], String> {
        let quaternion = self.numbers::<4>(expression, "orient")?;
        let squares: f64 = quaternion.iter().map(|q| q * q).sum();
        if (squares - 1.0).abs() > NORMALIZATION_ERROR {
            return Err(format!("not normalized: the squares are {squares}"));
        }
        // What the rounding of its numbers leaves is no part of the rotation.
        let unit = quaternion.map(|q| q / squares.sqrt());
        Ok(rotation_of_quaternion(unit))
    }

    /// External axes up to the last one that is given.
    fn external(&self, expression: &Expression) -> Result<Vec<f64>, String> {
        let axes = self.numbers::<6>(expression, "extjoint")?;
        let is_used = |value: &f64| *value != UNUSED;
        let given: Vec<f64> = axes.into_iter().take_while(is_used).collect();
        if axes[given.len()..].iter().any(is_used) {
            return Err("an external axis is given after one that is not".into());
        }
        Ok(given)
    }

    /// A robtarget.
    pub fn robtarget(&self, expression: &Expression) -> Result<Target, String> {
        let parts = parts(expression, "robtarget", 4)?;
        let confdata = self.numbers::<4>(&parts[2], "confdata")?;
        if confdata.iter().any(|cf| cf.fract() != 0.0) || !(0.0..8.0).contains(&confdata[3]) {
            return Err(format!("{confdata:?} is no confdata of an arm of six axes"));
        }
        let [cf1, cf4, cf6, cfx] = confdata.map(|cf| cf as i32);
        let cf = [cf1, cf4, cf6];
        Ok(Target::Pose {
            tip_mm: self.numbers::<3>(&parts[0], "pos")?,
            rotation: self.orientation(&parts[1])?,
            external: self.external(&parts[3])?,
            configuration: Some(Configuration::Quadrants { cf, cfx }),
        })
    }

    /// A jointtarget.
    pub fn jointtarget(&self, expression: &Expression) -> Result<Target, String> {
        let parts = parts(expression, "jointtarget", 2)?;
        let degrees = self.numbers::<6>(&parts[0], "robjoint")?;
        if degrees.contains(&UNUSED) {
            return Err("an axis of the robot is not given".into());
        }
        Ok(Target::Joints {
            degrees: degrees.into(),
            external: self.external(&parts[1])?,
        })
    }

    /// Speeds of the tip, mm/s, and of the tool's turning, degrees/s.
    pub fn speeds(&self, expression: &Expression) -> Result<(f64, f64), String> {
        if let Expression::Name(name) = expression {
            let tip_mm_s = predefined(name, 'v', &SPEEDS_MM_S);
            let tip_mm_s = tip_mm_s.ok_or_else(|| format!("{name} is no predefined speed"))?;
            return Ok((tip_mm_s, TURN_SPEED_DEG_S));
        }
        let [tip_mm_s, turn_deg_s, axes @ ..] = self.numbers::<4>(expression, "speeddata")?;
        if tip_mm_s <= 0.0 || turn_deg_s <= 0.0 || axes.iter().any(|&speed| speed < 0.0) {
            return Err("a speed is not above 0".into());
        }
        Ok((tip_mm_s, turn_deg_s))
    }

    /// Name of a tool, work object or signal; these live in the controller.
    pub fn controllers(&self, expression: &Expression) -> Result<String, String> {
        match expression {
            Expression::Name(name) if self.declaration(name).is_none() && !is_predefined(name) => {
                Ok(name.clone())
            }
            other => Err(format!("{other:?} is no name of the controller's")),
        }
    }
}

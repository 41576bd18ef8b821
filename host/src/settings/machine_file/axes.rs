//! `[kinematics]` of a machine file as a table: linear axes with rotary ones in the head or under the part.
//!
//! ```toml
//! [kinematics]
//! kind = "axes"
//! tilt_deg = 45
//! [[kinematics.rotary]]
//! side = "head"
//! axis = [0, 0, 1]
//! offset_mm = [0, 0, 80]
//! ```
//! In: directions of any length, offsets in mm. Out: the firmware's family. A single axis under the part makes a polar
//! table. `kinematics = "gantry"` and the other names stay strings.

use super::KinematicsName;
use super::write::{nice, number, triple};
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::axis_family::{AxisFamily, RotaryAxis};
use serde::de::value::{MapAccessDeserializer, StrDeserializer};
use serde::de::{Deserializer, Error, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// A name, or the table of a machine with rotary axes.
#[derive(Clone)]
pub(super) enum FileKinematics {
    Named(KinematicsName),
    Axes(FileAxes),
}

#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileAxes {
    #[allow(dead_code)]
    kind: AxesKind,
    tilt_deg: Option<f64>,
    rotary: Vec<FileRotary>,
}

/// The only kind that is a table.
#[derive(Clone, Copy, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
enum AxesKind {
    Axes,
}

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
enum SideName {
    Head,
    Table,
}

#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileRotary {
    side: SideName,
    axis: [f64; 3],
    offset_mm: [f64; 3],
}

impl<'de> Deserialize<'de> for FileKinematics {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameOrTable;
        impl<'de> Visitor<'de> for NameOrTable {
            type Value = FileKinematics;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a name such as \"planar\", or a table [kinematics] of kind \"axes\"")
            }
            fn visit_str<E: Error>(self, name: &str) -> Result<FileKinematics, E> {
                KinematicsName::deserialize(StrDeserializer::new(name)).map(FileKinematics::Named)
            }
            fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<FileKinematics, A::Error> {
                FileAxes::deserialize(MapAccessDeserializer::new(table)).map(FileKinematics::Axes)
            }
        }
        deserializer.deserialize_any(NameOrTable)
    }
}

fn wrong(problem: impl Into<String>) -> Refusal {
    refusal!("kinematics: {}", problem.into())
}

impl FileAxes {
    /// The family; refuses axes that cannot point a nozzle.
    pub(super) fn family(&self) -> Result<AxisFamily, Refusal> {
        let axes: Vec<RotaryAxis> = self
            .rotary
            .iter()
            .map(FileRotary::axis)
            .collect::<Result<_, _>>()?;
        let (first, second) = match axes[..] {
            [first] => (first, None),
            [first, second] => (first, Some(second)),
            _ => return Err(wrong("give one or two [[kinematics.rotary]]")),
        };
        let family = AxisFamily {
            first,
            second,
            tool_axis: AxisFamily::leaning(self.tilt_deg.unwrap_or(0.0).to_radians()),
            polar: second.is_none() && first.on_table,
        };
        let is_right = family.is_right();
        is_right.then_some(family).ok_or_else(|| {
            wrong(if family.polar {
                "a single rotary axis under the part makes a polar table: axis = [0, 0, 1], and no tilt_deg"
            } else {
                "the rotary axes cannot point the nozzle: they are parallel, or one of them turns only about the \
                 nozzle's own axis (which h does)"
            })
        })
    }
}

impl FileRotary {
    fn axis(&self) -> Result<RotaryAxis, Refusal> {
        let [x, y, z] = self.axis;
        let length = (x * x + y * y + z * z).sqrt();
        // Written so that a NaN is refused.
        let has_direction = length > 1e-9 && length.is_finite();
        if !has_direction {
            return Err(wrong(format!(
                "rotary axis = {:?} is no direction",
                self.axis
            )));
        }
        // A unit vector stays what it is to the last digit.
        let unit = (length - 1.0).abs() < 1e-12;
        Ok(RotaryAxis {
            on_table: self.side == SideName::Table,
            axis: if unit {
                self.axis
            } else {
                self.axis.map(|part| part / length)
            },
            offset_mm: self.offset_mm,
        })
    }
}

/// The table of a machine with rotary axes.
pub(super) fn write_axes(text: &mut String, family: &AxisFamily) -> std::fmt::Result {
    writeln!(
        text,
        "\n# Rotary axes in the order from the base outwards, by the right hand, with all joints at 0: side head or\n\
         # table, the axis' direction, and a point on it: of the head from the nozzle's tip, of the table in machine\n\
         # coordinates. The nozzle (h) turns about its own axis, which leans from Z towards X by tilt_deg.\n\
         [kinematics]\nkind = \"axes\""
    )?;
    let [x, _, z] = family.tool_axis;
    if x != 0.0 {
        let tilt = nice(x.atan2(z).to_degrees(), x, |deg| {
            AxisFamily::leaning(deg.to_radians())[0]
        });
        writeln!(text, "tilt_deg = {tilt}")?;
    }
    for axis in [Some(&family.first), family.second.as_ref()]
        .into_iter()
        .flatten()
    {
        let side = if axis.on_table { "table" } else { "head" };
        let [x, y, z] = axis.axis.map(number);
        writeln!(
            text,
            "\n[[kinematics.rotary]]\nside = \"{side}\"\naxis = [{x}, {y}, {z}]"
        )?;
        writeln!(text, "offset_mm = {}", triple(axis.offset_mm))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    //! Goal: rotary axes are read and written back as they are, named by where they point, and what cannot point
    //! a nozzle is refused with the reason. Method: an example's file and changes of it.
    use super::super::{from_toml, to_toml};
    use crate::settings::Settings;
    use crate::settings::examples::MachineExample;
    use headway_firmware::configuration::Kinematics;

    fn read(from: &str, to: &str) -> Result<Settings, String> {
        let text = MachineExample::HeadCb.text();
        assert!(text.contains(from), "{from}");
        from_toml(&text.replacen(from, to, 1)).map_err(|error| error.to_string())
    }

    #[test]
    fn rotary_axes_read_back() {
        for example in MachineExample::ALL {
            let settings = from_toml(example.text()).expect("an example");
            assert_eq!(
                from_toml(&to_toml(&settings)).expect("again"),
                settings,
                "{}",
                settings.machine_name
            );
        }
        // A direction of any length.
        let long = read("axis = [0, 1, 0]", "axis = [0, 7.5, 0]").expect("a machine");
        assert_eq!(long, read("axis", "axis").expect("a machine"));
        let Kinematics::Axes { axes, .. } = long.machine.kinematics else {
            panic!("axes");
        };
        assert_eq!(axes.second.expect("two").axis, [0.0, 1.0, 0.0]);
    }

    #[test]
    fn axes_that_cannot_be_are_refused() {
        for (from, to, part) in [
            ("axis = [0, 1, 0]", "axis = [0, 0, 1]", "parallel"),
            ("axis = [0, 1, 0]", "axis = [0, 0, 0]", "no direction"),
            ("axis = [0, 1, 0]", "axis = [0, nan, 0]", "no direction"),
            ("side = \"head\"", "side = \"bed\"", "is not known"),
            ("kind = \"axes\"", "kind = \"planar\"", "is not known"),
            ("[joints.b]", "[joints.a]", "joints.a"),
        ] {
            let error = read(from, to).expect_err(from);
            assert!(error.contains(part), "{to}: {error}");
        }
        let text = crate::settings::machine_file::to_toml(&Settings::planar());
        let named = |name: &str| {
            from_toml(&text.replacen("\"planar\"\nservo", &format!("{name}\nservo"), 1))
        };
        assert!(named("\"planar\"").is_ok());
        let error = named("\"planr\"").expect_err("misspelt").to_string();
        assert!(error.contains("`planr` is not known"), "{error}");
    }
}

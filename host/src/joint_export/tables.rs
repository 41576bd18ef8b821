//! Joints as tables: CSV with a header line, JSON with the joints' names, units and limits.
//!
//! In: the samples of [`super::samples`]. Out: text in pieces, so that a long job need not fit into memory.
//! Columns: time, state of the head, deposited volume, then position, rate, second derivative and motor steps
//! of each joint.

use super::samples::{JointSample, joint_samples, names};
use crate::job::SegmentStream;
use headway_firmware::configuration::MachineConfiguration;
use headway_protocol::units::CHANNEL_VOLUME;
use serde_json::json;
use std::io::{Error, Result, Write};

/// Columns before those of the joints.
pub(crate) const FIRST_COLUMNS: [&str; 6] =
    ["t_s", "layer", "pass", "state", "volume_mm3", "flow_mm3_s"];

/// A job whose joints are written.
#[derive(Clone, Copy, Debug)]
pub struct JointTable<'a> {
    /// Name of the part.
    pub name: &'a str,
    /// Name of the machine.
    pub machine_name: &'a str,
    /// The motion, machine coordinates.
    pub stream: &'a SegmentStream,
    /// The machine of the job.
    pub machine: &'a MachineConfiguration,
    /// Machine coordinates of the input's origin, mm.
    pub offset_mm: [f64; 3],
    /// Time between two rows, ms, greater than 0.
    pub every_ms: f64,
}

/// Names of the columns, in order.
pub fn columns(machine: &MachineConfiguration) -> Vec<String> {
    let names = names(machine);
    let endings: [fn(&str) -> String; 4] = [
        |unit| unit.to_string(),
        |unit| format!("{unit}_s"),
        |unit| format!("{unit}_s2"),
        |_| "steps".to_string(),
    ];
    let of_joints = endings.iter().flat_map(|ending| {
        let column = |of: &super::samples::JointName| format!("{}_{}", of.column, ending(of.unit));
        names.iter().map(column).collect::<Vec<_>>()
    });
    let first = FIRST_COLUMNS.iter().map(|name| (*name).to_string());
    first.chain(of_joints).collect()
}

impl JointTable<'_> {
    /// Servo ticks between two rows.
    pub(super) fn every_ticks(&self) -> f64 {
        self.every_ms * 1e-3 * f64::from(self.machine.servo_hz)
    }

    /// The joints' samples; a pose without joints is an error of the writing.
    pub(super) fn rows(&self) -> impl Iterator<Item = Result<JointSample>> + '_ {
        let samples = joint_samples(self.stream, self.machine, self.every_ticks());
        samples.map(|sample| sample.map_err(Error::other))
    }

    /// Writes a header line and a row for every step of time.
    ///
    /// # Errors
    /// Of the writer, and if a pose has no joints.
    pub fn write_csv(&self, out: &mut impl Write) -> Result<()> {
        writeln!(out, "{}", columns(self.machine).join(","))?;
        for sample in self.rows() {
            let sample = sample?;
            let state = sample.sample.mark.state.name();
            writeln!(out, "{}", self.row(&sample, state))?;
        }
        Ok(())
    }

    /// Writes one object: joints, columns and rows.
    ///
    /// # Errors
    /// As [`JointTable::write_csv`].
    pub fn write_json(&self, out: &mut impl Write) -> Result<()> {
        let joints: Vec<_> = names(self.machine)
            .iter()
            .zip(&self.machine.joints)
            .map(|(of, joint)| {
                json!({
                    "name": of.name,
                    "unit": of.unit,
                    "column": of.column,
                    "steps_per_unit": joint.steps_per_unit,
                    "position_min": joint.position_min,
                    "position_max": joint.position_max,
                    "speed_max": joint.speed_max,
                    "acceleration_max": joint.acceleration_max,
                })
            })
            .collect();
        let head = json!({
            "name": self.name,
            "machine": self.machine_name,
            "servo_hz": self.machine.servo_hz,
            "every_ms": self.every_ms,
            "offset_mm": self.offset_mm,
            "joints": joints,
            "columns": columns(self.machine),
        });
        // The head's closing brace makes room for the rows.
        let head = format!("{head:#}");
        write!(out, "{},\n  \"rows\": [", head.trim_end_matches("\n}"))?;
        for (number, sample) in self.rows().enumerate() {
            let sample = sample?;
            let comma = if number == 0 { "" } else { "," };
            let state = format!("\"{}\"", sample.sample.mark.state.name());
            write!(out, "{comma}\n    [{}]", self.row(&sample, &state))?;
        }
        writeln!(out, "\n  ]\n}}")
    }

    /// The numbers of a row between commas.
    fn row(&self, of: &JointSample, state: &str) -> String {
        let joints = self.machine.joints.len();
        let pass = of.sample.mark.pass.map_or(-1, i64::from);
        let mut row = format!(
            "{:.7},{},{pass},{state},{:.6},{:.5}",
            of.sample.time_s,
            of.sample.mark.layer,
            of.sample.position[CHANNEL_VOLUME],
            of.sample.flow_mm3_s()
        );
        for (values, digits) in [(&of.position, 9), (&of.velocity, 6), (&of.acceleration, 4)] {
            for value in &values[..joints] {
                row += &format!(",{value:.digits$}");
            }
        }
        for steps in &of.steps[..joints] {
            row += &format!(",{steps}");
        }
        row
    }
}

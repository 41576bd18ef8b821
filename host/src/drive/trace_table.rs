//! The simulated motion as CSV: poses by forward kinematics, and every step.
//!
//! `--trace`: one row every `every_ms` of real time from the job's first segment, in the input's
//! coordinates. Positions, tool axis and heading come from the step counts; the speed is the tip's
//! distance over `SPEED_WINDOW_S`, since single steps have none; the flow is that of the deposited
//! volume at the controller's true segment time. While it is stopped other than at a planned rest
//! the state is `hold`. `--trace-steps`: one row per step.

use crate::drive::laid_beads::LaidBeads;
use crate::drive::record::MotionRecord;
use crate::drive::servo_walk::ServoWalk;
use crate::drive::trace::pose_of_counts;
use crate::job::transform::PartTransform;
use crate::job::{Mark, MotionState, SegmentStream};
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::kinematics::pose::Pose;
use headway_protocol::units::CHANNEL_VOLUME;
use nalgebra::Vector3;
use std::collections::VecDeque;
use std::io::{self, Write};

/// Time over which the tip's speed is measured: 12 um of a step are 1.2 mm/s.
const SPEED_WINDOW_S: f64 = 0.01;

/// One servo tick of the trace.
#[derive(Clone, Copy, Debug)]
struct Sample {
    tick: i64,
    pose: Pose<f64>,
    flow_mm3_s: f64,
    state: MotionState,
    mark: Option<Mark>,
}

/// Writes the pose table. `every_ms` is rounded to whole servo ticks, at least one; with `laid` it has what leaves the
/// nozzle, mm³/s, as its last column.
///
/// # Errors
/// Those of the writer.
pub fn write_poses(
    out: &mut impl Write,
    stream: &SegmentStream,
    machine: &MachineConfiguration,
    record: &MotionRecord,
    transform: &PartTransform,
    every_ms: f64,
    laid: Option<&LaidBeads>,
) -> io::Result<()> {
    let more = if laid.is_some() { ",laid_mm3_s" } else { "" };
    writeln!(
        out,
        "t_s,layer,pass,x_mm,y_mm,z_mm,nx,ny,nz,heading_rad,speed_mm_s,flow_mm3_s,state{more}"
    )?;
    let servo_hz = f64::from(machine.servo_hz);
    let every_ticks = (every_ms * 1e-3 * servo_hz).round().max(1.0) as i64;
    let half_window = (SPEED_WINDOW_S / 2.0 * servo_hz).round().max(1.0) as usize;
    let mut window: VecDeque<Sample> = VecDeque::new();
    let mut samples = Samples::new(stream, machine, record);
    let end_tick = record.rates_q16.len() as i64;
    while let Some(sample) = samples.next() {
        if window.is_empty() {
            // At rest before the start.
            window.extend(std::iter::repeat_n(sample, 2 * half_window));
        }
        window.push_back(sample);
        if window.len() > 2 * half_window + 1 {
            window.pop_front();
        }
        let middle = window[half_window];
        let is_due = middle.tick >= 0 && middle.tick <= end_tick;
        if window.len() > 2 * half_window && is_due && middle.tick % every_ticks == 0 {
            let last = sample.pose.tip_mm;
            let way = last - window[0].pose.tip_mm;
            let ticks = (sample.tick - window[0].tick).max(1) as f64;
            write_row(out, &middle, way, ticks / servo_hz, servo_hz, transform)?;
            if let Some(laid) = laid {
                let flow = usize::try_from(middle.tick).ok();
                let flow = flow.and_then(|tick| laid.flow_mm3_s.get(tick));
                write!(out, ",{:.5}", flow.copied().unwrap_or_default())?;
            }
            writeln!(out)?;
        }
    }
    Ok(())
}

fn write_row(
    out: &mut impl Write,
    sample: &Sample,
    way_mm: Vector3<f64>,
    window_s: f64,
    servo_hz: f64,
    transform: &PartTransform,
) -> io::Result<()> {
    let tip = &sample.pose.tip_mm;
    let [x, y, z] = transform.to_input([tip.x, tip.y, tip.z]);
    let axis = sample.pose.tool_axis();
    let layer = sample.mark.map_or(0, |mark| mark.layer);
    let pass = sample.mark.and_then(|mark| mark.pass).map_or(-1, i64::from);
    write!(
        out,
        "{:.6},{layer},{pass},{x:.5},{y:.5},{z:.5},{:.7},{:.7},{:.7},{:.6},{:.4},{:.5},{}",
        sample.tick as f64 / servo_hz,
        axis.x,
        axis.y,
        axis.z,
        sample.pose.heading_rad,
        way_mm.norm() / window_s,
        sample.flow_mm3_s,
        sample.state.name(),
    )
}

/// Samples at every servo tick.
struct Samples<'a> {
    walk: ServoWalk<'a, Box<dyn Iterator<Item = crate::drive::record::Step> + 'a>>,
    machine: &'a MachineConfiguration,
    marks: &'a [Mark],
    servo_hz: f64,
}

impl<'a> Samples<'a> {
    fn new(
        stream: &'a SegmentStream,
        machine: &'a MachineConfiguration,
        record: &'a MotionRecord,
    ) -> Self {
        Samples {
            walk: ServoWalk::new(stream, machine, record),
            machine,
            marks: &stream.marks,
            servo_hz: f64::from(machine.servo_hz),
        }
    }

    fn next(&mut self) -> Option<Sample> {
        let interval = self.walk.next_interval()?;
        let [before, here, after, _] = interval.window;
        while self.marks.len() > 1 && here.segment_ticks >= self.marks[0].end_tick as f64 {
            self.marks = &self.marks[1..];
        }
        let mark = self.marks.first().copied();
        let gained = after.channels[CHANNEL_VOLUME] - before.channels[CHANNEL_VOLUME];
        let prints = mark.is_some_and(|mark| mark.state == MotionState::Print);
        let in_stream = mark.is_some_and(|mark| here.segment_ticks < mark.end_tick as f64);
        let stands = interval.rate_q16 == 0 && interval.tick >= 0 && in_stream;
        let planned = mark.map_or(MotionState::Hold, |mark| mark.state);
        Some(Sample {
            tick: interval.tick,
            pose: pose_of_counts(self.machine, &interval.counts),
            flow_mm3_s: if prints {
                gained * self.servo_hz / 2.0
            } else {
                0.0
            },
            state: if stands { MotionState::Hold } else { planned },
            mark,
        })
    }
}

/// Writes `t_us,motor,dir`, one line per step; time from the job's first segment at the
/// controller's step ticks, dir 1 towards larger positions and -1 back.
///
/// # Errors
/// Those of the writer.
pub fn write_steps(
    out: &mut impl Write,
    machine: &MachineConfiguration,
    record: &MotionRecord,
) -> io::Result<()> {
    writeln!(out, "t_us,motor,dir")?;
    let ratio = u64::from(machine.step_hz / machine.servo_hz);
    let origin = (record.first_servo_tick * ratio) as i64;
    let tick_us = 1e6 / f64::from(machine.step_hz);
    for step in record.steps.iter() {
        let time_us = (step.tick as i64 - origin) as f64 * tick_us;
        let direction = if step.forward { 1 } else { -1 };
        writeln!(out, "{time_us:.1},{},{direction}", step.motor)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::simulator::{Simulator, SimulatorSetup};
    use crate::drive::test_streams::{planar, spiral};
    use crate::job::frames::WireFrames;

    #[test]
    fn the_tables_tell_what_the_steps_did() {
        // Goal: columns, places and speeds. Method: a simulated spiral of known radius and speed.
        let (stream, machine) = (spiral(2.0), planar());
        let frames = WireFrames::encode(&stream).unwrap();
        let ticks = crate::drive::plan_curve::stream_ticks(&stream.knots);
        let setup = SimulatorSetup::default();
        let simulator = Simulator::new(frames, ticks, &machine, &setup).unwrap();
        let record = simulator.run(|_| {}).unwrap().motion;
        let transform = PartTransform {
            offset_mm: [100.0, 120.0, 0.0],
        };
        let mut poses = Vec::new();
        write_poses(
            &mut poses, &stream, &machine, &record, &transform, 1.0, None,
        )
        .unwrap();
        let text = String::from_utf8(poses).unwrap();
        let rows: Vec<Vec<&str>> = text
            .lines()
            .skip(1)
            .map(|l| l.split(',').collect())
            .collect();
        assert_eq!(rows.len() as u64, ticks / 2 + 1);
        let number = |row: usize, column: usize| rows[row][column].parse::<f64>().unwrap();
        let middle = rows.len() / 2;
        let radius = number(middle, 3).hypot(number(middle, 4));
        assert!((radius - (10.0 + 0.3 * std::f64::consts::TAU)).abs() < 0.5);
        let way: f64 = (middle..middle + 20)
            .map(|row| {
                let dx = number(row + 1, 3) - number(row, 3);
                let dy = number(row + 1, 4) - number(row, 4);
                dx.hypot(dy)
            })
            .sum();
        // Single steps make a way that is longer than the curve's, by less than a quarter.
        let speed = way / 0.02;
        assert!((speed / number(middle, 10) - 1.0).abs() < 0.25);
        assert_eq!(rows[middle][12], "print");
        let mut steps = Vec::new();
        write_steps(&mut steps, &machine, &record).unwrap();
        let lines = steps.iter().filter(|&&byte| byte == b'\n').count();
        assert_eq!(lines, record.steps.len() + 1);
    }
}

//! The stream -> blocks of a program, from rest to rest.
//!
//! In: a stream, its machine, tolerances. Out: [`Run`]s of [`Block`]s: ends of straight ways on which tip and tool turn evenly,
//! with seconds, blend and joints. A block ends where the tip or the nozzle's end would leave it by more than the tolerance,
//! where the speed has changed much, and before the tool turns so far that the shorter way round is another.

use super::pace::pace;
use super::pump::{OutputChange, OutputChanges};
use super::{ProgramJob, ProgramOptions};
use crate::drive::joint_track::JointTrack;
use crate::gcode::write::lines::{EvenHeading, LineTolerances, beside, move_ends};
use crate::gcode::write::poses::Poses;
use crate::job::MotionState;
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::{JOINTS_MAX, Kinematics, MachineConfiguration};
use headway_firmware::kinematics::pose::Pose;
use headway_protocol::units::{CHANNEL_VOLUME, CHANNELS};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// Most that the tool may be turned beside the job between two points, rad.
const TURN_RAD: f64 = 2.0 * PI / 180.0;
/// Share of the tolerance that a block may be off, and that a blend may cut.
const SHARE: f64 = 0.9;
/// A blend is at most this share of the shorter block, so that two do not meet.
const BLEND_SHARE: f64 = 0.45;
/// A blend is at least this share of it,
const LEAST_SHARE: f64 = 0.05;
/// and its circle so many times as large as it has to be.
const ROOM: f64 = 1.5;
/// A block ends where the speed is so many times that at its beginning, or less by as much,
const SPEED_RATIO: f64 = 1.25;
/// but lasts so long at least, s.
const BLOCK_S: f64 = 0.1;
/// Servo ticks between two looks at the joints, to count their turns: 32 ms at 2 kHz.
const LOOK_TICKS: usize = 64;
/// How near to the end of a block a change of the output is set there, s: shorter blocks are none for a controller.
const NEAR_S: f64 = 4e-3;
/// Longest blend at whose beginning or end it may come, s.
const OUTPUT_S: f64 = 2e-3;
/// Time over which points are counted, s.
const WINDOW_S: f64 = 0.5;

/// How far a program may be from the job.
#[derive(Clone, Copy, Debug)]
pub struct Tolerances {
    /// Tip, mm.
    tip_mm: f64,
    /// Heading and tilt, rad.
    turn_rad: f64,
}

impl Tolerances {
    /// Of the options.
    pub fn of(options: &ProgramOptions) -> Tolerances {
        let tip_mm = SHARE * options.tolerance_mm;
        Tolerances {
            tip_mm,
            // Of a narrow nozzle's axis too much would be allowed: a tilt is seen at the head.
            turn_rad: (tip_mm / options.reach_mm.max(1e-6)).min(TURN_RAD),
        }
    }
}

/// A place of the program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Tip, machine coordinates, mm.
    pub tip_mm: [f64; 3],
    /// From the axes of the controller's tool to the machine's: z out of the nozzle, x along its long side.
    pub tool: Rotation3<f64>,
    /// Heading, counted over turns, rad.
    pub heading_rad: f64,
    /// Joints, turns counted, mm or rad.
    pub joints: [f64; JOINTS_MAX],
}

/// A straight way to a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Its end.
    pub to: Place,
    /// Its time in the job, s.
    pub seconds: f64,
    /// Its time on a controller (`pace.rs`), s.
    pub lasts_s: f64,
    /// Way of the tip, mm.
    pub length_mm: f64,
    /// Turn of the tool, rad.
    pub turn_rad: f64,
    /// How near to the end the path may be left for the next block, mm; 0 is a rest.
    pub blend_mm: f64,
    /// Deposited on it, mm³.
    pub volume_mm3: f64,
    /// Speed of the tip with which a controller takes as long (`pace.rs`), mm/s.
    pub speed_mm_s: f64,
    /// Greatest speed of the tip in the job, and by the joints' speeds, mm/s.
    pub peak_mm_s: f64,
    /// By how much the path turns at its end, rad.
    pub corner_rad: f64,
    /// What the pump's output is set to at its end.
    pub output: Option<f64>,
}

impl Block {
    /// Speed of the tool's turn, degrees/s.
    pub fn turn_deg_s(&self) -> f64 {
        self.turn_rad.to_degrees() / self.seconds
    }

    /// True where the tip moves so little that its speed says nothing.
    pub fn is_turn(&self) -> bool {
        self.length_mm < 1e-2 * self.turn_rad.max(1e-3)
    }
}

/// Blocks from rest to rest, or a rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// What the head does.
    pub state: MotionState,
    /// Layer, from 0.
    pub layer: u32,
    /// The blocks; none where the head rests.
    pub blocks: Vec<Block>,
    /// Seconds of rests, and what the pump's output is set to at the end of each.
    pub rests: Vec<(f64, Option<f64>)>,
}

/// A job as blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    /// Where it begins.
    pub start: Place,
    /// Its runs.
    pub runs: Vec<Run>,
    /// Its time, s.
    pub duration_s: f64,
    /// Layers.
    pub layers: u32,
    /// Greatest value of the pump's output.
    pub output_max: f64,
}

impl Walk {
    /// Of a job.
    ///
    /// # Errors
    /// [`Refusal`] where a pose has no joints.
    pub fn of(
        job: &ProgramJob,
        tolerances: &Tolerances,
        changes: &OutputChanges,
    ) -> Result<Walk, Refusal> {
        let machine = job.stream.machine(job.machine);
        let servo_hz = f64::from(machine.servo_hz);
        let mut walker = Walker {
            poses: Poses::new(job.stream),
            track: JointTrack::new(&machine),
            machine: &machine,
            servo_hz,
            acceleration_mm_s2: job.tip_acceleration_mm_s2,
            tolerances,
        };
        let start = walker.first()?;
        let mut walk = Walk {
            start,
            runs: Vec::new(),
            duration_s: 0.0,
            layers: job.stream.layers(),
            output_max: changes.list.iter().map(|of| of.value).fold(0.0, f64::max),
        };
        let mut at = start;
        for mark in &job.stream.marks {
            let ticks = [mark.start_tick, mark.end_tick];
            // What comes right after a run is set at its end.
            let near = (NEAR_S * servo_hz) as u64;
            let from = if walk.runs.is_empty() {
                0
            } else {
                mark.start_tick + near
            };
            let changes = changes.within([from, mark.end_tick + near]);
            let blocks = walker.blocks(ticks, &at, changes)?;
            walk.duration_s += (mark.end_tick - mark.start_tick) as f64 / servo_hz;
            let rests = match blocks.last() {
                Some(last) => {
                    at = last.to;
                    Vec::new()
                }
                None => rests(ticks, changes, servo_hz),
            };
            walk.runs.push(Run {
                state: mark.state,
                layer: mark.layer,
                rests,
                blocks,
            });
        }
        Ok(walk)
    }

    /// Times of the job at which the controller is at the ends of blocks, and its own, s.
    pub fn clock(&self) -> Vec<[f64; 2]> {
        let mut now = [0.0; 2];
        let mut clock = vec![now];
        for run in &self.runs {
            let blocks = run.blocks.iter();
            let blocks = blocks.map(|block| [block.seconds, block.lasts_s]);
            let rests = run.rests.iter().map(|rest| [rest.0; 2]);
            for step in blocks.chain(rests) {
                now = [now[0] + step[0], now[1] + step[1]];
                clock.push(now);
            }
        }
        clock
    }

    /// Number of its blocks.
    pub fn points(&self) -> usize {
        self.runs.iter().map(|run| run.blocks.len()).sum()
    }

    /// Most of them in half a second, a second.
    pub fn points_a_second(&self) -> f64 {
        let mut now_s = 0.0;
        let ends = self.runs.iter().flat_map(|run| {
            let times = run.blocks.iter().map(|block| block.seconds);
            times.chain(run.rests.iter().map(|rest| rest.0))
        });
        let ends: Vec<f64> = ends
            .map(|seconds| {
                now_s += seconds;
                now_s
            })
            .collect();
        let mut first = 0;
        let mut most = 0;
        for (last, end_s) in ends.iter().enumerate() {
            while ends[first] < end_s - WINDOW_S {
                first += 1;
            }
            most = most.max(last - first);
        }
        most as f64 / WINDOW_S
    }
}

/// A rest, divided where the output changes.
fn rests([from, to]: [u64; 2], changes: &[OutputChange], servo_hz: f64) -> Vec<(f64, Option<f64>)> {
    let mut before = from;
    let mut rests: Vec<(f64, Option<f64>)> = Vec::new();
    let ends = changes.iter().map(|of| (of.tick.min(to), Some(of.value)));
    for (tick, output) in ends.chain([(to, None)]) {
        if tick > before {
            rests.push(((tick - before) as f64 / servo_hz, output));
        } else if let Some(last) = rests.last_mut() {
            // Of two changes at one place the later one counts.
            last.1 = output.or(last.1);
        }
        before = tick;
    }
    rests
}

/// The end that is nearest to a tick; ends rise.
fn nearest(ends: &[usize], tick: usize) -> Option<usize> {
    let after = ends.partition_point(|end| *end < tick);
    let around = after.saturating_sub(1)..ends.len().min(after + 1);
    around.min_by_key(|&index| ends[index].abs_diff(tick))
}

/// The ends of blocks, with those added where the output changes and none is near.
fn with_changes(mut ends: Vec<usize>, changes: &[usize], near: usize) -> Vec<usize> {
    for &tick in changes {
        if nearest(&ends, tick).is_none_or(|index| ends[index].abs_diff(tick) > near) {
            ends.insert(ends.partition_point(|end| *end < tick), tick);
        }
    }
    ends
}

/// The ends of blocks, with those added that keep every tick within the tolerance: between far ends not all were looked at.
fn kept(poses: &[[f64; CHANNELS]], ends: Vec<usize>, tolerances: &LineTolerances) -> Vec<usize> {
    let mut kept = Vec::with_capacity(ends.len());
    let mut before = 0;
    let mut left: Vec<usize> = ends.into_iter().rev().collect();
    while let Some(&end) = left.last() {
        let off = |tick: &usize| beside(&poses[*tick], &poses[before], &poses[end], tolerances);
        let worst = (before + 1..end).max_by(|a, b| off(a).total_cmp(&off(b)));
        match worst.filter(|tick| off(tick) > 1.0) {
            Some(tick) => left.push(tick),
            None => {
                kept.push(end);
                before = end;
                left.pop();
            }
        }
    }
    kept
}

struct Walker<'a> {
    poses: Poses<'a>,
    track: JointTrack,
    machine: &'a MachineConfiguration,
    servo_hz: f64,
    acceleration_mm_s2: f64,
    tolerances: &'a Tolerances,
}

impl Walker<'_> {
    fn first(&mut self) -> Result<Place, Refusal> {
        let pose = self.poses.at(0);
        self.place(&pose, 0)
    }

    /// The blocks from tick to tick; none where nothing moves.
    fn blocks(
        &mut self,
        [from, to]: [u64; 2],
        start: &Place,
        changes: &[OutputChange],
    ) -> Result<Vec<Block>, Refusal> {
        let poses: Vec<[f64; CHANNELS]> = (from..=to).map(|tick| self.poses.at(tick)).collect();
        let moves = |pose: &[f64; CHANNELS]| pose[..CHANNEL_VOLUME] != poses[0][..CHANNEL_VOLUME];
        if !poses.iter().any(moves) {
            return Ok(Vec::new());
        }
        let speeds: Vec<f64> = poses.windows(2).map(|pair| self.speed(pair)).collect();
        let mut before = 0;
        let mut at = *start;
        let mut blocks = Vec::new();
        let ticks: Vec<usize> = changes
            .iter()
            .map(|of| (of.tick.min(to) - from) as usize)
            .collect();
        let ends = self.ends(&poses, &speeds, &ticks);
        for &end in &ends {
            for tick in (before..end).step_by(LOOK_TICKS) {
                self.joints(&poses[tick], from + tick as u64)?;
            }
            let to = self.place(&poses[end], from + end as u64)?;
            let way: Vector3<f64> = Vector3::from(to.tip_mm) - Vector3::from(at.tip_mm);
            let turn = UnitQuaternion::from_rotation_matrix(&at.tool.rotation_to(&to.tool));
            let nozzle_rad = match self.turns_flange() {
                true => 0.0,
                false => (to.heading_rad - at.heading_rad).abs(),
            };
            let peak_mm_s = speeds[before..end].iter().copied().fold(0.0, f64::max);
            blocks.push(Block {
                to,
                seconds: (end - before) as f64 / self.servo_hz,
                lasts_s: 0.0,
                length_mm: way.norm(),
                turn_rad: turn.angle() + nozzle_rad,
                blend_mm: 0.0,
                volume_mm3: poses[end][CHANNEL_VOLUME] - poses[before][CHANNEL_VOLUME],
                speed_mm_s: way.norm() * self.servo_hz / (end - before) as f64,
                corner_rad: 0.0,
                output: None,
                peak_mm_s: peak_mm_s.min(way.norm() / self.least_s(&at, &to)),
            });
            (before, at) = (end, to);
        }
        for (change, tick) in changes.iter().zip(ticks) {
            if let Some(index) = nearest(&ends, tick) {
                blocks[index].output = Some(change.value);
            }
        }
        self.blend(&mut blocks, start);
        pace(&mut blocks, self.acceleration_mm_s2);
        Ok(blocks)
    }

    /// Least time between two places by the speeds of the joints, s.
    fn least_s(&self, from: &Place, to: &Place) -> f64 {
        let ways = from.joints.iter().zip(&to.joints);
        let of_joints = ways.zip(&self.machine.joints);
        of_joints
            .map(|((from, to), joint)| (to - from).abs() / joint.speed_max)
            .fold(1e-9, f64::max)
    }

    /// Speed of the tip from a tick to the next, mm/s.
    fn speed(&self, pair: &[[f64; CHANNELS]]) -> f64 {
        let way = (0..3).map(|c| (pair[1][c] - pair[0][c]).powi(2));
        way.sum::<f64>().sqrt() * self.servo_hz
    }

    /// Ends of blocks by geometry, and between them where the speed changes.
    fn ends(&self, poses: &[[f64; CHANNELS]], speeds: &[f64], changes: &[usize]) -> Vec<usize> {
        let tolerances = LineTolerances {
            tip_mm: self.tolerances.tip_mm,
            turn_rad: self.tolerances.turn_rad,
            wrapped: true,
            volume_mm3: f64::INFINITY,
            even: EvenHeading::ANY,
            long_ticks: usize::MAX,
        };
        let least = (BLOCK_S * self.servo_hz) as usize;
        let mut ends = Vec::new();
        let mut before = 0;
        let near = (NEAR_S * self.servo_hz) as usize;
        let straight = with_changes(move_ends(poses, &tolerances), changes, near);
        for end in kept(poses, straight, &tolerances) {
            let mut begun = speeds[before];
            for (tick, &now) in speeds.iter().enumerate().take(end).skip(before + 1) {
                let is_other = now > SPEED_RATIO * begun || begun > SPEED_RATIO * now;
                if is_other && tick - before >= least && end - tick >= least {
                    ends.push(tick);
                    (before, begun) = (tick, now);
                }
            }
            ends.push(end);
            before = end;
        }
        ends
    }

    /// Blends from block to block: as far before the corner as half a block, and as the tolerance allows.
    fn blend(&self, blocks: &mut [Block], start: &Place) {
        for number in 0..blocks.len().saturating_sub(1) {
            let from = match number {
                0 => start,
                _ => &blocks[number - 1].to,
            };
            let [from, at, to] = [from, &blocks[number].to, &blocks[number + 1].to]
                .map(|place| Vector3::from(place.tip_mm));
            let (comes, leaves): (Vector3<f64>, Vector3<f64>) = (at - from, to - at);
            let shorter_mm = comes.norm().min(leaves.norm());
            // A corner of angle c, cut r before it, is missed by r tan(c / 4).
            let corner_rad = comes.angle(&leaves);
            let most_mm = self.tolerances.tip_mm / (0.25 * corner_rad).tan().max(1e-9);
            // As far as a circle needs that is gone through at the speed of the faster block, and no further: until the end
            // of a blend controllers go at the speed of the slower one.
            let faster_mm_s = blocks[number].peak_mm_s.max(blocks[number + 1].peak_mm_s);
            let radius_mm = ROOM * faster_mm_s * faster_mm_s / self.acceleration_mm_s2;
            let needed_mm = radius_mm * (0.5 * corner_rad).tan();
            let wanted_mm = needed_mm.max(LEAST_SHARE * shorter_mm);
            let block = &mut blocks[number];
            block.corner_rad = corner_rad;
            block.blend_mm = most_mm.min(wanted_mm).min(BLEND_SHARE * shorter_mm);
            if block.output.is_some() {
                // Some controllers set it at the beginning of the blend.
                block.blend_mm = block.blend_mm.min(OUTPUT_S * faster_mm_s);
            }
        }
    }

    /// True where the flange turns with the nozzle.
    fn turns_flange(&self) -> bool {
        !matches!(&self.machine.kinematics, Kinematics::Arm6 { arm, .. } if arm.nozzle)
    }

    fn joints(&mut self, pose: &[f64; CHANNELS], tick: u64) -> Result<[f64; JOINTS_MAX], Refusal> {
        let time_s = tick as f64 / self.servo_hz;
        let joints = self.track.joints(pose);
        joints.ok_or_else(|| {
            refusal!(
                "{time_s:.3} s: the machine of the job has no joint positions for this pose; plan \
             it again"
            )
        })
    }

    fn place(&mut self, pose: &[f64; CHANNELS], tick: u64) -> Result<Place, Refusal> {
        let joints = self.joints(pose, tick)?;
        let mut posed = Pose::from_channels(pose);
        let heading_rad = posed.heading_rad;
        if !self.turns_flange() {
            posed.heading_rad = 0.0;
        }
        Ok(Place {
            tip_mm: [pose[0], pose[1], pose[2]],
            tool: posed.rotation() * Rotation3::from_axis_angle(&Vector3::x_axis(), PI),
            heading_rad,
            joints,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: no change of the output is lost in a rest, and of two at one place the later one counts. Method: changes within
    /// a rest of 100 ticks, and two that come right after it, which are set at its end.
    #[test]
    fn a_rest_keeps_what_changes_in_it() {
        let change = |(tick, value)| OutputChange { tick, value };
        let rests_of = |changes: &[(u64, f64)]| {
            let changes: Vec<OutputChange> = changes.iter().copied().map(change).collect();
            rests([1000, 1100], &changes, 100.0)
        };
        assert_eq!(rests_of(&[]), [(1.0, None)]);
        assert_eq!(
            rests_of(&[(1025, 2.0), (1050, 3.0)]),
            [(0.25, Some(2.0)), (0.25, Some(3.0)), (0.5, None)]
        );
        assert_eq!(rests_of(&[(1102, 2.0), (1105, 0.0)]), [(1.0, Some(0.0))]);
    }
}

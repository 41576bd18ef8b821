//! The channel that each motor follows, and a channel's integer base in motor steps.
//!
//! It is advanced once per span, exactly: nothing drifts however long the job.

use crate::configuration::{MOTORS_MAX, MachineConfiguration};
use crate::kinematics;
use crate::steps::{NEAR_STEP, ScaledUnits, StepScale};
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNELS, ChannelPoint, UNITS_PER_NATURAL, Units,
};
use heapless::Vec;

/// A motor that follows a channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct JointChannel {
    /// Which motor.
    pub motor: usize,
    /// Channel that it follows.
    pub channel: usize,
    /// Motor steps of its units.
    pub scale: StepScale,
    /// The same for small offsets: steps, or 2^-16 steps where [`JointChannels::may_be_near`].
    pub offset_scale: f32,
}

/// All of them: joints in order, then the extruder.
#[derive(Clone, Debug)]
pub struct JointChannels {
    motors: Vec<JointChannel, MOTORS_MAX>,
    /// A joint follows no channel: it comes from the tilt,
    tilts: bool,
    /// or from the whole pose.
    follows_pose: bool,
    /// The exponent of angles.
    angle_exponent: u8,
    /// mm in a unit of lengths, rad in one of angles.
    length_natural: f32,
    angle_natural: f32,
}

/// Most motor steps of a unit: [`StepScale`] holds less than 4, and a unit coarser than a step would move in
/// jumps.
const STEPS_PER_UNIT_MAX: f32 = 3.0;

impl JointChannels {
    /// From the machine's configuration.
    pub fn new(configuration: &MachineConfiguration) -> Self {
        let channels = kinematics::joint_channels(&configuration.kinematics);
        let joints = configuration
            .joints
            .iter()
            .map(|joint| joint.steps_per_unit);
        let extruder = (&Some(CHANNEL_VOLUME), configuration.extruder.steps_per_mm3);
        let all = channels
            .iter()
            .zip(joints)
            .chain(core::iter::once(extruder));
        let tilts = channels.contains(&None);
        let follows_pose = kinematics::follows_pose(&configuration.kinematics);
        let unit = if tilts || follows_pose {
            1.0
        } else {
            NEAR_STEP
        };
        let motors = all.enumerate().filter_map(|(motor, (channel, steps))| {
            let channel = (*channel)?;
            let scale = StepScale::new(steps / UNITS_PER_NATURAL.get(channel)?);
            Some(JointChannel {
                motor,
                channel,
                scale,
                offset_scale: scale.steps(unit),
            })
        });
        Self {
            motors: motors.take(MOTORS_MAX).collect(),
            tilts,
            follows_pose,
            angle_exponent: 0,
            length_natural: natural_of(&Units::BASE)[CHANNEL_X],
            angle_natural: natural_of(&Units::BASE)[CHANNEL_HEADING],
        }
    }

    /// The same in a stream's units; `self` has base units. `None` if a unit is too coarse for a motor.
    pub fn in_units(&self, units: &Units) -> Option<Self> {
        let mut coarse = self.clone();
        let natural = natural_of(units);
        coarse.angle_exponent = units.exponent(CHANNEL_HEADING);
        coarse.length_natural = natural[CHANNEL_X];
        coarse.angle_natural = natural[CHANNEL_HEADING];
        for motor in &mut coarse.motors {
            let exponent = units.exponent(motor.channel);
            let single = motor.scale.steps((1u32 << exponent) as f32);
            if exponent > 0 && single > STEPS_PER_UNIT_MAX {
                return None;
            }
            motor.scale = motor.scale.coarser(exponent);
            motor.offset_scale *= (1u32 << exponent) as f32;
        }
        Some(coarse)
    }

    /// mm or rad in a unit of a place channel.
    #[inline(always)]
    pub fn natural(&self, channel: usize) -> f32 {
        if channel == CHANNEL_HEADING {
            self.angle_natural
        } else {
            self.length_natural
        }
    }

    /// How far the extruder's units are in its motor's steps.
    pub fn extruder_scale(&self) -> StepScale {
        self.motors
            .iter()
            .rfind(|motor| motor.channel == CHANNEL_VOLUME)
            .map_or_else(StepScale::default, |motor| motor.scale)
    }

    /// True if joints of the machine follow the tilt.
    pub fn tilts(&self) -> bool {
        self.tilts
    }

    /// True if joints of the machine follow the complete pose.
    pub fn follows_pose(&self) -> bool {
        self.follows_pose
    }

    /// True if the joints are channels, so that a check for short spans is useful. Joints that follow more
    /// than one channel may move any distance.
    pub fn may_be_near(&self) -> bool {
        !self.tilts && !self.follows_pose
    }

    /// The motors that follow a channel.
    #[inline(always)]
    pub fn motors(&self) -> &[JointChannel] {
        &self.motors
    }

    /// µrad in a unit of an angle.
    #[inline(always)]
    pub fn urad_per_unit(&self) -> f32 {
        (1u32 << self.angle_exponent) as f32
    }

    /// An angle of a control point, µrad.
    #[inline(always)]
    pub fn urad(&self, point: &ChannelPoint, channel: usize) -> i32 {
        point.get(channel).copied().unwrap_or(0) << self.angle_exponent
    }

    /// Where the motors are at `base`, in these units; 0 for those that follow no channel.
    pub fn scaled(&self, base: &ChannelPoint) -> [ScaledUnits; MOTORS_MAX] {
        let mut scaled = [ScaledUnits::default(); MOTORS_MAX];
        for joint_channel in &self.motors {
            let units = base.get(joint_channel.channel).copied().unwrap_or(0);
            scaled[joint_channel.motor % MOTORS_MAX] = joint_channel.scale.scaled(i64::from(units));
        }
        scaled
    }
}

/// mm, rad and mm³ in a unit of each channel.
pub(crate) fn natural_of(units: &Units) -> [f32; CHANNELS] {
    core::array::from_fn(|channel| 1.0 / units.per_natural(channel) as f32)
}

//! Which channel each motor follows, and how far a channel's integer base is in motor steps.
//!
//! Moved once per span, exactly: nothing drifts however long the job.

use crate::configuration::{MOTORS_MAX, MachineConfiguration};
use crate::kinematics;
use crate::spline::SpanShape;
use crate::steps::{ScaledUnits, StepScale, Target};
use headway_protocol::units::{CHANNEL_VOLUME, CHANNELS, ChannelPoint, UNITS_PER_NATURAL};

/// One motor.
#[derive(Clone, Copy, Debug, Default)]
struct Carrier {
    /// Channel that it follows, or [`CHANNELS`] for none.
    channel: usize,
    scale: StepScale,
}

/// All motors: the joints in order, then the extruder.
#[derive(Clone, Copy, Debug)]
pub struct Carriers {
    motors: [Carrier; MOTORS_MAX],
}

impl Carriers {
    /// From the machine's configuration.
    pub fn new(configuration: &MachineConfiguration) -> Self {
        let none = Carrier {
            channel: CHANNELS,
            scale: StepScale::default(),
        };
        let mut motors = [none; MOTORS_MAX];
        let channels = kinematics::carriers(&configuration.kinematics).iter();
        let joints = configuration
            .joints
            .iter()
            .map(|joint| joint.steps_per_unit);
        let extruder = (&Some(CHANNEL_VOLUME), configuration.extruder.steps_per_mm3);
        let all = channels.zip(joints).chain(core::iter::once(extruder));
        for (motor, (channel, steps_per_natural)) in motors.iter_mut().zip(all) {
            if let Some(channel) = *channel
                && let Some(units) = UNITS_PER_NATURAL.get(channel)
            {
                *motor = Carrier {
                    channel,
                    scale: StepScale::new(steps_per_natural / units),
                };
            }
        }
        Self { motors }
    }

    /// Where the motors are at `base`; 0 for those that follow no channel.
    pub fn scaled(&self, base: &ChannelPoint) -> [ScaledUnits; MOTORS_MAX] {
        self.motors.map(|motor| {
            let units = base.get(motor.channel).copied().unwrap_or(0);
            motor.scale.scaled(i64::from(units))
        })
    }

    /// Where one motor is at the base of a span, from where it was at that of the one before;
    /// `anchors` are the same as targets.
    #[inline(always)]
    pub fn advance(
        &self,
        motor: usize,
        shape: &SpanShape,
        before: &[ScaledUnits; MOTORS_MAX],
        after: &mut [ScaledUnits; MOTORS_MAX],
        anchors: &mut [Target; MOTORS_MAX],
    ) {
        let motor = motor % MOTORS_MAX;
        let carrier = &self.motors[motor];
        if carrier.channel < CHANNELS {
            let step = shape.base_step(carrier.channel);
            after[motor] = carrier.scale.advanced(&before[motor], step);
            anchors[motor] = Target::of_position(after[motor].position);
        }
    }
}

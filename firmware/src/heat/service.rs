//! Heat parallel to the motion: when a period is due, and the data between motion and heaters.
//!
//! In: the motion, its servo ticks as the clock. Out: outputs of each period; faults latched in the
//! motion, which comes to rest on the path and retracts the melt if that is safe.

use super::{Heat, HeatCause, HeatFault, Orders, Outputs};
use crate::configuration::MachineConfiguration;
use crate::configuration::heat::{HeatConfiguration, PERIOD_S};
use crate::motion::Motion;
use headway_protocol::message::{DeviceState, Fault, FaultCause};

/// The heat loop of a board's main loop.
#[derive(Clone, Debug)]
pub struct HeatService {
    heat: Heat,
    period_ticks: u64,
    next_ticks: u64,
    steps_per_mm3: f32,
    extruder_steps: i64,
}

impl HeatService {
    /// All off; gives the motion the list of heaters.
    pub fn new(
        machine: &MachineConfiguration,
        heat: &HeatConfiguration,
        motion: &mut Motion,
    ) -> Self {
        motion.heat_mut().set_up(heat);
        Self {
            heat: Heat::new(heat),
            period_ticks: (PERIOD_S * machine.servo_hz as f32) as u64,
            next_ticks: 0,
            steps_per_mm3: machine.extruder.steps_per_mm3 as f32,
            extruder_steps: 0,
        }
    }

    /// A conversion of a heater's sensor, 0 to 4095.
    pub fn sample(&mut self, heater: usize, raw: u16) {
        self.heat.sample(heater, raw);
    }

    /// See [`Heat::wait_for_host`].
    pub fn wait_for_host(&mut self, silent_s: f32) {
        self.heat.wait_for_host(silent_s);
    }

    /// Fan pulses and the like are the board's: the heaters themselves.
    pub fn heat(&self) -> &Heat {
        &self.heat
    }

    /// A fault that a run before a reset has left, see [`Heat::keep_cut`].
    pub fn keep_cut(&mut self, fault: Fault) {
        let cause = match fault.cause {
            FaultCause::HeaterStuck => HeatCause::HeaterStuck,
            FaultCause::OverTemperature => HeatCause::OverTemperature,
            _ => return,
        };
        self.heat.keep_cut(HeatFault {
            cause,
            heater: fault.index,
            value: fault.value,
        });
    }

    /// The new outputs, once per period; `None` in between.
    pub fn serve(&mut self, motion: &mut Motion, fan_turns: u8) -> Option<Outputs> {
        let orders = self.take_orders(motion, fan_turns)?;
        let outputs = self.tick(&orders);
        self.tell(motion, &outputs);
        Some(outputs)
    }

    /// The motion's requests for the period that begins now; `None` in between. They are copied, as in
    /// [`Self::tell`]: a board locks the motion for these and not for [`Self::tick`].
    pub fn take_orders(&mut self, motion: &mut Motion, fan_turns: u8) -> Option<Orders> {
        let now_ticks = motion.now_ticks();
        if now_ticks < self.next_ticks {
            return None;
        }
        self.next_ticks = now_ticks + self.period_ticks;
        if self.heat.fault().is_some() && motion.fault().is_none() {
            self.heat.clear_fault();
        }
        let (targets_c, part_fan) = motion.heat().orders();
        Some(Orders {
            targets_c,
            part_fan,
            flow_mm3_s: self.flow_mm3_s(motion),
            drivers_on: motion.drivers_on(),
            host_heard: motion.heat_mut().take_heard(),
            faulted: motion.fault().is_some(),
            streams: motion.has_stream(),
            paused: motion.state() == DeviceState::Paused,
            fan_turns,
        })
    }

    /// The period's regulation.
    pub fn tick(&mut self, orders: &Orders) -> Outputs {
        self.heat.tick(orders)
    }

    /// Reports the result to the motion.
    pub fn tell(&self, motion: &mut Motion, outputs: &Outputs) {
        if let Some(fault) = self.heat.fault() {
            motion.fail_softly(fault.into());
        }
        let faulted = motion.fault().is_some();
        let state = motion.state();
        let panel = motion.heat_mut();
        panel.note_leave(state);
        if faulted {
            panel.all_off();
        }
        if outputs.lapsed {
            panel.lapse();
        }
        panel.note_stuck(self.heat.stays_on().map(Into::into));
        for heater in 0..self.heat.count() {
            let reading_c = self.heat.reading_c(heater);
            let (target_c, duty) = (self.heat.target_c(heater), self.heat.duty(heater));
            panel.note(heater, reading_c, target_c, duty);
        }
        panel.note_ready(outputs.not_ready, outputs.lowered);
        motion.note_heat();
    }

    /// Mean flow of the last period.
    fn flow_mm3_s(&mut self, motion: &Motion) -> f32 {
        let extruder = motion.motors() - 1;
        let steps = motion.counts().get(extruder).copied().unwrap_or_default();
        let way = steps.wrapping_sub(self.extruder_steps);
        self.extruder_steps = steps;
        way as f32 / self.steps_per_mm3 / PERIOD_S
    }
}

impl From<HeatFault> for Fault {
    fn from(fault: HeatFault) -> Self {
        let cause = match fault.cause {
            HeatCause::SensorOpen => FaultCause::SensorOpen,
            HeatCause::SensorShorted => FaultCause::SensorShorted,
            HeatCause::SensorSilent => FaultCause::SensorSilent,
            HeatCause::SensorFrozen => FaultCause::SensorFrozen,
            HeatCause::OverTemperature => FaultCause::OverTemperature,
            HeatCause::UnderTemperature => FaultCause::UnderTemperature,
            HeatCause::HeatingSlow => FaultCause::HeatingSlow,
            HeatCause::Drift => FaultCause::TemperatureDrift,
            HeatCause::HeaterStuck => FaultCause::HeaterStuck,
            HeatCause::PowerMismatch => FaultCause::PowerMismatch,
            HeatCause::HostSilent => FaultCause::HostSilent,
            HeatCause::FanStalled => FaultCause::FanStalled,
        };
        Self {
            cause,
            index: fault.heater,
            value: fault.value,
        }
    }
}

//! Heaters of an STM32F4 board: the loop at 10 Hz in the main loop, the PWM in the servo interrupt.

use super::converter::Thermistors;
use super::runtime::{Shared, with_motion};
use super::start;
use headway_firmware::board::{BoardPins, HeatPort, KeptFault};
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_firmware::heat::Outputs;
use headway_firmware::heat::pwm::SoftPwm;
use headway_firmware::heat::service::HeatService;

/// The servo interrupt's; the main loop holds it off while it loads a schedule.
static PWM: Shared<SoftPwm> = Shared::empty();

/// Before any interrupt is on.
pub fn set_up() {
    // SAFETY: nothing interrupts yet.
    unsafe { PWM.set(SoftPwm::default()) }
}

/// One servo tick, for its interrupt.
#[inline(always)]
pub fn servo_tick(pins: &mut impl BoardPins) {
    // SAFETY: set before this interrupt is on; the main loop raises BASEPRI.
    if let Some(levels) = unsafe { PWM.get() }.tick() {
        pins.put_heat(levels);
    }
}

/// Nothing more is switched on before the loop has its next turn; from the main loop.
pub fn cut() {
    // SAFETY: the servo is held off.
    with_motion(|_| unsafe { PWM.with(SoftPwm::cut) });
}

/// The main loop's part.
pub struct HeatLoop {
    service: HeatService,
    port: Thermistors,
}

impl HeatLoop {
    /// All off; `None` before the motion exists.
    // Never part of its caller, whose stack lasts.
    #[inline(never)]
    pub fn new(
        machine: &MachineConfiguration,
        heat: &HeatConfiguration,
        port: Thermistors,
    ) -> Option<Self> {
        let mut service = with_motion(|motion| HeatService::new(machine, heat, motion))?;
        if let Some(fault) = start::kept_fault().fault() {
            service.keep_cut(fault);
        }
        Some(Self { service, port })
    }

    /// One round of the main loop.
    #[inline(never)]
    pub fn turn(&mut self) {
        if let Some((heater, raw)) = self.port.poll() {
            self.service.sample(heater, raw);
        }
        let service = &mut self.service;
        let orders = with_motion(|motion| service.take_orders(motion, 0)).flatten();
        if let Some(orders) = orders {
            let outputs = service.tick(&orders);
            let fault = with_motion(|motion| {
                service.tell(motion, &outputs);
                motion.heat().stuck().or(motion.fault())
            });
            self.put_out(&outputs);
            if let Some(fault) = fault {
                start::keep_fault(KeptFault::of(fault));
            }
        }
    }

    fn put_out(&mut self, outputs: &Outputs) {
        let schedule = outputs.schedule();
        with_motion(|_| {
            // SAFETY: the servo is held off.
            let pwm = unsafe { PWM.get() };
            if outputs.is_cold() {
                // Now, not after the present period.
                pwm.cut();
            }
            pwm.load(&schedule);
        });
        self.port.supply(!outputs.cut_supply);
    }
}

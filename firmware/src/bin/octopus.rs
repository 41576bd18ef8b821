//! BTT Octopus v1.0 and v1.1 (STM32F446ZE at 168 MHz): eight drivers, TMC2209 by UART or stand-alone, USB CDC and
//! USART 2.
//!
//! Start-up and main loop are in `shared/stm32f4.rs`, steps, servo and link in `shared/runtime.rs`; pins
//! and their polarity are in `shared/octopus_pins.rs`. Steps are port-wide writes, equivalent to
//! `headway_firmware::board::PinOutput`. `docs/guide/boards.md` describes how to build, flash and wire it.
//! Built and emulated: it has not run on hardware.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this binary is for the board: build it for thumbv7em-none-eabihf");
}

#[cfg(all(target_os = "none", feature = "defmt"))]
use defmt_rtt as _;

#[cfg(target_os = "none")]
#[path = "shared/octopus_drivers.rs"]
mod drivers;
#[cfg(target_os = "none")]
#[path = "shared/octopus_heat.rs"]
mod heat;
#[cfg(target_os = "none")]
#[path = "shared/octopus_pins.rs"]
mod pins;
#[cfg(target_os = "none")]
#[path = "shared/octopus_step_ports.rs"]
mod ports;
#[cfg(target_os = "none")]
#[path = "shared/runtime.rs"]
mod runtime;
#[cfg(target_os = "none")]
#[path = "shared/octopus_servo.rs"]
mod servo;
#[cfg(target_os = "none")]
#[path = "shared/stm32f4.rs"]
mod stm32f4;
#[cfg(all(target_os = "none", feature = "octopus"))]
#[path = "shared/stm32f4_usb.rs"]
mod usb;

#[cfg(target_os = "none")]
use {
    board::Output,
    stm32f4::{CoreClock as Clock, pend_stop},
};

#[cfg(target_os = "none")]
mod board {
    use crate::pins;
    use crate::ports::DriverPorts;
    use crate::stm32f4::{self, Parts, SerialLine};
    use headway_firmware::board::input_map::InputMap;
    use headway_firmware::configuration::board_name::{BoardName, Known};
    use headway_firmware::configuration::heat::HeatConfiguration;
    use headway_firmware::configuration::wiring::Wiring;
    use headway_firmware::steps::output::PortOutput;
    use stm32f4xx_hal::pac::{self, Interrupt, interrupt};

    pub type Output = PortOutput<DriverPorts>;
    pub type Pins = pins::OctopusPins;
    pub type HeatPins = crate::heat::OctopusHeat;
    pub use crate::pins::heaters_off;
    pub type DriverPins = crate::drivers::OctopusDrivers;
    pub type ServoPin = crate::servo::OctopusServo;

    /// A hot end and a bed with the usual thermistors, if the settings contain no heaters.
    pub fn heaters(settings: Option<HeatConfiguration>) -> HeatConfiguration {
        settings.unwrap_or_else(HeatConfiguration::standard)
    }

    #[cfg(feature = "octopus")]
    pub type UsbLine = crate::usb::UsbLine;
    #[cfg(not(feature = "octopus"))]
    pub type UsbLine = headway_firmware::board::NoLine;

    pub const MOTORS: usize = headway_firmware::configuration::MOTORS_MAX;
    pub use headway_firmware::board::octopus::SETTINGS_SECTORS;
    /// Others have its chip, and other things at its pins.
    pub const NAMES: &[BoardName] = &headway_firmware::board::octopus::NAMES;
    pub const MUST_BE_NAMED: bool = true;

    /// The crystal of the chip.
    pub const CRYSTAL_HZ: u32 = 12_000_000;
    /// STM32F446.
    pub const CHIP_ID: u32 = 0x421;
    pub use headway_firmware::board::octopus::{INPUTS, input};
    /// Ports A to G.
    pub const PORTS_CLOCK_MASK: u32 = 0x7f;
    /// USART 2.
    pub const SERIAL_PORT: usize = 0x4000_4400;
    pub const SERIAL_CLOCK_MASK: u32 = 1 << 17;
    pub const SERIAL_INTERRUPT: Interrupt = Interrupt::USART2;

    #[interrupt]
    fn USART2() {
        SerialLine::interrupt();
    }

    pub fn set_up_board(
        device: pac::Peripherals,
        motors: usize,
        map: InputMap,
        wiring: &Wiring,
        known: Known,
    ) -> Option<Parts> {
        // Before the pins: the library that takes the pins of USB over resets their port.
        #[cfg(feature = "octopus")]
        let usb = crate::usb::set_up(device)?;
        #[cfg(not(feature = "octopus"))]
        let usb = {
            drop(device);
            headway_firmware::board::NoLine
        };
        let pins = pins::set_up(motors, map, known);
        Some(Parts {
            output: PortOutput::new(
                DriverPorts::new(pins::PORTS),
                motors,
                wiring.reversed_motors,
            ),
            pins,
            usb,
            heat: crate::heat::OctopusHeat::set_up(),
            drivers: crate::drivers::set_up(),
            servo: crate::servo::OctopusServo::set_up(known),
        })
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        stm32f4::main()
    }
}

//! Adafruit Feather STM32F405 Express (168 MHz), five drivers on its headers, serial line: a minimal
//! board, with only pins of its own, all of them from the HAL.
//!
//! Pins after the board's published table. Drivers share one enable; PB7 (SDA) is the emergency input.
//! Built and emulated (QEMU, netduinoplus2): it has not run on hardware.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this binary is for the board: build it for thumbv7em-none-eabihf");
}

#[cfg(all(target_os = "none", feature = "defmt"))]
use defmt_rtt as _;

#[cfg(target_os = "none")]
#[path = "shared/runtime.rs"]
mod runtime;
#[cfg(target_os = "none")]
#[path = "shared/stm32f4.rs"]
mod stm32f4;

#[cfg(target_os = "none")]
use {board::Output, stm32f4::pend_stop};

#[cfg(target_os = "none")]
mod board {
    use crate::stm32f4::rcc::all_inputs;
    use crate::stm32f4::{self, CoreDelay, Parts, SerialLine};
    use headway_firmware::board::input_map::InputMap;
    use headway_firmware::board::sector_flash::Sector;
    use headway_firmware::board::{NoHeat, NoLine, PinBoard, PinOutput};
    use headway_firmware::configuration::board_name::{BoardName, Known};
    use headway_firmware::configuration::heat::HeatConfiguration;
    use headway_firmware::configuration::wiring::{BoardInputs, Wiring};
    use headway_firmware::drivers::NoDrivers;
    use headway_firmware::motion::probe_pin::NoPulse;
    use headway_firmware::steps::output::Pin;
    use stm32f4xx_hal::gpio::{self, ErasedPin, Input};
    use stm32f4xx_hal::pac::{self, Interrupt, interrupt};
    use stm32f4xx_hal::prelude::*;

    type OutputPin = ErasedPin<gpio::Output>;
    /// X, Y, Z, nozzle, extruder.
    pub const MOTORS: usize = 5;
    /// Nothing of ours that gets hot is at its pins.
    pub const NAMES: &[BoardName] = &[BoardName::Feather];
    pub const MUST_BE_NAMED: bool = false;
    /// After all code: the chip has 1 MiB.
    pub const SETTINGS_SECTORS: [Sector; 2] = [
        Sector {
            number: 8,
            address: 0x0808_0000,
        },
        Sector {
            number: 9,
            address: 0x080a_0000,
        },
    ];
    pub type Output = PinOutput<OutputPin, OutputPin, MOTORS>;
    /// Four inputs.
    pub type Pins = PinBoard<ErasedPin<Input>, OutputPin, 4, 1>;
    pub type UsbLine = NoLine;
    pub type HeatPins = NoHeat;
    /// Its drivers are stand-alone: no pin is left for their wires.
    pub type DriverPins = NoDrivers;
    pub type ServoPin = NoPulse;

    /// The crystal of the chip.
    pub const CRYSTAL_HZ: u32 = 12_000_000;
    /// STM32F405.
    pub const CHIP_ID: u32 = 0x413;
    /// Switches of X, Y and Z, then the emergency input; Z's has no line of the interrupts that are used.
    const INPUT_PINS: [Pin; 4] = [(1, 9), (1, 8), (2, 3), (1, 7)];
    pub const INPUTS: BoardInputs = BoardInputs {
        count: 4,
        emergency: 3,
        emergency_mask: 0b1011,
    };

    pub fn input(number: u8) -> Option<Pin> {
        INPUT_PINS.get(usize::from(number)).copied()
    }

    /// Ports A to C.
    pub const PORTS_CLOCK_MASK: u32 = 0b111;
    /// USART 3: TX and RX of the header.
    pub const SERIAL_PORT: usize = 0x4000_4800;
    pub const SERIAL_CLOCK_MASK: u32 = 1 << 18;
    pub const SERIAL_INTERRUPT: Interrupt = Interrupt::USART3;

    /// This board has no heaters, whatever the settings contain.
    pub fn heaters(_settings: Option<HeatConfiguration>) -> HeatConfiguration {
        HeatConfiguration::none()
    }

    pub fn heaters_off() {}

    #[interrupt]
    fn USART3() {
        SerialLine::interrupt();
    }

    pub fn set_up_board(
        device: pac::Peripherals,
        motors: usize,
        map: InputMap,
        wiring: &Wiring,
        known: Known,
    ) -> Option<Parts> {
        if motors > MOTORS {
            return None;
        }
        let mut rcc = device.RCC.constrain();
        let a = device.GPIOA.split(&mut rcc);
        let b = device.GPIOB.split(&mut rcc);
        let c = device.GPIOC.split(&mut rcc);
        let steps = [
            a.pa4.into_push_pull_output().erase(),
            a.pa6.into_push_pull_output().erase(),
            c.pc4.into_push_pull_output().erase(),
            c.pc7.into_push_pull_output().erase(),
            b.pb13.into_push_pull_output().erase(),
        ];
        let directions = [
            a.pa5.into_push_pull_output().erase(),
            a.pa7.into_push_pull_output().erase(),
            c.pc5.into_push_pull_output().erase(),
            c.pc6.into_push_pull_output().erase(),
            b.pb14.into_push_pull_output().erase(),
        ];
        let [x, y, z] = [
            b.pb9.into_pull_up_input().erase(),
            b.pb8.into_pull_up_input().erase(),
            c.pc3.into_pull_up_input().erase(),
        ];
        let emergency = b.pb7.into_pull_up_input().erase();
        let enable = c.pc2.into_push_pull_output_in_state(gpio::PinState::High);
        if known == Known::Foreign {
            // Nothing is written to modes from here on.
            all_inputs();
        }
        b.pb10.into_alternate::<7>();
        // An input that floats hears noise.
        b.pb11.into_alternate::<7>().internal_pull_up(true);
        Some(Parts {
            output: PinOutput::new(steps, directions, wiring.reversed_motors),
            pins: PinBoard::new([x, y, z, emergency], map, [enable.erase()], &mut CoreDelay),
            usb: NoLine,
            heat: NoHeat,
            drivers: NoDrivers,
            servo: NoPulse,
        })
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        stm32f4::main()
    }
}

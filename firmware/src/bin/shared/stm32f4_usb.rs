//! USB CDC of an STM32F4: a serial port to the host, with the chip's own serial number.
//!
//! The driver masks all interrupts while it moves a packet, without need: it is polled only from the
//! main loop. It is called where the core ignores that ([`without_masking`]), so that no step is
//! delayed.

use super::rcc::{Bus, clock_on};
use super::runtime::without_masking;
use super::{CORE_HZ, start::usb_serial_number};
use embedded_io::{ErrorType, Read, ReadReady, Write, WriteReady};
use stm32f4xx_hal::otg_fs::{USB, UsbBus};
use stm32f4xx_hal::pac::Peripherals;
use stm32f4xx_hal::prelude::*;
use usb_device::bus::UsbBusAllocator;
use usb_device::prelude::*;
use usbd_serial::SerialPort;

/// A packet at full speed.
const PACKET_BYTES: usize = 64;

pub struct UsbLine {
    device: UsbDevice<'static, UsbBus<USB>>,
    port: SerialPort<'static, UsbBus<USB>>,
    packet: [u8; PACKET_BYTES],
    length: usize,
}

/// Of the USB controller, on its bus.
const USB_CLOCK: u32 = 1 << 7;

pub fn set_up(peripherals: Peripherals) -> Option<UsbLine> {
    // Ahead of the HAL, whose barrier the compiler may leave some instructions behind the write that it is for.
    clock_on(Bus::Ahb2, USB_CLOCK);
    let mut rcc = peripherals.RCC.constrain();
    let port_a = peripherals.GPIOA.split(&mut rcc);
    let usb = USB {
        usb_global: peripherals.OTG_FS_GLOBAL,
        usb_device: peripherals.OTG_FS_DEVICE,
        usb_pwrclk: peripherals.OTG_FS_PWRCLK,
        pin_dm: port_a.pa11.into(),
        pin_dp: port_a.pa12.into(),
        hclk: CORE_HZ.Hz(),
    };
    let memory = cortex_m::singleton!(: [u32; 320] = [0; 320])?;
    let bus = UsbBus::new(usb, memory);
    let bus = cortex_m::singleton!(: UsbBusAllocator<UsbBus<USB>> = bus)?;
    let serial_number = cortex_m::singleton!(: [u8; 24] = usb_serial_number())?;
    // SAFETY: digits and letters.
    let serial_number = unsafe { core::str::from_utf8_unchecked(serial_number) };
    let port = SerialPort::new(bus);
    let strings = StringDescriptors::default()
        .manufacturer("Headway")
        .product("Headway controller")
        .serial_number(serial_number);
    // The numbers that the USB device crate's authors have set aside for serial ports.
    let device = UsbDeviceBuilder::new(bus, UsbVidPid(0x16c0, 0x27dd))
        .device_class(usbd_serial::USB_CLASS_CDC)
        .strings(&[strings])
        .ok()?
        .build();
    Some(UsbLine {
        device,
        port,
        packet: [0; PACKET_BYTES],
        length: 0,
    })
}

impl ErrorType for UsbLine {
    type Error = core::convert::Infallible;
}

impl ReadReady for UsbLine {
    fn read_ready(&mut self) -> Result<bool, Self::Error> {
        without_masking(|| {
            self.device.poll(&mut [&mut self.port]);
            if self.length == 0 {
                self.length = self.port.read(&mut self.packet).unwrap_or(0);
            }
        });
        Ok(self.length > 0)
    }
}

impl Read for UsbLine {
    /// A packet at once; `bytes` must hold one.
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Self::Error> {
        let length = core::mem::take(&mut self.length);
        for (byte, arrived) in bytes.iter_mut().zip(self.packet.iter().take(length)) {
            *byte = *arrived;
        }
        Ok(length.min(bytes.len()))
    }
}

impl WriteReady for UsbLine {
    fn write_ready(&mut self) -> Result<bool, Self::Error> {
        Ok(self.device.state() == UsbDeviceState::Configured)
    }
}

impl Write for UsbLine {
    /// What fits: nothing while the host does not listen.
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
        Ok(without_masking(|| self.port.write(bytes).unwrap_or(0)))
    }

    fn flush(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

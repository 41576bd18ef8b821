//! Why a controller has stopped, with the value that caused it, and the text of that.

use serde::{Deserialize, Serialize};

/// What tripped a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FaultCause {
    /// Emergency input or command.
    Emergency,
    /// Limit switch of joint `index`.
    LimitSwitch,
    /// Joint `index` would leave its range, at `value` (0.1 µm or µrad).
    SoftLimit,
    /// A segment that cannot be: `value` is the knot's number.
    BadSegment,
    /// The stream's totals or order are wrong: `value` is the sequence number.
    Sequence,
    /// The pose has no joint positions: `value` is the span.
    Kinematics,
    /// The control loop was not served in time.
    Watchdog,
    /// Motor `index` would need more than one step per tick: `value` is its speed in thousandths of
    /// a step per step tick.
    StepRate,
    /// Step ticks were missed.
    StepOverrun,
    /// The time warp left its bounds.
    TimeWarp,
    /// Homing did not find the switch of joint `index`.
    Homing,
    /// The machine configuration cannot be run.
    Configuration,
    /// The firmware is for another board; it cannot be cleared. `index` 0: `value` is the chip's
    /// device id; 1: the crystal has `value` Hz, or does not start (0); 2: the core's clock does not
    /// lock; 3: the settings do not name which of the boards with this chip it is.
    Board,
    /// Motor `index` would exceed its speed or acceleration limit: `value` is the share in thousandths.
    Limit,
    /// The sensor of heater `index` is broken; `value` here and below: its last temperature, 0.01 °C.
    SensorOpen,
    /// The sensor of heater `index` is shorted.
    SensorShorted,
    /// The sensor of heater `index` gives no numbers.
    SensorSilent,
    /// The sensor of heater `index` always gives the same number.
    SensorFrozen,
    /// Heater `index` is above its limit.
    OverTemperature,
    /// Heater `index` is colder than can be.
    UnderTemperature,
    /// Heater `index` does not get warmer as fast as it should.
    HeatingSlow,
    /// Heater `index` has left its target.
    TemperatureDrift,
    /// Heater `index` gets warmer while it is off.
    HeaterStuck,
    /// The power of heater `index` does not match its temperature.
    PowerMismatch,
    /// No host was heard for `value` s while something was heated.
    HostSilent,
    /// The fan of a hot end does not turn.
    FanStalled,
    /// The driver of motor `index` does not answer or cannot be set up; `value`: 0 silent, 1 noise, 0x100 +
    /// register: a write not accepted, 0x200 + register: reads back a different value, 0x300 + version:
    /// another chip, 0x400: cannot be set so, 0x500: no bus to it.
    DriverSilent,
    /// The driver of motor `index` has restarted: its settings were lost.
    DriverReset,
    /// The driver of motor `index` has switched off for heat; `value` here and below: its DRV_STATUS.
    DriverHot,
    /// The driver of motor `index` has switched off for a short.
    DriverShort,
    /// Melt was to move while heater `index` was too cold for it: `value` is its temperature, 0.01 °C.
    ColdExtrusion,
}

/// A latched fault with the value that tripped it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Fault {
    /// What tripped.
    pub cause: FaultCause,
    /// Joint or motor, 0 if it has no meaning.
    pub index: u8,
    /// The value, as defined by the cause.
    pub value: i32,
}

impl core::fmt::Display for Fault {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let (index, value) = (self.index, self.value);
        match self.cause {
            FaultCause::Emergency => f.write_str("emergency stop"),
            FaultCause::LimitSwitch => write!(f, "limit switch of joint {index}"),
            FaultCause::SoftLimit => write!(
                f,
                "joint {index} would leave its range, at {value} (0.1 µm or µrad)"
            ),
            FaultCause::BadSegment => write!(f, "knot {value} cannot be run"),
            FaultCause::Sequence => write!(f, "the stream's totals or order are wrong ({value})"),
            FaultCause::Kinematics => write!(f, "the pose of span {value} has no joint positions"),
            FaultCause::Watchdog => f.write_str("the control loop was not served in time"),
            FaultCause::StepRate => write!(
                f,
                "motor {index} would need {value} thousandths of a step per step tick"
            ),
            FaultCause::StepOverrun => write!(f, "step ticks were missed ({value})"),
            FaultCause::TimeWarp => f.write_str("the time warp left its bounds"),
            FaultCause::Homing => write!(f, "homing did not find the switch of joint {index}"),
            FaultCause::Limit => write!(
                f,
                "motor {index} would reach {} % of its speed or acceleration limit",
                value / 10
            ),
            FaultCause::HostSilent => write!(f, "no host was heard for {value} s while heating"),
            FaultCause::FanStalled => f.write_str("the fan of a hot end does not turn"),
            FaultCause::DriverSilent
            | FaultCause::DriverReset
            | FaultCause::DriverHot
            | FaultCause::DriverShort => driver_fault(f, self),
            FaultCause::SensorOpen => heater_fault(f, "has a broken sensor", self),
            FaultCause::SensorShorted => heater_fault(f, "has a shorted sensor", self),
            FaultCause::SensorSilent => heater_fault(f, "has a sensor that gives no numbers", self),
            FaultCause::SensorFrozen => heater_fault(f, "has a sensor that is frozen", self),
            FaultCause::OverTemperature => heater_fault(f, "is above its limit", self),
            FaultCause::UnderTemperature => heater_fault(f, "is colder than can be", self),
            FaultCause::HeatingSlow => heater_fault(f, "does not heat as fast as it should", self),
            FaultCause::TemperatureDrift => heater_fault(f, "has left its target", self),
            FaultCause::HeaterStuck => heater_fault(f, "gets warmer while it is off", self),
            FaultCause::PowerMismatch => heater_fault(
                f,
                "takes another power than its temperature does (does the sensor sit in it?)",
                self,
            ),
            FaultCause::ColdExtrusion => {
                ColdHeater::write_temperature(f, index, value / 10)?;
                f.write_str(", too cold to extrude: heat it, or stream with --no-heat")
            }
            FaultCause::Configuration => f.write_str("the machine configuration cannot be run"),
            FaultCause::Board => match (index, value) {
                (0, _) => write!(
                    f,
                    "the firmware is for another chip than this one (device id {value:#x}); flash the image of this board"
                ),
                (1, 0) => f.write_str("the board's crystal does not start"),
                (1, _) => write!(
                    f,
                    "the board's crystal has {:.1} MHz, the firmware is for another; flash the image of this board",
                    f64::from(value) / 1e6
                ),
                (3, _) => f.write_str(
                    "nothing tells which board it is, so nothing moves or heats: put board = \"octopus-1.1\" (or \
                     octopus-1.0, spider-1.1, spider-2.2, as it is printed on it) at the top of the machine file, run \
                     `headway board configure` and switch the board off and on",
                ),
                _ => f.write_str("the clock of the board's core does not lock"),
            },
        }
    }
}

/// A hot end that is too cold for melt to move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ColdHeater {
    /// Heater from 0.
    pub heater: u8,
    /// Its temperature, tenths of a degree Celsius; the lowest number if it is not known.
    pub decidegrees: i16,
    /// The lowest at which melt may move.
    pub least_decidegrees: u16,
}

impl ColdHeater {
    fn write_temperature(
        f: &mut core::fmt::Formatter<'_>,
        heater: u8,
        decidegrees: i32,
    ) -> core::fmt::Result {
        if decidegrees == i32::from(i16::MIN) {
            return write!(f, "heater {heater} gives no temperature");
        }
        write!(
            f,
            "heater {heater} is at {:.1} °C",
            f64::from(decidegrees) / 10.0
        )
    }

    /// The fault of a stream.
    pub fn fault(&self) -> Fault {
        Fault {
            cause: FaultCause::ColdExtrusion,
            index: self.heater,
            value: i32::from(self.decidegrees) * 10,
        }
    }
}

impl core::fmt::Display for ColdHeater {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        Self::write_temperature(f, self.heater, self.decidegrees.into())?;
        write!(
            f,
            ", melt may move from {:.1} °C on: heat it first, or give --no-heat",
            f64::from(self.least_decidegrees) / 10.0
        )
    }
}

/// Shorts in a DRV_STATUS, from bit 2 on.
const SHORTS: [&str; 4] = [
    "A to ground",
    "B to ground",
    "A to the supply",
    "B to the supply",
];

/// A fault of a motor's driver.
fn driver_fault(f: &mut core::fmt::Formatter<'_>, fault: &Fault) -> core::fmt::Result {
    let (index, value) = (fault.index, fault.value);
    write!(f, "the driver of motor {index} ")?;
    match (fault.cause, value >> 8) {
        (FaultCause::DriverReset, _) => {
            f.write_str("has restarted (is its supply stable?); it is set up again")
        }
        (FaultCause::DriverHot, _) => write!(f, "has switched off for heat ({value:#010x})"),
        (FaultCause::DriverShort, _) => {
            f.write_str("has switched off for a short")?;
            let shorts = (2..).zip(SHORTS);
            for (_, coil) in shorts.filter(|(bit, _)| value >> bit & 1 == 1) {
                write!(f, ", coil {coil}")?;
            }
            write!(f, " ({value:#010x})")
        }
        (_, 1) => write!(f, "does not take register {:#04x}", value & 0xff),
        (_, 2) => write!(f, "reads register {:#04x} back otherwise", value & 0xff),
        (_, 3) => write!(
            f,
            "is another chip than the machine file says: its version is {:#04x} (a TMC2209's 0x21, a TMC5160's 0x30, a \
             TMC2240's 0x40)",
            value & 0xff
        ),
        (_, 5) => f.write_str("has SPI, to which this board has no wires"),
        _ if value == 1 => f.write_str("answers with noise"),
        _ => f.write_str(
            "does not answer (is the motors' supply on, the jumper set for UART or SPI?)",
        ),
    }
}

fn heater_fault(f: &mut core::fmt::Formatter<'_>, what: &str, fault: &Fault) -> core::fmt::Result {
    let celsius = f64::from(fault.value) / 100.0;
    write!(f, "heater {} {what} (last {celsius:.1} °C)", fault.index)
}

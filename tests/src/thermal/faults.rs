//! What can break, and within what time the heaters must be off.

/// What is broken; the number is the heater's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Injected {
    SensorOpen(usize),
    SensorShorted(usize),
    /// Hangs in the air beside what it should measure.
    FallenOut(usize),
    /// Gives always the number that it gave last, of the hot end.
    ConverterFrozen,
    /// Gives no numbers.
    ConverterSilent,
    /// The transistor conducts for good.
    HeaterStuck(usize),
    /// The wire of the heater is broken.
    HeaterBroken(usize),
    FanStuck,
    HostGone,
    /// Half the voltage.
    SupplySags,
    MainLoopHangs,
    /// Watchdog, brown-out or panic: the board begins anew.
    Reset,
}

const HOT_END: usize = 0;
const BED: usize = 1;

impl Injected {
    /// All of them by name, each with its bound, s, from when something was to heat at the target: the
    /// guard's own times, and for what must first cool down out of the hysteresis how long that takes.
    pub const ALL: [(&'static str, Self, f64); 18] = [
        ("hot_end_sensor_open", Self::SensorOpen(HOT_END), 0.5),
        ("bed_sensor_open", Self::SensorOpen(BED), 0.5),
        ("hot_end_sensor_shorted", Self::SensorShorted(HOT_END), 0.5),
        ("bed_sensor_shorted", Self::SensorShorted(BED), 0.5),
        ("hot_end_sensor_fallen_out", Self::FallenOut(HOT_END), 30.0),
        ("bed_sensor_fallen_out", Self::FallenOut(BED), 70.0),
        ("converter_frozen", Self::ConverterFrozen, 10.5),
        ("converter_silent", Self::ConverterSilent, 0.5),
        ("hot_end_heater_stuck_on", Self::HeaterStuck(HOT_END), 40.0),
        ("bed_heater_stuck_on", Self::HeaterStuck(BED), 60.0),
        ("hot_end_heater_broken", Self::HeaterBroken(HOT_END), 60.0),
        ("bed_heater_broken", Self::HeaterBroken(BED), 200.0),
        ("hot_end_fan_stuck", Self::FanStuck, 3.5),
        ("host_gone", Self::HostGone, 30.5),
        ("supply_sags_to_half", Self::SupplySags, 120.0),
        ("main_loop_hangs", Self::MainLoopHangs, 0.5),
        ("watchdog_brown_out_or_panic", Self::Reset, 0.2),
        ("heater_on_at_reset", Self::HeaterStuck(HOT_END), 40.0),
    ];

    /// The heater that it is about; the hot end where it is about all.
    pub fn heater(self) -> usize {
        match self {
            Self::SensorOpen(heater)
            | Self::SensorShorted(heater)
            | Self::FallenOut(heater)
            | Self::HeaterStuck(heater)
            | Self::HeaterBroken(heater) => heater,
            _ => HOT_END,
        }
    }
}

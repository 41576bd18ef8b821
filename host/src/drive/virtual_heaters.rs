//! Heaters of a board without hardware: the plant that its heat loop controls and measures.
//!
//! In: duties of the firmware's heat loop, servo ticks. Out: conversions of the sensors. Each heater is one mass
//! that loses heat to the air: power and loss are those in the board's settings, masses those of a usual hot end
//! and bed. Not covered: heat lost to flow and fan, and defects: `tests/src/thermal` has them.

use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::heat::{
    HEATERS_MAX, HeatConfiguration, HeaterConfiguration, HeaterRole, PERIOD_S,
};
use headway_firmware::configuration::sensor::Sensor;
use headway_firmware::heat::samples::FULL_SCALE;
use headway_firmware::heat::service::HeatService;
use headway_firmware::heat::{HeatCause, Outputs};
use headway_firmware::machine::Machine;

/// Where everything begins, and where heat goes, °C.
const AIR_C: f32 = 25.0;
/// Heat capacities, J/K: an E3D V6 as Marlin has it; 300 x 300 x 4 mm of aluminium.
const HOT_END_J_K: f32 = 16.7;
const BED_J_K: f32 = 900.0;
/// Conversions of each sensor in a period.
const CONVERSIONS: u64 = 32;
/// Halvings that find a conversion to more than its digits.
const HALVINGS: u32 = 24;

/// Heaters and their regulators.
#[derive(Clone, Debug)]
pub struct VirtualHeaters {
    service: HeatService,
    heaters: Vec<HeaterConfiguration>,
    celsius: [f32; HEATERS_MAX],
    duties: [f32; HEATERS_MAX],
    conversion_ticks: u64,
    ticks: u64,
}

impl VirtualHeaters {
    /// All cold; they are declared to the machine.
    pub fn new(
        machine: &mut Machine,
        configuration: &MachineConfiguration,
        heat: &HeatConfiguration,
    ) -> Self {
        let period_ticks = f64::from(configuration.servo_hz) * f64::from(PERIOD_S);
        VirtualHeaters {
            service: machine.add_heaters(configuration, heat),
            heaters: heat.heaters.to_vec(),
            celsius: [AIR_C; HEATERS_MAX],
            duties: [0.0; HEATERS_MAX],
            conversion_ticks: (period_ticks as u64 / CONVERSIONS).max(1),
            ticks: 0,
        }
    }

    /// The board waits so long for a silent host.
    pub fn wait_for_host(&mut self, silent_s: f32) {
        self.service.wait_for_host(silent_s);
    }

    /// A servo tick.
    pub fn tick(&mut self, machine: &mut Machine) {
        self.turn(|service| machine.serve_heat(service, 0));
    }

    /// The same if `serve` runs the heat loop.
    pub fn turn(&mut self, serve: impl FnOnce(&mut HeatService) -> Option<Outputs>) {
        self.ticks += 1;
        if self.ticks.is_multiple_of(self.conversion_ticks) {
            // A converter that lives has noise: half a count.
            let noise = (self.ticks / self.conversion_ticks % 2) as u16;
            for (number, heater) in self.heaters.iter().enumerate() {
                let raw = conversion(&heater.sensor, self.celsius[number]);
                self.service.sample(number, raw + noise);
            }
        }
        let Some(outputs) = serve(&mut self.service) else {
            return;
        };
        // What was put out until now has heated.
        for (number, heater) in self.heaters.iter().enumerate() {
            let capacity_j_k = match heater.role {
                HeaterRole::HotEnd => HOT_END_J_K,
                HeaterRole::Bed => BED_J_K,
            };
            let away_k = self.celsius[number] - AIR_C;
            let plant = &heater.plant;
            let watts = self.duties[number] * plant.power_w - away_k * plant.loss_w_k;
            self.celsius[number] += watts / capacity_j_k * PERIOD_S;
        }
        self.duties = outputs.duties;
    }
}

/// The conversion of a temperature: readings fall with the counts of a thermistor, and rise with those of
/// platinum.
fn conversion(sensor: &Sensor, celsius: f32) -> u16 {
    let is_colder = |share: f32| match sensor.celsius(share) {
        Ok(found) => found < celsius,
        // A thermistor's wire is open when it is cold, a platinum's when it is hot.
        Err(cause) => (cause == HeatCause::SensorOpen) == falls(sensor),
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match is_colder(middle) == falls(sensor) {
            true => high = middle,
            false => low = middle,
        }
    }
    (0.5 * (low + high) * f32::from(FULL_SCALE)).round() as u16
}

/// More counts are less heat.
fn falls(sensor: &Sensor) -> bool {
    let [few, more] = [0.3, 0.4].map(|share| sensor.celsius(share).ok());
    matches!((few, more), (Some(few), Some(more)) if few > more)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conversions_read_back_as_their_temperatures() {
        for (name, sensor) in Sensor::NAMED {
            for celsius in [25.0, 60.0, 150.0, 240.0] {
                let raw = conversion(&sensor, celsius);
                let read = sensor
                    .celsius(f32::from(raw) / f32::from(FULL_SCALE))
                    .unwrap();
                // A count is up to a kelvin where the curve is flat.
                assert!((read - celsius).abs() < 1.0, "{name}: {read} for {celsius}");
            }
        }
    }
}

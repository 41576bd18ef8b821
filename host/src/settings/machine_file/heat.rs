//! `[heaters]` of a machine file.

use crate::settings::heat::HEATER_KEYS;
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::heat::{
    EXTRUDE_MIN_C, Gains, HeatConfiguration, HeaterConfiguration, HeaterRole, Plant,
};
use headway_firmware::configuration::sensor::{Sensor, SensorCurve};
use serde::Deserialize;
use std::fmt::Write;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileHeaters {
    hot_end: FileHeater,
    bed: Option<FileHeater>,
    hot_end_2: Option<FileHeater>,
    fan_tells_turns: Option<bool>,
}

/// A named curve, or a, b and c of Steinhart and Hart.
#[derive(Deserialize)]
#[serde(untagged)]
enum FileSensor {
    Name(String),
    SteinhartHart([f32; 3]),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileHeater {
    sensor: Option<FileSensor>,
    limit_c: Option<f32>,
    power_w: Option<f32>,
    loss_w_k: Option<f32>,
    fan_loss_w_k: Option<f32>,
    melt_j_mm3_k: Option<f32>,
    measured: Option<bool>,
    proportional: Option<f32>,
    integral: Option<f32>,
    derivative: Option<f32>,
    extrude_min_c: Option<f32>,
}

impl FileHeaters {
    pub(super) fn heaters(&self) -> Result<HeatConfiguration, Refusal> {
        let given = [
            (Some(&self.hot_end), HeaterConfiguration::HOT_END),
            (self.bed.as_ref(), HeaterConfiguration::BED),
            (self.hot_end_2.as_ref(), HeaterConfiguration::HOT_END),
        ];
        if self.bed.is_none() && self.hot_end_2.is_some() {
            return Err(refusal!(
                "heaters.hot_end_2: the bed is heater 1, give it too"
            ));
        }
        if self
            .bed
            .as_ref()
            .is_some_and(|bed| bed.extrude_min_c.is_some())
        {
            return Err(refusal!(
                "heaters.bed.extrude_min_c: no melt passes the bed; give it to a hot end"
            ));
        }
        let mut configuration = HeatConfiguration {
            fan_tells_turns: self.fan_tells_turns.unwrap_or(false),
            ..HeatConfiguration::none()
        };
        for (key, (heater, default)) in HEATER_KEYS.iter().zip(given) {
            let Some(heater) = heater else { continue };
            // As many as there are keys.
            let _ = configuration.heaters.push(heater.over(key, &default)?);
        }
        Ok(configuration)
    }
}

impl FileHeater {
    fn over(
        &self,
        key: &str,
        default: &HeaterConfiguration,
    ) -> Result<HeaterConfiguration, Refusal> {
        let sensor = match &self.sensor {
            None => default.sensor,
            Some(FileSensor::SteinhartHart(coefficients)) => Sensor::steinhart_hart(*coefficients),
            Some(FileSensor::Name(name)) => named(key, name)?,
        };
        let (plant, gains) = (&default.plant, &default.gains);
        Ok(HeaterConfiguration {
            role: default.role,
            sensor,
            limit_c: self.limit_c.unwrap_or(default.limit_c),
            plant: Plant {
                power_w: self.power_w.unwrap_or(plant.power_w),
                loss_w_k: self.loss_w_k.unwrap_or(plant.loss_w_k),
                fan_loss_w_k: self.fan_loss_w_k.unwrap_or(plant.fan_loss_w_k),
                melt_j_mm3_k: self.melt_j_mm3_k.unwrap_or(plant.melt_j_mm3_k),
                measured: self.measured.unwrap_or(plant.measured),
            },
            gains: Gains {
                proportional: self.proportional.unwrap_or(gains.proportional),
                integral: self.integral.unwrap_or(gains.integral),
                derivative: self.derivative.unwrap_or(gains.derivative),
            },
            extrude_min_c: self.extrude_min_c.unwrap_or(default.extrude_min_c),
        })
    }
}

fn named(key: &str, name: &str) -> Result<Sensor, Refusal> {
    let found = Sensor::NAMED.iter().find(|(known, _)| *known == name);
    found.map(|(_, sensor)| *sensor).ok_or_else(|| {
        let known: Vec<_> = Sensor::NAMED.iter().map(|(known, _)| *known).collect();
        refusal!(
            "heaters.{key}.sensor `{name}`: {}, or a, b and c of Steinhart and Hart",
            known.join(", ")
        )
    })
}

/// Writes the group of heaters.
pub fn write_heaters(text: &mut String, heaters: &HeatConfiguration) -> std::fmt::Result {
    if heaters.fan_tells_turns {
        writeln!(text, "\n[heaters]\nfan_tells_turns = true")?;
    }
    for (key, heater) in HEATER_KEYS.iter().zip(&heaters.heaters) {
        write_heater(text, key, heater)?;
    }
    Ok(())
}

/// Writes one heater.
pub fn write_heater(
    text: &mut String,
    key: &str,
    heater: &HeaterConfiguration,
) -> std::fmt::Result {
    let (plant, gains) = (&heater.plant, &heater.gains);
    writeln!(text, "\n[heaters.{key}]")?;
    let name = Sensor::NAMED
        .iter()
        .find(|(_, known)| *known == heater.sensor);
    match (name, heater.sensor.curve) {
        (Some((name, _)), _) => writeln!(text, "sensor = \"{name}\"")?,
        (None, SensorCurve::SteinhartHart([a, b, c])) => {
            writeln!(text, "sensor = [{a:e}, {b:e}, {c:e}]")?;
        }
        // Platinum has its name.
        (None, SensorCurve::Platinum(_)) => {}
    }
    writeln!(text, "limit_c = {}", heater.limit_c)?;
    writeln!(text, "power_w = {}", plant.power_w)?;
    writeln!(text, "loss_w_k = {}", plant.loss_w_k)?;
    writeln!(text, "fan_loss_w_k = {}", plant.fan_loss_w_k)?;
    writeln!(text, "melt_j_mm3_k = {}", plant.melt_j_mm3_k)?;
    writeln!(text, "measured = {}", plant.measured)?;
    writeln!(text, "proportional = {}", gains.proportional)?;
    writeln!(text, "integral = {}", gains.integral)?;
    writeln!(text, "derivative = {}", gains.derivative)?;
    match heater.role == HeaterRole::HotEnd && heater.extrude_min_c != EXTRUDE_MIN_C {
        true => writeln!(text, "extrude_min_c = {}", heater.extrude_min_c),
        false => Ok(()),
    }
}

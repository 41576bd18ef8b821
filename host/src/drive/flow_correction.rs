//! What a sensor's program reports of a running print -> the flow override.
//!
//! In: readings, the operator's own override, the board's status, the time. Out: the override for the board in whole per
//! cent, figures, and messages, each once. The correction keeps to the range and the rate of `[measure]`, and multiplies the
//! operator's override. Above the plan's flow the board slows the head down by as much: no limit is raised. Values that
//! cannot be are no readings; without readings the flow returns to the plan's. Leaves out the program and its lines.

use crate::drive::layer_control::LayerControl;
use crate::settings::measure::{FlowController, Measure};
use headway_protocol::message::{DeviceState, FLOW_PERCENT_RANGE, Status};
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Least time between two overrides, s: the board's status is not older.
const PERIOD_S: f64 = 0.25;
/// Longest step of the clock that counts, s: the host may have slept.
const STEP_MAX_S: f64 = 1.0;
/// Share of the rate with which the flow returns to the plan's.
const RETURN_SHARE: f64 = 0.2;
/// Layers without a scan: twice the greatest delay that is tested.
const LAYERS_SILENT: usize = 10;
/// Pressures above so many times the one to keep cannot be.
const PRESSURE_RATIO_MAX: f64 = 10.0;

const SILENT: &str = "the sensor's program prints no readings: the flow returns to the plan's";
const ENDED: &str = "the sensor's program has ended: the flow returns to the plan's";
const BAD: &str = "the sensor's program prints what is no reading for measure.controller: left out";
const AT_BOUND: &str = "the flow is at a bound of measure.flow_range: look at material and sensor";

/// A line of the program.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct Reading {
    /// The program's time, for whoever reads its lines.
    pub t_s: Option<f64>,
    /// Share of the planned flow that it asks for.
    pub flow: Option<f64>,
    /// In the unit of `measure.pressure`.
    pub pressure: Option<f64>,
    /// The layer that was scanned, from 0.
    pub layer: Option<u32>,
    /// How much it is too high.
    pub height_error_mm: Option<f64>,
    /// What share of its volume is too much.
    pub volume_error: Option<f64>,
    /// Its scan, a file that is measured where lines are read.
    pub scan: Option<String>,
    /// Side of a pixel of a scan that is a picture, and the height of its grey levels.
    pub pixel_mm: Option<f64>,
    pub level_mm: Option<f64>,
    #[serde(flatten)]
    unknown: BTreeMap<String, IgnoredAny>,
}

/// What was heard and done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct CorrectionFigures {
    /// Share of the planned flow.
    pub correction: f64,
    /// Lines that were used.
    pub readings: u64,
    /// Lines, and pieces of long ones, that were not, or have unknown keys.
    pub bad_lines: u64,
    /// Time for which there were no readings.
    pub silent_s: f64,
}

/// The correction of a print.
#[derive(Clone, Debug, Default)]
pub struct FlowCorrection {
    /// The operator's own override.
    pub operator_percent: u16,
    /// The program has ended.
    pub has_ended: bool,
    /// Messages for the operator.
    pub news: Vec<&'static str>,
    /// What was done.
    pub figures: CorrectionFigures,
    measure: Measure,
    layer_mm: f64,
    layers: LayerControl,
    /// Where the correction goes.
    wanted: f64,
    /// Share of the pressure to keep.
    pressure: Option<f64>,
    told: Vec<&'static str>,
    now_s: f64,
    layer: u32,
    /// Since the last reading, while the path runs.
    quiet_s: f64,
    sent_s: f64,
}

impl FlowCorrection {
    /// Of a print with layers of `layer_mm`, from `layer` on. It continues with the board's override; what of that is beyond
    /// the range is the operator's.
    pub fn new(measure: Measure, layer_mm: f64, layer: u32, board_percent: u16) -> FlowCorrection {
        let [least, most] = measure.flow_range;
        let correction = (f64::from(board_percent) / 100.0).clamp(least, most);
        let noise = measure.height_noise_mm / layer_mm;
        FlowCorrection {
            operator_percent: (f64::from(board_percent) / correction).round() as u16,
            figures: CorrectionFigures {
                correction,
                ..Default::default()
            },
            layers: LayerControl::new(layer, correction, noise, measure.recovery_layers),
            measure,
            layer_mm,
            wanted: correction,
            // The first moment is no step.
            now_s: f64::INFINITY,
            layer,
            ..Default::default()
        }
    }

    /// The program has printed a line; `None` is no reading.
    pub fn hear(&mut self, line: Option<&Reading>) {
        let used = line.and_then(|reading| self.take(reading));
        if used.is_some() {
            self.figures.readings += 1;
            self.quiet_s = 0.0;
        }
        if used.is_none() || line.is_some_and(|reading| !reading.unknown.is_empty()) {
            self.figures.bad_lines += 1;
            self.tell(BAD);
        }
    }

    /// `None` where what the controller needs is missing, or cannot be.
    fn take(&mut self, reading: &Reading) -> Option<()> {
        match self.measure.controller {
            FlowController::Flow => {
                let percent = 100.0 * reading.flow?;
                let can_be = FLOW_PERCENT_RANGE.contains(&(percent.round() as u16));
                can_be.then(|| self.want(percent / 100.0))
            }
            FlowController::Pressure => {
                let share = reading.pressure? / self.measure.pressure?;
                let can_be = (0.0..=PRESSURE_RATIO_MAX).contains(&share);
                can_be.then(|| self.pressure = Some(share))
            }
            FlowController::Layer => {
                let height = reading.height_error_mm.map(|error| error / self.layer_mm);
                self.layers
                    .scanned(reading.layer?, height, reading.volume_error)
            }
        }
    }

    /// The override to send at a time, if there is one; `layer` is being printed.
    pub fn follow(&mut self, now_s: f64, layer: u32, status: &Status) -> Option<u16> {
        let step_s = (now_s - self.now_s).clamp(0.0, STEP_MAX_S);
        let is_next_layer = layer != self.layer;
        (self.now_s, self.layer) = (now_s, layer);
        let mut rate = self.measure.flow_change_per_s;
        let prints = status.state == DeviceState::Running;
        if prints {
            self.layers
                .printed(layer, f64::from(status.flow_percent) / 100.0);
            self.quiet_s += step_s;
        }
        let is_layers = self.measure.controller == FlowController::Layer;
        let is_silent = match is_layers {
            true => self.layers.since_scan() > LAYERS_SILENT,
            false => self.quiet_s > self.measure.silent_s,
        };
        if is_silent || self.has_ended {
            self.tell(if self.has_ended { ENDED } else { SILENT });
            self.figures.silent_s += step_s;
            self.wanted = 1.0;
            rate *= RETURN_SHARE;
        } else if is_layers && is_next_layer && self.figures.readings > 0 {
            self.want(100.0 * self.layers.next() / f64::from(self.operator_percent));
        } else if let Some(share) = self.pressure.filter(|_| prints) {
            let slope_per_s = self.measure.pressure_gain_per_s * (1.0 - share);
            self.want(self.wanted + slope_per_s * step_s);
        }
        let correction = &mut self.figures.correction;
        *correction += (self.wanted - *correction).clamp(-rate * step_s, rate * step_s);
        let exact = (*correction * f64::from(self.operator_percent)).round() as u16;
        let percent = exact.clamp(*FLOW_PERCENT_RANGE.start(), *FLOW_PERCENT_RANGE.end());
        let is_due = percent != status.flow_percent && now_s >= self.sent_s + PERIOD_S;
        is_due.then(|| {
            self.sent_s = now_s;
            percent
        })
    }

    fn want(&mut self, flow: f64) {
        let [least, most] = self.measure.flow_range;
        self.wanted = flow.clamp(least, most);
        if self.wanted != flow {
            self.tell(AT_BOUND);
        }
    }

    fn tell(&mut self, what: &'static str) {
        if !self.told.contains(&what) {
            self.told.push(what);
            self.news.push(what);
        }
    }
}

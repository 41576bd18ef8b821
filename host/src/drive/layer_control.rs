//! The flow of the next layers by scans of earlier ones, which come some layers late.
//!
//! In: the flow that each layer had; scans, by layer. Out: the flow of the next layer, unbounded. Heights in layers:
//!
//! ```text
//! a_k = a_(k-1) + s                      what the material lays beyond what it is given, and its drift by layers
//! e_k = e_(k-1) + (1 + a_k) f_k - 1      height error, the sum of what each layer has too much
//! f = (1 - e / n) / (1 + a)              takes an nth of the error away in each layer
//! ```
//! A filter (R. E. Kalman, 1960) estimates e, a and s at the last layer scanned. From there the model runs through the
//! layers printed since, with the flows that they had (the predictor of O. J. M. Smith, 1957): a delay makes the correction
//! late, not unstable, and bounds that clip the flow wind nothing up. Leaves out bounds and rates (`flow_correction`), and a
//! nozzle that presses down what is too high: then errors vanish sooner.

use nalgebra::{Matrix3, Vector3};
use std::collections::VecDeque;

/// Standard deviations before the first scan: of e, since the bed's distance is hardly known better, of a, by which spools
/// differ, and of s; and of their changes from layer to layer.
const START: [f64; 3] = [0.2, 0.05, 0.005];
const WALK: [f64; 3] = [0.0, 0.002, 0.001];
/// Least share of the flow that is taken to arrive: less is a fault, no material.
const ARRIVES_MIN: f64 = 0.1;

/// Estimates of a print so far.
#[derive(Clone, Debug, Default)]
pub struct LayerControl {
    /// Variance of a scan, layers².
    noise: f64,
    recovery_layers: f64,
    /// e, a, s at the end of the last layer scanned, and their covariance.
    state: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// The layer after it, and from that on the sum of the flow and the number of looks.
    next: u32,
    flows: VecDeque<[f64; 2]>,
}

impl LayerControl {
    /// Before `layer`, where the flow `flow` is taken to be right. Scans err by `noise_layers`.
    pub fn new(layer: u32, flow: f64, noise_layers: f64, recovery_layers: f64) -> LayerControl {
        LayerControl {
            noise: noise_layers * noise_layers,
            recovery_layers,
            state: Vector3::new(0.0, 1.0 / flow - 1.0, 0.0),
            covariance: variances(START),
            next: layer,
            flows: VecDeque::new(),
        }
    }

    /// The flow at a moment of a layer: shares of the planned one.
    pub fn printed(&mut self, layer: u32, flow: f64) {
        let Some(place) = layer.checked_sub(self.next) else {
            return;
        };
        match self.flows.get_mut(place as usize) {
            Some([sum, looks]) => (*sum, *looks) = (*sum + flow, *looks + 1.0),
            // Layers that passed between two looks had the flow of this one.
            None => self.flows.resize(place as usize + 1, [flow, 1.0]),
        }
    }

    /// Layers that were begun since the last one scanned.
    pub fn since_scan(&self) -> usize {
        self.flows.len()
    }

    /// A layer's error of height and of volume, shares of a layer and of its volume. `None` if it was not printed here, is
    /// not after the last one, or cannot be: all of it missing, or twice as much.
    pub fn scanned(&mut self, layer: u32, height: Option<f64>, volume: Option<f64>) -> Option<()> {
        let ahead = layer.checked_sub(self.next)? as usize;
        let all = [(height, f64::from(layer) + 1.0), (volume, 1.0)];
        let can_be = all.map(|(error, most)| error.is_none_or(|error| error.abs() <= most));
        if ahead >= self.flows.len() || can_be != [true; 2] || height.or(volume).is_none() {
            return None;
        }
        let mut flow = 1.0;
        for [sum, looks] in self.flows.drain(..=ahead) {
            flow = sum / looks;
            let model = Matrix3::new(1.0, flow, flow, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0);
            self.state = after(self.state, flow);
            self.covariance = model * self.covariance * model.transpose() + variances(WALK);
        }
        self.next = layer + 1;
        // Height is e, volume (1 + a) f - 1.
        for (measured, of, known) in [
            (height, Vector3::x(), 0.0),
            (volume, Vector3::y() * flow, flow - 1.0),
        ] {
            let Some(error) = measured else { continue };
            let seen = self.covariance * of;
            let share = seen / (of.dot(&seen) + self.noise);
            self.state += share * (error - known - of.dot(&self.state));
            self.covariance -= share * seen.transpose();
        }
        Some(())
    }

    /// The flow for the layer after the last one begun.
    pub fn next(&self) -> f64 {
        let flows = self.flows.iter().map(|[sum, looks]| sum / looks);
        let at = flows.fold(self.state, after);
        (1.0 - at.x / self.recovery_layers) / (1.0 + at.y + at.z).max(ARRIVES_MIN)
    }
}

fn variances(deviations: [f64; 3]) -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::from(
        deviations.map(|deviation| deviation * deviation),
    ))
}

/// The state after a layer of this flow.
fn after(before: Vector3<f64>, flow: f64) -> Vector3<f64> {
    let gain = before.y + before.z;
    Vector3::new(before.x + (1.0 + gain) * flow - 1.0, gain, before.z)
}

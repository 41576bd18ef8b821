//! Steps of the head -> passes: runs without an interruption of flow, and the way between them.
//!
//! In: [`Steps`]. Out: [`GcodePass`]es with layers (mm, mm³, mm/s). A pass ends where the head moves
//! without extruding, or the filament is pulled. Where no line of the file extrudes, everything but G0 that
//! moves in the plane prints. What is pushed into the air before the first pass is left out and told.

use super::comments::Slicer;
use super::interpreter::{Firmware, HeatStep, Step, Steps};
use super::{GcodePass, HeatPlace, Leg, Place, PlacedOrder, Push};
use std::f64::consts::PI;

/// Steps below this move nothing, mm.
const STANDS_MM: f64 = 1e-4;
/// The same of headings and tilts, degrees.
const STANDS_DEG: f64 = 1e-4;
/// A pass on a higher layer begins above all before it by more than this, mm.
const LAYER_MM: f64 = 1e-3;
/// Most that a prime adds to what was pulled, mm³: extra length after a travel. More is a purge.
const EXTRA_MM3: f64 = 2.0;
/// Heights of a layer that are believed, mm.
const HEIGHTS_MM: [f64; 2] = [0.01, 10.0];

/// What the passes leave out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LeftOut {
    /// Pushed on the spot beyond what was pulled, mm³.
    pub purged_mm3: f64,
    /// First line of that.
    pub line: usize,
}

struct Builder {
    passes: Vec<GcodePass>,
    heat: Vec<PlacedOrder>,
    open: Option<GcodePass>,
    at: Place,
    travel: Vec<Place>,
    /// Pulled since the last pass, mm³ and rate; pushed since.
    pulled: Option<Push>,
    pushed: Option<Push>,
    /// Pulled and not yet pushed, mm³.
    outstanding_mm3: f64,
    left_out: LeftOut,
    /// Most that a prime adds.
    extra_mm3: f64,
    layer: u32,
    top_mm: f64,
}

/// Puts steps together to passes, with the orders of heaters and fans; `filament_mm` is the filament's
/// diameter.
pub fn passes(steps: &Steps, filament_mm: f64) -> (Vec<GcodePass>, Vec<PlacedOrder>, LeftOut) {
    let area_mm2 = 0.25 * PI * filament_mm * filament_mm;
    let layers_told = steps.hints.iter().any(|hint| hint.layers > 0);
    let mut builder = Builder {
        passes: Vec::new(),
        heat: Vec::new(),
        open: None,
        at: Place::default(),
        travel: Vec::new(),
        pulled: None,
        pushed: None,
        outstanding_mm3: 0.0,
        left_out: LeftOut::default(),
        extra_mm3: match steps.comments.slicer {
            // Ours purge nothing.
            Slicer::Headway => f64::INFINITY,
            _ => EXTRA_MM3,
        },
        layer: 0,
        top_mm: f64::NEG_INFINITY,
    };
    let mut heat = steps.heat.iter().peekable();
    for (number, step) in steps.steps.iter().enumerate() {
        while let Some(order) = heat.next_if(|order| order.step <= number) {
            builder.order(order);
        }
        let scale = if step.volumetric { 1.0 } else { area_mm2 };
        let hint = steps.hints[step.hint];
        let told_layer = layers_told.then(|| hint.layers.saturating_sub(1));
        let leg = Leg {
            line: step.line,
            speed_mm_s: step.speed_mm_s,
            width_mm: hint.width_mm,
            height_mm: hint.height_mm,
            volume_mm3: steps.extrudes.then_some(step.extruded * scale),
        };
        builder.step(step, leg, scale, told_layer);
    }
    heat.for_each(|order| builder.order(order));
    builder.close();
    let mut passes = builder.passes;
    if !steps.extrudes {
        for pass in &mut passes {
            pass.prime = Some(Push::default());
            pass.retract = Some(Push::default());
        }
    }
    add_heights(&mut passes);
    (passes, builder.heat, builder.left_out)
}

impl Builder {
    fn step(&mut self, step: &Step, leg: Leg, scale: f64, told_layer: Option<u32>) {
        let to = Place {
            tip_mm: [step.to[0], step.to[1], step.to[2]],
            turn_deg: [step.to[3], step.to[4], step.to[5]],
        };
        let moved_mm = to.distance_mm(&self.at);
        let turned = (0..3).any(|i| (to.turn_deg[i] - self.at.turn_deg[i]).abs() > STANDS_DEG);
        let stands = moved_mm < STANDS_MM && !turned;
        let volume_mm3 = step.extruded * scale;
        let rate_mm3_s = step.speed_mm_s * scale;
        match step.firmware {
            Firmware::Retract(mm) => self.pull(mm.map(|mm| mm * scale), None),
            Firmware::Prime(mm) => self.push(mm.map(|mm| mm * scale), None, step.line),
            Firmware::None if stands && volume_mm3 < 0.0 => {
                self.pull(Some(-volume_mm3), Some(rate_mm3_s))
            }
            Firmware::None if stands && volume_mm3 > 0.0 => {
                self.push(Some(volume_mm3), Some(rate_mm3_s), step.line);
            }
            Firmware::None if stands => {}
            Firmware::None => {
                let in_plane =
                    (to.tip_mm[0] - self.at.tip_mm[0]).hypot(to.tip_mm[1] - self.at.tip_mm[1]);
                let prints = match leg.volume_mm3 {
                    Some(volume_mm3) => volume_mm3 > 0.0,
                    None => !step.rapid && (in_plane > STANDS_MM || turned),
                };
                if prints {
                    self.print(to, leg, told_layer);
                } else {
                    if volume_mm3 < 0.0 {
                        self.pull(Some(-volume_mm3), None);
                    }
                    self.close();
                    self.travel.push(to);
                }
                self.at = to;
            }
        }
    }

    /// An order of heaters and fans: it stands where the head is now.
    fn order(&mut self, order: &HeatStep) {
        let pass = self.passes.len();
        let place = match &self.open {
            Some(open) => HeatPlace::Point(pass, open.points.len() - 1),
            None if self.travel.is_empty() => HeatPlace::Leaving(pass),
            None => HeatPlace::Start(pass),
        };
        self.heat.push(PlacedOrder {
            line: order.line,
            place,
            order: order.order,
        });
    }

    fn pull(&mut self, mm3: Option<f64>, rate_mm3_s: Option<f64>) {
        self.close();
        self.outstanding_mm3 += mm3.unwrap_or(0.0);
        let before = self.pulled.take().unwrap_or(Push {
            mm3: Some(0.0),
            rate_mm3_s,
        });
        self.pulled = Some(before.and(mm3));
        if let Some(pass) = self.passes.last_mut() {
            pass.retract = self.pulled;
        }
    }

    fn push(&mut self, mm3: Option<f64>, rate_mm3_s: Option<f64>, line: usize) {
        self.close();
        let before = self.pushed.take().unwrap_or(Push {
            mm3: Some(0.0),
            rate_mm3_s,
        });
        let Some(mm3) = mm3 else {
            self.pushed = Some(before.and(None));
            return;
        };
        let owed_mm3 = mm3.min(self.outstanding_mm3);
        self.outstanding_mm3 -= owed_mm3;
        let extra_mm3 = mm3 - owed_mm3;
        if extra_mm3 > self.extra_mm3 {
            if extra_mm3 > 1e-9 && self.left_out.purged_mm3 == 0.0 {
                self.left_out.line = line;
            }
            self.left_out.purged_mm3 += extra_mm3;
            self.pushed =
                (owed_mm3 > 0.0 || before.mm3 != Some(0.0)).then(|| before.and(Some(owed_mm3)));
        } else {
            self.pushed = Some(before.and(Some(mm3)));
        }
    }

    fn print(&mut self, to: Place, leg: Leg, told_layer: Option<u32>) {
        if self.open.is_none() {
            let z_mm = to.tip_mm[2].max(self.at.tip_mm[2]);
            self.layer = match told_layer {
                Some(layer) => layer.max(self.layer),
                None if self.top_mm == f64::NEG_INFINITY => 0,
                None => self.layer + u32::from(z_mm > self.top_mm + LAYER_MM),
            };
            let mut travel = std::mem::take(&mut self.travel);
            // The last travel ends where the pass begins.
            if travel
                .last()
                .is_some_and(|last| last.distance_mm(&self.at) < STANDS_MM)
            {
                travel.pop();
            }
            self.open = Some(GcodePass {
                layer: self.layer,
                travel,
                points: vec![self.at],
                legs: Vec::new(),
                prime: self.pushed.take(),
                retract: None,
            });
            self.pulled = None;
        }
        self.top_mm = self.top_mm.max(to.tip_mm[2]);
        if let Some(pass) = &mut self.open {
            pass.points.push(to);
            pass.legs.push(leg);
        }
    }

    fn close(&mut self) {
        self.passes.extend(self.open.take());
    }
}

/// Heights that no comment tells: from the top of the layer below.
fn add_heights(passes: &mut [GcodePass]) {
    let top_mm = |pass: &GcodePass| {
        let heights = pass.points.iter().map(|point| point.tip_mm[2]);
        heights.fold(f64::NEG_INFINITY, f64::max)
    };
    let (mut below_mm, mut begin) = (0.0, 0);
    while begin < passes.len() {
        let layer = passes[begin].layer;
        let count = passes[begin..]
            .iter()
            .take_while(|pass| pass.layer == layer)
            .count();
        let of_layer = &mut passes[begin..begin + count];
        let layer_top_mm = of_layer
            .iter()
            .map(top_mm)
            .fold(f64::NEG_INFINITY, f64::max);
        let height_mm = layer_top_mm - below_mm;
        if (HEIGHTS_MM[0]..=HEIGHTS_MM[1]).contains(&height_mm) {
            for leg in of_layer.iter_mut().flat_map(|pass| &mut pass.legs) {
                leg.height_mm = leg.height_mm.or(Some(height_mm));
            }
        }
        below_mm = layer_top_mm;
        begin += count;
    }
}

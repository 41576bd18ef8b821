//! Steps of the head -> passes: runs without an interruption of flow, and the way between them.
//!
//! In: [`Steps`]. Out: [`GcodePass`]es with layers (mm, mm³, mm/s). A pass ends where the head moves
//! without extruding, or the filament is pulled. Where no line of the file extrudes, everything but G0 that
//! moves in the plane prints. What is pushed into the air before the first pass is left out and told.

mod gap;
mod heights;
use super::interpreter::{Firmware, HeatStep, Step, Steps};
use super::{
    BeadKind, GcodePass, HeatPlace, Leg, PUSH_MAX_MM3, PUSH_MIN_MM3_S, Place, PlacedOrder, Push,
    SLOW_S_MAX,
};
use crate::text::refusal::{Refusal, refusal};
use crate::text::short_number::Short;
use gap::Gap;
use heights::add_heights;
use std::f64::consts::PI;

/// Steps below this move nothing, mm.
pub const STILL_MM: f64 = 1e-4;
/// The same of headings and tilts, degrees.
pub const STILL_DEG: f64 = 1e-4;
/// A pass on a higher layer begins above all before it by more than this, mm.
const LAYER_MM: f64 = 1e-3;
/// Most that a prime adds to what was pulled, mm³: extra length after a travel. More is a purge.
const EXTRA_MM3: f64 = 2.0;
/// Longest push on the spot, s: the board's checks go through it by servo ticks.
const PUSH_S_MAX: f64 = 600.0;

/// What the passes leave out, and what they make one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LeftOut {
    /// Pushed on the spot beyond what was pulled, mm³.
    pub purged_mm3: f64,
    /// First line of that.
    pub line: usize,
    /// Pairs of retract and prime that follow others without a bead between them.
    pub pairs: usize,
    /// First line of them.
    pub pairs_line: usize,
    /// Layers that begin within passes.
    pub layers: u32,
    /// First line of the moves behind the last bead.
    pub end_line: Option<usize>,
}

impl LeftOut {
    /// What the user should know.
    pub fn notes(&self) -> impl Iterator<Item = String> {
        let purged = (self.purged_mm3 > 1e-6).then(|| {
            format!(
                "line {}: {:.2} mm³ are pushed out on the spot beyond what was pulled back: not done, prime \
                 the nozzle before the job",
                self.line, self.purged_mm3
            )
        });
        let pairs = (self.pairs > 0).then(|| {
            format!(
                "line {}: retracts and primes that follow each other without a bead between them are made one \
                 ({} more)",
                self.pairs_line, self.pairs
            )
        });
        let end = self.end_line.map(|line| {
            format!(
                "line {line}: the moves behind the last bead are not done; an export ends with its own (--end)"
            )
        });
        purged.into_iter().chain(pairs).chain(end)
    }
}

struct Builder {
    passes: Vec<GcodePass>,
    open: Option<GcodePass>,
    at: Place,
    travel: Vec<Place>,
    travel_legs: Vec<Leg>,
    /// Pulled and pushed since the last pass.
    gap: Gap,
    /// Pulled and not yet pushed, mm³.
    outstanding_mm3: f64,
    left_out: LeftOut,
    layer: u32,
    /// Highest of this object, and its first layer.
    top_mm: f64,
    first_mm: f64,
    told_layers: u32,
}

/// Passes, orders of heaters and fans, lines that no job does, what is left out.
type Passes = (
    Vec<GcodePass>,
    Vec<PlacedOrder>,
    Vec<PlacedOrder<usize>>,
    LeftOut,
);

/// Puts steps together to passes, with the orders of heaters and fans; `filament_mm` is the filament's
/// diameter.
///
/// # Errors
/// [`Refusal`] for pushes that no extruder makes.
pub fn passes(steps: &Steps, filament_mm: f64) -> Result<Passes, Refusal> {
    let area_mm2 = 0.25 * PI * filament_mm * filament_mm;
    let layers_told = steps.hints.iter().any(|hint| hint.layers > 0);
    let mut builder = Builder {
        passes: Vec::new(),
        open: None,
        at: place_of(&steps.start),
        travel: Vec::new(),
        travel_legs: Vec::new(),
        gap: Gap::default(),
        outstanding_mm3: 0.0,
        left_out: LeftOut::default(),
        layer: 0,
        top_mm: f64::NEG_INFINITY,
        first_mm: f64::INFINITY,
        told_layers: 0,
    };
    let (mut heat, mut lines) = (Vec::new(), Vec::new());
    let mut orders = steps.heat.iter().peekable();
    let mut left = steps.left.iter().peekable();
    for (number, step) in steps.steps.iter().enumerate() {
        while let Some(order) = orders.next_if(|order| order.step <= number) {
            heat.push(builder.placed(order));
        }
        while let Some(line) = left.next_if(|line| line.step <= number) {
            lines.push(builder.placed(line));
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
            is_inside: hint.is_inside,
            kind: match hint.kind {
                // The settings that say so stand at the file's end.
                BeadKind::OuterWall if steps.comments.is_fuzzy => BeadKind::FuzzyWall,
                kind => kind,
            },
        };
        builder.step(step, leg, area_mm2, told_layer)?;
    }
    heat.extend(orders.map(|order| builder.placed(order)));
    lines.extend(left.map(|line| builder.placed(line)));
    builder.close();
    let mut passes = builder.passes;
    if !steps.extrudes {
        for pass in &mut passes {
            pass.prime = Some(Push::default());
            pass.retract = Some(Push::default());
        }
    }
    let turns = add_heights(&mut passes);
    let mut left_out = builder.left_out;
    left_out.end_line = builder.travel_legs.first().map(|leg| leg.line);
    let layers = passes.last().map_or(0, |pass| pass.layer + 1);
    left_out.layers = match layers_told {
        true => builder.told_layers.saturating_sub(layers),
        false => turns,
    };
    Ok((passes, heat, lines, left_out))
}

impl Builder {
    fn step(
        &mut self,
        step: &Step,
        leg: Leg,
        area_mm2: f64,
        told_layer: Option<u32>,
    ) -> Result<(), Refusal> {
        let to = place_of(&step.to);
        let moved_mm = to.distance_mm(&self.at);
        let turned = (0..3).any(|i| (to.turn_deg[i] - self.at.turn_deg[i]).abs() > STILL_DEG);
        let stands = moved_mm < STILL_MM && !turned;
        let scale = if step.volumetric { 1.0 } else { area_mm2 };
        let volume_mm3 = step.extruded * scale;
        // A feed is of the filament also where E is in mm³.
        let rate_mm3_s = step.speed_mm_s * area_mm2;
        match step.firmware {
            Firmware::Retract(mm) => self.pull(mm.map(|mm| mm * scale), None, step.line)?,
            Firmware::Prime(mm) => self.push(mm.map(|mm| mm * scale), None, step.line)?,
            Firmware::None if stands && volume_mm3 != 0.0 => {
                let rate_mm3_s = Some(rate_mm3_s);
                match volume_mm3 < 0.0 {
                    true => self.pull(Some(-volume_mm3), rate_mm3_s, step.line)?,
                    false => self.push(Some(volume_mm3), rate_mm3_s, step.line)?,
                }
            }
            Firmware::None if stands => {}
            Firmware::None => {
                let in_plane =
                    (to.tip_mm[0] - self.at.tip_mm[0]).hypot(to.tip_mm[1] - self.at.tip_mm[1]);
                let prints = match leg.volume_mm3 {
                    Some(volume_mm3) => volume_mm3 > 0.0,
                    None => !step.rapid && (in_plane > STILL_MM || turned),
                };
                if prints {
                    self.print(to, leg, told_layer);
                } else {
                    if volume_mm3 < 0.0 {
                        self.pull(Some(-volume_mm3), None, step.line)?;
                    }
                    self.close();
                    self.travel.push(to);
                    self.travel_legs.push(leg);
                }
                self.at = to;
            }
        }
        Ok(())
    }

    /// An order stands where the head is now.
    fn placed<T: Copy>(&self, order: &HeatStep<T>) -> PlacedOrder<T> {
        let pass = self.passes.len();
        let place = match &self.open {
            Some(open) => HeatPlace::Point(pass, open.points.len() - 1),
            None if self.travel.is_empty() => HeatPlace::Leaving(pass),
            None => HeatPlace::Start(pass),
        };
        PlacedOrder {
            line: order.line,
            place,
            order: order.order,
        }
    }

    fn pull(
        &mut self,
        mm3: Option<f64>,
        rate_mm3_s: Option<f64>,
        line: usize,
    ) -> Result<(), Refusal> {
        self.close();
        check_push(mm3, rate_mm3_s, line)?;
        self.outstanding_mm3 += mm3.unwrap_or(0.0);
        if self.gap.pull(mm3, rate_mm3_s) {
            if self.left_out.pairs == 0 {
                self.left_out.pairs_line = line;
            }
            self.left_out.pairs += 1;
        }
        let retract = self.gap.retract();
        check_push(retract.and_then(|push| push.mm3), None, line)?;
        if let Some(pass) = self.passes.last_mut() {
            pass.retract = retract;
        }
        Ok(())
    }

    fn push(
        &mut self,
        mm3: Option<f64>,
        rate_mm3_s: Option<f64>,
        line: usize,
    ) -> Result<(), Refusal> {
        self.close();
        let Some(mm3) = mm3 else {
            self.gap.push(None, None);
            return Ok(());
        };
        let owed_mm3 = mm3.min(self.outstanding_mm3);
        let extra_mm3 = mm3 - owed_mm3;
        self.outstanding_mm3 -= owed_mm3;
        let made_mm3 = match extra_mm3 > EXTRA_MM3 {
            true => owed_mm3,
            false => mm3,
        };
        if made_mm3 < mm3 {
            if extra_mm3 > 1e-9 && self.left_out.purged_mm3 == 0.0 {
                self.left_out.line = line;
            }
            self.left_out.purged_mm3 += extra_mm3;
        }
        if made_mm3 > 0.0 {
            check_push(Some(made_mm3), rate_mm3_s, line)?;
            self.gap.push(Some(made_mm3), rate_mm3_s);
        }
        Ok(())
    }

    fn print(&mut self, to: Place, leg: Leg, told_layer: Option<u32>) {
        if self.open.is_none() {
            let z_mm = to.tip_mm[2].max(self.at.tip_mm[2]);
            // The next of objects that are printed one at a time, or the first layer below a line that primes.
            let is_next =
                z_mm <= self.first_mm + LAYER_MM && self.top_mm > self.first_mm + LAYER_MM;
            let is_below = z_mm < self.first_mm - LAYER_MM && self.first_mm.is_finite();
            let begins_anew = told_layer.is_none() && (is_next || is_below);
            self.layer = match told_layer {
                Some(layer) => layer.max(self.layer),
                None if self.top_mm == f64::NEG_INFINITY => 0,
                None => self.layer + u32::from(begins_anew || z_mm > self.top_mm + LAYER_MM),
            };
            if begins_anew || self.top_mm == f64::NEG_INFINITY {
                (self.top_mm, self.first_mm) = (z_mm, z_mm);
            }
            let mut travel = std::mem::take(&mut self.travel);
            // The last travel ends where the pass begins.
            if travel
                .last()
                .is_some_and(|last| last.distance_mm(&self.at) < STILL_MM)
            {
                travel.pop();
            }
            self.open = Some(GcodePass {
                layer: self.layer,
                travel,
                travel_legs: std::mem::take(&mut self.travel_legs),
                points: vec![self.at],
                legs: Vec::new(),
                prime: self.gap.prime(),
                retract: None,
            });
            self.gap = Gap::default();
        }
        self.told_layers = self
            .told_layers
            .max(told_layer.map_or(0, |layer| layer + 1));
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

fn place_of(&[x, y, z, a, b, c]: &[f64; 6]) -> Place {
    Place {
        tip_mm: [x, y, z],
        turn_deg: [a, b, c],
    }
}

/// Fails for a push or pull that no extruder makes, or none within ten minutes.
fn check_push(mm3: Option<f64>, rate_mm3_s: Option<f64>, line: usize) -> Result<(), Refusal> {
    let Some(volume_mm3) = mm3 else {
        return Ok(());
    };
    if volume_mm3 > PUSH_MAX_MM3 {
        return Err(refusal!(
            "line {line}: {} mm³ are to be pushed or pulled on the spot, more than {}: check E \
             (M82, M83, G92) and the filament's diameter",
            Short(volume_mm3),
            Short(PUSH_MAX_MM3)
        ));
    }
    let Some(rate_mm3_s) = rate_mm3_s else {
        return Ok(());
    };
    let seconds = volume_mm3 / rate_mm3_s;
    let is_slow = rate_mm3_s < PUSH_MIN_MM3_S && seconds > SLOW_S_MAX;
    match is_slow || seconds > PUSH_S_MAX {
        true => Err(refusal!(
            "line {line}: the extruder alone is to move {} mm³ at {} mm³/s, which takes {} s; \
             nozzles ooze faster than 0.01 mm³/s: check F, which is mm/min, and the modes (G93, \
             G94)",
            Short(volume_mm3),
            Short(rate_mm3_s),
            Short(volume_mm3 / rate_mm3_s)
        )),
        false => Ok(()),
    }
}

//! Findings on wide beads: layers with cold joints, curves with uneven deposition.
//!
//! In: the time of each layer (s), the worst curve of the finished stream, the settings. Out: figures, and an
//! [`Objection`] for each exceeded limit. Not covered: refusal of the job; the command handles that.

use super::objections::{Objection, ObjectionKind};
use crate::job::transform::PartTransform;
use crate::job::{Mark, MotionState, SegmentStream};
use crate::pipeline::layer_uses::LayerUse;
use crate::plan::judge::curve_ratio::{CurveRatio, RATIO_MAX};
use crate::report::Place;
use crate::report::figures::Figures;
use crate::settings::Settings;
use headway_protocol::segment::FlowAction;
use headway_protocol::units::CHANNEL_VOLUME;
use std::collections::BTreeMap;

/// The longest layers: how many are too long, the longest and its time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct LateLayers {
    layers: usize,
    late: u64,
    longest: u32,
    longest_s: f64,
}

impl LateLayers {
    /// Of the time of each layer.
    pub(crate) fn of(uses: &[LayerUse], settings: &Settings) -> LateLayers {
        LateLayers::of_seconds(uses.iter().map(|of| (of.layer, of.seconds)), settings)
    }

    /// Of a stream by itself.
    pub(crate) fn of_marks(stream: &SegmentStream, settings: &Settings) -> LateLayers {
        let servo_hz = f64::from(settings.machine.servo_hz);
        let seconds = |mark: &Mark| (mark.end_tick - mark.start_tick) as f64 / servo_hz;
        let marks = stream.marks.iter().map(|mark| (mark.layer, seconds(mark)));
        LateLayers::of_seconds(marks, settings)
    }

    fn of_seconds(all: impl Iterator<Item = (u32, f64)>, settings: &Settings) -> LateLayers {
        let mut seconds: BTreeMap<u32, f64> = BTreeMap::new();
        for (layer, layer_s) in all {
            *seconds.entry(layer).or_default() += layer_s;
        }
        let most_s = settings.wide_beads.layer_time_max_s;
        let mut found = LateLayers {
            layers: seconds.len(),
            ..LateLayers::default()
        };
        for (layer, layer_s) in seconds {
            found.late += u64::from(most_s > 0.0 && layer_s > most_s);
            if layer_s > found.longest_s {
                (found.longest, found.longest_s) = (layer, layer_s);
            }
        }
        found
    }
}

/// What finished streams show of wide beads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Laid {
    ratio: CurveRatio,
    /// Volume of primes less that of retracts.
    primed_mm3: f64,
    /// Passes, and those that went on into the next one without a rest.
    passes: u64,
    went_on: u64,
}

impl Laid {
    /// Of nothing.
    pub(crate) const NOTHING: Laid = Laid {
        ratio: CurveRatio::STRAIGHT,
        primed_mm3: 0.0,
        passes: 0,
        went_on: 0,
    };

    /// For this stream after the earlier ones.
    pub(crate) fn with(self, stream: &SegmentStream, settings: &Settings) -> Laid {
        let primed_units: i64 = (stream.events.iter())
            .map(|event| match event.action {
                FlowAction::Prime => i64::from(event.volume_units),
                FlowAction::Retract => -i64::from(event.volume_units),
            })
            .sum();
        let is_print = |mark: &&Mark| mark.state == MotionState::Print;
        let begins = |pair: &&[Mark]| pair[0].pass != pair[1].pass && pair[1].pass.is_some();
        let pairs = || stream.marks.windows(2).filter(begins);
        let passes = pairs().filter(|pair| is_print(&&pair[1])).count();
        let went_on = pairs().filter(|pair| pair.iter().all(|mark| is_print(&mark)));
        Laid {
            passes: self.passes + passes as u64,
            went_on: self.went_on + went_on.count() as u64,
            ratio: self.ratio.with(CurveRatio::of(stream, settings)),
            primed_mm3: self.primed_mm3
                + primed_units as f64 / stream.units.per_natural(CHANNEL_VOLUME),
        }
    }

    /// The figures, `volume_mm3` being that of the passes: a pump that runs on deposits the volume of its
    /// starts.
    pub(crate) fn figures(
        &self,
        late: &LateLayers,
        volume_mm3: f64,
        transform: &PartTransform,
        settings: &Settings,
    ) -> Figures {
        let (wide, ratio) = (&settings.wide_beads, &self.ratio);
        let runs_on = wide.pump_start_mm > 0.0 || wide.pump_stop_mm > 0.0;
        let at_mm = || transform.to_input(ratio.at_mm);
        Figures {
            flow_interruptions: wide.continuous_z.then_some(self.interruptions()),
            volume_mm3: runs_on.then_some(volume_mm3 + self.primed_mm3),
            layer_time_longest_s: (late.layers > 1).then_some(late.longest_s),
            late_layers: (wide.layer_time_max_s > 0.0).then_some(late.late),
            outer_inner_ratio_max: Some(ratio.ratio_max),
            outer_inner_ratio_at_mm: (ratio.ratio_max > 1.0).then(at_mm),
            outer_inner_over_mm: (wide.outer_inner_ratio_max > 0.0).then_some(ratio.over_mm),
            ..Figures::default()
        }
    }

    /// How often the flow rests between passes.
    fn interruptions(&self) -> u64 {
        self.passes.saturating_sub(1 + self.went_on)
    }

    /// Where a vase was asked for and most layers do not go on into the next one.
    fn rests(&self, late: &LateLayers, settings: &Settings) -> Option<Objection> {
        let is_kept = self.went_on > 0 && 2 * self.went_on + 1 >= late.layers as u64;
        (settings.wide_beads.continuous_z && !is_kept).then(|| Objection {
            kind: ObjectionKind::Options,
            text: format!(
                "NO VASE: --vase is kept by {} of {} layers; the flow rests after the first one, at layers of several \
                 passes or of an open one, and where the nozzle has to turn back between its stops",
                self.went_on, late.layers
            ),
        })
    }

    /// Where a vase was asked for, and some layers rest.
    pub(crate) fn rests_note(&self, settings: &Settings) -> Option<String> {
        (settings.wide_beads.continuous_z && self.interruptions() > 0).then(|| {
            format!(
                "--vase: {} of {} passes go on into the next one",
                self.went_on, self.passes
            )
        })
    }

    /// Exceeded limits of wide beads.
    pub(crate) fn objections(
        &self,
        late: &LateLayers,
        transform: &PartTransform,
        settings: &Settings,
    ) -> Vec<Objection> {
        let wide = &settings.wide_beads;
        let mut found: Vec<Objection> = self.rests(late, settings).into_iter().collect();
        if late.late > 0 {
            found.push(Objection {
                kind: ObjectionKind::LayerTime,
                text: format!(
                    "COLD JOINTS: {} of {} layers take longer than layer_time_max_s = {} s, layer {} the longest \
                     ({:.1} s): print faster, fewer parts at a time, or with a wider bead",
                    late.late, late.layers, wide.layer_time_max_s, late.longest, late.longest_s
                ),
            });
        }
        if self.ratio.over_mm > 0.0 {
            let [x, y, z] = transform.to_input(self.ratio.at_mm);
            found.push(Objection {
                kind: ObjectionKind::Curves,
                text: format!(
                    "TIGHT CURVES: {:.0} mm of the path lay more on the outside than outer_inner_ratio_max = {} \
                     times the inside; at worst {} near ({x:.1}, {y:.1}, {z:.1}): round the outline there, or \
                     print with a narrower nozzle",
                    self.ratio.over_mm,
                    wide.outer_inner_ratio_max,
                    self.worst()
                ),
            });
        }
        found
    }

    /// Where the worst curve is, if one is tighter than allowed.
    pub(crate) fn place(&self, transform: &PartTransform) -> Option<Place> {
        let [x_mm, y_mm, _] = transform.to_input(self.ratio.at_mm);
        (self.ratio.over_mm > 0.0).then(|| Place {
            what: format!("tight curve, {}", self.worst()),
            x_mm,
            y_mm,
            layer: Some(self.ratio.layer),
        })
    }

    fn worst(&self) -> String {
        match self.ratio.ratio_max < RATIO_MAX {
            true => format!("{:.2} times", self.ratio.ratio_max),
            false => "with the inside at a standstill".to_string(),
        }
    }
}

//! The figures of a job: `plan --json`, `simulate --json` and `report.json`.
//!
//! Other programs read these keys; they change only with a version. A figure without a meaning is
//! absent (a plan that was not simulated has no `tip_error_um_max`).

pub use super::corner_figures::CornerFigures;
pub use super::curved_layer_figures::CurvedLayerFigures;
use super::figure_rows::Row;
pub use super::layer_figures::{Inside, KindFigures, LayerFigures, LayerPlace, UseFigures};
pub use super::verdict_figures::{AgainstFigures, UnevenFigures, VerdictFigures};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A place of about a millimetre of a pass, input coordinates.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SlowPlaceFigures {
    /// Where it begins.
    pub x_mm: f64,
    /// Where it begins.
    pub y_mm: f64,
    /// Its duration.
    pub seconds: f64,
    /// The limit with the largest share of that.
    pub limit: String,
    /// Layer from 0; unknown in jobs of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layer: Option<u32>,
}

/// All figures; the keys are the field names. Shares are of the layers' area, over all layers;
/// depths and rates the worst of any; lengths, times and counts totals.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Figures {
    /// The figures in words; for displayed figures, never for those in a job file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<VerdictFigures>,
    /// What keeps the job from being good, one line each; it was allowed where there is a job all the same.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objections: Option<Vec<String>>,
    /// Area of the outline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub area_mm2: Option<f64>,
    /// Layers, where there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layers: Option<u64>,
    /// Layers that follow the top of a part, where there are some.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub curved_layers: Option<CurvedLayerFigures>,
    /// Layer groups, by their first layer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layer_kinds: Option<Vec<KindFigures>>,
    /// `covered_pct` of the layer that has the least.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub covered_pct_min: Option<f64>,
    /// `overlap_pct` of the layer that has the most.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overlap_pct_max: Option<f64>,
    /// Share of the outline that some aperture inside it can cover.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reachable_pct: Option<f64>,
    /// Share of the outline that is covered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub covered_pct: Option<f64>,
    /// Share of the reachable part that is covered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub covered_of_reachable_pct: Option<f64>,
    /// Largest depth of a placed aperture outside the outline, on the finished segments.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outside_depth_mm: Option<f64>,
    /// Share of the outline that is swept more than once.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overlap_pct: Option<f64>,
    /// Area of the outline lost to keep-outs; the shares are of the rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kept_out_mm2: Option<f64>,
    /// Ground inside the walls that infill lines are to cover.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub infill_mm2: Option<f64>,
    /// Covered share of that: the resulting density.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub infill_covered_pct: Option<f64>,
    /// Area of all layers that is open on purpose between the lines of a sparse infill.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sparse_mm2: Option<f64>,
    /// Covered share of that.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sparse_covered_pct: Option<f64>,
    /// Covered share of all other area of the outline, if some is sparse.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solid_covered_pct: Option<f64>,
    /// Boundary length that no aperture inside can touch.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unreachable_mm: Option<f64>,
    /// Largest connected uncovered area of the layers that are to be filled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub open_largest_mm2: Option<f64>,
    /// Largest number of layers on which the same tenth of a millimetre is uncovered, away from the
    /// outline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub open_ground_stacked_max_layers: Option<u64>,
    /// Such area that is uncovered on half of the layers or more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub open_ground_stacked_mm2: Option<f64>,
    /// Area that extends farther than half a bead beyond the layer below, all layers of a part.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overhang_mm2: Option<f64>,
    /// By layer, the most first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overhang_places: Option<Vec<LayerPlace>>,
    /// Regions of a part that are not printed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub left_out_places: Option<Vec<LayerPlace>>,
    /// The places of that: centre x, y and length of each, at most a thousand.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unreachable_places_mm: Option<Vec<[f64; 3]>>,
    /// Continuous runs with flow.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub passes: Option<u64>,
    /// Retract, travel and prime between two passes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flow_interruptions: Option<u64>,
    /// Travels between passes that leave the outline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outline_crossings: Option<u64>,
    /// Length of the tip's path on which nozzle or head collide with the table or the print.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub touched_mm: Option<f64>,
    /// Largest dip of the nozzle's flat end into the print.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tip_dip_max_mm: Option<f64>,
    /// Corners of a run of waypoints, where they are to be rounded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rounded_corners: Option<CornerFigures>,
    /// Tip path with flow.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub print_mm: Option<f64>,
    /// Printing path around the part: skirt and brim.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skirt_mm: Option<f64>,
    /// Tip path without flow.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub travel_mm: Option<f64>,
    /// Duration of the job.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub print_s: Option<f64>,
    /// The same part with another nozzle, if requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub against: Option<AgainstFigures>,
    /// The same without limits of the joints' jerk.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_bound_s: Option<f64>,
    /// The slicer's own estimate of the printing time, of G-code.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slicer_estimate_s: Option<f64>,
    /// What the passes deposit; primes and retracts are not in it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume_mm3: Option<f64>,
    /// Time, volume and path length by kind of bead: walls, solid, sparse, bridge, skirt; travel and
    /// rests.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by_kind: Option<BTreeMap<String, UseFigures>>,
    /// Time and volume by layer, the longest first, at most a thousand.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by_layer: Option<Vec<LayerFigures>>,
    /// Mass of the passes, where the material's density is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass_g: Option<f64>,
    /// What that costs, where its price is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material_cost: Option<f64>,
    /// Length of the filament, where its diameter is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub filament_mm: Option<f64>,
    /// Layers that were slowed to the requested minimum time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slowed_layers: Option<u64>,
    /// Those of them that are over too soon all the same.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub short_layers: Option<u64>,
    /// The layer that takes longest, of several, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layer_time_longest_s: Option<f64>,
    /// Layers that take longer than permitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub late_layers: Option<u64>,
    /// Largest ratio of a bead's material on the outside of a curve to that on the inside; 100 if the inside
    /// is at rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outer_inner_ratio_max: Option<f64>,
    /// Where that is, input coordinates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outer_inner_ratio_at_mm: Option<[f64; 3]>,
    /// Printing path above the ratio that is allowed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outer_inner_over_mm: Option<f64>,
    /// Duration of planning.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plan_s: Option<f64>,
    /// Sum of |heading change|.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heading_travel_rad: Option<f64>,
    /// Peak heading rate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heading_rate_max_rad_s: Option<f64>,
    /// Spans of the stream.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub segments: Option<u64>,
    /// Bytes to the controller.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// The same for each second of motion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes_per_s: Option<f64>,
    /// Worst speed over its share of the limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit_ratio_velocity: Option<f64>,
    /// Worst acceleration over its share of the limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit_ratio_acceleration: Option<f64>,
    /// Worst jerk over its share of the limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit_ratio_jerk: Option<f64>,
    /// Share of the printing time at each limit; "none" is the share at no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_share_by_limit: Option<BTreeMap<String, f64>>,
    /// The five places of about a millimetre that take longest, the slowest first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slow_places: Option<Vec<SlowPlaceFigures>>,
    /// Where beads are uneven, by kind: absent for even ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uneven_places: Option<Vec<UnevenFigures>>,
    /// Tip of the simulated steps against the plan.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tip_error_um_max: Option<f64>,
    /// The same, root mean square.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tip_error_um_rms: Option<f64>,
    /// Heading of the simulated steps against the plan.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heading_error_mrad_max: Option<f64>,
    /// Effect of half a step of every joint at the tip.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub half_step_um_max: Option<f64>,
    /// Effect of half a step of every joint on the heading.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub half_step_mrad_max: Option<f64>,
    /// Input shapers' path from the planned one, where joints are shaped; the errors above are from theirs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shaping_error_um_max: Option<f64>,
    /// Deposited volume of the steps against the plan.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume_error_pct: Option<f64>,
    /// Steps against the exact crossing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_time_error_us_max: Option<f64>,
    /// The same, root mean square.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_time_error_us_rms: Option<f64>,
    /// Steps of all motors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<u64>,
    /// Hash of every step: tick from the job's first segment, motor, direction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_digest: Option<String>,
    /// Step counts at the end: joints in order, extruder last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub final_counts: Option<Vec<i64>>,
    /// Frames that had to be sent again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resent_frames: Option<u64>,
    /// Times the controller ran out of segments.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub underruns: Option<u64>,
    /// Times the head came to rest on the path and continued.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub holds: Option<u64>,
    /// Faults latched.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub faults: Option<u64>,
    /// Seconds of motion for each second of simulation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub realtime_factor: Option<f64>,
}

impl Figures {
    /// Pretty JSON. Numbers that are not finite become `null`; there should be none.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_else(|_| "{}".to_string())
    }

    /// `self` with everything that `later` knows written over it.
    pub fn merged_with(self, later: &Figures) -> Figures {
        let (Ok(serde_json::Value::Object(mut all)), Ok(serde_json::Value::Object(new))) =
            (serde_json::to_value(&self), serde_json::to_value(later))
        else {
            return self;
        };
        all.extend(new);
        serde_json::from_value(all.into()).unwrap_or(self)
    }

    /// The figures in groups, for a terminal: (group, rows of (what, value with unit)).
    pub fn groups(&self) -> Vec<(&'static str, Vec<(String, String)>)> {
        let named = |rows: Vec<Row>| -> Vec<(String, Option<String>)> {
            let rows = rows.into_iter();
            rows.map(|(what, value)| (what.to_string(), value))
                .collect()
        };
        let groups = [
            ("Coverage", named(self.coverage_rows())),
            ("Layers", self.layer_rows()),
            ("Motion", named(self.motion_rows())),
            ("Limits and stream", named(self.stream_rows())),
            ("Simulated steps", named(self.step_rows())),
        ];
        groups
            .into_iter()
            .map(|(group, rows)| {
                let known = rows
                    .into_iter()
                    .filter_map(|(what, value)| Some((what, value?)));
                (group, known.collect::<Vec<_>>())
            })
            .filter(|(_, rows)| !rows.is_empty())
            .collect()
    }

    /// [`Figures::groups`] as aligned text.
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        for (group, rows) in self.groups() {
            text += group;
            text.push('\n');
            for (what, value) in rows {
                text += &format!("  {what:<32} {value}\n");
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_figures_are_absent_and_keys_are_stable() {
        let plan = Figures {
            covered_pct: Some(99.5),
            passes: Some(3),
            ..Figures::default()
        };
        let value: serde_json::Value = serde_json::from_str(&plan.to_json()).expect("JSON");
        assert_eq!(value, serde_json::json!({"covered_pct": 99.5, "passes": 3}));
        let simulated = Figures {
            passes: Some(4),
            faults: Some(0),
            final_counts: Some(vec![1, -2]),
            ..Figures::default()
        };
        let merged = plan.merged_with(&simulated);
        assert_eq!(merged.passes, Some(4));
        assert_eq!(merged.covered_pct, Some(99.5));
        assert_eq!(merged.final_counts, Some(vec![1, -2]));
        assert!(merged.to_text().contains("covered"));
    }
}

//! The figures of a job: `plan --json`, `simulate --json` and `report.json`.
//!
//! Other programs read these keys; they change only with a version. A figure without a meaning is
//! absent (a plan that was not simulated has no `tip_error_um_max`).

pub use super::corner_figures::CornerFigures;
pub use super::curved_layer_figures::CurvedLayerFigures;
use super::figure_rows::{GROUPS, Row, number, row, slowest_place, time_shares};
pub use super::layer_figures::{
    Inside, KindFigures, LaidLayerFigures, LayerFigures, LayerPlace, UseFigures,
};
pub use super::piece_figures::PieceFigures;
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

/// Declares [`Figures`]: key and type of each, then, if tables of figures show it, its place in them (group in
/// hundreds), its name there, how its value is written, and the figure without which it is not shown.
macro_rules! figures {
    ($($(#[doc = $doc:literal])+ $key:ident: $of:ty
        $(=> $place:literal $what:literal, $text:expr $(, if $known:ident)?)?;)+) => {
        /// All figures; the keys are the field names. Shares are of the layers' area, over all layers;
        /// depths and rates the worst of any; lengths, times and counts totals.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(default)]
        pub struct Figures {
            $($(#[doc = $doc])+ #[serde(skip_serializing_if = "Option::is_none")] pub $key: Option<$of>,)+
        }

        impl Figures {
            /// Rows of the tables, in the order of the keys.
            fn rows(&self) -> Vec<Row> {
                let mut rows = Vec::new();
                $($(if true $(&& self.$known.is_some())? {
                    rows.extend(row($place, $what, &self.$key, $text));
                })?)+
                rows
            }
        }
    };
}

figures! {
    /// The figures in words; for displayed figures, never for those in a job file.
    verdict: VerdictFigures;
    /// What keeps the job from being good, one line each; it was allowed where there is a job all the same.
    objections: Vec<String>;
    /// Area of the outline.
    area_mm2: f64 => 101 "outline", number(2, "mm²");
    /// Layers, where there are several.
    layers: u64 => 201 "layers", u64::to_string;
    /// Layers that follow the top of a part, where there are some.
    curved_layers: CurvedLayerFigures => 202 "curved layers", |layers| layers.text();
    /// Pieces with build directions of their own, where there are some: the rest, which is upright, first.
    pieces: Vec<PieceFigures> => 205 "pieces", |pieces| PieceFigures::text(pieces);
    /// Layer groups, by their first layer.
    layer_kinds: Vec<KindFigures>;
    /// `covered_pct` of the layer that has the least.
    covered_pct_min: f64 => 203 "covered, least of a layer", number(2, "%");
    /// `overlap_pct` of the layer that has the most.
    overlap_pct_max: f64 => 204 "overlap, most of a layer", number(2, "%");
    /// Share of the outline that some aperture inside it can cover.
    reachable_pct: f64 => 102 "reachable", number(2, "%");
    /// Share of the outline that is covered.
    covered_pct: f64 => 103 "covered", number(2, "%");
    /// Share of the reachable part that is covered.
    covered_of_reachable_pct: f64 => 104 "covered of reachable", number(2, "%");
    /// Largest depth of a placed aperture outside the outline, on the finished segments.
    outside_depth_mm: f64 => 106 "outside, deepest", |mm| number(2, "µm")(&(mm * 1e3));
    /// Share of the outline that is swept more than once.
    overlap_pct: f64 => 105 "overlap", number(2, "%");
    /// Area of the outline lost to keep-outs; the shares are of the rest.
    kept_out_mm2: f64 => 107 "kept out", number(2, "mm²");
    /// Ground inside the walls that infill lines are to cover.
    infill_mm2: f64 => 108 "infill area", number(2, "mm²");
    /// Covered share of that: the resulting density.
    infill_covered_pct: f64 => 109 "infill density", number(2, "%");
    /// Area of all layers that is open on purpose between the lines of a sparse infill.
    sparse_mm2: f64 => 110 "left to sparse lines", number(2, "mm²");
    /// Covered share of that.
    sparse_covered_pct: f64 => 111 "covered of that", number(2, "%");
    /// Covered share of all other area of the outline, if some is sparse.
    solid_covered_pct: f64 => 112 "covered of the rest", number(2, "%");
    /// Boundary length that no aperture inside can touch.
    unreachable_mm: f64 => 113 "unreachable boundary", number(2, "mm");
    /// Largest connected uncovered area of the layers that are to be filled.
    open_largest_mm2: f64 => 114 "largest piece left open", number(3, "mm²");
    /// Largest number of layers on which the same tenth of a millimetre is uncovered, away from the
    /// outline.
    open_ground_stacked_max_layers: u64 => 115 "open on the same place, layers", u64::to_string;
    /// Such area that is uncovered on half of the layers or more.
    open_ground_stacked_mm2: f64 => 116 "open on half the layers", number(2, "mm²");
    /// Area that extends farther than half a bead beyond the layer below, all layers of a part.
    overhang_mm2: f64 => 117 "hanging over nothing", number(2, "mm²");
    /// By layer, the most first.
    overhang_places: Vec<LayerPlace>;
    /// Regions of a part that are not printed.
    left_out_places: Vec<LayerPlace> => 118 "regions not printed", |places| places.len().to_string();
    /// The places of that: centre x, y and length of each, at most a thousand.
    unreachable_places_mm: Vec<[f64; 3]>;
    /// Continuous runs with flow.
    passes: u64 => 301 "passes", u64::to_string;
    /// Retract, travel and prime between two passes.
    flow_interruptions: u64 => 302 "flow interruptions", u64::to_string;
    /// Travels between passes that leave the outline.
    outline_crossings: u64 => 303 "travels across the outline", u64::to_string;
    /// Length of the tip's path on which nozzle or head collide with the table or the print.
    touched_mm: f64 => 304 "path with collisions", number(1, "mm");
    /// Largest dip of the nozzle's flat end into the print.
    tip_dip_max_mm: f64 => 305 "flat end in the print", number(2, "mm");
    /// Corners of a run of waypoints, where they are to be rounded.
    rounded_corners: CornerFigures => 306 "corners rounded", |corners| corners.text();
    /// Tip path with flow.
    print_mm: f64 => 307 "printing path", number(1, "mm");
    /// Printing path around the part: skirt and brim.
    skirt_mm: f64 => 308 "skirt and brim", number(1, "mm");
    /// Tip path without flow.
    travel_mm: f64 => 309 "travel", number(1, "mm");
    /// Duration of the job.
    print_s: f64 => 310 "print time", number(2, "s");
    /// The same part with another nozzle, if requested.
    against: AgainstFigures;
    /// The same without limits of the joints' jerk.
    time_bound_s: f64 => 311 "without limits of jerk", number(2, "s");
    /// The slicer's own estimate of the printing time, of G-code.
    slicer_estimate_s: f64 => 312 "slicer's estimate", number(2, "s");
    /// What the passes deposit; primes and retracts are not in it.
    volume_mm3: f64 => 313 "deposited volume", number(2, "mm³");
    /// Time, volume and path length by kind of bead: walls, solid, sparse, bridge, skirt; travel and
    /// rests.
    by_kind: BTreeMap<String, UseFigures>;
    /// Time and volume by layer, the longest first, at most a thousand.
    by_layer: Vec<LayerFigures>;
    /// Mass of the passes, where the material's density is known.
    mass_g: f64 => 314 "mass", number(2, "g");
    /// What that costs, where its price is known.
    material_cost: f64 => 315 "cost of the material", number(2, "");
    /// Length of the filament, where its diameter is known.
    filament_mm: f64 => 316 "filament", number(1, "mm");
    /// Layers that were slowed to the requested minimum time.
    slowed_layers: u64 => 317 "layers slowed", u64::to_string;
    /// Those of them that are over too soon all the same.
    short_layers: u64 => 318 "layers too short all the same", u64::to_string;
    /// The layer that takes longest, of several, s.
    layer_time_longest_s: f64 => 319 "longest layer", number(1, "s");
    /// Layers that take longer than permitted.
    late_layers: u64 => 320 "layers that take too long", u64::to_string;
    /// Largest ratio of a bead's material on the outside of a curve to that on the inside; 100 if the inside
    /// is at rest.
    outer_inner_ratio_max: f64 => 321 "outside by inside of a curve, worst", number(2, ""), if outer_inner_over_mm;
    /// Where that is, input coordinates.
    outer_inner_ratio_at_mm: [f64; 3];
    /// Printing path above the ratio that is allowed.
    outer_inner_over_mm: f64 => 322 "path in tighter curves", number(1, "mm");
    /// Duration of planning.
    plan_s: f64 => 323 "planning time", number(2, "s");
    /// Sum of |heading change|.
    heading_travel_rad: f64 => 324 "heading travel", number(1, "rad");
    /// Peak heading rate.
    heading_rate_max_rad_s: f64 => 325 "heading rate, peak", number(2, "rad/s");
    /// Spans of the stream.
    segments: u64 => 406 "segments", u64::to_string;
    /// Bytes to the controller.
    bytes: u64 => 407 "bytes", u64::to_string;
    /// The same for each second of motion.
    bytes_per_s: f64 => 408 "bytes per second of motion", number(0, "B/s");
    /// Worst speed over its share of the limit.
    limit_ratio_velocity: f64 => 401 "worst speed / limit", number(4, "");
    /// Worst acceleration over its share of the limit.
    limit_ratio_acceleration: f64 => 402 "worst acceleration / limit", number(4, "");
    /// Worst jerk over its share of the limit.
    limit_ratio_jerk: f64 => 403 "worst jerk / limit", number(4, "");
    /// Share of the printing time at each limit; "none" is the share at no limit.
    time_share_by_limit: BTreeMap<String, f64> => 404 "printing time at", time_shares;
    /// The five places of about a millimetre that take longest, the slowest first.
    slow_places: Vec<SlowPlaceFigures> => 405 "slowest place", |places| slowest_place(places);
    /// Where beads are uneven, by kind: absent for even ones.
    uneven_places: Vec<UnevenFigures>;
    /// Tip of the simulated steps against the plan.
    tip_error_um_max: f64 => 502 "tip error, worst", number(2, "µm");
    /// The same, root mean square.
    tip_error_um_rms: f64 => 503 "tip error, rms", number(2, "µm");
    /// Heading of the simulated steps against the plan.
    heading_error_mrad_max: f64 => 505 "heading error, worst", number(3, "mrad");
    /// Effect of half a step of every joint at the tip.
    half_step_um_max: f64 => 504 "half a step at the tip", number(2, "µm");
    /// Effect of half a step of every joint on the heading.
    half_step_mrad_max: f64 => 506 "half a step in heading", number(3, "mrad");
    /// Input shapers' path from the planned one, where joints are shaped; the errors above are from theirs.
    shaping_error_um_max: f64 => 507 "shaping error", number(1, "µm");
    /// Deposited volume of the steps against the plan.
    volume_error_pct: f64 => 508 "volume error", number(4, "%");
    /// Steps against the exact crossing.
    step_time_error_us_max: f64 => 509 "step time error, worst", number(2, "µs");
    /// The same, root mean square.
    step_time_error_us_rms: f64 => 510 "step time error, rms", number(2, "µs");
    /// Steps of all motors.
    steps: u64 => 501 "steps", u64::to_string;
    /// Hash of every step: tick from the job's first segment, motor, direction.
    step_digest: String => 516 "step digest", String::clone;
    /// Step counts at the end: joints in order, extruder last.
    final_counts: Vec<i64>;
    /// Frames that had to be sent again.
    resent_frames: u64 => 511 "frames sent again", u64::to_string;
    /// Times the controller ran out of segments.
    underruns: u64 => 512 "underruns", u64::to_string;
    /// Times the head came to rest on the path and continued.
    holds: u64 => 513 "holds", u64::to_string;
    /// Faults latched.
    faults: u64 => 514 "faults", u64::to_string;
    /// What arrives on the passes, of a known material.
    laid_mm3: f64 => 517 "volume that arrives", number(2, "mm³");
    /// The same against what was asked for.
    laid_error_pct: f64 => 518 "volume that arrives, off by", number(2, "%");
    /// What leaves the nozzle off the passes.
    laid_off_passes_mm3: f64 => 519 "leaves off the passes", number(2, "mm³");
    /// Error of the beads' cross-sections without its sign, mean by length, starts and stops of passes left out.
    bead_area_error_pct_mean: f64 => 520 "bead area off by, mean", number(2, "%");
    /// The largest of them.
    bead_area_error_pct_max: f64 => 521 "bead area off by, worst", number(2, "%");
    /// The same within a nozzle's length of starts and stops.
    bead_area_error_ends_pct_max: f64 => 522 "the same at starts and stops", number(2, "%");
    /// The worst place, starts and stops left out, per cent with its sign.
    bead_area_worst: UnevenFigures;
    /// What arrives by layer, at most a thousand.
    laid_by_layer: Vec<LaidLayerFigures>;
    /// Seconds of motion for each second of simulation.
    realtime_factor: f64 => 515 "motion / simulation time", number(1, "x");
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
        let mut rows = self.rows();
        rows.extend(self.layer_rows());
        rows.sort_by_key(|row| row.place);
        let mut groups: Vec<(&str, Vec<_>)> = Vec::new();
        for group in rows.chunk_by(|a, b| a.place / 100 == b.place / 100) {
            let rows = group.iter().map(|row| (row.what.clone(), row.text.clone()));
            groups.push((
                GROUPS[usize::from(group[0].place / 100) - 1],
                rows.collect(),
            ));
        }
        groups
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

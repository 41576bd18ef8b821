//! Rows of the tables of figures: a name, and a value with its unit where it is known.

use super::figures::{CurvedLayerFigures, Figures, KindFigures};

/// Layers that are listed in text, the longest ones.
const LAYERS_TOLD: usize = 3;
/// Limits that are listed in text.
const LIMITS_TOLD: usize = 4;

impl Figures {
    pub(super) fn coverage_rows(&self) -> Vec<Row> {
        vec![
            ("outline", number(self.area_mm2, 2, "mm²")),
            ("reachable", number(self.reachable_pct, 2, "%")),
            ("covered", number(self.covered_pct, 2, "%")),
            (
                "covered of reachable",
                number(self.covered_of_reachable_pct, 2, "%"),
            ),
            ("overlap", number(self.overlap_pct, 2, "%")),
            (
                "outside, deepest",
                number(self.outside_depth_mm.map(|v| v * 1e3), 2, "µm"),
            ),
            ("kept out", number(self.kept_out_mm2, 2, "mm²")),
            ("infill area", number(self.infill_mm2, 2, "mm²")),
            ("infill density", number(self.infill_covered_pct, 2, "%")),
            ("left to sparse lines", number(self.sparse_mm2, 2, "mm²")),
            ("covered of that", number(self.sparse_covered_pct, 2, "%")),
            (
                "covered of the rest",
                number(self.solid_covered_pct, 2, "%"),
            ),
            ("unreachable boundary", number(self.unreachable_mm, 2, "mm")),
            (
                "largest piece left open",
                number(self.open_largest_mm2, 3, "mm²"),
            ),
            (
                "open on the same place, layers",
                count(self.open_ground_stacked_max_layers),
            ),
            (
                "open on half the layers",
                number(self.open_ground_stacked_mm2, 2, "mm²"),
            ),
            ("hanging over nothing", number(self.overhang_mm2, 2, "mm²")),
            (
                "regions not printed",
                count(self.left_out_places.as_ref().map(|p| p.len() as u64)),
            ),
        ]
    }

    pub(super) fn layer_rows(&self) -> Vec<(String, Option<String>)> {
        let curved = self.curved_layers.as_ref();
        let rows: [Row; 4] = [
            ("layers", count(self.layers)),
            ("curved layers", curved.map(CurvedLayerFigures::text)),
            (
                "covered, least of a layer",
                number(self.covered_pct_min, 2, "%"),
            ),
            (
                "overlap, most of a layer",
                number(self.overlap_pct_max, 2, "%"),
            ),
        ];
        let rows = rows.map(|(what, value)| (what.to_string(), value));
        let kinds = self.layer_kinds.iter().flatten();
        let used = self.by_kind.iter().flatten().map(|(name, used)| {
            let share_pct = 100.0 * used.seconds / self.print_s.unwrap_or(f64::INFINITY);
            let value = format!(
                "{:.1} s ({share_pct:.1} %), {:.1} mm³",
                used.seconds, used.volume_mm3
            );
            (format!("time, volume: {name}"), Some(value))
        });
        let longest = self
            .by_layer
            .iter()
            .flatten()
            .take(LAYERS_TOLD)
            .map(|layer| {
                let value = format!("{:.1} s, {:.1} mm³", layer.seconds, layer.volume_mm3);
                let what = format!("long layer {}, z {:.2}", layer.layer + 1, layer.z_mm);
                (what, Some(value))
            });
        rows.into_iter()
            .chain(kinds.map(KindFigures::row))
            .chain(used)
            .chain(longest)
            .collect()
    }

    pub(super) fn motion_rows(&self) -> Vec<Row> {
        vec![
            ("passes", count(self.passes)),
            ("flow interruptions", count(self.flow_interruptions)),
            ("travels across the outline", count(self.outline_crossings)),
            ("path with collisions", number(self.touched_mm, 1, "mm")),
            (
                "flat end in the print",
                number(self.tip_dip_max_mm, 2, "mm"),
            ),
            ("corners rounded", self.rounded_corners.map(|c| c.text())),
            ("printing path", number(self.print_mm, 1, "mm")),
            ("skirt and brim", number(self.skirt_mm, 1, "mm")),
            ("travel", number(self.travel_mm, 1, "mm")),
            ("print time", number(self.print_s, 2, "s")),
            ("without limits of jerk", number(self.time_bound_s, 2, "s")),
            ("slicer's estimate", number(self.slicer_estimate_s, 2, "s")),
            ("deposited volume", number(self.volume_mm3, 2, "mm³")),
            ("mass", number(self.mass_g, 2, "g")),
            ("cost of the material", number(self.material_cost, 2, "")),
            ("filament", number(self.filament_mm, 1, "mm")),
            ("layers slowed", count(self.slowed_layers)),
            ("layers too short all the same", count(self.short_layers)),
            ("longest layer", number(self.layer_time_longest_s, 1, "s")),
            ("layers that take too long", count(self.late_layers)),
            (
                "outside by inside of a curve, worst",
                (self.outer_inner_over_mm).and(number(self.outer_inner_ratio_max, 2, "")),
            ),
            (
                "path in tighter curves",
                number(self.outer_inner_over_mm, 1, "mm"),
            ),
            ("planning time", number(self.plan_s, 2, "s")),
            ("heading travel", number(self.heading_travel_rad, 1, "rad")),
            (
                "heading rate, peak",
                number(self.heading_rate_max_rad_s, 2, "rad/s"),
            ),
        ]
    }

    pub(super) fn stream_rows(&self) -> Vec<Row> {
        vec![
            (
                "worst speed / limit",
                number(self.limit_ratio_velocity, 4, ""),
            ),
            (
                "worst acceleration / limit",
                number(self.limit_ratio_acceleration, 4, ""),
            ),
            ("worst jerk / limit", number(self.limit_ratio_jerk, 4, "")),
            ("printing time at", self.time_shares()),
            ("slowest place", self.slowest_place()),
            ("segments", count(self.segments)),
            ("bytes", count(self.bytes)),
            (
                "bytes per second of motion",
                number(self.bytes_per_s, 0, "B/s"),
            ),
        ]
    }

    /// The limits that take most of the time.
    pub(super) fn time_shares(&self) -> Option<String> {
        let mut shares: Vec<_> = self.time_share_by_limit.as_ref()?.iter().collect();
        shares.sort_by(|a, b| b.1.total_cmp(a.1));
        let told = shares.iter().take(LIMITS_TOLD);
        let told = told.map(|(limit, share)| format!("{limit} {:.0} %", 100.0 * **share));
        Some(told.collect::<Vec<_>>().join(", "))
    }

    pub(super) fn slowest_place(&self) -> Option<String> {
        let place = self.slow_places.as_ref()?.first()?;
        Some(format!(
            "{:.2} s a millimetre at ({:.2}, {:.2}), by {}",
            place.seconds, place.x_mm, place.y_mm, place.limit
        ))
    }

    pub(super) fn step_rows(&self) -> Vec<Row> {
        vec![
            ("steps", count(self.steps)),
            ("tip error, worst", number(self.tip_error_um_max, 2, "µm")),
            ("tip error, rms", number(self.tip_error_um_rms, 2, "µm")),
            (
                "half a step at the tip",
                number(self.half_step_um_max, 2, "µm"),
            ),
            (
                "heading error, worst",
                number(self.heading_error_mrad_max, 3, "mrad"),
            ),
            (
                "half a step in heading",
                number(self.half_step_mrad_max, 3, "mrad"),
            ),
            ("shaping error", number(self.shaping_error_um_max, 1, "µm")),
            ("volume error", number(self.volume_error_pct, 4, "%")),
            (
                "step time error, worst",
                number(self.step_time_error_us_max, 2, "µs"),
            ),
            (
                "step time error, rms",
                number(self.step_time_error_us_rms, 2, "µs"),
            ),
            ("frames sent again", count(self.resent_frames)),
            ("underruns", count(self.underruns)),
            ("holds", count(self.holds)),
            ("faults", count(self.faults)),
            (
                "motion / simulation time",
                number(self.realtime_factor, 1, "x"),
            ),
            ("step digest", self.step_digest.clone()),
        ]
    }
}

pub(super) type Row = (&'static str, Option<String>);

fn number(value: Option<f64>, digits: usize, unit: &str) -> Option<String> {
    value.map(|v| format!("{v:.digits$} {unit}").trim_end().to_string())
}

fn count(value: Option<u64>) -> Option<String> {
    value.map(|v| v.to_string())
}

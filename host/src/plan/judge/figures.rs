//! The figures by which a plan is judged; [`super::measure`] finds them.
//!
//! In: swept areas of each printing of a region, mm². Out: shares in per cent, depths in µm.

use serde::{Deserialize, Serialize};

/// What a plan is judged on. Shares are weighted by area over all layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlanFigures {
    /// Layers.
    pub layers: u32,
    /// Area of the regions, of one layer.
    pub area_mm2: f64,
    /// Share of the area that some placement covers.
    pub reachable_pct: f64,
    /// Share of the area that was swept.
    pub covered_pct: f64,
    /// The same for the layer with the least.
    pub covered_pct_min: f64,
    /// Share of the reachable area that was swept.
    pub covered_of_reachable_pct: f64,
    /// Share of the area that is swept more than once on its layer.
    pub overlap_pct: f64,
    /// The same for the layer with the most.
    pub overlap_pct_max: f64,
    /// Largest depth of a placed aperture outside the regions, on any layer.
    pub outside_depth_mm: f64,
    /// Where that is, input coordinates.
    pub outside_at_mm: [f64; 2],
    /// Number of passes.
    pub passes: usize,
    /// Length of the printed tip path.
    pub print_mm: f64,
    /// What of that is printed around the regions.
    pub skirt_mm: f64,
    /// Length of everything else.
    pub travel_mm: f64,
    /// Duration of the stream.
    pub print_s: f64,
    /// What the passes deposit; primes and retracts are not in it.
    pub volume_mm3: f64,
    /// Sum of the heading's changes.
    pub heading_travel_rad: f64,
    /// Largest heading rate.
    pub heading_rate_max_rad_s: f64,
}

impl PlanFigures {
    /// Sets shares and depths from those of all printings and the layer of each, ordered by layer.
    pub fn set_shares(&mut self, layers: &[u32], swept: &[Swept]) {
        let all = Swept::sum(swept);
        let of_layers = || layers.chunk_by(|p, q| p == q);
        self.layers = of_layers().count().max(1) as u32;
        self.area_mm2 = all.area_mm2 / f64::from(self.layers);
        let area_mm2 = all.area_mm2.max(1e-12);
        self.covered_pct = all.covered_pct();
        self.overlap_pct = all.overlap_pct();
        self.reachable_pct = 100.0 * all.reachable_mm2 / area_mm2;
        self.covered_of_reachable_pct = 100.0 * all.covered_mm2 / all.reachable_mm2.max(1e-12);
        self.outside_depth_mm = all.outside_depth_mm;
        self.outside_at_mm = all.outside_at_mm;
        self.covered_pct_min = self.covered_pct;
        self.overlap_pct_max = self.overlap_pct;
        let mut done = 0;
        for layer in of_layers() {
            let layer_swept = Swept::sum(&swept[done..done + layer.len()]);
            done += layer.len();
            self.covered_pct_min = self.covered_pct_min.min(layer_swept.covered_pct());
            self.overlap_pct_max = self.overlap_pct_max.max(layer_swept.overlap_pct());
        }
    }

    /// Adds lengths, times and counts of further layers; shares are set for all together.
    pub fn add_lengths(&mut self, next: &PlanFigures) {
        self.passes += next.passes;
        self.print_mm += next.print_mm;
        self.skirt_mm += next.skirt_mm;
        self.travel_mm += next.travel_mm;
        self.print_s += next.print_s;
        self.volume_mm3 += next.volume_mm3;
        self.heading_travel_rad += next.heading_travel_rad;
        self.heading_rate_max_rad_s = self.heading_rate_max_rad_s.max(next.heading_rate_max_rad_s);
    }
}

/// Areas of one printing of a region, or of several together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Swept {
    /// Area of the region.
    pub area_mm2: f64,
    /// Swept part of it.
    pub covered_mm2: f64,
    /// Part of it that was swept more than once.
    pub overlap_mm2: f64,
    /// Part of it that some placement covers.
    pub reachable_mm2: f64,
    /// Largest depth of a placed aperture outside it.
    pub outside_depth_mm: f64,
    /// Where that is, input coordinates.
    pub outside_at_mm: [f64; 2],
}

impl Swept {
    /// Several together: sums of the areas, the deepest of the depths.
    pub fn sum<'a>(parts: impl IntoIterator<Item = &'a Swept>) -> Swept {
        let mut sum = Swept::default();
        for part in parts {
            sum.area_mm2 += part.area_mm2;
            sum.covered_mm2 += part.covered_mm2;
            sum.overlap_mm2 += part.overlap_mm2;
            sum.reachable_mm2 += part.reachable_mm2;
            if part.outside_depth_mm > sum.outside_depth_mm {
                sum.outside_depth_mm = part.outside_depth_mm;
                sum.outside_at_mm = part.outside_at_mm;
            }
        }
        sum
    }

    /// Share of the area that was swept.
    pub fn covered_pct(&self) -> f64 {
        100.0 * self.covered_mm2 / self.area_mm2.max(1e-12)
    }

    /// Share of the area that was swept more than once.
    pub fn overlap_pct(&self) -> f64 {
        100.0 * self.overlap_mm2 / self.area_mm2.max(1e-12)
    }
}

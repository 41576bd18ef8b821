//! Solid layers over an almost empty interior: roofs.
//!
//! The layer below has walls and solid areas; between the lines of such a sparse infill it has nothing that supports
//! a bead. Input: the outlines of all layers (mm, input coordinates) and the infill. Output: the solid area of a
//! layer, and the supporting area of the one below; bridges and overhangs are found between the two as between
//! outlines. Not covered: the sparse lines, which support a bridge where it crosses them.

use crate::geometry::Point2;
use crate::geometry::boolean::{difference, grown, intersection};
use crate::geometry::polygon::{Box2, Region, Ring};
use crate::plan::layers::bridge_ground::is_wide;
use crate::plan::layers::shells::{ShellLayers, solid_ground};
use crate::settings::{BOTTOM_LAYERS, Infill, Settings, TOP_LAYERS};

/// Beads from one line of the infill to the next that a solid layer spans as it is: 5 at 20 %, 6.7 at 15 %.
pub const SPAN_BEADS_MAX: f64 = 6.0;

/// A part with such an inside.
#[derive(Clone, Copy, Debug)]
pub struct Hollow<'a> {
    outlines: &'a [&'a [Region]],
    shells: ShellLayers,
    walls_mm: f64,
    bead_mm: f64,
}

/// The solid layers that close a part.
pub fn shell_layers(infill: &Infill) -> ShellLayers {
    ShellLayers {
        bottom: infill.bottom_layers.unwrap_or(BOTTOM_LAYERS),
        top: infill.top_layers.unwrap_or(TOP_LAYERS),
    }
}

impl<'a> Hollow<'a> {
    /// `None` if the infill is dense enough, or there is none.
    pub fn of(outlines: &'a [&'a [Region]], settings: &Settings) -> Option<Hollow<'a>> {
        let infill = settings.infill.as_ref()?;
        let bead_mm = 2.0 * settings.aperture.major_mm();
        let is_hollow = infill.density_pct * SPAN_BEADS_MAX < 100.0;
        is_hollow.then_some(Hollow {
            outlines,
            shells: shell_layers(infill),
            walls_mm: f64::from(infill.walls) * bead_mm,
            bead_mm,
        })
    }

    /// The solid area of a layer, including walls and overhangs, and the area of the one below that
    /// supports it; `None` on the lowest layer, and if both have the same interior.
    pub fn pair(&self, layer: usize) -> Option<[Vec<Region>; 2]> {
        let below = layer.checked_sub(1)?;
        let [solid, solid_below] = [layer, below].map(|layer| self.solid(layer));
        let (own, under) = (self.outlines[layer], self.outlines[below]);
        if own == under && solid == solid_below {
            return None;
        }
        let sparse = difference(&self.inside(own), &solid);
        let sparse = intersection(&sparse, under);
        let sparse_below = difference(&self.inside(under), &solid_below);
        Some([difference(own, &sparse), difference(under, &sparse_below)])
    }

    /// Solid area of a layer over nothing, farther than `reach_mm` from its support: parts wider than a
    /// bead.
    pub fn unheld(&self, layer: usize, reach_mm: f64) -> Vec<Region> {
        let Some([own, below]) = self.pair(layer) else {
            return Vec::new();
        };
        let mut open = difference(&own, &grown(&below, reach_mm));
        open.retain(|piece| is_wide(piece, self.bead_mm));
        open
    }

    fn solid(&self, layer: usize) -> Vec<Region> {
        solid_ground(self.outlines, layer, self.shells)
    }

    /// What the walls leave of an outline.
    fn inside(&self, outline: &[Region]) -> Vec<Region> {
        let corners: Vec<Point2> = outline
            .iter()
            .map(Region::bounds)
            .flat_map(|bounds| [bounds.min, bounds.max])
            .collect();
        if corners.is_empty() {
            return Vec::new();
        }
        let Box2 { min, max } = Box2::of(&corners).grown(2.0 * self.walls_mm + self.bead_mm);
        let around = Region {
            exterior: Ring {
                points: vec![
                    min,
                    Point2::new(max.x, min.y),
                    max,
                    Point2::new(min.x, max.y),
                ],
            },
            holes: Vec::new(),
        };
        let outside = difference(&[around], outline);
        difference(outline, &grown(&outside, self.walls_mm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::region;
    use crate::plan::layers::bridge_ground::bridges;

    fn area_mm2(regions: &[Region]) -> f64 {
        regions.iter().map(Region::area_mm2).sum()
    }

    /// Goal: the first solid layer over an empty inside is bridged from wall to wall, those above and below it are
    /// not; a denser inside carries it. Method: a box of 20 mm of eight layers, two of them solid at either end; areas by hand.
    #[test]
    fn a_roof_over_nothing_is_bridged() {
        let own = [region(&[&[
            [0.0, 0.0],
            [20.0, 0.0],
            [20.0, 20.0],
            [0.0, 20.0],
        ]])];
        let outlines = [own.as_slice(); 8];
        let with = |density_pct: f64| Settings {
            infill: Some(Infill {
                density_pct,
                bottom_layers: Some(2),
                top_layers: Some(2),
                ..Infill::solid(2)
            }),
            ..Settings::default()
        };
        for density_pct in [0.0, 5.0, 15.0] {
            let settings = with(density_pct);
            let reach_mm = settings.aperture.major_mm();
            let hollow = Hollow::of(&outlines, &settings).expect("hollow");
            for layer in 0..8 {
                let unheld_mm2 = area_mm2(&hollow.unheld(layer, reach_mm));
                let pair = hollow.pair(layer);
                let spans = pair.map_or(Vec::new(), |[own, below]| bridges(&own, &below, reach_mm));
                let bridged_mm2: f64 = spans.iter().map(|bridge| area_mm2(&bridge.ground)).sum();
                // Two walls of 1.2 mm leave 15.2 mm, of which the beads' reach is 0.6 mm all around.
                let [roof_mm2, far_mm2] = [15.2f64, 14.0].map(|side| match layer {
                    6 => side * side,
                    _ => 0.0,
                });
                assert!(
                    (bridged_mm2 - roof_mm2).abs() < 0.1,
                    "{layer}: {bridged_mm2}"
                );
                assert!((unheld_mm2 - far_mm2).abs() < 0.1, "{layer}: {unheld_mm2}");
            }
        }
        assert!(Hollow::of(&outlines, &with(20.0)).is_none());
    }
}

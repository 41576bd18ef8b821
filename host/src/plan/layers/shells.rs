//! Areas of each layer that are exposed above or below: they are solid, however sparse the infill
//! is.
//!
//! Input: the outlines of all layers of a part, upwards (mm, input coordinates). Output: the area
//! of a layer that one of the next few layers above or below does not have, as overlapping regions;
//! and overhangs. The planner uses the part inside the walls.

use crate::geometry::Point2;
use crate::geometry::apart::apart_mm;
use crate::geometry::boolean::{difference, grown, intersection};
use crate::geometry::polygon::Region;
use rayon::prelude::*;

/// Solid layers that close a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShellLayers {
    /// Above areas that are exposed below.
    pub bottom: u32,
    /// Below areas that are exposed above.
    pub top: u32,
}

/// The area of a layer that is exposed within a number of layers.
pub fn solid_ground(outlines: &[&[Region]], layer: usize, shells: ShellLayers) -> Vec<Region> {
    exposed_ground(outlines, layer, shells, |_| false)
}

/// The same, but for what is near the outline only: `is_alike` is true of a layer that lacks nothing else.
pub fn exposed_ground(
    outlines: &[&[Region]],
    layer: usize,
    shells: ShellLayers,
    is_alike: impl Fn(usize) -> bool,
) -> Vec<Region> {
    let own = outlines[layer];
    let above = (1..=shells.top as usize).map(|step| Some(layer + step));
    let below = (1..=shells.bottom as usize).map(|step| layer.checked_sub(step));
    let others = above.chain(below);
    let others: Option<Vec<usize>> = others
        .map(|other| other.filter(|&other| other < outlines.len()))
        .collect();
    let Some(others) = others else {
        // Above the last layer and below the first there is nothing.
        return own.to_vec();
    };
    let mut open = Vec::new();
    let mut last: &[Region] = own;
    for number in others {
        let other = outlines[number];
        if other != own && other != last && !is_alike(number) {
            open.extend(difference(own, other));
        }
        last = other;
    }
    open
}

/// An overhang.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overhang {
    /// How much, mm².
    pub area_mm2: f64,
    /// The largest connected part of it, mm².
    pub largest_mm2: f64,
    /// A place of that, input coordinates.
    pub at: Point2,
    /// Regions that lie on nothing at all, mm², and a place of the largest.
    pub floating: Option<(f64, Point2)>,
}

/// Distance from a bridge's area within which an area borders on it, mm: well above rounding.
const BESIDE_MM: f64 = 0.02;

/// For each layer except the first the area farther than `reach_mm` from the layer below, together with
/// that of `unheld`, and outside the layer's bridges.
pub fn overhangs(
    outlines: &[&[Region]],
    unheld: impl Fn(usize) -> Vec<Region> + Sync,
    bridges: impl Fn(usize) -> Vec<Region> + Sync,
    reach_mm: f64,
) -> Vec<Overhang> {
    let layers = (0..outlines.len()).into_par_iter();
    let found = layers.map(|layer| {
        let below = layer.checked_sub(1).map(|below| outlines[below]);
        let mut hanging = Overhang::default();
        let mut open = match below {
            Some(below) if apart_mm(outlines[layer], below, reach_mm).is_none() => {
                let holding = grown(below, reach_mm);
                let open = difference(outlines[layer], &holding);
                hanging.floating = floating(outlines[layer], &open, &holding);
                open
            }
            _ => Vec::new(),
        };
        let unheld = unheld(layer);
        if !unheld.is_empty() {
            let more = difference(&unheld, &open);
            open.extend(more);
        }
        if !open.is_empty() {
            let bridged = grown(&bridges(layer), BESIDE_MM);
            open = difference(&open, &bridged);
        }
        for region in &open {
            let area_mm2 = region.area_mm2();
            hanging.area_mm2 += area_mm2;
            if area_mm2 > hanging.largest_mm2 {
                hanging.largest_mm2 = area_mm2;
                hanging.at = region.exterior.points.first().copied().unwrap_or_default();
            }
        }
        hanging
    });
    found.collect()
}

/// Least share of a region's area that is open where all of it is: far above rounding.
const WHOLE_SHARE: f64 = 1.0 - 1e-6;

/// The regions of a layer that nothing below holds: their area, mm², and a place of the largest. `open` is what is left of the
/// layer beside `holding`: a region that is held nowhere is whole in it, and only such ones are looked at.
fn floating(layer: &[Region], open: &[Region], holding: &[Region]) -> Option<(f64, Point2)> {
    let largest_mm2 = open.iter().map(Region::area_mm2).fold(0.0, f64::max);
    let may_float = |region: &&Region| region.area_mm2() * WHOLE_SHARE <= largest_mm2;
    let floats = |region: &&Region| {
        may_float(region) && intersection(std::slice::from_ref(region), holding).is_empty()
    };
    let floating: Vec<&Region> = layer.iter().filter(floats).collect();
    let area_mm2 = |region: &&Region| region.area_mm2();
    let largest = (floating.iter()).max_by(|a, b| area_mm2(a).total_cmp(&area_mm2(b)))?;
    let at = largest.exterior.points.first().copied()?;
    Some((floating.iter().map(area_mm2).sum(), at))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::region;

    fn square(size: f64) -> Vec<Region> {
        vec![region(&[&[
            [0.0, 0.0],
            [size, 0.0],
            [size, size],
            [0.0, size],
        ]])]
    }

    fn area_mm2(regions: &[Region]) -> f64 {
        regions.iter().map(Region::area_mm2).sum()
    }

    /// Goal: of a stair that narrows, each step is open as many layers deep as there are top layers,
    /// the lowest layer all over, the inside nowhere. Method: areas by hand.
    #[test]
    fn a_stair_is_open_at_its_steps() {
        let (wide, narrow) = (square(10.0), square(4.0));
        let mut layers = vec![wide.as_slice(); 6];
        layers.extend([narrow.as_slice(); 6]);
        let shells = ShellLayers { bottom: 1, top: 2 };
        let open = |layer| area_mm2(&solid_ground(&layers, layer, shells)).round();
        let areas: Vec<f64> = (0..layers.len()).map(open).collect();
        let expected = [
            100.0, 0.0, 0.0, 0.0, 84.0, 84.0, 0.0, 0.0, 0.0, 0.0, 16.0, 16.0,
        ];
        assert_eq!(areas, expected);
    }

    /// Goal: only what juts out farther than the reach and is not bridged hangs. Method: a wider square on
    /// a narrow one, the ring beyond the reach by hand (corners round), with a bridge over a side of it.
    #[test]
    fn what_juts_out_hangs() {
        let (narrow, wide) = (square(4.0), square(5.0));
        let layers = [narrow.as_slice(), wide.as_slice(), wide.as_slice()];
        let none = |_| Vec::new();
        let found = overhangs(&layers, none, none, 0.3);
        let expected = 25.0 - (4.3 * 4.3 - (1.0 - std::f64::consts::FRAC_PI_4) * 0.09);
        assert!(
            (found[1].area_mm2 - expected).abs() < 1e-3,
            "{:?}",
            found[1]
        );
        assert_eq!([found[0], found[2]], [Overhang::default(); 2]);
        assert_eq!(overhangs(&layers, none, none, 1.5)[1].area_mm2, 0.0);
        // All that hangs beyond x = 4.3 mm.
        let side = region(&[&[[4.3, 0.0], [5.0, 0.0], [5.0, 5.0], [4.3, 5.0]]]);
        let bridged = |layer| {
            if layer == 1 {
                vec![side.clone()]
            } else {
                Vec::new()
            }
        };
        let held = overhangs(&layers, none, bridged, 0.3)[1].area_mm2;
        // The bridge holds 0.02 mm of the rest.
        assert!((held - (expected - 3.5)).abs() < 0.02, "{held}");
    }
}

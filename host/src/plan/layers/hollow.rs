//! Solid layers over a sparse or empty interior: roofs.
//!
//! The layer below has walls and solid areas, and between them the lines of its infill. A roof goes the shorter way: from
//! wall to wall, or, where the lines below are closer to each other than the walls, across these lines. Input: the
//! outlines of all layers (mm, input coordinates) and the infill. Output: the bridges of each layer, the area that hangs,
//! the density at which no roof has to span more than it may. Not covered: roofs over an infill of half the ground or
//! more, which they span as they are, and that sparse lines may end short of a wall.

use crate::geometry::Point2;
use crate::geometry::apart::apart_mm;
use crate::geometry::boolean::{difference, grown, intersection};
use crate::geometry::polygon::{Box2, Region, Ring};
use crate::plan::layers::bridge_ground::{Bridge, bridges, is_wide, open_space};
use crate::plan::layers::shells::{ShellLayers, exposed_ground};
use crate::settings::{BOTTOM_LAYERS, Infill, Settings, TOP_LAYERS};
use rayon::prelude::*;
use std::sync::OnceLock;

/// Beads from one line of the infill to the next that a solid curved layer spans as it is: 5 at 20 %, 6.7 at 15 %.
pub const SPAN_BEADS_MAX: f64 = 6.0;
/// The same of a flat layer: a gap of one bead.
const PITCH_BEADS_MAX: f64 = 2.0;
/// Spans that are longer than allowed by less are as long as allowed, against the longest that is.
const SPAN_SLACK: f64 = 1e-6;

/// A part with such an inside.
#[derive(Clone, Debug)]
pub struct Hollow<'a> {
    outlines: &'a [&'a [Region]],
    /// Of each layer, once known: both layers beside it need it, and both for bridges and for what hangs.
    known: Vec<KnownLayer>,
    infill: Infill,
    shells: ShellLayers,
    walls_mm: f64,
    /// As wide as the walls are at least.
    walls_min_mm: f64,
    bead_mm: f64,
    /// Distance that beads extend over an edge without support.
    reach_mm: f64,
    span_max_mm: f64,
}

/// What is known of a layer.
#[derive(Clone, Debug, Default)]
struct KnownLayer {
    solid: OnceLock<Vec<Region>>,
    inside: OnceLock<Vec<Region>>,
    /// How far its outline is from that of the layer below; infinite beyond the narrowest walls.
    apart_mm: OnceLock<f64>,
}

/// The value of a cell, found if it is not known. Nobody waits meanwhile: a thread that finds it may be made to work on another
/// layer that needs the same.
fn known<T>(cell: &OnceLock<T>, find: impl FnOnce() -> T) -> &T {
    match cell.get() {
        Some(found) => found,
        None => {
            let found = find();
            cell.get_or_init(|| found)
        }
    }
}

/// A bridge that spans more than it may.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WideSpan {
    /// The layer, from 0.
    pub layer: u32,
    /// From one anchor to the next.
    pub span_mm: f64,
    /// A place on it, input coordinates.
    pub at: Point2,
    /// The part is below it, empty inside.
    pub is_roof: bool,
}

/// The density, per cent, of lines so many beads apart, and the other way round.
fn pct_or_pitch(pitch_or_pct: f64) -> f64 {
    100.0 / pitch_or_pct
}

/// The solid layers that close a part.
pub fn shell_layers(infill: &Infill) -> ShellLayers {
    ShellLayers {
        bottom: infill.bottom_layers.unwrap_or(BOTTOM_LAYERS),
        top: infill.top_layers.unwrap_or(TOP_LAYERS),
    }
}

/// The bridges of a layer, where there are lines to make them of; `hollow` is the part's inside ([`Hollow::of`]).
pub fn bridges_of(
    hollow: Option<&Hollow>,
    outlines: &[&[Region]],
    layer: usize,
    settings: &Settings,
) -> Vec<Bridge> {
    let below = layer.checked_sub(1);
    let (Some(below), Some(_)) = (below, &settings.infill) else {
        return Vec::new();
    };
    match hollow {
        Some(hollow) => hollow.bridges(layer),
        None => bridges(
            outlines[layer],
            outlines[below],
            settings.aperture.major_mm(),
        ),
    }
}

/// The bridges that span more than they may.
pub fn wide_spans<'b>(
    outlines: &[&[Region]],
    bridges: impl Iterator<Item = (u32, &'b Bridge)>,
    settings: &Settings,
) -> Vec<WideSpan> {
    let most_mm = settings.longest_bridge_mm() * (1.0 + SPAN_SLACK);
    let wide = bridges.filter(|(_, bridge)| bridge.span_mm > most_mm);
    let wide = wide.filter_map(|(layer, bridge)| {
        let below = outlines.get((layer as usize).checked_sub(1)?)?;
        let over = intersection(&bridge.ground, below);
        let area_mm2 = |regions: &[Region]| regions.iter().map(Region::area_mm2).sum::<f64>();
        let ground = bridge.ground.first()?;
        let Box2 { min, max } = ground.bounds();
        Some(WideSpan {
            layer,
            span_mm: bridge.span_mm,
            at: nalgebra::center(&min, &max),
            is_roof: 2.0 * area_mm2(&over) > area_mm2(&bridge.ground),
        })
    });
    wide.collect()
}

/// The density of a sparse infill whose lines are as far from each other as a bridge may span, and the longest of the
/// roofs that need it; `None` where the infill is dense enough for all of them, or empty.
pub fn denser(outlines: &[&[Region]], settings: &Settings) -> Option<(f64, WideSpan)> {
    let hollow = Hollow::of(outlines, settings)?;
    let most_mm = settings.longest_bridge_mm();
    if hollow.gap_mm()? <= most_mm * (1.0 + SPAN_SLACK) {
        return None;
    }
    let layers = (0..outlines.len()).into_par_iter();
    let wide = layers.flat_map_iter(|layer| {
        let bridges = hollow.bridges(layer);
        let numbered = bridges.iter().map(|bridge| (layer as u32, bridge));
        wide_spans(outlines, numbered, settings)
    });
    let wide: Vec<WideSpan> = wide.filter(|span| span.is_roof).collect();
    let longest = wide.into_iter();
    let longest = longest.reduce(|p, q| if q.span_mm > p.span_mm { q } else { p })?;
    Some((
        pct_or_pitch((most_mm + hollow.bead_mm) / hollow.bead_mm),
        longest,
    ))
}

impl<'a> Hollow<'a> {
    /// `None` if the infill is dense enough, or there is none.
    pub fn of(outlines: &'a [&'a [Region]], settings: &Settings) -> Option<Hollow<'a>> {
        let infill = settings.infill?;
        let bead_mm = 2.0 * settings.aperture.major_mm();
        Hollow::is_sparse(infill.density_pct).then_some(Hollow {
            outlines,
            known: vec![KnownLayer::default(); outlines.len()],
            infill,
            shells: shell_layers(&infill),
            walls_mm: f64::from(infill.walls) * bead_mm,
            walls_min_mm: 2.0 * f64::from(infill.walls) * settings.aperture.minor_mm(),
            bead_mm,
            reach_mm: settings.aperture.major_mm(),
            span_max_mm: settings.longest_bridge_mm(),
        })
    }

    /// True if a density leaves lines too far apart to be lain on as they are.
    fn is_sparse(density_pct: f64) -> bool {
        pct_or_pitch(density_pct) > PITCH_BEADS_MAX
    }

    /// Between the beads of the infill; `None` without any.
    fn gap_mm(&self) -> Option<f64> {
        let pct = self.infill.density_pct;
        (pct > 0.0).then(|| self.bead_mm * (pct_or_pitch(pct) - 1.0))
    }

    /// The gap, where a bridge may be so long.
    fn gap_to_span_mm(&self) -> Option<f64> {
        let most_mm = self.span_max_mm * (1.0 + SPAN_SLACK);
        self.gap_mm().filter(|gap_mm| *gap_mm <= most_mm)
    }

    /// What a layer lays over open space and over the lines of the infill below it.
    pub fn bridges(&self, layer: usize) -> Vec<Bridge> {
        let Some([own, below]) = self.pair(layer) else {
            return Vec::new();
        };
        let mut found = bridges(&own, &below, self.reach_mm);
        let Some(gap_mm) = self.gap_to_span_mm() else {
            return found;
        };
        let lines_below = self.sparse(layer - 1);
        // Over lines that are nearer to each other than the walls they are the anchors.
        found.retain(|bridge| {
            let mut in_air = difference(&bridge.ground, &lines_below);
            in_air.retain(|piece| is_wide(piece, self.reach_mm));
            bridge.span_mm <= gap_mm || !in_air.is_empty()
        });
        let whole = intersection(&open_space(&own, &below, self.reach_mm), &lines_below);
        let taken: Vec<Region> = found.iter().flat_map(|b| b.ground.clone()).collect();
        let mut ground = match taken.is_empty() {
            true => whole,
            false => difference(&whole, &taken),
        };
        ground.retain(|piece| is_wide(piece, self.reach_mm));
        if !ground.is_empty() {
            found.push(Bridge {
                ground,
                angle_rad: self.infill.inside(layer as u32).angle_rad,
                span_mm: gap_mm,
                over_lines: true,
            });
        }
        found
    }

    /// True if neither of two layers has anything that the other has not, but for what is within the walls, and within
    /// this distance of the outline.
    fn is_alike(&self, one: usize, other: usize, most_mm: f64) -> bool {
        let most_mm = most_mm.min(self.walls_min_mm);
        let between = one.min(other) + 1..=one.max(other);
        let apart_mm: f64 = between.map(|layer| self.apart_mm(layer)).sum();
        apart_mm <= most_mm
    }

    /// How far a layer's outline is from that of the one below.
    fn apart_mm(&self, layer: usize) -> f64 {
        *known(&self.known[layer].apart_mm, || {
            let [own, below] = [layer, layer - 1].map(|layer| self.outlines[layer]);
            apart_mm(own, below, self.walls_min_mm).unwrap_or(f64::INFINITY)
        })
    }

    /// The part of a layer inside the walls that is not solid.
    fn sparse(&self, layer: usize) -> Vec<Region> {
        difference(self.inside(layer), self.solid(layer))
    }

    /// The solid area of a layer, including walls and overhangs, and the area of the one below that
    /// supports it; `None` on the lowest layer, and if both have the same interior, or one that differs by less than beads
    /// reach.
    fn pair(&self, layer: usize) -> Option<[Vec<Region>; 2]> {
        let below = layer.checked_sub(1)?;
        let [solid, solid_below] = [layer, below].map(|layer| self.solid(layer));
        let (own, under) = (self.outlines[layer], self.outlines[below]);
        if own == under && solid == solid_below {
            return None;
        }
        let is_hollow = solid.is_empty() && solid_below.is_empty();
        if is_hollow && self.is_alike(layer, below, self.reach_mm) {
            return None;
        }
        let sparse = difference(self.inside(layer), solid);
        let sparse = intersection(&sparse, under);
        let sparse_below = difference(self.inside(below), solid_below);
        Some([difference(own, &sparse), difference(under, &sparse_below)])
    }

    /// Solid area of a layer over nothing, farther from its support than beads reach: parts wider than a
    /// bead.
    pub fn unheld(&self, layer: usize) -> Vec<Region> {
        let Some([own, mut below]) = self.pair(layer) else {
            return Vec::new();
        };
        if self.gap_to_span_mm().is_some() {
            below = self.outlines[layer - 1].to_vec();
        }
        let mut open = difference(&own, &grown(&below, self.reach_mm));
        open.retain(|piece| is_wide(piece, self.bead_mm));
        open
    }

    /// What of a layer inside the walls is solid, and some of what is not inside them.
    pub fn solid(&self, layer: usize) -> &[Region] {
        known::<Vec<Region>>(&self.known[layer].solid, || {
            let is_alike = |other: usize| self.is_alike(layer, other, self.walls_min_mm);
            exposed_ground(self.outlines, layer, self.shells, is_alike)
        })
    }

    /// What the walls leave of a layer.
    fn inside(&self, layer: usize) -> &[Region] {
        known::<Vec<Region>>(&self.known[layer].inside, || {
            inside_walls(self.outlines[layer], self.walls_mm, self.bead_mm)
        })
    }
}

/// What walls of this width leave of an outline; `bead_mm` that of a bead.
fn inside_walls(outline: &[Region], walls_mm: f64, bead_mm: f64) -> Vec<Region> {
    let corners: Vec<Point2> = outline
        .iter()
        .map(Region::bounds)
        .flat_map(|bounds| [bounds.min, bounds.max])
        .collect();
    if corners.is_empty() {
        return Vec::new();
    }
    let Box2 { min, max } = Box2::of(&corners).grown(2.0 * walls_mm + bead_mm);
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
    difference(outline, &grown(&outside, walls_mm))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::region;
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

    fn area_mm2(regions: &[Region]) -> f64 {
        regions.iter().map(Region::area_mm2).sum()
    }

    fn square(side: f64) -> [Region; 1] {
        [region(&[&[
            [0.0, 0.0],
            [side, 0.0],
            [side, side],
            [0.0, side],
        ]])]
    }

    fn with(density_pct: f64, bridge_max_mm: Option<f64>) -> Settings {
        Settings {
            infill: Some(Infill {
                density_pct,
                bottom_layers: Some(2),
                top_layers: Some(2),
                ..Infill::solid(2)
            }),
            bridge_max_mm,
            ..Settings::default()
        }
    }

    /// Goal: the first solid layer over a sparse inside is bridged, the shorter way: from wall to wall, or across lines
    /// that are nearer; those above and below it are not. Method: a box of 20 mm of eight layers, two of them solid at
    /// either end; areas, spans and directions by hand.
    #[test]
    fn a_roof_goes_the_shorter_way() {
        let own = square(20.0);
        let outlines = [own.as_slice(); 8];
        // Two walls of 1.2 mm leave 15.2 mm; lines of 15 % are 8 mm apart, less a bead; layer 6 lies across layer 5.
        let across_rad = FRAC_PI_4;
        for (density_pct, span_mm, is_across) in [
            (0.0, 15.2, false),
            (5.0, 15.2, false),
            (15.0, 6.8, true),
            (20.0, 4.8, true),
        ] {
            let settings = with(density_pct, None);
            let hollow = Hollow::of(&outlines, &settings).expect("hollow");
            for layer in 0..8 {
                let spans = hollow.bridges(layer);
                if layer != 6 {
                    assert_eq!(spans, [], "{layer}");
                    assert_eq!(area_mm2(&hollow.unheld(layer)), 0.0);
                    continue;
                }
                assert_eq!(spans.len(), 1, "{density_pct}: {spans:?}");
                let bridged_mm2 = area_mm2(&spans[0].ground);
                assert!((bridged_mm2 - 15.2 * 15.2).abs() < 0.1, "{bridged_mm2}");
                let found_mm = spans[0].span_mm;
                assert!(
                    (found_mm - span_mm).abs() < 0.01,
                    "{density_pct}: {found_mm}"
                );
                let off_rad = (spans[0].angle_rad - across_rad).rem_euclid(FRAC_PI_2);
                let is_diagonal = off_rad.min(FRAC_PI_2 - off_rad) < 1e-9;
                assert_eq!(is_diagonal, is_across, "{density_pct}");
                if is_across {
                    let lines_rad = settings.infill.expect("lines").inside(5).angle_rad;
                    let turn_rad = (spans[0].angle_rad - lines_rad).rem_euclid(PI);
                    assert!((turn_rad - FRAC_PI_2).abs() < 1e-9);
                }
            }
            assert_eq!(denser(&outlines, &settings), None);
        }
        assert!(Hollow::of(&outlines, &with(50.0, None)).is_none());
    }

    /// Goal: lines farther apart than a bridge may span are put as near as that where a roof needs it, and there only;
    /// over an empty inside what spans more is told. Method: boxes of 60 mm and 20 mm; spans by hand.
    #[test]
    fn lines_are_as_near_as_a_bridge_may_span() {
        let (wide, small) = (square(60.0), square(20.0));
        let wide = [wide.as_slice(); 8];
        let small = [small.as_slice(); 8];
        // 25 beads of 1.2 mm are allowed, walls leave 55.2 mm.
        let (density_pct, longest) = denser(&wide, &with(2.0, None)).expect("denser");
        assert!(
            (density_pct - 100.0 * 1.2 / 31.2).abs() < 1e-9,
            "{density_pct}"
        );
        assert_eq!((longest.layer, longest.is_roof), (6, true));
        assert!((longest.span_mm - 55.2).abs() < 0.01, "{longest:?}");
        assert_eq!(denser(&small, &with(2.0, None)), None);
        assert_eq!(denser(&wide, &with(4.0, None)), None);
        assert!(denser(&small, &with(5.0, Some(10.0))).is_some());
        assert_eq!(denser(&wide, &with(0.0, None)), None);
        let told = |density_pct: f64| {
            let settings = with(density_pct, None);
            let bridges = bridges_of(Hollow::of(&wide, &settings).as_ref(), &wide, 6, &settings);
            wide_spans(&wide, bridges.iter().map(|bridge| (6, bridge)), &settings)
        };
        let empty = told(0.0);
        assert_eq!(empty.len(), 1);
        assert!((empty[0].span_mm - 55.2).abs() < 0.01 && empty[0].is_roof);
        assert_eq!(told(density_pct), []);
    }
}

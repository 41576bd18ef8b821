//! The floor of coverage: where a region falls below it, gaps are filled at a higher price.
//!
//! In: the passes as they are joined, the region's walls. Out: the same with shortcuts; where too
//! little of what the aperture reaches is covered then, with fine ones, and gap-fill moves added
//! until enough is; where that does not do, without shortcuts. A fixed price leaves regions of many
//! small corners more open than a printer would have them.

use super::shortened;
use crate::geometry::Point2;
use crate::geometry::aperture::Aperture;
use crate::geometry::coverage::Cell;
use crate::geometry::edge_index::EdgeIndex;
use crate::plan::coverage::raster::{same_bead_mm, within_walls};
use crate::plan::joining::gap_fill::fill_gaps;
use crate::plan::outline::reachable::reachable_count;
use crate::plan::pass::LayerPass;
use crate::plan::pose_limits::AreaPrice;
use crate::settings::{Quality, Settings};

/// Prices against the settings' own, one after the other until the floor holds.
const PRICES: [f64; 3] = [1.7, 3.0, 6.0];
/// Ground at a part's corners that the curve opens after the floor was counted on placements, mm²:
/// of a large region it is little, of one of 4 mm² one per cent. Less opens parts of a few mm²
/// below the floor.
const ROUNDED_MM2: f64 = 0.04;
/// Highest floor on placements: more is not to be had on parts as small as the aperture.
const FLOOR_SHARE_MAX: f64 = 0.99;
/// Most cells of the raster on which coverage is counted.
const CELLS_MAX: usize = 1_000_000;
/// Open places of which it is asked whether the aperture reaches them.
const ASKED_MAX: usize = 2000;

/// Replaces stretches of the passes within `walls`, which bound `area_mm2`, by shortcuts: fewer of
/// them and gap-fill moves besides where the quality's floor would not hold. `may_fill` is false
/// where ground is meant to stay open.
pub fn shortened_to_floor(
    passes: Vec<LayerPass>,
    walls: &EdgeIndex,
    area_mm2: f64,
    may_fill: bool,
    settings: &Settings,
) -> Vec<LayerPass> {
    let aperture = &settings.aperture;
    let rounded_share = ROUNDED_MM2 / area_mm2.max(ROUNDED_MM2);
    let floor_share = (settings.quality.floor_share() + rounded_share).min(FLOOR_SHARE_MAX);
    let holds = |passes: &[LayerPass]| !may_fill || covers(passes, walls, aperture, floor_share);
    let mut short = passes.clone();
    shortened(&mut short, walls, area_mm2, settings);
    if holds(&short) {
        return short;
    }
    let mut short = passes.clone();
    let fine = Settings {
        quality: Quality::Fine,
        ..settings.clone()
    };
    shortened(&mut short, walls, area_mm2, &fine);
    let price = AreaPrice::of(settings);
    for factor in PRICES {
        if holds(&short) {
            break;
        }
        fill_gaps(&mut short, aperture, walls, Some(&price.times(factor)));
    }
    if holds(&short) {
        return short;
    }
    // What shortcuts opened here is not to be filled again: none of them then.
    let mut whole = passes;
    fill_gaps(&mut whole, aperture, walls, None);
    whole
}

/// True where the passes cover this share of what the aperture reaches within the walls.
fn covers(passes: &[LayerPass], walls: &EdgeIndex, aperture: &Aperture, least: f64) -> bool {
    let raster = within_walls(passes, walls, aperture, CELLS_MAX, same_bead_mm(aperture));
    let open = raster.count(Cell::Gap);
    let covered = (raster.count(Cell::Covered) + raster.count(Cell::Overlap)) as f64;
    if open == 0 || covered >= least * (covered + open as f64) {
        return true;
    }
    let asked: Vec<Point2> = raster.gaps().step_by(open.div_ceil(ASKED_MAX)).collect();
    let reached = reachable_count(aperture, &asked, walls) as f64 / asked.len() as f64;
    covered >= least * (covered + open as f64 * reached)
}

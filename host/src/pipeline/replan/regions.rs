//! Beads of a layer of a sliced file -> regions that are planned anew, and runs of beads that stay lines.
//!
//! ```text
//! passes --levels--> beads --loops--> outlines --swept ground inside them--> regions, and the beads of each
//! (mm, mm³)         (mm)              (mm)                                   (mm, mm³)
//! ```
//! In: the passes of one layer in the file's coordinates. Out: [`Parts`]. Walls, solid infill and what fills gaps between
//! them are one region: bounded by the centre lines of the outer walls, moved outwards by half a width with sharp corners,
//! and where beads of another kind follow, by what its own beads sweep. Leaves out how it is planned, and whether that pays.

use super::loops::outline;
use crate::gcode::comments::Slicer;
use crate::gcode::{BeadKind, GcodePass, Push};
use crate::geometry::Point2;
use crate::geometry::boolean::{difference, filled, intersection, mitred, moved, swept};
use crate::geometry::polygon::{Box2, Region};
use crate::geometry::repair::FillRule;
use std::collections::BTreeMap;

/// Voids between beads of up to this radius, in mean widths of them, belong to the region: slicers leave them at turns of
/// lines.
const VOID_WIDTHS: f64 = 0.36;
/// Regions that are nowhere as wide as so many of their beads stay lines.
const DETAIL_WIDTHS: f64 = 1.1;
/// Lines of an infill are solid where a disk of this share of their width fits into what they sweep without its voids: a
/// single line has half.
const SOLID_SHARE: f64 = 0.75;
/// Side of the least square of solid lines, in their widths: crossings of single lines are smaller.
const SOLID_WIDTHS: f64 = 5.0;
/// What the beads of a region lay, as a share of its area times its height: beyond this it is not the ground that they fill.
const VOLUME_SHARES: [f64; 2] = [0.85, 1.15];
/// Ends of a bead at different heights: it rises.
pub(super) const LEVEL_MM: f64 = 1e-3;
/// Widths of beads that are swept together.
const WIDTH_STEP_MM: f64 = 0.01;
/// What a bead of round sides is narrower at its mean than at its middle, as a share of its height: 1 - pi / 4.
const ROUND_SHARE: f64 = 0.215;

/// Beads in one pass of the file.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// Number of the pass in the file.
    pub number: usize,
    /// Its first leg there, and the one behind its last.
    pub legs: [usize; 2],
    /// It begins and ends with its pass of the file.
    pub is_whole: [bool; 2],
    /// The beads.
    pub pass: GcodePass,
}

/// A region and the beads that fill it in the file.
#[derive(Clone, Debug)]
pub struct Ground {
    /// Its outline, file coordinates.
    pub region: Region,
    /// Around it.
    pub bounds: Box2,
    /// Tip height.
    pub z_mm: f64,
    /// Height of its beads.
    pub height_mm: f64,
    /// What they lay.
    pub volume_mm3: f64,
    /// Share of its area that they cover, at the widths that their volume has.
    pub covered_pct: f64,
    /// Mean tip speeds of the outer walls and of the others.
    pub speeds_mm_s: [f64; 2],
    /// How far from the outline the outer walls reach; the beads where it has none.
    pub wall_mm: f64,
    /// They, in order.
    pub runs: Vec<Run>,
}

/// What a layer has.
#[derive(Clone, Debug, Default)]
pub struct Parts {
    /// Regions that may be planned anew.
    pub grounds: Vec<Ground>,
    /// Beads that stay lines, in the file's order.
    pub kept: Vec<Run>,
}

/// A straight bead.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bead {
    /// Pass of the layer, and leg of it.
    pub pass: usize,
    pub leg: usize,
    pub ends: [Point2; 2],
    pub width_mm: f64,
    pub kind: BeadKind,
    z_mm: f64,
    height_mm: f64,
    volume_mm3: f64,
    speed_mm_s: f64,
    is_level: bool,
}

/// The parts of a layer's passes, the first of which has this number in the file.
pub fn parts(passes: &[GcodePass], first_pass: usize, slicer: Slicer) -> Parts {
    let beads = beads(passes, slicer);
    let mut levels: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
    for (number, bead) in beads.iter().enumerate().filter(|(_, bead)| bead.is_level) {
        let level = (bead.z_mm / LEVEL_MM).round() as i64;
        levels.entry(level).or_default().push(number);
    }
    let mut grounds_of: Vec<Option<usize>> = vec![None; beads.len()];
    let mut grounds: Vec<Ground> = Vec::new();
    for of_level in levels.values() {
        let level: Vec<Bead> = of_level.iter().map(|number| beads[*number]).collect();
        let mut is_filling = filling(&level);
        let mut found = regions(&level, &is_filling);
        if fill_holes(&found, &level, &mut is_filling) {
            found = regions(&level, &is_filling);
        }
        for region in found {
            let is_own = |own: &usize| is_filling[*own] && region.contains(level[*own].middle());
            let own: Vec<usize> = (0..level.len()).filter(is_own).collect();
            let its: Vec<Bead> = own.iter().map(|own| level[*own]).collect();
            let Some(ground) = ground(region, &its) else {
                continue;
            };
            for own in own {
                grounds_of[of_level[own]] = Some(grounds.len());
            }
            grounds.push(ground);
        }
    }
    let mut kept = Vec::new();
    let numbered: Vec<usize> = (0..beads.len()).collect();
    let is_one =
        |a: &usize, b: &usize| beads[*a].pass == beads[*b].pass && grounds_of[*a] == grounds_of[*b];
    for run in numbered.chunk_by(is_one) {
        let ends = [&beads[run[0]], &beads[run[run.len() - 1]]];
        let own = run_of(passes, first_pass, ends);
        match grounds_of[run[0]] {
            Some(number) => grounds[number].runs.push(own),
            None => kept.push(own),
        }
    }
    Parts { grounds, kept }
}

impl Bead {
    fn middle(&self) -> Point2 {
        nalgebra::center(&self.ends[0], &self.ends[1])
    }

    /// Follows another in the same pass.
    pub(super) fn follows(&self, before: &Bead) -> bool {
        self.pass == before.pass && self.leg == before.leg + 1
    }
}

/// Why a bead that fills no region stays a line.
pub fn why(kind: BeadKind, is_level: bool) -> &'static str {
    match kind {
        _ if !is_level => "they rise along their length",
        BeadKind::Overhang | BeadKind::Bridge => "they span open space",
        BeadKind::FuzzyWall => "they are rough on purpose",
        BeadKind::Sparse => "there is room between them",
        BeadKind::Support => "they come off the part",
        BeadKind::Skirt => "they are beside the part",
        BeadKind::Ironing => "they lie on ground that is filled",
        BeadKind::Unknown => "the file does not say what they are",
        BeadKind::OuterWall | BeadKind::Wall | BeadKind::Solid => {
            "no region is as fine as they are"
        }
    }
}

fn beads(passes: &[GcodePass], slicer: Slicer) -> Vec<Bead> {
    let mut beads = Vec::new();
    for (number, pass) in passes.iter().enumerate() {
        for (k, (pair, leg)) in pass.points.windows(2).zip(&pass.legs).enumerate() {
            let ends = [0, 1].map(|i| Point2::new(pair[i].tip_mm[0], pair[i].tip_mm[1]));
            let [from_mm, to_mm] = [0, 1].map(|i| pair[i].tip_mm[2]);
            let length_mm = (ends[1] - ends[0]).norm();
            let height_mm = leg.height_mm.unwrap_or(0.0);
            let width_mm = leg.bead_mm(length_mm, height_mm, slicer).unwrap_or(0.0);
            let is_bead = height_mm > 0.0 && length_mm > 0.0 && width_mm > 0.0;
            beads.push(Bead {
                pass: number,
                leg: k,
                ends,
                width_mm,
                kind: leg.kind,
                z_mm: to_mm,
                height_mm,
                volume_mm3: leg.volume_mm3.unwrap_or(0.0),
                speed_mm_s: leg.speed_mm_s,
                is_level: is_bead && width_mm.is_finite() && is_level(from_mm, to_mm),
            });
        }
    }
    beads
}

/// True for ends of a bead that does not rise.
pub fn is_level(from_mm: f64, to_mm: f64) -> bool {
    (to_mm - from_mm).abs() < LEVEL_MM
}

/// Which beads of a level fill ground: walls and solid infill, and lines of an infill that lie as close as their widths.
fn filling(level: &[Bead]) -> Vec<bool> {
    let is_sparse = |bead: &Bead| bead.kind == BeadKind::Sparse;
    let sparse: Vec<Bead> = level.iter().copied().filter(is_sparse).collect();
    let solid = match sparse.iter().map(|bead| bead.width_mm).reduce(f64::max) {
        None => Vec::new(),
        Some(width_mm) => {
            let least_mm = SOLID_SHARE * width_mm;
            let void_mm = VOID_WIDTHS * mean_width_mm(&sparse);
            let closed = moved(&sweep(&sparse, |bead| bead.width_mm, false), void_mm);
            let mut solid = moved(&moved(&closed, -void_mm - least_mm), least_mm + void_mm);
            let least_mm2 = (SOLID_WIDTHS * width_mm).powi(2);
            solid.retain(|region| region.area_mm2() > least_mm2);
            solid
        }
    };
    let fills = |bead: &Bead| match bead.kind {
        BeadKind::OuterWall | BeadKind::Wall | BeadKind::Solid => true,
        BeadKind::Sparse => {
            let all = [bead.ends[0], bead.middle(), bead.ends[1]];
            let is_in = |p: &Point2| solid.iter().any(|region| region.contains(*p));
            all.iter().all(is_in)
        }
        _ => false,
    };
    level.iter().map(fills).collect()
}

/// Counts the lines of an infill that fill a hole as its region's; true where there are any.
fn fill_holes(found: &[Region], level: &[Bead], is_filling: &mut [bool]) -> bool {
    let mut is_changed = false;
    let open: Vec<usize> = (0..level.len())
        .filter(|number| !is_filling[*number] && level[*number].kind == BeadKind::Sparse)
        .collect();
    let holes = found.iter().flat_map(|region| &region.holes);
    for hole in holes.filter(|_| !open.is_empty()) {
        let region = Region {
            exterior: hole.clone(),
            holes: Vec::new(),
        };
        let bounds = region.bounds();
        let is_in = |number: &&usize| {
            let middle = level[**number].middle();
            bounds.contains(middle) && region.contains(middle)
        };
        let its: Vec<usize> = open.iter().filter(is_in).copied().collect();
        let volume_mm3: f64 = its.iter().map(|number| level[*number].volume_mm3).sum();
        let height_mm = its.first().map_or(1.0, |number| level[*number].height_mm);
        let share = volume_mm3 / (hole.signed_area_mm2().abs() * height_mm);
        if share >= VOLUME_SHARES[0] {
            its.iter().for_each(|number| is_filling[*number] = true);
            is_changed = true;
        }
    }
    is_changed
}

/// Mean width of beads by their lengths; zero without any.
fn mean_width_mm(beads: &[Bead]) -> f64 {
    let sums = beads.iter().fold([0.0, 0.0], |[mm2, mm], bead| {
        let length_mm = (bead.ends[1] - bead.ends[0]).norm();
        [mm2 + length_mm * bead.width_mm, mm + length_mm]
    });
    sums[0] / sums[1].max(f64::MIN_POSITIVE)
}

/// What beads sweep, each at a width.
fn sweep(beads: &[Bead], width_mm: impl Fn(&Bead) -> f64, is_cut_at_ends: bool) -> Vec<Region> {
    let mut lines: BTreeMap<i64, Vec<Vec<Point2>>> = BTreeMap::new();
    let mut last: Option<(&Bead, i64)> = None;
    for bead in beads {
        let width = (width_mm(bead) / WIDTH_STEP_MM).round() as i64;
        let of_width = lines.entry(width).or_default();
        match (last, of_width.last_mut()) {
            (Some((before, same)), Some(line)) if same == width && bead.follows(before) => {
                line.push(bead.ends[1]);
            }
            _ => of_width.push(bead.ends.to_vec()),
        }
        last = Some((bead, width));
    }
    let lines = lines.iter().filter(|(width, _)| **width > 0);
    let all: Vec<Region> = lines
        .flat_map(|(width, lines)| swept(lines, *width as f64 * WIDTH_STEP_MM, is_cut_at_ends))
        .collect();
    filled(all.iter().flat_map(Region::rings), FillRule::NonZero)
}

/// The regions of a level that its beads fill.
fn regions(level: &[Bead], is_filling: &[bool]) -> Vec<Region> {
    let of = |wanted: &dyn Fn(usize) -> bool| -> Vec<Bead> {
        let numbers = (0..level.len()).filter(|number| wanted(*number));
        numbers.map(|number| level[number]).collect()
    };
    let its = of(&|number| is_filling[number]);
    let void_mm = VOID_WIDTHS * mean_width_mm(&its);
    let all = sweep(&its, |bead| bead.width_mm, false);
    if all.is_empty() {
        return all;
    }
    let outline = outline(level);
    // Corners, which round beads leave out.
    let rims = difference(&outline, &mitred(&outline, -void_mm));
    let union = |parts: &[&[Region]]| {
        let parts = parts.iter().flat_map(|part| part.iter());
        filled(parts.flat_map(Region::rings), FillRule::NonZero)
    };
    let closed = moved(&moved(&union(&[&all, &rims]), void_mm), -void_mm);
    let inside = intersection(&closed, &outline);
    // Walls that are no loops.
    let open = difference(&all, &moved(&outline, void_mm));
    let found = match open.is_empty() {
        true => inside,
        false => union(&[
            &inside,
            &intersection(&closed, &moved(&open, 2.0 * void_mm)),
        ]),
    };
    let hanging = of(&|number| level[number].kind == BeadKind::Overhang);
    match hanging.is_empty() {
        true => found,
        false => difference(&found, &sweep(&hanging, |bead| bead.width_mm, true)),
    }
}

/// A region with the beads that fill it; `None` where it is too narrow, or not what they fill.
fn ground(region: Region, beads: &[Bead]) -> Option<Ground> {
    let own = std::slice::from_ref(&region);
    let (area_mm2, height_mm) = (region.area_mm2(), beads.first()?.height_mm);
    let volume_mm3: f64 = beads.iter().map(|bead| bead.volume_mm3).sum();
    let share = volume_mm3 / (area_mm2 * height_mm);
    let detail_mm = DETAIL_WIDTHS * mean_width_mm(beads);
    let is_filled = (VOLUME_SHARES[0]..=VOLUME_SHARES[1]).contains(&share);
    if !is_filled || moved(own, -0.5 * detail_mm).is_empty() {
        return None;
    }
    let mean_mm = |bead: &Bead| bead.width_mm - ROUND_SHARE * bead.height_mm;
    let covered = intersection(&sweep(beads, mean_mm, false), own);
    let covered_mm2: f64 = covered.iter().map(Region::area_mm2).sum();
    let is_outer = |bead: &&Bead| bead.kind == BeadKind::OuterWall;
    let speed_mm_s = |wanted: bool| {
        let its = beads.iter().filter(|bead| is_outer(bead) == wanted);
        let (mm, s) = its.fold((0.0, 0.0), |(mm, s), bead| {
            let length_mm = (bead.ends[1] - bead.ends[0]).norm();
            (mm + length_mm, s + length_mm / bead.speed_mm_s)
        });
        (s > 0.0).then_some(mm / s)
    };
    let speeds_mm_s = match [speed_mm_s(true), speed_mm_s(false)] {
        [Some(outer), Some(others)] => [outer, others],
        [outer, others] => [outer.or(others)?; 2],
    };
    let has_outer = beads.iter().any(|bead| is_outer(&bead));
    let walls = beads.iter().filter(|bead| !has_outer || is_outer(bead));
    let walls_mm = walls.map(|bead| bead.width_mm);
    Some(Ground {
        z_mm: beads[0].z_mm,
        height_mm,
        volume_mm3,
        covered_pct: 100.0 * covered_mm2 / area_mm2,
        speeds_mm_s,
        wall_mm: walls_mm.fold(0.0, f64::max),
        runs: Vec::new(),
        bounds: region.bounds(),
        region,
    })
}

/// The beads of a pass from one to another. Where it is cut, the nozzle retracts and primes as the machine does.
fn run_of(passes: &[GcodePass], first_pass: usize, [first, last]: [&Bead; 2]) -> Run {
    let pass = &passes[first.pass];
    let is_whole = [first.leg == 0, last.leg + 1 == pass.legs.len()];
    let own = Some(Push::default());
    Run {
        number: first_pass + first.pass,
        legs: [first.leg, last.leg + 1],
        is_whole,
        pass: GcodePass {
            layer: pass.layer,
            travel: if is_whole[0] {
                pass.travel.clone()
            } else {
                Vec::new()
            },
            travel_legs: Vec::new(),
            points: pass.points[first.leg..=last.leg + 1].to_vec(),
            legs: pass.legs[first.leg..=last.leg].to_vec(),
            prime: if is_whole[0] { pass.prime } else { own },
            retract: if is_whole[1] { pass.retract } else { own },
        },
    }
}

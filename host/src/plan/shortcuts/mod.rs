//! Shortcuts: stretches of the finished chain replaced by smoother ones that are printed sooner.
//!
//! ```text
//! LayerPass --even steps--> Chain --windows--> Shortcut --worth its ground?--> LayerPass
//!  (mm, rad)                (mm, rad, 1/s²)    (s, mm²)                        (mm, rad)
//! ```
//!
//! Beads are laid where they cover best; what that costs in time shows only where they are joined. Here,
//! after ordering and before the layer path, windows of the chain are replaced by smoother ones
//! (shortcutting; Hauser and Ng-Thow-Hing, "Fast Smoothing of Manipulator Trajectories using Optimal
//! Bounded-Acceleration Shortcuts", ICRA 2010) where the seconds saved are worth more than the ground that is
//! left open or laid twice, by one price ([`crate::settings::Quality`]). Windows of a batch are searched side
//! by side against the same state and taken in their order, each one's ground counted again: what comes out
//! does not depend on threads. Round nozzles have no heading to smooth and are left as they are.

mod chain;
mod floor;
mod local_time;
mod smoothing;
mod window;

use self::chain::{Chain, swept_poses};
pub use self::floor::shortened_to_floor;
use self::local_time::step_s;
use self::window::{Scratch, Shortcut, ShortcutSearch, swept_range};
use crate::geometry::clearance::Configuration;
use crate::geometry::edge_index::EdgeIndex;
use crate::plan::coverage::raster::{Raster, same_bead_mm};
use crate::plan::pass::LayerPass;
use crate::plan::pose_limits::PoseLimits;
use crate::settings::{Quality, Settings};
use rayon::prelude::*;
use std::ops::Range;

/// Raster cell against the minor semi-axis: 0.03 mm for 0.2 mm.
const CELL_SHARE: f64 = 0.15;
/// Most cells: larger parts get larger ones.
const CELLS_MAX: usize = 12_000_000;
/// Lengths of the windows against the time that the heading takes to turn by a radian from rest to
/// rest: 0.1 and 0.26 s on the built-in machine.
const WINDOWS: [f64; 2] = [0.8, 2.0];
/// Rounds over all lengths.
const ROUNDS: usize = 2;
/// Windows of one length begin so many times as often as they are long.
const PHASES: usize = 3;
/// Step of the poses, against a: 0.2 mm for 0.6 mm. Half of it covers 0.2 % more and takes 15 % longer.
const STEP_SHARE: f64 = 1.0 / 3.0;
/// The same at fine quality.
const STEP_SHARE_FINE: f64 = 1.0 / 6.0;
/// What a turn by a radian counts as, against a.
const TURN_SHARE: f64 = 1.2;
/// Most poses of a window.
const POSES_MAX: usize = 160;
/// Least poses of one.
const POSES_MIN: usize = 7;
/// Least placements of a pass that is looked at.
const PLACEMENTS_MIN: usize = 12;

/// Replaces stretches of the passes within `walls`, which bound `area_mm2`, by shortcuts. Where these would
/// open more than the quality allows, the price is raised.
fn shortened(passes: &mut [LayerPass], walls: &EdgeIndex, area_mm2: f64, settings: &Settings) {
    let aperture = &settings.aperture;
    let limits = PoseLimits::of(settings);
    if aperture.is_round() {
        return;
    }
    let step_share = match settings.quality {
        Quality::Fine => STEP_SHARE_FINE,
        Quality::Standard | Quality::Fast => STEP_SHARE,
    };
    let (step_mm, turn_mm) = (
        step_share * aperture.major_mm(),
        TURN_SHARE * aperture.major_mm(),
    );
    let long = passes
        .iter_mut()
        .filter(|pass| pass.placements.len() >= PLACEMENTS_MIN);
    let mut long: Vec<&mut LayerPass> = long.collect();
    let chains = long
        .par_iter()
        .map(|pass| Chain::of(pass, step_mm, turn_mm));
    let mut chains: Vec<Chain> = chains.collect();
    let mut raster = Raster::over(&walls.bounds(), aperture, CELL_SHARE, CELLS_MAX);
    for chain in &chains {
        let mut poses = Vec::new();
        swept_poses(&chain.poses, 0..chain.poses.len(), &mut poses);
        raster.add(&poses);
    }
    let price_s_mm2 = settings.quality.price_s_mm2();
    let mut left_mm2 = settings.quality.shortcut_share() * area_mm2;
    let mut search = ShortcutSearch {
        aperture,
        walls,
        limits: &limits,
        price_s_mm2,
        return_mm: same_bead_mm(aperture),
    };
    let radian_s = limits.rest_to_rest_s(0.0, 1.0);
    for round in 0..ROUNDS {
        let batches = WINDOWS
            .iter()
            .flat_map(|window| (0..PHASES).map(move |phase| (window * radian_s, phase)));
        for (window_s, phase) in batches {
            let phase = (phase as f64 + 0.5 * (round % 2) as f64) / PHASES as f64;
            chains.par_iter_mut().for_each(|chain| chain.time(&limits));
            let found = found(&search, &chains, &raster, window_s, phase);
            search.price_s_mm2 = search.price_s_mm2.max(price_within(&found, left_mm2));
            left_mm2 -= take(found, &search, &mut chains, &mut raster);
        }
    }
    for (pass, chain) in long.iter_mut().zip(&chains) {
        pass.placements = chain.placements();
    }
}

/// The shortcuts of all windows of one length, in the order of the chains and along them.
fn found(
    search: &ShortcutSearch,
    chains: &[Chain],
    raster: &Raster,
    window_s: f64,
    phase: f64,
) -> Vec<Shortcut> {
    let windows = chains.iter().enumerate().flat_map(|(number, chain)| {
        let windows = windows(chain, window_s, phase).into_iter();
        windows.map(move |range| (number, range))
    });
    let windows: Vec<(usize, Range<usize>)> = windows.collect();
    let windows = windows.into_par_iter();
    windows
        .map_init(Scratch::default, |scratch, (number, range)| {
            search.best(chains, raster, number, range, scratch)
        })
        .flatten()
        .collect()
}

/// The poses of windows of this length, one behind the other; the first begins after a share of it.
fn windows(chain: &Chain, window_s: f64, phase: f64) -> Vec<Range<usize>> {
    let mut windows = Vec::new();
    let (mut first, mut left_s) = (0, phase * window_s);
    for i in 1..chain.poses.len() {
        left_s -= step_s(chain.rates[i - 1], chain.rates[i]);
        let count = i + 1 - first;
        if (left_s <= 0.0 && count >= POSES_MIN) || count >= POSES_MAX {
            windows.push(first..i + 1);
            (first, left_s) = (i, window_s);
        }
    }
    if first + POSES_MIN <= chain.poses.len() {
        windows.push(first..chain.poses.len());
    }
    windows
}

/// Takes the shortcuts that still gain with those before them taken, the last of a chain first, so that
/// numbers of poses stay right. What they open, mm².
fn take(
    found: Vec<Shortcut>,
    search: &ShortcutSearch,
    chains: &mut [Chain],
    raster: &mut Raster,
) -> f64 {
    let mut opened_mm2 = 0.0;
    let mut scratch = Scratch::default();
    let mut swept: Vec<Configuration> = Vec::new();
    for shortcut in found.into_iter().rev() {
        let chain = &mut chains[shortcut.chain];
        let change = search.change_again(chain, raster, &shortcut, &mut scratch);
        if search.gain_s(shortcut.saved_s, change) <= 0.0 {
            continue;
        }
        opened_mm2 += change.opened_mm2;
        let own = swept_range(chain, &shortcut.range);
        let after = chain.poses.len() - own.end;
        swept.clear();
        swept_poses(&chain.poses, own.clone(), &mut swept);
        raster.remove(&swept);
        chain.poses.splice(shortcut.range.clone(), shortcut.poses);
        chain.contacts.splice(shortcut.range, shortcut.contacts);
        swept.clear();
        swept_poses(
            &chain.poses,
            own.start..chain.poses.len() - after,
            &mut swept,
        );
        raster.add(&swept);
    }
    opened_mm2
}

/// The price, s/mm², at which the shortcuts open no more ground than this.
fn price_within(found: &[Shortcut], most_mm2: f64) -> f64 {
    let opening = found
        .iter()
        .filter(|shortcut| shortcut.change.opened_mm2 > 0.0);
    let price = |shortcut: &Shortcut| shortcut.saved_s / shortcut.change.opened_mm2;
    let mut opening: Vec<(f64, f64)> = opening
        .map(|shortcut| (price(shortcut), shortcut.change.opened_mm2))
        .collect();
    opening.sort_by(|p, q| q.0.total_cmp(&p.0));
    let mut sum_mm2 = 0.0;
    let beyond = opening.iter().find(|(_, opened_mm2)| {
        sum_mm2 += opened_mm2;
        sum_mm2 > most_mm2
    });
    beyond.map_or(0.0, |(price_s_mm2, _)| *price_s_mm2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::clearance::is_inside;
    use crate::geometry::test_shapes::{self, ELLIPSE};
    use crate::plan::coverage::exchange::CoverageChange;
    use crate::plan::pass::test_passes::run;

    /// A bar of 20 x 1.2 mm, and a bead along it whose heading wavers by 0.2 rad every 0.8 mm.
    fn wavering() -> (EdgeIndex, LayerPass) {
        let walls = test_shapes::walls(&[&[[0.0, 0.0], [20.0, 0.0], [20.0, 1.2], [0.0, 1.2]]]);
        let mut pass = run([0.7, 0.6], [19.3, 0.6]);
        for (i, placement) in pass.placements.iter_mut().enumerate() {
            placement.at.heading_rad += 0.2 * (i as f64 * std::f64::consts::FRAC_PI_4).sin();
        }
        (walls, pass)
    }

    fn print_s(pass: &LayerPass) -> f64 {
        let mut chain = Chain::of(pass, 0.1, 0.6);
        chain.time(&PoseLimits::of(&Settings::default()));
        local_time::duration_s(&chain.rates)
    }

    /// Goal: a heading that wavers for nothing is smoothed, the bead stays inside and keeps its ends, and
    /// what comes out does not depend on threads. Method: the wavering bead on one thread and on four.
    #[test]
    fn a_wavering_heading_is_smoothed() {
        let (walls, pass) = wavering();
        let with_threads = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let mut passes = vec![pass.clone()];
            pool.expect("a pool").install(|| {
                shortened(&mut passes, &walls, 24.0, &Settings::default());
            });
            passes.remove(0)
        };
        let found = with_threads(1);
        assert_eq!(found, with_threads(4));
        assert!(
            print_s(&found) < 0.8 * print_s(&pass),
            "{} {}",
            print_s(&found),
            print_s(&pass)
        );
        for placement in &found.placements {
            assert!(
                is_inside(&ELLIPSE, placement.at, &walls, -2e-3),
                "{placement:?}"
            );
        }
        let ends =
            |pass: &LayerPass| [0, pass.placements.len() - 1].map(|i| pass.placements[i].at.center);
        for (own, before) in ends(&found).iter().zip(ends(&pass)) {
            assert!((own - before).norm() < 1e-9);
        }
    }

    /// Goal: the price holds what shortcuts open. Method: three shortcuts that open 1 mm² each for 3, 2
    /// and 1 s: two fit in 2.5 mm², all in 3.5.
    #[test]
    fn the_price_rises_where_too_much_would_open() {
        let shortcut = |saved_s: f64| Shortcut {
            chain: 0,
            range: 0..0,
            poses: Vec::new(),
            contacts: Vec::new(),
            saved_s,
            change: CoverageChange {
                opened_mm2: 1.0,
                recovered_mm2: 0.0,
            },
        };
        let found = [3.0, 1.0, 2.0].map(shortcut);
        assert_eq!(price_within(&found, 2.5), 1.0);
        assert_eq!(price_within(&found, 3.5), 0.0);
    }
}

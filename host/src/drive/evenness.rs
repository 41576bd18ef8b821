//! Unevenness of finished beads: a nozzle that spins, a bead that thins or swells, speed that falls for no limit.
//!
//! In: a finished motion, moment by moment in order. Out: by kind of fault the number of places and the worst. Beads are
//! compared window by window, each as long as the narrowest bead is wide, with the windows before and behind: a bead that
//! becomes thinner bit by bit is meant so, one that does within a window is not. Cross-sections are divided by the width
//! that the nozzle spans there; a bead beside an earlier one of its layer may be thin, since ground counts once. Not covered:
//! the ends of a pass, tools that lean.

use crate::drive::moment::Moment;
use crate::geometry::point_grid::PointGrid;
use crate::geometry::{Point2, Vector2};
use crate::settings::Settings;
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_VOLUME, CHANNELS,
};
use std::collections::{BTreeMap, VecDeque};

/// Windows before and behind that one is compared with.
const SIDE: usize = 6;
/// Of them the farthest: flow that changes at once is spread over the windows beside.
const FAR: usize = 3;
/// Heading turned beyond the turn of the path within three windows, about the widest bead; example plans turn by a third of
/// a right angle in one.
const SPIN_MAX_RAD: f64 = 100.0 * std::f64::consts::PI / 180.0;
/// Cross-section against that of both sides; example plans have 0.41 (beside an earlier bead) to 1.66.
const THIN: f64 = 0.4;
const SWOLLEN: f64 = 2.0;
/// Speed against that of both sides, and the share of such a window's time that a limit explains.
const SLOW: f64 = 0.4;
const EXPLAINED_SHARE: f64 = 0.25;
/// Windows whose speeds differ by less are driven at one speed, which was asked for.
const STEADY_SHARE: f64 = 0.05;
/// Turn of path and nozzle over the windows that are compared: beyond it the bead meets itself, or there is a corner to slow
/// for.
const BEND_MAX_RAD: f64 = 90.0 * std::f64::consts::PI / 180.0;
const STRAIGHT_RAD: f64 = 20.0 * std::f64::consts::PI / 180.0;
/// Tilt of a tool, rad, from which beads are not seen from above any more.
const LEAN_MAX: f64 = 0.2;
/// Earlier beads this far away, in widths, share their ground with a bead.
const BESIDE_WIDTHS: f64 = 1.5;

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Uneven {
    /// The nozzle turns by more than the path, degrees within three windows.
    Spin,
    /// Cross-section against both sides.
    Thin,
    /// The same.
    Swollen,
    /// Speed against both sides, at no limit.
    Slow,
}

impl Uneven {
    /// As the figures have it.
    pub fn name(self) -> &'static str {
        match self {
            Uneven::Spin => "spin",
            Uneven::Thin => "thin",
            Uneven::Swollen => "swollen",
            Uneven::Slow => "slow",
        }
    }
}

/// The places with a fault of a kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnevenPlaces {
    /// How many windows.
    pub places: u64,
    /// The worst: degrees, or a ratio.
    pub worst: f64,
    /// Where that is, machine coordinates.
    pub at_mm: [f64; 3],
    /// Its layer from 0.
    pub layer: u32,
}

/// A piece of a bead.
#[derive(Clone, Copy, Debug, Default)]
struct Window {
    at_mm: [f64; 3],
    layer: u32,
    way_mm: f64,
    volume_mm3: f64,
    /// Width times way.
    spanned_mm2: f64,
    heading_rad: f64,
    direction_rad: f64,
    ticks: f64,
    limited_ticks: f64,
    leans: bool,
    /// An earlier bead of the layer lies beside it.
    beside: bool,
}

impl Window {
    /// Volume by the ground that the nozzle spans: the bead's height.
    fn height_mm(&self) -> f64 {
        self.volume_mm3 / self.spanned_mm2.max(1e-12)
    }

    /// Of the path or of the nozzle.
    fn turn_rad(&self) -> f64 {
        self.direction_rad.abs().max(self.heading_rad.abs())
    }

    fn speed(&self) -> f64 {
        self.way_mm / self.ticks.max(1e-12)
    }
}

/// A moment that represents some ticks.
pub(crate) struct Sample<'a> {
    pub(crate) moment: &'a Moment,
    pub(crate) ticks: f64,
    pub(crate) is_limited: bool,
    pub(crate) layer: u32,
}

/// Collects the faults of a job.
#[derive(Debug, Default)]
pub(crate) struct Evenness {
    now: Window,
    direction: Option<Vector2>,
    run: VecDeque<Window>,
    /// Number of windows so far; those of the layer by their place, with number and height.
    windows: u64,
    laid: Option<PointGrid<(u64, f64)>>,
    layer: u32,
    found: BTreeMap<Uneven, UnevenPlaces>,
}

impl Evenness {
    /// The next moment of a bead.
    pub(crate) fn add(&mut self, sample: &Sample, settings: &Settings) {
        let servo_hz = f64::from(settings.machine.servo_hz);
        let Moment {
            position, velocity, ..
        } = sample.moment;
        let aperture = &settings.aperture;
        if self.now.ticks == 0.0 {
            self.begin(position, sample.layer, settings);
        }
        let seconds = sample.ticks / servo_hz;
        let flat = Vector2::new(velocity[0], velocity[1]);
        let way_mm = seconds * flat.norm().hypot(velocity[2]);
        let window = &mut self.now;
        window.ticks += sample.ticks;
        window.limited_ticks += if sample.is_limited { sample.ticks } else { 0.0 };
        window.way_mm += way_mm;
        window.volume_mm3 += seconds * velocity[CHANNEL_VOLUME];
        window.heading_rad += seconds * velocity[CHANNEL_HEADING];
        window.leans |= leans(position);
        if let Some(direction) = flat.try_normalize(1e-6) {
            let across = Vector2::new(-direction.y, direction.x);
            window.spanned_mm2 +=
                2.0 * aperture.extent_mm(position[CHANNEL_HEADING], across) * way_mm;
            if let Some(last) = self.direction.replace(direction) {
                window.direction_rad += last.perp(&direction).atan2(last.dot(&direction));
            }
        }
        if window.way_mm >= 2.0 * aperture.minor_mm() {
            self.close(settings);
        }
    }

    /// The bead ends.
    pub(crate) fn end(&mut self) {
        self.now = Window::default();
        self.direction = None;
        self.run.clear();
    }

    /// The faults, by kind.
    pub(crate) fn found(self) -> BTreeMap<Uneven, UnevenPlaces> {
        self.found
    }

    fn begin(&mut self, position: &[f64; CHANNELS], layer: u32, settings: &Settings) {
        if layer != self.layer {
            self.laid = None;
            self.layer = layer;
        }
        let at_mm = [position[0], position[1], position[2]];
        let beside = self.is_beside(at_mm, settings);
        self.now = Window {
            at_mm,
            layer,
            beside,
            ..Window::default()
        };
    }

    fn is_beside(&self, at_mm: [f64; 3], settings: &Settings) -> bool {
        // What the bead itself has just laid does not count: twice the way across a cell of the grid and its neighbours.
        let way_windows =
            6.0 * BESIDE_WIDTHS * settings.aperture.major_mm() / settings.aperture.minor_mm();
        let before = self.windows.saturating_sub(way_windows.ceil() as u64);
        let same_height = |z_mm: f64| (z_mm - at_mm[2]).abs() < 0.5 * settings.layer_height_mm;
        let place = Point2::new(at_mm[0], at_mm[1]);
        let mut others = self.laid.iter().flat_map(|laid| laid.around(place));
        others.any(|(window, z_mm)| *window < before && same_height(*z_mm))
    }

    fn close(&mut self, settings: &Settings) {
        let window = std::mem::take(&mut self.now);
        let reach_mm = BESIDE_WIDTHS * 2.0 * settings.aperture.major_mm();
        let empty = || PointGrid::of(reach_mm, std::iter::empty());
        let [x, y, z_mm] = window.at_mm;
        let laid = self.laid.get_or_insert_with(empty);
        laid.add(Point2::new(x, y), (self.windows, z_mm));
        self.windows += 1;
        self.run.push_back(window);
        if self.run.len() > 2 * SIDE + 1 {
            self.run.pop_front();
        }
        let last = self.run.iter().rev().take(3);
        let [heading_rad, direction_rad] = last.fold([0.0, 0.0], |[heading, direction], of| {
            [heading + of.heading_rad, direction + of.direction_rad]
        });
        let spin_rad = heading_rad.abs() - direction_rad.abs();
        let is_round = settings.aperture.major_mm() <= 1.01 * settings.aperture.minor_mm();
        if spin_rad > SPIN_MAX_RAD && !window.leans && !is_round {
            self.note(Uneven::Spin, spin_rad.to_degrees(), &window);
        }
        if self.run.len() == 2 * SIDE + 1 {
            self.compare();
        }
    }

    /// Compares the middle of the run with both sides.
    fn compare(&mut self) {
        let windows: Vec<Window> = self.run.iter().copied().collect();
        let (before, middle, behind) = (&windows[..SIDE], windows[SIDE], &windows[SIDE + 1..]);
        let turn = |of: &[Window]| of.iter().map(Window::turn_rad).sum::<f64>();
        if !windows.iter().any(|window| window.leans) && turn(&windows) < BEND_MAX_RAD {
            let height = |side: &[Window]| middle_of(side.iter().map(Window::height_mm).collect());
            let (one, other) = (height(&before[..FAR]), height(&behind[SIDE - FAR..]));
            let thin = middle.height_mm() / one.min(other).max(1e-12);
            let swollen = middle.height_mm() / one.max(other).max(1e-12);
            if thin < THIN && !middle.beside {
                self.note(Uneven::Thin, thin, &middle);
            }
            if swollen > SWOLLEN {
                self.note(Uneven::Swollen, swollen, &middle);
            }
        }
        let fastest = |side: &[Window]| side.iter().map(Window::speed).fold(0.0, f64::max);
        let ratio = middle.speed() / fastest(before).min(fastest(behind)).max(1e-12);
        let near = &windows[SIDE - 1..=SIDE + 1];
        let limited: f64 = near.iter().map(|window| window.limited_ticks).sum();
        let all: f64 = near.iter().map(|window| window.ticks).sum();
        let is_steady = (near.iter())
            .all(|window| (window.speed() / middle.speed() - 1.0).abs() < STEADY_SHARE);
        let is_straight = turn(&windows[SIDE - 2..=SIDE + 2]) < STRAIGHT_RAD;
        if ratio < SLOW && limited < EXPLAINED_SHARE * all && is_straight && !is_steady {
            self.note(Uneven::Slow, ratio, &middle);
        }
    }

    fn note(&mut self, what: Uneven, value: f64, window: &Window) {
        let is_worse = |worst: f64| match what {
            Uneven::Spin | Uneven::Swollen => value > worst,
            Uneven::Thin | Uneven::Slow => value < worst,
        };
        let found = self.found.entry(what).or_insert(UnevenPlaces {
            places: 0,
            worst: value,
            at_mm: window.at_mm,
            layer: window.layer,
        });
        found.places += 1;
        if is_worse(found.worst) {
            (found.worst, found.at_mm, found.layer) = (value, window.at_mm, window.layer);
        }
    }
}

fn leans(position: &[f64; CHANNELS]) -> bool {
    position[CHANNEL_TILT_X].hypot(position[CHANNEL_TILT_Y]) > LEAN_MAX
}

/// The median.
fn middle_of(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}

//! The heading along a run of contacts: dynamic programming over the feasible headings, then continuous
//! refinement.
//!
//! The state is phi modulo the aperture's symmetry. Each contact and heading has one placement:
//! tangent to the wall at the contact (centre = p + support point), slid off any other wall that
//! it would cut. The cost of a placement is (e - wanted extent)² plus (slide)², per mm of wall;
//! the cost of turning is lambda dphi² / ds. The best closed or open profile is found exactly over
//! the bins (Viterbi), then refined between them.
//!
//! In: contacts (mm) with desired extents, the weight of turning (mm²), walls. Out: one placement
//! for each contact (mm, unwrapped rad), and whether it fits. Why here: the only place where
//! headings of a bead are chosen. Headings do not come from F(p) ([`crate::plan::feasible`]): there
//! the aperture touches the wall exactly, but a bead may keep a distance at a price. Not covered:
//! time, which the optimiser weighs.

mod ahead;
mod along;
mod bins;
mod refine;
mod thinned;

use self::ahead::{Ahead, all_ahead};
use self::along::Along;
use self::bins::{closed_start, unwrap_bins, viterbi};
use self::refine::refine;
use crate::geometry::Vector2;
use crate::geometry::aperture::{Aperture, Turn};
use crate::geometry::clearance::{Configuration, Turned, WallContact, contact_turned};
use crate::geometry::edge_index::EdgeIndex;
use crate::plan::pass::{Contact, Placement};
use crate::plan::pose_limits::PoseLimits;
use rayon::prelude::*;

/// Heading bins over the 180° of a symmetric aperture: 3° each, refined afterwards.
const BINS: usize = 60;
/// Step of the wanted extent along a run, against b: half the distance of contacts.
const ENTRY_SHARE: f64 = 0.25;
/// Weight of turning against a v / √A, with v the tip's speed and A the heading's acceleration limit:
/// that is a times how far the tip goes while the heading turns by a radian. From trials on real slices,
/// 0.08 mm⁴ for the built-in machine at 60 mm/s; more opens corners, less is slower.
const TURN_SHARE: f64 = 0.0426;
/// The weight for the built-in machine, mm⁴.
pub const TURN_WEIGHT_MM4: f64 = 0.08;
/// What tilting to the left of the normal costs beyond tilting to its right, of the aperture's unit, squared: both often fit
/// alike, and neither rounding nor noise of some micrometres may choose, nor where along a straight
/// wall the tilt changes over. More than this is felt where a side is short.
const TILT_WEIGHT: f64 = 7e-5;
/// Slides of one placement before it counts as infeasible.
const SLIDES_MAX: usize = 4;
/// Slide that an infeasible placement counts as, of the aperture's unit: far above any misfit.
const INFEASIBLE: f64 = 5.0;
/// Least length that a contact represents, of the unit.
const NODE_LEAST: f64 = 0.01;
/// A placement may cut by this share of the aperture before the final push-off.
const CUT_SHARE_MAX: f64 = 2e-3;

/// Rounds of smoothing: they halve the print time of turned corners for 0.1 % of coverage.
const SMOOTHING_ROUNDS: usize = 6;

struct Candidate {
    at: Configuration,
    cost: f64,
    feasible: bool,
}

/// What turning weighs for a machine, mm⁴ (`TURN_SHARE`).
pub fn turn_weight_mm4(limits: &PoseLimits, aperture: &Aperture) -> f64 {
    let [_, _, heading] = &limits.axes;
    let way_mm2 = TURN_SHARE * aperture.major_mm() * limits.tip_speed_mm_s;
    // Misfits are squared and summed along the path.
    way_mm2 / heading.acceleration.sqrt() * aperture.unit_mm().powi(2)
}

/// Finds the profile along `contacts`; `closed` where the last one meets the first. Turning by dphi
/// over ds costs `turn_weight_mm4` dphi² / ds. Straight walls are thinned out for it.
pub fn profile(
    contacts: &[Contact],
    closed: bool,
    turn_weight_mm4: f64,
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Vec<Placement> {
    let kept = thinned::kept(contacts, aperture);
    if kept.len() == contacts.len() {
        return whole_profile(contacts, closed, turn_weight_mm4, aperture, walls);
    }
    let thin = thinned::standing_for_all(contacts, &kept);
    let found = whole_profile(&thin, closed, turn_weight_mm4, aperture, walls);
    thinned::filled_in(contacts, &kept, &found, aperture)
}

/// The profile of all contacts, each evaluated.
fn whole_profile(
    contacts: &[Contact],
    closed: bool,
    turn_weight_mm4: f64,
    aperture: &Aperture,
    walls: &EdgeIndex,
) -> Vec<Placement> {
    if contacts.is_empty() {
        return Vec::new();
    }
    let period_rad = aperture.period_rad();
    let bins = match (aperture.is_round(), period_rad > std::f64::consts::PI) {
        (true, _) => 1,
        (false, false) => BINS,
        (false, true) => 2 * BINS,
    };
    let bin_rad = period_rad / bins as f64;
    let ahead = all_ahead(contacts, aperture, walls);
    let run = ContactRun::new(contacts, closed, aperture, walls, &ahead);
    let turns: Vec<Turn> = (0..bins).map(|bin| (bin as f64 * bin_rad).into()).collect();
    let cost = |i: usize, turn: &Turn| run.place(i, *turn).cost as f32;
    let costs: Vec<Vec<f32>> = (0..contacts.len())
        .into_par_iter()
        .map(|i| turns.iter().map(|turn| cost(i, turn)).collect())
        .collect();
    let steps = turn_slacks_per_mm(contacts, closed, turn_weight_mm4, aperture);
    let start = if closed {
        closed_start(&costs, &steps, bin_rad)
    } else {
        None
    };
    let chosen = viterbi(&costs, &steps, bin_rad, start);
    let mut headings = unwrap_bins(&chosen, bins, bin_rad);
    if !aperture.is_round() {
        refine(&run, &steps, &mut headings);
    }
    run.placements(&headings)
}

/// Smooths a run by rounds of [1 2 1] / 4 over centres and headings; the ends of an open one stay.
pub fn smooth(placements: &mut [Placement], closed: bool, aperture: &Aperture) {
    let count = placements.len();
    if count < 4 {
        return;
    }
    let headings: Vec<f64> = placements.iter().map(|p| p.at.heading_rad).collect();
    let lap = if closed {
        lap_turn(&headings, aperture.period_rad())
    } else {
        0.0
    };
    for _ in 0..SMOOTHING_ROUNDS {
        let before: Vec<Configuration> = placements.iter().map(|p| p.at).collect();
        for i in 0..count {
            if !closed && (i == 0 || i + 1 == count) {
                continue;
            }
            let own = before[i];
            let (p, q) = (before[(i + count - 1) % count], before[(i + 1) % count]);
            let back = if i == 0 { lap } else { 0.0 };
            let ahead = if i + 1 == count { lap } else { 0.0 };
            let sum = p.center.coords + own.center.coords * 2.0 + q.center.coords;
            placements[i].at = Configuration {
                center: (sum / 4.0).into(),
                heading_rad: (p.heading_rad - back + 2.0 * own.heading_rad + q.heading_rad + ahead)
                    / 4.0,
            };
        }
    }
}

/// A run of contacts with what placing the aperture on them needs.
struct ContactRun<'a> {
    contacts: &'a [Contact],
    closed: bool,
    aperture: &'a Aperture,
    walls: &'a EdgeIndex,
    along: Along<'a>,
    /// For each contact what an aperture touching there may cut.
    ahead: &'a [Ahead],
}

impl<'a> ContactRun<'a> {
    fn new(
        contacts: &'a [Contact],
        closed: bool,
        aperture: &'a Aperture,
        walls: &'a EdgeIndex,
        ahead: &'a [Ahead],
    ) -> ContactRun<'a> {
        ContactRun {
            contacts,
            closed,
            aperture,
            walls,
            along: Along::new(contacts, closed, ENTRY_SHARE * aperture.minor_mm()),
            ahead,
        }
    }

    /// The placement of one contact at one heading, slid inside where it would cut a wall. A turned
    /// aperture touches the inner side of its bead before or after the contact: that is where the
    /// width counts.
    fn place(&self, i: usize, heading: impl Into<Turn>) -> Candidate {
        let (c, aperture) = (&self.contacts[i], self.aperture);
        let turn = heading.into();
        let extent = aperture.extent_mm(turn, c.normal);
        let along = Vector2::new(c.normal.y, -c.normal.x);
        let support = aperture.support_point(turn, c.normal);
        let (tangent, wanted) = if c.on_axis {
            let center = aperture.center_on_axis(turn.heading_rad, c.point, c.normal);
            // A turned aperture touches one wall before, the other after its contact: where the
            // passage narrows or bends it is off the axis.
            let ahead_mm = support.dot(&along);
            let wall_mm = |side: f64| {
                let along_mm = side * ahead_mm;
                self.along.aside_mm(i, along_mm) + side * self.along.wanted_mm(i, along_mm)
            };
            let (far, near) = (wall_mm(1.0), wall_mm(-1.0));
            (center + c.normal * (0.5 * (far + near)), 0.5 * (far - near))
        } else {
            let center = aperture.center_on_wall(turn, c.point, c.normal);
            let ahead_mm = (center + support - c.point).dot(&along);
            (center, self.along.wanted_mm(i, ahead_mm))
        };
        let at = Turned {
            center: tangent,
            turn,
        };
        let slid = match &self.ahead[i] {
            Ahead::Clear { is_inside } => is_inside.then(|| at.into()),
            Ahead::Edges(edges) => {
                let cut = contact_turned(aperture, at, edges, 1.0);
                slide_from(cut, at, aperture, self.walls, SLIDES_MAX, CUT_SHARE_MAX)
            }
        };
        let misfit_mm = extent - wanted;
        let slide_mm = slid.map_or(INFEASIBLE * aperture.unit_mm(), |s| {
            (s.center - tangent).norm()
        });
        Candidate {
            at: slid.unwrap_or(at.into()),
            cost: (misfit_mm.powi(2)
                + slide_mm.powi(2)
                + tilt_cost(turn, c.normal) * aperture.unit_mm().powi(2))
                * c.length_mm.max(NODE_LEAST * aperture.unit_mm()),
            feasible: slid.is_some(),
        }
    }

    fn placements(&self, headings: &[f64]) -> Vec<Placement> {
        (0..self.contacts.len())
            .into_par_iter()
            .map(|i| {
                let found = self.place(i, headings[i]);
                Placement {
                    at: found.at,
                    feasible: found.feasible,
                    contact: self.contacts[i],
                }
            })
            .collect()
    }
}

/// From 0 where the heading is 45° to the right of the normal to [`TILT_WEIGHT`] at 45° to its
/// left, smoothly.
fn tilt_cost(turn: Turn, normal: Vector2) -> f64 {
    let ahead = Vector2::new(turn.cos, turn.sin);
    0.5 * TILT_WEIGHT * (1.0 + 2.0 * normal.perp(&ahead) * normal.dot(&ahead))
}

/// Slides a placement off the walls along their contact normals, at most `rounds` times, until it
/// cuts no deeper than `cut_share`; `None` if that does not succeed or it is outside.
pub fn slide_inside(
    at: Configuration,
    aperture: &Aperture,
    walls: &EdgeIndex,
    rounds: usize,
    cut_share: f64,
) -> Option<Configuration> {
    let at = Turned::from(at);
    let cut = contact_turned(aperture, at, walls, 1.0);
    slide_from(cut, at, aperture, walls, rounds, cut_share)
}

/// The same where the first contact is known.
fn slide_from(
    first: Option<WallContact>,
    at: Turned,
    aperture: &Aperture,
    walls: &EdgeIndex,
    rounds: usize,
    cut_share: f64,
) -> Option<Configuration> {
    let (mut at, mut found) = (at, first);
    let cuts = |found: &WallContact| found.scaled < 1.0 - cut_share;
    for _ in 0..rounds {
        let Some(cut) = found.filter(cuts) else {
            break;
        };
        at.center -= cut.outward * (cut.depth_mm + 1e-6);
        found = contact_turned(aperture, at, walls, 1.0);
    }
    (!found.is_some_and(|found| cuts(&found)) && walls.contains(at.center)).then_some(at.into())
}

/// Distance that the turning between contact i and i + 1 can use, over the weight of turning, 1/mm.
fn turn_slacks_per_mm(
    contacts: &[Contact],
    closed: bool,
    turn_weight_mm4: f64,
    aperture: &Aperture,
) -> Vec<f64> {
    let count = contacts.len();
    let swing = 0.5 * (aperture.major_mm() + aperture.minor_mm());
    (0..if closed { count } else { count - 1 })
        .map(|i| {
            let (c, d) = (&contacts[i], &contacts[(i + 1) % count]);
            let angle = c
                .normal
                .perp(&d.normal)
                .atan2(c.normal.dot(&d.normal))
                .abs();
            ((d.point - c.point).norm() + swing * angle).max(NODE_LEAST * aperture.unit_mm())
                / turn_weight_mm4
        })
        .collect()
}

/// The turn of a closed run over one lap: the multiple of the period that makes its ends meet.
fn lap_turn(headings: &[f64], period_rad: f64) -> f64 {
    let (Some(first), Some(last)) = (headings.first(), headings.last()) else {
        return 0.0;
    };
    ((last - first) / period_rad).round() * period_rad
}

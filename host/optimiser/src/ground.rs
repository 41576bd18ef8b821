//! The price of area left open or laid twice.
//!
//! In: the sweep of the passes. Out: value, gradient and curvature (of each visit by itself: what neighbouring beads share
//! is not coupled). A cell's coverage is the sum of its visits and
//! of the wall's contribution; 1 is correct, less is open, more is laid twice. Each cell passes its slope to the
//! two contacts of the adjacent strip, each contact to the four knots of its pose.

use super::band::{PoseTerm, System};
use super::curve::{Knot, PassKnots};
use super::sweep::{Contact, Sweep, VISITS_MAX, Visit, cover, cover_slope, from_grid, is_strip};
use super::terms::Terms;

/// Curvature of the price against that of one visit, for what neighbouring beads share. It is not coupled, and a bound of
/// it (twice the number of visits) makes steps too short: with less than this, beads that meet overshoot.
const SHARED: f64 = 1.25;

/// The area terms.
#[derive(Clone, Debug)]
pub struct Ground<'a> {
    sweep: Sweep<'a>,
    price: f64,
    twice_share: f64,
}

/// What a cover costs: value, slope, and curvature of the parabola that bounds it (Huber).
fn cost(cover: f64, blur: f64, twice_share: f64) -> [f64; 3] {
    let off = (1.0 - cover).abs();
    let weight = if cover <= 1.0 { 1.0 } else { twice_share };
    let sign = if cover < 1.0 { -weight } else { weight };
    if off < blur {
        let value = weight * off * off / (2.0 * blur);
        [value, sign * off / blur, weight / blur]
    } else {
        [weight * (off - blur / 2.0), sign, weight / off]
    }
}

impl<'a> Ground<'a> {
    /// `price` of an area of a², in mean spans; `twice_share` of it for area laid twice.
    pub fn new(sweep: Sweep<'a>, price: f64, twice_share: f64) -> Ground<'a> {
        Ground {
            sweep,
            price,
            twice_share,
        }
    }

    /// Only the cells within `reach` of these knots count from now on.
    pub fn keep_near(&mut self, knots: &[Knot], reach: f64) {
        self.sweep.keep_near(knots, reach);
    }

    /// How far the aperture reaches from its middle, a.
    pub fn radius(&self) -> f64 {
        self.sweep.radius()
    }

    /// Sweeps all passes again.
    pub fn sweep(&mut self, knots: &[Knot], passes: &[PassKnots]) {
        self.sweep.run(knots, passes);
    }

    /// Adds the area terms of the last sweep, with the corner of the price rounded over `blur`; slopes where there is a
    /// system.
    pub fn add(&mut self, blur: f64, terms: &mut Terms, system: Option<&mut System>) {
        for contact in &mut self.sweep.contacts {
            (contact.slope, contact.curvature) = (0.0, 0.0);
        }
        let area = self.sweep.cells.size * self.sweep.cells.size;
        let mut sum = 0.0;
        for cell in 0..self.sweep.cells.wall_cover.len() {
            if self.sweep.visits.is_covered_once(cell) && self.sweep.cells.wall_cover[cell] == 0.0 {
                continue;
            }
            let [covered, value] = self.add_cell(cell, area, blur);
            sum += value;
            if covered < 1.0 {
                terms.open += (1.0 - covered) * area;
            } else {
                terms.twice += (covered - 1.0) * area;
            }
        }
        terms.ground += self.price * area * sum;
        if let Some(system) = system {
            self.add_contacts(system);
        }
    }

    /// Cover and cost of a cell; hands slope and curvature to the contacts.
    fn add_cell(&mut self, cell: usize, area: f64, blur: f64) -> [f64; 2] {
        let wall = f64::from(self.sweep.cells.wall_cover[cell]);
        if let Some(plain) = self.sweep.visits.plain_cover(cell) {
            let covered = wall + f64::from(plain);
            let [value, ..] = cost(covered, blur, self.twice_share);
            return [covered, value];
        }
        let edge_half = self.sweep.cells.edge_half;
        let price = self.price * area;
        if let Some(visit) = self.sweep.visits.only(cell) {
            let z = visit.distance / edge_half;
            let covered = wall + f64::from(cover(z));
            let [value, slope, bend] = cost(covered, blur, self.twice_share);
            let by_distance = cover_slope(z) / edge_half;
            self.hand_on(&visit, by_distance, price * slope, price * bend * SHARED);
            return [covered, value];
        }
        let mut visits = [Visit::NONE; VISITS_MAX];
        let count = self.sweep.visits.of(cell, &mut visits);
        let mut slopes = [0.0f32; VISITS_MAX];
        let mut covered = wall;
        let mut before = 0.0f32;
        for (k, visit) in visits[..count].iter().enumerate() {
            let z = visit.distance / edge_half;
            let own = cover(z);
            slopes[k] = cover_slope(z) / edge_half;
            covered += f64::from(own);
            if visit.weight < 1.0 && k > 0 {
                // Of two visits that half count as one the lesser has the weight.
                let lesser = if own < before { k } else { k - 1 };
                slopes[lesser] *= visit.weight;
                covered -= f64::from((1.0 - visit.weight) * own.min(before));
            }
            before = own;
        }
        let [value, slope, bend] = cost(covered, blur, self.twice_share);
        for (visit, &by_distance) in visits[..count].iter().zip(&slopes) {
            self.hand_on(visit, by_distance, price * slope, price * bend * SHARED);
        }
        [covered, value]
    }

    /// Hands slope and curvature by a visit's cover to the contacts of its strip.
    #[inline]
    fn hand_on(&mut self, visit: &Visit, by_distance: f32, slope: f64, bend: f64) {
        if by_distance == 0.0 || !is_strip(visit.strip) {
            return;
        }
        let by_distance = f64::from(by_distance);
        let slope = (slope * by_distance) as f32;
        let bend = (bend * by_distance * by_distance) as f32;
        let [from, to] = self.sweep.strips[visit.strip as usize];
        let first = &mut self.sweep.contacts[from as usize];
        first.slope += (1.0 - visit.share) * slope;
        first.curvature += (1.0 - visit.share) * bend;
        let second = &mut self.sweep.contacts[to as usize];
        second.slope += visit.share * slope;
        second.curvature += visit.share * bend;
    }

    /// Hands what the contacts collected to the knots, the contacts of one pose together.
    fn add_contacts(&self, system: &mut System) {
        let same_pose = |a: &Contact, b: &Contact| a.pose == b.pose;
        for group in self.sweep.contacts.chunk_by(same_pose) {
            let mut term = PoseTerm::default();
            for contact in group {
                let [x, y] = from_grid(contact.normal.map(f64::from));
                let by_pose = [-x, -y, f64::from(contact.by_heading)];
                let [slope, curvature] = [contact.slope, contact.curvature].map(f64::from);
                term.add(slope, curvature, &by_pose);
            }
            let pose = &self.sweep.poses[group[0].pose as usize];
            let weights = &self.sweep.bases[pose.basis as usize].value;
            system.add_pose(pose.knot as usize, weights, &term);
        }
    }
}

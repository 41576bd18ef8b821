//! Parts as users draw them, that no constant of the planner was chosen on: families of shapes, each
//! a short function of drawn sizes, so that there are as many parts as numbers.
//!
//! [`held_out`] is the set that `docs/measurements/held-out.md` reports: the first two of every family, as the
//! ranges gave them. [`Family::part`] draws any other, for hunts. 10 to 120 mm across.

mod drawing;
mod mechanical;
mod thin;

use headway::geometry::polygon::Region;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

/// Sizes drawn from ranges, the same for the same seed.
pub struct Sizes(Pcg32);

impl Sizes {
    /// In [0, 1).
    fn share(&mut self) -> f64 {
        f64::from(self.0.random::<u32>()) / 2f64.powi(32)
    }

    /// Evenly between two numbers.
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.share()
    }

    /// A whole number, both ends included.
    fn whole(&mut self, low: usize, high: usize) -> usize {
        low + (self.share() * (high - low + 1) as f64) as usize
    }

    /// True in half the cases.
    fn coin(&mut self) -> bool {
        self.share() < 0.5
    }
}

/// One drawn part.
#[derive(Clone, Debug)]
pub struct Part {
    /// Family and number.
    pub name: String,
    /// Mostly one; letters have several.
    pub regions: Vec<Region>,
}

/// Shapes of one kind.
#[derive(Clone, Copy)]
pub struct Family {
    /// What they are.
    pub name: &'static str,
    draw: fn(&mut Sizes) -> Vec<Region>,
}

impl Family {
    /// The part of this number.
    pub fn part(&self, number: u64) -> Part {
        let letters = self.name.bytes().map(u64::from);
        let family = letters.fold(0, |hash, byte| (hash * 31 + byte) % 1_000_003);
        let mut sizes = Sizes(Pcg32::seed_from_u64(1_000_000 * family + number));
        Part {
            name: format!("{} {number}", self.name),
            regions: (self.draw)(&mut sizes),
        }
    }
}

/// All families, by name.
pub const FAMILIES: [Family; 22] = [
    family("blade", thin::blade),
    family("bracket", mechanical::bracket),
    family("comb plate", mechanical::comb_plate),
    family("cookie cutter", thin::cookie_cutter),
    family("gear", mechanical::gear),
    family("hinge leaf", mechanical::hinge_leaf),
    family("honeycomb", thin::honeycomb),
    family("hook", mechanical::hook),
    family("impeller", thin::impeller),
    family("keyhole plate", mechanical::keyhole_plate),
    family("labyrinth", thin::labyrinth),
    family("lattice", thin::lattice),
    family("letters", mechanical::letters),
    family("phone stand", mechanical::phone_stand),
    family("plate with holes", mechanical::plate_with_holes),
    family("snowflake", thin::snowflake),
    family("spanner", mechanical::spanner),
    family("spiral", thin::spiral),
    family("star plate", mechanical::star_plate),
    family("thin-walled box", thin::thin_walled_box),
    family("truss", thin::truss),
    family("wheel", mechanical::wheel),
];

const fn family(name: &'static str, draw: fn(&mut Sizes) -> Vec<Region>) -> Family {
    Family { name, draw }
}

/// The set that the documentation reports.
pub fn held_out() -> Vec<Part> {
    let numbers = FAMILIES
        .iter()
        .flat_map(|family| [(family, 1), (family, 2)]);
    numbers
        .map(|(family, number)| family.part(number))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use headway::geometry::validity::validate_all;

    /// Goal: every part is a valid polygon of the stated size, and the same each time. Method: the
    /// held-out set and the next three of every family.
    #[test]
    fn parts_are_valid_and_of_a_size() {
        for family in FAMILIES {
            for number in 1..=5 {
                let part = family.part(number);
                assert_eq!(validate_all(&part.regions), Ok(()), "{}", part.name);
                let points = || part.regions.iter().flat_map(|r| &r.exterior.points);
                let across = |of: fn(f64, f64) -> f64| {
                    let start = points().next().expect("points").coords;
                    points().fold(start, |far, p| far.zip_map(&p.coords, of))
                };
                let size = across(f64::max) - across(f64::min);
                let longest_mm = size.x.max(size.y);
                assert!(
                    (10.0..=120.0).contains(&longest_mm),
                    "{}: {longest_mm:.1} mm",
                    part.name
                );
                assert_eq!(part.regions, family.part(number).regions);
            }
        }
        assert_eq!(held_out().len(), 2 * FAMILIES.len());
    }
}

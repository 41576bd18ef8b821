//! Beads that fit: what the optimiser need not look at.
//!
//! In: knots at the beginning, the edges of their ground, the aperture, limits. Out: the pace of each knot that need not move. A
//! bead that can be laid at full speed, and whose flanks lie on a wall or on the flank of another such bead, takes the
//! least time, leaves nothing open and covers nothing twice: the objective has nothing to gain there. Lengths are in a.

use super::Site;
use super::curve::{Basis, Knot, PassKnots, Units, blend};
use super::moving::{AT_ENDS, Squares};
use super::search::Tools;
use super::sweep::{CONTACTS_MAX, Shape, Touch};
use headway_geometry::edge_index::{Edge, EdgeIndex};
use headway_geometry::polygon::Region;

/// Most that two flanks overlap or leave open, or a flank and a wall, a.
const APART_MAX: f64 = 0.004;
/// Share of that by which a flank may be outside a wall: for rounding.
const OUTSIDE_MAX: f64 = 1e-6;
/// Most that they lie apart along the bead, a: more than half a span.
const ALONG_MAX: f64 = 0.3;
/// Most that their directions differ from opposite ones, as one plus the cosine of the angle.
const OPPOSITE: f64 = 1e-4;

/// A point at which the side of a bead ends.
#[derive(Clone, Copy, Debug)]
struct Flank {
    knot: u32,
    at: [f64; 2],
    /// Outward unit normal.
    normal: [f64; 2],
}

/// For each knot on a bead that fits the pace of the full speed; `None` for those that have to move.
pub fn paces(knots: &[Knot], passes: &[PassKnots], tools: &Tools) -> Vec<Option<f64>> {
    let Tools { site, motion, .. } = tools;
    let mut paces = vec![None; knots.len()];
    // The sides of a tool whose size depends on its place are not those of the plane.
    if site.scale.is_some() {
        return paces;
    }
    let mut flanks = Vec::new();
    for pass in passes.iter().filter(|pass| pass.free) {
        for knot in pass.first + AT_ENDS..pass.end().saturating_sub(AT_ENDS) {
            let pace = motion.full_speed_pace(&knots[knot - 2..=knot + 2]);
            if pace.is_some() && add_flanks(knots, knot, tools.shape, &mut flanks) {
                paces[knot] = pace;
            }
        }
    }
    let edges = Edges::of(site, tools.units);
    for flank in unpaired(knots, &flanks) {
        if !edges.meet(&flank.at) {
            paces[flank.knot as usize] = None;
        }
    }
    paces
}

/// Adds the points at which the aperture touches the sides of the bead; false where it does not have two.
fn add_flanks(knots: &[Knot], knot: usize, shape: &Shape, flanks: &mut Vec<Flank>) -> bool {
    let around = &knots[knot - 1..=knot + 2];
    let [x, y, heading, _] = blend(&Basis::at(0.0).value, around);
    let (behind, ahead) = (&around[0], &around[2]);
    let way = [ahead[0] - behind[0], ahead[1] - behind[1]];
    let (sin, cos) = heading.sin_cos();
    let in_tool = [cos * way[0] + sin * way[1], cos * way[1] - sin * way[0]];
    let mut touches = [Touch::default(); CONTACTS_MAX];
    let turn = (ahead[2] - behind[2]) as f32;
    let found = shape.touches(in_tool.map(|c| c as f32), turn, &mut touches);
    let in_plane = |[u, v]: [f32; 2]| {
        let (u, v) = (f64::from(u), f64::from(v));
        [cos * u - sin * v, sin * u + cos * v]
    };
    flanks.extend(touches[..found].iter().map(|Touch { at, .. }| {
        let point = in_plane(at.point);
        Flank {
            knot: knot as u32,
            at: [x + point[0], y + point[1]],
            normal: in_plane(at.normal),
        }
    }));
    found >= 2
}

/// The flanks on which no other lies.
fn unpaired<'a>(knots: &[Knot], flanks: &'a [Flank]) -> Vec<&'a Flank> {
    let squares = Squares::around(knots);
    let [firsts, inside] = squares.sorted(flanks.iter().map(|flank| flank.at));
    let has_partner = |flank: &&Flank| {
        let reach = ALONG_MAX + APART_MAX;
        squares.within(flank.at, reach).any(|square| {
            let range = firsts[square] as usize..firsts[square + 1] as usize;
            inside[range]
                .iter()
                .any(|&other| meet(flank, &flanks[other as usize]))
        })
    };
    flanks.iter().filter(|flank| !has_partner(flank)).collect()
}

/// Whether two flanks face each other and touch.
fn meet(flank: &Flank, other: &Flank) -> bool {
    let [x, y] = flank.normal;
    let apart = [other.at[0] - flank.at[0], other.at[1] - flank.at[1]];
    let facing = x * other.normal[0] + y * other.normal[1];
    facing <= OPPOSITE - 1.0
        && (x * apart[0] + y * apart[1]).abs() <= APART_MAX
        && (x * apart[1] - y * apart[0]).abs() <= ALONG_MAX
}

/// The edges of the ground.
struct Edges<'a> {
    walls: &'a EdgeIndex,
    left_out: Option<EdgeIndex>,
    units: &'a Units,
}

impl<'a> Edges<'a> {
    fn of(site: &Site<'a>, units: &'a Units) -> Edges<'a> {
        let others = site.left_out.iter().flat_map(Region::edges);
        let others: Vec<Edge> = others.map(|(a, b)| Edge { a, b }).collect();
        Edges {
            walls: site.walls,
            left_out: (!others.is_empty()).then(|| EdgeIndex::new(others, units.length_mm)),
            units,
        }
    }

    /// Whether a point lies on one of them.
    fn meet(&self, &[x, y]: &[f64; 2]) -> bool {
        let point = self.units.point_of(x, y);
        let apart_mm = APART_MAX * self.units.length_mm;
        let on_wall = self.walls.nearest_within(point, apart_mm);
        let is_inside =
            |edge: &Edge, foot| edge.normal().dot(&(point - foot)) >= -OUTSIDE_MAX * apart_mm;
        on_wall.is_some_and(|near| is_inside(&self.walls.edges()[near.edge], near.foot))
            || (self.left_out.as_ref())
                .is_some_and(|index| index.nearest_within(point, apart_mm).is_some())
    }
}

//! The sweep of the aperture along the passes, as strips along the edge of the swept area.
//!
//! ```text
//! knots --poses--> Pose --touches--> Contact --joined from pose to pose--> strips --cells beside them--> Visits
//!                  (a, rad)          (a)                                   (contact pairs)
//! ```
//!
//! A pose touches the envelope of its sweep in mostly two points, where its outline moves along itself (Blackmore,
//! Leu, "Analysis of swept volume via Lie groups and differential equations", 1992). Contacts are connected from
//! pose to pose; a cell next to such a strip is evaluated once, by its distance to the envelope. The derivative of
//! that distance by the pose is a constant of the contact, so that each collects one slope and one curvature.
//! Inside the sweep cells are only marked when they are entered ([`strips`]). At ends, reversals and cusps, where
//! the envelope does not consist of contacts, the outline of the pose closes it where no neighbouring pose covers
//! it.

mod cells;
mod ellipse;
mod rounded;
mod shape;
mod strips;

pub use self::cells::{
    Cells, Segment, VISITS_MAX, Visit, cover, cover_slope, edge_half, from_grid,
};
use self::cells::{NO_STRIP, Visits, to_grid};
pub use self::shape::{CONTACTS_MAX, Shape, Touch};
use self::shape::{Inside, OUTLINE_MAX, OutlinePoint};
use self::strips::{Beside, Marked};
use super::curve::{Basis, Knot, PassKnots, blend};
use super::tool_scale::ToolScale;

/// Poses of a span.
const POSES_A_SPAN: usize = 2;
/// Parameter at which the direction of motion is evaluated at the ends of a pass, where it may be
/// at rest.
const END_SHARE: f64 = 0.05;
/// A pose nearer to the previous one than this, in a, a turn by its arc, is skipped.
const STEP_MIN: f32 = 1.0 / 15.0;
/// Path between passes, in a: far more than a return takes.
const BETWEEN_PASSES: f32 = 20.0;
/// A contact this far inside a neighbouring pose (of the squared gauge) is the nearest place, not the farthest.
const NEAREST: f32 = 4e-3;
/// Contacts are joined up to this multiple of the motion of the aperture, plus a share of a.
const JOIN_REACH: f32 = 1.5;
const JOIN_SLACK: f32 = 0.05;
/// Normals of joined contacts differ by less than 60°.
const JOIN_COSINE: f32 = 0.5;
/// The line that joins them rises along the normals by less than this share of its length.
const JOIN_SLOPE: f32 = 0.5;
/// Depth in squared gauge at which an outline point inside a neighbour is still visible, at most and per motion
/// between the two.
const HIDDEN_MAX: f32 = 0.1;
const HIDDEN_SHARE: f32 = 0.5;
/// Outline points around a contact that the strips on both its sides represent, in each direction and in
/// all, of 32.
const OWN_EACH: usize = 9;
const OWN_ALL: usize = 7;
const OWN_OF: usize = 32;

/// A pose of the sweep, in the frame of the grid.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    /// Centre, in a.
    pub center: [f32; 2],
    /// Size of the tool against that of the plane, and one over that.
    pub size: f32,
    /// See `size`.
    pub inverse: f32,
    /// Cosine and sine of the heading.
    pub turn: [f32; 2],
    /// Derivative of the centre by the spline's parameter.
    pub velocity: [f32; 2],
    /// Derivative of the heading.
    pub turning: f32,
    /// Path so far, in a.
    pub path: f32,
    /// First of its four knots.
    pub knot: u32,
    /// Its row of [`Sweep::bases`].
    pub basis: u32,
}

impl Pose {
    /// Transforms a vector of the plane into the tool's frame, in which the tool has its own size.
    #[inline]
    pub fn in_tool(&self, v: [f32; 2]) -> [f32; 2] {
        self.turned_in(v).map(|c| c * self.inverse)
    }

    /// A direction of the plane in the tool's frame.
    #[inline]
    pub fn turned_in(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let [cos, sin] = self.turn;
        [cos * x + sin * y, cos * y - sin * x]
    }

    /// A point of the tool's outline in the plane, about its centre.
    #[inline]
    pub fn in_plane(&self, point: [f32; 2]) -> [f32; 2] {
        self.turned_out(point).map(|c| c * self.size)
    }

    /// A direction of the tool's frame in the plane.
    #[inline]
    pub fn turned_out(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let [cos, sin] = self.turn;
        [cos * x - sin * y, sin * x + cos * y]
    }

    /// How far it moved from another: of the centre, in a, and the sine of the turn.
    #[inline]
    pub fn motion_from(&self, other: &Pose) -> [f32; 2] {
        let (x, y) = (
            self.center[0] - other.center[0],
            self.center[1] - other.center[1],
        );
        let turn = (self.turn[0] * other.turn[1] - self.turn[1] * other.turn[0]).abs();
        [(x * x + y * y).sqrt(), turn]
    }
}

/// A point of a pose's outline on the edge of the sweep, with the area terms' slopes there.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// Where, in a.
    pub at: [f32; 2],
    /// Outward unit normal.
    pub normal: [f32; 2],
    /// Derivative of a cell's distance by the heading; by the centre it is the negative normal.
    pub by_heading: f32,
    /// Number of its pose.
    pub pose: u32,
    /// Outline point at or before it.
    pub number: u32,
    /// Collected slope of the objective by the distance.
    pub slope: f32,
    /// Collected curvature.
    pub curvature: f32,
}

/// Contacts of one pose while the next is evaluated: which of the two sides of each is joined.
#[derive(Clone, Copy, Debug, Default)]
struct Joined {
    first: usize,
    count: usize,
    sides: [u8; CONTACTS_MAX],
}

/// Both sides of a contact are joined.
const BOTH: u8 = 3;

/// The sweep of all passes.
#[derive(Clone, Debug)]
pub struct Sweep<'a> {
    pub(super) shape: Shape,
    scale: ToolScale<'a>,
    pub(super) cells: Cells,
    pub(super) visits: Visits,
    pub(super) poses: Vec<Pose>,
    pub(super) contacts: Vec<Contact>,
    /// The two contacts of each strip.
    pub(super) strips: Vec<[u32; 2]>,
    pub(super) marked: Marked,
    /// Cells next to the strip that is being swept.
    pub(super) beside: Vec<Beside>,
    pub(super) inside: Inside,
    /// Of the poses of a span, its end included.
    pub(super) bases: [Basis; POSES_A_SPAN + 1],
    end_bases: [Basis; 2],
}

impl<'a> Sweep<'a> {
    /// Nothing swept yet; a return counts after `return_path`, in a.
    pub fn new(shape: Shape, cells: Cells, return_path: f32, scale: ToolScale<'a>) -> Sweep<'a> {
        let share = |k: usize| k as f64 / POSES_A_SPAN as f64;
        Sweep {
            visits: Visits::new(cells.wall_cover.len(), return_path),
            marked: Marked::new(cells.rows),
            beside: Vec::new(),
            inside: shape.inside(),
            shape,
            scale,
            cells,
            poses: Vec::new(),
            contacts: Vec::new(),
            strips: Vec::new(),
            bases: std::array::from_fn(|k| Basis::at(share(k))),
            end_bases: [Basis::at(END_SHARE), Basis::at(1.0 - END_SHARE)],
        }
    }

    /// How far the aperture reaches from its middle, a, by the poses swept last.
    pub fn radius(&self) -> f64 {
        let own = self.shape.radius();
        let size = self.poses.iter().map(|pose| pose.size).fold(0.0, f32::max);
        f64::from(own * size)
    }

    /// Only the cells within `reach` of these knots count from now on.
    pub fn keep_near(&mut self, knots: &[Knot], reach: f64) {
        let centers = knots.iter().map(|knot| self.scale.at(knot).center);
        self.cells.keep_near(centers, reach);
        self.visits = self.visits.for_cells(self.cells.wall_cover.len());
    }

    /// Sweeps all passes again.
    pub fn run(&mut self, knots: &[Knot], passes: &[PassKnots]) {
        self.poses.clear();
        self.contacts.clear();
        self.strips.clear();
        self.visits.clear();
        let mut path = 0.0;
        for pass in passes {
            let first = self.poses.len();
            path = self.place(knots, pass, path) + BETWEEN_PASSES;
            self.marked.clear();
            self.sweep_pass(first);
        }
    }

    /// Puts the poses of one pass in a row; the path at its end.
    fn place(&mut self, knots: &[Knot], pass: &PassKnots, path: f32) -> f32 {
        let first = self.poses.len();
        let last = pass.spans * POSES_A_SPAN;
        let mut path = path;
        for k in 0..=last {
            let span = (k / POSES_A_SPAN).min(pass.spans - 1);
            let basis = k - span * POSES_A_SPAN;
            let motion = match k {
                0 => &self.end_bases[0],
                k if k == last => &self.end_bases[1],
                _ => &self.bases[basis],
            };
            let knot = pass.first + span;
            let at = blend(&self.bases[basis].value, &knots[knot..]);
            let rate = blend(&motion.first, &knots[knot..]);
            let (sin, cos) = (at[2] as f32).sin_cos();
            let tool = self.scale.at(&at);
            let [center, velocity] =
                [tool.center, [rate[0], rate[1]]].map(|v| to_grid(v).map(|c| c as f32));
            let turn = to_grid([f64::from(cos), f64::from(sin)]).map(|c| c as f32);
            let mut pose = Pose {
                center,
                size: tool.size as f32,
                inverse: tool.inverse as f32,
                turn,
                velocity,
                turning: rate[2] as f32,
                path,
                knot: knot as u32,
                basis: basis as u32,
            };
            if self.poses.len() > first {
                let before = &self.poses[self.poses.len() - 1];
                let [moved, turned] = pose.motion_from(before);
                if moved + turned < STEP_MIN && k != last {
                    continue;
                }
                path += moved;
                pose.path = path;
            }
            self.poses.push(pose);
        }
        path
    }

    /// Sweeps the poses from `first` on.
    fn sweep_pass(&mut self, first: usize) {
        let count = self.poses.len();
        let mut before = Joined::default();
        for i in first..count {
            let mut here = self.touch(i, first..count);
            if i > first {
                self.mark_between(i);
                self.join(i, &mut before, &mut here);
                self.close(i - 1, first..count, &before);
            }
            before = here;
        }
        if count > first {
            self.close(count - 1, first..count, &before);
        }
    }

    /// Finds the contacts of pose `i` with the envelope.
    fn touch(&mut self, i: usize, pass: std::ops::Range<usize>) -> Joined {
        let pose = self.poses[i];
        let mut touches = [Touch::default(); CONTACTS_MAX];
        let velocity = pose.in_tool(pose.velocity);
        let found = self.shape.touches(velocity, pose.turning, &mut touches);
        let first = self.contacts.len();
        for touch in &touches[..found] {
            let turned = pose.in_plane(touch.at.point);
            let at = [pose.center[0] + turned[0], pose.center[1] + turned[1]];
            let is_nearest = |other: usize| self.gauge2(other, at) < 1.0 - NEAREST;
            if (i > pass.start && is_nearest(i - 1)) || (i + 1 < pass.end && is_nearest(i + 1)) {
                continue;
            }
            self.add_contact(i, touch.number, &touch.at);
        }
        Joined {
            first,
            count: self.contacts.len() - first,
            sides: [0; CONTACTS_MAX],
        }
    }

    /// The squared gauge of pose `i` at a point of the plane.
    #[inline]
    fn gauge2(&self, i: usize, at: [f32; 2]) -> f32 {
        let pose = &self.poses[i];
        self.shape
            .gauge2(pose.in_tool([at[0] - pose.center[0], at[1] - pose.center[1]]))
    }

    fn add_contact(&mut self, i: usize, number: usize, at: &OutlinePoint) -> usize {
        let pose = &self.poses[i];
        let (point, normal) = (pose.in_plane(at.point), pose.turned_out(at.normal));
        self.contacts.push(Contact {
            at: [pose.center[0] + point[0], pose.center[1] + point[1]],
            normal,
            by_heading: point[1] * normal[0] - point[0] * normal[1],
            pose: i as u32,
            number: number as u32,
            slope: 0.0,
            curvature: 0.0,
        });
        self.contacts.len() - 1
    }

    /// Joins the contacts of pose `i` with the nearest of the pose before that face in the same
    /// direction.
    fn join(&mut self, i: usize, before: &mut Joined, here: &mut Joined) {
        let [moved, turned] = self.poses[i].motion_from(&self.poses[i - 1]);
        let reach = JOIN_REACH * (moved + turned) + JOIN_SLACK;
        let path = self.poses[i].path;
        let mut used = [false; CONTACTS_MAX];
        for k in 0..here.count {
            let own = self.contacts[here.first + k];
            let mut best = (reach * reach, None);
            for (o, _) in used[..before.count]
                .iter()
                .enumerate()
                .filter(|(_, used)| !**used)
            {
                let other = &self.contacts[before.first + o];
                if dot(own.normal, other.normal) < JOIN_COSINE {
                    continue;
                }
                let way = [other.at[0] - own.at[0], other.at[1] - own.at[1]];
                let distance2 = dot(way, way);
                let normals = [
                    own.normal[0] + other.normal[0],
                    own.normal[1] + other.normal[1],
                ];
                if dot(way, normals).powi(2) > JOIN_SLOPE * JOIN_SLOPE * 4.0 * distance2 {
                    continue;
                }
                if distance2 < best.0 {
                    best = (distance2, Some(o));
                }
            }
            if let Some(o) = best.1 {
                used[o] = true;
                before.sides[o] |= 2;
                here.sides[k] |= 1;
                self.strip(before.first + o, here.first + k, path, None);
            }
        }
    }

    /// Clears `visible` where an outline point of pose `i` is inside pose `other`, by more than a tolerance that
    /// grows with the motion between them.
    fn hide(&self, i: usize, other: usize, visible: &mut [bool]) {
        let (own, over) = (&self.poses[i], &self.poses[other]);
        let shift = over.in_tool([
            own.center[0] - over.center[0],
            own.center[1] - over.center[1],
        ]);
        let larger = own.size * over.inverse;
        let cos = larger * dot(own.turn, over.turn);
        let sin = larger * (own.turn[1] * over.turn[0] - own.turn[0] * over.turn[1]);
        let [moved, turned] = own.motion_from(over);
        let least = 1.0 - HIDDEN_MAX.min(HIDDEN_SHARE * (moved + turned));
        self.shape.hide(shift, [cos, sin], least, visible);
    }

    /// Closes the envelope with the outline of pose `i` where no neighbour covers it and no strip runs.
    fn close(&mut self, i: usize, pass: std::ops::Range<usize>, joined: &Joined) {
        let mut all = [true; OUTLINE_MAX];
        let count = self.shape.outline().len();
        let visible = &mut all[..count];
        if i > pass.start {
            self.hide(i, i - 1, visible);
        }
        if i + 1 < pass.end {
            self.hide(i, i + 1, visible);
        }
        for k in (0..joined.count).filter(|&k| joined.sides[k] == BOTH) {
            hide_own(self.contacts[joined.first + k].number as usize, visible);
        }
        if !visible.contains(&true) {
            return;
        }
        let pose = self.poses[i];
        let path = pose.path;
        let mut last: Option<(usize, usize)> = None;
        for k in 0..count {
            let next = if k + 1 < count { k + 1 } else { 0 };
            if !(visible[k] || visible[next]) {
                continue;
            }
            let from = match last {
                Some((at, contact)) if at == k => contact,
                _ => {
                    let at = self.shape.outline()[k];
                    self.add_contact(i, k, &at)
                }
            };
            let at = self.shape.outline()[next];
            let to = self.add_contact(i, next, &at);
            self.strip(from, to, path, Some(&pose));
            last = Some((k + 1, to));
        }
    }
}

/// Clears a short visible run around a contact that has strips on both sides: it is theirs.
fn hide_own(number: usize, visible: &mut [bool]) {
    let count = visible.len();
    let (each, all) = (OWN_EACH * count / OWN_OF, OWN_ALL * count / OWN_OF);
    // At most once around.
    let within = |number: usize| number.checked_sub(count).unwrap_or(number);
    let point = |ahead: usize| within(number + ahead);
    let behind = |back: usize| within(number + count - back);
    let (mut left, mut right) = (0, 1);
    while left < each && visible[behind(left)] {
        left += 1;
    }
    while right < each && visible[point(right)] {
        right += 1;
    }
    if left + right > all {
        (left, right) = (1, 2);
    }
    for back in 0..=left {
        visible[behind(back)] = false;
    }
    for ahead in 0..=right {
        visible[point(ahead)] = false;
    }
}

/// Dot product.
#[inline]
fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

/// The contacts of a strip as numbers.
pub fn is_strip(strip: u32) -> bool {
    strip != NO_STRIP
}

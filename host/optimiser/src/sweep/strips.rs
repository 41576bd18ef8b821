//! The two kernels of the sweep: cells next to a strip, and cells that the interior of the aperture
//! enters.
//!
//! In: two contacts of the envelope, or two poses; lengths in a. Out: visits of cells. The optimiser spends most
//! of its time here: f32, no allocation.

use super::cells::{LANES, OUTSIDE, Seen};
use super::{Contact, Pose, Sweep, dot};

/// Rows of a mark that are evaluated together.
const ROWS: usize = 2 * LANES;
/// Most marks between two poses.
const MARKS_MAX: usize = 64;

/// The rows that the inside of the aperture marked last.
#[derive(Clone, Debug)]
pub struct Marked {
    rows: std::ops::Range<usize>,
    columns: Vec<[u32; 2]>,
}

impl Marked {
    /// Nothing marked.
    pub fn new(rows: usize) -> Marked {
        Marked {
            rows: 0..0,
            columns: vec![[0, 0]; rows],
        }
    }

    /// Forgets what was marked.
    pub fn clear(&mut self) {
        self.rows = 0..0;
    }
}

/// One end of a strip: its contact and the direction along the strip there.
struct End {
    at: [f32; 2],
    normal: [f32; 2],
    along: [f32; 2],
}

impl End {
    fn of(contact: &Contact, chord: [f32; 2]) -> End {
        let [x, y] = contact.normal;
        let along = [-y, x];
        let sign = if dot(along, chord) < 0.0 { -1.0 } else { 1.0 };
        End {
            at: contact.at,
            normal: contact.normal,
            along: [sign * along[0], sign * along[1]],
        }
    }
}

/// The envelope between two contacts.
struct Strip {
    ends: [End; 2],
    /// Unit normal of the chord, outwards.
    across: [f32; 2],
    /// Distances beyond the envelope between which cells count.
    bounds: [f32; 2],
}

impl Strip {
    /// Between two contacts; `None` if they coincide.
    fn between(a: &Contact, b: &Contact, bounds: [f32; 2]) -> Option<Strip> {
        let chord = [b.at[0] - a.at[0], b.at[1] - a.at[1]];
        let length2 = dot(chord, chord);
        if length2 < 1e-12 {
            return None;
        }
        let mut across = [-chord[1], chord[0]].map(|c| c / length2.sqrt());
        if dot(across, a.normal) + dot(across, b.normal) < 0.0 {
            across = across.map(|c| -c);
        }
        Some(Strip {
            ends: [End::of(a, chord), End::of(b, chord)],
            across,
            bounds,
        })
    }

    /// Least and greatest x (`c` 0) or y (1) of the strip.
    fn range(&self, c: usize) -> [f32; 2] {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for end in &self.ends {
            for far in self.bounds {
                let at = end.at[c] + far * end.normal[c];
                (low, high) = (low.min(at), high.max(at));
            }
        }
        [low, high]
    }

    /// Places cells of a row, from the one with its middle at `x`, against the envelope: the distance beyond it, the mean
    /// of those to the chord and to the tangents (right to second order), and the share of the way from the first contact
    /// to the second. Kept apart from its caller, so that the compiler computes the lanes together.
    #[inline(never)]
    fn place(&self, columns: [i32; LANES], [x0, size]: [f32; 2], y: f32, lanes: &mut Lanes) {
        let [a, b] = &self.ends;
        let [least, most] = self.bounds;
        let (y_a, y_b) = (y - a.at[1], y - b.at[1]);
        for (k, column) in columns.into_iter().enumerate() {
            let x = x0 + column as f32 * size;
            let (x_a, x_b) = (x - a.at[0], x - b.at[0]);
            let past_a = x_a * a.along[0] + y_a * a.along[1];
            let past_b = x_b * b.along[0] + y_b * b.along[1];
            let share = past_a / (past_a - past_b);
            let beyond_a = x_a * a.normal[0] + y_a * a.normal[1];
            let beyond_b = x_b * b.normal[0] + y_b * b.normal[1];
            let tangents = (1.0 - share) * beyond_a + share * beyond_b;
            let distance = 0.5 * (tangents + (x_a * self.across[0] + y_a * self.across[1]));
            lanes.distance[k] = distance;
            lanes.share[k] = share;
            // Between the normals of both contacts, and near.
            let off = [
                past_a < 0.0,
                past_b >= 0.0,
                distance >= most,
                distance <= least,
            ];
            lanes.off[k] = off.map(u32::from).into_iter().fold(0, |all, one| all | one);
        }
    }
}

/// Some cells of a row against a strip; `off` is 0 for those beside it.
#[derive(Default)]
struct Lanes {
    distance: [f32; LANES],
    share: [f32; LANES],
    off: [u32; LANES],
}

/// A cell beside a strip: its place in the box, with its distance and its share of the strip.
#[derive(Clone, Copy, Debug, Default)]
pub struct Beside {
    at: u32,
    distance: f32,
    share: f32,
}

impl Sweep<'_> {
    /// Sees the cells within the edge's half width of the envelope between two contacts, at this path. Where the
    /// strip closes the envelope by a pose's own outline, cells nearer to another side of that outline are left to it.
    pub(super) fn strip(&mut self, from: usize, to: usize, path: f32, closes: Option<&Pose>) {
        let [a, b] = [from, to].map(|contact| &self.contacts[contact]);
        let bounds = [-self.shape.deep(), self.cells.edge_half];
        let Some(strip) = Strip::between(a, b, bounds) else {
            return;
        };
        let number = self.strips.len() as u32;
        self.strips.push([from as u32, to as u32]);
        let count = self.find_beside(&strip);
        for cell in &self.beside[..count] {
            let number_of_cell = self.cells.numbers[cell.at as usize];
            let is_other = |pose: &Pose| self.is_nearer_elsewhere(pose, cell);
            if number_of_cell == OUTSIDE || closes.is_some_and(is_other) {
                continue;
            }
            let seen = Seen {
                from: path,
                last: path,
                distance: cell.distance,
                strip: number,
                share: cell.share,
            };
            self.visits.see(number_of_cell, seen);
        }
    }

    /// Collects the cells beside a strip; their number. A branch for each cell of the box would be hard to predict.
    fn find_beside(&mut self, strip: &Strip) -> usize {
        let ([left, right], [low, high]) = (strip.range(0), strip.range(1));
        let columns = self.cells.columns_in(left, right);
        let [x0, y0] = self.cells.first_middle();
        let size = self.cells.size as f32;
        let mut lanes = Lanes::default();
        let mut count = 0;
        for row in self.cells.rows_in(low, high) {
            let y = y0 + row as u32 as i32 as f32 * size;
            let mut first = columns.start;
            while first < columns.end {
                let columns_here = std::array::from_fn(|k| (first + k) as i32);
                strip.place(columns_here, [x0, size], y, &mut lanes);
                if count + LANES > self.beside.len() {
                    self.beside.resize(2 * (count + LANES), Beside::default());
                }
                let room = &mut self.beside[count..count + LANES];
                let mut held = 0;
                for k in 0..LANES {
                    room[held % LANES] = Beside {
                        at: (row * self.cells.columns + first + k) as u32,
                        distance: lanes.distance[k],
                        share: lanes.share[k],
                    };
                    let counts = (first + k < columns.end) & (lanes.off[k] == 0);
                    held += usize::from(counts);
                }
                count += held;
                first += LANES;
            }
        }
        count
    }

    /// Whether a cell is nearer to another side of a pose's outline than to the strip.
    fn is_nearer_elsewhere(&self, pose: &Pose, cell: &Beside) -> bool {
        let [x0, y0] = self.cells.first_middle();
        let size = self.cells.size as f32;
        let [column, row] = [
            cell.at as usize % self.cells.columns,
            cell.at as usize / self.cells.columns,
        ];
        let (x, y) = (x0 + column as f32 * size, y0 + row as f32 * size);
        let off = [x - pose.center[0], y - pose.center[1]];
        self.shape
            .is_nearer(pose.in_tool(off), cell.distance * pose.inverse)
    }

    /// Marks what the inside of the aperture enters between pose `i` and the one before.
    pub(super) fn mark_between(&mut self, i: usize) {
        let (before, pose) = (self.poses[i - 1], self.poses[i]);
        let [moved, turned] = pose.motion_from(&before);
        let way = [
            pose.center[0] - before.center[0],
            pose.center[1] - before.center[1],
        ];
        let direction = if moved > 1e-6 {
            way.map(|c| c / moved)
        } else {
            [1.0, 0.0]
        };
        let marks = (((moved + turned) / self.shape.mark_step()) as usize + 1).min(MARKS_MAX);
        for k in 0..marks {
            let t = (k as f32 + 0.5) / marks as f32;
            let mix = |a: f32, b: f32| a + (b - a) * t;
            let turn = [
                mix(before.turn[0], pose.turn[0]),
                mix(before.turn[1], pose.turn[1]),
            ];
            let length = dot(turn, turn).sqrt().max(1e-6);
            let at = Pose {
                center: [
                    mix(before.center[0], pose.center[0]),
                    mix(before.center[1], pose.center[1]),
                ],
                turn: turn.map(|c| c / length),
                path: mix(before.path, pose.path),
                ..pose
            };
            self.mark(&at, direction);
        }
    }

    /// Sees the cells that the inside of the aperture enters at a pose; they stay in it for its chord along the
    /// direction of motion.
    fn mark(&mut self, pose: &Pose, direction: [f32; 2]) {
        self.shape.turn_inside(pose.turn, &mut self.inside);
        let size = pose.size;
        let last = pose.path + size * self.shape.chord(pose.turned_in(direction));
        let seen = Seen::inside(pose.path, last);
        let [x, y] = pose.center;
        let y0 = self.cells.first_middle()[1];
        let [bottom, top] = self.inside.heights().map(|height| size * height);
        let rows = self.cells.rows_in(y + bottom, y + top);
        for first in rows.clone().step_by(ROWS) {
            let mut above = [0.0; ROWS];
            for (k, above) in above.iter_mut().enumerate() {
                let row = (first + k) as u32 as i32;
                *above = (y0 + row as f32 * self.cells.size as f32 - y) * pose.inverse;
            }
            let [mut low, mut high] = self.inside.rows(&above);
            for end in low.iter_mut().chain(&mut high) {
                *end = x + size * *end;
            }
            let (from, to) = (self.cells.columns_at(&low), self.cells.columns_at(&high));
            let held = rows.end.min(first + ROWS) - first;
            for (k, row) in (first..first + held).enumerate() {
                self.mark_row(row, [from[k], to[k]], seen);
            }
        }
        self.marked.rows = rows;
    }

    /// Sees the cells of a row between two columns that the mark before did not hold.
    #[inline]
    fn mark_row(&mut self, row: usize, [start, end]: [u32; 2], seen: Seen) {
        let mut held = [end, end];
        if self.marked.rows.contains(&row) {
            let before = self.marked.columns[row];
            if before[0] < before[1] {
                held = before;
            }
        }
        self.marked.columns[row] = [start, end];
        let numbers = &self.cells.numbers[row * self.cells.columns..][..self.cells.columns];
        for (from, to) in [(start, end.min(held[0])), (start.max(held[1]), end)] {
            for column in from..to {
                let number = numbers[column as usize];
                if number != OUTSIDE {
                    self.visits.see(number, seen);
                }
            }
        }
    }
}

//! The two kernels of the sweep: cells next to a strip, and cells that the interior of the aperture
//! enters.
//!
//! In: two contacts of the envelope, or two poses; lengths in a. Out: visits of cells. The optimiser spends most
//! of its time here: f32, no allocation.

use super::cells::{OUTSIDE, Seen};
use super::{Contact, Pose, Sweep, dot};

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
}

impl Strip {
    /// Between two contacts; `None` if they coincide.
    fn between(a: &Contact, b: &Contact) -> Option<Strip> {
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
        })
    }

    /// Least and greatest x (`c` 0) or y (1) from `deep` below the envelope to `reach` above it.
    fn range(&self, c: usize, deep: f32, reach: f32) -> [f32; 2] {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for end in &self.ends {
            for far in [-deep, reach] {
                let at = end.at[c] + far * end.normal[c];
                (low, high) = (low.min(at), high.max(at));
            }
        }
        [low, high]
    }

    /// Distance of a point beyond the envelope, the mean of those to the chord and to the tangents (right to second
    /// order), and its place from the first contact to the second; `None` if it is not between their normals.
    #[inline]
    fn distance(&self, x: f32, y: f32) -> Option<[f32; 2]> {
        let [a, b] = &self.ends;
        let from_a = [x - a.at[0], y - a.at[1]];
        let from_b = [x - b.at[0], y - b.at[1]];
        let (past_a, past_b) = (dot(from_a, a.along), dot(from_b, b.along));
        if past_a < 0.0 || past_b >= 0.0 {
            return None;
        }
        let share = past_a / (past_a - past_b);
        let tangents = (1.0 - share) * dot(from_a, a.normal) + share * dot(from_b, b.normal);
        Some([0.5 * (tangents + dot(from_a, self.across)), share])
    }
}

impl Sweep<'_> {
    /// Sees the cells within the edge's half width of the envelope between two contacts, at this path. Where the
    /// strip closes the envelope by a pose's own outline, cells nearer to another side of that outline are left to it.
    pub(super) fn strip(&mut self, from: usize, to: usize, path: f32, closes: Option<&Pose>) {
        let Some(strip) = Strip::between(&self.contacts[from], &self.contacts[to]) else {
            return;
        };
        let number = self.strips.len() as u32;
        self.strips.push([from as u32, to as u32]);
        let (reach, deep) = (self.cells.edge_half, self.shape.deep());
        let [left, right] = strip.range(0, deep, reach);
        let [low, high] = strip.range(1, deep, reach);
        let columns = self.cells.columns_in(left, right);
        let [x0, y0] = self.cells.first_middle();
        let size = self.cells.size as f32;
        for row in self.cells.rows_in(low, high) {
            let y = y0 + row as f32 * size;
            let numbers = &self.cells.numbers[row * self.cells.columns..][..self.cells.columns];
            for column in columns.clone() {
                let x = x0 + column as f32 * size;
                let Some([distance, share]) = strip.distance(x, y) else {
                    continue;
                };
                if distance >= reach || distance <= -deep || numbers[column] == OUTSIDE {
                    continue;
                }
                let is_other = |pose: &Pose| {
                    let off = [x - pose.center[0], y - pose.center[1]];
                    self.shape
                        .is_nearer(pose.in_tool(off), distance * pose.inverse)
                };
                if closes.is_some_and(is_other) {
                    continue;
                }
                let seen = Seen {
                    from: path,
                    last: path,
                    distance,
                    strip: number,
                    share,
                };
                self.visits.see(numbers[column], seen);
            }
        }
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
        for row in rows.clone() {
            let above = y0 + row as f32 * self.cells.size as f32 - y;
            let [low, high] = self.inside.row(above * pose.inverse).map(|x| size * x);
            let columns = self.cells.columns_in(x + low, x + high);
            let mut held = columns.end..columns.end;
            if self.marked.rows.contains(&row) {
                let [from, to] = self.marked.columns[row];
                if from < to {
                    held = from as usize..to as usize;
                }
            }
            self.marked.columns[row] = [columns.start as u32, columns.end as u32];
            let numbers = &self.cells.numbers[row * self.cells.columns..][..self.cells.columns];
            let entered_low = columns.start..columns.end.min(held.start);
            let entered_high = columns.start.max(held.end)..columns.end;
            for column in entered_low.chain(entered_high) {
                if numbers[column] != OUTSIDE {
                    self.visits.see(numbers[column], seen);
                }
            }
        }
        self.marked.rows = rows;
    }
}

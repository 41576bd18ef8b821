//! The head over a cell, as rows of cells along x.
//!
//! Each section of the profile is convex, so that a row of it is one interval: its ends follow from a quadratic equation and are then
//! moved to the last cell that [`meets`] holds for.

use super::grid::Part;
use crate::Vector3;
use crate::profile::HeadProfile;

/// What rounding may decide.
const EPSILON: f64 = 1e-9;

/// Rows of one height.
pub(super) struct Plane {
    pub(super) dz: i16,
    pub(super) dy_first: i32,
    pub(super) dy_end: i32,
    /// Of the row `dy_first` in `starts`.
    first: usize,
}

/// The cells that the head contains, from the cell under the aperture.
pub(super) struct HeadRows {
    /// The closest ones first.
    pub(super) planes: Vec<Plane>,
    starts: Vec<u32>,
    spans: Vec<[i16; 2]>,
}

/// Whether the head along `axis` contains the middle of a cell some cells away.
pub(super) fn meets(
    head: &HeadProfile,
    axis: &Vector3,
    voxel_mm: f64,
    slack_mm: f64,
    away: &Vector3,
) -> bool {
    let along_mm = away.dot(axis);
    let height_mm = along_mm - 0.5 * voxel_mm;
    let radius_mm = head.radius_mm(height_mm);
    height_mm > slack_mm + EPSILON
        && away.norm_squared() - along_mm * along_mm <= radius_mm * radius_mm + EPSILON
}

impl HeadRows {
    pub(super) fn new(part: &Part, axis: &Vector3, head: &HeadProfile, slack_mm: f64) -> HeadRows {
        let [nx, ny, nz] = part.size().map(|n| n as i32 - 1);
        let (mut planes, mut starts, mut spans) = (Vec::new(), Vec::new(), Vec::new());
        let sections: Vec<[[f64; 2]; 2]> = head.sections().chain([open_top(head)]).collect();
        let line = Row {
            axis,
            head,
            voxel_mm: part.voxel_mm(),
            slack_mm,
            end: nx,
        };
        for dz in (0..=nz).flat_map(|z| [z, -z]).skip(1) {
            let first = starts.len();
            let mut rows = None;
            for dy in -ny..=ny {
                let before = spans.len();
                for section in &sections {
                    line.spans(section, [dy, dz], &mut spans);
                }
                if spans.len() > before || rows.is_some() {
                    starts.push(before as u32);
                }
                if spans.len() > before {
                    rows = Some([rows.map_or(dy, |[low, _]: [i32; 2]| low), dy + 1]);
                }
            }
            let Some([dy_first, dy_end]) = rows else {
                continue;
            };
            starts.truncate(first + (dy_end - dy_first) as usize);
            starts.push(spans.len() as u32);
            planes.push(Plane {
                dz: dz as i16,
                dy_first,
                dy_end,
                first,
            });
        }
        HeadRows {
            planes,
            starts,
            spans,
        }
    }

    /// The intervals of a row, from `dy_first` to before `dy_end`.
    #[inline]
    pub(super) fn spans(&self, plane: &Plane, dy: i32) -> &[[i16; 2]] {
        let at = plane.first + (dy - plane.dy_first) as usize;
        &self.spans[self.starts[at] as usize..self.starts[at + 1] as usize]
    }
}

/// Above the top: something carries the head.
fn open_top(head: &HeadProfile) -> [[f64; 2]; 2] {
    let [height_mm, radius_mm] = head.knots()[head.knots().len() - 1];
    [[height_mm, radius_mm], [f64::INFINITY, radius_mm]]
}

struct Row<'a> {
    axis: &'a Vector3,
    head: &'a HeadProfile,
    voxel_mm: f64,
    slack_mm: f64,
    /// The last cell on either side.
    end: i32,
}

impl Row<'_> {
    /// Adds the cells of a section, in the row by y and z.
    fn spans(
        &self,
        [[low_mm, from_mm], [high_mm, to_mm]]: &[[f64; 2]; 2],
        yz: [i32; 2],
        spans: &mut Vec<[i16; 2]>,
    ) {
        if high_mm <= low_mm || *high_mm <= self.slack_mm {
            return;
        }
        let [y_mm, z_mm] = yz.map(|n| f64::from(n) * self.voxel_mm);
        // Height above the tip: out x + base.
        let base_mm = y_mm * self.axis.y + z_mm * self.axis.z - 0.5 * self.voxel_mm;
        let Some([low, high]) = self.between(base_mm, low_mm.max(self.slack_mm), *high_mm) else {
            return;
        };
        let slope = if high_mm.is_finite() {
            (to_mm - from_mm) / (high_mm - low_mm)
        } else {
            0.0
        };
        let along_mm = base_mm + 0.5 * self.voxel_mm;
        // Radius: slope out x + wide; squared distance less squared radius: a x² + 2 b x + c.
        let wide_mm = from_mm + slope * (base_mm - low_mm);
        let out = self.axis.x;
        let a = 1.0 - out * out - (slope * out).powi(2);
        let b = -out * along_mm - slope * out * wide_mm;
        let c = y_mm * y_mm + z_mm * z_mm - along_mm * along_mm - wide_mm * wide_mm;
        let holds = |x: i32| {
            let away = Vector3::new(f64::from(x) * self.voxel_mm, y_mm, z_mm);
            x.abs() <= self.end && meets(self.head, self.axis, self.voxel_mm, self.slack_mm, &away)
        };
        let in_cells = |x_mm: f64| (x_mm / self.voxel_mm).clamp(f64::from(low), f64::from(high));
        // The least value of the quadratic, and where it is zero.
        let root = (b * b - a * c).max(0.0).sqrt();
        let (tries, ends) = if a > EPSILON {
            let middle = in_cells(-b / a);
            let ends = [in_cells((-b - root) / a), in_cells((-b + root) / a)];
            ([middle.floor() as i32, middle.ceil() as i32], ends)
        } else {
            ([low, high], [f64::from(low), f64::from(high)])
        };
        let Some(inside) = tries.into_iter().find(|&x| holds(x)) else {
            return;
        };
        let end_on = |sign: i32, guess: i32| {
            let mut x = if (guess - inside) * sign > 0 {
                guess
            } else {
                inside
            };
            while x != inside && !holds(x) {
                x -= sign;
            }
            while holds(x + sign) {
                x += sign;
            }
            x
        };
        let span = [
            end_on(-1, ends[0].round() as i32),
            end_on(1, ends[1].round() as i32),
        ]
        .map(|x| x as i16);
        spans.push(span);
    }

    /// The cells of a row whose heights are between two, and one more on either side.
    fn between(&self, base_mm: f64, low_mm: f64, high_mm: f64) -> Option<[i32; 2]> {
        let end = f64::from(self.end);
        let out_mm = self.axis.x * self.voxel_mm;
        if out_mm.abs() < 1e-12 {
            let holds = base_mm >= low_mm - EPSILON && base_mm <= high_mm + EPSILON;
            return holds.then_some([-self.end, self.end]);
        }
        let mut ends = [(low_mm - base_mm) / out_mm, (high_mm - base_mm) / out_mm];
        ends.sort_by(f64::total_cmp);
        let low = (ends[0] - EPSILON).ceil().clamp(-end, end + 1.0) as i32;
        let high = (ends[1] + EPSILON).floor().clamp(-end - 1.0, end) as i32;
        (low <= high).then_some([low, high])
    }
}

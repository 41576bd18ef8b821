//! The region as cells, with the visits of each.
//!
//! In: the walls, and area inside them that does not count, in a. Out: numbered cells of the rest with the coverage
//! contributed by an adjacent wall; visits by the sweep with a distance to the edge of the swept area. A cell's
//! coverage is a smooth step of that distance, so that the covered area has a derivative by the path.

/// Cell size, in half widths of the edge.
const CELL: f64 = 0.8;
/// Half the width of the smooth step at the edge of the sweep, in a, and at most in b.
const EDGE_HALF: f64 = 1.0 / 6.0;
const EDGE_HALF_MINOR: f64 = 0.6;
/// Half the path over which a return increases from no visit to a full one, in a.
const RETURN_RAMP: f32 = 0.5;
/// Most cells of the box about the region: beyond that they grow, to the half width of the edge at most.
const CELLS_MAX: f64 = 60e6;
/// Cosine and sine of the angle by which the grid is turned: its tangent is the square of the golden ratio's inverse,
/// so that neither walls along the axes nor diagonals fall in step with the cells.
const TURN: [f64; 2] = [0.934_172_358_962_715_7, 0.356_822_089_773_089_9];
/// Cells of a row, or rows, that are evaluated together.
pub const LANES: usize = 4;
/// Number of a cell outside the region.
pub const OUTSIDE: u32 = u32::MAX;
/// Strip number of a visit by the inside of the aperture.
pub const NO_STRIP: u32 = u32::MAX;

/// Cover at distance z (in half widths) beyond the edge: 1 well inside, 0 outside, C² in between.
#[inline]
pub fn cover(z: f32) -> f32 {
    if z <= -1.0 {
        1.0
    } else if z >= 1.0 {
        0.0
    } else {
        let y = z * z;
        0.5 - 0.9375 * z * (1.0 - y * (2.0 / 3.0) + y * y * 0.2)
    }
}

/// Derivative of [`cover`].
#[inline]
pub fn cover_slope(z: f32) -> f32 {
    let y = 1.0 - z * z;
    if y <= 0.0 { 0.0 } else { -0.9375 * y * y }
}

/// Half the width of the smooth step for an aperture with this b, in a.
pub fn edge_half(minor: f64) -> f64 {
    EDGE_HALF.min(EDGE_HALF_MINOR * minor)
}

/// A vector of the plane in the frame of the grid.
#[inline]
pub fn to_grid([x, y]: [f64; 2]) -> [f64; 2] {
    let [cos, sin] = TURN;
    [cos * x - sin * y, sin * x + cos * y]
}

/// A vector of the grid's frame in the plane.
#[inline]
pub fn from_grid([x, y]: [f64; 2]) -> [f64; 2] {
    let [cos, sin] = TURN;
    [cos * x + sin * y, cos * y - sin * x]
}

/// The first of `count` columns or rows from `origin` on whose middle is not below `v`.
#[inline]
fn place(v: f32, origin: f32, inverse: f32, count: usize) -> u32 {
    // A cast cuts off towards zero and saturates; NaN is 0.
    (((v - origin) * inverse + 0.5) as i32).clamp(0, count as i32) as u32
}

/// An edge of the region, in a.
pub type Segment = [[f64; 2]; 2];

/// The cells of a region.
#[derive(Clone, Debug)]
pub struct Cells {
    /// Side of a cell, in a.
    pub size: f64,
    /// Half the width of the smooth step, in a.
    pub edge_half: f32,
    /// Columns and rows of the box about the region.
    pub columns: usize,
    /// Rows of it.
    pub rows: usize,
    /// Number of each cell of the box, row by row, or [`OUTSIDE`]; [`LANES`] of these at the end spare the bounds.
    pub numbers: Vec<u32>,
    /// Coverage contributed by the wall, by number: the area beyond it counts as laid.
    pub wall_cover: Vec<f32>,
    origin: [f64; 2],
    /// One over the side.
    inverse: f32,
}

impl Cells {
    /// Cells of the region with these edges except for the area that others bound, for an edge of this half width;
    /// `None` if it is too large or empty.
    pub fn of(segments: &[Segment], left_out: &[Segment], edge_half: f64) -> Option<Cells> {
        let turned = |segments: &[Segment]| -> Vec<Segment> {
            segments.iter().map(|ends| ends.map(to_grid)).collect()
        };
        let (segments, left_out) = (turned(segments), turned(left_out));
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in segments.iter().flatten() {
            for c in 0..2 {
                low[c] = low[c].min(point[c]);
                high[c] = high[c].max(point[c]);
            }
        }
        let [width, height] = [high[0] - low[0] + 1.0, high[1] - low[1] + 1.0];
        let size = (CELL * edge_half).max((width * height / CELLS_MAX).sqrt());
        if !(width.is_finite() && height.is_finite() && size <= edge_half) {
            return None;
        }
        let (columns, rows) = ((width / size) as usize + 1, (height / size) as usize + 1);
        let mut cells = Cells {
            size,
            edge_half: edge_half as f32,
            columns,
            rows,
            numbers: vec![OUTSIDE; columns * rows + LANES],
            wall_cover: Vec::new(),
            origin: [low[0] - 0.5, low[1] - 0.5],
            inverse: (1.0 / size) as f32,
        };
        cells.number(&segments, &left_out);
        for segment in &segments {
            cells.cover_by_wall(segment);
        }
        Some(cells)
    }

    /// Numbers the cells inside, by where the edges cross the middle of each row.
    fn number(&mut self, segments: &[Segment], left_out: &[Segment]) {
        let outside = self.crossings(left_out);
        let mut count = 0;
        for (row, (inside, outside)) in self.crossings(segments).iter().zip(&outside).enumerate() {
            let first = row * self.columns;
            for pair in inside.chunks_exact(2) {
                for column in self.columns_in(pair[0] as f32, pair[1] as f32) {
                    self.numbers[first + column] = 0;
                }
            }
            for pair in outside.chunks_exact(2) {
                for column in self.columns_in(pair[0] as f32, pair[1] as f32) {
                    self.numbers[first + column] = OUTSIDE;
                }
            }
            for number in &mut self.numbers[first..first + self.columns] {
                if *number != OUTSIDE {
                    *number = count;
                    count += 1;
                }
            }
        }
        self.wall_cover = vec![0.0; count as usize];
    }

    /// Where edges cross the middle of each row, rising.
    fn crossings(&self, segments: &[Segment]) -> Vec<Vec<f64>> {
        let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); self.rows];
        for [p, q] in segments {
            let (low, high) = (p[1].min(q[1]), p[1].max(q[1]));
            for row in self.rows_in(low as f32, high as f32) {
                let y = self.middle(row, 1);
                // The range may miss or exceed by one row for rounding; the test decides.
                if (p[1] <= y) != (q[1] <= y) {
                    crossings[row].push(p[0] + (q[0] - p[0]) * (y - p[1]) / (q[1] - p[1]));
                }
            }
        }
        crossings
            .iter_mut()
            .for_each(|xs| xs.sort_by(f64::total_cmp));
        crossings
    }

    /// Middle of a column (`axis` 0) or row (1).
    fn middle(&self, number: usize, axis: usize) -> f64 {
        self.origin[axis] + (number as f64 + 0.5) * self.size
    }

    /// Raises the cover of the cells along a wall.
    fn cover_by_wall(&mut self, &[p, q]: &Segment) {
        let reach = f64::from(self.edge_half);
        let way = [q[0] - p[0], q[1] - p[1]];
        let length2 = way[0] * way[0] + way[1] * way[1];
        let (low, high) = (p[1].min(q[1]), p[1].max(q[1]));
        for row in self.rows_in((low - reach) as f32, (high + reach) as f32) {
            let y = self.middle(row, 1) - p[1];
            // The part of the wall that is near enough to this row.
            let share = |at: f64| {
                if way[1].abs() > 1e-12 {
                    (at / way[1]).clamp(0.0, 1.0)
                } else {
                    0.5
                }
            };
            let (mut from, mut to) = (share(y - reach), share(y + reach));
            if way[1].abs() <= 1e-12 {
                (from, to) = (0.0, 1.0);
            }
            let [x0, x1] = [p[0] + way[0] * from, p[0] + way[0] * to];
            let range = self.columns_in((x0.min(x1) - reach) as f32, (x0.max(x1) + reach) as f32);
            for column in range {
                let cell = self.numbers[row * self.columns + column];
                if cell == OUTSIDE {
                    continue;
                }
                let x = self.middle(column, 0) - p[0];
                let t = ((x * way[0] + y * way[1]) / (length2 + 1e-30)).clamp(0.0, 1.0);
                let distance = (x - t * way[0]).hypot(y - t * way[1]);
                let cover = cover((distance / reach) as f32);
                let held = &mut self.wall_cover[cell as usize];
                *held = held.max(cover);
            }
        }
    }

    /// Drops all cells but those within `reach` of one of these points of the plane.
    pub fn keep_near(&mut self, points: impl Iterator<Item = [f64; 2]>, reach: f64) {
        let reach = reach as f32;
        let mut kept = vec![false; self.wall_cover.len()];
        for [x, y] in points.map(|at| to_grid(at).map(|c| c as f32)) {
            for row in self.rows_in(y - reach, y + reach) {
                let up = self.middle(row, 1) as f32 - y;
                let aside = (reach * reach - up * up).max(0.0).sqrt();
                let columns = self.columns_in(x - aside, x + aside);
                for &number in &self.numbers[row * self.columns..][columns] {
                    if number != OUTSIDE {
                        kept[number as usize] = true;
                    }
                }
            }
        }
        let mut count = 0;
        for number in &mut self.numbers {
            let Some(old) = (*number != OUTSIDE).then_some(*number as usize) else {
                continue;
            };
            *number = match kept[old] {
                true => {
                    self.wall_cover[count] = self.wall_cover[old];
                    count += 1;
                    count as u32 - 1
                }
                false => OUTSIDE,
            };
        }
        self.wall_cover.truncate(count);
    }

    /// Columns whose middles are in a range of x.
    #[inline]
    pub fn columns_in(&self, low: f32, high: f32) -> std::ops::Range<usize> {
        self.range(low, high, self.origin[0] as f32, self.columns)
    }

    /// Rows whose middles are in a range of y.
    #[inline]
    pub fn rows_in(&self, low: f32, high: f32) -> std::ops::Range<usize> {
        self.range(low, high, self.origin[1] as f32, self.rows)
    }

    #[inline]
    fn range(&self, low: f32, high: f32, origin: f32, count: usize) -> std::ops::Range<usize> {
        let [from, to] = [low, high].map(|v| place(v, origin, self.inverse, count));
        from as usize..to as usize
    }

    /// Bounds of [`Cells::columns_in`] for several rows at once.
    #[inline]
    pub fn columns_at<const N: usize>(&self, xs: &[f32; N]) -> [u32; N] {
        let mut columns = [0; N];
        for (column, &x) in columns.iter_mut().zip(xs) {
            *column = place(x, self.origin[0] as f32, self.inverse, self.columns);
        }
        columns
    }

    /// Middle of column 0 and row 0, f32.
    #[inline]
    pub fn first_middle(&self) -> [f32; 2] {
        [self.middle(0, 0) as f32, self.middle(0, 1) as f32]
    }
}

/// One visit of a cell.
#[derive(Clone, Copy, Debug)]
pub struct Visit {
    /// Path at which the aperture leaves it, in a.
    pub last: f32,
    /// Distance of the cell beyond the edge of the sweep, in a.
    pub distance: f32,
    /// Place on the strip, 0 to 1 from its first contact to its second.
    pub share: f32,
    /// Below 1 for a return so soon that it is not quite a new visit.
    pub weight: f32,
    /// The strip, or [`NO_STRIP`].
    pub strip: u32,
    /// The visit before it: its number among the older ones, [`FIRST`] or, of a cell never visited, [`NEVER`].
    before: u32,
}

/// No visit before this one, and none at all.
const FIRST: u32 = u32::MAX - 1;
const NEVER: u32 = u32::MAX;
/// Distance of a cell over which the interior of the aperture has moved.
const WELL_INSIDE: f32 = -1e3;

/// The visits of all cells: the newest of each in place, the few older ones after them.
#[derive(Clone, Debug)]
pub struct Visits {
    newest: Vec<Visit>,
    older: Vec<Visit>,
    /// Path after which a return begins to count.
    apart: f32,
}

/// The sweep's data at a cell.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Path at its start and end, in a.
    pub from: f32,
    /// Path at its end.
    pub last: f32,
    /// Distance beyond the edge of the sweep.
    pub distance: f32,
    /// Strip and place on it.
    pub strip: u32,
    /// Place on the strip.
    pub share: f32,
}

impl Seen {
    /// By the inside of the aperture.
    pub fn inside(from: f32, last: f32) -> Seen {
        Seen {
            from,
            last,
            distance: WELL_INSIDE,
            strip: NO_STRIP,
            share: 0.0,
        }
    }
}

impl Visits {
    /// No visits yet; a return counts after `return_path`, in a.
    pub fn new(cells: usize, return_path: f32) -> Visits {
        Visits {
            newest: vec![Visit::NONE; cells],
            older: Vec::new(),
            apart: return_path - RETURN_RAMP,
        }
    }

    /// Of another number of cells.
    pub fn for_cells(&self, cells: usize) -> Visits {
        Visits {
            newest: vec![Visit::NONE; cells],
            older: Vec::new(),
            apart: self.apart,
        }
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.newest.fill(Visit::NONE);
        self.older.clear();
    }

    /// A cell is seen: a part of its last visit, or a new one.
    #[inline]
    pub fn see(&mut self, cell: u32, seen: Seen) {
        let newest = &mut self.newest[cell as usize];
        let (mut weight, mut before) = (1.0, FIRST);
        if newest.before != NEVER {
            let gap = seen.from - newest.last - self.apart;
            if gap <= 0.0 {
                newest.last = newest.last.max(seen.last);
                if seen.distance < newest.distance {
                    (newest.distance, newest.strip, newest.share) =
                        (seen.distance, seen.strip, seen.share);
                }
                return;
            }
            weight = (gap / (2.0 * RETURN_RAMP)).min(1.0);
            before = self.older.len() as u32;
            self.older.push(*newest);
        }
        *newest = Visit {
            last: seen.last,
            distance: seen.distance,
            share: seen.share,
            weight,
            strip: seen.strip,
            before,
        };
    }

    /// The coverage of a cell outside all strips: never visited, or once by the interior of the
    /// aperture.
    #[inline]
    pub fn plain_cover(&self, cell: usize) -> Option<f32> {
        let visit = &self.newest[cell];
        match visit.before {
            NEVER => Some(0.0),
            FIRST if visit.strip == NO_STRIP => Some(1.0),
            _ => None,
        }
    }

    /// Whether the interior of the aperture visits a cell once, and nothing else does.
    #[inline]
    pub fn is_covered_once(&self, cell: usize) -> bool {
        let visit = &self.newest[cell];
        visit.before == FIRST && visit.strip == NO_STRIP
    }

    /// The visit of a cell that has one.
    #[inline]
    pub fn only(&self, cell: usize) -> Option<Visit> {
        let visit = self.newest[cell];
        (visit.before == FIRST).then_some(visit)
    }

    /// The visits of a cell in order, as many as fit, otherwise the newest; their number.
    #[inline]
    pub fn of(&self, cell: usize, into: &mut [Visit; VISITS_MAX]) -> usize {
        let mut visit = self.newest[cell];
        let mut count = 0;
        while visit.before != NEVER && count < VISITS_MAX {
            into[count] = visit;
            count += 1;
            visit = match self.older.get(visit.before as usize) {
                Some(older) => *older,
                None => break,
            };
        }
        into[..count].reverse();
        count
    }
}

/// Maximum number of visits of a cell that are evaluated.
pub const VISITS_MAX: usize = 8;

impl Visit {
    /// No visit.
    pub const NONE: Visit = Visit {
        last: 0.0,
        distance: 0.0,
        share: 0.0,
        weight: 1.0,
        strip: NO_STRIP,
        before: NEVER,
    };
}

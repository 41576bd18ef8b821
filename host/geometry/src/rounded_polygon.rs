//! A convex polygon with rounded corners: the shape of every aperture that is not an ellipse.
//!
//! A core (a convex polygon, or a line for the slot) grown by a radius. In: corners in mm about the
//! tool's axis, long side along tool X. Out: support function, distance to a wall, rows of a
//! raster. All in the tool's own frame; [`super::aperture`] rotates it. Corners are stored inline,
//! so that an aperture is `Copy`. Not covered: outlines that are not convex, and arcs of different
//! radii.

use super::Vector2;

/// Most corners of a core.
pub const CORNERS_MAX: usize = 64;
/// Corners closer to the line between their neighbours than this are not corners, mm.
const COLLINEAR_MM: f64 = 1e-7;
/// The tool's axis must be at least this far inside, mm.
const AXIS_INSIDE_MM: f64 = 1e-3;
/// Corners may miss their opposite by this share of the size in a shape of 180° symmetry.
const SYMMETRY_SHARE: f64 = 1e-9;

/// What the user called it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// A slot with round ends: full length and width, mm.
    Stadium([f64; 2]),
    /// A rectangle: full length and width and corner radius, mm.
    Rectangle([f64; 3]),
    /// Any convex polygon, sharp corners.
    Polygon,
}

/// Why corners are not an aperture.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ShapeError {
    /// Fewer than three or more than [`CORNERS_MAX`] true corners.
    #[error("{count} corners where 3 to {CORNERS_MAX} are possible; simplify the outline")]
    Corners {
        /// How many there are.
        count: usize,
    },
    /// Not convex, or crossing itself.
    #[error("not convex at the corner ({x_mm}, {y_mm}) mm; draw its convex outline")]
    NotConvex {
        /// Corner.
        x_mm: f64,
        /// Corner.
        y_mm: f64,
    },
    /// The tool's axis, (0, 0), is not inside.
    #[error("the tool's axis (0, 0) is not inside it; draw the aperture about its centre")]
    AxisOutside,
}

/// The side of the core towards a direction: n·x <= offset for all its points.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Face {
    normal: Vector2,
    offset_mm: f64,
}

/// A convex core with a radius around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoundedPolygon {
    corners: [Vector2; CORNERS_MAX],
    faces: [Face; CORNERS_MAX],
    corner_count: usize,
    face_count: usize,
    radius_mm: f64,
    kind: Kind,
    symmetric: bool,
    widest_mm: f64,
    narrowest_mm: f64,
}

/// Position of a wall relative to the shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// Distance, negative if the wall cuts: the shortest displacement that separates them.
    pub gap_mm: f64,
    /// Unit vector from the shape towards the wall.
    pub outward: Vector2,
}

impl RoundedPolygon {
    /// A slot `length_mm` x `width_mm` with round ends, the length along tool X and greater.
    pub fn stadium(length_mm: f64, width_mm: f64) -> RoundedPolygon {
        let half = (length_mm - width_mm) / 2.0;
        let corners = [Vector2::new(half, 0.0), Vector2::new(-half, 0.0)];
        Self::of_core(
            &corners,
            width_mm / 2.0,
            Kind::Stadium([length_mm, width_mm]),
        )
    }

    /// A rectangle `length_mm` x `width_mm`, the length along tool X, with corners of `radius_mm`
    /// (less than half the width).
    pub fn rectangle(length_mm: f64, width_mm: f64, radius_mm: f64) -> RoundedPolygon {
        let (x, y) = (length_mm / 2.0 - radius_mm, width_mm / 2.0 - radius_mm);
        let corners = [[x, -y], [x, y], [-x, y], [-x, -y]].map(Vector2::from);
        let kind = Kind::Rectangle([length_mm, width_mm, radius_mm]);
        Self::of_core(&corners, radius_mm, kind)
    }

    /// A convex polygon about the tool's axis; corners in either sense, collinear ones are dropped.
    pub fn polygon(corners: &[Vector2]) -> Result<RoundedPolygon, ShapeError> {
        let mut kept: Vec<Vector2> = corners.to_vec();
        let area =
            |c: &[Vector2]| -> f64 { (0..c.len()).map(|i| c[i].perp(&c[(i + 1) % c.len()])).sum() };
        if area(&kept) < 0.0 {
            kept.reverse();
        }
        drop_collinear(&mut kept);
        let count = kept.len();
        if !(3..=CORNERS_MAX).contains(&count) {
            return Err(ShapeError::Corners { count });
        }
        let mut turn_rad = 0.0;
        for i in 0..count {
            let before = kept[i] - kept[(i + count - 1) % count];
            let after = kept[(i + 1) % count] - kept[i];
            let turn = before.perp(&after).atan2(before.dot(&after));
            turn_rad += turn;
            if turn <= 0.0 {
                let (x_mm, y_mm) = (kept[i].x, kept[i].y);
                return Err(ShapeError::NotConvex { x_mm, y_mm });
            }
        }
        if turn_rad > 1.5 * std::f64::consts::TAU {
            let (x_mm, y_mm) = (kept[0].x, kept[0].y);
            return Err(ShapeError::NotConvex { x_mm, y_mm });
        }
        let shape = Self::of_core(&kept, 0.0, Kind::Polygon);
        if shape.axis_inside_mm() < AXIS_INSIDE_MM {
            return Err(ShapeError::AxisOutside);
        }
        Ok(shape)
    }

    /// The same shape, all its lengths times this factor.
    pub fn scaled(&self, factor: f64) -> RoundedPolygon {
        let kind = match self.kind {
            Kind::Stadium(sizes) => Kind::Stadium(sizes.map(|size| factor * size)),
            Kind::Rectangle(sizes) => Kind::Rectangle(sizes.map(|size| factor * size)),
            Kind::Polygon => Kind::Polygon,
        };
        RoundedPolygon {
            corners: self.corners.map(|corner| factor * corner),
            faces: self.faces.map(|face| Face {
                offset_mm: factor * face.offset_mm,
                ..face
            }),
            radius_mm: factor * self.radius_mm,
            widest_mm: factor * self.widest_mm,
            narrowest_mm: factor * self.narrowest_mm,
            kind,
            ..*self
        }
    }

    /// `corners` counter-clockwise, two or more.
    fn of_core(corners: &[Vector2], radius_mm: f64, kind: Kind) -> RoundedPolygon {
        let none = Face {
            normal: Vector2::zeros(),
            offset_mm: 0.0,
        };
        let mut shape = RoundedPolygon {
            corners: [Vector2::zeros(); CORNERS_MAX],
            faces: [none; CORNERS_MAX],
            corner_count: corners.len(),
            face_count: 0,
            radius_mm,
            kind,
            symmetric: false,
            widest_mm: 0.0,
            narrowest_mm: f64::INFINITY,
        };
        shape.corners[..corners.len()].copy_from_slice(corners);
        for i in 0..corners.len() {
            let along = corners[(i + 1) % corners.len()] - corners[i];
            shape.add_face(Vector2::new(along.y, -along.x).normalize());
        }
        if corners.len() == 2 {
            // A line has two sides and, for walls in its own direction, two ends.
            let along = (corners[0] - corners[1]).normalize();
            shape.add_face(along);
            shape.add_face(-along);
        }
        let size = corners.iter().map(|c| c.norm()).fold(0.0, f64::max);
        let opposite = |c: &Vector2| {
            let twin = |d: &Vector2| (c + d).norm() <= SYMMETRY_SHARE * size;
            corners.iter().any(twin)
        };
        shape.symmetric = corners.iter().all(opposite);
        for (i, c) in corners.iter().enumerate() {
            for d in &corners[..i] {
                shape.widest_mm = shape.widest_mm.max((c - d).norm() + 2.0 * radius_mm);
            }
        }
        for i in 0..shape.face_count {
            let normal = shape.faces[i].normal;
            let width = shape.support_mm(normal) + shape.support_mm(-normal);
            shape.narrowest_mm = shape.narrowest_mm.min(width);
        }
        shape
    }

    fn add_face(&mut self, normal: Vector2) {
        self.faces[self.face_count] = Face {
            normal,
            offset_mm: self.core_support_mm(normal),
        };
        self.face_count += 1;
    }

    /// Corners of the core, counter-clockwise; two for a slot.
    pub fn corners(&self) -> &[Vector2] {
        &self.corners[..self.corner_count]
    }

    /// Radius around the core, mm.
    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// What the user called it.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// True if it is symmetric under a half turn.
    pub fn is_symmetric(&self) -> bool {
        self.symmetric
    }

    /// True where mirroring about the x axis brings it onto itself.
    pub fn is_mirror_image(&self) -> bool {
        let corners = self.corners();
        let size = corners.iter().map(|c| c.norm()).fold(0.0, f64::max);
        corners.iter().all(|c| {
            let twin = |d: &Vector2| (Vector2::new(c.x, -c.y) - d).norm() <= SYMMETRY_SHARE * size;
            corners.iter().any(twin)
        })
    }

    /// The greatest width over all directions (its diameter), mm.
    pub fn widest_mm(&self) -> f64 {
        self.widest_mm
    }

    /// The least width over all directions, mm.
    pub fn narrowest_mm(&self) -> f64 {
        self.narrowest_mm
    }

    /// Distance of the tool's axis to the outline, mm.
    pub fn axis_inside_mm(&self) -> f64 {
        let sides = self.faces[..self.face_count].iter();
        sides.map(|f| f.offset_mm).fold(f64::INFINITY, f64::min) + self.radius_mm
    }

    /// Distance of the farthest point from the tool's axis, mm.
    pub fn reach_mm(&self) -> f64 {
        let far = self.corners().iter().map(|c| c.norm());
        far.fold(0.0, f64::max) + self.radius_mm
    }

    /// Unit outward normals of the straight sides, with the corner at each one's start.
    pub fn sides(&self) -> impl Iterator<Item = (Vector2, usize)> + '_ {
        (0..self.corner_count).map(|i| (self.faces[i].normal, i))
    }

    fn core_support_mm(&self, direction: Vector2) -> f64 {
        let dots = self.corners().iter().map(|c| c.dot(&direction));
        dots.fold(f64::NEG_INFINITY, f64::max)
    }

    /// Support function: extent from the axis in the unit direction, mm.
    pub fn support_mm(&self, direction: Vector2) -> f64 {
        self.core_support_mm(direction) + self.radius_mm
    }

    /// Number of the corner farthest in a direction; the first of two equally far.
    pub fn support_corner(&self, direction: Vector2) -> usize {
        let far = |i: usize| self.corners[i].dot(&direction);
        (1..self.corner_count).fold(0, |best, i| if far(i) > far(best) { i } else { best })
    }

    /// The point farthest in the unit direction.
    pub fn support_point(&self, direction: Vector2) -> Vector2 {
        self.corners[self.support_corner(direction)] + direction * self.radius_mm
    }

    /// Area, mm².
    pub fn area_mm2(&self) -> f64 {
        let corners = self.corners();
        let (mut area, mut around) = (0.0, 0.0);
        for (i, c) in corners.iter().enumerate() {
            let next = corners[(i + 1) % corners.len()];
            area += c.perp(&next) / 2.0;
            around += (next - c).norm();
        }
        area + around * self.radius_mm + std::f64::consts::PI * self.radius_mm.powi(2)
    }

    /// Distance to the outline of the shape: negative inside.
    pub fn signed_distance_mm(&self, p: Vector2) -> f64 {
        self.gap_to(p, p, f64::INFINITY)
            .map_or(f64::INFINITY, |g| g.gap_mm)
    }

    /// True if [`Self::gap_to`] returns `None` for every wall in a box, because all of the box is
    /// beyond one side of the shape: tested with the nearest corner of the box, rounded like the
    /// walls.
    pub fn is_beyond(&self, low: Vector2, high: Vector2, limit_mm: f64) -> bool {
        let limit = limit_mm + self.radius_mm;
        self.faces[..self.face_count].iter().any(|face| {
            let nearest = Vector2::new(
                if face.normal.x > 0.0 { low.x } else { high.x },
                if face.normal.y > 0.0 { low.y } else { high.y },
            );
            face.normal.dot(&nearest) - face.offset_mm > limit
        })
    }

    /// The position of the wall a-b (tool frame) relative to the shape; `None` if it is certainly
    /// farther than `limit_mm`.
    ///
    /// Separating axes: if core and wall meet, the shortest displacement that separates them is
    /// along a side's normal or the wall's. If not, the distance is that of a corner and the wall
    /// or of an end of the wall and a side.
    pub fn gap_to(&self, a: Vector2, b: Vector2, limit_mm: f64) -> Option<Gap> {
        let mut best = (f64::NEG_INFINITY, Vector2::x());
        let limit = limit_mm + self.radius_mm;
        for face in &self.faces[..self.face_count] {
            let apart = face.normal.dot(&a).min(face.normal.dot(&b)) - face.offset_mm;
            if apart > best.0 {
                best = (apart, face.normal);
            }
        }
        if best.0 > limit {
            return None;
        }
        let along = b - a;
        let length = along.norm();
        if length > 0.0 {
            let across = Vector2::new(-along.y, along.x) / length;
            for normal in [across, -across] {
                let apart = normal.dot(&a) - self.core_support_mm(normal);
                if apart > best.0 {
                    best = (apart, normal);
                }
            }
        }
        if best.0 > limit {
            return None;
        }
        let (apart, outward) = if best.0 > 0.0 {
            self.nearest(a, b)
        } else {
            best
        };
        Some(Gap {
            gap_mm: apart - self.radius_mm,
            outward,
        })
    }

    /// Distance and direction from the core to a wall apart from it.
    fn nearest(&self, a: Vector2, b: Vector2) -> (f64, Vector2) {
        let mut best = (f64::INFINITY, Vector2::x());
        let mut take = |from: Vector2, to: Vector2| {
            let distance2 = (to - from).norm_squared();
            if distance2 < best.0 {
                best = (distance2, to - from);
            }
        };
        let corners = self.corners();
        for (i, &corner) in corners.iter().enumerate() {
            take(corner, foot(a, b, corner));
            let next = corners[(i + 1) % corners.len()];
            take(foot(corner, next, a), a);
            take(foot(corner, next, b), b);
        }
        let distance = best.0.sqrt();
        let outward = best.1.try_normalize(1e-300).unwrap_or(Vector2::x());
        (distance, outward)
    }

    /// The nearest point of the shape.
    pub fn nearest_point(&self, p: Vector2) -> Vector2 {
        match self.gap_to(p, p, f64::INFINITY) {
            Some(gap) if gap.gap_mm > 0.0 => p - gap.outward * gap.gap_mm,
            _ => p,
        }
    }

    /// The outline at `share` of its length, from the first side on, counter-clockwise.
    pub fn outline_at(&self, share: f64) -> Vector2 {
        let corners = self.corners();
        let turn = |i: usize| {
            let (n, m) = (
                self.faces[i].normal,
                self.faces[(i + 1) % corners.len()].normal,
            );
            // The ends of a line turn by 180°, whose sign is lost to rounding.
            n.perp(&m).atan2(n.dot(&m)).abs()
        };
        let mut left = share.rem_euclid(1.0) * self.perimeter_mm();
        for (i, corner) in corners.iter().enumerate() {
            let next = corners[(i + 1) % corners.len()];
            let (side, normal) = (next - corner, self.faces[i].normal);
            let length = side.norm();
            if left <= length {
                return corner + side * (left / length) + normal * self.radius_mm;
            }
            left -= length;
            let arc = turn(i) * self.radius_mm;
            if left <= arc {
                let (sin, cos) = (left / self.radius_mm).sin_cos();
                let turned = Vector2::new(
                    normal.x * cos - normal.y * sin,
                    normal.x * sin + normal.y * cos,
                );
                return next + turned * self.radius_mm;
            }
            left -= arc;
        }
        corners[0] + self.faces[0].normal * self.radius_mm
    }

    /// Length of the outline, mm.
    pub fn perimeter_mm(&self) -> f64 {
        let corners = self.corners();
        let sides: f64 = (0..corners.len())
            .map(|i| (corners[(i + 1) % corners.len()] - corners[i]).norm())
            .sum();
        sides + std::f64::consts::TAU * self.radius_mm
    }
}

/// Drops corners on the line between their neighbours, or on a neighbour.
fn drop_collinear(corners: &mut Vec<Vector2>) {
    let mut i = 0;
    let mut since_drop = 0;
    while corners.len() > 2 && since_drop < corners.len() {
        let count = corners.len();
        i %= count;
        let (before, after) = (corners[(i + count - 1) % count], corners[(i + 1) % count]);
        let near = (corners[i] - foot(before, after, corners[i])).norm() < COLLINEAR_MM;
        if near {
            corners.remove(i);
            since_drop = 0;
        } else {
            i += 1;
            since_drop += 1;
        }
    }
}

/// The point of a-b nearest to `p`.
fn foot(a: Vector2, b: Vector2, p: Vector2) -> Vector2 {
    let d = b - a;
    let length2 = d.norm_squared();
    if length2 <= 0.0 {
        return a;
    }
    a + d * ((p - a).dot(&d) / length2).clamp(0.0, 1.0)
}

/// Intersection of the row at height `y` with the shape of `corners` (any frame, in order) grown by
/// `radius`: least and greatest x; `None` if it misses.
pub fn row_range(corners: &[Vector2], radius: f64, y: f64) -> Option<[f64; 2]> {
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    let mut take = |x: f64| range = [range[0].min(x), range[1].max(x)];
    for (i, &corner) in corners.iter().enumerate() {
        let rise = y - corner.y;
        let under_root = radius * radius - rise * rise;
        if under_root >= 0.0 {
            let half = under_root.sqrt();
            take(corner.x - half);
            take(corner.x + half);
        }
        // The outside of a counter-clockwise side is to its right; both shifts of a line are sides.
        let next = corners[(i + 1) % corners.len()];
        let side = next - corner;
        let length = side.norm();
        if length <= 0.0 {
            continue;
        }
        let out = Vector2::new(side.y, -side.x) * (radius / length);
        let (from, to) = (corner + out, next + out);
        if (from.y <= y) != (to.y <= y) {
            take(from.x + (to.x - from.x) * (y - from.y) / (to.y - from.y));
        }
    }
    (range[0] <= range[1]).then_some(range)
}

#[cfg(test)]
#[path = "rounded_polygon_tests.rs"]
mod tests;

//! The head as a solid of revolution: its radius at a height above the tip.

/// Radius by height, piecewise linear, with steps. A narrower section above a wider one counts as
/// wide as that one: no print can be there.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadProfile {
    /// Height and radius, mm; both never fall. Two of one height are a step.
    knots: Vec<[f64; 2]>,
    /// Radius at the upper end of each of [`BOUNDS`] equal heights, and how many there are a mm.
    bounds_mm: Vec<f64>,
    bounds_per_mm: f64,
}

/// Heights of the quick bound.
const BOUNDS: u32 = 512;

/// Why knots are no profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileError {
    /// Fewer than two.
    TooFew,
    /// The first is not at height 0.
    NotAtTip,
    /// One is not a number, negative, or lower than the previous one; its index.
    Knot(usize),
}

impl HeadProfile {
    /// Of heights and radii, mm, from the tip upwards.
    ///
    /// # Errors
    /// [`ProfileError`].
    pub fn new(knots: &[[f64; 2]]) -> Result<HeadProfile, ProfileError> {
        let Some(first) = knots.first().filter(|_| knots.len() > 1) else {
            return Err(ProfileError::TooFew);
        };
        if first[0] != 0.0 {
            return Err(ProfileError::NotAtTip);
        }
        let mut risen: Vec<[f64; 2]> = Vec::with_capacity(knots.len());
        for (index, &[height_mm, radius_mm]) in knots.iter().enumerate() {
            let [before_mm, widest_mm] = risen.last().copied().unwrap_or([0.0; 2]);
            let is_sound = height_mm.is_finite() && radius_mm.is_finite() && radius_mm >= 0.0;
            if !is_sound || height_mm < before_mm {
                return Err(ProfileError::Knot(index));
            }
            risen.push([height_mm, radius_mm.max(widest_mm)]);
        }
        Ok(HeadProfile::of_sound(risen))
    }

    fn of_sound(knots: Vec<[f64; 2]>) -> HeadProfile {
        let mut profile = HeadProfile {
            knots,
            bounds_mm: Vec::new(),
            bounds_per_mm: 0.0,
        };
        let top_mm = profile.top_mm().max(f64::MIN_POSITIVE);
        // A little more than the upper end: rounding may take a height for the lower neighbour's.
        let upper_mm = |index: u32| top_mm * (f64::from(index) + 1.001) / f64::from(BOUNDS);
        profile.bounds_mm = (0..=BOUNDS)
            .map(|index| profile.radius_mm(upper_mm(index)))
            .collect();
        profile.bounds_per_mm = f64::from(BOUNDS) / top_mm;
        profile
    }

    /// A head of radius 0, which contains nothing.
    pub fn line() -> HeadProfile {
        HeadProfile::of_sound(vec![[0.0; 2], [1.0, 0.0]])
    }

    /// Only the flat end, up to its radius: its dip at 45°.
    pub fn flat_end(&self) -> HeadProfile {
        let radius_mm = self.tip_radius_mm();
        HeadProfile::of_sound(vec![[0.0, radius_mm], [radius_mm.max(1e-9), radius_mm]])
    }

    /// Height and radius of its edges, mm, from the tip upwards.
    pub fn knots(&self) -> &[[f64; 2]] {
        &self.knots
    }

    /// Its sections, from the tip upwards: lower and upper height and radius, mm.
    pub(crate) fn sections(&self) -> impl Iterator<Item = [[f64; 2]; 2]> + '_ {
        self.knots.windows(2).map(|pair| [pair[0], pair[1]])
    }

    /// Where it ends, mm above the tip.
    pub fn top_mm(&self) -> f64 {
        self.knots[self.knots.len() - 1][0]
    }

    /// Radius of the flat end, mm.
    pub fn tip_radius_mm(&self) -> f64 {
        self.knots[0][1]
    }

    /// The largest distance of any part from the tip, mm.
    pub fn reach_mm(&self) -> f64 {
        let [height_mm, radius_mm] = self.knots[self.knots.len() - 1];
        height_mm.hypot(radius_mm)
    }

    /// Radius at a height, mm, the larger one at a step; below the tip that of the flat end, above the top the
    /// largest.
    #[inline]
    pub fn radius_mm(&self, height_mm: f64) -> f64 {
        let mut below = self.knots[0];
        for &knot in &self.knots[1..] {
            if knot[0] > height_mm {
                let share = (height_mm - below[0]).max(0.0) / (knot[0] - below[0]);
                return below[1] + share * (knot[1] - below[1]);
            }
            below = knot;
        }
        below[1]
    }

    /// No less than the radius at a height, mm, and not much more: found without a search.
    #[inline]
    pub(crate) fn radius_bound_mm(&self, height_mm: f64) -> f64 {
        // What is negative becomes 0.
        let index = (height_mm * self.bounds_per_mm) as usize;
        self.bounds_mm[index.min(BOUNDS as usize)]
    }

    /// Depth of a point inside, mm: no less than its distance from the lines of all faces except the top;
    /// negative outside, and then by no more than the distance.
    pub fn depth_mm(&self, [height_mm, from_axis_mm]: [f64; 2]) -> f64 {
        let mut deepest_mm = f64::NEG_INFINITY;
        for pair in self.knots.windows(2) {
            let [[low_mm, from_mm], [high_mm, to_mm]] = [pair[0], pair[1]];
            if high_mm <= low_mm {
                continue;
            }
            let slope = (to_mm - from_mm) / (high_mm - low_mm);
            let side_mm = from_mm + slope * (height_mm - low_mm) - from_axis_mm;
            let side_mm = side_mm / slope.hypot(1.0);
            let inside_mm = side_mm.min(height_mm - low_mm).min(high_mm - height_mm);
            // A section on top of a wider or an equal one is continued below: only its own step is a face.
            let open_mm = side_mm.min(height_mm - low_mm);
            deepest_mm = deepest_mm.max(if height_mm <= high_mm {
                open_mm
            } else {
                inside_mm
            });
        }
        deepest_mm
    }

    /// How far the lowest edge is below the tip, mm, of a tool along `axis` (unit, z up).
    pub fn below_tip_mm(&self, axis: &crate::Vector3) -> f64 {
        let leaning = axis.xy().norm();
        self.knots
            .iter()
            .map(|[height_mm, radius_mm]| radius_mm * leaning - height_mm * axis.z)
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// Half the angle of the head, seen from its tip, at a distance: it contains a point there whose direction
    /// is closer to the axis than that and that is higher than `slack_mm`. Above its top the head continues
    /// with the same width, since something carries it.
    ///
    /// At a distance rho the sine of the angle g increases and the radius at the height rho cos g decreases, so
    /// one g separates inside and outside: on a cone of slope k from a radius r0 it is atan k + asin(r0 cos(atan
    /// k) / rho).
    pub fn half_angle_rad(&self, distance_mm: f64, slack_mm: f64) -> f64 {
        if distance_mm <= slack_mm {
            return 0.0;
        }
        let lowest_rad = (slack_mm / distance_mm).clamp(-1.0, 1.0).acos();
        self.crossing_rad(distance_mm).min(lowest_rad)
    }

    fn crossing_rad(&self, distance_mm: f64) -> f64 {
        let square = distance_mm * distance_mm;
        // How far the sphere of that radius is from the axis at a height.
        let out_mm = |height_mm: f64| (square - height_mm * height_mm).max(0.0).sqrt();
        if distance_mm <= self.knots[0][1] {
            return std::f64::consts::FRAC_PI_2;
        }
        for pair in self.knots.windows(2) {
            let [[low_mm, from_mm], [high_mm, to_mm]] = [pair[0], pair[1]];
            if high_mm > low_mm {
                if high_mm < distance_mm && out_mm(high_mm) > to_mm {
                    continue;
                }
                let slope = (to_mm - from_mm) / (high_mm - low_mm);
                return cone_rad(slope, from_mm - slope * low_mm, distance_mm);
            }
            if out_mm(high_mm) <= to_mm {
                return (high_mm / distance_mm).clamp(-1.0, 1.0).acos();
            }
        }
        cone_rad(0.0, self.knots[self.knots.len() - 1][1], distance_mm)
    }

    /// The free tilt: up to that tilt, the head never touches print made in the order of height. The least angle
    /// between the tip's plane and an edge of the head, except for the flat end itself.
    pub fn free_tilt_rad(&self) -> f64 {
        let edges = self.knots.iter().filter(|knot| knot[0] > 0.0);
        edges
            .map(|[height_mm, radius_mm]| height_mm.atan2(*radius_mm))
            .fold(std::f64::consts::FRAC_PI_2, f64::min)
    }

    /// Largest tilt at which no edge is below the table, `above_mm` below the tip; the flat end may dip by
    /// `slack_mm`. Zero if even an upright head is below it.
    pub fn tilt_over_table_rad(&self, above_mm: f64, slack_mm: f64) -> f64 {
        let room_mm = above_mm + slack_mm;
        let limit = |&[height_mm, radius_mm]: &[f64; 2]| {
            let far_mm = height_mm.hypot(radius_mm);
            if room_mm >= far_mm {
                return std::f64::consts::PI;
            }
            // radius sin t - height cos t = far sin(t - atan2(height, radius)) reaches the room.
            (height_mm.atan2(radius_mm) + (room_mm / far_mm).max(-1.0).asin()).max(0.0)
        };
        self.knots
            .iter()
            .map(limit)
            .fold(std::f64::consts::PI, f64::min)
    }
}

/// Where a sphere about the tip meets a cone or a cylinder of this radius at the tip's height.
fn cone_rad(slope: f64, radius_mm: f64, distance_mm: f64) -> f64 {
    let half_rad = slope.atan();
    half_rad
        + (radius_mm * half_rad.cos() / distance_mm)
            .clamp(-1.0, 1.0)
            .asin()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stepped() -> HeadProfile {
        // A cone of 30° to each side, a step, a cylinder.
        HeadProfile::new(&[[0.0, 0.8], [20.0, 12.347], [20.0, 22.0], [60.0, 22.0]]).unwrap()
    }

    /// Goal: the closed form is where the head begins. Method: along the sphere from the axis outwards, in steps.
    #[test]
    fn half_angles_part_inside_and_outside() {
        for profile in [
            stepped(),
            HeadProfile::new(&[[0.0, 0.0], [5.0, 1.0], [5.0, 3.0], [9.0, 3.0], [12.0, 10.0]])
                .unwrap(),
        ] {
            for step in 1..400 {
                let distance_mm = 0.15 * f64::from(step);
                for slack_mm in [0.1, 0.4] {
                    let found = profile.half_angle_rad(distance_mm, slack_mm);
                    let holds = |angle: f64| {
                        let (sin, cos) = angle.sin_cos();
                        let height_mm = distance_mm * cos;
                        height_mm > slack_mm && distance_mm * sin < profile.radius_mm(height_mm)
                    };
                    if found > 1e-6 {
                        assert!(holds(found - 1e-9 * 57.0), "{distance_mm}: {found}");
                        assert!(holds(0.5 * found), "{distance_mm}");
                    }
                    assert!(!holds(found + 1e-9 * 57.0), "{distance_mm}: {found}");
                }
            }
        }
    }

    /// Goal: the quick bound is no less than the radius and at most 1/256 of the height off. Method: at edges, between, beside.
    #[test]
    fn quick_bounds_are_no_less_than_the_radius() {
        for profile in [stepped(), HeadProfile::line()] {
            let top_mm = profile.top_mm();
            for knot in profile.knots() {
                for off_mm in [-1.0, -1e-9, -1e-15, 0.0, 1e-15, 1e-9, 0.3] {
                    let height_mm = knot[0] + off_mm;
                    let bound_mm = profile.radius_bound_mm(height_mm);
                    assert!(bound_mm >= profile.radius_mm(height_mm), "{height_mm}");
                    let above_mm = height_mm.max(0.0) + top_mm / 256.0;
                    assert!(bound_mm <= profile.radius_mm(above_mm), "{height_mm}");
                }
            }
            for step in 0..5000 {
                let height_mm = top_mm * (f64::from(step) / 4000.0 - 0.1);
                assert!(profile.radius_bound_mm(height_mm) >= profile.radius_mm(height_mm));
            }
        }
    }

    /// Goal: the head stays over the table up to that tilt and no further. Method: the lowest of all its edges.
    #[test]
    fn tilts_over_the_table() {
        let head = stepped();
        for above_mm in [0.2, 5.0, 15.0, 40.0, 100.0] {
            let tilt_rad = head.tilt_over_table_rad(above_mm, 0.1);
            let lowest_mm = |tilt_rad: f64| {
                let below = head
                    .knots()
                    .iter()
                    .map(|[h, r]| r * tilt_rad.sin() - h * tilt_rad.cos());
                above_mm - below.fold(f64::NEG_INFINITY, f64::max)
            };
            if tilt_rad < 1.5 {
                assert!(
                    (lowest_mm(tilt_rad) + 0.1).abs() < 1e-9,
                    "{above_mm}: {tilt_rad}"
                );
            }
        }
        // The corner of the head: atan(20 / 22).
        assert!((head.free_tilt_rad().to_degrees() - 42.274).abs() < 1e-3);
    }

    /// Goal: what is no profile is refused, a waist counts as wide. Method: one of each.
    #[test]
    fn knots_are_checked() {
        assert_eq!(HeadProfile::new(&[[0.0, 1.0]]), Err(ProfileError::TooFew));
        assert_eq!(
            HeadProfile::new(&[[1.0, 1.0], [2.0, 1.0]]),
            Err(ProfileError::NotAtTip)
        );
        for bad in [
            [-1.0, 1.0],
            [1.0, -1.0],
            [f64::NAN, 1.0],
            [1.0, f64::INFINITY],
        ] {
            assert_eq!(
                HeadProfile::new(&[[0.0, 1.0], bad]),
                Err(ProfileError::Knot(1))
            );
        }
        let waist = HeadProfile::new(&[[0.0, 1.0], [5.0, 8.0], [5.0, 3.0], [9.0, 3.0]]).unwrap();
        assert_eq!(waist.radius_mm(7.0), 8.0);
    }

    /// Goal: depths are distances to the nearest face. Method: places worked out by hand.
    #[test]
    fn depths_by_hand() {
        let head = stepped();
        // 2 mm inside the cylinder, far from its lower face; 1 mm above the step; outside.
        assert!((head.depth_mm([40.0, 20.0]) - 2.0).abs() < 1e-12);
        assert!((head.depth_mm([21.0, 18.0]) - 1.0).abs() < 1e-12);
        assert!((head.depth_mm([40.0, 25.0]) + 3.0).abs() < 1e-12);
        assert!((head.depth_mm([0.05, 0.0]) - 0.05).abs() < 1e-12);
        assert!(head.depth_mm([-1.0, 0.0]) < 0.0 && head.depth_mm([61.0, 0.0]) < 0.0);
    }
}

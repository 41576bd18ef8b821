//! Goal: the tables are the rules of the heads of the files, a part known by hand has its share, and orders hold up. Method: plain
//! loops over cells; a T whose share follows from four slopes.

use super::*;
use crate::space::head_rows::meets;

fn gantry() -> HeadProfile {
    HeadProfile::new(&[[0.0, 0.8], [20.0, 12.35], [20.0, 22.0], [70.0, 22.0]]).unwrap()
}

fn tee(cells_mm: usize) -> Part {
    let size = [60, 12, 52].map(|n| n * cells_mm);
    Part::new(size, 1.0 / cells_mm as f64, |[x, _, z]| {
        z >= 40 * cells_mm || (24 * cells_mm..36 * cells_mm).contains(&x)
    })
    .unwrap()
}

fn space(part: &Part, directions: &[Vector3], head: &HeadProfile, half_mm: [f64; 2]) -> Space {
    let contains =
        |[x, y]: [f64; 2]| (x / half_mm[0]).powi(2) + (y / half_mm[1]).powi(2) <= 1.0 + 1e-9;
    let headings_rad = (0..8)
        .map(|n| f64::from(n) * std::f64::consts::PI / 8.0)
        .collect();
    let aperture = Aperture {
        headings_rad,
        reach_mm: half_mm[0].max(half_mm[1]),
        contains: &contains,
    };
    let allowed = |_: [u16; 3], _: usize| true;
    let rules = Rules {
        head,
        slack_mm: 0.3 * part.voxel_mm(),
        self_support_rad: 45f64.to_radians(),
        aperture,
        allowed: &allowed,
    };
    Space::new(part, directions, &rules).unwrap()
}

#[test]
fn rows_of_the_head_are_the_cells_that_meet_it() {
    let part = Part::new([23, 19, 21], 1.7, |_| true).unwrap();
    let head = gantry();
    for (number, axis) in directions(1.5, 0.7).iter().enumerate().step_by(5) {
        let rows = HeadRows::new(&part, axis, &head, 0.5);
        for z in -20..=20i32 {
            for y in -18..=18i32 {
                let plane = rows.planes.iter().find(|plane| i32::from(plane.dz) == z);
                let plane = plane.filter(|plane| (plane.dy_first..plane.dy_end).contains(&y));
                for x in -22..=22i32 {
                    let away = Vector3::new(x.into(), y.into(), z.into()) * 1.7;
                    let is_in = plane.is_some_and(|plane| {
                        rows.spans(plane, y)
                            .iter()
                            .any(|[lo, hi]| (i32::from(*lo)..=(*hi).into()).contains(&x))
                    });
                    assert_eq!(
                        is_in,
                        meets(&head, axis, 1.7, 0.5, &away),
                        "direction {number}: {x} {y} {z}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_t_has_the_share_that_four_slopes_give_by_hand() {
    // The arm's lower side grows by 12 mm / tan of the slope on either side: 3456, 4721 and 6783 of 8640 mm³ of the arm.
    let part = tee(1);
    let head = gantry();
    for (tilt, by_hand) in [(0f64, 64.0), (15.0, 72.8), (30.0, 87.1), (45.0, 100.0)] {
        let space = space(
            &part,
            &directions(tilt.to_radians(), head.free_tilt_rad()),
            &head,
            [0.6, 0.2],
        );
        let reach = space.reach(!0);
        let share = |count: usize| 100.0 * count as f64 / part.cells().len() as f64;
        let most = share(reach.at_most.iter().filter(|laid| **laid).count());
        println!("{tilt} {by_hand} {} {most}", share(reach.steps.len()));
        assert!(
            (most - by_hand).abs() <= 2.0,
            "{tilt}: {most} for {by_hand}"
        );
        assert!(most - share(reach.steps.len()) < 0.5);
    }
}

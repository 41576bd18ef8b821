//! Goal: rows of the head are its cells, a part known by hand has its share, directions fit into a mask. Method: plain loops
//! over cells; a T whose share follows from four slopes.

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

/// Calls with rules for an ellipse.
fn with_rules<T>(head: &HeadProfile, voxel_mm: f64, call: impl FnOnce(&Rules) -> T) -> T {
    let contains = |[x, y]: [f64; 2]| (x / 0.6).powi(2) + (y / 0.2).powi(2) <= 1.0 + 1e-9;
    let headings = 0..8;
    let headings = headings.map(|n| f64::from(n) * std::f64::consts::PI / 8.0);
    let rules = Rules {
        head,
        slack_mm: 0.3 * voxel_mm,
        self_support_rad: 45f64.to_radians(),
        aperture: Aperture {
            headings_rad: headings.collect(),
            reach_mm: 0.6,
            contains: &contains,
        },
        allowed: &|_, _| true,
    };
    call(&rules)
}

#[test]
fn rows_of_the_head_are_the_cells_that_meet_it() {
    let part = Part::new([23, 19, 21], 1.7, |_| true).unwrap();
    let axes = directions(1.5, 0.7);
    with_rules(&gantry(), 1.7, |rules| {
        for (number, axis) in axes.iter().enumerate().step_by(5) {
            let rows = HeadRows::new(&part, axis, rules);
            let is_in = |[x, y, z]: [i32; 3]| {
                let plane = rows.planes.iter().find(|plane| plane.dz == z);
                let plane = plane.filter(|plane| (plane.dy_first..plane.dy_end).contains(&y));
                let spans = plane.map_or(&[][..], |plane| rows.spans(plane, y));
                let holds =
                    |[low, high]: &[i16; 2]| (i32::from(*low)..=(*high).into()).contains(&x);
                spans.iter().any(holds)
            };
            for cell in super::cube(18) {
                let cell = cell.map(i32::from);
                let away = Vector3::from(cell.map(f64::from)) * 1.7;
                let meets = meets(rules, axis, 1.7, &away);
                assert_eq!(is_in(cell), meets, "direction {number}: {cell:?}");
            }
        }
    });
}

#[test]
fn a_t_has_the_share_that_four_slopes_give_by_hand() {
    // The arm's lower side grows by 12 mm / tan of the slope on either side: 3456, 4721 and 6783 of 8640 mm³ of the arm.
    let part = tee(1);
    let head = gantry();
    for (tilt, by_hand) in [(0f64, 64.0), (15.0, 72.8), (30.0, 87.1), (45.0, 100.0)] {
        let axes = directions(tilt.to_radians(), head.free_tilt_rad());
        let space = with_rules(&head, part.voxel_mm(), |rules| {
            Space::new(&part, &axes, rules)
        });
        let space = space.unwrap();
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

#[test]
fn rings_fit_into_a_mask() {
    for tilt in 0..=95 {
        for free in 0..=90 {
            let [tilt_rad, free_rad] = [tilt, free].map(|deg| f64::from(deg).to_radians());
            let count = directions(tilt_rad, free_rad).len();
            assert!(
                (1..=DIRECTIONS_MAX).contains(&count),
                "{tilt} {free}: {count}"
            );
        }
    }
}

#[test]
fn every_step_of_an_order_keeps_the_head_off_what_stands() {
    // A roof on two posts with a tongue below it: the head is in the way inside.
    let size = [20, 8, 16];
    let part = Part::new(size, 2.0, |[x, _, z]| {
        z >= 13 || !(4..16).contains(&x) || (8..11).contains(&x) && z >= 9
    });
    let part = part.unwrap();
    let axes = directions(1.5, 0.7);
    let head = gantry();
    with_rules(&head, 2.0, |rules| {
        let reach = Space::new(&part, &axes, rules).unwrap().reach(!0);
        let middle = |cell: u32| Vector3::from(part.cells()[cell as usize].map(f64::from)) * 2.0;
        for (count, step) in reach.steps.iter().enumerate() {
            let axis = &axes[usize::from(step.direction)];
            for before in &reach.steps[..count] {
                let away = middle(before.cell) - middle(step.pose);
                assert!(
                    before.cell != step.cell && !meets(rules, axis, 2.0, &away),
                    "{count}"
                );
            }
            assert!(reach.at_most[step.cell as usize]);
        }
        let tilted = |step: &&Step| axes[usize::from(step.direction)].z < 0.9;
        assert!(reach.steps.iter().filter(tilted).count() > 10);
    });
}

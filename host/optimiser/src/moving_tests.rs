//! Tests of the smaller problem: what it contains by brute force, and its result against that of the whole.

use super::curve::Knot;
use super::moving::moving;
use super::terms::Terms;
use super::test_passes::{limits, objective, pass_of, rectangle, site};
use super::*;
use headway_geometry::test_shapes::ELLIPSE;
use std::f64::consts::FRAC_PI_2;

/// Two straight beads in a bar of 100 x 2.4 mm, the lower one bent by 0.1 mm at 30 mm.
fn bent_beads() -> [OptimisedPass; 2] {
    let bead = |y_mm: f64, bump_mm: f64| {
        pass_of(400, 0.25 / 57.0, move |t| {
            let x_mm = 0.4 + 99.2 * t;
            let bump = (-((x_mm - 30.0) / 0.8).powi(2)).exp();
            [x_mm, y_mm + bump_mm * bump, FRAC_PI_2]
        })
    };
    [bead(0.6, 0.1), bead(1.8, 0.0)]
}

fn begun<'a>(passes: &[OptimisedPass], site: &Site<'a>) -> Search<'a> {
    Search::of(passes, site, &objective(0.6), |_, _, _| None)
        .unwrap_or_else(|outcome| panic!("{outcome:?}"))
}

/// Goal: the smaller problem has each knot that moves, and each pose that reaches a cell that one of them can reach.
/// Method: knots of two beads, some displaced; distances between all pairs.
#[test]
fn the_smaller_problem_has_all_that_matters() {
    let bar = rectangle(100.0, 2.4);
    let limits = limits();
    let site = site(&bar, &ELLIPSE, &limits);
    let newton = begun(&bent_beads(), &site).newton;
    let mut now = newton.knots.clone();
    for (knot, across, turn) in [(100, 0.01, 0.0), (290, 0.0, 0.05), (600, 0.003, 0.007)] {
        now[knot][1] += across;
        now[knot][2] += turn;
    }
    let radius = newton.objectives.ground.radius();
    assert!((radius - 1.0).abs() < 1e-6, "{radius}");
    let part = moving(
        [&newton.knots, &now],
        newton.stays(),
        &newton.passes,
        radius,
    )
    .expect("most stays");
    let place = |knot: usize| part.knots.iter().position(|&own| own == knot);
    let moves: Vec<usize> = (0..now.len())
        .filter(|&knot| place(knot).is_some_and(|at| !part.stays[at]))
        .collect();
    for knot in [100, 290, newton.passes[1].first, newton.passes[1].end() - 1] {
        assert!(moves.contains(&knot), "{knot} stays");
    }
    assert!(!moves.contains(&600), "600 moves");
    let reach2 = (part.reach + radius).powi(2);
    for (number, own) in now.iter().enumerate() {
        let meets = |&other: &usize| {
            let other = &now[other];
            (own[0] - other[0]).powi(2) + (own[1] - other[1]).powi(2) < reach2
        };
        let is_left_out = place(number).is_none();
        assert!(!(is_left_out && moves.iter().any(meets)), "{number}");
    }
    assert!(part.knots.len() < now.len() / 2, "{}", part.knots.len());
    let mut sorted = part.knots.clone();
    sorted.dedup();
    assert_eq!(sorted.len(), part.knots.len(), "a knot in two windows");
}

/// Goal: the smaller problem is as good as the whole, and what stays is as it was. Method: the bent beads, with all knots in
/// all iterations and as it is done.
#[test]
fn what_stays_does_not_change_the_result() {
    let bar = rectangle(100.0, 2.4);
    let limits = limits();
    let site = site(&bar, &ELLIPSE, &limits);
    let passes = bent_beads();
    let mut whole = begun(&passes, &site).newton;
    whole.run(1..=20, &Effort::cold(20), |_, _| {});
    let searched = begun(&passes, &site).run(&Effort::cold(20));
    let bend_mm = |knots: &[Knot]| {
        // The lower bead's knots, in mm from the bar's middle of 50 x 1.2.
        let bent = knots[..403]
            .iter()
            .filter(|knot| (0.6 * knot[0] + 20.0).abs() < 4.0);
        bent.map(|knot| (0.6 * knot[1] + 0.6).abs())
            .fold(0.0, f64::max)
    };
    let before = begun(&passes, &site).newton;
    assert!(bend_mm(&before.knots) > 0.095);
    assert!(
        bend_mm(&searched.knots) < 0.01,
        "{}",
        bend_mm(&searched.knots)
    );
    let straight = searched.knots[..403]
        .iter()
        .filter(|knot| knot[0].abs() < 60.0);
    let far = straight.filter(|knot| (0.6 * knot[0] + 20.0).abs() > 6.0);
    let turn_rad = far
        .map(|knot| (knot[2] - FRAC_PI_2).abs())
        .fold(0.0, f64::max);
    assert!(turn_rad < 0.01, "{turn_rad}");
    let areas = |terms: &Terms| terms.open + 0.5 * terms.twice;
    let (own, all) = (areas(&searched.terms), areas(&whole.terms));
    assert!(
        own < all + 0.1 * (areas(&before.terms) - all),
        "{all} {own}"
    );
    // Sums that are kept up are those of a new count.
    let mut written = passes.to_vec();
    searched.finish(&mut written, &site);
    let counted = areas(&begun(&written, &site).newton.terms);
    assert!((own - counted).abs() < 0.02, "{own} {counted}");
}

//! Tests of beads that fit: which they are, by beads whose gaps are known, and what becomes of the others.

use super::curve::PassKnots;
use super::test_passes::{limits, objective, pass_of, rectangle, site};
use super::*;
use headway_geometry::test_shapes::ELLIPSE;
use std::f64::consts::FRAC_PI_2;

const LENGTH_MM: f64 = 100.0;

/// A bead along a bar at `y_mm`, moved aside and turned by `bump` at 30 mm, on 1.5 mm.
fn bead(y_mm: f64, bump: [f64; 2]) -> OptimisedPass {
    pass_of(400, 0.25 / 30.0, move |t| {
        let x_mm = 0.4 + 99.2 * t;
        let bell = (-((x_mm - 30.0) / 0.8).powi(2)).exp();
        [x_mm, y_mm + bump[0] * bell, FRAC_PI_2 + bump[1] * bell]
    })
}

/// Where the control points of each pass are that fit in a bar of this width, x in mm.
fn fitting_mm(passes: &[OptimisedPass], width_mm: f64, limits: &PoseLimits) -> Vec<Vec<f64>> {
    let bar = rectangle(LENGTH_MM, width_mm);
    let site = site(&bar, &ELLIPSE, limits);
    let mut found = Vec::new();
    let search = Search::of(passes, &site, &objective(0.6), |knots, ranges, tools| {
        let paces = fitting::paces(knots, ranges, tools);
        let own = |range: &PassKnots| {
            let fitting = (range.first..range.end()).filter(|&knot| paces[knot].is_some());
            fitting.map(|knot| 50.0 + 0.6 * knots[knot][0]).collect()
        };
        found = ranges.iter().map(own).collect();
        None
    });
    assert!(search.is_ok());
    found
}

/// Goal: a bead fits where it is at full speed between its neighbours and walls, and nowhere else. Method: two beads that fill a
/// bar of 2.4 mm, and each departure from that by itself.
#[test]
fn beads_fit_where_nothing_can_be_gained() {
    let straight = |y_mm| bead(y_mm, [0.0; 2]);
    let both = [straight(0.6), straight(1.8)];
    let counts = |passes: &[OptimisedPass], width_mm: f64, limits: &PoseLimits| -> Vec<usize> {
        let found = fitting_mm(passes, width_mm, limits);
        found.iter().map(Vec::len).collect()
    };
    // All but the ends, which always move: phantoms and 7 more on each side.
    assert_eq!(counts(&both, 2.4, &limits()), [387, 387]);
    // A gap of 6 um, an overlap, a wall that is 6 um away, one that cuts.
    assert_eq!(
        counts(&[straight(0.6), straight(1.806)], 2.406, &limits()),
        [0, 0]
    );
    assert_eq!(
        counts(&[straight(0.6), straight(1.794)], 2.394, &limits()),
        [0, 0]
    );
    assert_eq!(counts(&both, 2.406, &limits()), [387, 0]);
    assert_eq!(counts(&both, 2.399, &limits()), [387, 0]);
    // A bead that is alone in the bar, and one laid twice.
    assert_eq!(counts(&both[..1], 2.4, &limits()), [0]);
    let turned = both.clone().map(|mut pass| {
        pass.control.iter_mut().for_each(|point| point[2] += 0.2);
        pass
    });
    assert_eq!(counts(&turned, 2.4, &limits()), [0, 0]);
    // Moved aside by 30 um, which the tip passes at full speed: neither it nor what is next to it.
    for bump in [[0.03, 0.0], [0.0, 0.3]] {
        let found = fitting_mm(&[bead(0.6, bump), straight(1.8)], 2.4, &limits());
        for (pass, found) in found.iter().enumerate() {
            assert!(found.iter().all(|x_mm| (x_mm - 30.0).abs() > 0.8), "{pass}");
            let far = found.iter().filter(|x_mm| (*x_mm - 30.0).abs() > 2.5);
            assert!(far.count() >= 387 - 21, "{pass} {}", found.len());
        }
    }
}

/// Goal: a bead that turns as its walls do fits as long as the heading's axis follows at full speed. Method: two rings with
/// the heading on the normal, with the built-in axis and with one that turns by less than the tip's speed over the radius.
#[test]
fn rings_fit_where_the_heading_follows() {
    let ring = |radius_mm: f64| {
        pass_of((25.0 * radius_mm) as usize, 0.25 / 30.0, move |t| {
            let angle = 6.0 * t;
            [radius_mm * angle.cos(), radius_mm * angle.sin(), angle]
        })
    };
    let passes = [ring(8.6), ring(9.8)];
    let circle = |radius_mm: f64| -> Vec<[f64; 2]> {
        let point = |k: i32| {
            let angle = std::f64::consts::TAU * f64::from(k) / 720.0;
            [radius_mm * angle.cos(), radius_mm * angle.sin()]
        };
        (0..720).map(point).collect()
    };
    // Chords of a circle lie 0.1 um inside it, and so does the spline through points on it.
    let (outer, mut inner) = (circle(10.4005), circle(7.9985));
    inner.reverse();
    let walls = headway_geometry::test_shapes::walls(&[&outer, &inner]);
    for (heading_speed, share) in [(17.9, 0.9), (5.0, 0.0)] {
        let mut limits = limits();
        limits.axes[2].speed = heading_speed;
        let site = site(&walls, &ELLIPSE, &limits);
        let mut fitting = 0;
        let search = Search::of(&passes, &site, &objective(0.6), |knots, ranges, tools| {
            let paces = fitting::paces(knots, ranges, tools);
            fitting = paces.iter().flatten().count();
            None
        });
        let knots = search.map(|search| search.newton.knots.len());
        let knots = knots.unwrap_or_else(|outcome| panic!("{outcome:?}")) as f64;
        let found = fitting as f64 / knots;
        assert!(found >= share && found <= share + 0.1, "{found}");
    }
}

/// Goal: what fits stays as it is and costs nothing; the rest is improved as without it. Method: two beads, the lower one bent by
/// 0.1 mm, optimised with and without all knots.
#[test]
fn the_rest_is_as_good_as_the_whole() {
    let bar = rectangle(LENGTH_MM, 2.4);
    let limits = limits();
    let site = site(&bar, &ELLIPSE, &limits);
    let passes = [bead(0.6, [0.1, 0.0]), bead(1.8, [0.0; 2])];
    let objective = objective(0.6);
    let begun = |leaves_out: bool| {
        let search = match leaves_out {
            true => Search::begin(&passes, &site, &objective),
            false => Search::of(&passes, &site, &objective, |_, _, _| None),
        };
        search.unwrap_or_else(|outcome| panic!("{outcome:?}"))
    };
    let [part, whole] = [true, false].map(|leaves_out| begun(leaves_out).newton.knots.len());
    assert!(part < whole / 2, "{part} {whole}");
    let effort = Effort::cold(20);
    let mut own = passes.to_vec();
    let report = optimise(&mut own, &site, &objective, &effort);
    let mut others = passes.to_vec();
    let searched = begun(false).run(&effort);
    searched.finish(&mut others, &site);
    let bump_mm = |passes: &[OptimisedPass]| {
        let points = passes[0].control.iter();
        points.map(|p| (p[1] - 0.6).abs()).fold(0.0, f64::max)
    };
    assert!(bump_mm(&passes) > 0.095);
    assert!(
        bump_mm(&own) < 0.01 && bump_mm(&others) < 0.01,
        "{}",
        bump_mm(&own)
    );
    for (before, after) in passes.iter().zip(&own) {
        let pairs = before.control.iter().zip(&after.control).enumerate();
        let far = pairs.filter(|(k, (p, _))| (30..370).contains(k) && (p[0] - 30.0).abs() > 6.0);
        for (k, (p, q)) in far {
            let moved = (p[0] - q[0]).hypot(p[1] - q[1]);
            // The last projection keeps them half a micrometre off the walls.
            assert!(moved < 1e-3 && (p[2] - q[2]).abs() < 1e-6, "{k} {moved}");
        }
    }
    // Areas and seconds by the count of all knots.
    let counted = |passes: &[OptimisedPass]| {
        let search = Search::of(passes, &site, &objective, |_, _, _| None);
        let Search { units, newton, .. } = search.unwrap_or_else(|outcome| panic!("{outcome:?}"));
        let area = newton.terms.open + 0.5 * newton.terms.twice;
        [
            area * units.length_mm.powi(2),
            newton.terms.time * units.time_s,
        ]
    };
    let [own_mm2, own_s] = counted(&own);
    let [others_mm2, _] = counted(&others);
    assert!(own_mm2 < others_mm2 + 0.01, "{own_mm2} {others_mm2}");
    // At 57 mm/s, but for the bump and a little at the soft limits of the ends.
    let least_s = 2.0 * 99.2 / limits.tip_speed_mm_s;
    assert!((own_s / least_s - 1.0).abs() < 0.01, "{own_s} {least_s}");
    // The beads that fit leave nothing open, and all of them take time.
    let reported_mm2 = report.open_mm2[1] + 0.5 * report.twice_mm2[1];
    assert!(
        (reported_mm2 - own_mm2).abs() < 0.1,
        "{reported_mm2} {own_mm2}"
    );
    assert!(
        (report.seconds[1] / own_s - 1.0).abs() < 1e-3,
        "{report:?} {own_s}"
    );
}

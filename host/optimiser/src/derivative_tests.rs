//! Tests of the parts: each term's gradient against differences, the banded solver against a dense one.

use super::band::{Band, System, WIDTH};
use super::containment::Wall;
use super::curve::{At, CHANNELS, Knot, PACE, PassKnots, set_phantoms};
use super::curves::Curves;
use super::newton::prepare;
use super::terms::Terms;
use super::test_passes::{apertures, kind_name, limits, objective, pass_of, rectangle, site};
use super::{OptimisedPass, Search};
use headway_geometry::aperture::Aperture;
use headway_geometry::test_shapes::{ELLIPSE, random_numbers};
use std::f64::consts::FRAC_PI_2;

/// Two beads that touch the walls and each other here and there, headings and pace uneven.
fn uneven() -> Vec<OptimisedPass> {
    [0.6, 1.74]
        .into_iter()
        .map(|y| {
            let mut pass = pass_of(30, 0.006, |t| {
                let wave = (17.0 * t + y).sin();
                let heading = FRAC_PI_2 + 0.3 * (11.0 * t).cos();
                [0.5 + 7.0 * t, y + 0.04 * wave, heading]
            });
            for (k, pace) in pass.log_pace.iter_mut().enumerate() {
                *pace += 0.2 * (0.9 * k as f64).sin();
            }
            pass
        })
        .collect()
}

/// Greatest difference of a term's slope along random directions from its central difference, against the greatest
/// slope. `term` adds it and reads its value.
fn error_of(
    aperture: &Aperture,
    step: f64,
    mut term: impl FnMut(&mut Search, &[Knot], &mut System) -> f64,
) -> f64 {
    let walls = rectangle(8.0, 2.35);
    let passes = uneven();
    let limits = limits();
    let site = site(&walls, aperture, &limits);
    let mut search = Search::of(&passes, &site, &objective(0.6), |_, _, _| None)
        .unwrap_or_else(|outcome| panic!("{outcome:?}"));
    let knots = search.newton.knots.clone();
    let ranges = search.newton.passes.clone();
    let mut system = System::new(CHANNELS * knots.len());
    term(&mut search, &knots, &mut system);
    prepare(&mut system, &ranges, &[]);
    let mut spare = System::new(CHANNELS * knots.len());
    let mut random = random_numbers(7);
    let (mut worst, mut greatest) = (0.0f64, 0.0f64);
    for _ in 0..12 {
        let mut direction = vec![[0.0; CHANNELS]; knots.len()];
        for range in &ranges {
            // Waves, as a step of the solver has them; ends stay.
            let [phase, wave] = [6.0 * random(), 0.2 + 0.6 * random()];
            let amount: [f64; CHANNELS] = std::array::from_fn(|_| random() - 0.5);
            let own = range.first + 1..range.end() - 1;
            let last = own.end - 1;
            for (k, step) in direction
                .iter_mut()
                .enumerate()
                .take(own.end)
                .skip(own.start)
            {
                let is_end = k == own.start || k == last;
                for c in 0..CHANNELS {
                    let swing = (phase + c as f64 + wave * k as f64).sin();
                    step[c] = if is_end && c < PACE {
                        0.0
                    } else {
                        amount[c] * swing
                    };
                }
            }
        }
        let mut at = |way: f64| {
            let mut moved = knots.clone();
            for (knot, step) in moved.iter_mut().zip(&direction) {
                *knot = std::array::from_fn(|c| knot[c] + way * step[c]);
            }
            for range in &ranges {
                set_phantoms(&mut moved, range);
            }
            term(&mut search, &moved, &mut spare)
        };
        let difference = (at(step) - at(-step)) / (2.0 * step);
        let entries = direction.iter().flatten().zip(&system.gradient);
        let slope: f64 = entries.map(|(d, g)| d * g).sum();
        worst = worst.max((slope - difference).abs());
        greatest = greatest.max(slope.abs());
    }
    assert!(greatest > 0.0);
    worst / greatest
}

/// All knots move.
fn moving<'a>(knots: &'a [Knot], passes: &'a [PassKnots]) -> At<'a> {
    At {
        knots,
        passes,
        stays: &[],
    }
}

/// Goal: the slope of time and limits is exact. Method: central differences; 1e-6 is what they leave at hinges.
#[test]
fn slope_of_motion() {
    let error = error_of(&ELLIPSE, 1e-6, |search, knots, system| {
        let mut terms = Terms::default();
        let ranges = search.newton.passes.clone();
        let motion = &search.newton.objectives.motion;
        motion.add(&moving(knots, &ranges), 2.0, &mut terms, Some(system));
        assert!(terms.excess > 1.0);
        terms.time + terms.excess + terms.smooth
    });
    assert!(error < 1e-5, "{error}");
}

/// Goal: the slope of curves that are too tight is exact. Method: central differences; the path wavers, so that a bound
/// of 0.02 is exceeded nearly everywhere, up to where the cost grows no faster. A rectangle's width has kinks, over
/// which its slope is a mean: 1e-3.
#[test]
fn slope_of_curves() {
    for aperture in apertures() {
        let error = error_of(&aperture, 1e-6, |search, knots, system| {
            let mut terms = Terms::default();
            let ranges = search.newton.passes.clone();
            let curves = Curves::new(&aperture, search.units.length_mm, 0.02);
            curves.add(knots, &ranges, 2.0, &mut terms, Some(system));
            assert!(terms.excess > 1.0);
            terms.excess
        });
        assert!(error < 1e-3, "{} {error}", kind_name(&aperture));
    }
}

/// Goal: the slope of containment is right near contact. Method: central differences; the distance is of first order
/// off an ellipse's outline, so that a hundredth of a beyond it costs some per mille; exact for polygons.
#[test]
fn slope_of_containment() {
    let wall = Wall {
        weight: 100.0,
        margin: 0.01,
    };
    for aperture in apertures() {
        let error = error_of(&aperture, 1e-5, |search, knots, system| {
            let mut terms = Terms::default();
            let ranges = search.newton.passes.clone();
            let containment = &mut search.newton.objectives.containment;
            containment.add(&moving(knots, &ranges), &wall, &mut terms, system);
            assert!(terms.outside > 0.0);
            terms.outside
        });
        assert!(error < 0.01, "{} {error}", kind_name(&aperture));
    }
}

/// Goal: the slope of ground is the slope of what the strips find, for the whole of which the contacts stand.
/// Method: differences over 1e-3 a, since single cells come and go below that; 0.01 for an ellipse. A
/// rectangle's contact may jump along a side that runs along the path: 0.11, all others stay below 0.04.
#[test]
fn slope_of_ground() {
    for aperture in apertures() {
        let error = error_of(&aperture, 1e-3, |search, knots, system| {
            let mut terms = Terms::default();
            let ranges = search.newton.passes.clone();
            let ground = &mut search.newton.objectives.ground;
            ground.sweep(knots, &ranges);
            ground.add(0.3, &mut terms, Some(system));
            assert!(terms.open > 0.0 && terms.twice > 0.0);
            terms.ground
        });
        let name = kind_name(&aperture);
        let bound = if name == "rect" { 0.15 } else { 0.05 };
        assert!(error < bound, "{name} {error}");
    }
}

/// A random positive definite system of `knots` knots, and its matrix row by row.
fn random_system(knots: usize, seed: u64) -> (System, Vec<Vec<f64>>) {
    let mut random = random_numbers(seed);
    let unknowns = CHANNELS * knots;
    let mut system = System::new(unknowns);
    for i in 0..unknowns {
        // A span couples four knots.
        let end = (CHANNELS * (i / CHANNELS) + WIDTH).min(unknowns);
        for (off, entry) in system.band.row_mut(i)[..end - i].iter_mut().enumerate() {
            *entry = if off == 0 {
                20.0 + random()
            } else {
                random() - 0.5
            };
        }
        system.gradient[i] = random() - 0.5;
    }
    let row = |i: usize| (0..unknowns).map(|j| system.band.at(i, j)).collect();
    let dense = (0..unknowns).map(row).collect();
    (system, dense)
}

fn product(matrix: &[Vec<f64>], x: &[f64]) -> Vec<f64> {
    let row = |row: &Vec<f64>| row.iter().zip(x).map(|(a, b)| a * b).sum();
    matrix.iter().map(row).collect()
}

/// Goal: the banded solver solves. Method: the solutions of random systems, an unknown taken out, multiplied by the
/// dense matrix.
#[test]
fn band_agrees_with_dense() {
    for knots in [4, 5, 9, 30] {
        let (mut system, mut dense) = random_system(knots, knots as u64);
        let pinned = 2 * CHANNELS + 1;
        system.pin(pinned);
        dense[pinned].fill(0.0);
        for row in &mut dense {
            row[pinned] = 0.0;
        }
        dense[pinned][pinned] = 1.0;
        let mut found = system.gradient.clone();
        assert!(system.band.factor());
        system.band.solve(&mut found);
        for (own, right) in product(&dense, &found).iter().zip(&system.gradient) {
            assert!((own - right).abs() < 1e-12);
        }
    }
    let mut indefinite = Band::new(8);
    indefinite.row_mut(0)[0] = -1.0;
    assert!(!indefinite.factor());
}

/// Goal: taking out a phantom is a change of variables. Method: products with random vectors x, before and after:
/// with T the change, (Tᵀ A T) x and Tᵀ g.
#[test]
fn folding_is_a_change_of_variables() {
    let knots = 7;
    let (mut system, dense) = random_system(knots, 3);
    let unknowns = CHANNELS * knots;
    let ends = [[0, 1, 2], [6, 5, 4]];
    let transposed = |mut y: Vec<f64>| {
        for [phantom, end, inner] in ends {
            for c in 0..CHANNELS {
                let value = std::mem::take(&mut y[CHANNELS * phantom + c]);
                y[CHANNELS * end + c] += 2.0 * value;
                y[CHANNELS * inner + c] -= value;
            }
        }
        y
    };
    let slope = transposed(system.gradient[..unknowns].to_vec());
    system.fold(0, ends[0]);
    system.fold(3, ends[1]);
    let mut random = random_numbers(5);
    let mut x: Vec<f64> = (0..unknowns).map(|_| random() - 0.5).collect();
    for [phantom, end, inner] in ends {
        for c in 0..CHANNELS {
            x[CHANNELS * phantom + c] = 2.0 * x[CHANNELS * end + c] - x[CHANNELS * inner + c];
        }
    }
    let expected = transposed(product(&dense, &x));
    for [phantom, ..] in ends {
        x[CHANNELS * phantom..][..CHANNELS].fill(0.0);
    }
    for i in 0..unknowns {
        let row: f64 = (0..unknowns).map(|j| system.band.at(i, j) * x[j]).sum();
        assert!((row - expected[i]).abs() < 1e-12, "{i}");
        assert!((system.gradient[i] - slope[i]).abs() < 1e-12, "{i}");
    }
}

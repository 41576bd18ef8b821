//! G2, G3 and G5 -> chords.
//!
//! In: start and end in the plane of the arc, centre or radius, mm; out: points between them, the end
//! last, no chord farther than [`CHORD_MM`] from the curve. Turns (P) and helices go through evenly.
//! Source: RS274/NGC 3, sections 3.5.3 and 3.8; G5 as Marlin and LinuxCNC have it.
use crate::gcode::error;
use crate::text::refusal::Refusal;
use std::f64::consts::{PI, TAU};

/// How far a chord may be from the curve, mm.
pub const CHORD_MM: f64 = 0.001;
/// How far the centre may be from lying evenly between start and end, mm, and of the radius: three
/// decimals, and inches with four.
const UNEVEN_MM: f64 = 0.02;
const UNEVEN_SHARE: f64 = 0.002;
/// Most chords of one line.
const CHORDS_MAX: f64 = 100_000.0;
/// Most turns of one line: a hundred, and the arc itself.
pub const TURNS_MAX: f64 = 101.0;

/// An arc as its line gives it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ArcWords {
    /// G2.
    pub clockwise: bool,
    /// From the start to the centre.
    pub centre_mm: Option<[f64; 2]>,
    /// R; negative for the way round of more than half a turn.
    pub radius_mm: Option<f64>,
    /// P: times that the end is passed, 1 where it is not given.
    pub turns: Option<f64>,
}

/// Shares of the way and places of the chords' ends; the last is the end itself.
///
/// # Errors
/// [`Refusal`] of what is no arc, and where the chords are more than `chords_max`, before any is made.
pub fn arc_chords(
    from: [f64; 2],
    to: [f64; 2],
    words: &ArcWords,
    chords_max: usize,
    line: usize,
) -> Result<Vec<[f64; 2]>, Refusal> {
    let bad = |problem: String| error::arc(line, &problem);
    let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    let offset = match (words.centre_mm, words.radius_mm) {
        (Some(offset), _) => offset,
        (None, Some(radius_mm)) => {
            let centre = centre_of_radius([dx, dy], radius_mm, words.clockwise);
            centre.ok_or_else(|| {
                bad(format!(
                    "of radius {radius_mm} does not reach its end, or ends where it begins: give its \
                     centre (I, J, K)"
                ))
            })?
        }
        (None, None) => {
            return Err(bad(
                "has neither centre (I, J, K) nor radius (R)".to_string()
            ));
        }
    };
    let radius_mm = offset[0].hypot(offset[1]);
    let end_mm = (dx - offset[0]).hypot(dy - offset[1]);
    let uneven_mm = (radius_mm - end_mm).abs();
    if !(radius_mm > 0.0 && radius_mm < 1e6) || uneven_mm > UNEVEN_MM.max(UNEVEN_SHARE * radius_mm)
    {
        return Err(bad(format!(
            "has radius {radius_mm:.4} mm at its start and {end_mm:.4} mm at its end: check I, J, K and \
             their mode (G90.1, G91.1)"
        )));
    }
    let turns = words.turns.unwrap_or(1.0);
    if !(1.0..=TURNS_MAX).contains(&turns) {
        return Err(bad(format!("has P{turns}: write 1 to {TURNS_MAX} turns")));
    }
    let start_rad = (-offset[1]).atan2(-offset[0]);
    let stop_rad = (dy - offset[1]).atan2(dx - offset[0]);
    let sign = if words.clockwise { -1.0 } else { 1.0 };
    let mut sweep_rad = (sign * (stop_rad - start_rad)).rem_euclid(TAU);
    // The end on the start is a full circle.
    if dx.hypot(dy) < 1e-6 || sweep_rad < 1e-9 {
        sweep_rad = TAU;
    }
    sweep_rad += TAU * (turns.floor() - 1.0);
    let step_rad = 2.0 * (1.0 - CHORD_MM / radius_mm.max(CHORD_MM)).acos();
    let count = (sweep_rad / step_rad.min(PI / 8.0)).ceil().max(1.0);
    if count > CHORDS_MAX {
        return Err(bad(format!(
            "needs more than {CHORDS_MAX} chords: divide it"
        )));
    }
    let count = count as usize;
    if count > chords_max {
        return Err(error::too_fine(line));
    }
    let places = (1..=count).map(|k| {
        if k == count {
            return to;
        }
        let share = k as f64 / count as f64;
        let angle = start_rad + sign * sweep_rad * share;
        let reach = radius_mm + share * (end_mm - radius_mm);
        [
            from[0] + offset[0] + reach * angle.cos(),
            from[1] + offset[1] + reach * angle.sin(),
        ]
    });
    Ok(places.collect())
}

/// The centre, from the start, of the arc of this radius; `None` where there is none.
fn centre_of_radius([dx, dy]: [f64; 2], radius_mm: f64, clockwise: bool) -> Option<[f64; 2]> {
    let chord_mm = dx.hypot(dy);
    if chord_mm < 1e-6 || radius_mm == 0.0 {
        return None;
    }
    let square = radius_mm * radius_mm - 0.25 * chord_mm * chord_mm;
    // A half circle may be short of its end by what decimals take.
    if square < -UNEVEN_MM * radius_mm.abs() {
        return None;
    }
    let aside = square.max(0.0).sqrt() / chord_mm;
    let left = clockwise != (radius_mm > 0.0);
    let side = if left { 1.0 } else { -1.0 };
    Some([0.5 * dx - side * aside * dy, 0.5 * dy + side * aside * dx])
}

/// A cubic Bezier curve's chords; control points relative to nothing but the plane.
pub fn bezier_chords(p: [[f64; 2]; 4]) -> Vec<[f64; 2]> {
    let bend = |i: usize| {
        let [x, y] = [0, 1].map(|c: usize| p[i][c] - 2.0 * p[i + 1][c] + p[i + 2][c]);
        x.hypot(y)
    };
    let second = 6.0 * bend(0).max(bend(1));
    let count = (second / (8.0 * CHORD_MM))
        .sqrt()
        .ceil()
        .clamp(1.0, CHORDS_MAX) as usize;
    let places = (1..=count).map(|k| {
        let t = k as f64 / count as f64;
        let s = 1.0 - t;
        let weights = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
        [0, 1].map(|c: usize| (0..4).map(|i| weights[i] * p[i][c]).sum())
    });
    places.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn centred(clockwise: bool, centre_mm: [f64; 2]) -> ArcWords {
        ArcWords {
            clockwise,
            centre_mm: Some(centre_mm),
            ..ArcWords::default()
        }
    }

    /// Goal: chords within 1 µm of the circle, the right way round, ends kept. Method: quarters, full
    /// circles and radii in closed form.
    #[test]
    fn arcs_go_the_way_they_say() {
        let length = |from: [f64; 2], chords: &[[f64; 2]]| -> f64 {
            let mut at = from;
            let steps = chords.iter().map(|to| {
                let step = (to[0] - at[0]).hypot(to[1] - at[1]);
                at = *to;
                step
            });
            steps.sum()
        };
        let from = [10.0, 0.0];
        let quarter = arc_chords(from, [0.0, 10.0], &centred(false, [-10.0, 0.0]), 10_000, 1)
            .expect("quarter");
        assert!((length(from, &quarter) - 5.0 * PI).abs() < 2e-3);
        let other = arc_chords(from, [0.0, 10.0], &centred(true, [-10.0, 0.0]), 10_000, 1)
            .expect("the other way");
        assert!((length(from, &other) - 15.0 * PI).abs() < 6e-3);
        let whole = arc_chords(from, from, &centred(false, [-10.0, 0.0]), 10_000, 1).expect("full");
        assert!((length(from, &whole) - 20.0 * PI).abs() < 8e-3);
        for pair in whole.windows(2) {
            let middle = [
                0.5 * (pair[0][0] + pair[1][0]),
                0.5 * (pair[0][1] + pair[1][1]),
            ];
            assert!(10.0 - middle[0].hypot(middle[1]) < 1.01 * CHORD_MM);
        }
        for (radius_mm, clockwise, expected) in [
            (10.0, false, 0.5),
            (-10.0, false, 1.5),
            (10.0, true, 0.5),
            (-10.0, true, 1.5),
        ] {
            let words = ArcWords {
                clockwise,
                radius_mm: Some(radius_mm),
                ..ArcWords::default()
            };
            let arc = arc_chords(from, [0.0, 10.0], &words, 10_000, 1).expect("radius");
            assert!(
                (length(from, &arc) - 10.0 * PI * expected).abs() < 6e-3,
                "{radius_mm} {clockwise}"
            );
        }
        let short = ArcWords {
            radius_mm: Some(3.0),
            ..ArcWords::default()
        };
        assert!(
            arc_chords(from, [0.0, 10.0], &short, 10_000, 4)
                .expect_err("too short")
                .to_string()
                .contains("line 4")
        );
        assert!(arc_chords(from, [0.0, 9.0], &centred(false, [-10.0, 0.0]), 10_000, 1).is_err());
    }

    #[test]
    fn a_bezier_ends_where_it_should() {
        let line = bezier_chords([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]);
        assert_eq!(line, [[3.0, 0.0]]);
        let bent = bezier_chords([[0.0, 0.0], [0.0, 5.0], [10.0, 5.0], [10.0, 0.0]]);
        assert!(bent.len() > 20 && bent.last() == Some(&[10.0, 0.0]));
    }
}

//! Goal: a pattern read as instructed gives the machine's true value. Method: a machine with a known error;
//! positions and widths of its real beads are computed here from the lines' headings and axes; the line that
//! fits must be the one whose value is that error.

use super::*;
use headway_firmware::configuration::Kinematics;

fn drawn(kind: PatternKind, asked: Asked, settings: &Settings) -> Pattern {
    pattern(kind, &asked, settings).expect("a pattern")
}

/// The value for which a measure is least.
fn least<'a>(lines: impl Iterator<Item = (&'a Line, f64)>) -> f64 {
    let best = lines.min_by(|a, b| a.1.total_cmp(&b.1)).expect("lines");
    best.0.value.expect("a value")
}

#[test]
fn the_narrowest_line_tells_the_heading() {
    let settings = Settings::planar();
    let fan = drawn(PatternKind::Heading, Asked::default(), &settings);
    let [a, b] = [0.6, 0.2];
    for off_deg in [-20.0, 0.0, 15.0] {
        for fan_name in ["fan", "fan after 5 turns"] {
            let lines = fan.lines.iter().filter(|line| line.what == fan_name);
            let width = |line: &Line| {
                let real = (line.heading_deg().unwrap() + off_deg).to_radians();
                (a * real.sin()).hypot(b * real.cos())
            };
            let read_deg = least(lines.map(|line| (line, width(line))));
            assert!((read_deg + off_deg).abs() < 1e-9, "{read_deg} {off_deg}");
        }
    }
}

#[test]
fn the_second_fan_tells_the_steps_of_a_turn() {
    let settings = Settings::planar();
    let fan = drawn(PatternKind::Heading, Asked::default(), &settings);
    // 9600 steps in the file, really 9600 / 0.99 a turn: it turns 1 % too little.
    let turned = 0.99;
    let read = |name: &str| {
        let lines = fan.lines.iter().filter(|line| line.what == name);
        let width = |line: &Line| {
            (turned * line.heading_deg().unwrap())
                .to_radians()
                .sin()
                .abs()
        };
        least(lines.map(|line| (line, width(line))))
    };
    let difference_deg = read("fan after 5 turns") - read("fan");
    let steps = 9600.0 * (1.0 + difference_deg / (360.0 * 5.0));
    // The fan steps by 5°, so that the reading is within half of that of 18.2°.
    assert!(
        (steps - 9600.0 / turned).abs() < 9600.0 * 2.5 / 1800.0 + 1.0,
        "{steps}"
    );
    assert!(difference_deg > 0.0);
}

/// The lines in halves of a row, by pairs.
fn pairs<'a>(pattern: &'a Pattern, row: &str) -> Vec<[&'a Line; 2]> {
    let lines: Vec<&Line> = pattern
        .lines
        .iter()
        .filter(|l| l.what.starts_with(row))
        .collect();
    assert!(lines.len() >= 6, "{}", lines.len());
    lines
        .chunks_exact(2)
        .map(|pair| [pair[0], pair[1]])
        .collect()
}

#[test]
fn the_line_without_a_step_tells_how_far_the_nozzle_is_off() {
    let settings = Settings::planar();
    let pattern = drawn(PatternKind::Nozzle, Asked::default(), &settings);
    // Off by this in tool axes.
    let (off_x, off_y) = (0.18, -0.12);
    let real_y = |line: &Line| {
        let (sin, cos) = line.points[0].heading_rad.unwrap().sin_cos();
        line.points[0].tip_mm.y + off_x * sin + off_y * cos
    };
    for (row, off_mm) in [("row 1", off_y), ("row 2", off_x)] {
        let halves = pairs(&pattern, row).into_iter();
        let read = least(halves.map(|[a, b]| (a, (real_y(a) - real_y(b)).abs())));
        assert!((read - off_mm).abs() < 1e-9, "{row}: {read}");
    }
}

#[test]
fn the_line_without_a_step_tells_the_pivot_length() {
    let settings = Settings::gantry();
    let Kinematics::Gantry { pivot_length_mm } = settings.machine.kinematics else {
        panic!("a gantry");
    };
    let pattern = drawn(PatternKind::Pivot, Asked::default(), &settings);
    let true_mm = pivot_length_mm + 0.3;
    // X Y Z go where the file's length takes them; the true length hangs the tip from there.
    let real = |line: &Line| {
        let (tip, axis) = (
            line.points[0].tip_mm.coords,
            line.points[0].axis.into_inner(),
        );
        tip + pivot_length_mm * axis - true_mm * axis
    };
    for (row, across) in [("row 1", 1), ("row 2", 0)] {
        let halves = pairs(&pattern, row).into_iter();
        let read = least(halves.map(|[a, b]| (a, (real(a)[across] - real(b)[across]).abs())));
        assert!((read - true_mm).abs() < 1e-9, "{row}: {read}");
    }
}

#[test]
fn what_makes_no_sense_is_refused_with_what_to_do() {
    let planar = Settings::planar();
    let refused = |kind, asked: Asked, settings: &Settings, words: &str, is_usage| {
        let error = pattern(kind, &asked, settings).expect_err(words);
        assert!(error.to_string().contains(words), "{error}");
        assert_eq!(
            matches!(error, CalibrationError::Usage(_)),
            is_usage,
            "{error}"
        );
    };
    let none = Asked::default();
    refused(PatternKind::Pivot, none, &planar, "heads that tilt", false);
    let round = Settings {
        aperture: crate::settings::aperture_text::parse_aperture("circle:0.6").expect("round"),
        ..planar.clone()
    };
    refused(PatternKind::Heading, none, &round, "round", false);
    let of = |change: fn(&mut Asked)| {
        let mut asked = Asked::default();
        change(&mut asked);
        asked
    };
    use PatternKind as K;
    let tilted = of(|asked| asked.tilt_deg = Some(10.0));
    refused(K::Heading, tilted, &planar, "--tilt does not go", true);
    let few = of(|asked| asked.lines = Some(2));
    refused(K::Heading, few, &planar, "from 3 to 41", true);
    let no_number = of(|asked| asked.from = Some(f64::NAN));
    refused(K::Advance, no_number, &planar, "--from below --to", true);
    let backwards = of(|asked| (asked.from, asked.to) = (Some(0.1), Some(0.05)));
    refused(K::Advance, backwards, &planar, "--from below --to", true);
    let long = of(|asked| asked.length_mm = Some(1000.0));
    refused(K::Prime, long, &planar, "--length", false);
    let mut dry = planar.clone();
    dry.prime_retract.retract_mm3 = 0.0;
    refused(K::Retract, none, &dry, "retract_mm3 is 0", false);
}

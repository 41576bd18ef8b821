//! Goal: headings are within each point's range and turn as little as possible. Method: lines whose headings are
//! known by hand.

use super::{BeadLines, HeadingTrack, bead_headings};
use crate::settings::Settings;
use std::f64::consts::PI;

/// Lines of 0.45 mm at 60 mm/s by directions in degrees and lengths.
fn lines(legs: &[[f64; 2]], is_inside: bool) -> BeadLines {
    let count = legs.len();
    BeadLines {
        travel_rad: legs.iter().map(|leg| leg[0].to_radians()).collect(),
        length_mm: legs.iter().map(|leg| leg[1]).collect(),
        widths_mm: vec![0.45; count],
        speeds_mm_s: vec![60.0; count],
        is_inside: vec![is_inside; count],
        arrival_s: 0.1,
    }
}

fn track(lines: &BeadLines) -> HeadingTrack {
    let mut tracks = bead_headings(
        std::slice::from_ref(lines),
        lines.travel_rad[0],
        &Settings::default(),
    );
    tracks.pop().expect("a track")
}

/// How far the long axis is from the travel, degrees in [0, 90].
fn off_deg(heading_rad: f64, travel_rad: f64) -> f64 {
    let off = (heading_rad - travel_rad).rem_euclid(PI);
    off.min(PI - off).to_degrees()
}

/// A bead of 0.45 mm is laid at sin² = (0.45² - 0.4²) / (1.2² - 0.4²) from the travel: 10.5°.
#[test]
fn long_lines_have_their_width() {
    let lines = lines(&[[0.0, 20.0], [90.0, 20.0], [180.0, 20.0]], false);
    let track = track(&lines);
    for (k, travel_rad) in lines.travel_rad.iter().enumerate() {
        for at_mm in [6.0, 10.0, 14.0] {
            let heading_rad = track.at(20.0 * k as f64 + at_mm);
            let off = off_deg(heading_rad, *travel_rad);
            // Cubics between nodes: 0.2° are 0.002 mm of width.
            assert!((off - 10.5).abs() < 0.2, "{off}° on leg {k}");
        }
    }
    assert!(
        track.off.third_mm > 0.1 && track.off.longest_mm < 1.0,
        "{:?}",
        track.off
    );
    // Within 3 mm of the two corners.
    assert!(track.off.eighth_mm < 4.0, "{:?}", track.off);
}

/// Round a rectangle the nozzle turns on and on, whatever rounding makes of its right angles; to which side is the same.
#[test]
fn the_nozzle_turns_on_round_a_rectangle() {
    for tilt in [-1e-7, 0.0, 1e-7] {
        let legs: Vec<[f64; 2]> = (0..8)
            .map(|k| [90.0 * f64::from(k) + tilt * f64::from(k % 2), 5.0])
            .collect();
        let track = track(&lines(&legs, false));
        let turned_deg = (track.at(40.0) - track.at(0.0)).to_degrees();
        // Seven corners, less what both ends lead and lag: at most 24° each.
        assert!((turned_deg.abs() - 630.0).abs() < 50.0, "{turned_deg}");
        let at = |k: u32| track.at(0.1 * f64::from(k)) * turned_deg.signum();
        assert!((0..399).all(|k| at(k + 1) - at(k) > -0.01), "it turns back");
    }
}

/// Over the stubs of a solid infill the heading is held, of a wall it is not.
#[test]
fn headings_are_held_over_links_of_an_infill() {
    let mut legs = Vec::new();
    for k in 0..20 {
        legs.push([if k % 2 == 0 { 0.0 } else { 180.0 }, 8.0]);
        legs.push([90.0, 0.45]);
    }
    legs.pop();
    let turned = |is_inside: bool| {
        let track = track(&lines(&legs, is_inside));
        let length_mm = 20.0 * 8.0 + 19.0 * 0.45;
        let at = |k: u32| track.at(length_mm * f64::from(k) / 4000.0);
        let turns = (0..4000).map(|k| (at(k + 1) - at(k)).abs());
        turns.sum::<f64>().to_degrees()
    };
    // Five degrees a link; a nozzle that turns to each link and back needs 138.
    let held_deg = turned(true);
    assert!(held_deg < 19.0 * 5.0, "{held_deg}");
    let walls_deg = turned(false);
    assert!(walls_deg > 3.0 * held_deg, "{walls_deg}");
}

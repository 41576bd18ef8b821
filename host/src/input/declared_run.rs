//! G-code of declared axes whose tool tilts -> a run of waypoints that keeps its volumes and speeds.
//!
//! In: a [`GcodeProgram`] whose points are poses on the part (mm, degrees), legs with volume and the tip's speed.
//! Out: [`WaypointRun`] with the file's passes: each waypoint has the section of its bead (volume per mm of path) and
//! its speed, each pass its prime and retract. Where two legs meet, the section is their mean and the speed the lower
//! one; sections are scaled so that a pass deposits the file's volume. Not covered: travel, which depends on the
//! machine, layers, heaters and fans.

use super::gcode_run::{DIVISIONS_MAX, SPACING_MM, heat_note};
use super::near_waypoints::joined;
use super::waypoints::{PassAsked, Waypoint, WaypointRun};
use crate::gcode::{GcodePass, GcodeProgram, Leg, Place, Push};
use crate::settings::Settings;
use nalgebra::{Point3, UnitVector3, Vector3};
use std::f64::consts::TAU;

/// Shortest leg whose volume gives a section, mm: E is rounded.
const LEG_MIN_MM: f64 = 1e-3;
/// Legs that turn less than this, are closer than this to their curve, and differ by no more than this, are chords:
/// as joints of polygons in other files.
const CHORD_TURN_RAD: f64 = 0.2;
const CHORD_MM: f64 = 0.02;
const CHORD_RATIO: f64 = 3.0;
/// Highest speed that settings may have, mm/s: a feed beyond it is the machine's to bound.
const SPEED_MAX_MM_S: f64 = 10_000.0;
/// Slowest, mm/s.
const SPEED_MIN_MM_S: f64 = 0.01;

/// The run of a program's passes.
pub fn declared_run(program: GcodeProgram) -> WaypointRun {
    let mut points: Vec<Waypoint> = Vec::new();
    let has_headings = program.has_headings;
    for pass in &program.passes {
        let near_rad = points.last().and_then(|point| point.heading_rad);
        let (mut own, ..) = joined(pass_points(pass, near_rad.unwrap_or(0.0)));
        complete_sections(&mut own);
        scale_sections(&mut own, pass.volume_mm3());
        if !has_headings {
            own.iter_mut().for_each(|point| point.heading_rad = None);
        }
        points.extend(own);
    }
    let mut notes = program.notes;
    notes.extend(heat_note(program.heat.len()));
    notes.push(
        "the tool tilts: the path is followed as waypoints with the file's volumes and speeds; travel between \
         passes is this machine's"
            .to_string(),
    );
    WaypointRun {
        name: program.name,
        points,
        notes,
        has_feeds: true,
    }
}

/// A run's feeds as requested speeds, and the settings with the print speed that they need: the fastest of
/// them, or `speed_max_mm_s`.
pub fn at_feeds(
    run: &mut WaypointRun,
    speed_max_mm_s: Option<f64>,
    settings: &Settings,
) -> Settings {
    if !run.has_feeds {
        return settings.clone();
    }
    let speeds = run.points.iter().filter_map(|point| point.speed_mm_s);
    let fastest_mm_s = speeds.fold(0.0, f64::max) / settings.plan_share;
    let print_mm_s = speed_max_mm_s.map_or(fastest_mm_s, |most| fastest_mm_s.min(most));
    let print_mm_s = print_mm_s.clamp(SPEED_MIN_MM_S, SPEED_MAX_MM_S);
    for point in &mut run.points {
        // The planner uses its share of the requested value.
        let asked = |feed: f64| (feed / settings.plan_share).min(print_mm_s);
        point.speed_mm_s = point.speed_mm_s.map(asked);
    }
    Settings {
        speed_mm_s: print_mm_s,
        ..settings.clone()
    }
}

/// The waypoints of a pass: its places, and more on long legs.
fn pass_points(pass: &GcodePass, near_rad: f64) -> Vec<Waypoint> {
    let mut points: Vec<Waypoint> = Vec::new();
    let mut from: Option<(UnitVector3<f64>, f64)> = None;
    let near = |heading: f64, to: f64| heading + TAU * ((to - heading) / TAU).round();
    let mut section_mm2: Option<f64> = None;
    let bends = Bends::of(&pass.points);
    for (number, (pair, leg)) in pass.points.windows(2).zip(&pass.legs).enumerate() {
        let (axis, heading) = from.unwrap_or_else(|| {
            let (axis, heading) = pair[0].axis_and_heading();
            (axis, near(heading, near_rad))
        });
        let (to_axis, to_heading) = pair[1].axis_and_heading();
        let to_heading = near(to_heading, heading);
        section_mm2 = section(pair, leg).or(section_mm2);
        let at = |share: f64| {
            let tip =
                |i: usize| pair[0].tip_mm[i] + share * (pair[1].tip_mm[i] - pair[0].tip_mm[i]);
            let between = axis.into_inner().lerp(&to_axis, share);
            Waypoint {
                line: leg.line,
                tip_mm: Point3::new(tip(0), tip(1), tip(2)),
                axis: UnitVector3::try_new(between, 1e-6).unwrap_or(to_axis),
                heading_rad: Some(heading + share * (to_heading - heading)),
                width_mm: None,
                height_mm: None,
                section_mm2,
                speed_mm_s: Some(leg.speed_mm_s),
                cone_rad: None,
                begins: false,
                asked: PassAsked::default(),
            }
        };
        match points.last_mut() {
            None => points.push(Waypoint {
                begins: true,
                asked: asked(pass),
                ..at(0.0)
            }),
            Some(joint) => {
                let mean = |a: f64| section_mm2.map_or(a, |b| 0.5 * (a + b));
                joint.section_mm2 = joint.section_mm2.map(mean);
                joint.speed_mm_s = joint.speed_mm_s.map(|speed| speed.min(leg.speed_mm_s));
            }
        }
        let count = bends.waypoints_of(number);
        points.extend((1..=count).map(|k| at(k as f64 / count as f64)));
        from = Some((to_axis, to_heading));
    }
    points
}

/// Legs of a pass, and how the path bends between them.
struct Bends {
    lengths_mm: Vec<f64>,
    /// Between a leg and the next one, rad.
    turns_rad: Vec<f64>,
}

impl Bends {
    fn of(points: &[Place]) -> Bends {
        let chords: Vec<Vector3<f64>> = points
            .windows(2)
            .map(|pair| Vector3::from(pair[1].tip_mm) - Vector3::from(pair[0].tip_mm))
            .collect();
        Bends {
            lengths_mm: chords.iter().map(Vector3::norm).collect(),
            turns_rad: chords
                .windows(2)
                .map(|pair| pair[0].angle(&pair[1]))
                .collect(),
        }
    }

    /// How many waypoints a leg becomes. One where it is a chord of a curve; others are straight.
    fn waypoints_of(&self, leg: usize) -> usize {
        let length_mm = self.lengths_mm[leg];
        let count = (length_mm / SPACING_MM).ceil().clamp(1.0, DIVISIONS_MAX);
        let is_chord = [leg.checked_sub(1), Some(leg)]
            .into_iter()
            .flatten()
            .all(|bend| {
                let Some(turn_rad) = self.turns_rad.get(bend) else {
                    return true;
                };
                let other_mm = self.lengths_mm[if bend == leg { leg + 1 } else { bend }];
                let is_alike =
                    other_mm < CHORD_RATIO * length_mm && length_mm < CHORD_RATIO * other_mm;
                // The height of a curve above its chord.
                is_alike && *turn_rad < CHORD_TURN_RAD && length_mm * turn_rad < 8.0 * CHORD_MM
            });
        if is_chord { 1 } else { count as usize }
    }
}

/// Volume of a leg for each mm; `None` for one of length 0.
fn section(pair: &[Place], leg: &Leg) -> Option<f64> {
    let length_mm = pair[1].distance_mm(&pair[0]);
    let volume_mm3 = leg.volume_mm3?;
    Some(volume_mm3 / length_mm.max(LEG_MIN_MM)).filter(|_| length_mm >= LEG_MIN_MM)
}

fn asked(pass: &GcodePass) -> PassAsked {
    let pushed = |push: Option<Push>| push.map_or(Some(0.0), |push| push.mm3);
    PassAsked {
        pushes_mm3: [pushed(pass.prime), pushed(pass.retract)],
        ..PassAsked::default()
    }
}

/// Gives waypoints before the first leg of non-zero length the section of that leg; all waypoints of a
/// pass have one, or none.
fn complete_sections(points: &mut [Waypoint]) {
    let known = points.iter().find_map(|point| point.section_mm2);
    for point in points.iter_mut() {
        point.section_mm2 = point.section_mm2.or(known);
    }
    if let Some(first) = points.first_mut() {
        first.asked.has_sections = known.is_some();
    }
}

/// Scales the sections of a pass so that they add up to its volume.
fn scale_sections(points: &mut [Waypoint], volume_mm3: Option<f64>) {
    let laid = points.windows(2).map(|pair| {
        let length_mm = (pair[1].tip_mm - pair[0].tip_mm).norm();
        let of = |point: &Waypoint| point.section_mm2.unwrap_or(0.0);
        0.5 * length_mm * (of(&pair[0]) + of(&pair[1]))
    });
    let laid_mm3: f64 = laid.sum();
    let Some(volume_mm3) = volume_mm3.filter(|_| laid_mm3 > 0.0) else {
        return;
    };
    for point in points {
        point.section_mm2 = point.section_mm2.map(|mm2| mm2 * volume_mm3 / laid_mm3);
    }
}

#[cfg(test)]
mod tests {
    //! Goal: a pass lays what its file does, wherever its head stands. Method: passes of a table that turns and tilts, one
    //! of which begins on the spot; sections summed over the chords.
    use super::*;
    use crate::gcode::axes::FileAxes;
    use crate::gcode::{GcodeOptions, read};
    use crate::settings::axes_words::AxesWords;
    use std::sync::Arc;

    fn run(text: &str) -> (WaypointRun, GcodeProgram) {
        let words = "B=head:y:at=0/0/40,C=table:z,coordinates=tip";
        let words = AxesWords::parse(words).expect("words");
        let options = GcodeOptions {
            axes: Some(Arc::new(FileAxes::new(&words, None).expect("axes"))),
            ..GcodeOptions::default()
        };
        let program = read(text.as_bytes(), "run", &options).expect("a program");
        (declared_run(program.clone()), program)
    }

    #[test]
    fn sections_come_to_the_volume_of_their_pass() {
        let text = "M83\nG0 X0 Y0 Z5 B10\nG1 B12 E.02 F600\nG1 X10 E1\nG1 X20 Y1 E.3 F1200\nG1 E-1 F1800\n\
                    G0 X40 C5\nG1 E1.1\nG1 X50 B14 C9 E.5 F900\n";
        let (mut run, program) = run(text);
        assert!(run.has_feeds && run.points.iter().all(|point| point.heading_rad.is_none()));
        let mut passes = run.points.chunk_by(|_, next| !next.begins);
        for pass in &program.passes {
            let points = passes.next().expect("its waypoints");
            assert!(points[0].begins && points[0].asked.has_sections);
            let laid_mm3: f64 = points
                .windows(2)
                .map(|pair| {
                    let length_mm = (pair[1].tip_mm - pair[0].tip_mm).norm();
                    let of = |point: &Waypoint| point.section_mm2.expect("a section");
                    0.5 * length_mm * (of(&pair[0]) + of(&pair[1]))
                })
                .sum();
            let meant_mm3 = pass.volume_mm3().expect("a volume");
            assert!(
                (laid_mm3 / meant_mm3 - 1.0).abs() < 1e-12,
                "{laid_mm3} {meant_mm3}"
            );
        }
        assert!(passes.next().is_none());
        // 1 mm and 1.1 mm of filament back and forth; nothing before the first and behind the last.
        let pushes: Vec<_> = run.points.iter().filter(|point| point.begins).collect();
        let area_mm2 = 0.25 * std::f64::consts::PI * 1.75 * 1.75;
        let of =
            |k: usize, side: usize| pushes[k].asked.pushes_mm3[side].expect("a push") / area_mm2;
        assert_eq!((of(0, 0), of(1, 1)), (0.0, 0.0));
        assert!((of(0, 1) - 1.0).abs() < 1e-12 && (of(1, 0) - 1.1).abs() < 1e-12);
        // The fastest feed of the file, 20 mm/s, is what the planner's share of the print speed is.
        let settings = Settings::default();
        let at = at_feeds(&mut run, None, &settings);
        assert!(
            (at.speed_mm_s * at.plan_share - 20.0).abs() < 1e-9,
            "{}",
            at.speed_mm_s
        );
        let slow = at_feeds(&mut run, Some(5.0), &settings);
        assert!(
            run.points
                .iter()
                .all(|point| point.speed_mm_s <= Some(slow.speed_mm_s))
        );
    }
}

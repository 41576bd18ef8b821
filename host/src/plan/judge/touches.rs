//! Touches of nozzle and head with the table and with what is printed already.
//!
//! In: the route (mm, rad, machine coordinates), the head's shape, the table's height. Out: the deepest
//! touch of each kind with its place, and how much of the way touches. Looked at in the part's frame:
//! where the table turns, the bed turns with the part. The table is a plane; what is printed is the way of
//! the tip with flow up to then. Poses are looked at every [`LOOK_MM`]. Touches not deeper than half a
//! layer are what the material gives. Leaves out the machine's frame and arms, and what else stands on the table.

use crate::job::MotionState;
use crate::plan::route::moves::{Route, tilt, tip};
use crate::settings::Settings;
use crate::settings::head_shape::HeadShape;
use headway_firmware::pose::tool_axis;
use headway_protocol::units::CHANNELS;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Way and turn between two looks, before there are too many.
const LOOK_MM: f64 = 0.5;
const LOOK_RAD: f64 = 0.05;
/// Most looks: more of them are further apart. Each is held against all before it.
const LOOKS_MAX: f64 = 20_000.0;

/// What touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeadPart {
    /// The nozzle's cone.
    Nozzle,
    /// The head above it.
    Head,
}

/// What is touched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstacle {
    /// The table.
    Table,
    /// What is printed already.
    Print,
    /// What it is printed on.
    Surface,
}

/// A touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// What touches.
    pub part: HeadPart,
    /// What is touched.
    pub obstacle: Obstacle,
    /// How deep, mm.
    pub depth_mm: f64,
    /// The tip, machine coordinates.
    pub tip_mm: [f64; 3],
}

/// All touches of a route.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Touches {
    /// The deepest of each kind.
    pub deepest: Vec<Touch>,
    /// Way of the tip on which something touches, mm.
    pub touched_mm: f64,
}

/// A pose that is looked at.
struct Look {
    tip: Vector3<f64>,
    axis: Vector3<f64>,
    lays: bool,
    /// Way since the look before, mm.
    step_mm: f64,
}

/// Looks along the route; nothing where the head's shape is not known.
pub fn touches(route: &Route, settings: &Settings) -> Option<Touches> {
    touches_on(route, settings, &[])
}

/// The same above a surface, of which these points are known, mm.
pub fn touches_on(route: &Route, settings: &Settings, surface: &[Vector3<f64>]) -> Option<Touches> {
    let head = settings.head.as_ref()?;
    let looks = looks(route);
    let slack_mm = 0.5 * settings.layer_height_mm;
    let table_mm = settings.work_area_mm[0][2];
    let found: Vec<[Option<Touch>; 3]> = looks
        .par_iter()
        .enumerate()
        .map(|(index, look)| {
            let laid = looks[..index].iter().filter(|before| before.lays);
            let laid = laid.map(|before| &before.tip);
            let touches = [
                touch_of_table(look, head, table_mm),
                touch_of_points(look, head, Obstacle::Print, laid),
                touch_of_points(look, head, Obstacle::Surface, surface.iter()),
            ];
            touches.map(|touch| touch.filter(|touch| touch.depth_mm > slack_mm))
        })
        .collect();
    let mut all = Touches::default();
    for (look, touches) in looks.iter().zip(&found) {
        if touches.iter().any(Option::is_some) {
            all.touched_mm += look.step_mm;
        }
        for touch in touches.iter().flatten() {
            let same =
                |known: &&mut Touch| (known.part, known.obstacle) == (touch.part, touch.obstacle);
            match all.deepest.iter_mut().find(same) {
                Some(known) if known.depth_mm >= touch.depth_mm => {}
                Some(known) => *known = *touch,
                None => all.deepest.push(*touch),
            }
        }
    }
    Some(all)
}

fn looks(route: &Route) -> Vec<Look> {
    let turn = |a: &[f64; CHANNELS], b: &[f64; CHANNELS]| (tilt(a) - tilt(b)).norm();
    let way = |a: &[f64; CHANNELS], b: &[f64; CHANNELS]| (tip(a) - tip(b)).norm();
    let wanted =
        |a: &[f64; CHANNELS], b: &[f64; CHANNELS]| way(a, b) / LOOK_MM + turn(a, b) / LOOK_RAD;
    let legs = route
        .moves
        .iter()
        .flat_map(|route_move| route_move.curve.control.windows(2));
    let all: f64 = legs.map(|leg| wanted(&leg[0], &leg[1])).sum();
    let share = (LOOKS_MAX / all.max(1.0)).min(1.0);
    let mut looks: Vec<Look> = Vec::new();
    let mut due = 0.0;
    for route_move in &route.moves {
        let curve = &route_move.curve;
        for (span, leg) in curve.control.windows(2).enumerate() {
            let count = share * wanted(&leg[0], &leg[1]);
            while due < count {
                let pose = curve.evaluate(span as f64 + due / count).value;
                let tip = tip(&pose);
                looks.push(Look {
                    step_mm: looks.last().map_or(0.0, |last| (tip - last.tip).norm()),
                    tip,
                    axis: tool_axis(tilt(&pose)),
                    lays: route_move.state == MotionState::Print,
                });
                due += 1.0;
            }
            due -= count;
        }
    }
    looks
}

/// How deep the lowest edge of nozzle and head is below the table.
fn touch_of_table(look: &Look, head: &HeadShape, table_mm: f64) -> Option<Touch> {
    let depths = head.rims().map(|rim| {
        let lowest_mm = look.tip.z - rim.below_tip_mm(&look.axis);
        let part = if rim.is_nozzle {
            HeadPart::Nozzle
        } else {
            HeadPart::Head
        };
        (table_mm - lowest_mm, part)
    });
    let deepest = depths.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
    deepest.map(|(depth_mm, part)| Touch {
        part,
        obstacle: Obstacle::Table,
        depth_mm,
        tip_mm: look.tip.into(),
    })
}

/// How deep points of what was laid before, or of the surface, are in nozzle or head.
fn touch_of_points<'a>(
    look: &Look,
    head: &HeadShape,
    obstacle: Obstacle,
    points: impl Iterator<Item = &'a Vector3<f64>>,
) -> Option<Touch> {
    let reach_square = head.reach_mm() * head.reach_mm();
    let slope = (0.5 * head.nozzle_angle_rad).cos();
    let mut deepest: Option<(f64, HeadPart)> = None;
    for point in points {
        let away = point - look.tip;
        let height_mm = away.dot(&look.axis);
        let square = away.norm_squared();
        if height_mm <= 0.0 || square > reach_square {
            continue;
        }
        let Some(radius_mm) = head.radius_mm(height_mm) else {
            continue;
        };
        let from_axis_mm = (square - height_mm * height_mm).max(0.0).sqrt();
        let nozzle = head.is_nozzle(height_mm);
        let side_mm = (radius_mm - from_axis_mm) * if nozzle { slope } else { 1.0 };
        let bottom_mm = if nozzle {
            height_mm
        } else {
            height_mm - head.nozzle_length_mm
        };
        let depth_mm = side_mm.min(bottom_mm);
        if deepest.is_none_or(|(most_mm, _)| depth_mm > most_mm) {
            deepest = Some((
                depth_mm,
                if nozzle {
                    HeadPart::Nozzle
                } else {
                    HeadPart::Head
                },
            ));
        }
    }
    deepest.map(|(depth_mm, part)| Touch {
        part,
        obstacle,
        depth_mm,
        tip_mm: look.tip.into(),
    })
}

#[cfg(test)]
mod tests {
    //! Goal: what touches is told with its depth, what does not is not. Method: places whose distances
    //! are worked out by hand.
    use super::*;
    use crate::plan::route::moves::{PathCurve, RouteMove};

    const HEAD: HeadShape = HeadShape {
        nozzle_tip_radius_mm: 1.0,
        nozzle_angle_rad: std::f64::consts::FRAC_PI_2,
        nozzle_length_mm: 10.0,
        head_radius_mm: 20.0,
        head_length_mm: 40.0,
    };

    fn pose(tip: [f64; 3], tilt_y: f64) -> [f64; CHANNELS] {
        let [x, y, z] = tip;
        [x, y, z, 0.0, tilt_y, 0.0, 0.0]
    }

    fn route(legs: &[(MotionState, [[f64; CHANNELS]; 2])]) -> Route {
        let route_move = |(state, ends): &(MotionState, [[f64; CHANNELS]; 2])| RouteMove {
            state: *state,
            layer: 0,
            pass: None,
            curve: PathCurve {
                control: ends.to_vec(),
            },
            dwell_s: 0.0,
            speed_mm_s: None,
            speeds_mm_s: Vec::new(),
            acceleration_mm_s2: None,
            event: None,
        };
        Route {
            moves: legs.iter().map(route_move).collect(),
        }
    }

    fn found(route: &Route) -> Touches {
        let settings = Settings {
            head: Some(HEAD),
            ..Settings::default()
        };
        touches(route, &settings).unwrap()
    }

    #[test]
    fn a_tilted_nozzle_near_the_table_is_told() {
        let quarter = std::f64::consts::FRAC_PI_4;
        let line = |height_mm: f64| {
            let ends = [0.0, 30.0].map(|x| pose([x, 0.0, height_mm], quarter));
            found(&route(&[(MotionState::Print, ends)]))
        };
        // The head's lower edge: (10 - 20) sin 45° below the tip; the nozzle's end 1 sin 45°.
        let low = line(5.0);
        let touch = low.deepest[0];
        assert_eq!(
            (touch.part, touch.obstacle),
            (HeadPart::Head, Obstacle::Table)
        );
        let depth_mm = 10.0 * quarter.sin() - 5.0;
        assert!((touch.depth_mm - depth_mm).abs() < 1e-9, "{touch:?}");
        assert!((low.touched_mm - 30.0).abs() < 2.0 * LOOK_MM, "{low:?}");
        assert_eq!(line(7.2).deepest, []);
    }

    #[test]
    fn a_wall_beside_the_nozzle_is_told() {
        let wall = [0.0, 20.0].map(|y| pose([0.0, y, 15.0], 0.0));
        let beside = |x: f64, z: f64| {
            let ends = [0.0, 20.0].map(|y| pose([x, y, z], 0.0));
            found(&route(&[
                (MotionState::Print, wall),
                (MotionState::Print, ends),
            ]))
        };
        // 5 mm below the wall's top the cone has a radius of 6 mm.
        let touch = beside(4.0, 10.0).deepest[0];
        assert_eq!(
            (touch.part, touch.obstacle),
            (HeadPart::Nozzle, Obstacle::Print)
        );
        let depth_mm = 2.0 * std::f64::consts::FRAC_PI_4.cos();
        assert!((touch.depth_mm - depth_mm).abs() < 0.02, "{touch:?}");
        assert_eq!(beside(7.0, 10.0).deepest, []);
        // 12 mm below it is the head that touches, 2 mm deep.
        let touch = beside(17.0, 3.0).deepest[0];
        assert_eq!(
            (touch.part, touch.obstacle),
            (HeadPart::Head, Obstacle::Print)
        );
        assert!((touch.depth_mm - 2.0).abs() < 1e-9, "{touch:?}");
    }
}

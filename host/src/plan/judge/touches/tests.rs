//! Goal: a collision is reported with its depth, and nothing else is. Method: positions whose
//! distances are computed by hand.
use super::*;
use crate::job::MotionState;
use crate::plan::route::moves::RouteMove;
use crate::settings::head_shape::{ConeAndCylinder, HeadOutline, HeadShape};
use headway_protocol::units::CHANNELS;

const HEAD: HeadShape = HeadShape {
    outline: HeadOutline::Cone(ConeAndCylinder {
        nozzle_tip_radius_mm: 1.0,
        nozzle_angle_rad: std::f64::consts::FRAC_PI_2,
        nozzle_length_mm: 10.0,
        head_radius_mm: 20.0,
        head_length_mm: 40.0,
    }),
    tip_slack_mm: None,
};

fn pose(tip: [f64; 3], tilt_y: f64) -> [f64; CHANNELS] {
    let [x, y, z] = tip;
    [x, y, z, 0.0, tilt_y, 0.0, 0.0]
}

fn route(legs: &[(MotionState, [[f64; CHANNELS]; 2])]) -> Route {
    let route_move = |(state, ends): &(MotionState, [[f64; CHANNELS]; 2])| {
        RouteMove::new(*state, 0, ends.to_vec())
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
    touches(route, None, &settings).unwrap()
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
    assert!((low.touched_mm - 30.0).abs() < 1.0, "{low:?}");
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
    // The bead's edge, 0.6 mm nearer, is what is met.
    let depth_mm = 2.6 * std::f64::consts::FRAC_PI_4.cos();
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

/// Goal: a leaning nozzle's flat end dips into the layer that it lays: a figure of its own, and a touch of the tip only
/// beyond its slack. Method: rows side by side, the tool leaning by 15° across them: 1 mm of flat dips 0.27 mm.
#[test]
fn the_flat_end_dips_as_it_leans() {
    let lean_rad = 15f64.to_radians();
    let row = |row: i32| {
        let y = 0.1 * f64::from(row);
        let ends = [0.0, 4.0].map(|x| pose([x, y, 20.0], lean_rad));
        // Leaning about x: the tool's axis is tilted towards -y.
        let ends = ends.map(|[x, y, z, ..]| [x, y, z, lean_rad, 0.0, 0.0, 0.0]);
        (MotionState::Print, ends)
    };
    let rows: Vec<_> = (0..20).map(row).collect();
    let found = |rows: &[_], tip_slack_mm: f64| {
        let settings = Settings {
            head: Some(HeadShape {
                tip_slack_mm: Some(tip_slack_mm),
                ..HEAD
            }),
            ..Settings::default()
        };
        touches(&route(rows), None, &settings).unwrap()
    };
    let downhill = found(&rows, 0.1);
    let uphill: Vec<_> = rows.iter().rev().copied().collect();
    let uphill = found(&uphill, 0.1);
    let dips = [&downhill, &uphill].map(|touches| touches.tip_dip_max_mm);
    let (least_mm, most_mm) = (dips[0].min(dips[1]), dips[0].max(dips[1]));
    // The greatest row offset within 1 mm across the axis: 1.0 sin 15°.
    assert!((most_mm - lean_rad.sin()).abs() < 1e-9, "{dips:?}");
    // Rounding alone: on the other side all rows lie in the plane of the flat or below it.
    assert!(least_mm < 1e-12, "{dips:?}");
    let worse = if dips[0] > dips[1] { downhill } else { uphill };
    assert_eq!(worse.deepest[0].part, HeadPart::Tip);
    assert_eq!(found(&rows, 1.0).deepest, []);
}

//! Goal: places of poses, and ways between them. Method: poses as places and back; a turn of a table beside its circle.
use super::*;
use crate::settings::axes_words::AxesWords;

fn axes(text: &str) -> FileAxes {
    FileAxes::new(&AxesWords::parse(text).expect("words"), None).expect("axes")
}

fn at(values: &[f64]) -> At {
    std::array::from_fn(|slot| values.get(slot).copied().unwrap_or(0.0))
}

#[test]
fn a_pose_is_its_place() {
    for (n, heading_rad) in [
        ([0.0, 0.0, 1.0], 0.3),
        ([0.0, 0.0, 1.0], 40.0),
        ([0.6, 0.0, 0.8], -2.0),
        ([-0.3, 0.5, -0.2], 1.0),
        ([1.0, 0.0, 0.0], 0.5),
        ([0.0, -1.0, 0.0], 0.0),
    ] {
        let axis = Unit::new_normalize(Vector3::from(n));
        let pose = FilePose {
            tip_mm: Vector3::zeros(),
            axis,
            heading_rad,
        };
        let near_deg = heading_rad.to_degrees();
        let (axis_back, heading_back) = pose.place(near_deg).axis_and_heading();
        // Rounding of an arcsine beside 1.
        assert!(
            (axis_back.into_inner() - axis.into_inner()).norm() < 1e-7,
            "{n:?}"
        );
        let turns = (heading_back - heading_rad) / std::f64::consts::TAU;
        assert!((turns - turns.round()).abs() < 1e-7, "{n:?} {heading_back}");
    }
}

#[test]
fn a_table_that_turns_draws_a_circle() {
    let axes = axes("C=table:z:at=10/0/0,coordinates=pivot");
    let (from, to) = (at(&[40.0, 0.0, 1.0, 0.0]), at(&[40.0, 0.0, 1.0, 360.0]));
    let legs = axes.legs(&from, &to);
    let mut before = axes.pose(&from).tip_mm;
    for leg in &legs {
        let tip = axes.pose(leg).tip_mm;
        let middle = 0.5 * (tip + before) - Vector3::new(10.0, 0.0, 1.0);
        assert!(
            (30.0 - middle.norm()).abs() < legs::LEG_TIP_MM,
            "{middle:?}"
        );
        before = tip;
    }
    // A circle's chord of 2 sqrt(2 s r) has the height s: 385 of them, the next power of two.
    assert_eq!(legs.len(), 512);
    // The table turns to the left: the tip goes to the right.
    let quarter = axes.pose(&at(&[40.0, 0.0, 1.0, 90.0])).tip_mm;
    assert!(
        (quarter - Vector3::new(10.0, -30.0, 1.0)).norm() < 1e-9,
        "{quarter:?}"
    );
}

#[test]
fn straight_moves_stay_one() {
    let axes = axes("A=table:x,C=table:z,coordinates=pivot");
    assert_eq!(axes.legs(&at(&[0.0]), &at(&[100.0, 3.0, 2.0])).len(), 1);
}

#[test]
fn letters_have_to_fit_the_joints() {
    let arm = ["j1", "j2", "j3", "j4", "j5", "j6", "h"];
    let machine = FileMachine {
        kinematics: &Kinematics::Planar,
        joints: &arm,
    };
    let words = AxesWords::parse("machine").expect("words");
    let refused = FileAxes::new(&words, Some(&machine)).expect_err("no letters");
    assert!(refused.to_string().contains("j1, j2"), "{refused}");
    let words = AxesWords::parse("machine,letters=A/B/C/U/V/W/H").expect("words");
    let axes = FileAxes::new(&words, Some(&machine)).expect("axes");
    assert_eq!(&axes.letters(), b"\0\0\0ABCUVWH");
}

#[test]
fn poses_that_no_head_has_are_finite() {
    let axes = axes("A=table:x,C=table:z,U=heading,coordinates=pivot");
    for a in [180.0, -180.0, 179.999_999, 540.0] {
        let pose = axes.pose(&at(&[1.0, 2.0, 3.0, a, 30.0, 5.0]));
        let place = pose.place(0.0);
        assert!(
            place
                .turn_deg
                .iter()
                .chain(&place.tip_mm)
                .all(|value| value.is_finite())
        );
        assert!(pose.axis.z < -0.99, "{a}: {pose:?}");
    }
}

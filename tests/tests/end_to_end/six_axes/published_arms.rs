//! Goal: the arms of `headway machine new --arm` are those of their makers, and reach the bed that they are given. Method:
//! flanges by the transforms of public robot descriptions (`tests/data/arm_flanges.csv`), which do not know our parameters; the
//! lower third of the bed's box in one joint solution.

use headway::plan::motion::box_reach::box_reach;
use headway::settings::arms::{ARM_MODELS, ArmModel, flange_pose};
use nalgebra::{Rotation3, Vector3};

#[test]
fn published_arms_stand_where_their_makers_say() {
    let table = include_str!("../../../data/arm_flanges.csv");
    let mut rows = 0;
    for line in table.lines().skip(2) {
        let (name, numbers) = line.split_once(',').unwrap();
        // Some descriptions give the flange's axis alone.
        let cells = numbers.split(',').filter(|cell| !cell.is_empty());
        let numbers: Vec<f64> = cells.map(|cell| cell.parse().unwrap()).collect();
        let settings = ArmModel::named(name).unwrap().settings().unwrap();
        let joints_deg = std::array::from_fn(|axis| numbers[axis]);
        let [tip_mm, turn_deg] = flange_pose(&settings.machine.kinematics, joints_deg).unwrap();
        let [yaw, pitch, roll] = turn_deg.map(f64::to_radians);
        let rotation = Rotation3::from_euler_angles(roll, pitch, yaw);
        let theirs = |from: usize| Vector3::from_row_slice(&numbers[from..from + 3]);
        let away_mm = (Vector3::from(tip_mm) - theirs(6)).norm();
        assert!(away_mm < 0.01, "{line}: {tip_mm:?}");
        let along = rotation * Vector3::z() - theirs(9);
        assert!(along.norm() < 1e-4, "{line}: {along:?}");
        if numbers.len() > 12 {
            let across = rotation * Vector3::x() - theirs(12);
            assert!(across.norm() < 1e-4, "{line}: {across:?}");
        }
        rows += 1;
    }
    assert!(rows >= 2 * ARM_MODELS.len(), "{rows}");
}

#[test]
fn published_arms_reach_their_bed() {
    for model in ARM_MODELS {
        let settings = model.settings().unwrap();
        settings.check().unwrap();
        let [low, mut high] = settings.work_area_mm;
        high[2] /= 3.0;
        let start = [low[0], low[1], 0.6, 0.0, 0.0, 0.0, 0.0];
        let reach = box_reach([low, high], &start, &settings);
        let reach = reach.unwrap_or_else(|error| panic!("{}: {error}", model.name));
        assert!(reach.turn_rad > 6.0, "{}: {}", model.name, reach.turn_rad);
    }
}

//! The approach to a point of a partly printed job: up, across above the print, down.
//!
//! In: the pose where a stream begins, the height of the print (mm, machine coordinates), the machine. Out: two
//! poses to which a board is sent in turn (`GoTo` moves joint by joint, Z first when it rises and last when it
//! lowers). The tip is never below the first pose while it crosses. Not covered: obstacles on the machine, and
//! machines with a tilting table or an arm's joints: they have no joint that lifts straight up.

use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::{Kinematics, MachineConfiguration};
use headway_protocol::units::{CHANNEL_Z, CHANNELS, ChannelPoint, UNITS_PER_NATURAL};

/// Least height above the print while the head crosses it, mm: for warping of the part and blobs.
pub const CLEARANCE_MM: f64 = 5.0;
/// Height that has to do under the upper end of Z, mm.
const CLEARANCE_LEAST_MM: f64 = 1.0;
/// The joint that lifts.
const JOINT_Z: usize = 2;
/// Tilt among the channels.
const CHANNEL_TILT: usize = CHANNEL_Z + 1;

/// The approach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    /// Above the start, clear of the print; base units, as commands have.
    pub above: ChannelPoint,
    /// Where the stream begins.
    pub start: ChannelPoint,
    /// Height of the tip above the start, mm.
    pub above_mm: f64,
}

/// No joint lifts straight up.
pub fn no_lift() -> Refusal {
    refusal!(
        "only machines that lift the head by one joint (planar, gantry) find the way back above \
         a print: this one's table tilts, or it is an arm"
    )
}

/// The approach to `start`, in base units, above the print.
///
/// # Errors
/// [`Refusal`].
pub fn approach(
    start: ChannelPoint,
    top_mm: f64,
    lift_mm: f64,
    machine: &MachineConfiguration,
) -> Result<Approach, Refusal> {
    let units = UNITS_PER_NATURAL[CHANNEL_Z];
    let natural: [f64; CHANNELS] =
        std::array::from_fn(|c| f64::from(start[c]) / UNITS_PER_NATURAL[c]);
    // Difference of Z between a tilted head and an upright one with the tip at the same height.
    let leaning_mm = match machine.kinematics {
        Kinematics::Planar => 0.0,
        Kinematics::Gantry { pivot_length_mm } => {
            let tilt_rad = natural[CHANNEL_TILT].hypot(natural[CHANNEL_TILT + 1]);
            pivot_length_mm * (1.0 - tilt_rad.cos())
        }
        Kinematics::Trunnion { .. } | Kinematics::Arm6 { .. } | Kinematics::Axes { .. } => {
            return Err(no_lift());
        }
    };
    let top_mm = top_mm.max(natural[CHANNEL_Z]);
    // The head may be upright while it comes up: then its tip is as high as Z alone.
    let wanted_mm = top_mm + lift_mm.max(CLEARANCE_MM) + leaning_mm;
    let end_of_z_mm = machine
        .joints
        .get(JOINT_Z)
        .map_or(f64::INFINITY, |joint| joint.position_max);
    let end_mm = end_of_z_mm + leaning_mm;
    let above_mm = wanted_mm.min(end_mm);
    if above_mm < top_mm + leaning_mm + CLEARANCE_LEAST_MM {
        return Err(refusal!(
            "the print is {top_mm:.2} mm high and Z ends at {end_mm:.2} mm: there is no room to \
             cross above it"
        ));
    }
    let mut above = start;
    above[CHANNEL_Z] = (above_mm * units).floor() as i32;
    Ok(Approach {
        above,
        start,
        above_mm: above_mm - natural[CHANNEL_Z],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;

    fn pose(z_mm: f64, tilt_rad: f64) -> ChannelPoint {
        headway_protocol::units::to_units(&[100.0, 90.0, z_mm, 0.0, tilt_rad, 1.0, 3.0])
    }

    /// Goal: the head crosses above the print, whatever leans. Method: heights by hand.
    #[test]
    fn the_head_crosses_above_the_print_or_not_at_all() {
        let planar = Settings::planar().machine;
        let way = approach(pose(2.0, 0.0), 4.0, 1.0, &planar).unwrap();
        assert_eq!(way.above[CHANNEL_Z], 90_000);
        assert_eq!(way.start, pose(2.0, 0.0));
        assert!((way.above_mm - 7.0).abs() < 1e-9);
        let way = approach(pose(2.0, 0.0), 1.0, 8.0, &planar).unwrap();
        assert_eq!(way.above[CHANNEL_Z], 100_000, "above the start at least");
        let end_mm = planar.joints[JOINT_Z].position_max;
        let way = approach(pose(2.0, 0.0), end_mm - 2.0, 1.0, &planar).unwrap();
        assert_eq!(f64::from(way.above[CHANNEL_Z]), end_mm * 1e4);
        let refused = approach(pose(2.0, 0.0), end_mm - 0.5, 1.0, &planar).unwrap_err();
        assert!(
            refused.to_string().contains("mm high and Z ends at"),
            "{refused}"
        );

        let gantry = Settings::gantry().machine;
        let Kinematics::Gantry { pivot_length_mm } = gantry.kinematics else {
            panic!("a gantry");
        };
        let way = approach(pose(2.0, 0.3), 4.0, 1.0, &gantry).unwrap();
        // Z of the joint for the leaning head: p + L n - (0, 0, L).
        let joint_mm =
            f64::from(way.above[CHANNEL_Z]) * 1e-4 - pivot_length_mm * (1.0 - 0.3f64.cos());
        assert!((joint_mm - 9.0).abs() < 2e-4, "{joint_mm}");
        let trunnion = MachineConfiguration {
            kinematics: Kinematics::Trunnion {
                centre_mm: [0.0; 3],
                solution: 0,
            },
            ..planar
        };
        assert_eq!(
            approach(pose(2.0, 0.0), 4.0, 1.0, &trunnion),
            Err(no_lift())
        );
    }
}

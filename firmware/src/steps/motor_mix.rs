//! Targets of the joints -> targets of the motors, for the step generator: pairs that share two motors, and copies.
//!
//! In: a [`MotorMatrix`], positions in 2^-31 steps and fine targets in 2^-22 steps, where sums and differences are exact.
//! Out: the same for each motor. `configuration/motors.rs` defines pairs and copies.

use crate::configuration::MOTORS_MAX;
use crate::configuration::motors::{COPIES_MAX, MotorMatrix};

/// The same for the step generator.
#[derive(Clone, Copy, Debug, Default)]
pub struct MotorMix {
    /// Places of the pair; two equal ones are not a pair.
    pair: [u8; 2],
    /// The index of each copy and of the motor that it repeats.
    copies: [[u8; 2]; COPIES_MAX],
    copy_count: u8,
}

impl MotorMix {
    /// Motors are the joints.
    pub const NONE: Self = Self {
        pair: [0; 2],
        copies: [[0; 2]; COPIES_MAX],
        copy_count: 0,
    };

    /// Of a machine with this many joints.
    pub fn new(matrix: &MotorMatrix, joints: usize) -> Self {
        let mut mix = Self::NONE;
        if let Some(pair) = &matrix.pair {
            mix.pair = pair.joints;
        }
        for (place, of) in mix.copies.iter_mut().zip(&matrix.copies) {
            *place = [joints as u8 + 1 + mix.copy_count, *of];
            mix.copy_count += 1;
        }
        mix
    }

    /// True where every motor is a joint of its own, or the extruder.
    #[inline]
    pub fn is_none(&self) -> bool {
        self.pair[0] == self.pair[1] && self.copy_count == 0
    }

    /// All motors of a machine with this many joints and an extruder.
    pub fn motors(&self, joints: usize) -> usize {
        joints + 1 + usize::from(self.copy_count)
    }

    fn places(&self) -> Option<[usize; 2]> {
        let [a, b] = self.pair.map(|joint| usize::from(joint) % MOTORS_MAX);
        (a != b).then_some([a, b])
    }

    fn copy(&self, values: &mut [impl Copy; MOTORS_MAX]) {
        for [place, of] in self.copies.iter().take(self.copy_count.into()) {
            values[usize::from(*place) % MOTORS_MAX] = values[usize::from(*of) % MOTORS_MAX];
        }
    }

    /// Joint positions -> motor positions, 2^-31 steps, wrapping.
    #[inline(never)]
    pub fn motors_of(&self, mut joints: [i64; MOTORS_MAX]) -> [i64; MOTORS_MAX] {
        if let Some([a, b]) = self.places() {
            let (first, second) = (joints[a], joints[b]);
            joints[a] = first.wrapping_add(second);
            joints[b] = first.wrapping_sub(second);
        }
        self.copy(&mut joints);
        joints
    }

    /// Motor positions -> joint positions, 2^-31 steps; half of the last place is cut off. Copies are no joints: 0.
    #[inline(never)]
    pub fn joints_of(&self, mut motors: [i64; MOTORS_MAX]) -> [i64; MOTORS_MAX] {
        if let Some([a, b]) = self.places() {
            let (sum, difference) = (motors[a], motors[b]);
            motors[a] = sum.wrapping_add(difference) >> 1;
            motors[b] = sum.wrapping_sub(difference) >> 1;
        }
        for [place, _] in self.copies.iter().take(self.copy_count.into()) {
            motors[usize::from(*place) % MOTORS_MAX] = 0;
        }
        motors
    }

    /// True if both joints of the pair are in the mask of known ones.
    pub fn pair_is_known(&self, known: u8) -> bool {
        let is_known = |joint: usize| known >> joint & 1 == 1;
        self.places()
            .is_some_and(|pair| pair.into_iter().all(is_known))
    }

    /// True if a motor is one of the pair.
    pub fn is_of_pair(&self, motor: usize) -> bool {
        self.places().is_some_and(|pair| pair.contains(&motor))
    }

    /// Fine targets of joints -> those of motors; each target has `bias` in it.
    #[inline(always)]
    pub(crate) fn mix(&self, row: &mut [i32; MOTORS_MAX], bias: i32) {
        if let Some([a, b]) = self.places() {
            let (first, second) = (row[a], row[b]);
            row[a] = first.wrapping_add(second).wrapping_sub(bias);
            row[b] = first.wrapping_sub(second).wrapping_add(bias);
        }
        self.copy(row);
    }

    /// The larger displacement of the pair's motors between two rows of joints, 2^-22 steps.
    #[inline(always)]
    pub(crate) fn way(&self, from: &[i32; MOTORS_MAX], to: &[i32; MOTORS_MAX]) -> u32 {
        let Some([a, b]) = self.places() else {
            return 0;
        };
        let way = |joint: usize| to[joint].wrapping_sub(from[joint]).unsigned_abs();
        way(a).saturating_add(way(b))
    }
}

#[cfg(test)]
mod tests {
    //! Goal: joints and motors go over into each other, exactly where they are integers, and what does not
    //! fit is refused. Method: known numbers and random ones there and back.
    use super::*;
    use crate::configuration::motors::MotorPair;
    use heapless::Vec;

    fn core_xy() -> MotorMatrix {
        MotorMatrix {
            pair: Some(MotorPair {
                joints: [0, 1],
                speed_max: 300.0,
                acceleration_max: 4000.0,
                jerk_max: 1e6,
            }),
            copies: Vec::from_slice(&[2]).unwrap(),
        }
    }

    #[test]
    fn motors_are_sum_and_difference_and_come_back() {
        let mix = MotorMix::new(&core_xy(), 4);
        assert!(!mix.is_none() && MotorMix::NONE.is_none());
        assert_eq!(mix.motors(4), 6);
        let joints = [30, 12, 5, 7, 9, 0, 0, 0];
        let motors = mix.motors_of(joints);
        assert_eq!(motors, [42, 18, 5, 7, 9, 5, 0, 0]);
        assert_eq!(mix.joints_of(motors)[..5], joints[..5]);
        assert_eq!(
            core_xy().motor_steps(&[3.0, 1.0, 5.0, 0.0, 0.0, 0.0, 0.0])[..3],
            [4.0, 2.0, 5.0]
        );
        assert_eq!(
            core_xy().joint_steps(&[4.0, 2.0, 5.0, 0.0, 0.0, 0.0, 0.0])[..3],
            [3.0, 1.0, 5.0]
        );
        assert!(mix.pair_is_known(0b11) && !mix.pair_is_known(0b101));
        assert!(mix.is_of_pair(1) && !mix.is_of_pair(2));
        let mut random = 12345u64;
        for _ in 0..10_000 {
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            let [x, y] = [random >> 8, random << 11].map(|bits| bits as i64 >> 4);
            let motors = mix.motors_of([x, y, 0, 0, 0, 0, 0, 0]);
            assert_eq!(mix.joints_of(motors)[..2], [x, y]);
        }
    }

    #[test]
    fn fine_targets_are_those_of_the_motors_positions() {
        use crate::steps::{FINE_BIAS, Target};
        let mix = MotorMix::new(&core_xy(), 4);
        for i in 0..1000i64 {
            let joints = [
                i * 77_777_777_512,
                -i * 31_415_926_528,
                i << 31,
                0,
                0,
                0,
                0,
                0,
            ]
            .map(|position: i64| position >> 9 << 9);
            let mut row = joints.map(|position| Target::of_position(position).fine());
            mix.mix(&mut row, FINE_BIAS);
            let motors = mix.motors_of(joints);
            assert_eq!(
                row,
                motors.map(|position| Target::of_position(position).fine())
            );
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let machine = crate::board::built_in::emulated_planar();
        let joints = &machine.joints;
        assert!(MotorMatrix::DIRECT.is_right(joints) && core_xy().is_right(joints));
        for pair in [[0, 0], [0, 3], [0, 2], [0, 9]] {
            let mut matrix = core_xy();
            matrix.pair.as_mut().unwrap().joints = pair;
            assert!(!matrix.is_right(joints), "{pair:?}");
        }
        let mut matrix = core_xy();
        matrix.pair.as_mut().unwrap().speed_max = f64::NAN;
        assert!(!matrix.is_right(joints));
        matrix = core_xy();
        matrix.copies.push(4).unwrap();
        assert!(!matrix.is_right(joints), "the extruder");
    }
}

//! Cells that are not printed -> the largest connected places of each cause.

use super::voxels::Voxels;
use headway_reach::Vector3;
use headway_reach::space::LeftOut;
use serde::Serialize;
use std::collections::BTreeMap;

/// Places that are named.
const PLACES: usize = 5;

/// A connected place that is not printed for one cause.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOutPlace {
    /// The cause in a word: aperture, bed, joints, obstacle, support or head.
    pub why: &'static str,
    /// Its volume.
    pub volume_mm3: f64,
    /// The middle of its box, the part's coordinates.
    pub middle_mm: [f64; 3],
    /// The size of its box.
    pub size_mm: [f64; 3],
}

pub(super) fn places(voxels: &Voxels, left_out: &[Option<LeftOut>]) -> Vec<LeftOutPlace> {
    let cells = voxels.part.cells().iter().zip(left_out);
    let mut left: BTreeMap<[u16; 3], LeftOut> = cells
        .filter_map(|(cell, why)| Some((*cell, (*why)?)))
        .collect();
    let mut found = Vec::new();
    while let Some((first, why)) = left.pop_first() {
        let mut place = vec![first];
        let mut next = 0;
        while let Some(&cell) = place.get(next) {
            next += 1;
            for (axis, by) in [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)] {
                let mut beside = cell;
                beside[axis] = beside[axis].wrapping_add_signed(by);
                if left.get(&beside) == Some(&why) {
                    left.remove(&beside);
                    place.push(beside);
                }
            }
        }
        found.push((why, place));
    }
    found.sort_by_key(|(_, place)| std::cmp::Reverse(place.len()));
    found.truncate(PLACES);
    found
        .into_iter()
        .map(|(why, place)| described(voxels, why, &place))
        .collect()
}

fn described(voxels: &Voxels, why: LeftOut, place: &[[u16; 3]]) -> LeftOutPlace {
    let voxel_mm = voxels.part.voxel_mm();
    let middles = place.iter().map(|&cell| voxels.middle_mm(cell));
    let none = Vector3::repeat(f64::INFINITY);
    let [low, high] = middles.fold([none, -none], |[low, high], p| [low.inf(&p), high.sup(&p)]);
    LeftOutPlace {
        why: match why {
            LeftOut::Aperture => "aperture",
            LeftOut::Bed => "bed",
            LeftOut::Joints => "joints",
            LeftOut::Obstacle => "obstacle",
            LeftOut::Support => "support",
            LeftOut::Head => "head",
        },
        volume_mm3: place.len() as f64 * voxel_mm.powi(3),
        middle_mm: (0.5 * (low + high)).into(),
        size_mm: (high - low).add_scalar(voxel_mm).into(),
    }
}

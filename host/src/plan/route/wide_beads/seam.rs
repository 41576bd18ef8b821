//! A loop that begins and ends -> one that goes on over its seam.
//!
//! In: the control points of a loop (mm, rad, mm³), the length within which its ends show. Out: the same points with the
//! flow, the heading and the path of the bead beside. Not covered: which loop follows (`continuous`).

use super::continuous::turn_to;
use crate::geometry::hermite::hermite;
use crate::plan::route::moves::{tip, ways_mm};
use crate::settings::Settings;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y, CHANNELS};

type Point = [f64; CHANNELS];

/// The path is led past a loop's ends by no more than this, of the nozzle's semi-minor axis.
const SEAM_SHARE: f64 = 0.1;

/// A loop with the flow beside its ends, within a reach of them, in place of the flow of a begin and an end: that lays all
/// of the aperture at once, and leaves out what is covered. Its heading goes on from its end to its begin. `begins` where
/// its begin is one.
pub(super) fn evened(
    control: &[Point],
    begins: bool,
    reach_mm: f64,
    settings: &Settings,
) -> Vec<Point> {
    let ways_mm = ways_mm(control);
    let length_mm = ways_mm[ways_mm.len() - 1];
    // A seam takes two points beside each end.
    if length_mm < 5.0 * reach_mm || control.len() < 6 {
        return control.to_vec();
    }
    let section_mm2 = |from_mm: f64, to_mm: f64| {
        let [from, to] = [from_mm, to_mm].map(|mm| ways_mm.partition_point(|way| *way < mm));
        let to = to.min(control.len() - 1);
        let laid_mm3 = control[to][CHANNEL_VOLUME] - control[from.min(to)][CHANNEL_VOLUME];
        laid_mm3 / (ways_mm[to] - ways_mm[from.min(to)]).max(f64::MIN_POSITIVE)
    };
    let after_mm2 = section_mm2(reach_mm, 2.0 * reach_mm);
    let before_mm2 = section_mm2(length_mm - 2.0 * reach_mm, length_mm - reach_mm);
    let mut even = control.to_vec();
    go_on_over_the_seam(&mut even, &ways_mm, begins, reach_mm, settings);
    for k in 1..control.len() {
        let step_mm = ways_mm[k] - ways_mm[k - 1];
        let middle_mm = 0.5 * (ways_mm[k] + ways_mm[k - 1]);
        // From the reach before the end to the reach after the begin: 0 to 1.
        let to_end_mm = length_mm - middle_mm;
        let laid_mm3 = if to_end_mm < reach_mm || (middle_mm < reach_mm && !begins) {
            let beyond_mm = if to_end_mm < reach_mm {
                -to_end_mm
            } else {
                middle_mm
            };
            let share = 0.5 * (1.0 + beyond_mm / reach_mm);
            (before_mm2 + share * (after_mm2 - before_mm2)) * step_mm
        } else {
            control[k][CHANNEL_VOLUME] - control[k - 1][CHANNEL_VOLUME]
        };
        even[k][CHANNEL_VOLUME] = even[k - 1][CHANNEL_VOLUME] + laid_mm3;
    }
    even
}

/// The seam of a loop: from a point before its end to one after its begin.
#[derive(Clone, Copy)]
struct Seam<'a> {
    ways_mm: &'a [f64],
    gap_mm: f64,
    before: usize,
    after: usize,
    /// The loop begins there: its begin is left as it is.
    begins: bool,
}

impl Seam<'_> {
    /// A channel that goes evenly on over the seam: the values there, the loop's begin coming `turn` after its end.
    fn bridged(&self, control: &[Point], channel: usize, turn: f64) -> Vec<(usize, f64)> {
        let (ways_mm, last) = (self.ways_mm, control.len() - 1);
        let slope = |k: usize| {
            let [from, to] = [k - 1, k + 1].map(|k| control[k][channel]);
            (to - from) / (ways_mm[k + 1] - ways_mm[k - 1]).max(f64::MIN_POSITIVE)
        };
        let to_end_mm = ways_mm[last] - ways_mm[self.before];
        let over_mm = to_end_mm + self.gap_mm + ways_mm[self.after];
        let ends = [
            control[self.before][channel],
            control[self.after][channel] + turn,
        ];
        let slopes = [self.before, self.after].map(|k| slope(k) * over_mm);
        let of_end = (self.before..=last).map(|k| (k, ways_mm[k] - ways_mm[self.before], 0.0));
        let begin = if self.begins { 0 } else { self.after };
        let of_begin = (0..begin).map(|k| (k, to_end_mm + self.gap_mm + ways_mm[k], turn));
        let all = of_end.chain(of_begin);
        all.map(|(k, way_mm, turn)| (k, hermite(way_mm / over_mm, ends, slopes) - turn))
            .collect()
    }
}

/// Leads a loop evenly on over its seam, within a reach: its heading, and its path unless that would leave a corner.
fn go_on_over_the_seam(
    control: &mut [Point],
    ways_mm: &[f64],
    begins: bool,
    reach_mm: f64,
    settings: &Settings,
) {
    let last = control.len() - 1;
    let turn_rad = turn_to(&control[0], &control[last], settings);
    let within = |reach_mm: f64| {
        [ways_mm[last] - reach_mm, reach_mm]
            .map(|mm| ways_mm.partition_point(|way| *way < mm).clamp(2, last - 2))
    };
    let [before, after] = within(2.0 * reach_mm);
    let seam = Seam {
        ways_mm,
        gap_mm: (tip(&control[0]) - tip(&control[last])).norm(),
        before,
        after,
        begins,
    };
    for (k, heading_rad) in seam.bridged(control, CHANNEL_HEADING, turn_rad) {
        control[k][CHANNEL_HEADING] = heading_rad;
    }
    // On a tight curve over the ends' own points alone.
    for [before, after] in [within(reach_mm), [last - 2, 2]] {
        let seam = Seam {
            before,
            after,
            ..seam
        };
        let [x_mm, y_mm] =
            [CHANNEL_X, CHANNEL_Y].map(|channel| seam.bridged(control, channel, 0.0));
        let bridged = || {
            x_mm.iter()
                .zip(&y_mm)
                .map(|((k, x_mm), (_, y_mm))| (*k, [*x_mm, *y_mm]))
        };
        let off_mm = bridged().map(|(k, [x_mm, y_mm])| {
            (x_mm - control[k][CHANNEL_X]).hypot(y_mm - control[k][CHANNEL_Y])
        });
        if off_mm.fold(0.0, f64::max) <= SEAM_SHARE * settings.aperture.minor_mm() {
            for (k, at_mm) in bridged() {
                control[k][CHANNEL_X..=CHANNEL_Y].copy_from_slice(&at_mm);
            }
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: a loop of few control points stays as it is. Method: the first one to five corners of a square of 20 mm.
    #[test]
    fn loops_of_few_points_are_no_seam() {
        let corners = [
            [0.0, 0.0],
            [20.0, 0.0],
            [20.0, 20.0],
            [0.0, 20.0],
            [0.0, 0.4],
        ];
        for count in 1..=corners.len() {
            let point = |[x, y]: [f64; 2]| [x, y, 0.2, 0.0, 0.0, 0.0, x + y];
            let control: Vec<Point> = corners[..count].iter().copied().map(point).collect();
            let even = evened(&control, false, 1.2, &Settings::default());
            assert_eq!(even, control);
        }
    }
}

//! What of the extruder's flow arrives, and how much melt its pressure holds, by flow.
//!
//! In: points of `[extruder] flow_loss` and `advance` of a machine file. Out: what the motor has to be asked for so
//! that a flow arrives, and the volume of the advance. Between points, and from the origin to the first, the flow
//! that arrives is a straight line, which the last one goes on: planner, board and exported G-code invert it exactly.
//! K of the advance is straight between points and constant outside them, so that its volume has no corners, which
//! would be jumps of the motor's speed. Units: mm³, s.

use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most points of a curve.
pub const CURVE_POINTS_MAX: usize = 8;
/// Most pieces: from the origin, between points, beyond the last.
pub const PIECES_MAX: usize = CURVE_POINTS_MAX + 1;
/// Least increase of what arrives by what is asked: below it more flow hardly helps.
const ARRIVING_SLOPE_MIN: f64 = 0.05;
/// Most of a flow that can be lost, and that can arrive beyond what was asked for.
const SHARE_RANGE: [f32; 2] = [-0.5, 0.9];
/// K, s.
const ADVANCE_RANGE_S: [f32; 2] = [0.0, 5.0];

/// Points of a curve: flow, mm³/s, and its value there.
pub type CurvePoints = Vec<[f32; 2], CURVE_POINTS_MAX>;

/// The extruder where one factor does not do.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FlowCurves {
    /// By the flow asked of the motor: the share of it that does not arrive.
    pub loss: CurvePoints,
    /// By flow: K in e = V + K dV/dt, s, in place of the constant one.
    pub advance: CurvePoints,
}

/// From here on, y = value + (slope + bend d) d at a distance d.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Its start.
    pub from: f64,
    /// The value there.
    pub value: f64,
    /// And the slope.
    pub slope: f64,
    /// Half the second derivative.
    pub bend: f64,
}

/// A curve from the origin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// One after the other; none: y = x.
    pub pieces: Vec<Piece, PIECES_MAX>,
}

impl Curve {
    /// Straight from the origin through the points.
    fn through(points: impl Iterator<Item = [f64; 2]>) -> Self {
        let (mut curve, mut start) = (Self::default(), [0.0; 2]);
        for end in points {
            let [from, value] = core::mem::replace(&mut start, end);
            // As many as there are points; collecting could panic.
            let _ = curve.pieces.push(Piece {
                from,
                value,
                slope: (end[1] - value) / (end[0] - from),
                bend: 0.0,
            });
        }
        curve
    }

    /// Value and slope at `x`; below 0 the first piece goes on.
    pub fn at(&self, x: f64) -> [f64; 2] {
        let mut value = [x, 1.0];
        for (k, piece) in self.pieces.iter().enumerate() {
            if k == 0 || piece.from <= x {
                let beyond = x - piece.from;
                let along = (piece.slope + piece.bend * beyond) * beyond;
                value = [piece.value + along, piece.slope + 2.0 * piece.bend * beyond];
            }
        }
        value
    }

    /// The largest slope at the start of a piece; 1 without any.
    pub fn steepest(&self) -> f64 {
        let slopes = self.pieces.iter().map(|piece| piece.slope);
        slopes.reduce(f64::max).unwrap_or(1.0)
    }
}

impl FlowCurves {
    /// What is asked for arrives, and the advance is in proportion to the flow.
    pub const NONE: Self = Self {
        loss: Vec::new(),
        advance: Vec::new(),
    };

    /// Neither is curved.
    pub fn is_none(&self) -> bool {
        self.loss.is_empty() && self.advance.is_empty()
    }

    /// Asked and arriving flow at the points.
    fn flows(&self) -> impl Iterator<Item = [f64; 2]> {
        self.loss.iter().map(|[asked, share]| {
            let asked = f64::from(*asked);
            [asked, asked * (1.0 - f64::from(*share))]
        })
    }

    /// The flow that arrives by that asked of the motor, mm³/s.
    pub fn arriving(&self) -> Curve {
        Curve::through(self.flows())
    }

    /// The flow to ask the motor for by that which is to arrive, mm³/s.
    pub fn asked(&self) -> Curve {
        Curve::through(self.flows().map(|[asked, arriving]| [arriving, asked]))
    }

    /// The volume of the advance by flow, mm³ and mm³/s: only where [`Self::advance`] has points.
    pub fn advance_volume(&self) -> Curve {
        let mut curve = Curve::default();
        let (mut from, mut value) = (0.0, 0.0);
        let mut slope = self.advance.first().map_or(0.0, |[_, k]| f64::from(*k));
        let points = self.advance.iter().map(|point| point.map(f64::from));
        for [end, next] in points {
            let bend = 0.5 * (next - slope) / (end - from);
            // As many as there is room for.
            let _ = curve.pieces.push(Piece {
                from,
                value,
                slope,
                bend,
            });
            value += 0.5 * (slope + next) * (end - from);
            (from, slope) = (end, next);
        }
        let bend = 0.0;
        let _ = curve.pieces.push(Piece {
            from,
            value,
            slope,
            bend,
        });
        curve
    }

    /// The largest K and the largest |dK/dq|, s and s²/mm³: the first bounds the advance as a constant would; `None`
    /// where it is not curved.
    pub fn advance_bounds(&self) -> Option<[f64; 2]> {
        let curve = (!self.advance.is_empty()).then(|| self.advance_volume())?;
        let bends = curve.pieces.iter().map(|piece| 2.0 * piece.bend.abs());
        Some([curve.steepest(), bends.fold(0.0, f64::max)])
    }

    /// The first point, from 0, that cannot be, of the loss and of the advance.
    pub fn wrong(&self) -> [Option<usize>; 2] {
        let within = |points: &CurvePoints, [low, high]: [f32; 2]| {
            let mut before = 0.0;
            points.iter().position(|[flow, value]| {
                let right = *flow > before && flow.is_finite() && *value >= low && *value <= high;
                before = *flow;
                !right
            })
        };
        // Written so that a NaN is refused.
        let falls = |piece: &Piece| !(piece.slope >= ARRIVING_SLOPE_MIN && piece.slope.is_finite());
        let loss = within(&self.loss, SHARE_RANGE);
        [
            loss.or_else(|| self.arriving().pieces.iter().position(falls)),
            within(&self.advance, ADVANCE_RANGE_S),
        ]
    }
}

#[cfg(test)]
mod tests {
    //! Goal: the curves are what their points say, and those that cannot be inverted are refused. Method: lines by
    //! hand, the advance's volume as a sum of its K.
    use super::*;

    fn points(given: &[[f32; 2]]) -> CurvePoints {
        given.iter().copied().collect()
    }

    #[test]
    fn asked_and_arriving_flows_are_inverse() {
        let curves = FlowCurves {
            loss: points(&[[5.0, 0.04], [10.0, 0.1], [20.0, 0.25]]),
            ..FlowCurves::NONE
        };
        assert_eq!(curves.wrong(), [None, None]);
        // 4.8 of 5, 9 of 10, 15 of 20; the line 9 to 15 goes on.
        for (asked, arrives) in [
            (2.5, 2.4),
            (5.0, 4.8),
            (7.5, 6.9),
            (15.0, 12.0),
            (30.0, 21.0),
        ] {
            assert!(
                (curves.arriving().at(asked)[0] - arrives).abs() < 1e-6,
                "{asked}"
            );
            assert!(
                (curves.asked().at(arrives)[0] - asked).abs() < 1e-6,
                "{asked}"
            );
        }
        assert!((curves.asked().steepest() - 10.0 / 6.0).abs() < 1e-6);
        assert_eq!(FlowCurves::NONE.asked().at(7.0), [7.0, 1.0]);
    }

    #[test]
    fn the_advance_is_the_sum_of_its_k() {
        let curves = FlowCurves {
            advance: points(&[[4.0, 0.05], [8.0, 0.03], [9.0, 0.04]]),
            ..FlowCurves::NONE
        };
        assert_eq!(curves.wrong(), [None, None]);
        let k = |flow: f64| match flow {
            flow if flow < 4.0 => 0.05,
            flow if flow < 8.0 => 0.05 - 0.005 * (flow - 4.0),
            flow if flow < 9.0 => 0.03 + 0.01 * (flow - 8.0),
            _ => 0.04,
        };
        let mut sum = 0.0;
        for step in 0..12_000 {
            let flow = f64::from(step) * 1e-3;
            let [volume, slope] = curves.advance_volume().at(flow);
            assert!(
                (volume - sum).abs() < 1e-5 && (slope - k(flow)).abs() < 1e-6,
                "{flow}"
            );
            sum += k(flow + 0.5e-3) * 1e-3;
        }
        let [most_s, change] = curves.advance_bounds().expect("curved");
        assert!((most_s - 0.05).abs() < 1e-6 && (change - 0.01).abs() < 1e-6);
    }

    #[test]
    fn points_that_cannot_be_are_named() {
        let wrong = |loss: &[[f32; 2]], advance: &[[f32; 2]]| {
            let (loss, advance) = (points(loss), points(advance));
            FlowCurves { loss, advance }.wrong()
        };
        assert_eq!(wrong(&[[5.0, 0.1], [5.0, 0.2]], &[]), [Some(1), None]);
        assert_eq!(wrong(&[[0.0, 0.1]], &[]), [Some(0), None]);
        assert_eq!(wrong(&[[5.0, 0.95]], &[]), [Some(0), None]);
        assert_eq!(wrong(&[[5.0, f32::NAN]], &[]), [Some(0), None]);
        // 9 of 10 and 9.2 of 20.
        assert_eq!(wrong(&[[10.0, 0.1], [20.0, 0.54]], &[]), [Some(1), None]);
        assert_eq!(wrong(&[], &[[4.0, 0.05], [4.0, 0.02]]), [None, Some(1)]);
        assert_eq!(wrong(&[], &[[4.0, -0.01]]), [None, Some(0)]);
    }
}

//! `[[flow_loss]]`: what of the extruder's flow does not arrive, by the hot end's temperature.
//!
//! In: curves at rising temperatures, the material's. Out: the points of the curve there, which a job keeps as
//! `extruder.flow_loss`. Between two temperatures the flow that arrives is a straight line. Units: °C, mm³/s.

use crate::settings::check::check_flow_curves;
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::flow_curves::{CURVE_POINTS_MAX, CurvePoints, FlowCurves};
use serde::Deserialize;

/// Most curves.
const CURVES_MAX: usize = 100;

#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileFlowLoss {
    hot_end_c: f64,
    points: Vec<[f32; 2]>,
}

impl FileFlowLoss {
    fn curves(&self) -> Result<FlowCurves, Refusal> {
        let at = self.hot_end_c;
        let wrong = |why: &str| refusal!("flow_loss at {at} °C: {why}");
        let loss = CurvePoints::from_slice(&self.points);
        let loss = loss.ok().filter(|points| !points.is_empty());
        let loss = loss.ok_or_else(|| wrong(&format!("give 1 to {CURVE_POINTS_MAX} points")))?;
        let advance = CurvePoints::new();
        let curves = FlowCurves { loss, advance };
        check_flow_curves(&curves).map_err(|error| wrong(&error.to_string()))?;
        Ok(curves)
    }
}

/// The points at the material's temperature.
///
/// # Errors
/// Curves that are wrong or do not rise in temperature, no temperature, or one beyond those of the curves.
pub(super) fn at_temperature(
    given: &[FileFlowLoss],
    hot_end_c: Option<f64>,
) -> Result<CurvePoints, Refusal> {
    if given.len() > CURVES_MAX {
        return Err(refusal!(
            "flow_loss: {CURVES_MAX} curves at most, {} are given",
            given.len()
        ));
    }
    let curves = given.iter().map(FileFlowLoss::curves);
    let curves: Vec<FlowCurves> = curves.collect::<Result<_, _>>()?;
    let rise = given
        .windows(2)
        .all(|two| two[0].hot_end_c < two[1].hot_end_c);
    let (Some(first), Some(last), true) = (given.first(), given.last(), rise) else {
        return Err(refusal!(
            "flow_loss: temperatures hot_end_c must rise from curve to curve"
        ));
    };
    let here_c = hot_end_c.ok_or_else(|| {
        refusal!("flow_loss: curves by temperature need that of the material: write hot_end_c under [material]")
    })?;
    if !(first.hot_end_c..=last.hot_end_c).contains(&here_c) {
        return Err(refusal!(
            "material.hot_end_c: {here_c} is not between the temperatures of [[flow_loss]], {} to {}: measure a curve there \
             (headway calibrate flow)",
            first.hot_end_c,
            last.hot_end_c
        ));
    }
    let above = given.partition_point(|curve| curve.hot_end_c < here_c);
    let below = above.saturating_sub(1);
    let [low_c, high_c] = [below, above].map(|at| given[at].hot_end_c);
    let share = if above == below {
        0.0
    } else {
        (here_c - low_c) / (high_c - low_c)
    };
    Ok(mixed(&curves[below], &curves[above], share))
}

/// Arriving flow at that share of the way from one curve to the other; of too many points those that bend it most, as a share
/// of the flow.
fn mixed(low: &FlowCurves, high: &FlowCurves, share: f64) -> CurvePoints {
    if share == 0.0 || share == 1.0 {
        return if share == 0.0 { low } else { high }.loss.clone();
    }
    let arriving = [low, high].map(FlowCurves::arriving);
    let mut asked: Vec<f32> = low
        .loss
        .iter()
        .chain(&high.loss)
        .map(|[flow, _]| *flow)
        .collect();
    asked.sort_by(f32::total_cmp);
    asked.dedup();
    let mut flows = vec![[0.0; 2]];
    flows.extend(asked.into_iter().map(f64::from).map(|flow| {
        let [low, high] = [0, 1].map(|of| arriving[of].at(flow)[0]);
        [flow, low + share * (high - low)]
    }));
    while flows.len() > CURVE_POINTS_MAX + 1 {
        let bend = |at: &usize| {
            let [[a, at_a], [b, at_b], [c, at_c]] = [flows[at - 1], flows[*at], flows[at + 1]];
            ((at_a + (at_c - at_a) * (b - a) / (c - a)) / at_b - 1.0).abs()
        };
        let least = (1..flows.len() - 1).min_by(|a, b| bend(a).total_cmp(&bend(b)));
        flows.remove(least.unwrap_or(1));
    }
    let points = flows.into_iter().skip(1);
    points
        .map(|[flow, arrives]| [flow as f32, (1.0 - arrives / flow) as f32])
        .collect()
}

#[cfg(test)]
mod tests {
    //! Goal: the curve at a temperature lies between its neighbours, at each flow where a straight line says. Method: the flow
    //! that arrives, computed point by point from two tables of eight points; files that cannot be, through the machine file.
    use super::*;
    use crate::settings::machine_file::{from_toml, to_toml};

    const LOW: [[f32; 2]; 8] = [
        [1.0, 0.01],
        [2.0, 0.02],
        [3.0, 0.04],
        [4.0, 0.06],
        [5.0, 0.09],
        [6.0, 0.13],
        [7.0, 0.18],
        [8.0, 0.25],
    ];
    const HIGH: [[f32; 2]; 8] = [
        [1.5, 0.01],
        [3.0, 0.02],
        [4.5, 0.03],
        [6.0, 0.05],
        [7.5, 0.08],
        [9.0, 0.11],
        [10.5, 0.15],
        [12.0, 0.2],
    ];

    fn given(points: &[[f32; 2]], hot_end_c: f64) -> FileFlowLoss {
        let points = points.to_vec();
        FileFlowLoss { hot_end_c, points }
    }

    /// What arrives, by hand.
    fn arrives(points: &[[f32; 2]], flow: f64) -> f64 {
        let mut flows = vec![[0.0, 0.0]];
        flows.extend(points.iter().map(|[asked, lost]| {
            let asked = f64::from(*asked);
            [asked, asked * (1.0 - f64::from(*lost))]
        }));
        let at = (1..flows.len() - 1)
            .find(|&at| flow <= flows[at][0])
            .unwrap_or(flows.len() - 1);
        let [[a, at_a], [b, at_b]] = [flows[at - 1], flows[at]];
        at_a + (at_b - at_a) * (flow - a) / (b - a)
    }

    #[test]
    fn a_curve_lies_between_those_of_its_temperatures() {
        let tables = [given(&LOW, 200.0), given(&HIGH, 220.0), given(&HIGH, 230.0)];
        let at = |hot_end_c| at_temperature(&tables, Some(hot_end_c)).expect("a curve");
        assert_eq!(at(200.0).as_slice(), LOW);
        assert_eq!(at(220.0).as_slice(), HIGH);
        let between = at(205.0);
        assert_eq!(between.len(), CURVE_POINTS_MAX);
        for tenth in 1..140 {
            let flow = f64::from(tenth) * 0.1;
            let wanted = 0.75 * arrives(&LOW, flow) + 0.25 * arrives(&HIGH, flow);
            // Six of fourteen points are left out, which is 0.6 % at 3 mm³/s; a bead's area has to be right to 1 %.
            let off = arrives(&between, flow) / wanted - 1.0;
            assert!(off.abs() < 0.01, "{flow}: {off}");
        }
    }

    #[test]
    fn a_file_has_one_curve_at_its_temperature() {
        let two = "\n[[flow_loss]]\nhot_end_c = 200\npoints = [[4, 0.1]]\n[[flow_loss]]\nhot_end_c = 220\npoints = [[4, 0.05]]\n";
        let of = |c: &str, more: &str| to_toml(&Default::default()) + c + more;
        let file = of("\n[material]\nhot_end_c = 205\n", two);
        let settings = from_toml(&file).expect("settings");
        let [[flow, share]] = settings.machine.curves.loss[..] else {
            panic!("{:?}", settings.machine.curves)
        };
        assert!(flow == 4.0 && (share - 0.0875).abs() < 1e-6, "{share}");
        let again = from_toml(&to_toml(&settings)).expect("read again");
        assert_eq!(again.machine.curves, settings.machine.curves);
        let turned = two.replace("220", "190");
        let both = file.replace("[extruder]", "[extruder]\nflow_loss = [[3, 0.1]]");
        for (file, said) in [
            (of("\n[material]\nhot_end_c = 240\n", two), "200 to 220"),
            (of("", two), "write hot_end_c under [material]"),
            (of("\n[material]\nhot_end_c = 195\n", &turned), "must rise"),
            (
                file.replace("0.05", "0.95"),
                "flow_loss at 220 °C: extruder.flow_loss: point 1",
            ),
            (
                file.replace("[[4, 0.05]]", "[]"),
                "flow_loss at 220 °C: give 1 to 8 points",
            ),
            (both, "leave one of them out"),
        ] {
            let refused = from_toml(&file).expect_err(said).to_string();
            assert!(refused.contains(said), "{said}: {refused}");
        }
    }
}

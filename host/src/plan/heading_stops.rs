//! Passes that turn further than the nozzle may between its stops: cut where it has to turn back.
//!
//! The aperture's symmetry helps: headings a period apart lay the same bead, so a pass may be entered
//! at any of them. Input: passes with unwrapped headings. Output: the pass, or pieces of it that each
//! fit between the stops from some heading and meet at a placement. The piece begun at a place is the
//! longest that fits, so there are as few as can be.

use super::layer_path::PlaneControl;
use super::passes::LayerPass;
use crate::settings::Settings;
use headway_firmware::kinematics;
use headway_protocol::units::CHANNEL_HEADING;

/// Room left before each stop, rad, tried in this order: the curve is sharpened and pushed off the
/// walls, and its headings leave those of the placements by a few degrees at the most.
const ROOM_RAD: [f64; 3] = [0.03, 0.1, 0.25];

/// Stops of the joint that follows the heading one to one, rad; the tool stands upright.
pub fn heading_range(settings: &Settings) -> [f64; 2] {
    let machine = &settings.machine;
    let carriers = kinematics::carriers(&machine.kinematics).iter();
    let mut turning = carriers
        .zip(&machine.joints)
        .filter(|(carrier, _)| **carrier == Some(CHANNEL_HEADING));
    turning
        .next()
        .map_or([f64::NEG_INFINITY, f64::INFINITY], |(_, joint)| {
            [joint.position_min, joint.position_max]
        })
}

/// The curves of a pass, made by `curves_of` of all of it or of as few pieces as will turn no further
/// than the nozzle may. Where some heading fits nowhere between the stops the pass stays whole: the
/// check of the joints' ranges then names the place.
pub fn curves_between_stops(
    pass: &LayerPass,
    settings: &Settings,
    curves_of: impl Fn(&LayerPass) -> Vec<Vec<PlaneControl>>,
) -> Vec<Vec<PlaneControl>> {
    let stops = Stops::of(settings);
    let mut curves = Vec::new();
    for room_rad in ROOM_RAD {
        let pieces = stops.pieces(pass, room_rad);
        curves = pieces.iter().flat_map(&curves_of).collect();
        let turns = curves.iter().map(|curve: &Vec<PlaneControl>| {
            let first_rad = curve[0][2];
            curve.iter().fold([first_rad; 2], |[least, most], control| {
                [least.min(control[2]), most.max(control[2])]
            })
        });
        if turns
            .into_iter()
            .all(|turns| stops.fit(turns, settings.tolerances.heading_rad))
        {
            break;
        }
    }
    curves
}

struct Stops {
    range_rad: [f64; 2],
    period_rad: f64,
}

impl Stops {
    fn of(settings: &Settings) -> Stops {
        Stops {
            range_rad: heading_range(settings),
            period_rad: settings.aperture.period_rad(),
        }
    }

    /// True where headings from the least to the most fit between the stops, some periods away.
    fn fit(&self, [least_rad, most_rad]: [f64; 2], room_rad: f64) -> bool {
        let [low_rad, high_rad] = self.range_rad;
        let first = ((low_rad + room_rad - least_rad) / self.period_rad).ceil();
        let last = ((high_rad - room_rad - most_rad) / self.period_rad).floor();
        first <= last
    }

    /// The pass, or pieces of it that fit.
    fn pieces(&self, pass: &LayerPass, room_rad: f64) -> Vec<LayerPass> {
        let fits = |turns: [f64; 2]| self.fit(turns, room_rad);
        let headings: Vec<f64> = pass.placements.iter().map(|p| p.at.heading_rad).collect();
        let mut cuts = Vec::new();
        let mut turned: Option<[f64; 2]> = None;
        for (index, &heading_rad) in headings.iter().enumerate() {
            let [least, most] = turned.unwrap_or([heading_rad; 2]);
            let wider = [least.min(heading_rad), most.max(heading_rad)];
            if fits(wider) {
                turned = Some(wider);
                continue;
            }
            let before = index.saturating_sub(1);
            let two = [headings[before], heading_rad];
            let alone = [two[0].min(two[1]), two[0].max(two[1])];
            if !fits(alone) {
                return vec![pass.clone()];
            }
            cuts.push(before);
            turned = Some(alone);
        }
        let Some(last) = headings.len().checked_sub(1) else {
            return vec![pass.clone()];
        };
        let ends = cuts.iter().copied().chain([last]);
        let starts = [0].into_iter().chain(cuts.iter().copied());
        starts
            .zip(ends)
            .map(|(start, end)| LayerPass {
                placements: pass.placements[start..=end].to_vec(),
                ..*pass
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;
    use crate::plan::test_passes::{arc, pass};
    use std::f64::consts::TAU;

    fn stops(low_deg: f64, high_deg: f64) -> Settings {
        let mut settings = Settings::default();
        settings.machine.joints[3].position_min = low_deg.to_radians();
        settings.machine.joints[3].position_max = high_deg.to_radians();
        settings
    }

    /// Goal: a pass is cut as seldom as the stops allow, and its pieces meet. Method: a spiral of five
    /// turns under stops that let it turn by so much at most; the least number of pieces by hand.
    #[test]
    fn pieces_turn_no_further_than_the_stops_allow() {
        let spiral = arc(Point2::origin(), 5.0, 0.3, 5.0 * TAU);
        let pieces = |settings: &Settings| Stops::of(settings).pieces(&spiral, 0.1);
        assert_eq!(pieces(&Settings::default()), std::slice::from_ref(&spiral));
        // A piece fits for sure where it turns by 180° less than there is room, at most by all of it.
        for stop_deg in [200.0, 360.0, 540.0, 990.0] {
            let settings = stops(-stop_deg, stop_deg);
            let pieces = pieces(&settings);
            let most_deg = 2.0 * (stop_deg - 0.1f64.to_degrees());
            let least = (1800.0 / most_deg).ceil() as usize;
            let surely = (1800.0 / (most_deg - 180.0 - 2.0)).ceil() as usize;
            assert!((least..=surely).contains(&pieces.len()), "{}", pieces.len());
            let mut placements = pieces[0].placements.clone();
            for pair in pieces.windows(2) {
                assert_eq!(pair[0].placements.last(), pair[1].placements.first());
                placements.extend(&pair[1].placements[1..]);
            }
            assert_eq!(placements, spiral.placements);
            for piece in &pieces {
                let headings = piece.placements.iter().map(|p| p.at.heading_rad);
                let first_rad = piece.placements[0].at.heading_rad;
                let [least, most] = headings.fold([first_rad; 2], |[least, most], heading| {
                    [least.min(heading), most.max(heading)]
                });
                assert!((most - least).to_degrees() < most_deg);
            }
        }
    }

    /// Goal: what fits nowhere is left as it is. Method: stops 90° apart, headings across them.
    #[test]
    fn a_heading_beyond_all_stops_leaves_the_pass_whole() {
        let places = (0..20).map(|i| (Point2::new(f64::from(i), 0.0), 0.2 * f64::from(i)));
        let turning = pass(places, false);
        let stops = Stops::of(&stops(-45.0, 45.0));
        assert_eq!(stops.pieces(&turning, 0.1), [turning]);
    }
}

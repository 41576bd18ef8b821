//! Cuts passes that turn further than the nozzle may between its stops, where it has to turn back.
//!
//! The aperture's symmetry helps: headings a period apart print the same bead, so a pass may be
//! entered at any of them. Input: passes with unwrapped headings. Output: the pass, or parts of it
//! that each fit between the stops from some heading: as few as possible, cut where that covers the
//! least area twice, each beginning a little after the end of the previous one
//! ([`crate::plan::coverage::deposited_area`]).

use crate::geometry::edge_index::EdgeIndex;
use crate::geometry::frame::Frame;
use crate::geometry::plane_curve::PlaneControl;
use crate::plan::coverage::deposited_area::DepositedArea;
use crate::plan::headings::stops::{Stops, cheapest_cuts};
use crate::plan::pass::LayerPass;
use crate::settings::Settings;
use std::cell::OnceCell;

/// Turn left before each stop, rad, tried in this order: the curve is sharpened and pushed
/// off the walls, and its headings leave those of the placements by a few degrees at the most.
const ROOM_RAD: [f64; 3] = [0.03, 0.1, 0.25];

/// Cuts the passes of a region where they turn further than the nozzle may.
pub struct PassCutter<'a> {
    passes: &'a [LayerPass],
    walls: &'a EdgeIndex,
    settings: &'a Settings,
    stops: Stops,
    /// Made for the first pass that is cut.
    ground: OnceCell<Option<DepositedArea>>,
}

impl<'a> PassCutter<'a> {
    /// Of all the passes within some walls, both in a frame.
    pub fn new(
        passes: &'a [LayerPass],
        walls: &'a EdgeIndex,
        frame: &Frame,
        settings: &'a Settings,
    ) -> PassCutter<'a> {
        PassCutter {
            passes,
            walls,
            settings,
            stops: Stops::seen_from(frame, settings),
            ground: OnceCell::new(),
        }
    }

    /// All passes, divided where they turn further than the nozzle may; `None` if none does. With the largest margin,
    /// since an optimiser turns them a little further.
    pub fn cut(&self) -> Option<Vec<LayerPass>> {
        let headings_fit = |pass: &LayerPass| {
            let headings = pass.placements.iter().map(|p| p.at.heading_rad);
            self.headings_fit(headings)
        };
        if self.passes.iter().all(headings_fit) {
            return None;
        }
        let [.., room_rad] = ROOM_RAD;
        let pieces = self.passes.iter().map(|pass| match headings_fit(pass) {
            true => vec![pass.clone()],
            false => self.pieces(pass, room_rad),
        });
        Some(pieces.flatten().collect())
    }

    /// The curves of a pass, made by `curves_of` from all of it or from as few parts as will turn
    /// no further than the nozzle may. If a heading fits nowhere between the stops the pass is not
    /// divided: the check of the joints' ranges then names the place.
    pub fn curves(
        &self,
        pass: &LayerPass,
        curves_of: impl Fn(&LayerPass) -> Vec<Vec<PlaneControl>>,
    ) -> Vec<Vec<PlaneControl>> {
        let mut curves = Vec::new();
        for room_rad in ROOM_RAD {
            let pieces = self.pieces(pass, room_rad);
            curves = pieces.iter().flat_map(&curves_of).collect();
            if curves.iter().all(|curve| self.fits(curve)) {
                break;
            }
        }
        curves
    }

    /// True where the headings of a curve fit between the stops.
    pub fn fits(&self, curve: &[PlaneControl]) -> bool {
        self.headings_fit(curve.iter().map(|control| control[2]))
    }

    fn headings_fit(&self, headings: impl Iterator<Item = f64>) -> bool {
        let slack_rad = self.settings.tolerances.heading_rad;
        self.stops.headings_fit(headings, slack_rad)
    }

    /// The pass, or pieces of it that fit: of the fewest those that cover the least area twice.
    fn pieces(&self, pass: &LayerPass, room_rad: f64) -> Vec<LayerPass> {
        let headings: Vec<f64> = pass.placements.iter().map(|p| p.at.heading_rad).collect();
        let Some(fits_from) = self.stops.fits_from(&headings, room_rad) else {
            return vec![pass.clone()];
        };
        if fits_from.last().is_none_or(|&from| from == 0) {
            return vec![pass.clone()];
        }
        let ground = self.ground.get_or_init(|| {
            DepositedArea::of_passes(self.passes, self.walls, &self.settings.aperture)
        });
        let costs = ground.as_ref().map(|g| g.cuts_of(&pass.placements));
        let cut_at = |cut: usize, begin_max: usize| {
            let costs = costs.as_ref();
            costs.map_or((0, cut), |costs| costs.cut(cut, begin_max))
        };
        let last = headings.len() - 1;
        let cuts = cheapest_cuts(&fits_from, |cut| cut_at(cut, last).0);
        let ends = cuts.iter().copied().chain([last]);
        let begins = cuts.iter().zip(ends.clone().skip(1));
        // A part is at least between two cuts.
        let begins = begins.map(|(&cut, end)| cut_at(cut, end - 1).1);
        let pieces = [0].into_iter().chain(begins).zip(ends);
        let pieces = pieces.map(|(begin, end)| LayerPass {
            placements: pass.placements[begin..=end].to_vec(),
            ..pass.clone()
        });
        pieces.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::test_shapes::walls;
    use crate::geometry::{Point2, Vector2};
    use crate::plan::pass::test_passes::pass;

    fn stops(low_deg: f64, high_deg: f64) -> Settings {
        let mut settings = Settings::default();
        settings.machine.joints[3].position_min = low_deg.to_radians();
        settings.machine.joints[3].position_max = high_deg.to_radians();
        settings
    }

    fn pieces(settings: &Settings, pass: &LayerPass) -> Vec<LayerPass> {
        let walls = walls(&[&[[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]]]);
        let passes = std::slice::from_ref(pass);
        PassCutter::new(passes, &walls, &Frame::IDENTITY, settings).pieces(pass, 0.1)
    }

    /// Goal: a pass is cut as seldom as the stops allow, and no piece begins far from where the one
    /// before it ends. Method: a spiral of five turns under stops that let it turn by so much at
    /// most; the least number of pieces by hand.
    #[test]
    fn pieces_turn_no_further_than_the_stops_allow() {
        let center = Point2::origin();
        let out = |i: u32| 3.0 + 0.004 * f64::from(i);
        let angle = |i: u32| 0.3 + 0.025 * f64::from(i);
        let places = (0..1256).map(|i| {
            let (sin, cos) = angle(i).sin_cos();
            (center + out(i) * Vector2::new(cos, sin), angle(i))
        });
        let spiral = pass(places, false);
        let whole = pieces(&Settings::default(), &spiral);
        assert_eq!(whole, std::slice::from_ref(&spiral));
        // A piece fits for sure where it turns by 180° less than there is room, at most by all of
        // it.
        for stop_deg in [200.0, 360.0, 540.0, 990.0] {
            let pieces = pieces(&stops(-stop_deg, stop_deg), &spiral);
            let most_deg = 2.0 * (stop_deg - 0.1f64.to_degrees());
            let least = (1800.0 / most_deg).ceil() as usize;
            let surely = (1800.0 / (most_deg - 180.0 - 2.0)).ceil() as usize;
            assert!((least..=surely).contains(&pieces.len()), "{}", pieces.len());
            assert_eq!(pieces[0].placements[0], spiral.placements[0]);
            let ends = [pieces.last(), Some(&spiral)].map(|p| p.and_then(|p| p.placements.last()));
            assert_eq!(ends[0], ends[1]);
            for pair in pieces.windows(2) {
                let end = pair[0].placements.last().expect("an end").at;
                let begin = pair[1].placements[0].at;
                assert!(begin.heading_rad >= end.heading_rad);
                // 0.3 mm on costs least, and placements are up to 0.2 mm apart.
                assert!((begin.center - end.center).norm() < 0.5);
            }
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
        assert_eq!(pieces(&stops(-45.0, 45.0), &turning), [turning]);
    }
}

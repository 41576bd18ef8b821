//! Joins the blocks of a part: the travel from the end of one to the start of the next.
//!
//! A block begins and ends at rest on its own passes, with no material laid before it and its heading near 0: its plan does
//! not depend on the blocks below, so that blocks may be planned in any order, on several machines. The chain adds what
//! depends on them: a travel, and the numbers by which the block's stream is shifted: material laid before, and, where no
//! stops bound the heading, whole periods of the aperture.
//!
//! In: blocks in order, each with its layers' ground. Out: streams that follow on one another. Not covered: where blocks
//! begin and end, which their outlines decide.

use super::{Plan, PlanError, start_pose};
use crate::job::SegmentStream;
use crate::pipeline::layer_uses::LayerUse;
use crate::pipeline::piece::Piece;
use crate::pipeline::stack::Stack;
use crate::plan::judge::measure::measure;
use crate::plan::motion::segments::lay_segments_with_progress;
use crate::plan::progress::Progress;
use crate::plan::route::build_route::build_link;
use crate::plan::route::travel::TravelWays;
use crate::settings::Settings;
use headway_protocol::units::CHANNELS;

/// Where the blocks so far end.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Chain {
    /// Not wrapped at 32 bits: a heading that wound is that of the nozzle still.
    end: Option<[i64; CHANNELS]>,
}

impl Chain {
    /// The travel to a block that begins on its first pass, and the block's stream from there on.
    ///
    /// # Errors
    /// If there is no path around the keep-outs, or the travel cannot be timed.
    pub(crate) fn link(
        &mut self,
        piece: &mut Piece,
        stack: &Stack,
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<Option<Piece>, PlanError> {
        if piece.stream.knots.is_empty() {
            return Ok(None);
        }
        let (mut end, link) = match stack.start {
            Some(_) => (piece.stream.start.map(i64::from), None),
            None => {
                let begin = || piece.stream.units.of_natural(&start_pose(settings));
                let end = self.end.unwrap_or_else(|| begin().map(i64::from));
                (
                    end,
                    Some(travel(end, &piece.stream, stack, settings, progress)?),
                )
            }
        };
        if let Some(link) = &link {
            let begun = std::mem::take(&mut piece.stream);
            piece.stream = begun.shifted_to(link.stream.end());
        }
        let streams = link.iter().map(|link| &link.stream).chain([&piece.stream]);
        for by in streams.map(SegmentStream::displacement) {
            end = std::array::from_fn(|channel| end[channel] + by[channel]);
        }
        self.end = Some(end);
        Ok(link)
    }
}

/// The travel from `end` to the start of a block's stream.
fn travel(
    end: [i64; CHANNELS],
    next: &SegmentStream,
    stack: &Stack,
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Piece, PlanError> {
    let layer = next.marks.first().map_or(0, |mark| mark.layer);
    let ground = stack.on_machine(stack.outline_of(layer));
    let keep_out = stack.on_machine(stack.keep_out);
    let mut ways = TravelWays::new(&keep_out, &ground, settings)?;
    let units = &next.units;
    let from = std::array::from_fn(|channel| end[channel] as f64 / units.per_natural(channel));
    let to = next.units.to_natural(&next.start);
    let route = build_link(from, to, layer, &mut ways, settings);
    let route = route.map_err(|error| error.shifted(-stack.shift()))?;
    let (stream, motion) = lay_segments_with_progress(&route, settings, progress)?;
    let (figures, _) = measure(&stream, &[], &[], &stack.transform, settings, progress);
    let plan = Plan {
        route,
        stream,
        motion,
        figures,
        ..Plan::default()
    };
    let uses = LayerUse::of_travel(&plan);
    let mut piece = Piece::of(plan, settings);
    piece.uses.extend(uses);
    Ok(piece)
}

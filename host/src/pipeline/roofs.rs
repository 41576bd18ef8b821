//! Bridges of a part that span more than they may, and what was done about them.
//!
//! In: the outlines of all layers (mm, input coordinates), settings. Out: settings with an infill that is dense enough
//! for its roofs, [`Roofs`], notes for the user. Leaves out the bridges themselves, which [`crate::plan::layers::hollow`]
//! finds.

use crate::geometry::polygon::Region;
use crate::plan::layers::hollow::{WideSpan, denser};
use crate::settings::{Infill, Settings};
use crate::text::short_number::Short;

/// Spans that are reported one by one.
const SPANS_TOLD: usize = 3;

/// What spans much.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Roofs {
    /// Bridges that span more than they may.
    pub wide: Vec<WideSpan>,
    /// Densities of the sparse infill as it was given and as it is, per cent, and the roof that needs it.
    pub denser: Option<([f64; 2], WideSpan)>,
}

impl Roofs {
    /// The settings with a sparse infill that no roof has to span too far over, and what that changed.
    pub fn settled(outlines: &[&[Region]], settings: &Settings) -> (Settings, Roofs) {
        let mut settled = settings.clone();
        let mut roofs = Roofs::default();
        if let (Some((density_pct, roof)), Some(infill)) =
            (denser(outlines, settings), &mut settled.infill)
        {
            roofs.denser = Some(([infill.density_pct, density_pct], roof));
            *infill = Infill {
                density_pct,
                spacing_mm: None,
                ..*infill
            };
        }
        (settled, roofs)
    }

    /// Notes for the user.
    pub fn notes(&self, settings: &Settings) -> Vec<String> {
        let most = mm(settings.longest_bridge_mm());
        let mut notes = Vec::new();
        if let Some(([given_pct, pct], roof)) = self.denser {
            let [given, own] = [given_pct, pct].map(|pct| Short((pct * 100.0).round() / 100.0));
            notes.push(format!(
                "the sparse infill covers {own} % in place of {given} %, so that the {} spans no more than the \
                 {most} mm that --bridge-max allows",
                roof_text(&roof)
            ));
        }
        let mut wide: Vec<&WideSpan> = self.wide.iter().collect();
        wide.sort_by(|p, q| q.span_mm.total_cmp(&p.span_mm));
        if !wide.is_empty() {
            let told = wide.iter().take(SPANS_TOLD).map(|span| {
                let over = match span.is_roof {
                    true => "the empty inside",
                    false => "nothing",
                };
                let (span_mm, at) = (mm(span.span_mm), span.at);
                format!(
                    "{} spans {span_mm} mm over {over} near ({:.2}, {:.2})",
                    roof_text(span),
                    at.x,
                    at.y
                )
            });
            let told = told.collect::<Vec<_>>().join(", ");
            let more = match wide.len().saturating_sub(SPANS_TOLD) {
                0 => String::new(),
                more => format!(", and {more} more"),
            };
            notes.push(format!(
                "bridges are longer than the {most} mm that --bridge-max allows: {told}{more}; a sparse infill would carry \
                 roofs"
            ));
        }
        notes
    }
}

fn roof_text(span: &WideSpan) -> String {
    let what = if span.is_roof { "roof" } else { "bridge" };
    format!("{what} of layer {}", span.layer + 1)
}

fn mm(mm: f64) -> Short {
    Short((mm * 100.0).round() / 100.0)
}

//! Output about a job for people and programs: figures, pictures, tables.
//!
//! ```text
//! plain structs (PlanPicture, Track, Figures) --> SVG, JSON, CSV, HTML
//! ```
//! Input: the stages' results, handed over as plain structs in the input's coordinates (mm).
//! Output: text. Not covered: files: [`write_report`] returns names and contents, the command
//! writes them.

mod canvas;
pub mod compare_picture;
mod corner_figures;
mod curved_layer_figures;
mod figure_rows;
pub mod figures;
pub mod job_texts;
mod layer_figures;
pub mod layer_path;
pub mod machine_links;
pub mod page;
pub mod page_layer;
mod piece_figures;
pub mod plan_marks;
pub mod plan_picture;
pub mod pose_table;
pub mod reach_picture;
pub mod scan_picture;
pub mod track;
pub mod verdict;
mod verdict_figures;

use crate::geometry::coverage::Coverage;
use crate::geometry::frame::Frame;
use figures::Figures;
use machine_links::MachineLinks;
use page_layer::{LayerMotion, PageFacts, PageLayer};
use plan_picture::PlanPicture;
use serde::Serialize;

/// Everything that a report shows.
#[derive(Clone, Debug)]
pub struct Report<'a> {
    /// Name of the part.
    pub title: &'a str,
    /// The figures.
    pub figures: &'a Figures,
    /// Layers that are drawn; the picture of the first has the plain file name.
    pub layers: Vec<DrawnLayer<'a>>,
    /// Layers of which only the motion is known; only the page shows them.
    pub more_layers: Vec<PageLayer<'a>>,
    /// Warnings and notes for the page.
    pub notes: &'a [String],
    /// The machine around the path, where its tool can tilt.
    pub machine: Option<MachineLinks>,
    /// The page's data about the complete job.
    pub facts: PageFacts,
    /// Rate of the servo ticks.
    pub servo_hz: f64,
    /// Highest flow that is planned.
    pub flow_limit_mm3_s: f64,
    /// Names of the limits that tracks speak of by number.
    pub limits: &'a [String],
    /// The slowest places, the slowest first.
    pub slow_places: &'a [Place],
    /// Places that are not printed, the largest first.
    pub left_out: &'a [Place],
}

/// Something at a place of the part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Place {
    /// Its description, in words.
    pub what: String,
    /// Where, input coordinates.
    pub x_mm: f64,
    /// Where, input coordinates.
    pub y_mm: f64,
    /// The lowest layer that has it, from 0; `None` if it is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layer: Option<u32>,
}

/// A layer with a picture.
#[derive(Clone, Debug)]
pub struct DrawnLayer<'a> {
    /// Layer from 0.
    pub layer: u32,
    /// The number of the layer and those identical to it; empty if there is only one.
    pub label: &'a str,
    /// Outline, axis, passes, nozzle outlines.
    pub plan: PlanPicture<'a>,
    /// What was swept of each region, in a frame within the input's coordinates; empty if it was not measured.
    pub swept: Vec<(Frame, Coverage)>,
    /// Its motion, for the page.
    pub motion: LayerMotion,
}

/// A file of the report.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportFile {
    /// Name inside the report's folder.
    pub name: String,
    /// Contents.
    pub text: String,
}

/// The report's files: `report.json`, the pictures of layers, `index.html`.
pub fn write_report(report: &Report) -> Vec<ReportFile> {
    let pictures = report.layers.iter().enumerate().map(|(number, layer)| {
        let name = match number {
            0 => "plan.svg".to_string(),
            _ => format!("plan-layer-{}.svg", layer.layer + 1),
        };
        let text = plan_picture::draw(&layer.plan);
        ReportFile { name, text }
    });
    let first = ReportFile {
        name: "report.json".to_string(),
        text: report.figures.to_json() + "\n",
    };
    let mut files: Vec<ReportFile> = std::iter::once(first).chain(pictures).collect();
    let text = page::html(report, &files[1..]);
    let name = "index.html".to_string();
    files.push(ReportFile { name, text });
    files
}

#[cfg(test)]
mod tests;

//! Output about a job for people and programs: figures, pictures, tables.
//!
//! ```text
//! plain structs (PlanPicture, CoveragePicture, TimePlots, Track, Figures) --> SVG, JSON, CSV, HTML
//! ```
//! Input: the stages' results, handed over as plain structs in the input's coordinates (mm).
//! Output: text. Not covered: files: [`write_report`] returns names and contents, the command
//! writes them.

mod canvas;
pub mod compare_picture;
mod corner_figures;
pub mod coverage_picture;
mod curved_layer_figures;
mod figure_rows;
pub mod figures;
pub mod job_texts;
mod layer_figures;
pub mod layer_path;
pub mod machine_links;
pub mod page;
pub mod page_layer;
pub mod plan_marks;
pub mod plan_picture;
pub mod plots;
pub mod pose_table;
pub mod space_picture;
pub mod stream_plots;
pub mod track;
pub mod verdict;
mod verdict_figures;

use coverage_picture::CoveragePicture;
use figures::Figures;
use machine_links::MachineLinks;
use page_layer::{LayerMotion, PageFacts, PageLayer};
use plan_picture::PlanPicture;
use plots::TimePlots;
use serde::Serialize;
use space_picture::SpacePicture;

/// Everything that a report shows.
#[derive(Clone, Debug)]
pub struct Report<'a> {
    /// Name of the part.
    pub title: &'a str,
    /// The figures.
    pub figures: &'a Figures,
    /// Sheets of layers; the first has the plain file names.
    pub layers: Vec<LayerSheets<'a>>,
    /// Layers of which only the motion is known; only the page shows them.
    pub more_layers: Vec<PageLayer<'a>>,
    /// The path in space, where the tool tilts.
    pub space: Option<SpacePicture>,
    /// Curves over time.
    pub motion: Option<TimePlots>,
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

/// Pictures of one layer.
#[derive(Clone, Debug)]
pub struct LayerSheets<'a> {
    /// Layer from 0.
    pub layer: u32,
    /// The number of the layer and those identical to it; empty if there is only one.
    pub label: &'a str,
    /// Outline, axis, passes, nozzle outlines.
    pub plan: PlanPicture<'a>,
    /// Gaps and overlaps.
    pub coverage: Option<CoveragePicture<'a>>,
    /// Its motion, for the page.
    pub motion: Option<LayerMotion>,
}

/// A file of the report.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportFile {
    /// Name inside the report's folder.
    pub name: String,
    /// Contents.
    pub text: String,
}

/// The report's files: `report.json`, the pictures that there is something for, `index.html`.
pub fn write_report(report: &Report) -> Vec<ReportFile> {
    let mut files = Vec::new();
    let mut pictures: Vec<(String, String)> = Vec::new();
    let mut add = |name: String, caption: String, text: String| {
        pictures.push((name.clone(), caption));
        files.push(ReportFile { name, text });
    };
    for (number, sheets) in report.layers.iter().enumerate() {
        let ending = match number {
            0 => ".svg".to_string(),
            _ => format!("-layer-{}.svg", sheets.layer + 1),
        };
        let caption = |what: &str| match sheets.label {
            "" => what.to_string(),
            label => format!("{what}: {label}"),
        };
        let text = plan_picture::draw(&sheets.plan);
        let what = "Outline, medial axis, passes and nozzle outlines";
        add(format!("plan{ending}"), caption(what), text);
        if let Some(coverage) = &sheets.coverage {
            let text = coverage_picture::draw(coverage);
            let what = "Deposited area: gaps and overlaps";
            add(format!("coverage{ending}"), caption(what), text);
        }
    }
    if let Some(space) = &report.space {
        let what = "The path in space with its tool axes";
        let text = space_picture::draw(space);
        add("space.svg".to_string(), what.to_string(), text);
    }
    if let Some(motion) = &report.motion {
        let what = "Speed, joints, heading and flow over time";
        add(
            "motion.svg".to_string(),
            what.to_string(),
            plots::draw(motion),
        );
    }
    let page = page::html(report, &pictures);
    let first = ReportFile {
        name: "report.json".to_string(),
        text: report.figures.to_json() + "\n",
    };
    let last = ReportFile {
        name: "index.html".to_string(),
        text: page,
    };
    std::iter::once(first).chain(files).chain([last]).collect()
}

#[cfg(test)]
mod tests;

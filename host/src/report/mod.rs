//! What people and programs get to see of a job: figures, pictures, tables.
//!
//! ```text
//! plain structs (PlanPicture, CoveragePicture, TimePlots, Figures) --> SVG, JSON, CSV, HTML text
//! ```
//! Input: the stages' results, handed over as plain structs in the input's coordinates (mm).
//! Output: text. Leaves out files: [`write_report`] returns names and contents, the command writes
//! them.

mod canvas;
pub mod coverage_picture;
pub mod figures;
pub mod job_texts;
pub mod page;
pub mod plan_picture;
pub mod plots;
pub mod pose_table;
pub mod stream_plots;

use coverage_picture::CoveragePicture;
use figures::Figures;
use plan_picture::PlanPicture;
use plots::TimePlots;

/// Everything that a report shows.
#[derive(Clone, Debug)]
pub struct Report<'a> {
    /// Name of the part.
    pub title: &'a str,
    /// The figures.
    pub figures: &'a Figures,
    /// Outline, axis, passes, nozzle outlines.
    pub plan: Option<PlanPicture<'a>>,
    /// Gaps and overlaps.
    pub coverage: Option<CoveragePicture<'a>>,
    /// Curves over time.
    pub motion: Option<TimePlots>,
    /// Warnings and notes for the page.
    pub notes: &'a [String],
}

/// A file of the report.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportFile {
    /// Name inside the report's folder.
    pub name: &'static str,
    /// Contents.
    pub text: String,
}

/// The report's files: `report.json`, the pictures that there is something for, `index.html`.
pub fn write_report(report: &Report) -> Vec<ReportFile> {
    let mut files = vec![ReportFile {
        name: "report.json",
        text: report.figures.to_json() + "\n",
    }];
    let mut pictures = Vec::new();
    if let Some(plan) = &report.plan {
        let text = plan_picture::draw(plan);
        pictures.push((
            "plan.svg",
            "Outline, medial axis, passes and nozzle outlines",
        ));
        files.push(ReportFile {
            name: "plan.svg",
            text,
        });
    }
    if let Some(coverage) = &report.coverage {
        let text = coverage_picture::draw(coverage);
        pictures.push(("coverage.svg", "Deposited area: gaps and overlaps"));
        files.push(ReportFile {
            name: "coverage.svg",
            text,
        });
    }
    if let Some(motion) = &report.motion {
        let text = plots::draw(motion);
        pictures.push(("motion.svg", "Speed, joints, heading and flow over time"));
        files.push(ReportFile {
            name: "motion.svg",
            text,
        });
    }
    let text = page::html(report.title, report.figures, report.notes, &pictures);
    files.push(ReportFile {
        name: "index.html",
        text,
    });
    files
}

#[cfg(test)]
mod tests;

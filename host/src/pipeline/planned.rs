//! The plan of an input of any kind: a job with its figures, notes and objections.
//!
//! In: a plan of any kind, and the results of reading its input. Out: [`Planned`], from which a job is packed. The
//! command and library users get the same.

use super::Plan;
use super::findings::gcode::gcode_findings;
use super::findings::left_out::of_figures;
use super::findings::objections::Objection;
use super::findings::part::part_findings;
use super::findings::wide_beads::Laid;
use super::findings::{Findings, findings};
use super::gcode::GcodePlan;
use super::layer_uses::pass_uses;
use super::mesh::PartPlan;
use super::pass_facts::{FilePasses, PassFacts};
use crate::drive::laid_beads::LaidBeads;
use crate::gcode::GcodeProgram;
use crate::geometry::polygon::Region;
use crate::input::Target;
use crate::job::SegmentStream;
use crate::job::file::JobHeader;
use crate::job::heat::HeatEvent;
use crate::job::transform::PartTransform;
use crate::mesh::layers::SlicedPart;
use crate::plan::outline::unreachable::UnreachableRun;
use crate::report::Place;
use crate::report::figures::Figures;
use crate::report::job_texts::{
    LAYER_OUTLINES_TEXT, LayerOutlines, OUTLINE_TEXT, SETTINGS_TEXT, outline_from_json,
};
use crate::settings::{Settings, machine_file};
use headway_firmware::configuration::JointConfiguration;

/// A job and its data.
#[derive(Clone, Debug, Default)]
pub struct Planned {
    /// Name of the part.
    pub name: String,
    /// Of all layers, or of the lowest one of a part.
    pub outline: Vec<Region>,
    /// Of a part whose layers differ.
    pub layer_outlines: LayerOutlines,
    /// The settings it was planned with, the machine in the solution of its joints.
    pub settings: Settings,
    /// Its position on the machine.
    pub transform: PartTransform,
    /// The stream for the controller; empty if its parts were handed on.
    pub stream: SegmentStream,
    /// Heater and fan commands of its file.
    pub heat: Vec<HeatEvent>,
    /// Its figures.
    pub figures: Figures,
    /// Notes of reading and planning.
    pub notes: Vec<String>,
    /// What keeps it from being good.
    pub objections: Vec<Objection>,
    /// The machine's own joints, if it was planned with wider ranges.
    pub own_joints: Option<Vec<JointConfiguration>>,
    /// The known data of each pass.
    pub pass_facts: PassFacts,
    /// The planner's intermediates; `None` for a job from a file.
    pub plan: Option<Box<Plan>>,
    /// Unreachable boundary, input coordinates.
    pub unreachable: Vec<UnreachableRun>,
    /// Its beads as a known material lays them, once it is simulated with one.
    pub laid: Option<LaidBeads>,
    /// Ground and boundary that is not printed, the largest of each first; of a job from a file what its figures list.
    pub left_out: Vec<Place>,
}

/// Findings of the blocks of a part, and their stream if it is not handed on.
#[derive(Clone, Debug)]
pub struct LaidPart {
    /// The stream.
    pub stream: SegmentStream,
    laid: Laid,
}

impl Default for LaidPart {
    fn default() -> LaidPart {
        LaidPart {
            stream: SegmentStream::default(),
            laid: Laid::NOTHING,
        }
    }
}

impl LaidPart {
    /// Adds the next block.
    pub fn look_at(&mut self, piece: &SegmentStream, settings: &Settings) {
        self.laid = self.laid.with(piece, settings);
    }
}

impl Planned {
    /// For an outline, a run of waypoints or a surface that took `plan_s` seconds; `notes` are those of reading
    /// it.
    pub fn of_plan(
        plan: Plan,
        plan_s: f64,
        Target { name, regions }: Target,
        notes: Vec<String>,
        mut settings: Settings,
    ) -> Planned {
        settings.machine = plan.stream.machine(&settings.machine);
        let found = findings(&plan, plan_s, &settings);
        Planned {
            outline: regions,
            transform: plan.transform,
            stream: plan.stream.clone(),
            pass_facts: PassFacts::of_uses(&pass_uses(&plan)),
            plan: Some(Box::new(plan)),
            ..Planned::found(found, name, notes, settings)
        }
    }

    /// Of a file of G-code, planned with these settings.
    pub fn of_gcode(
        program: GcodeProgram,
        planned: GcodePlan,
        plan_s: f64,
        settings: &Settings,
    ) -> Planned {
        let found = gcode_findings(&program, &planned, plan_s, settings);
        let machine = planned.stream.machine(&settings.machine);
        let settings = Settings {
            machine,
            ..planned.settings
        };
        let GcodeProgram {
            name,
            notes,
            passes,
            ..
        } = program;
        Planned {
            transform: planned.transform,
            stream: planned.stream,
            heat: planned.heat,
            pass_facts: PassFacts::File(FilePasses {
                passes,
                of_job: planned.file_passes,
            }),
            ..Planned::found(found, name, notes, settings)
        }
    }

    /// Of a mesh; `name` and `notes` are those of reading and cutting it.
    pub fn of_part(
        (name, notes): (String, Vec<String>),
        part: &SlicedPart,
        planned: PartPlan,
        laid: LaidPart,
        keep_out: &[Region],
        plan_s: f64,
        mut settings: Settings,
    ) -> Planned {
        let found = part_findings(part, &planned, &laid.laid, keep_out, plan_s, &settings);
        let kinematics = &mut settings.machine.kinematics;
        *kinematics = kinematics.with_solution(planned.solution);
        let layers = || part.wanted_layers().iter();
        let mut outlines = layers().map(|layer| &layer.regions);
        let lowest = outlines.find(|regions| !regions.is_empty());
        let numbered = layers().map(|layer| (layer.number, layer.regions.as_slice()));
        Planned {
            outline: lowest.cloned().unwrap_or_default(),
            layer_outlines: LayerOutlines::of(numbered),
            transform: planned.transform,
            stream: laid.stream,
            pass_facts: PassFacts::of_uses(&planned.printed.pass_uses),
            ..Planned::found(found, name, notes, settings)
        }
    }

    /// What a job file knows: its header, and its stream unpacked.
    pub fn of_job(header: &JobHeader, stream: SegmentStream, name: String) -> Planned {
        let text = |key: &str| header.texts.get(key).map(String::as_str);
        let settings = text(SETTINGS_TEXT).and_then(|text| machine_file::from_job_toml(text).ok());
        let outlines = text(LAYER_OUTLINES_TEXT).and_then(LayerOutlines::from_json);
        let figures: Figures = serde_json::from_str(&header.figures_json).unwrap_or_default();
        Planned {
            left_out: of_figures(&figures, true),
            figures,
            name,
            outline: text(OUTLINE_TEXT)
                .and_then(outline_from_json)
                .unwrap_or_default(),
            layer_outlines: outlines.unwrap_or_default(),
            settings: Settings {
                machine: header.machine.clone(),
                machine_name: header.machine_name.clone(),
                ..settings.unwrap_or_default()
            },
            transform: header.transform,
            heat: header.heat(),
            pass_facts: PassFacts::of_job(header),
            stream,
            ..Planned::default()
        }
    }

    fn found(found: Findings, name: String, mut notes: Vec<String>, settings: Settings) -> Planned {
        notes.extend(found.warnings);
        Planned {
            name,
            settings,
            figures: found.figures,
            notes,
            objections: found.objections,
            unreachable: found.unreachable,
            left_out: found.left_out,
            ..Planned::default()
        }
    }

    /// The outline of a layer; empty if it is not known.
    pub fn outline_of(&self, layer: u32) -> &[Region] {
        match self.layer_outlines.is_empty() {
            true => &self.outline,
            false => self.layer_outlines.of_layer(layer),
        }
    }

    /// Notes the objections in the figures, which say them first, before those that the job was written with.
    pub fn note_objections(&mut self) {
        let objections = self.objections.iter();
        let mut lines: Vec<String> = objections.map(|of| of.text.clone()).collect();
        lines.extend(self.figures.objections.take().unwrap_or_default());
        self.figures.objections = (!lines.is_empty()).then_some(lines);
    }

    /// Restores the ranges of the machine's own joints, by which a board identifies it.
    pub fn restore_joints(&mut self) {
        let Some(own) = self.own_joints.take() else {
            return;
        };
        for (joint, own) in self.settings.machine.joints.iter_mut().zip(own) {
            *joint = own;
        }
    }
}

//! The layers that the report's page shows, their motion, and the data of the complete job.
//!
//! In: a planned job, the layers that have pictures; each layer is shown by its own motion. Out: the page's plain structs,
//! with so few points and samples that the page stays below 15 MB.

use crate::drive::time_by_limit::limit_at;
use crate::job::SegmentStream;
use crate::job::heat::{HEATER_NAMES, HeatOrder, job_events};
use crate::pipeline::page::pictures::ShownLayer;
use crate::pipeline::planned::Planned;
use crate::plan::layers::layer_groups::infills_of_layers;
use crate::report::layer_path::{PathOf, layer_path};
use crate::report::page_layer::{HeatStep, LayerMotion, PageFacts, PageLayer};
use crate::report::pose_table::{StreamIndex, duration_ticks};
use crate::report::track::{TrackOf, track};
use headway_firmware::configuration::Kinematics;

/// Most samples of the page's layers together: about 4 MB of it with seven joints.
const SAMPLES_MAX: u64 = 120_000;
/// Most points of their paths besides the ends of moves, for an upright and for a tilting tool: about 7 MB.
const POINTS_MAX: [u64; 2] = [700_000, 400_000];

/// The motion of the page's layers.
pub struct LayerMotions<'a> {
    planned: &'a Planned,
    index: StreamIndex<'a>,
}

impl<'a> LayerMotions<'a> {
    pub fn of(planned: &'a Planned) -> LayerMotions<'a> {
        LayerMotions {
            planned,
            index: StreamIndex::of(&planned.stream),
        }
    }

    /// Of a layer, with what holds it back.
    pub fn motion(&self, layer: u32) -> LayerMotion {
        let (stream, settings) = (&self.planned.stream, &self.planned.settings);
        let ticks = ticks_of(stream, layer);
        let share = (ticks[1] - ticks[0]) as f64 / duration_ticks(stream).max(1) as f64;
        let of = TrackOf {
            stream,
            settings,
            index: &self.index,
            ticks,
            samples_max: (SAMPLES_MAX as f64 * share) as u64,
        };
        let tilts = !matches!(settings.machine.kinematics, Kinematics::Planar);
        let of_path = PathOf {
            stream,
            index: &self.index,
            transform: &self.planned.transform,
            reach_mm: settings.aperture.major_mm(),
            ticks,
            points_max: (POINTS_MAX[usize::from(tilts)] as f64 * share) as usize,
        };
        let track = track(of, |span, t_ticks| limit_at(span, t_ticks, settings));
        let every_ticks = track.every_s * f64::from(settings.machine.servo_hz);
        let tick_of = |sample: usize| ticks[0] + (sample as f64 * every_ticks) as u64;
        let laid = self.planned.laid.iter().flat_map(|laid| {
            let samples = 0..track.limit.len();
            samples.map(move |sample| laid.share_at(tick_of(sample)))
        });
        LayerMotion {
            laid: laid.collect(),
            track,
            path: layer_path(of_path, self.planned.pass_facts.follow()),
        }
    }

    /// Layers that the pictures leave out.
    pub fn more(&self, shown: &[ShownLayer]) -> Vec<PageLayer<'a>> {
        let planned = self.planned;
        let layers = planned.stream.layers();
        let kinds = kinds_of_layers(planned);
        let kind = |layer: u32| kinds.get(layer as usize);
        let alike = |layer: u32| shown.iter().find(|shown| kind(shown.layer) == kind(layer));
        let more = bare_layers(planned, shown).into_iter();
        more.map(|layer| {
            let like = (kinds.len() == layers as usize)
                .then(|| alike(layer))
                .flatten();
            let like = like.map(|shown| shown.layer);
            let words = like.map_or(String::new(), |like| format!(", like layer {}", like + 1));
            PageLayer {
                layer,
                label: format!("layer {} of {layers}{words}", layer + 1),
                like,
                outline: planned.outline_of(layer),
                motion: self.motion(layer),
            }
        })
        .collect()
    }

    /// What the page is told of the whole job.
    pub fn facts(&self) -> PageFacts {
        let planned = self.planned;
        let (settings, stream) = (&planned.settings, &planned.stream);
        let servo_hz = f64::from(settings.machine.servo_hz);
        let infill = settings.infill.as_ref();
        let sparse = infill.filter(|infill| (0.0..100.0).contains(&infill.density_pct));
        let sparse = sparse.filter(|infill| infill.density_pct > 0.0);
        let is_still = matches!(
            settings.machine.kinematics,
            Kinematics::Planar | Kinematics::Gantry { .. }
        );
        PageFacts {
            duration_s: duration_ticks(stream) as f64 / servo_hz,
            bead_mm: settings.layer_height_mm,
            sparse_pitch_mm: sparse
                .map(|infill| 2.0 * settings.aperture.major_mm() * 100.0 / infill.density_pct),
            is_hollow: infill.is_some_and(|infill| infill.density_pct <= 0.0),
            line_name: planned.pass_facts.line_name(),
            bed_mm: is_still.then(|| {
                settings
                    .work_area_mm
                    .map(|corner| planned.transform.to_input(corner))
            }),
            heat: heat(planned, servo_hz),
        }
    }
}

/// For each layer the number of its kind; none where all layers differ, as those of a slicer's file do, which has no
/// outline.
pub fn kinds_of_layers(planned: &Planned) -> Vec<usize> {
    match planned.outline.is_empty() {
        true => Vec::new(),
        false => {
            let (infills, mut kinds) = infills_of_layers(&planned.settings);
            let is_solid = |kind: usize| infills[kind].is_none_or(|infill| infill.is_solid());
            let mut layers = 1..kinds.len();
            // The first solid layer over a sparse infill may be a bridge.
            if let Some(roof) = layers.find(|&l| is_solid(kinds[l]) && !is_solid(kinds[l - 1])) {
                kinds[roof] = infills.len();
            }
            kinds
        }
    }
}

/// Numbers of the layers that have no pictures.
fn bare_layers(planned: &Planned, shown: &[ShownLayer]) -> Vec<u32> {
    let Some(lowest) = shown.first() else {
        return Vec::new();
    };
    let stream = &planned.stream;
    let moves = |layer: &u32| {
        let [from, end] = stream.ticks_of_layer(*layer);
        from < end
    };
    let is_bare = |layer: &u32| shown.iter().all(|shown| shown.layer != *layer);
    let bare = (lowest.layer + 1..stream.layers()).filter(is_bare);
    bare.filter(moves).collect()
}

/// First and last tick of a layer; of the only one all there is.
fn ticks_of(stream: &SegmentStream, layer: u32) -> [u64; 2] {
    match stream.layers() {
        0 | 1 => [0, duration_ticks(stream)],
        _ => stream.ticks_of_layer(layer),
    }
}

/// What heaters and fan are set to, by the file or the machine's material.
fn heat(planned: &Planned, servo_hz: f64) -> Vec<HeatStep> {
    let material = planned.settings.material.as_ref();
    let events = job_events(&planned.heat, material, &planned.stream.marks);
    let step = |event: &crate::job::heat::HeatEvent| {
        let (name, to) = match event.order {
            HeatOrder::Heater {
                heater, celsius, ..
            } => {
                let name = HEATER_NAMES.get(usize::from(heater));
                (
                    format!("{}, °C", name.copied().unwrap_or("heater")),
                    celsius,
                )
            }
            HeatOrder::Fan { fan_pct } => ("fan, %".to_string(), fan_pct),
        };
        HeatStep {
            at_s: event.tick as f64 / servo_hz,
            name,
            to,
        }
    };
    events.iter().map(step).collect()
}

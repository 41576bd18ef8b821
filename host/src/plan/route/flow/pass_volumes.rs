//! The volume that each pass of a job deposits along its curve.
//!
//! In: the passes in printing order, machine coordinates. Out: for each one the cumulative volume at
//! its control points, mm³. Earlier coverage is tracked among the passes of a layer that may touch
//! each other; the same passes in the same order, on any layer, are evaluated once.

use crate::geometry::aperture::Aperture;
use crate::geometry::clearance::Configuration;
use crate::geometry::place_scale::ScaleField;
use crate::geometry::plane_curve::{PlaneControl, curve_at};
use crate::geometry::polygon::Box2;
use crate::geometry::union_find::root;
use crate::geometry::{Point2, Vector2};
use crate::plan::layers::PlanePass;
use crate::plan::pass::sweep::flatness;
use crate::plan::route::flow::Bead;
use crate::plan::route::flow::fresh_ground::{fresh_shares, pose_step_mm};
use crate::settings::Settings;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Most poses of one span.
const STEPS_MAX: f64 = 256.0;

/// For each pass the volume that it has deposited at its control points; `scale` if the plane is the chart of a
/// curved surface: the volumes are then those of the chart.
pub fn volumes_mm3(
    passes: &[PlanePass],
    scale: Option<&ScaleField>,
    settings: &Settings,
) -> Vec<Arc<[f64]>> {
    let reach_mm = settings.aperture.reach_mm();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut begin = 0;
    for layer in passes.chunk_by(|p, q| p.layer == q.layer) {
        groups.extend(groups_of_layer(layer, begin, reach_mm));
        begin += layer.len();
    }
    // The same curves in the same order are one.
    let mut known = HashMap::new();
    let mut different: Vec<&[usize]> = Vec::new();
    let like: Vec<usize> = groups
        .iter()
        .map(|group| {
            let curves = group
                .iter()
                .map(|&number| Arc::as_ptr(&passes[number].control));
            *known.entry(curves.collect::<Vec<_>>()).or_insert_with(|| {
                different.push(group);
                different.len() - 1
            })
        })
        .collect();
    let found: Vec<Vec<Arc<[f64]>>> = different
        .into_par_iter()
        .map(|group| volumes_of_group(group.iter().map(|&number| &passes[number]), scale, settings))
        .collect();
    let mut volumes: Vec<Arc<[f64]>> = vec![Arc::from([]); passes.len()];
    for (group, like) in groups.iter().zip(like) {
        for (&number, volume_mm3) in group.iter().zip(&found[like]) {
            volumes[number] = volume_mm3.clone();
        }
    }
    volumes
}

/// The numbers of the passes of a layer, those together that may touch each other, in their order.
fn groups_of_layer(layer: &[PlanePass], first: usize, reach_mm: f64) -> Vec<Vec<usize>> {
    let boxes: Vec<Box2> = layer
        .iter()
        .map(|pass| {
            let points = pass.control.iter().map(|&[x, y, _]| Point2::new(x, y));
            Box2::of(&points.collect::<Vec<_>>()).grown(reach_mm)
        })
        .collect();
    let mut by_left: Vec<usize> = (0..boxes.len()).collect();
    by_left.sort_by(|&p, &q| boxes[p].min.x.total_cmp(&boxes[q].min.x));
    let mut parent: Vec<usize> = (0..boxes.len()).collect();
    for (place, &own) in by_left.iter().enumerate() {
        let beside = by_left[place + 1..].iter();
        for &other in beside.take_while(|&&other| boxes[other].min.x <= boxes[own].max.x) {
            if boxes[own].meets(&boxes[other]) {
                let [a, b] = [own, other].map(|number| root(&mut parent, number));
                parent[a.max(b)] = a.min(b);
            }
        }
    }
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for number in 0..boxes.len() {
        let group = groups.entry(root(&mut parent, number)).or_default();
        group.push(first + number);
    }
    groups.into_values().collect()
}

fn volumes_of_group<'a>(
    passes: impl Iterator<Item = &'a PlanePass>,
    scale: Option<&ScaleField>,
    settings: &Settings,
) -> Vec<Arc<[f64]>> {
    let (mut poses, mut knots) = (Vec::new(), Vec::new());
    for pass in passes {
        let (of_pass, at_knots) = sampled(&pass.control, &settings.aperture);
        poses.push(of_pass);
        knots.push(at_knots);
    }
    let fresh = fresh_shares(&poses, &settings.aperture, scale);
    let bead = Bead {
        scale,
        ..Bead::of(settings)
    };
    let of_pass = poses.par_iter().zip(&fresh).zip(&knots);
    of_pass
        .map(|((poses, fresh), knots)| {
            let volume_mm3 = bead.deposit(poses, fresh);
            knots.iter().map(|&pose| volume_mm3[pose]).collect()
        })
        .collect()
}

/// Poses along a curve, so dense that their union is the swept area, and which of them are at its
/// control points' parameters.
fn sampled(control: &[PlaneControl], aperture: &Aperture) -> (Vec<Configuration>, Vec<usize>) {
    let step_mm = pose_step_mm(aperture);
    let pose = |span: usize, t: f64| {
        let [x, y, heading_rad] = curve_at(control, span, t);
        Configuration {
            center: Point2::new(x, y),
            heading_rad,
        }
    };
    let spans = control.len() - 1;
    let (mut poses, mut knots) = (Vec::new(), Vec::new());
    for span in 0..spans {
        knots.push(poses.len());
        let [p, q] = [control[span], control[span + 1]];
        let way = Vector2::new(q[0] - p[0], q[1] - p[1]);
        let turned_mm = aperture.major_mm() * (q[2] - p[2]).abs();
        let moved_mm = way.norm() / flatness(aperture, p[2], way);
        let steps = ((moved_mm + turned_mm) / step_mm).ceil();
        let steps = steps.clamp(1.0, STEPS_MAX) as usize;
        poses.extend((0..steps).map(|step| pose(span, step as f64 / steps as f64)));
    }
    knots.push(poses.len());
    poses.push(pose(
        spans.saturating_sub(1),
        if spans > 0 { 1.0 } else { 0.0 },
    ));
    (poses, knots)
}

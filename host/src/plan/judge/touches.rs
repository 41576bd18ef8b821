//! Collisions of nozzle and head with the table, with earlier print, and with obstacles.
//!
//! In: the route (mm, rad, machine coordinates), the head's profile, the table's height. Out: the deepest collision
//! of each kind with its place, and the length of path with collisions. The check uses the part's frame: where the
//! table turns, the bed turns with the part. The table is a plane; earlier print is the path of the tip with flow
//! up to then, half the bead's width to its sides ([`stations`]). Every station is checked, and the path between
//! two of them is halved until the motion from its middle to its ends cannot collide. Not covered: the machine's
//! frame and arms.
//!
//! Earlier print that is no higher above the tip's plane than the tip's slack is under the flat end: the depth to
//! which that end dips is a separate figure.

pub mod stations;

use crate::plan::route::lean::LayerNormals;
use crate::plan::route::moves::Route;
use crate::settings::Settings;
use headway_reach::profile::HeadProfile;
use headway_reach::standing::{Point, Standing};
use headway_reach::touch::Head;
use headway_reach::{Pose, Vector3};
use rayon::prelude::*;
use stations::{Station, Stations};

/// Shorter and smaller motions are not halved: what they could touch in between is closer than that.
const HALVED_MM: f64 = 0.02;
const HALVED_RAD: f64 = 0.001;

/// What touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeadPart {
    /// The nozzle's flat end, deeper than its slack.
    Tip,
    /// The nozzle's sides.
    Nozzle,
    /// The head above it.
    Head,
}

impl HeadPart {
    /// In a sentence.
    pub fn name(self) -> &'static str {
        match self {
            HeadPart::Tip => "the nozzle's flat end",
            HeadPart::Nozzle => "the nozzle",
            HeadPart::Head => "the head",
        }
    }
}

/// What is touched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstacle {
    /// The table.
    Table,
    /// What is printed already.
    Print,
    /// What it is printed on.
    Surface,
    /// An obstacle on the machine (`--obstacle`).
    Standing,
}

impl Obstacle {
    /// In a sentence.
    pub fn name(self) -> &'static str {
        match self {
            Obstacle::Table => "the table",
            Obstacle::Print => "what is printed",
            Obstacle::Surface => "the surface",
            Obstacle::Standing => "an obstacle (--obstacle)",
        }
    }
}

/// A collision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// What touches.
    pub part: HeadPart,
    /// What is touched.
    pub obstacle: Obstacle,
    /// How deep, mm.
    pub depth_mm: f64,
    /// The tip, machine coordinates.
    pub tip_mm: [f64; 3],
}

/// All collisions of a route.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Touches {
    /// The deepest of each kind.
    pub deepest: Vec<Touch>,
    /// Length of the tip's path with collisions, mm.
    pub touched_mm: f64,
    /// Largest dip of the tip's flat end into earlier print, mm.
    pub tip_dip_max_mm: f64,
    /// How far it may.
    pub tip_slack_mm: f64,
}

impl Touches {
    fn add(&mut self, touch: &Touch) {
        let same =
            |known: &&mut Touch| (known.part, known.obstacle) == (touch.part, touch.obstacle);
        match self.deepest.iter_mut().find(same) {
            Some(known) if known.depth_mm >= touch.depth_mm => {}
            Some(known) => *known = *touch,
            None => self.deepest.push(*touch),
        }
    }
}

/// Everything that a station is checked against.
struct Judge<'a> {
    profile: &'a HeadProfile,
    flat_end: HeadProfile,
    tip_slack_mm: f64,
    /// The head and its clearances for table, surface and obstacles.
    slack_mm: f64,
    nozzle_length_mm: f64,
    table_mm: f64,
    stations: &'a Stations<'a>,
    printed: Standing,
    surface: Standing,
    standing: Standing,
}

/// Collisions along the route; none if the head's shape is not known. `normals` are those of the print of its
/// passes, if they differ from the tool axis.
pub fn touches(
    route: &Route,
    normals: Option<&LayerNormals>,
    settings: &Settings,
) -> Option<Touches> {
    all_touches(route, normals, settings, &[])
}

/// The same above a surface given by these points, mm.
pub fn touches_on(route: &Route, settings: &Settings, surface: &[Vector3]) -> Option<Touches> {
    all_touches(route, None, settings, surface)
}

fn all_touches(
    route: &Route,
    normals: Option<&LayerNormals>,
    settings: &Settings,
    surface: &[Vector3],
) -> Option<Touches> {
    settings.head.as_ref()?;
    let stations = Stations::of(route, normals, settings);
    judged(&stations, settings, surface)
}

/// Collisions at stations of consecutive routes; none if the head's shape is not known.
pub fn touches_at(stations: &Stations, settings: &Settings) -> Option<Touches> {
    judged(stations, settings, &[])
}

fn judged(stations: &Stations, settings: &Settings, surface: &[Vector3]) -> Option<Touches> {
    let head = settings.head.as_ref()?;
    let on_surface = surface.iter().map(|at_mm| Point {
        at_mm: *at_mm,
        half_width_mm: 0.0,
        normal: Vector3::z(),
    });
    let profile = head.profile();
    let judge = Judge {
        profile: &profile,
        flat_end: profile.flat_end(),
        tip_slack_mm: head.tip_slack_mm(settings.layer_height_mm),
        slack_mm: 0.5 * settings.layer_height_mm,
        nozzle_length_mm: head.nozzle_length_mm(),
        table_mm: settings.work_area_mm[0][2],
        printed: Standing::new(&stations.points),
        surface: Standing::new(&on_surface.collect::<Vec<_>>()),
        standing: Standing::new(&settings.obstacles.points),
        stations,
    };
    let found: Vec<Found> = (0..stations.stations.len())
        .into_par_iter()
        .map(|index| judge.at(index))
        .collect();
    let mut all = Touches {
        tip_slack_mm: judge.tip_slack_mm,
        ..Touches::default()
    };
    for found in &found {
        all.touched_mm += found.touched_mm;
        all.tip_dip_max_mm = all.tip_dip_max_mm.max(found.tip_dip_mm);
        found.touches.iter().for_each(|touch| all.add(touch));
    }
    Some(all)
}

/// The collisions from one station to the next.
#[derive(Default)]
struct Found {
    touches: Vec<Touch>,
    touched_mm: f64,
    tip_dip_mm: f64,
}

impl Judge<'_> {
    /// Collisions at a station, or before the next one.
    fn at(&self, index: usize) -> Found {
        let station = &self.stations.stations[index];
        let mut found = Found {
            touches: self.touches_of(&station.pose, station.before),
            ..Found::default()
        };
        if station.lays {
            let flat_end = Head {
                profile: &self.flat_end,
                slack_mm: 0.0,
            };
            found.tip_dip_mm = flat_end.tip_dip_mm(&self.printed, &station.pose, station.before);
        }
        let next = self.stations.stations.get(index + 1);
        let next = next.filter(|next| next.moving == station.moving);
        if let Some(next) = next
            && found.touches.is_empty()
        {
            let ends = [(station.at, station.pose), (next.at, next.pose)];
            found.touches = self.between(station, ends);
        }
        if !found.touches.is_empty() {
            found.touched_mm = station.step_mm;
        }
        found
    }

    fn head(&self, slack_mm: f64) -> Head<'_> {
        Head {
            profile: self.profile,
            slack_mm,
        }
    }

    /// What touches between two places of one move, neither of which does: halves that are not clear are halved again.
    fn between(&self, station: &Station, ends: [(f64, Pose); 2]) -> Vec<Touch> {
        let mut waiting = vec![ends];
        while let Some([from, to]) = waiting.pop() {
            let apart_mm = (to.1.tip_mm - from.1.tip_mm).norm();
            let is_small = apart_mm < HALVED_MM && (to.1.axis - from.1.axis).norm() < HALVED_RAD;
            if is_small || self.is_clear_between([&from.1, &to.1], station.before) {
                continue;
            }
            let (at, pose) = self.stations.middle(station.moving, [from, to]);
            let touches = self.touches_of(&pose, station.before);
            if !touches.is_empty() {
                return touches;
            }
            waiting.push([(at, pose), to]);
            waiting.push([from, (at, pose)]);
        }
        Vec::new()
    }

    fn is_clear_between(&self, ends: [&Pose; 2], before: usize) -> bool {
        let all = [
            (&self.printed, self.tip_slack_mm, before),
            (&self.surface, self.slack_mm, usize::MAX),
            (&self.standing, self.slack_mm, usize::MAX),
        ];
        all.into_iter().all(|(standing, slack_mm, before)| {
            self.head(slack_mm).is_clear_between(standing, ends, before)
        })
    }

    /// The deepest touches of a pose.
    fn touches_of(&self, pose: &Pose, before: usize) -> Vec<Touch> {
        let mut found = Touches::default();
        let all = [
            (&self.printed, self.tip_slack_mm, before, Obstacle::Print),
            (&self.surface, self.slack_mm, usize::MAX, Obstacle::Surface),
            (
                &self.standing,
                self.slack_mm,
                usize::MAX,
                Obstacle::Standing,
            ),
        ];
        for (standing, slack_mm, before, obstacle) in all {
            self.head(slack_mm)
                .each_touch(standing, pose, before, |touch| {
                    found.add(&Touch {
                        part: self.part(touch.height_mm),
                        obstacle,
                        depth_mm: touch.depth_mm,
                        tip_mm: pose.tip_mm.into(),
                    });
                });
        }
        if let Some(touch) = self.touch_of_table(pose) {
            found.add(&touch);
        }
        found.deepest
    }

    fn part(&self, height_mm: f64) -> HeadPart {
        match height_mm {
            low if low <= self.profile.tip_radius_mm() => HeadPart::Tip,
            low if low < self.nozzle_length_mm => HeadPart::Nozzle,
            _ => HeadPart::Head,
        }
    }

    /// How deep the lowest edge of nozzle and head is below the table, where that is more than it gives.
    fn touch_of_table(&self, pose: &Pose) -> Option<Touch> {
        let leaning = pose.axis.xy().norm();
        let depths = self.profile.knots().iter().map(|[height_mm, radius_mm]| {
            let lowest_mm = pose.tip_mm.z - (radius_mm * leaning - height_mm * pose.axis.z);
            (self.table_mm - lowest_mm, *height_mm, *radius_mm)
        });
        let (depth_mm, height_mm, radius_mm) = depths.max_by(|a, b| a.0.total_cmp(&b.0))?;
        // At its height the head begins where the nozzle ends: the wider one is lower.
        let is_head = height_mm >= self.nozzle_length_mm
            && radius_mm >= self.profile.radius_mm(self.nozzle_length_mm);
        let part = match (is_head, height_mm > 0.0) {
            (true, _) => HeadPart::Head,
            (false, true) => HeadPart::Nozzle,
            (false, false) => HeadPart::Tip,
        };
        (depth_mm > self.slack_mm).then(|| Touch {
            part,
            obstacle: Obstacle::Table,
            depth_mm,
            tip_mm: pose.tip_mm.into(),
        })
    }
}

#[cfg(test)]
mod tests;

//! A slicer's path against what it has laid before: objects that are printed one after another, layers that go down.
//!
//! A head that stands upright and never goes down cannot touch what it printed: it is above all of it. Where the
//! file goes down by more than the flat end's slack, or something stands on the machine, all poses are looked at.

use crate::gcode::GcodeProgram;
use crate::plan::judge::touches::stations::Stations;
use crate::plan::judge::touches::{Touches, touches_at};
use crate::plan::route::moves::Route;
use crate::settings::Settings;

/// Where a file goes down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Descent {
    /// How far below the highest bead before it, mm.
    pub down_mm: f64,
    /// Line of the file.
    pub line: u64,
}

/// The first place at which a bead is lower than one before it by more than the flat end's slack.
pub fn descent(program: &GcodeProgram, settings: &Settings) -> Option<Descent> {
    let slack_mm = match &settings.head {
        Some(head) => head.tip_slack_mm(settings.layer_height_mm),
        None => settings.layer_height_mm,
    };
    let mut highest_mm = f64::NEG_INFINITY;
    for pass in &program.passes {
        for (index, point) in pass.points.iter().enumerate() {
            let down_mm = highest_mm - point.tip_mm[2];
            if down_mm > slack_mm {
                let leg = pass.legs.get(index.min(pass.legs.len().saturating_sub(1)));
                let line = leg.map_or(0, |leg| leg.line as u64);
                return Some(Descent { down_mm, line });
            }
            highest_mm = highest_mm.max(point.tip_mm[2]);
        }
    }
    None
}

/// Collects the pieces of a path and holds them against what stands, where that can be touched.
pub(crate) struct Collector {
    stations: Option<Stations<'static>>,
}

impl Collector {
    /// For a file that may go down.
    pub fn new(descent: Option<Descent>, settings: &Settings) -> Collector {
        let is_needed = descent.is_some() || !settings.obstacles.points.is_empty();
        Collector {
            stations: (is_needed && settings.head.is_some()).then(Stations::default),
        }
    }

    /// Puts a piece behind the others.
    pub fn add(&mut self, route: &Route, settings: &Settings) {
        if let Some(stations) = &mut self.stations {
            stations.append(route, None, settings);
        }
    }

    /// What they touch; nothing where nobody had to look, or the head's shape is not known.
    pub fn touches(&self, settings: &Settings) -> Option<Touches> {
        touches_at(self.stations.as_ref()?, settings)
    }
}

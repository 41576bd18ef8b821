//! The heater and fan commands that `stream` sends: before the job and along its path.
//!
//! In: a job's commands by servo tick, options that override them. Out: commands for the board, each due once the
//! spans up to its tick are done. Not covered: switching everything off (`operator.rs`), how a board holds a
//! temperature, and its rest until the temperature is reached.

use crate::cli::args::board::StreamArgs;
use crate::cli::board::heat::heat;
use crate::cli::error::CliError;
use crate::cli::plan::missing_heat::missing_heat;
use crate::cli::reading::job::Job;
use crate::drive::pause_heat::PAUSE_HEAT_MAX_MIN;
use crate::job::heat::{BED, HEAT_TEXT, HOT_END, HeatEvent, HeatOrder, from_json, material_events};
use headway_protocol::message::Control;
use std::collections::VecDeque;

/// What a job orders.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct StreamHeat {
    /// Before it.
    pub before: Vec<Control>,
    /// On its path, with their ticks.
    on_path: VecDeque<(u64, Control)>,
}

impl StreamHeat {
    /// The orders of a job under the options.
    pub(crate) fn of(args: &StreamArgs, job: &Job) -> Result<StreamHeat, CliError> {
        if args.no_heat {
            // Nothing is melted: the board is to move the extruder all the same, in this run.
            return Ok(StreamHeat {
                before: vec![Control::ExtrudeCold(true)],
                on_path: VecDeque::new(),
            });
        }
        let mut events = of_job(job)?;
        for (name, celsius) in [("bed", args.bed), ("hot-end", args.hot_end)] {
            let Some(celsius) = celsius else { continue };
            // Reports the error of the option.
            heat(name, celsius, true)?;
            let heater = if name == "bed" { BED } else { HOT_END };
            replace(&mut events, HeatOrder::wait_for(heater, celsius));
        }
        if let Some(fan_pct) = args.fan {
            if !(0.0..=100.0).contains(&fan_pct) {
                return Err(CliError::Usage(format!("--fan {fan_pct}: 0 to 100")));
            }
            replace(&mut events, HeatOrder::Fan { fan_pct });
        }
        if let Some(missing) = missing_heat(job, &events, "give --hot-end C") {
            return Err(CliError::Job(missing));
        }
        let end_tick = job.stream.marks.last().map_or(0, |mark| mark.end_tick);
        Ok(StreamHeat::of_events(&events, end_tick))
    }

    fn of_events(events: &[HeatEvent], end_tick: u64) -> StreamHeat {
        let control = |event: &HeatEvent| Some((event.tick, event.order.control()?));
        let (mut before, mut on_path) = (Vec::new(), VecDeque::new());
        for (tick, control) in events.iter().filter_map(control) {
            if tick == 0 {
                before.push(control);
            } else if tick < end_tick {
                on_path.push_back((tick, control));
            }
        }
        StreamHeat { before, on_path }
    }

    /// Something changes on the path.
    pub(crate) fn changes(&self) -> bool {
        !self.on_path.is_empty()
    }

    /// The next command that is due once this tick is done.
    pub(crate) fn due(&mut self, done_tick: u64) -> Option<Control> {
        let (tick, _) = self.on_path.front()?;
        match *tick <= done_tick {
            true => self.on_path.pop_front().map(|(_, control)| control),
            false => None,
        }
    }
}

/// A job's own orders; one that was planned before jobs had them uses the targets of its material.
pub(crate) fn of_job(job: &Job) -> Result<Vec<HeatEvent>, CliError> {
    match job.file.header.texts.get(HEAT_TEXT) {
        Some(text) => from_json(text).ok_or_else(|| {
            CliError::Job(format!(
                "{}: the job's orders of heaters and fans cannot be read: plan it again, or leave them out \
                 with --no-heat",
                job.name
            ))
        }),
        None => {
            let material = job.settings.as_ref().and_then(|settings| settings.material);
            let marks = &job.stream.marks;
            Ok(material.map_or(Vec::new(), |material| material_events(&material, marks)))
        }
    }
}

/// How long a pause keeps its heat: as requested, as in the job's machine file, or the default.
pub(crate) fn pause_heat_max_min(args: &StreamArgs, job: &Job) -> f64 {
    let settings = job.settings.as_ref();
    let material = settings.and_then(|settings| settings.material);
    let of_file = material.and_then(|material| material.pause_heat_max_min);
    args.pause_heat_max_min
        .or(of_file)
        .unwrap_or(PAUSE_HEAT_MAX_MIN)
}

/// One order for the whole job in place of all of the same heater, or of the fan.
fn replace(events: &mut Vec<HeatEvent>, order: HeatOrder) {
    events.retain(|event| !event.order.is_of_same(&order));
    events.insert(0, HeatEvent { tick: 0, order });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: each order is given once, when its tick is done. Method: orders by hand.
    #[test]
    fn orders_come_when_their_place_is_done() {
        let event = |tick, order| HeatEvent { tick, order };
        let fan = |fan_pct| HeatOrder::Fan { fan_pct };
        let mut events = vec![
            event(0, HeatOrder::wait_for(HOT_END, 215.0)),
            event(10, fan(50.0)),
            event(20, HeatOrder::target(HOT_END, 205.0)),
            event(30, fan(0.0)),
        ];
        let mut orders = StreamHeat::of_events(&events, 30);
        assert_eq!(orders.before, [heat("hot-end", 215.0, true).unwrap()]);
        assert_eq!(orders.due(9), None);
        assert_eq!(orders.due(25), Some(Control::Fan(500)));
        assert_eq!(orders.due(25), Some(heat("hot-end", 205.0, false).unwrap()));
        assert_eq!(orders.due(u64::MAX), None);
        replace(&mut events, fan(10.0));
        let orders = StreamHeat::of_events(&events, 30);
        assert_eq!(orders.before[0], Control::Fan(100));
        assert_eq!(orders.on_path.len(), 1);
    }
}

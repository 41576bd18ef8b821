//! The heater and fan commands of a job, and their positions on its path.
//!
//! In: a file's commands at ticks of the stream, or the `[material]` of a machine file and the layers of a
//! stream. Out: [`HeatEvent`]s by tick (servo ticks of segment time), and their text in a job's header. Not
//! covered: sending them, which `stream` does to a board and `export` as codes of another controller.

use crate::job::Mark;
use crate::settings::heat::Material;
use headway_protocol::message::{Control, DECIDEGREES_MAX, HEATERS_MAX};
use serde::{Deserialize, Serialize};

/// Key of the commands among a job's texts.
pub const HEAT_TEXT: &str = "heat";
/// The hot end among the heaters.
pub const HOT_END: u8 = 0;
/// The bed among the heaters.
pub const BED: u8 = 1;
/// Names of the heaters in the order of their numbers.
pub const HEATER_NAMES: [&str; HEATERS_MAX] = ["hot end", "bed", "second hot end"];

/// One command.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub enum HeatOrder {
    /// A heater's target.
    Heater {
        /// Which, as the board counts them.
        heater: u8,
        /// Target, °C; 0 is off.
        celsius: f64,
        /// The path waits at rest until it is there.
        wait: bool,
    },
    /// The part fan.
    Fan {
        /// Per cent of its full speed.
        fan_pct: f64,
    },
}

/// A command at a point of the path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeatEvent {
    /// Servo tick of segment time from which it applies.
    pub tick: u64,
    /// What.
    pub order: HeatOrder,
}

impl HeatOrder {
    /// A target that nothing waits for.
    pub fn target(heater: u8, celsius: f64) -> HeatOrder {
        HeatOrder::Heater {
            heater,
            celsius,
            wait: false,
        }
    }

    /// A target that the path waits for.
    pub fn wait_for(heater: u8, celsius: f64) -> HeatOrder {
        HeatOrder::Heater {
            heater,
            celsius,
            wait: celsius > 0.0,
        }
    }

    /// True for commands of the same heater, or both of the fan.
    pub fn is_of_same(&self, other: &HeatOrder) -> bool {
        self.channel() == other.channel()
    }

    /// The heater; `None` for the fan.
    fn channel(&self) -> Option<u8> {
        match self {
            HeatOrder::Heater { heater, .. } => Some(*heater),
            HeatOrder::Fan { .. } => None,
        }
    }

    /// True for a heater or fan that is switched on.
    pub fn is_on(&self) -> bool {
        match self {
            HeatOrder::Heater { celsius, .. } => *celsius > 0.0,
            HeatOrder::Fan { fan_pct } => *fan_pct > 0.0,
        }
    }

    /// As a board's command; `None` for a heater or number that no board has.
    pub fn control(&self) -> Option<Control> {
        match *self {
            HeatOrder::Heater {
                heater,
                celsius,
                wait,
            } => {
                let decidegrees = (celsius * 10.0).round();
                let is_known = usize::from(heater) < HEATERS_MAX
                    && (0.0..=f64::from(DECIDEGREES_MAX)).contains(&decidegrees);
                is_known.then_some(Control::Heat {
                    heater,
                    decidegrees: decidegrees as u16,
                    wait,
                })
            }
            HeatOrder::Fan { fan_pct } => {
                let is_known = (0.0..=100.0).contains(&fan_pct);
                is_known.then_some(Control::Fan((fan_pct * 10.0).round() as u16))
            }
        }
    }

    /// For people: "hot end 215 °C, waits".
    pub fn text(&self) -> String {
        match *self {
            HeatOrder::Heater {
                heater,
                celsius,
                wait,
            } => {
                let name = HEATER_NAMES.get(usize::from(heater));
                let name = name.copied().unwrap_or("unknown heater");
                match (celsius > 0.0, wait) {
                    (false, _) => format!("{name} off"),
                    (true, false) => format!("{name} {celsius} °C"),
                    (true, true) => format!("{name} {celsius} °C, waits"),
                }
            }
            HeatOrder::Fan { fan_pct } if fan_pct > 0.0 => {
                format!("fan {} %", round_tenth(fan_pct))
            }
            HeatOrder::Fan { .. } => "fan off".to_string(),
        }
    }
}

fn round_tenth(number: f64) -> f64 {
    (number * 10.0).round() / 10.0
}

/// A material's commands for a stream with these marks: first the bed, which takes longer, then the hot end;
/// after the first layer its own temperatures end; the fan is switched on with its first layer; at the end all
/// is off.
pub fn material_events(material: &Material, marks: &[Mark]) -> Vec<HeatEvent> {
    let (Some(first), Some(last)) = (marks.first(), marks.last()) else {
        return Vec::new();
    };
    // Layers of a range are counted from its lowest.
    let layer_tick = |above: u32| {
        let layer = first.layer.saturating_add(above);
        let number = marks.partition_point(|mark| mark.layer < layer);
        marks.get(number).map(|mark| mark.start_tick)
    };
    let mut events = Vec::new();
    let mut push = |tick: Option<u64>, order: HeatOrder| {
        events.extend(tick.map(|tick| HeatEvent { tick, order }));
    };
    let heaters = [
        (BED, material.bed_c, material.first_layer_bed_c),
        (HOT_END, material.hot_end_c, material.first_layer_hot_end_c),
    ];
    for (heater, celsius, first_c) in heaters {
        let first_c = first_c.unwrap_or(celsius);
        if first_c > 0.0 {
            push(Some(0), HeatOrder::wait_for(heater, first_c));
        }
        if first_c != celsius {
            push(layer_tick(1), HeatOrder::target(heater, celsius));
        }
        if first_c > 0.0 || celsius > 0.0 {
            push(Some(last.end_tick), HeatOrder::target(heater, 0.0));
        }
    }
    if material.fan_pct > 0.0 {
        let from = layer_tick(material.fan_from_layer.unwrap_or(2).saturating_sub(1));
        let fan_pct = material.fan_pct;
        push(from, HeatOrder::Fan { fan_pct });
        push(from.map(|_| last.end_tick), HeatOrder::Fan { fan_pct: 0.0 });
    }
    sorted(events)
}

/// The commands of a file, completed by those of the material; at the end all heaters are off.
pub fn job_events(
    of_file: &[HeatEvent],
    material: Option<&Material>,
    marks: &[Mark],
) -> Vec<HeatEvent> {
    let mut events = of_file.to_vec();
    let of_material = material.map_or(Vec::new(), |material| material_events(material, marks));
    let is_silent = |event: &HeatEvent| {
        !of_file
            .iter()
            .any(|said| said.order.is_of_same(&event.order))
    };
    events.extend(of_material.into_iter().filter(is_silent));
    let end_tick = marks.last().map_or(0, |mark| mark.end_tick);
    ended(&sorted(events), end_tick, false)
}

/// The heaters that commands leave on, as they were commanded last.
pub fn left_on(events: &[HeatEvent]) -> Vec<HeatOrder> {
    let last_of = |heater| {
        let of_heater = |order: &HeatOrder| order.channel() == Some(heater);
        events.iter().rev().map(|event| event.order).find(of_heater)
    };
    let last = (0..HEATERS_MAX as u8).filter_map(last_of);
    last.filter(HeatOrder::is_on).collect()
}

/// Commands by tick, after which every heater is off: those that they leave on go off at the job's end. With
/// `leave_hot` heaters stay as they are when the end is reached, and only the fan goes off there.
pub fn ended(events: &[HeatEvent], end_tick: u64, leave_hot: bool) -> Vec<HeatEvent> {
    let is_end = |event: &HeatEvent| {
        event.tick >= end_tick && event.order.channel().is_some() && !event.order.is_on()
    };
    let kept = events.iter().filter(|event| !(leave_hot && is_end(event)));
    let mut kept: Vec<HeatEvent> = kept.copied().collect();
    if !leave_hot {
        let tick = kept.last().map_or(end_tick, |last| last.tick.max(end_tick));
        let off = left_on(&kept)
            .into_iter()
            .filter_map(|order| order.channel());
        let off = off.map(|heater| HeatOrder::target(heater, 0.0));
        kept.extend(off.map(|order| HeatEvent { tick, order }));
    }
    kept
}

/// By their ticks, those of a tick as they came.
fn sorted(mut events: Vec<HeatEvent>) -> Vec<HeatEvent> {
    events.sort_by_key(|event| event.tick);
    events
}

/// The text for a job's header.
pub fn to_json(events: &[HeatEvent]) -> String {
    serde_json::to_string(events).unwrap_or_else(|_| "[]".to_string())
}

/// The output of [`to_json`], by tick; `None` if it is something else or no board can do it.
pub fn from_json(text: &str) -> Option<Vec<HeatEvent>> {
    let events: Vec<HeatEvent> = serde_json::from_str(text).ok()?;
    let is_known = |event: &HeatEvent| event.order.control().is_some();
    let all_known = events.iter().all(is_known);
    (all_known && events.is_sorted_by_key(|event| event.tick)).then_some(events)
}

/// A line on each, with its time.
pub fn list(events: &[HeatEvent], servo_hz: f64) -> Vec<String> {
    let line = |event: &HeatEvent| {
        let seconds = event.tick as f64 / servo_hz;
        format!("at {seconds:.3} s: {}", event.order.text())
    };
    events.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::MotionState;

    fn marks(layers: std::ops::Range<u32>) -> Vec<Mark> {
        let mark = |layer| Mark {
            start_tick: u64::from(layer) * 100,
            end_tick: u64::from(layer) * 100 + 100,
            state: MotionState::Print,
            layer,
            pass: Some(layer),
        };
        layers.map(mark).collect()
    }

    /// Goal: a material's orders stand at the layers that it names. Method: three layers by hand.
    #[test]
    fn a_material_changes_behind_the_first_layer() {
        let material = Material {
            hot_end_c: 205.0,
            bed_c: 60.0,
            fan_pct: 80.0,
            first_layer_hot_end_c: Some(215.0),
            fan_from_layer: Some(3),
            ..Material::default()
        };
        let events = material_events(&material, &marks(0..3));
        let told: Vec<(u64, String)> = events
            .iter()
            .map(|event| (event.tick, event.order.text()))
            .collect();
        let told: Vec<(u64, &str)> = told.iter().map(|(tick, text)| (*tick, &**text)).collect();
        assert_eq!(
            told,
            [
                (0, "bed 60 °C, waits"),
                (0, "hot end 215 °C, waits"),
                (100, "hot end 205 °C"),
                (200, "fan 80 %"),
                (300, "bed off"),
                (300, "hot end off"),
                (300, "fan off"),
            ]
        );
        assert_eq!(from_json(&to_json(&events)), Some(events));
        // A fan from a layer that the job has not stays off, a range begins with its own lowest.
        let of_range = material_events(&material, &marks(7..9));
        assert!(
            of_range
                .iter()
                .all(|event| !matches!(event.order, HeatOrder::Fan { .. }))
        );
        assert_eq!(of_range[2].tick, 800);
        assert_eq!(material_events(&material, &[]), []);
    }

    /// Goal: what a file orders is its own, the rest the material's. Method: a file with a fan alone.
    #[test]
    fn a_file_goes_before_the_material() {
        let material = Material {
            hot_end_c: 205.0,
            fan_pct: 80.0,
            ..Material::default()
        };
        let fan = HeatEvent {
            tick: 150,
            order: HeatOrder::Fan { fan_pct: 40.0 },
        };
        let events = job_events(&[fan], Some(&material), &marks(0..2));
        let ticks: Vec<u64> = events.iter().map(|event| event.tick).collect();
        assert_eq!(ticks, [0, 150, 200]);
        assert_eq!(events[1], fan);
    }

    /// Goal: whatever switched heaters on, a job's end switches them off, each once and none that is off. Method: a
    /// file that leaves the bed and a second hot end on and switches the first off before its end; left hot, the
    /// material's own end too.
    #[test]
    fn heaters_that_are_left_on_go_off_at_the_end() {
        let event = |tick, order| HeatEvent { tick, order };
        let file = [
            event(0, HeatOrder::wait_for(BED, 60.0)),
            event(0, HeatOrder::wait_for(HOT_END, 215.0)),
            event(120, HeatOrder::target(2, 180.0)),
            event(190, HeatOrder::target(HOT_END, 0.0)),
        ];
        assert_eq!(left_on(&file), [file[0].order, file[2].order]);
        let job = job_events(&file, None, &marks(0..2));
        let off = [BED, 2].map(|heater| event(200, HeatOrder::target(heater, 0.0)));
        assert_eq!(job, [&file[..], &off[..]].concat());
        assert_eq!(ended(&job, 200, false), job);
        assert_eq!(ended(&job, 200, true), file);
        assert_eq!(left_on(&job), []);
        let material = Material {
            hot_end_c: 205.0,
            fan_pct: 80.0,
            ..Material::default()
        };
        let hot = ended(&material_events(&material, &marks(0..2)), 200, true);
        assert_eq!(left_on(&hot), [HeatOrder::wait_for(HOT_END, 205.0)]);
        assert_eq!(
            hot.last(),
            Some(&event(200, HeatOrder::Fan { fan_pct: 0.0 }))
        );
    }

    #[test]
    fn texts_of_others_are_none() {
        for text in [
            "",
            "{}",
            r#"[{"tick":0,"order":{"heater":7,"celsius":20.0,"wait":false}}]"#,
            r#"[{"tick":0,"order":{"heater":0,"celsius":-1.0,"wait":false}}]"#,
            r#"[{"tick":0,"order":{"heater":0,"celsius":2e9,"wait":false}}]"#,
            r#"[{"tick":0,"order":{"fan_pct":101.0}}]"#,
            r#"[{"tick":2,"order":{"fan_pct":1.0}},{"tick":1,"order":{"fan_pct":1.0}}]"#,
        ] {
            assert_eq!(from_json(text), None, "{text}");
        }
    }
}

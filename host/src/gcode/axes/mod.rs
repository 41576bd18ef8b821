//! Axes of the machine that a file was written for: its words become poses of the nozzle on the part.
//!
//! In: [`AxesWords`], or the joints of a machine file; the place of each axis as a file counts it (mm, degrees). Out:
//! the tip in the part's frame, the tool axis and the heading. The part's frame is the machine's with all rotary
//! axes at 0. A file of linear axes (`coordinates=pivot`) goes through the forward equations of
//! [`headway_firmware::kinematics`]; where its X Y Z are the tip already, they turn the tool axis alone. Between two
//! places of a file all axes go evenly, so that the tip's way is no straight line where an axis turns: [`legs`]
//! divides it. Leaves out which letters a file has that nothing declares: the interpreter asks for them.

pub mod legs;

use crate::gcode::Place;
use crate::settings::axes_words::{AxesWords, Coordinates, FeedOf};
use crate::text::refusal::{Refusal, refusal};
use headway_firmware::configuration::axis_family::{AxisFamily, RotaryAxis};
use headway_firmware::configuration::{JOINTS_MAX, Kinematics};
use headway_firmware::kinematics::Model;
use nalgebra::{Unit, Vector3};

/// Axes that a file may have: X, Y, Z, and as many that turn as an arm with a nozzle.
pub const SLOTS: usize = 10;
/// The first that turns.
pub const TURNS_FROM: usize = 3;
/// Where each of a file's axes stands: mm, and degrees from [`TURNS_FROM`] on.
pub type At = [f64; SLOTS];

/// One axis of a file.
#[derive(Clone, Debug, PartialEq)]
struct Slot {
    /// A letter, or the name of a manual stepper.
    name: String,
    /// The joint that it is.
    joint: usize,
    /// 1, or -1 where it counts the other way.
    sense: f64,
    /// Where the joint is at the file's 0, mm or rad.
    zero: f64,
}

/// The axes of the machine that a file was written for.
#[derive(Clone, Debug, PartialEq)]
pub struct FileAxes {
    model: Model<f64>,
    slots: [Option<Slot>; SLOTS],
    /// The one that turns the nozzle about its own axis.
    heading: Option<usize>,
    coordinates: Coordinates,
    feed: Option<FeedOf>,
    extruder: Option<u8>,
    text: String,
}

/// A machine whose joints a file has.
#[derive(Clone, Copy, Debug)]
pub struct FileMachine<'a> {
    /// Its equations.
    pub kinematics: &'a Kinematics,
    /// Names of its joints, in order.
    pub joints: &'a [&'a str],
}

/// The nozzle on the part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilePose {
    /// Tip, part's frame, mm.
    pub tip_mm: Vector3<f64>,
    /// From the tip into the head.
    pub axis: Unit<Vector3<f64>>,
    /// About it, rad, as poses count it.
    pub heading_rad: f64,
}

impl FileAxes {
    /// The axes that words say; `machine` is that which they name, if they name one.
    ///
    /// # Errors
    /// A `Refusal` where letters do not fit the machine's joints.
    pub fn new(words: &AxesWords, machine: Option<&FileMachine>) -> Result<FileAxes, Refusal> {
        let (model, slots, heading) = match machine {
            Some(machine) => of_machine(words, machine)?,
            None => of_words(words),
        };
        let mut axes = FileAxes {
            model,
            slots,
            heading,
            coordinates: Coordinates::Tip,
            feed: words.feed,
            extruder: words.extruder,
            text: words.text.clone(),
        };
        let is_jointed = machine.is_some() || !words.rotary.is_empty();
        axes.coordinates = match words.coordinates {
            Some(coordinates) => coordinates,
            None if is_jointed => Coordinates::Pivot,
            None => Coordinates::Tip,
        };
        for (slot, mm) in axes.slots.iter_mut().zip(words.shift_mm) {
            if let Some(slot) = slot {
                slot.zero += mm;
            }
        }
        Ok(axes)
    }

    /// Letters of the slots; 0 where one has none.
    pub fn letters(&self) -> [u8; SLOTS] {
        std::array::from_fn(|slot| {
            let name = self.slots[slot].as_ref().map(|slot| slot.name.as_bytes());
            match name {
                Some([letter]) => *letter,
                _ => 0,
            }
        })
    }

    /// The slot of a manual stepper, as Klipper's files call it.
    pub fn stepper(&self, name: &str) -> Option<usize> {
        let is_named = |slot: &Option<Slot>| {
            let of_slot = slot.as_ref().map(|slot| slot.name.as_str());
            of_slot.is_some_and(|of_slot| of_slot.len() > 1 && of_slot.eq_ignore_ascii_case(name))
        };
        self.slots.iter().position(is_named)
    }

    /// The slot that turns the nozzle.
    pub fn heading(&self) -> Option<usize> {
        self.heading
    }

    /// The extruder's letter, where they say it.
    pub fn extruder(&self) -> Option<u8> {
        self.extruder
    }

    /// What F measures where no inverse time is told.
    pub fn feed(&self) -> FeedOf {
        self.feed.unwrap_or(match self.coordinates {
            Coordinates::Tip => FeedOf::Tip,
            Coordinates::Pivot => FeedOf::Xyz,
        })
    }

    /// The words as they were said.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The nozzle on the part, for each axis of a file at its place.
    pub fn pose(&self, at: &At) -> FilePose {
        let mut joints = [0.0; JOINTS_MAX];
        let is_tip = self.coordinates == Coordinates::Tip;
        let mut tip_mm = Vector3::zeros();
        for (number, slot) in self.slots.iter().enumerate() {
            let Some(slot) = slot else { continue };
            let turns = number >= TURNS_FROM;
            let value = if turns {
                at[number].to_radians()
            } else {
                at[number]
            };
            let value = slot.sense * value + slot.zero;
            match is_tip && !turns {
                true => tip_mm[number] = value,
                false => joints[slot.joint] = value,
            }
        }
        let pose = self.model.forward(&joints);
        FilePose {
            tip_mm: if is_tip { tip_mm } else { pose.tip_mm },
            axis: Unit::try_new(pose.tool_axis(), 0.5).unwrap_or(-Vector3::z_axis()),
            // Straight down there is no heading; such a pose is refused where it prints.
            heading_rad: Some(pose.heading_rad)
                .filter(|rad| rad.is_finite())
                .unwrap_or(0.0),
        }
    }
}

impl FilePose {
    /// The place as the rest of reading has it, its heading within half a turn of `near_deg` (C).
    pub fn place(&self, near_deg: f64) -> Place {
        let n = self.axis;
        let across = n.y.hypot(n.z);
        // Of an axis along X any turn about X is one.
        let a = if across > 1e-12 {
            (-n.y).atan2(n.z)
        } else {
            0.0
        };
        let b = n.x.clamp(-1.0, 1.0).asin();
        let mut place = Place {
            tip_mm: self.tip_mm.into(),
            turn_deg: [a.to_degrees(), b.to_degrees(), 0.0],
        };
        let (_, at_zero_rad) = place.axis_and_heading();
        let c = (self.heading_rad - at_zero_rad).to_degrees();
        place.turn_deg[2] = c + 360.0 * ((near_deg - c) / 360.0).round();
        place
    }
}

type Parts = (Model<f64>, [Option<Slot>; SLOTS], Option<usize>);

/// Axes by words: linear axes, up to two rotary ones, the nozzle's turn.
fn of_words(words: &AxesWords) -> Parts {
    let plain = |name: &str, joint: usize| Slot {
        name: name.to_string(),
        joint,
        sense: 1.0,
        zero: 0.0,
    };
    let mut slots: [Option<Slot>; SLOTS] = Default::default();
    for (joint, name) in ["X", "Y", "Z"].into_iter().enumerate() {
        slots[joint] = Some(plain(name, joint));
    }
    for (k, rotary) in words.rotary.iter().enumerate() {
        slots[TURNS_FROM + k] = Some(Slot {
            zero: rotary.zero_rad,
            ..plain(&rotary.name, TURNS_FROM + k)
        });
    }
    let heading = TURNS_FROM + words.rotary.len();
    slots[heading] = words.heading.as_ref().map(|word| Slot {
        sense: if word.negated { -1.0 } else { 1.0 },
        zero: word.zero_rad,
        ..plain(&word.name, heading)
    });
    let mut axes = words.rotary.iter().map(|rotary| RotaryAxis {
        on_table: rotary.on_table,
        axis: rotary.axis,
        offset_mm: rotary.at_mm.unwrap_or_default(),
    });
    let model = match axes.next() {
        None => Model::Planar,
        Some(first) => Model::new(&Kinematics::Axes {
            axes: AxisFamily {
                first,
                second: axes.next(),
                tool_axis: AxisFamily::leaning(words.lean_rad),
                polar: false,
            },
            solution: 0,
        }),
    };
    (model, slots, words.heading.as_ref().map(|_| heading))
}

/// The joints of a machine: linear ones as X, Y, Z, the others behind them, by their names or by letters that are
/// given.
fn of_machine(words: &AxesWords, machine: &FileMachine) -> Result<Parts, Refusal> {
    let letters = match &words.letters {
        Some(letters) if letters.len() != machine.joints.len() => {
            return Err(wrong_letters(letters.len(), machine.joints));
        }
        Some(letters) => letters.clone(),
        None => default_letters(machine.joints)?,
    };
    let mut slots: [Option<Slot>; SLOTS] = Default::default();
    let (mut heading, mut next) = (None, TURNS_FROM);
    for (joint, (name, letter)) in machine.joints.iter().zip(letters).enumerate() {
        let number = match ["x", "y", "z"].iter().position(|linear| linear == name) {
            Some(linear) => linear,
            None => {
                next += 1;
                next - 1
            }
        };
        // The last joint of every machine but an arm without a nozzle turns it.
        if *name == "h" || *name == "c" && joint + 1 == machine.joints.len() {
            heading = Some(number);
        }
        if let Some(slot) = slots.get_mut(number) {
            *slot = Some(Slot {
                name: char::from(letter).to_string(),
                joint,
                sense: 1.0,
                zero: 0.0,
            });
        }
    }
    Ok((Model::new(machine.kinematics), slots, heading))
}

/// The letters of joints that are named by letters.
fn default_letters(joints: &[&str]) -> Result<Vec<u8>, Refusal> {
    let letters = joints.iter().map(|name| match name.as_bytes() {
        [letter] => Some(letter.to_ascii_uppercase()),
        _ => None,
    });
    let letters = letters.collect::<Option<_>>();
    letters.ok_or_else(|| wrong_letters(0, joints))
}

fn wrong_letters(given: usize, joints: &[&str]) -> Refusal {
    refusal!(
        "letters= has {given}, and that machine has the joints {}: write one for each, in this order, as in \
         letters=X/Y/Z/B/C/H",
        joints.join(", ")
    )
}

#[cfg(test)]
#[path = "axes_tests.rs"]
mod tests;

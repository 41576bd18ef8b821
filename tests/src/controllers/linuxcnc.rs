//! A model of LinuxCNC 2.9's trajectory planner for moves with ABC or UVW: parabolic blends.
//!
//! Source: linuxcnc.org, "Trajectory Control" (G64 P, blending), and the behaviour of `emccanon.cc`, `tp.c` and `tc.c`. Where a
//! move has A B C or U V W there is neither a tangent nor an arc blend: each move of G64 speeds up from 0 and slows down to 0 by
//! half its acceleration, the next beginning while this one slows down, from the blend velocity on, so that corners stay
//! within P. A move is faster than sqrt(a L) only on paper. G93 is the move's time, if no axis is too slow. M66, M68 and
//! the end of a program wait for rest. Leaves out tangent and arc blends: moves of X Y Z alone are planned as the others,
//! which is slower; arcs' centripetal acceleration takes its share of theirs.

use super::profiles::{Block, Profile, trapezoid};
use super::state::{Rules, State, Way};
use super::{AXES, EXTRUDER, Printed, moves_of, within};

/// A servo period, s: no move is shorter.
const CYCLE_S: f64 = 0.001;
/// Characters of a line.
const LINE_MAX: usize = 255;
/// Feed of G0 is the machine's: a rate that all axes bound.
const RAPID: f64 = f64::INFINITY;

/// What the INI file says; axes are X Y Z A B C U, a second.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// `MAX_VELOCITY`.
    pub speed_max: [f64; AXES],
    /// `MAX_ACCELERATION`.
    pub acceleration_max: [f64; AXES],
    /// `MIN_LIMIT` and `MAX_LIMIT` of U, mm; none where an INI file has none.
    pub extruder_mm: Option<[f64; 2]>,
    /// Letter of the extruder's axis.
    pub extruder: char,
}

/// A machine that LinuxCNC runs, from program to program.
#[derive(Clone, Debug)]
pub struct LinuxCnc {
    config: Config,
    state: State,
}

impl LinuxCnc {
    /// Homed and configured.
    pub fn new(config: Config) -> LinuxCnc {
        let mut letters = ['X', 'Y', 'Z', 'A', 'B', 'C', 'U'];
        letters[EXTRUDER] = config.extruder;
        let state = State::new(Rules {
            letters,
            machine_tool: true,
            arcs: true,
            codes: &[],
        });
        LinuxCnc { config, state }
    }

    /// Runs a program.
    ///
    /// # Errors
    /// What it refuses, with the line.
    pub fn print(&mut self, text: &str) -> Result<Printed, String> {
        let config = &self.config;
        let mut centripetal = Vec::new();
        let moves = moves_of(text, &mut self.state, LINE_MAX, |state, way, _| {
            config.check(way)?;
            let block = config.block(state, way);
            if block.is_some() {
                centripetal.push(way.arc.map(|(centre, _)| centre[0].hypot(centre[1])));
            }
            Ok(block)
        })?;
        let tolerance_mm = tolerance_mm(text)?;
        let blocks: Vec<Block> = moves
            .iter()
            .zip(centripetal)
            .map(|(of, radius)| with_bend(of.block.clone(), radius))
            .collect();
        let printed = Printed::of_moves(&moves, |range| blended(&blocks[range], tolerance_mm));
        Ok(printed.of_text(text, self.state.left()))
    }
}

/// P of the last G64; 0 is any.
///
/// # Errors
/// Where there is none: exact stop is not modelled.
fn tolerance_mm(text: &str) -> Result<f64, String> {
    let line = text.lines().rev().find(|line| line.contains("G64"));
    let line = line.ok_or("no G64")?;
    let after = line.split('P').nth(1).unwrap_or("0");
    after.trim().parse().map_err(|_| format!("{line}: P"))
}

/// An arc's own acceleration: half of it is the bend's.
fn with_bend(block: Block, radius_mm: Option<f64>) -> Block {
    let Some(radius_mm) = radius_mm else {
        return block;
    };
    Block {
        speed_max: block
            .speed_max
            .min((0.5 * block.acceleration * radius_mm).sqrt()),
        acceleration: 0.5 * 3.0f64.sqrt() * block.acceleration,
        ..block
    }
}

impl Config {
    fn check(&self, way: &Way) -> Result<(), String> {
        match self.extruder_mm {
            Some([least, most]) if !(least..=most).contains(&way.to[EXTRUDER]) => Err(format!(
                "{} exceeds its limits {least}:{most}",
                self.extruder
            )),
            _ => Ok(()),
        }
    }

    fn block(&self, state: &State, way: &Way) -> Option<Block> {
        let turn = way.by[3..EXTRUDER]
            .iter()
            .map(|d| d * d)
            .sum::<f64>()
            .sqrt();
        let pushed = way.by[EXTRUDER].abs();
        // X Y Z, else U V W, else A B C.
        let lengths = [way.length_mm, pushed, turn];
        let length = lengths.into_iter().find(|length| *length > 1e-9)?;
        let direction = way.by.map(|d| d / length);
        let requested = match (way.rapid, way.seconds) {
            (true, _) => RAPID,
            (false, Some(seconds)) => length / seconds,
            (false, None) => state.feed / 60.0,
        };
        let fastest = within(&direction, &self.speed_max);
        Some(Block {
            length,
            direction,
            speed_max: requested.min(fastest).min(length / CYCLE_S),
            acceleration: within(&direction, &self.acceleration_max),
            entry_max: 0.0,
            entry_by: "no tangent blend",
        })
    }
}

/// Each block from 0 to 0 by half its acceleration, overlapping the next one; a profile's seconds are those up to the
/// start of the next.
fn blended(blocks: &[Block], tolerance_mm: f64) -> Vec<Profile> {
    let half = |block: &Block| Block {
        acceleration: 0.5 * block.acceleration,
        ..block.clone()
    };
    let mut profiles = Vec::new();
    for (i, block) in blocks.iter().enumerate() {
        let own = if blocks.len() == 1 {
            block.clone()
        } else {
            half(block)
        };
        let mut profile = trapezoid(&own, 0.0, 0.0);
        if let Some(next) = blocks.get(i + 1) {
            let overlap_s = blend_velocity(&own, &half(next), tolerance_mm) / own.acceleration;
            profile.seconds -= overlap_s;
        }
        profiles.push(profile);
    }
    profiles
}

/// Speed of a block, slowing down, at which the next begins.
fn blend_velocity(block: &Block, next: &Block, tolerance_mm: f64) -> f64 {
    let reachable = |of: &Block| (of.acceleration * of.length).sqrt().min(of.speed_max);
    let [own, other] = [reachable(block), reachable(next)];
    let longest_s = (block.length / own).min(next.length / other);
    let least_s = (own / block.acceleration).max(other / next.acceleration);
    let blend = own.min(longest_s.min(least_s) * block.acceleration);
    // Half the angle between the moves of X Y Z; where one has none, nothing bounds it.
    let dot: f64 = (0..3)
        .map(|axis| block.direction[axis] * next.direction[axis])
        .sum();
    let half_rad = 0.5 * (-dot).clamp(-1.0, 1.0).acos();
    let bends = [block, next]
        .iter()
        .all(|of| of.direction[..3].iter().any(|share| *share != 0.0));
    match tolerance_mm > 0.0 && bends && half_rad.cos() > 1e-3 {
        true => blend.min(2.0 * (block.acceleration * tolerance_mm / half_rad.cos()).sqrt()),
        false => blend,
    }
}

#[cfg(test)]
mod tests {
    //! Goal: what parabolic blends take. Method: equal moves in line, of which the time is in closed form.
    use super::*;

    fn machine() -> LinuxCnc {
        LinuxCnc::new(Config {
            speed_max: [250.0, 250.0, 20.0, 120.0, 120.0, 1000.0, 50.0],
            acceleration_max: [2000.0, 2000.0, 200.0, 1500.0, 1500.0, 20_000.0, 1000.0],
            extruder_mm: None,
            extruder: 'U',
        })
    }

    fn line(moves: u32, length_mm: f64, seconds: f64) -> String {
        let mut text = "G21 G90\nG64 P0.005\nG93\nG0 F3000\n".to_string();
        for k in 1..=moves {
            let x = f64::from(k) * length_mm;
            text += &format!("G1 X{x:.4} U{:.4} F{:.4}\n", 0.01 * x, 60.0 / seconds);
        }
        text + "G94\nM2\n"
    }

    #[test]
    fn short_moves_are_bound_by_their_acceleration() {
        // 100 moves of 0.4 mm at 60 mm/s requested: sqrt(1000 * 0.4) = 20 mm/s, the last slows down alone.
        let printed = machine()
            .print(&line(100, 0.4, 0.4 / 60.0))
            .expect("printed");
        let speed = 400.0f64.sqrt();
        let by_hand = 40.0 / speed + speed / 1000.0;
        assert!(
            (printed.seconds - by_hand).abs() < 1e-9,
            "{} {by_hand}",
            printed.seconds
        );
        // Moves of 10 mm have their speed: 3.6 mm are what 60 mm/s take.
        let printed = machine()
            .print(&line(10, 10.0, 10.0 / 60.0))
            .expect("printed");
        let by_hand = 100.0 / 60.0 + 60.0 / 1000.0;
        assert!(
            (printed.seconds - by_hand).abs() < 1e-9,
            "{} {by_hand}",
            printed.seconds
        );
    }

    #[test]
    fn corners_stay_within_p() {
        // A right angle: 45° of half angle, 2 sqrt(1000 * 0.005 / cos 45°) mm/s of blend.
        let text = "G64 P0.005\nG94\nG0 F3000\nG1 X10 U0.1 F3000\nG1 Y10 U0.2\nM2";
        let printed = machine().print(text).expect("printed");
        let blend = 2.0 * (1000.0 * 0.005 / 0.5f64.sqrt()).sqrt();
        let each = 10.0 / 50.0 + 50.0 / 1000.0;
        let by_hand = 2.0 * each - blend / 1000.0;
        assert!(
            (printed.seconds - by_hand).abs() < 1e-9,
            "{} {by_hand}",
            printed.seconds
        );
        assert!(machine().print("G1 X1 F60").is_err(), "no G64");
    }
}

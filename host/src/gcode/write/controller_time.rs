//! What a controller's own planner makes of the moves: its time, and what slows it down.
//!
//! In: moves as they are written, axis by axis, with the limits that the guide has the controller set. Out: seconds and the
//! most frequent reason that a move begins slower than requested. Printers' controllers and grblHAL look ahead over
//! straight moves of one acceleration each; they differ in what bounds the speed from a move to the next. LinuxCNC blends
//! no tangents where A B C or U move: each move speeds up by half its acceleration, overlapping the one before. An
//! estimate: without the controllers' buffers, minimum lengths and arcs of their own. A push of the extruder alone is
//! taken as rest, so that no more than a pass is held in memory.

use super::dialect::Dialect;
use super::limits::{AXES, AxisLimits, EXTRUDER, HEADING};

/// Corner velocities of X Y Z, mm/s, as RepRapFirmware and Marlin are set by the guide.
const JERK_MM_S: [f64; 3] = [10.0, 10.0, 1.0];
/// `square_corner_velocity` of Klipper, mm/s; of its extruder, mm/s; of the others' extruder.
const SQUARE_CORNER_MM_S: f64 = 5.0;
const EXTRUDER_CORNER_MM_S: [f64; 2] = [1.0, 30.0];
/// `$11` of grblHAL.
const DEVIATION_MM: f64 = 0.02;
/// Share of the moves that a reason slows down before it is reported.
const SHARE_TOLD: f64 = 0.01;

/// What slows moves down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlowedBy {
    /// Changes of the heading's speed from move to move.
    Heading,
    /// Corners of the path, by the accelerations of the axes that move.
    Corners,
    /// Moves too short for their acceleration, of which no tangents are blended.
    NoBlends,
}

impl SlowedBy {
    const ALL: [SlowedBy; 3] = [SlowedBy::Heading, SlowedBy::Corners, SlowedBy::NoBlends];

    /// For messages.
    pub fn text(self) -> &'static str {
        match self {
            SlowedBy::Heading => "changes of the heading's speed from move to move",
            SlowedBy::Corners => "corners, by the accelerations of the axes",
            SlowedBy::NoBlends => {
                "short moves, which it does not blend while the heading or the extruder moves"
            }
        }
    }
}

/// A move.
#[derive(Clone, Copy, Debug)]
struct Block {
    length: f64,
    direction: [f64; AXES],
    speed: f64,
    acceleration: f64,
    /// Fastest start by its junction, and why.
    entry: f64,
    by: Option<SlowedBy>,
}

/// Adds up.
#[derive(Clone, Debug)]
pub struct ControllerTime {
    dialect: Dialect,
    limits: AxisLimits,
    blocks: Vec<Block>,
    seconds: f64,
    moves: usize,
    slowed: [usize; SlowedBy::ALL.len()],
}

impl ControllerTime {
    /// None so far.
    pub fn new(dialect: Dialect, limits: AxisLimits) -> ControllerTime {
        ControllerTime {
            dialect,
            limits,
            blocks: Vec::new(),
            seconds: 0.0,
            moves: 0,
            slowed: [0; SlowedBy::ALL.len()],
        }
    }

    /// A move: what each axis goes, the length of X Y Z (along an arc), how long it is to last.
    pub fn add(&mut self, by: [f64; AXES], tip_mm: f64, seconds: f64) {
        let root = |axes: &[f64]| axes.iter().map(|d| d * d).sum::<f64>().sqrt();
        let turn_deg = root(&by[3..EXTRUDER]);
        let measure = match self.dialect {
            Dialect::GrblHal => root(&by),
            _ if tip_mm > 0.0 => tip_mm,
            _ if turn_deg > 0.0 => turn_deg,
            _ => by[EXTRUDER].abs(),
        };
        if measure <= 0.0 || seconds <= 0.0 {
            return;
        }
        let direction = by.map(|d| d / measure);
        let fastest = AxisLimits::within(&direction, &self.limits.speed);
        let mut block = Block {
            length: measure,
            direction,
            speed: (measure / seconds).min(fastest),
            acceleration: AxisLimits::within(&direction, &self.limits.acceleration),
            entry: 0.0,
            by: None,
        };
        let is_push = tip_mm <= 0.0 && turn_deg <= 0.0;
        if is_push {
            self.rest();
        } else if let Some(before) = self.blocks.last() {
            (block.entry, block.by) = self.junction(before, &block);
        }
        self.blocks.push(block);
        if is_push {
            self.rest();
        }
    }

    /// The moves before are done before the next begins.
    pub fn rest(&mut self) {
        let blocks = std::mem::take(&mut self.blocks);
        self.moves += blocks.len();
        self.seconds += match self.dialect {
            Dialect::LinuxCnc => self.blended_s(&blocks),
            _ => self.looked_ahead_s(&blocks),
        };
    }

    /// Seconds, and what slows the most moves down.
    pub fn finish(&mut self) -> (f64, Option<SlowedBy>) {
        self.rest();
        let least = SHARE_TOLD * self.moves as f64;
        let of_kinds = SlowedBy::ALL.into_iter().zip(self.slowed);
        let most = of_kinds.max_by_key(|(_, moves)| *moves);
        let told = most.filter(|(_, moves)| *moves as f64 > least);
        (self.seconds, told.map(|(kind, _)| kind))
    }

    fn looked_ahead_s(&mut self, blocks: &[Block]) -> f64 {
        let reach =
            |speed: f64, of: &Block| (speed * speed + 2.0 * of.acceleration * of.length).sqrt();
        let mut exits = vec![0.0; blocks.len()];
        let mut entry = 0.0f64;
        for (block, exit) in blocks.iter().zip(&mut exits).rev() {
            *exit = entry;
            entry = reach(entry, block).min(block.entry);
        }
        let (mut speed, mut seconds) = (0.0f64, 0.0);
        for (block, exit) in blocks.iter().zip(exits) {
            if speed < 0.999 * block.speed
                && let Some(by) = block.by
                && speed > 0.999 * block.entry
            {
                self.slowed[by as usize] += 1;
            }
            let exit = reach(speed, block).min(exit);
            seconds += trapezoid_s(block, speed, exit);
            speed = exit;
        }
        seconds
    }

    /// LinuxCNC: each from 0 to 0, the next beginning where this one slows down.
    fn blended_s(&mut self, blocks: &[Block]) -> f64 {
        let half = |of: &Block| Block {
            acceleration: 0.5 * of.acceleration,
            ..*of
        };
        let peak = |of: &Block| (of.acceleration * of.length).sqrt().min(of.speed);
        let mut seconds = 0.0;
        for (i, block) in blocks.iter().enumerate() {
            let own = half(block);
            seconds += trapezoid_s(&own, 0.0, 0.0);
            self.slowed[SlowedBy::NoBlends as usize] += usize::from(peak(&own) < 0.999 * own.speed);
            if let Some(next) = blocks.get(i + 1).map(half) {
                let longest_s = (own.length / peak(&own)).min(next.length / peak(&next));
                let slowing_s =
                    (peak(&own) / own.acceleration).max(peak(&next) / next.acceleration);
                let speed = peak(&own).min(own.acceleration * longest_s.min(slowing_s));
                seconds -= speed / own.acceleration;
            }
        }
        seconds
    }

    /// Fastest start behind a move.
    fn junction(&self, before: &Block, block: &Block) -> (f64, Option<SlowedBy>) {
        let speed = before.speed.min(block.speed);
        let least = match self.dialect {
            Dialect::Klipper => self.square_corner(before, block),
            Dialect::GrblHal => self.deviation(before, block),
            _ => self.jerk(before, block),
        };
        match least {
            Some((corner, by)) if corner < speed => (corner, Some(by)),
            _ => (speed, None),
        }
    }

    /// Klipper: square corners in X Y Z, corner velocities of the other axes, rest where X Y Z stand.
    fn square_corner(&self, before: &Block, block: &Block) -> Option<(f64, SlowedBy)> {
        let goes = |of: &Block| of.direction[..3].iter().any(|share| *share != 0.0);
        if !(goes(before) && goes(block)) {
            return Some((0.0, SlowedBy::Corners));
        }
        let change = |axis: usize| (before.direction[axis] - block.direction[axis]).abs();
        let heading = self.limits.corner(HEADING) / change(HEADING).max(1e-9);
        let extruder = EXTRUDER_CORNER_MM_S[0] / change(EXTRUDER).max(1e-9);
        let dot: f64 = (0..3)
            .map(|axis| before.direction[axis] * block.direction[axis])
            .sum();
        let half_sin = (0.5 * (1.0 + dot)).clamp(0.0, 1.0).sqrt();
        let half_cos = (0.5 * (1.0 - dot)).clamp(0.0, 1.0).sqrt();
        let mut corner = extruder;
        if half_sin < 1.0 && half_cos > 0.0 {
            let limit = self.limits.acceleration[0];
            let deviation = SQUARE_CORNER_MM_S * SQUARE_CORNER_MM_S * (2.0f64.sqrt() - 1.0) / limit;
            for of in [before, block] {
                let own = of.acceleration.min(limit);
                let by_angle = own * deviation * half_sin / (1.0 - half_sin);
                let by_length = 0.5 * of.length * own * half_sin / half_cos;
                corner = corner.min(by_angle.sqrt()).min(by_length.sqrt());
            }
        }
        Some(match heading < corner {
            true => (heading, SlowedBy::Heading),
            false => (corner, SlowedBy::Corners),
        })
    }

    /// RepRapFirmware and Marlin: the change of each axis' speed.
    fn jerk(&self, before: &Block, block: &Block) -> Option<(f64, SlowedBy)> {
        let corner = |axis: usize| match axis {
            0..3 => JERK_MM_S[axis],
            EXTRUDER => EXTRUDER_CORNER_MM_S[1],
            axis => self.limits.corner(axis),
        };
        let speeds = (0..AXES).map(|axis| {
            let change = (before.direction[axis] - block.direction[axis]).abs();
            let by = match axis {
                HEADING => SlowedBy::Heading,
                _ => SlowedBy::Corners,
            };
            (corner(axis) / change.max(1e-9), by)
        });
        speeds.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// grblHAL: the angle in all axes at once.
    fn deviation(&self, before: &Block, block: &Block) -> Option<(f64, SlowedBy)> {
        let (from, to) = (&before.direction, &block.direction);
        let dot: f64 = from.iter().zip(to).map(|(a, b)| a * b).sum();
        let half_sin = (0.5 * (1.0 + dot)).clamp(0.0, 1.0).sqrt();
        let across: [f64; AXES] = std::array::from_fn(|axis| to[axis] - from[axis]);
        let length = across.iter().map(|d| d * d).sum::<f64>().sqrt();
        if length < 1e-6 {
            return None;
        }
        let unit = across.map(|d| d / length);
        let acceleration = AxisLimits::within(&unit, &self.limits.acceleration);
        let corner = (acceleration * DEVIATION_MM * half_sin / (1.0 - half_sin)).sqrt();
        Some((corner, SlowedBy::Corners))
    }
}

/// Seconds of a trapezoid between two speeds.
fn trapezoid_s(block: &Block, entry: f64, exit: f64) -> f64 {
    let meeting = (0.5 * (entry * entry + exit * exit) + block.acceleration * block.length).sqrt();
    let peak = meeting.min(block.speed).max(entry).max(exit);
    let ramps = (2.0 * peak * peak - entry * entry - exit * exit) / (2.0 * block.acceleration);
    (2.0 * peak - entry - exit) / block.acceleration + (block.length - ramps).max(0.0) / peak
}

#[cfg(test)]
mod tests {
    //! Goal: moves last as the controllers' rules say. Method: two moves each, by hand.
    use super::*;

    fn seconds(dialect: Dialect, moves: &[([f64; AXES], f64)]) -> (f64, Option<SlowedBy>) {
        let mut time = ControllerTime::new(dialect, AxisLimits::BUILT_IN);
        for (by, seconds) in moves {
            let tip_mm = by[..3].iter().map(|d| d * d).sum::<f64>().sqrt();
            time.add(*by, tip_mm, *seconds);
        }
        time.finish()
    }

    #[test]
    fn a_square_corner_by_each_rule() {
        let legs = [
            ([10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.2),
            ([0.0, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.2),
        ];
        // 50 mm/s and 3000 mm/s²; each leg from rest to the corner's speed.
        let leg = |corner: f64| {
            let ramps = (2.0 * 2500.0 - corner * corner) / 6000.0;
            (100.0 - corner) / 3000.0 + (10.0 - ramps) / 50.0
        };
        let s = 0.5f64.sqrt();
        let across = (3000.0 * 2.0f64.sqrt() * DEVIATION_MM * s / (1.0 - s)).sqrt();
        for (dialect, corner) in [
            (Dialect::Klipper, 5.0),
            (Dialect::RepRapFirmware, 10.0),
            (Dialect::Marlin, 10.0),
            (Dialect::GrblHal, across),
        ] {
            let (own, by) = seconds(dialect, &legs);
            assert!((own - 2.0 * leg(corner)).abs() < 1e-9, "{dialect:?}: {own}");
            assert_eq!(by, Some(SlowedBy::Corners));
        }
    }

    #[test]
    fn headings_and_blends() {
        // 10 mm with 10 degrees, then with 1000: 200 of the difference of 99 a millimetre.
        let turns = [
            ([10.0, 0.0, 0.0, 0.0, 0.0, 10.0, 0.0], 0.2),
            ([10.0, 0.0, 0.0, 0.0, 0.0, 1000.0, 0.0], 2.0),
        ];
        for dialect in [Dialect::Klipper, Dialect::RepRapFirmware] {
            assert_eq!(seconds(dialect, &turns).1, Some(SlowedBy::Heading));
        }
        // Ten moves of 0.4 mm: sqrt(1500 * 0.4) mm/s, the last slows down alone.
        let short = [([0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01], 0.4 / 60.0); 10];
        let (own, by) = seconds(Dialect::LinuxCnc, &short);
        let speed = 600.0f64.sqrt();
        assert!((own - 4.0 / speed - speed / 1500.0).abs() < 1e-9, "{own}");
        assert_eq!(by, Some(SlowedBy::NoBlends));
    }
}

//! Programs of robot and gantry controllers, read as their manuals define them: text to motions and outputs.
//!
//! In: the files of a program. Out: [`Step`]s in the order in which the controller runs them, all numbers converted to
//! mm, degrees and seconds. Independent of the writers: each interpreter is written from its maker's manual and refuses
//! what it does not know. Not covered: what the controller's planner makes of the motions (see the time model).

pub mod block_time;
pub mod joints;
pub mod krl;
pub mod rapid;
pub mod sinumerik;
mod tokens;
pub mod urscript;

use std::fmt;

/// A file of a program: its name as the controller knows it, and its text.
#[derive(Clone, Debug)]
pub struct SourceFile {
    /// Name with its ending: `part.mod`.
    pub name: String,
    /// Text.
    pub text: String,
}

/// Where a program cannot be run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProgramError {
    /// File.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// What is wrong there.
    pub problem: String,
}

impl ProgramError {
    /// A problem in a line of a file.
    pub fn new(file: &str, line: usize, problem: impl Into<String>) -> Self {
        Self {
            file: file.into(),
            line,
            problem: problem.into(),
        }
    }
}

impl fmt::Display for ProgramError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}:{}: {}", self.file, self.line, self.problem)
    }
}

/// Where a motion leads.
#[derive(Clone, Debug, PartialEq)]
pub enum Target {
    /// Joint angles, degrees, and external axes (mm or degrees).
    Joints {
        /// The robot's axes.
        degrees: Vec<f64>,
        /// External axes that are given.
        external: Vec<f64>,
    },
    /// Pose of the tool in the work object's frame.
    Pose {
        /// Tip, mm.
        tip_mm: [f64; 3],
        /// Rows of the rotation from tool axes to the frame's.
        rotation: [[f64; 3]; 3],
        /// External axes that are given (mm or degrees); on a gantry its rotary axis.
        external: Vec<f64>,
        /// The joint solution, where the target names one.
        configuration: Option<Configuration>,
    },
}

/// A joint solution as its controller names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Configuration {
    /// RAPID's confdata: quadrants of axes 1, 4, 6, and the number of the solution.
    Quadrants {
        /// cf1, cf4, cf6.
        cf: [i32; 3],
        /// cfx.
        cfx: i32,
    },
    /// KRL's status and turn.
    StatusTurn {
        /// S.
        status: u32,
        /// T.
        turn: u32,
    },
}

/// How the tool goes to a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// All joints together.
    Joints,
    /// The tip on a straight line.
    Line,
    /// A control point of a spline.
    Spline,
}

/// A motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// File.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Where to.
    pub target: Target,
    /// How.
    pub way: Way,
    /// Speed of the tip, mm/s; of joints alone a share of the greatest, in `share`.
    pub speed_mm_s: f64,
    /// Speed of the tool's turning, degrees/s, where the language has it; infinite where nothing bounds it.
    pub turn_speed_deg_s: f64,
    /// Share of the greatest joint speeds, for motions of joints.
    pub share: f64,
    /// How near to the target the tip may leave the path, mm; 0 is an exact stop.
    pub blend_mm: f64,
    /// Seconds of the motion, where the block says its time; else `None`.
    pub seconds: Option<f64>,
    /// Name or number of the tool.
    pub tool: String,
    /// Name or number of the work object or base.
    pub frame: String,
}

impl Motion {
    /// A motion that stops, of a share of 1, whose speeds nothing bounds, without a tool and a frame.
    pub fn new(file: &str, line: usize, target: Target, way: Way) -> Self {
        Motion {
            file: file.into(),
            line,
            target,
            way,
            speed_mm_s: f64::INFINITY,
            turn_speed_deg_s: f64::INFINITY,
            share: 1.0,
            blend_mm: 0.0,
            seconds: None,
            tool: String::new(),
            frame: String::new(),
        }
    }
}

/// What the controller does next.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// A motion.
    Move(Motion),
    /// An output is set.
    Output {
        /// File.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Name or number.
        name: String,
        /// Value: volts, counts, or 0 and 1.
        value: f64,
        /// Distance before the end of the motion it belongs to, mm, where it is bound to one.
        before_end_mm: f64,
        /// Time after that place, s; negative before it.
        delay_s: f64,
    },
    /// Nothing moves for so long.
    Wait {
        /// Seconds.
        seconds: f64,
    },
    /// A line for the operator or a comment that is a label: layers.
    Note {
        /// Text.
        text: String,
    },
}

impl Step {
    /// An output in a line of a file that is set where the program is, and at once.
    pub fn output(file: &str, line: usize, name: impl Into<String>, value: f64) -> Self {
        Step::Output {
            file: file.into(),
            line,
            name: name.into(),
            value,
            before_end_mm: 0.0,
            delay_s: 0.0,
        }
    }
}

/// Rotation matrix (rows) of a unit quaternion (w, x, y, z).
pub fn rotation_of_quaternion([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ]
}

/// A line for each step, for tests; of a motion its speeds in mm/s and degrees/s, its share and its blend in mm, of a
/// pose the tip and the directions of the tool's x and z.
#[cfg(test)]
pub fn shown(steps: &[Step]) -> String {
    let line = |step: &Step| match step {
        Step::Move(m) => {
            let numbers = [m.speed_mm_s, m.turn_speed_deg_s, m.share, m.blend_mm];
            let names = (&m.tool, &m.frame, m.seconds);
            let (file, line, way, target) = (&m.file, m.line, m.way, &m.target);
            let target = match target {
                Target::Pose {
                    tip_mm,
                    rotation,
                    external,
                    configuration,
                } => {
                    let axes = [0, 2].map(|axis| rotation.map(|row| row[axis]));
                    format!("{tip_mm:.1?} {axes:.1?} {external:?} {configuration:?}")
                }
                joints => format!("{joints:.1?}"),
            };
            format!("{file}:{line} {way:?} {numbers:.2?} {names:?} {target}\n")
        }
        other => format!("{other:.2?}\n"),
    };
    steps.iter().map(line).collect()
}

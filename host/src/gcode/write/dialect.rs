//! What controllers differ in: letters, feed, extruder, retraction, start and end.
//!
//! In: a [`Dialect`]. Out: its rules. Feed of a move that also turns: Klipper, RepRapFirmware and Marlin
//! take F as the speed of X, Y, Z and let the other axes follow; of turns alone F is degrees a minute.
//! LinuxCNC and grblHAL are told the time of each move (G93), which no rule of mixed moves can change. Arcs: only
//! LinuxCNC runs them as arcs. RepRapFirmware and Marlin make chords of them, all axes evenly; Klipper's
//! `gcode_arcs` passes on X, Y, Z and E alone; grblHAL multiplies the F of G93 by the number of its chords and
//! takes it as mm/min (`mc_arc`).

/// Controllers that are written for; the texts are the command's help.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "command", derive(clap::ValueEnum))]
#[cfg_attr(feature = "command", value(rename_all = "lower"))]
pub enum Dialect {
    /// Klipper; the heading is a manual stepper with a G-code axis.
    Klipper,
    /// RepRapFirmware 3.
    RepRapFirmware,
    /// LinuxCNC; inverse time, U is the extruder.
    LinuxCnc,
    /// grblHAL; inverse time, U is the extruder.
    GrblHal,
    /// Marlin 2.1 with extra axes.
    Marlin,
}

/// How primes and retracts are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "command", derive(clap::ValueEnum))]
pub enum Retraction {
    /// G10 and G11, lengths set before (M207, SET_RETRACTION).
    Firmware,
    /// M228 retracts, M227 primes.
    Source,
    /// The extruder's axis back and forth.
    Extruder,
}

/// Arcs that a controller runs as a job has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArcsWritten {
    /// None.
    None,
    /// Those on which the heading stands.
    Standing,
    /// All.
    Turning,
}

impl Dialect {
    /// All of them.
    pub const ALL: [Dialect; 5] = [
        Dialect::Klipper,
        Dialect::RepRapFirmware,
        Dialect::LinuxCnc,
        Dialect::GrblHal,
        Dialect::Marlin,
    ];

    /// As options and headers call it.
    pub fn name(self) -> &'static str {
        match self {
            Dialect::Klipper => "klipper",
            Dialect::RepRapFirmware => "reprapfirmware",
            Dialect::LinuxCnc => "linuxcnc",
            Dialect::GrblHal => "grblhal",
            Dialect::Marlin => "marlin",
        }
    }

    /// Controllers of machine tools: inverse time, an axis as extruder, dwells in seconds.
    pub fn is_machine_tool(self) -> bool {
        matches!(self, Dialect::LinuxCnc | Dialect::GrblHal)
    }

    /// The extruder's letter.
    pub fn extruder(self) -> u8 {
        if self.is_machine_tool() { b'U' } else { b'E' }
    }

    /// Arcs that it runs with all its axes.
    pub fn arcs(self) -> ArcsWritten {
        match self {
            Dialect::LinuxCnc | Dialect::RepRapFirmware | Dialect::Marlin => ArcsWritten::Turning,
            Dialect::Klipper => ArcsWritten::Standing,
            Dialect::GrblHal => ArcsWritten::None,
        }
    }

    /// Arcs are written unless the user chooses otherwise: this controller does not split them into chords itself.
    pub fn writes_arcs_by_default(self) -> bool {
        self == Dialect::LinuxCnc
    }

    /// The heading follows the tip at the speeds of the file: its own acceleration limit is lifted on the job's moves.
    /// grblHAL takes corners by the acceleration of all axes at once, and LinuxCNC each move by its own.
    pub fn heading_follows(self) -> bool {
        !self.is_machine_tool()
    }

    /// The code that sets accelerations of axes, where the file has to set the heading's.
    pub(super) fn acceleration_code(self) -> Option<&'static str> {
        matches!(self, Dialect::RepRapFirmware | Dialect::Marlin).then_some("M201")
    }

    /// Moves a second that its buffer is trusted with: a bound of ours, from a line of 45 characters at
    /// 115200 baud for controllers that are fed over a line, and what planners keep up with else.
    pub fn moves_a_second_max(self) -> f64 {
        match self {
            Dialect::Klipper => 1000.0,
            Dialect::RepRapFirmware | Dialect::LinuxCnc => 500.0,
            Dialect::GrblHal | Dialect::Marlin => 250.0,
        }
    }

    /// Tip tolerance where none is given, mm, and that of headings and tilts, degrees. Moves are as long as what is
    /// promised of the path allows (5 µm, 0.05°) for LinuxCNC, where each of them speeds up from rest, and for
    /// grblHAL and Marlin, which take the fewest a second.
    pub fn tolerances(self) -> [f64; 2] {
        match self {
            Dialect::LinuxCnc | Dialect::GrblHal | Dialect::Marlin => [0.003, 0.04],
            _ => [super::TIP_TOLERANCE_MM, 0.02],
        }
    }

    /// What a controller has to be set to beside the limits of its axes, for those who export.
    pub fn needs(self) -> &'static str {
        match self {
            Dialect::Klipper => "[manual_stepper heading] without position_min and position_max",
            Dialect::RepRapFirmware => {
                "config.g with M566 of the heading as high as its acceleration over 20 ms (C24000 where the guide \
                 has it), and M208 without ends for it"
            }
            Dialect::Marlin => {
                "CLASSIC_JERK with the heading's jerk as high as its acceleration over 20 ms, and no software \
                 endstops for it"
            }
            Dialect::GrblHal => {
                "a build whose axes have the letters of the file (X Y Z A B C U: N_AXIS 7), $11=0.02, and no soft \
                 limits for heading and extruder"
            }
            Dialect::LinuxCnc => "[AXIS_C] and [AXIS_U] without MIN_LIMIT and MAX_LIMIT",
        }
    }

    /// What the moves need behind any start block, with fields: absolute places in mm, the extruder's mode, the heading's
    /// axis. Its zero is where it stands.
    pub(super) fn setup(self) -> &'static str {
        match self {
            Dialect::Klipper => "G21\nG90\nM83\nG92 {extruder}0\n",
            Dialect::RepRapFirmware | Dialect::Marlin => {
                "G21\nG90\nM83\nG92 {extruder}0 {heading}0\n"
            }
            Dialect::LinuxCnc => {
                "G21 G90 G91.1 G17 G40 G49 G80\nG64 P0.003\nG92 {extruder}0 {heading}0\nG93\n"
            }
            Dialect::GrblHal => "G21 G90 G17 G40 G49 G80\nG92 {extruder}0 {heading}0\nG93\n",
        }
    }

    /// End block, with fields: what a user may replace. The heading was turned back to a whole turn before; the tip goes
    /// up above all that was printed and to where the file began, and a tilted head back along its axis.
    pub fn end(self, tilts: bool) -> &'static str {
        match (self.is_machine_tool(), tilts) {
            (_, true) => "G1 X{lift_x} Y{lift_y} Z{lift_z} F600\n",
            (false, false) => "G0 Z{lift_z} F600\nG0 X{x} Y{y} F3000\n",
            (true, false) => "G0 Z{lift_z}\nG0 X{x} Y{y}\n",
        }
    }

    /// What stands behind any end block.
    pub(super) fn closing(self) -> &'static str {
        match self.is_machine_tool() {
            true => "M2\n",
            false => "M400\nM82\n",
        }
    }
}

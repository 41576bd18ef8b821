//! Everything the user can set: machine file, command-line overrides, defaults.
//!
//! Input: nothing (the built-in machine), a machine file ([`machine_file`]) or overrides on top.
//! Output: one immutable [`Settings`], checked by [`Settings::check`]. Angles are radians here and
//! degrees in the file. Leaves out the job itself: outline, scale and place are the input's.

pub mod aperture_text;
pub mod arms;
pub mod axes_words;
mod check;
mod choices;
pub mod curved_layers;
mod defaults;
pub mod directions;
pub mod drivers;
pub mod examples;
pub mod extruder_model;
mod groups;
pub mod head_shape;
mod heading_joint;
mod heading_motor;
pub mod heat;
mod keys;
pub mod kinds;
pub mod machine_file;
pub mod measure;
pub mod obstacles;
pub mod options;
pub mod probe;
pub mod pump;
mod switches;
pub(crate) mod units;
pub mod wide_beads;

pub use check::{joint_names, motor_rates_hz};
pub use choices::{HeadingLaw, PassMode, Place, Quality, SeamPlace};
pub use heading_joint::{WristStops, linear_joint_number};
pub use heading_motor::HeadingMotor;

use self::head_shape::HeadShape;
use self::obstacles::Obstacles;
use self::wide_beads::WideBeads;
use crate::geometry::aperture::Aperture;
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::configuration::board_name::BoardName;
use headway_firmware::configuration::drivers::DriversConfiguration;
use headway_firmware::configuration::heat::HeatConfiguration;
use headway_firmware::configuration::homing::HomingConfiguration;
use headway_firmware::configuration::wiring::Wiring;

/// Walls with straight lines inside, in place of beads all the way in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Infill {
    /// Loops from the outline inwards.
    pub walls: u32,
    /// Share of the ground inside the walls that the lines cover, per cent; 0 leaves it empty.
    pub density_pct: f64,
    /// From the middle of a line to that of the next, which sets the density with the widest bead.
    pub spacing_mm: Option<f64>,
    /// Direction of the lines of the first layer against the x axis; every other layer's lie
    /// across.
    pub angle_rad: f64,
    /// Solid layers from the bed up; `None`: [`BOTTOM_LAYERS`], where there is more than one layer.
    pub bottom_layers: Option<u32>,
    /// Solid layers from the top down; `None`: [`TOP_LAYERS`], where there is more than one layer.
    pub top_layers: Option<u32>,
}

/// Most layers of a job; its path is bounded as well.
pub const LAYERS_MAX: u32 = 10_000;
/// Solid layers below a sparse infill: 0.8 mm of 0.2 mm layers, as slicers have it.
pub const BOTTOM_LAYERS: u32 = 4;
/// Tool axes may be off by so much where a machine's axes line up: half a degree lifts the edge of a
/// bead a millimetre wide by 4 um.
pub const AXIS_TOLERANCE_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// More is no tolerance any more.
pub const AXIS_TOLERANCE_MAX_DEG: f64 = 10.0;
/// How far the tool axis may be allowed to lean at most, degrees.
pub const TILT_MAX_ASKED_DEG: f64 = 90.0;
/// Longest span of a bridge, in widest beads.
pub const BRIDGE_MAX_BEADS: f64 = 25.0;
/// Solid layers above a sparse infill: one more, since the first lies on gaps.
pub const TOP_LAYERS: u32 = 5;

impl Settings {
    /// The longest span that a bridge may have.
    pub fn longest_bridge_mm(&self) -> f64 {
        let by_bead_mm = BRIDGE_MAX_BEADS * 2.0 * self.aperture.major_mm();
        self.bridge_max_mm.unwrap_or(by_bead_mm)
    }
}

impl Infill {
    /// `walls` loops around a solid inside.
    pub fn solid(walls: u32) -> Infill {
        Infill {
            walls,
            density_pct: 100.0,
            spacing_mm: None,
            angle_rad: std::f64::consts::FRAC_PI_4,
            bottom_layers: None,
            top_layers: None,
        }
    }

    /// The lines of one of `layers` layers, counted from 0: solid at the bottom and the top, turned
    /// by 90° on every other one.
    pub fn of_layer(&self, layer: u32, layers: u32) -> Infill {
        let by_default = |solid: u32| if layers > 1 { solid } else { 0 };
        let bottom = self.bottom_layers.unwrap_or(by_default(BOTTOM_LAYERS));
        let top = self.top_layers.unwrap_or(by_default(TOP_LAYERS));
        let mut infill = Infill {
            bottom_layers: None,
            top_layers: None,
            ..*self
        };
        if layer < bottom || layers.saturating_sub(layer) <= top {
            infill.density_pct = 100.0;
        }
        if layer % 2 == 1 && infill.density_pct > 0.0 {
            infill.angle_rad += std::f64::consts::FRAC_PI_2;
        }
        infill
    }

    /// The lines of a layer inside the shells of a part, turned by 90° on every other one.
    pub fn inside(&self, layer: u32) -> Infill {
        let without_shells = Infill {
            bottom_layers: Some(0),
            top_layers: Some(0),
            ..*self
        };
        without_shells.of_layer(layer, layer + 1)
    }

    /// True where the lines leave nothing open on purpose.
    pub fn is_solid(&self) -> bool {
        self.density_pct >= 100.0
    }
}

/// Loops around the part, printed before it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Skirt {
    /// Loops at a distance.
    pub loops: u32,
    /// Loops that touch the part.
    pub brim_loops: u32,
    /// From the part, or its brim, to the innermost loop.
    pub distance_mm: f64,
}

/// Turn of a seam's direction, rad: on an edge of 1 mm 20 µm, more than noise of meshes, and on a curve of 15 mm a seam 0.3 mm
/// beside. Few parts have an edge in this direction.
const SEAM_TURN_RAD: f64 = 0.02;

/// Where loops begin and end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seam {
    /// Which place.
    pub place: SeamPlace,
    /// Direction of aligned seams against the x axis.
    pub direction_rad: f64,
}

impl Seam {
    /// The direction a little turned, so that of the two ends of an edge across it the same one is farther on all layers.
    /// Layers do not know of each other: in input coordinates it is the same for all.
    pub fn untied_rad(&self) -> f64 {
        self.direction_rad + SEAM_TURN_RAD
    }
}

impl Quality {
    /// Seconds that a mm² of ground is worth.
    pub fn price_s_mm2(self) -> f64 {
        match self {
            Quality::Fine => 16.0,
            Quality::Standard => 2.0,
            Quality::Fast => 0.8,
        }
    }
}

/// Tolerances of planning and fitting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerances {
    /// How far a placed aperture may leave the target.
    pub outside_mm: f64,
    /// Tip position of the finished segments against the path.
    pub tip_mm: f64,
    /// Tool axis of the finished segments against the path.
    pub axis_rad: f64,
    /// Heading of the finished segments against the path.
    pub heading_rad: f64,
    /// Flattening of input curves.
    pub flatten_mm: f64,
    /// How far a run of waypoints may leave its corners (`--corner-tolerance`); 0: the head rests at them.
    pub corner_mm: f64,
}

/// Prime and retract around each pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrimeRetract {
    /// Volume pulled back at a pass's end.
    pub retract_mm3: f64,
    /// Peak rate of the retract.
    pub retract_rate_mm3_s: f64,
    /// How long before the pass's end the retract begins.
    pub retract_lead_s: f64,
    /// Volume pushed at a pass's start.
    pub prime_mm3: f64,
    /// Peak rate of the prime.
    pub prime_rate_mm3_s: f64,
    /// How long before its end the pass may start to move.
    pub prime_lead_s: f64,
}

/// All settings of a job. Immutable once made; built by [`Settings::default`], a machine file and
/// the command line, checked by `Settings::check`.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Name of the machine, for messages and headers.
    pub machine_name: String,
    /// Joints, kinematics, limits (full limits; the plan uses `plan_share` of each).
    pub machine: MachineConfiguration,
    /// Work area (min, max) in machine coordinates, mm; inputs are centred over it on z_min
    /// unless `at_mm` says otherwise.
    pub work_area_mm: [[f64; 3]; 2],
    /// Machine coordinates of the input's origin (`--at`), mm; `None` centres the input.
    pub at_mm: Option<[f64; 3]>,
    /// Jump between two waypoints that ends a pass (`--gap`), mm; `None`: many times the usual spacing.
    pub gap_mm: Option<f64>,
    /// Where a part lies if `at_mm` does not say it (`--place`).
    pub place: Place,
    /// How far the tool axis may leave that of a run of waypoints where two rotary axes of the machine
    /// line up (`--axis-tolerance`), rad.
    pub axis_tolerance_rad: f64,
    /// How far the tool axis of a run of waypoints may lean from that given, to keep clear of what stands
    /// (`--tilt-max`), rad; `None` leaves it as it is.
    pub tilt_max_rad: Option<f64>,
    /// The nozzle's smallest printable feature.
    pub aperture: Aperture,
    /// Layers, all of the same outline.
    pub layers: u32,
    /// Layer height.
    pub layer_height_mm: f64,
    /// Height of the first layer of a mesh, where it differs.
    pub first_layer_height_mm: Option<f64>,
    /// Tip speed while printing.
    pub speed_mm_s: f64,
    /// Tip speed while travelling.
    pub travel_speed_mm_s: f64,
    /// Tip acceleration limit.
    pub tip_acceleration_mm_s2: f64,
    /// Lift of travel moves above the layer.
    pub lift_mm: f64,
    /// Letters of the tilts about X and Y and of the heading on another controller, which knows the tip of a head that tilts.
    pub gcode_letters: Option<[u8; 3]>,
    /// Axes of the machine that G-code which is read was written for, in the words of `--axes`.
    pub gcode_axes: Option<String>,
    /// Multiplier of the deposited volume.
    pub flow_factor: f64,
    /// Volumetric flow limit of dV/dt.
    pub flow_max_mm3_s: f64,
    /// Limit of d²V/dt².
    pub flow_rate_of_change_max_mm3_s2: f64,
    /// Prime and retract.
    pub prime_retract: PrimeRetract,
    /// Share of each limit that the plan uses.
    pub plan_share: f64,
    /// Controlled overlap between neighbouring passes, per cent of the bead width.
    pub overlap_pct: f64,
    /// Two-pass or one-pass.
    pub pass_mode: PassMode,
    /// Tangent or linear.
    pub heading_law: HeadingLaw,
    /// What ground is worth in seconds.
    pub quality: Quality,
    /// Walls and lines; `None` fills with beads along the outline.
    pub infill: Option<Infill>,
    /// Skirt and brim.
    pub skirt: Skirt,
    /// Radius of what surrounds the aperture and must keep out of keep-outs; 0 for the aperture
    /// alone.
    pub nozzle_body_radius_mm: f64,
    /// What of nozzle and head could touch the table or the print; `None` where it is not known.
    pub head: Option<HeadShape>,
    /// What stands on the machine beside the table, machine coordinates.
    pub obstacles: Obstacles,
    /// What the kinds of bead ask for where it differs.
    pub kinds: kinds::Kinds,
    /// Longest span of a bridge; `None`: [`BRIDGE_MAX_BEADS`].
    pub bridge_max_mm: Option<f64>,
    /// Least time of a layer, s; shorter ones are printed slower. 0 for none.
    pub layer_time_min_s: f64,
    /// Least tip speed that short layers are slowed to.
    pub slow_speed_min_mm_s: f64,
    /// What wide beads ask for.
    pub wide_beads: WideBeads,
    /// Seams of loops.
    pub seam: Seam,
    /// Travel stays inside the part where there is a way.
    pub avoid_crossing: bool,
    /// Tolerances.
    pub tolerances: Tolerances,
    /// Temperatures that a job sets, if it sets any.
    pub material: Option<heat::Material>,
    /// Heaters of the board, where they are not those that it has built in.
    pub heaters: Option<HeatConfiguration>,
    /// Drivers that the board sets up; none for those that stand alone.
    pub drivers: DriversConfiguration,
    /// What the motor of the heading joint can do, where it is known.
    pub heading_motor: Option<HeadingMotor>,
    /// The wrist that turns the nozzle, once a job's place is known; `None` for a joint of its own.
    pub wrist: Option<WristStops>,
    /// Switches to home to; `None`: the usual ones.
    pub switches: Option<HomingConfiguration>,
    /// Joints that would fall, a bit each: the board holds them when it lets the others go.
    pub hold: u8,
    /// Roles of the board's inputs, senses of its motors.
    pub wiring: Wiring,
    /// Which board the machine has, where it has to be said.
    pub board: Option<BoardName>,
    /// The probe, if there is one.
    pub probe: Option<probe::ProbeSettings>,
    /// The pump, where the machine's own controller drives it.
    pub pump: Option<pump::PumpOutput>,
    /// What corrects the flow of a running print, where that is not left to a sensor's program.
    pub measure: Option<measure::Measure>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sparse(bottom_layers: Option<u32>, top_layers: Option<u32>) -> Infill {
        Infill {
            density_pct: 20.0,
            bottom_layers,
            top_layers,
            ..Infill::solid(2)
        }
    }

    fn solid_layers(infill: &Infill, layers: u32) -> Vec<u32> {
        (0..layers)
            .filter(|&layer| infill.of_layer(layer, layers).is_solid())
            .collect()
    }

    #[test]
    fn solid_layers_are_at_the_bottom_and_the_top() {
        let by_default = sparse(None, None);
        assert_eq!(solid_layers(&by_default, 12), [0, 1, 2, 3, 7, 8, 9, 10, 11]);
        assert_eq!(solid_layers(&by_default, 9).len(), 9);
        // One layer is what its density says.
        assert_eq!(solid_layers(&by_default, 1), [] as [u32; 0]);
        assert_eq!(solid_layers(&sparse(Some(1), None), 1), [0]);
        assert_eq!(solid_layers(&sparse(Some(2), Some(0)), 12), [0, 1]);
        assert_eq!(solid_layers(&sparse(Some(0), Some(1)), 12), [11]);
        assert_eq!(solid_layers(&sparse(Some(50), Some(50)), 3), [0, 1, 2]);
    }

    #[test]
    fn lines_lie_across_those_of_the_layer_below() {
        let infill = sparse(Some(1), Some(1));
        let angle = |layer| infill.of_layer(layer, 5).angle_rad.to_degrees().round();
        assert_eq!([0, 1, 2, 3, 4].map(angle), [45.0, 135.0, 45.0, 135.0, 45.0]);
        let empty = Infill {
            density_pct: 0.0,
            ..sparse(Some(0), Some(0))
        };
        assert_eq!(empty.of_layer(0, 5), empty.of_layer(1, 5));
    }
}

//! A bed that is not flat: its heights, and a job that follows them.
//!
//! ```text
//! bed.toml --file--> BedMesh --surface--> shift of the tip in Z at (x, y, z)
//! SegmentStream --refined: spans of at most 2 mm--> --shifted control points--> --checked--> SegmentStream
//! ```
//! In: a finished job and a bed mesh, both in machine coordinates. Out: the same job over that bed: marks,
//! events, volumes and times are kept, only Z changes. The mesh is applied when a job is sent, not when it
//! is planned and not on the board: docs/design/bed-mesh.md gives the reasons. Every span is checked again
//! by the same code that the board runs. Not covered: probing (`cli/board/probe.rs`).

mod file;
mod refined;
mod surface;

use crate::text::refusal::{Refusal, refusal};
pub use file::{BedMeshFileError, from_toml, to_toml};

use crate::job::SegmentStream;
use crate::settings::joint_names;
use crate::text::short_number::Short;
use headway_firmware::configuration::MachineConfiguration;
use headway_firmware::path::load::{LoadModel, SpanFault};
use headway_firmware::path::spline::SpanWindow;
use headway_protocol::units::{CHANNEL_X, CHANNEL_Y, CHANNEL_Z, ChannelPoint, Units};
use refined::refined;

/// Longest span along the bed, mm. Control points are moved, not the curve: between them a bed with the
/// curvature m'' is missed by up to way² m'' / 6, 0.5 µm for a millimetre of warp in 100 mm.
const SPAN_MM: f64 = 2.0;
/// Default height up to which the mesh applies fully, mm above Z 0: Klipper's `fade_start`.
pub const FADE_START_MM: f64 = 1.0;
/// Default height from which it does not apply: Klipper's and Marlin's.
pub const FADE_HEIGHT_MM: f64 = 10.0;
/// Largest share by which a layer may be thicker or thinner than planned while the mesh is blended out.
pub const LAYER_SHARE_MAX: f64 = 0.05;

/// Heights of a bed.
#[derive(Clone, Debug, PartialEq)]
pub struct BedMesh {
    /// Hash of the machine whose bed it is.
    pub machine_hash: u32,
    /// Corner of the grid with the lowest x and y, mm, machine coordinates.
    pub min_mm: [f64; 2],
    /// The opposite corner.
    pub max_mm: [f64; 2],
    /// Z at which the nozzle touches the bed, mm: rows from the lowest y up, in each from the lowest x up.
    pub heights_mm: Vec<Vec<f64>>,
    /// Z up to which the job follows the bed fully, mm.
    pub fade_start_mm: f64,
    /// Z from which on it is planar, mm.
    pub fade_height_mm: f64,
}

/// A joint cannot follow.
pub fn span(at_s: f64, fault: SpanFault, joint: (&'static str, bool)) -> Refusal {
    refusal!(
        "over this bed, {} s into the job: {}",
        Short(at_s),
        fault_text(&fault, joint)
    )
}

fn fault_text(fault: &SpanFault, (name, is_rotary): (&'static str, bool)) -> String {
    match fault {
        SpanFault::SoftLimit(_, units) => {
            let (at, unit) = match is_rotary {
                true => ((f64::from(*units) * 1e-6).to_degrees(), "°"),
                false => (f64::from(*units) * 1e-4, " mm"),
            };
            format!(
                "joint {name} would be at {:.3}{unit}, out of its range; is Z 0 where the nozzle touches the bed?",
                at
            )
        }
        SpanFault::Limit(motor, permille) => format!(
            "motor {motor} would need {} times its limit; plan the job slower, or level the bed",
            Short(f64::from(*permille) * 1e-3)
        ),
        SpanFault::Kinematics(error) => format!("{error}; place the part elsewhere"),
    }
}

/// The job over a bed: the same for the same mesh.
///
/// # Errors
/// [`Refusal`].
pub fn over_bed(
    stream: &SegmentStream,
    mesh: &BedMesh,
    machine: &MachineConfiguration,
) -> Result<SegmentStream, Refusal> {
    let (of_mesh, of_job) = (mesh.machine_hash, machine.hash());
    if of_mesh != of_job {
        return Err(refusal!(
            "the mesh was probed with machine {of_mesh:08x}, the job is for {of_job:08x}; probe \
             the bed again with the machine file of the job"
        ));
    }
    mesh.check_fade()?;
    let mut over = refined(stream, SPAN_MM);
    let units = over.units;
    over.start = mesh.shifted(&over.start, &units);
    for knot in &mut over.knots {
        knot.control = mesh.shifted(&knot.control, &units);
    }
    check(&over, machine)?;
    Ok(over)
}

impl BedMesh {
    /// A pose of the plan over this bed, in the same units.
    pub fn shifted(&self, point: &ChannelPoint, units: &Units) -> ChannelPoint {
        let tip = [CHANNEL_X, CHANNEL_Y, CHANNEL_Z];
        let tip_mm = tip.map(|c| f64::from(point[c]) / units.per_natural(c));
        let shift = self.shift_mm(tip_mm) * units.per_natural(CHANNEL_Z);
        let mut shifted = *point;
        shifted[CHANNEL_Z] = point[CHANNEL_Z].saturating_add(shift.round() as i32);
        shifted
    }

    fn check_fade(&self) -> Result<(), Refusal> {
        let deviation_mm = self.deviation_mm();
        let fade_mm = [self.fade_start_mm, self.fade_height_mm];
        if deviation_mm > LAYER_SHARE_MAX * (fade_mm[1] - fade_mm[0]) {
            return Err(refusal!(
                "the bed is up to {} mm off its mean: blended out from {} to {} mm layers would \
                 be {} % off; a fade_height_mm of at least {} keeps to 5 %, a level bed is \
                 better",
                Short(deviation_mm),
                Short(fade_mm[0]),
                Short(fade_mm[1]),
                Short(100.0 * deviation_mm / (fade_mm[1] - fade_mm[0])),
                Short(fade_mm[0] + deviation_mm / LAYER_SHARE_MAX)
            ));
        }
        Ok(())
    }
}

/// Checks every span as the board will on arrival.
fn check(stream: &SegmentStream, machine: &MachineConfiguration) -> Result<(), Refusal> {
    let machine = stream.machine(machine);
    let mut loads = LoadModel::new(&machine);
    loads.take_units(&stream.units);
    let mut window = SpanWindow::at_rest(&stream.start);
    let mut winding = loads.winding_at(&stream.start);
    let mut ticks = 0u64;
    let joint = |fault: &SpanFault| match fault {
        SpanFault::SoftLimit(joint, _) => {
            let joint = usize::from(*joint);
            let name = joint_names(&machine.kinematics).get(joint);
            let is_rotary = machine.joints.get(joint).is_some_and(|joint| joint.rotary);
            (name.copied().unwrap_or_default(), is_rotary)
        }
        _ => ("", false),
    };
    for knot in &stream.knots {
        window.push(knot);
        loads.of_span(&window, &mut winding).map_err(|fault| {
            span(
                ticks as f64 / f64::from(machine.servo_hz),
                fault,
                joint(&fault),
            )
        })?;
        ticks += u64::from(window.duration_ticks());
    }
    Ok(())
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;

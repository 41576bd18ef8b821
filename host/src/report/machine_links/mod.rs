//! The machine as links that its joints move, which the page draws around the path.
//!
//! In: the machine's configuration (lengths in mm), its work area, the head's shape, the part's position.
//! Out: [`MachineLinks`], a tree of links. Each link has a frame in its parent's, a joint that slides or turns it
//! there, and convex solids. The relevant lengths are those of the kinematics, and a test checks the tool's
//! position against `headway_firmware::kinematics`; everything else (posts, beams, thickness) only makes the
//! machine recognisable. Not covered: drawing (`page/script/links.js`), and collisions.

mod machines;
mod solids;
#[cfg(test)]
mod tests;

use crate::job::transform::PartTransform;
use crate::settings::Settings;
use headway_firmware::configuration::{Frame, Kinematics, MachineConfiguration};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use serde::Serialize;

/// Corners of a convex solid in its link's frame, mm.
pub type Solid = Vec<[f64; 3]>;

/// The links of a machine; the first is the base, in the input's coordinates.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MachineLinks {
    /// Every link after its parent.
    pub links: Vec<Link>,
    /// The link with the part; its frame is the input's when all joints are at 0.
    pub part: usize,
    /// The link of the nozzle: its origin is the tip, its Z the tool axis, its X the long axis.
    pub tool: usize,
}

/// A link.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Link {
    /// The link that carries it; the base carries itself.
    pub parent: usize,
    /// Origin in the parent's frame, mm.
    pub origin_mm: [f64; 3],
    /// Rotation into the parent's frame, by rows.
    pub rotation: [[f64; 3]; 3],
    /// What moves it in that frame.
    pub joint: Option<LinkJoint>,
    /// Its appearance.
    pub solids: Vec<Solid>,
}

/// A joint between a link and its parent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LinkJoint {
    /// Number in the machine's joint order.
    pub number: usize,
    /// It slides (mm) instead of turning (rad).
    pub slides: bool,
    /// Along or about this axis of the link's frame: 0 is X.
    pub axis: usize,
    /// Model's motion = `sign` x joint - `zero`.
    pub sign: f64,
    /// See there.
    pub zero: f64,
}

impl LinkJoint {
    const fn new(number: usize, slides: bool, axis: usize) -> Self {
        Self {
            number,
            slides,
            axis,
            sign: 1.0,
            zero: 0.0,
        }
    }

    fn motion(&self, joints: &[f64]) -> Isometry3<f64> {
        let joint = joints.get(self.number).copied().unwrap_or_default();
        let by = self.sign * joint - self.zero;
        let axis = Vector3::ith(self.axis, 1.0);
        match self.slides {
            true => Translation3::from(by * axis).into(),
            false => Isometry3::rotation(by * axis),
        }
    }
}

impl MachineLinks {
    /// For a machine; `None` for one whose tool never tilts: the drawing from above shows
    /// everything.
    pub fn of(
        machine: &MachineConfiguration,
        settings: &Settings,
        transform: &PartTransform,
    ) -> Option<MachineLinks> {
        let look = machines::Look::of(machine, settings);
        let mut links = match &machine.kinematics {
            Kinematics::Planar => return None,
            Kinematics::Gantry { pivot_length_mm } => machines::gantry(&look, *pivot_length_mm),
            Kinematics::Trunnion { centre_mm, .. } => machines::trunnion(&look, *centre_mm),
            Kinematics::Arm6 { arm, .. } => machines::arm6(&look, arm),
            // Not drawn yet: the tool is.
            Kinematics::Axes { .. } => return None,
        };
        let offset_mm = transform.offset_mm;
        links.links[0].origin_mm = offset_mm.map(|mm| -mm);
        let on_the_table = links.part;
        let centre_mm = machines::table_centre_mm(&machine.kinematics);
        let from_centre = std::array::from_fn(|k| offset_mm[k] - centre_mm[k]);
        links.part = links.add(on_the_table, from_centre, None, Vec::new());
        Some(links)
    }

    fn on_ground(solids: Vec<Solid>) -> Self {
        let mut links = Self {
            links: Vec::new(),
            part: 0,
            tool: 0,
        };
        links.add(0, [0.0; 3], None, solids);
        links
    }

    /// Adds a link with its parent's axes, and returns its number.
    fn add(
        &mut self,
        parent: usize,
        origin_mm: [f64; 3],
        joint: Option<LinkJoint>,
        solids: Vec<Solid>,
    ) -> usize {
        self.links.push(Link {
            parent,
            origin_mm,
            rotation: Frame::IDENTITY.rotation,
            joint,
            solids,
        });
        self.links.len() - 1
    }

    /// Frames of all links in the input's coordinates, with the base fixed, for these joint positions
    /// (mm, rad).
    pub fn frames(&self, joints: &[f64]) -> Vec<Isometry3<f64>> {
        let mut frames: Vec<Isometry3<f64>> = Vec::with_capacity(self.links.len());
        for (number, link) in self.links.iter().enumerate() {
            let rotation = Matrix3::from_fn(|row, column| link.rotation[row][column]);
            let rotation = Rotation3::from_matrix_unchecked(rotation);
            let rest = Isometry3::from_parts(
                Translation3::from(Vector3::from(link.origin_mm)),
                UnitQuaternion::from_rotation_matrix(&rotation),
            );
            let parent = match link.parent < number {
                true => frames[link.parent],
                false => Isometry3::identity(),
            };
            let moved = link.joint.map(|joint| joint.motion(joints));
            frames.push(parent * rest * moved.unwrap_or_default());
        }
        frames
    }

    /// The tool's frame relative to the part, input coordinates: the result of forward kinematics.
    #[cfg(test)]
    pub fn tool_on_part(&self, joints: &[f64]) -> Isometry3<f64> {
        let frames = self.frames(joints);
        frames[self.part].inverse() * frames[self.tool]
    }
}

/// Directions at right angles to an axis and to each other.
fn across(axis: &Unit<Vector3<f64>>) -> [Vector3<f64>; 2] {
    let least = axis.iamin();
    let one = axis.cross(&Vector3::ith(least, 1.0)).normalize();
    [one, axis.cross(&one)]
}

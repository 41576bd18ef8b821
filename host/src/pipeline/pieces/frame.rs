//! The frame of a piece: its direction is up, by the smallest turn, as for a tool that leans.
//!
//! In: poses and places in the frame (mm). Out: the same in the part's coordinates. Headings stay what they are: the tool sees
//! the frame as it sees the plane when it is upright.

use crate::geometry::Point2;
use crate::job::SegmentStream;
use crate::job::transform::PartTransform;
use crate::mesh::{Mesh, Point3};
use crate::plan::route::clear_travel::moved_to;
use crate::plan::route::moves::{RouteMove, tip};
use headway_firmware::kinematics::pose::tilt_of_axis;
use headway_protocol::units::{CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNELS};
use nalgebra::{Rotation3, Vector2, Vector3};

/// How far an upright tool leans where that determines its joints: an edge 10 mm off the axis dips by 10 um.
const LEAN_RAD: f64 = 1e-3;

/// Where up is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    turn: Rotation3<f64>,
    tilt: Vector2<f64>,
}

impl Frame {
    /// Of a unit vector.
    pub(super) fn of(direction: &Vector3<f64>) -> Frame {
        let tilt = tilt_of_axis(direction);
        Frame {
            turn: Rotation3::new(Vector3::new(tilt.x, tilt.y, 0.0)),
            tilt,
        }
    }

    /// The same with a tool that leans a little towards another direction: where an upright one leaves a joint of the table or
    /// the head undetermined, that joint stays where the next piece needs it.
    pub(super) fn leaning(self, direction: &Vector3<f64>) -> Frame {
        let lean = tilt_of_axis(direction).try_normalize(0.0);
        Frame {
            tilt: self.tilt + LEAN_RAD * lean.unwrap_or_default(),
            ..self
        }
    }

    pub(super) fn to_part(self, place: Vector3<f64>) -> Vector3<f64> {
        self.turn * place
    }

    pub(super) fn of_part(self, place: Vector3<f64>) -> Vector3<f64> {
        self.turn.inverse() * place
    }

    /// A place of a level, seen from above in the part's coordinates.
    pub(super) fn seen(self, at: Point2, level_mm: f64) -> Point2 {
        Point2::from(self.to_part(Vector3::new(at.x, at.y, level_mm)).xy())
    }

    pub(super) fn mesh(self, mesh: &Mesh) -> Mesh {
        let vertices = mesh.vertices.iter();
        Mesh {
            vertices: vertices
                .map(|p| Point3::from(self.of_part(p.coords)))
                .collect(),
            triangles: mesh.triangles.clone(),
        }
    }

    /// Leans moves.
    pub(super) fn lean(self, moves: &mut [RouteMove]) {
        for pose in moves.iter_mut().flat_map(|own| &mut own.curve.control) {
            *pose = moved_to(pose, self.to_part(tip(pose)));
            (pose[CHANNEL_TILT_X], pose[CHANNEL_TILT_Y]) = (self.tilt.x, self.tilt.y);
        }
    }

    /// A stream on the machine as the frame sees it, to its units.
    pub(super) fn stream(self, stream: &SegmentStream, transform: &PartTransform) -> SegmentStream {
        let mut seen = stream.clone();
        let units = seen.units;
        let shift_mm = Vector3::from(transform.offset_mm);
        let of_machine = |point: &mut [i32; CHANNELS]| {
            let pose = units.to_natural(point);
            let own = units.of_natural(&moved_to(&pose, self.of_part(tip(&pose) - shift_mm)));
            point[..3].copy_from_slice(&own[..3]);
        };
        of_machine(&mut seen.start);
        seen.knots
            .iter_mut()
            .for_each(|knot| of_machine(&mut knot.control));
        seen
    }
}

//! The aperture for the sweep: points of its outline, contacts with the envelope, rows of its interior.
//!
//! In: an [`Aperture`], mm. Out: lengths in a (half its greatest width), f32, in the tool's frame. An ellipse and a
//! polygon with rounded corners implement the same queries.

use super::ellipse::{Ellipse, EllipseRows, POINTS as ELLIPSE_POINTS};
use super::rounded::{Rounded, RoundedRows};
use headway_geometry::aperture::Aperture;

/// Most points of an outline.
pub const OUTLINE_MAX: usize = 256;
/// Most contacts of one pose with the envelope.
pub const CONTACTS_MAX: usize = 8;
/// Share of the edge's half width by which the inside is smaller than the aperture: within it,
/// cover is full.
const RIM_SHARE: f32 = 0.85;
/// Depth of the inside that may be missed between two of its marks, in half widths.
const SCALLOP_SHARE: f32 = 0.35;
/// Depth of a strip below that, in half widths, and the largest height of a sharp corner's tip above the inside.
const SPARE_SHARE: f32 = 0.05;
const TIP_MAX: f32 = 4.0;
/// Most motion between two marks, in a, and the least.
const MARK_STEPS: [f32; 2] = [0.02, 2.0 / 15.0];
/// What makes another side nearer, in a: more than rounding.
const NEARER: f32 = 1e-3;
/// Least b that is done, in a.
const MINOR_MIN: f64 = 0.05;

/// A point of the outline with its outward unit normal, tool frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct OutlinePoint {
    /// Where, in a.
    pub point: [f32; 2],
    /// Outward unit normal.
    pub normal: [f32; 2],
}

/// A point of the outline that moves along the outline: there the outline touches the envelope of
/// the sweep.
#[derive(Clone, Copy, Debug, Default)]
pub struct Touch {
    /// The point.
    pub at: OutlinePoint,
    /// The point of [`Shape::outline`] before it.
    pub number: usize,
}

/// An aperture.
#[derive(Clone, Debug)]
pub struct Shape {
    kind: Kind,
    outline: Vec<OutlinePoint>,
    mark_step: f32,
    deep: f32,
}

#[derive(Clone, Debug)]
enum Kind {
    Ellipse(Ellipse),
    Rounded(Rounded),
}

/// Rows of the rotated aperture without a rim, about its axis.
#[derive(Clone, Debug)]
pub enum Inside {
    /// Of an ellipse.
    Ellipse(EllipseRows),
    /// Of a polygon.
    Rounded(RoundedRows),
}

impl Inside {
    /// Least and greatest y.
    pub fn heights(&self) -> [f32; 2] {
        match self {
            Inside::Ellipse(rows) => [-rows.height, rows.height],
            Inside::Rounded(rows) => rows.heights(),
        }
    }

    /// Least x, then greatest x in the rows at `ys`; empty (greatest below least) where it misses.
    #[inline]
    pub fn rows<const N: usize>(&self, ys: &[f32; N]) -> [[f32; N]; 2] {
        match self {
            Inside::Ellipse(rows) => rows.rows(ys),
            Inside::Rounded(rows) => rows.rows(ys),
        }
    }
}

impl Shape {
    /// The aperture in units of its own a, for an edge of this half width; `None` if the sweep does not
    /// support it.
    pub fn of(aperture: &Aperture, edge_half: f32) -> Option<Shape> {
        let (major_mm, minor_mm) = (aperture.major_mm(), aperture.minor_mm());
        let minor = minor_mm / major_mm;
        if !(MINOR_MIN..=1.0).contains(&minor) {
            return None;
        }
        let (rim, scallop) = (RIM_SHARE * edge_half, SCALLOP_SHARE * edge_half);
        let (kind, outline, mark_step, tip) = match aperture {
            Aperture::Ellipse { .. } => {
                let ellipse = Ellipse::new(minor as f32, rim);
                let step = ellipse.mark_step(scallop);
                (Kind::Ellipse(ellipse.clone()), ellipse.outline(), step, rim)
            }
            Aperture::Rounded(shape) => {
                let rounded = Rounded::new(shape, major_mm, rim);
                let (outline, step) = (rounded.outline(), rounded.mark_step(scallop));
                let tip = rounded.tip().min(TIP_MAX * edge_half);
                (Kind::Rounded(rounded), outline, step, tip)
            }
        };
        let [least, most] = MARK_STEPS;
        (outline.len() <= OUTLINE_MAX).then_some(Shape {
            kind,
            outline,
            mark_step: mark_step.clamp(least, most),
            deep: tip + scallop + SPARE_SHARE * edge_half,
        })
    }

    /// Points around the outline, counter-clockwise.
    pub fn outline(&self) -> &[OutlinePoint] {
        &self.outline
    }

    /// How far it reaches from its middle, in a.
    pub fn radius(&self) -> f32 {
        let points = self.outline.iter().map(|at| at.point);
        let squares = points.map(|[x, y]| x * x + y * y);
        squares.fold(0.0, f32::max).sqrt()
    }

    /// Motion between marks of the inside, in a.
    pub fn mark_step(&self) -> f32 {
        self.mark_step
    }

    /// Depth below the edge of the sweep to which a strip must include cells so that none is missed between it and
    /// the marks of the interior, in a.
    pub fn deep(&self) -> f32 {
        self.deep
    }

    /// The square of the gauge function, or an equivalent: below 1 inside, 1 on the outline.
    #[inline]
    pub fn gauge2(&self, at: [f32; 2]) -> f32 {
        match &self.kind {
            Kind::Ellipse(ellipse) => ellipse.gauge2(at),
            Kind::Rounded(rounded) => rounded.gauge2(at),
        }
    }

    /// Whether a point at this distance from one side of the outline is nearer to another side, so that the
    /// aperture ends there; never for an ellipse, which has no corners.
    #[inline]
    pub fn is_nearer(&self, at: [f32; 2], distance: f32) -> bool {
        match &self.kind {
            Kind::Ellipse(_) => false,
            Kind::Rounded(rounded) => rounded.signed_distance(at) > distance + NEARER,
        }
    }

    /// Clears `visible` where a point of the outline of a tool, rotated and shifted relative to this one, has a
    /// gauge below `least`.
    pub fn hide(&self, shift: [f32; 2], turn: [f32; 2], least: f32, visible: &mut [bool]) {
        match &self.kind {
            Kind::Ellipse(ellipse) => {
                let mut gauges = [0.0; ELLIPSE_POINTS];
                ellipse.outline_gauges(shift, turn, &mut gauges);
                for (seen, gauge) in visible.iter_mut().zip(&gauges) {
                    *seen &= *gauge >= least;
                }
            }
            Kind::Rounded(rounded) => {
                let [cos, sin] = turn;
                for (seen, outline) in visible.iter_mut().zip(&self.outline) {
                    let [x, y] = outline.point;
                    let there = [shift[0] + cos * x - sin * y, shift[1] + sin * x + cos * y];
                    *seen &= rounded.gauge2(there) >= least;
                }
            }
        }
    }

    /// Points where the outline moves along itself while the tool moves with `velocity` and turns with `turning`:
    /// at most [`CONTACTS_MAX`] touches into `found`; their number.
    pub fn touches(
        &self,
        velocity: [f32; 2],
        turning: f32,
        found: &mut [Touch; CONTACTS_MAX],
    ) -> usize {
        match &self.kind {
            Kind::Ellipse(ellipse) => ellipse.touches(velocity, turning, found),
            Kind::Rounded(rounded) => rounded.touches(velocity, turning, found),
        }
    }

    /// Rows of the aperture without its rim, not yet rotated.
    pub fn inside(&self) -> Inside {
        match &self.kind {
            Kind::Ellipse(ellipse) => Inside::Ellipse(ellipse.rows([1.0, 0.0])),
            Kind::Rounded(rounded) => Inside::Rounded(rounded.rows()),
        }
    }

    /// Turns the rows.
    pub fn turn_inside(&self, turn: [f32; 2], inside: &mut Inside) {
        match (&self.kind, inside) {
            (Kind::Ellipse(ellipse), Inside::Ellipse(rows)) => *rows = ellipse.rows(turn),
            (Kind::Rounded(rounded), Inside::Rounded(rows)) => rounded.turn_rows(turn, rows),
            _ => {}
        }
    }

    /// How far a place moves through the aperture at most, along a unit direction of the tool's frame.
    pub fn chord(&self, direction: [f32; 2]) -> f32 {
        match &self.kind {
            Kind::Ellipse(ellipse) => ellipse.chord(direction).min(2.0),
            Kind::Rounded(rounded) => rounded.chord(direction).min(2.0),
        }
    }
}

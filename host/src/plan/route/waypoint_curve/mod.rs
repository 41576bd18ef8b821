//! Waypoints -> C² curves from rest to rest: an interpolating cubic spline, cut at its corners.
//!
//! In: a [`WaypointRun`] (mm, input coordinates), the part's offset, tolerances and aperture. Out:
//! [`PathCurve`]s in machine coordinates that join end to end. Until the flow is known the volume channel
//! holds the relative excess of the bead's section over the nozzle's own: 0 if the waypoints have neither
//! widths nor heights. If they have sections it holds these, mm².
//!
//! ```text
//! waypoints -> runs between corners -> cubic spline over chord length
//!           -> even samples -> uniform B-spline through them, refined until it agrees
//! ```
//! Where no heading is given, a width turns the nozzle until it prints such a bead. A turn of more than
//! [`CORNER_RAD`] is a corner: the head comes to rest there, unless corners are rounded ([`rounding`]). Waypoints
//! at the same position turn the head in place. Cubic splines: C. de Boor, A Practical Guide to Splines (1978),
//! chapter 4. Not covered: flow (`waypoint_route`) and time.

pub mod chord_spline;
mod fit;
mod pieces;
pub mod rounding;

use crate::geometry::aperture::Aperture;
use crate::input::near_waypoints::usual_gap_mm;
use crate::input::waypoints::{PassAsked, SAME_PLACE_MM, Waypoint, WaypointRun};
use crate::plan::headings::stops::nearest_heading;
use crate::plan::route::clear_travel::UPRIGHT_RAD;
use crate::plan::route::moves::PathCurve;
use crate::settings::Settings;
use crate::text::refusal::{Refusal, refusal};
use chord_spline::Spline;
use headway_firmware::kinematics::pose::{tilt_of_axis, tool_axis};
use headway_protocol::units::{
    CHANNEL_HEADING, CHANNEL_TILT_X, CHANNEL_TILT_Y, CHANNEL_VOLUME, CHANNEL_X, CHANNEL_Y,
    CHANNEL_Z, CHANNELS,
};
use nalgebra::{Rotation3, Vector2, Vector3};
use pieces::{Piece, pieces};
use rounding::{RoundedCorners, RoundedSpline};
use std::f64::consts::{FRAC_PI_2, PI};

/// Turns of the path above this are corners.
pub const CORNER_RAD: f64 = PI / 6.0;
/// Most spans of a run, all moves together: 10 m at 10 µm.
const SPANS_MAX: usize = 1 << 20;
/// Least width and height of a bead between waypoints, against the least given one.
const BEAD_SHARE_MIN: f64 = 0.1;

type Point = [f64; CHANNELS];

/// A run's passes, each as moves from rest to rest, machine coordinates.
#[derive(Clone, Debug, Default)]
pub struct WaypointPasses {
    /// Their curves.
    pub passes: Vec<Vec<PathCurve>>,
    /// For each curve of all passes in order the speeds that its waypoints request: path parameter and mm/s; empty
    /// if they request none.
    pub speeds_mm_s: Vec<Vec<[f64; 2]>>,
    /// Requests of each pass.
    pub asked: Vec<PassAsked>,
    /// What became of their corners.
    pub rounded: RoundedCorners,
}

/// The run's passes.
///
/// # Errors
/// [`Refusal`] with the line.
pub fn waypoint_passes(
    run: &WaypointRun,
    offset_mm: [f64; 3],
    settings: &Settings,
) -> Result<WaypointPasses, Refusal> {
    check_tilt(&run.points, settings)?;
    check_speeds(&run.points, settings)?;
    let mut spans_left = SPANS_MAX;
    let mut all = WaypointPasses::default();
    // A waypoint between two jumps prints nothing.
    for points in divided(run, settings).filter(|points| points.len() > 1) {
        let (curves, rounded) = pass_curves(points, offset_mm, settings, &mut spans_left)?;
        let (curves, speeds): (Vec<_>, Vec<_>) = curves.into_iter().unzip();
        all.rounded = all.rounded.and(rounded);
        all.passes.push(curves);
        all.asked.push(points[0].asked);
        all.speeds_mm_s.extend(speeds);
    }
    Ok(all)
}

/// The waypoints of a run in the order of its passes: a jump ends one.
pub fn divided<'a>(
    run: &'a WaypointRun,
    settings: &Settings,
) -> impl Iterator<Item = &'a [Waypoint]> + use<'a> {
    let is_divided = run.points.iter().any(|point| point.begins);
    let gap_mm = settings.gap_mm.unwrap_or_else(|| match is_divided {
        true => f64::INFINITY,
        false => usual_gap_mm(&run.points),
    });
    let goes_on =
        move |a: &Waypoint, b: &Waypoint| !b.begins && (b.tip_mm - a.tip_mm).norm() <= gap_mm;
    run.points.chunk_by(goes_on)
}

/// A curve and the requested speeds along it.
type SpeedCurve = (PathCurve, Vec<[f64; 2]>);

/// One pass: its curves, with the requested speeds along each, and the treatment of its corners.
fn pass_curves(
    points: &[Waypoint],
    offset_mm: [f64; 3],
    settings: &Settings,
    spans_left: &mut usize,
) -> Result<(Vec<SpeedCurve>, RoundedCorners), Refusal> {
    let (pieces, rounded) = pieces(points, offset_mm, settings);
    let mut curves: Vec<SpeedCurve> = Vec::new();
    for piece in pieces {
        let points = piece.points;
        let before = curves
            .last()
            .and_then(|(curve, _)| curve.control.last().copied());
        let curve = move_curve(piece, settings, before, *spans_left)?;
        *spans_left = spans_left.saturating_sub(curve.control.len());
        if let (Some(from), Some(&to)) = (before, curve.control.first())
            && from[CHANNEL_HEADING] != to[CHANNEL_HEADING]
        {
            // The corner's two sides are oriented differently across the travel.
            let control = vec![from, to];
            curves.push((PathCurve { control }, Vec::new()));
        }
        let speeds = asked_speeds(points, &curve, settings);
        curves.push((curve, speeds));
    }
    Ok((curves, rounded))
}

/// The requested speeds along a move's curve, by its parameter; those without one print at the print
/// speed.
fn asked_speeds(points: &[Waypoint], curve: &PathCurve, settings: &Settings) -> Vec<[f64; 2]> {
    if points.iter().all(|point| point.speed_mm_s.is_none()) {
        return Vec::new();
    }
    let mut way_mm = 0.0;
    let ways = points.iter().enumerate().map(|(index, point)| {
        let before = points[index.saturating_sub(1)];
        way_mm += (point.tip_mm - before.tip_mm).norm();
        way_mm
    });
    let ways: Vec<f64> = ways.collect();
    let per_mm = curve.span_count() as f64 / ways.last().copied().unwrap_or(0.0).max(SAME_PLACE_MM);
    let speed_mm_s = |point: &Waypoint| point.speed_mm_s.unwrap_or(settings.speed_mm_s);
    let planned_mm_s = |point: &Waypoint| speed_mm_s(point) * settings.plan_share;
    let speeds = points.iter().zip(ways);
    speeds
        .map(|(point, way_mm)| [way_mm * per_mm, planned_mm_s(point)])
        .collect()
}

/// Speeds above the print speed would be cut without a word.
fn check_speeds(points: &[Waypoint], settings: &Settings) -> Result<(), Refusal> {
    for point in points {
        if let Some(asked_mm_s) = point
            .speed_mm_s
            .filter(|speed| *speed > settings.speed_mm_s)
        {
            return Err(refusal!(
                "line {line}: asks for {asked_mm_s} mm/s, more than the print speed of \
                 {print_mm_s} mm/s; raise that (--speed {asked_mm_s})",
                line = point.line,
                print_mm_s = settings.speed_mm_s
            ));
        }
    }
    Ok(())
}

fn check_tilt(points: &[Waypoint], settings: &Settings) -> Result<(), Refusal> {
    if settings.tilts() {
        return Ok(());
    }
    for point in points {
        let tilt_rad = point.axis.x.hypot(point.axis.y).atan2(point.axis.z);
        if tilt_rad > UPRIGHT_RAD {
            return Err(refusal!(
                "line {line}: the tool axis is tilted by {tilt_deg:.3}°, and this machine's \
                 head does not tilt; plan for another machine (--machine)",
                line = point.line,
                tilt_deg = tilt_rad.to_degrees()
            ));
        }
    }
    Ok(())
}

/// The pose of a waypoint, machine coordinates.
pub fn pose(point: &Waypoint, offset_mm: [f64; 3]) -> Point {
    let tilt = tilt_of_axis(&point.axis.into_inner());
    let mut pose = [0.0; CHANNELS];
    pose[CHANNEL_X] = point.tip_mm.x + offset_mm[0];
    pose[CHANNEL_Y] = point.tip_mm.y + offset_mm[1];
    pose[CHANNEL_Z] = point.tip_mm.z + offset_mm[2];
    pose[CHANNEL_TILT_X] = tilt.x;
    pose[CHANNEL_TILT_Y] = tilt.y;
    pose[CHANNEL_HEADING] = point.heading_rad.unwrap_or(0.0);
    pose
}

fn move_curve(
    piece: Piece,
    settings: &Settings,
    before: Option<Point>,
    spans_max: usize,
) -> Result<PathCurve, Refusal> {
    let (points, mut poses) = (piece.points, piece.poses);
    // A round nozzle prints the same at any heading: it need not turn.
    let across =
        !settings.aperture.is_round() && points.iter().any(|point| point.heading_rad.is_none());
    let near_rad = before.map_or(0.0, |before| before[CHANNEL_HEADING]);
    let Some(spline) = piece.spline else {
        if across {
            poses
                .iter_mut()
                .for_each(|pose| pose[CHANNEL_HEADING] = near_rad);
        }
        return Ok(PathCurve { control: poses });
    };
    let curve = Curve {
        beads: Beads::of(points, spline.knots(), settings),
        sections: sections(points, spline.knots()),
        spline,
        across,
        settings,
    };
    let fitted = curve.fit(points.len(), near_rad, spans_max);
    fitted.ok_or_else(|| {
        refusal!(
            "between lines {from} and {to} the waypoints are so uneven that their curve needs more \
         than {SPANS_MAX} spans; space them more evenly, or round no corners so closely \
         (--corner-tolerance)",
            from = points.first().map_or(0, |point| point.line),
            to = points.last().map_or(0, |point| point.line)
        )
    })
}

/// The curve that is meant: the spline, and the rule for the heading.
struct Curve<'a> {
    spline: RoundedSpline,
    /// Widths and heights of the bead, where they are given.
    beads: Option<Beads>,
    /// Sections of the bead, where they are: length of the move and mm², even in between.
    sections: Option<Vec<[f64; 2]>>,
    /// The major axis is across the travel, or oblique for a narrower bead.
    across: bool,
    settings: &'a Settings,
}

/// The sections along a move, where all of its waypoints have one.
fn sections(points: &[Waypoint], knots: &[f64]) -> Option<Vec<[f64; 2]>> {
    let of_point = |(point, s): (&Waypoint, &f64)| Some([*s, point.section_mm2?]);
    points.iter().zip(knots).map(of_point).collect()
}

/// The section at a place of a move, mm².
fn section_at(sections: &[[f64; 2]], s: f64) -> f64 {
    let next = sections.partition_point(|[at, _]| *at < s);
    let ends = [next.saturating_sub(1), next.min(sections.len() - 1)];
    let [[from, a], [to, b]] = ends.map(|index| sections[index]);
    match to > from {
        true => a + (b - a) * ((s - from) / (to - from)).clamp(0.0, 1.0),
        false => b,
    }
}

/// Widths and heights along a move.
struct Beads {
    /// Width in the first channel, height in the second, mm, over the length of the move.
    spline: Spline,
    has_width: bool,
}

impl Beads {
    fn of(points: &[Waypoint], knots: &[f64], settings: &Settings) -> Option<Beads> {
        let has_width = points.iter().all(|point| point.width_mm.is_some());
        if !has_width && points.iter().all(|point| point.height_mm.is_none()) {
            return None;
        }
        let values: Vec<Point> = points
            .iter()
            .map(|point| {
                let mut value = [0.0; CHANNELS];
                value[0] = point.width_mm.unwrap_or_default();
                value[1] = point.height_mm.unwrap_or(settings.layer_height_mm);
                value
            })
            .collect();
        Some(Beads {
            spline: Spline::over(knots.to_vec(), &values),
            has_width,
        })
    }

    /// Width (where it is given) and height at a place, mm. Between waypoints a spline may leave what they
    /// span: not below a tenth of the least.
    fn at(&self, s: f64) -> (Option<f64>, f64) {
        let value = self.spline.value(s);
        let least = |channel: usize| {
            let given = self.spline.points.iter().map(|point| point[channel]);
            BEAD_SHARE_MIN * given.fold(f64::INFINITY, f64::min)
        };
        let width_mm = self.has_width.then(|| value[0].max(least(0)));
        (width_mm, value[1].max(least(1)))
    }
}

impl Curve<'_> {
    /// The pose at chord length `s`, its heading near `near_rad` where the rule gives it.
    fn pose(&self, s: f64, near_rad: f64) -> Point {
        let mut pose = self.spline.value(s);
        if let Some(sections) = &self.sections {
            pose[CHANNEL_VOLUME] = section_at(sections, s);
        }
        let aperture = &self.settings.aperture;
        let bead = self.beads.as_ref().map(|beads| beads.at(s));
        let width_mm = bead.and_then(|(width_mm, _)| width_mm);
        if !self.across && bead.is_none() {
            return pose;
        }
        let direction = self.spline.slope(s);
        if self.across {
            // The angle between the major axis and the normal for such a bead.
            let aslant_rad =
                width_mm.map_or(0.0, |width_mm| aperture.angle_of_extent_rad(0.5 * width_mm));
            let period_rad = aperture.period_rad();
            let turned_rad = near_rad + aslant_rad;
            let across_rad = across_heading(&pose, &direction, turned_rad, period_rad);
            pose[CHANNEL_HEADING] = across_rad - aslant_rad;
        }
        if let Some((width_mm, height_mm)) = bead {
            let laid_mm = laid_width_mm(&pose, &direction, aperture);
            let wider = width_mm.map_or(1.0, |width_mm| width_mm / laid_mm);
            pose[CHANNEL_VOLUME] = wider * height_mm / self.settings.layer_height_mm - 1.0;
        }
        pose
    }
}

/// Heading with the major axis across the travel, as seen along the tool axis; the one of the equal
/// ones that is nearest. Where the travel is along the tool axis it stays.
fn across_heading(pose: &Point, direction: &Point, near_rad: f64, period_rad: f64) -> f64 {
    let travel = upright(pose) * Vector3::new(direction[0], direction[1], direction[2]);
    if travel.x.hypot(travel.y) < 1e-6 * travel.norm() {
        return near_rad;
    }
    nearest_heading(travel.y.atan2(travel.x) + FRAC_PI_2, near_rad, period_rad)
}

/// The nozzle's own bead width in this direction, mm.
fn laid_width_mm(pose: &Point, direction: &Point, aperture: &Aperture) -> f64 {
    let travel = upright(pose) * Vector3::new(direction[0], direction[1], direction[2]);
    let across = Vector2::new(-travel.y, travel.x);
    let across = across.try_normalize(1e-9).unwrap_or_else(Vector2::x);
    2.0 * aperture.extent_mm(pose[CHANNEL_HEADING], across)
}

/// Rotates the tool axis of a pose to Z: directions as seen by the tool, apart from its heading.
pub fn upright(pose: &Point) -> Rotation3<f64> {
    let tilt = Vector2::new(pose[CHANNEL_TILT_X], pose[CHANNEL_TILT_Y]);
    debug_assert!(tool_axis(tilt).norm() > 0.5);
    Rotation3::new(Vector3::new(tilt.x, tilt.y, 0.0)).inverse()
}

/// Half the bead width of the nozzle from one pose to the next, mm; the narrowest if it does not move.
pub fn half_width_mm(from: &Point, to: &Point, aperture: &Aperture) -> f64 {
    let step = upright(from) * Vector3::from_fn(|i, _| to[CHANNEL_X + i] - from[CHANNEL_X + i]);
    let across = Vector2::new(-step.y, step.x).try_normalize(1e-9);
    across.map_or(aperture.minor_mm(), |across| {
        aperture.support_mm(from[CHANNEL_HEADING], across)
    })
}

#[cfg(test)]
mod tests;

//! Detours of a curve where it crosses a wall and cannot be pushed out of it.
//!
//! Two consecutive placements may each fit while nothing between them does: the tip is on one side
//! of a corner of the walls in the first and on its other side in the second. Such a curve must be
//! led around, turned in another direction, not pushed. Input: control points, and the spans that
//! cut a wall however they are pushed. Output: control points with detours around those spans where
//! there are any.

use crate::geometry::clearance::Configuration;
use crate::geometry::plane_curve::{PlaneControl, configuration};
use crate::plan::coverage::connections::{CUT_SHARE, SLIDES, bent_connection};
use crate::plan::curve::pushing_inside::{InsideWalls, bad_runs, strayed_spans};
use crate::plan::headings::profile::slide_inside;
use crate::plan::joining::links::{LENGTH_SHARE, TURN_MAX_RAD};
use std::ops::Range;

/// Control points that a detour leaves out on either side of the spans, the fewest first: as far as
/// a link may extend if placements are as far apart as contacts usually are.
const BESIDE: [usize; 4] = [2, 4, 8, 16];
/// Control points beyond a detour that may be pushed along with it.
const MARGIN: usize = 8;

/// The curve with a detour around each group of bad spans that has one; `None` if none has.
pub fn detoured(
    control: &[PlaneControl],
    bad: &[bool],
    inside: &InsideWalls,
) -> Option<Vec<PlaneControl>> {
    let mut found: Option<Vec<PlaneControl>> = None;
    // From the last to the first: spans before a detour keep their numbers.
    for run in bad_runs(bad).into_iter().rev() {
        let control = found.as_deref().unwrap_or(control);
        let mut detours = BESIDE.into_iter();
        let around = detours.find_map(|beside| around(control, &run, beside, inside));
        found = around.or(found);
    }
    found
}

/// The curve with the shortest existing detour instead of the spans and as many control points on
/// either side; `None` if there is none or it cannot be pushed inside.
fn around(
    control: &[PlaneControl],
    run: &Range<usize>,
    beside: usize,
    inside: &InsideWalls,
) -> Option<Vec<PlaneControl>> {
    let first = run.start.checked_sub(beside)?;
    let last = run.end + beside;
    let (aperture, walls) = (inside.aperture, inside.walls);
    let slid =
        |at: &PlaneControl| slide_inside(configuration(*at), aperture, walls, SLIDES, CUT_SHARE);
    let (from, to) = (slid(&control[first])?, slid(control.get(last)?)?);
    if (to.center - from.center).norm() > LENGTH_SHARE * aperture.major_mm() {
        return None;
    }
    let way = bent_connection(from, to, TURN_MAX_RAD, aperture, walls)?;
    // Headings are unwrapped.
    let turned_rad = way.last()?.heading_rad - control[last][2];
    let of = |at: &Configuration| [at.center.x, at.center.y, at.heading_rad];
    let mut led = control[..first].to_vec();
    led.push(of(&from));
    led.extend(way.iter().map(of));
    let beyond = led.len();
    let rest = control[last + 1..].iter();
    led.extend(rest.map(|[x, y, heading]| [*x, *y, heading + turned_rad]));
    let about = first.saturating_sub(MARGIN)..(beyond + MARGIN).min(led.len());
    let mut pushed = led[about.clone()].to_vec();
    let still_cuts = inside.project(&mut pushed).contains(&true);
    let strays = strayed_spans(&led[about], &pushed, inside.near_mm()).contains(&true);
    (!still_cuts && !strays).then_some(led)
}

//! Passes: divides one region into bead channels and runs of contacts, each with its placements.
//!
//! 1. Where one bead across is cheaper than two sides, the region is cut off by chords between the
//!    feet of the axis: single beads along the axis.
//! 2. What remains is tiled by k beads between wall and axis ([`super::bead_count`]); the channel
//!    field gives each channel's outer wall, moved onto the edge of earlier beads
//!    ([`super::channel_walls`]); contacts along it get the heading profile.
//! 3. The innermost beads share out the gap or overlap between them.
//!
//! Input: region (mm), pruned axis. Output: [`LayerPass`]es, unordered, in region coordinates.

use crate::geometry::aperture::Aperture;
use crate::geometry::edge_index::{Edge, EdgeIndex};
use crate::geometry::polygon::{Region, Ring};
use crate::geometry::{Point2, Vector2};
use crate::plan::axis::pruned_axis::Axis;
use crate::plan::beads::bead_count::{ChannelWidths, bead_counts, blended};
use crate::plan::beads::channel_walls::Laid;
use crate::plan::beads::field::Field;
use crate::plan::beads::single_bead_runs::{Piece, SingleRun, split_region};
use crate::plan::coverage::idle_passes::drop_idle;
use crate::plan::headings::contacts::{ContactSpacing, resampled, wall_contacts};
use crate::plan::headings::profile::profile;
use crate::plan::headings::runs::{feasible_runs, printable_runs, trim_ends};
use crate::plan::pass::{Contact, LayerPass, PassKind, Placement};
use crate::settings::HeadingLaw;
use rayon::prelude::*;

/// What the pass planner needs of the settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassSettings {
    /// The nozzle.
    pub aperture: Aperture,
    /// Wanted overlap of neighbouring beads, share of the bead width.
    pub overlap: f64,
    /// Put one pass on the axis wherever the aperture spans the passage.
    pub one_pass: bool,
    /// How a width becomes a heading angle.
    pub law: HeadingLaw,
    /// What turning weighs there, mm².
    pub turn_weight_mm4: f64,
}

impl PassSettings {
    /// The placements on a run of contacts.
    fn placements(&self, contacts: &[Contact], closed: bool, walls: &EdgeIndex) -> Vec<Placement> {
        let aperture = &self.aperture;
        profile(contacts, closed, self.turn_weight_mm4, aperture, walls)
    }

    /// How far each of two neighbouring beads reaches over the line between their channels, against
    /// the width of its own: beads as wide as their channels / (1 - overlap) overlap by that share
    /// of their width.
    fn reach_over_share(&self) -> f64 {
        0.5 * self.overlap / (1.0 - self.overlap)
    }

    /// The width of a bead from the outer wall of its channel, `width_mm` from the inner one: for
    /// all but the outermost the outer wall is already moved out by as much as the bead extends over
    /// it.
    fn bead_width_mm(&self, width_mm: f64, channel: usize) -> f64 {
        let over = self.reach_over_share();
        let own = if channel == 1 { 1.0 } else { 1.0 + over };
        width_mm * (1.0 + over / own)
    }

    /// The extent across the passage at the law's angle for half a bead width of `half_mm`: the same for the
    /// tangent law; for the linear law that of |alpha| = (1 - w) 90° with w = (half - b) / (a - b), which is r
    /// of docs/design/heading-law.md halved in two-pass and r itself in one-pass.
    pub fn law_extent_mm(&self, half_mm: f64) -> f64 {
        let (a, b) = (self.aperture.major_mm(), self.aperture.minor_mm());
        match self.law {
            HeadingLaw::Tangent => half_mm,
            HeadingLaw::Linear if a - b < 1e-9 => half_mm,
            HeadingLaw::Linear => {
                let weight = ((half_mm - b) / (a - b)).clamp(0.0, 1.0);
                self.aperture
                    .extent_at_angle_mm((1.0 - weight) * std::f64::consts::FRAC_PI_2)
            }
        }
    }
}

/// Most channels of one piece; a wider region is left with its middle open, which the coverage
/// figure shows.
const CHANNELS_MAX: usize = 4096;

/// Spacing of contacts, of the field's nodes and of the axis' nodes, against b.
const SPACING_SHARE: f64 = 0.5;
/// Length over which a change of bead count is blended, against a.
const BLEND_SHARE: f64 = 2.0;
/// Half-window of normal smoothing, against b.
const SMOOTHING_SHARE: f64 = 0.75;
/// Least turn of a wall that is a corner, rad.
pub const CORNER_RAD: f64 = 0.35;
/// Turn between the contacts of the fan at a corner, rad.
const FAN_RAD: f64 = 0.14;

/// Lengths that the pass planner derives from the aperture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lengths {
    /// Contact spacing, mm.
    pub contact_mm: f64,
    /// Grid step of the channel field, mm.
    pub grid_mm: f64,
    /// Node spacing of the axis, mm.
    pub axis_mm: f64,
    /// Length over which a change of bead count is blended, mm.
    pub blend_mm: f64,
    /// Half-window of normal smoothing, mm.
    pub smoothing_mm: f64,
}

impl Lengths {
    /// All in proportion to the semi-axes.
    pub fn of(aperture: &Aperture) -> Lengths {
        let (a, b) = (aperture.major_mm(), aperture.minor_mm());
        Lengths {
            contact_mm: SPACING_SHARE * b,
            grid_mm: SPACING_SHARE * b,
            axis_mm: SPACING_SHARE * b,
            blend_mm: BLEND_SHARE * a,
            smoothing_mm: SMOOTHING_SHARE * b,
        }
    }

    /// Spacing of wall contacts.
    pub fn spacing(&self) -> ContactSpacing {
        ContactSpacing {
            spacing_mm: self.contact_mm,
            smoothing_mm: self.smoothing_mm,
            corner_rad: CORNER_RAD,
            fan_rad: FAN_RAD,
        }
    }
}

/// All passes of one region within `walls`, its own edges.
pub fn passes(
    region: &Region,
    walls: &EdgeIndex,
    axis: &Axis,
    settings: &PassSettings,
) -> Vec<LayerPass> {
    outer_passes(region, walls, axis, settings, CHANNELS_MAX).0
}

/// The outermost `channels` loops of one region, and the rings that bound the remaining area,
/// inside on the left (they may cross themselves slightly).
pub fn outer_passes(
    region: &Region,
    walls: &EdgeIndex,
    axis: &Axis,
    settings: &PassSettings,
    channels: usize,
) -> (Vec<LayerPass>, Vec<Ring>) {
    let lengths = Lengths::of(&settings.aperture);
    let axis = axis.densified(lengths.axis_mm);
    let axis = axis.split_at_radius(settings.aperture.minor_mm());
    let split = split_region(region, walls, &axis, settings);
    let found: Vec<(Vec<LayerPass>, Vec<Ring>)> = split
        .pieces
        .par_iter()
        .map(|piece| {
            // Most regions are one piece.
            let own = (piece.region != *region)
                .then(|| EdgeIndex::of_region(&piece.region, settings.aperture.major_mm()));
            let walls = own.as_ref().unwrap_or(walls);
            piece_passes(piece, walls, settings, lengths, channels)
        })
        .collect();
    let (mut all, mut open) = (Vec::new(), Vec::new());
    for (passes, rings) in found {
        all.extend(passes);
        open.extend(rings);
    }
    let singles: Vec<LayerPass> = split
        .runs
        .par_iter()
        .flat_map(|run| single_passes(run, walls, settings))
        .collect();
    all.extend(singles);
    drop_idle(&mut all, &settings.aperture, &region.bounds());
    (all, open)
}

/// At most `channels` channels of one piece, outermost first, and the outer wall of the next.
fn piece_passes(
    Piece {
        region: piece,
        axis,
    }: &Piece,
    walls: &EdgeIndex,
    settings: &PassSettings,
    lengths: Lengths,
    channels: usize,
) -> (Vec<LayerPass>, Vec<Ring>) {
    if axis.points.is_empty() {
        return (Vec::new(), Vec::new());
    }
    let aperture = &settings.aperture;
    let widths = ChannelWidths::of(aperture, settings.overlap);
    let counts = bead_counts(axis, widths);
    let beads = blended(axis, &counts, lengths.axis_mm, lengths.blend_mm, widths);
    let field = Field::new(walls, axis, &beads, widths.most_mm, lengths.grid_mm);
    let needed = (field.max().ceil() as usize).max(1);
    let mut laid = Laid::new(aperture);
    let mut all = Vec::new();
    for channel in 1..=channels.min(needed) {
        let found = channel_passes(channel, piece, walls, &field, &laid, settings, lengths);
        for pass in &found {
            laid.add(&pass.placements, pass.closed);
        }
        all.extend(found);
    }
    let open = if needed > channels {
        channel_rings(channels + 1, piece, &field, &laid, settings, lengths)
    } else {
        Vec::new()
    };
    (all, open)
}

/// The outer wall of a channel: the outline, or the level curve moved onto earlier beads.
fn channel_rings(
    channel: usize,
    piece: &Region,
    field: &Field,
    laid: &Laid,
    settings: &PassSettings,
    lengths: Lengths,
) -> Vec<Ring> {
    if channel == 1 {
        return piece.rings().cloned().collect();
    }
    let widths = ChannelWidths::of(&settings.aperture, settings.overlap);
    // The bead before this one reaches over its channel's inner wall, and this one as far back.
    let overlap_mm = |wall: Point2, normal: Vector2| {
        if settings.overlap == 0.0 {
            return 0.0;
        }
        let before = wall - normal * lengths.grid_mm;
        let rise = field.at(wall) - field.at(before);
        let width_mm = lengths.grid_mm / rise.max(1e-6);
        // Of a nozzle that is round or nearly so the widest bead, with room for corners, is below the narrowest.
        let least_mm = widths.least_mm.min(widths.most_mm);
        2.0 * settings.reach_over_share() * width_mm.clamp(least_mm, widths.most_mm)
    };
    field
        .level_rings((channel - 1) as f64)
        .iter()
        // Grid step and contact spacing are half of b: shorter rings hold nothing.
        .filter(|ring| ring.perimeter_mm() > 8.0 * lengths.contact_mm)
        .map(|ring| resampled(ring, lengths.contact_mm, 4))
        .map(|ring| laid.moved_wall(&ring, lengths.contact_mm, overlap_mm))
        .collect()
}

/// The passes of one channel: one for each ring of its outer wall, or several where parts of the
/// ring hold no bead.
fn channel_passes(
    channel: usize,
    piece: &Region,
    walls: &EdgeIndex,
    field: &Field,
    laid: &Laid,
    settings: &PassSettings,
    lengths: Lengths,
) -> Vec<LayerPass> {
    let aperture = &settings.aperture;
    let rings = channel_rings(channel, piece, field, laid, settings, lengths);
    let own_walls;
    let channel_walls = if channel == 1 {
        walls
    } else {
        let edges = rings
            .iter()
            .flat_map(|r| r.edges())
            .map(|(a, b)| Edge { a, b })
            .collect();
        own_walls = EdgeIndex::new(edges, aperture.major_mm());
        &own_walls
    };
    let of_ring = |ring: &Ring| {
        let mut found = Vec::new();
        let mut contacts = wall_contacts(ring, lengths.spacing());
        for contact in &mut contacts {
            let width = channel_width_mm(contact, channel, field, lengths.grid_mm, aperture);
            contact.extent_mm = 0.5 * settings.bead_width_mm(width, channel);
        }
        for (mut run, closed) in printable_runs(&contacts, aperture) {
            for contact in &mut run {
                contact.extent_mm = settings.law_extent_mm(contact.extent_mm);
            }
            let placements = settings.placements(&run, closed, channel_walls);
            found.extend(feasible_runs(placements, closed, aperture).into_iter().map(
                |(placements, closed)| LayerPass {
                    kind: PassKind::TwoPass,
                    channel: channel as u32,
                    closed,
                    placements,
                    then: Vec::new(),
                },
            ));
        }
        found
    };
    let mut found: Vec<LayerPass> = rings.par_iter().flat_map_iter(of_ring).collect();
    let open = found.iter_mut().filter(|pass| !pass.closed);
    open.for_each(|pass| trim_ends(&mut pass.placements));
    drop_stubs(&mut found, channel, aperture);
    found
}

/// Least slope of the field towards a channel's inner wall, relative to that at its outer wall.
/// Beyond the bisector of a right corner the slope is zero: there neither rounding nor slight noise
/// may decide.
const SLOPE_SHARE_MIN: f64 = 0.03;
/// Farthest that the inner wall is sought, against a: farther than any channel is wide.
const REACH_SHARE: f64 = 2.5;

/// Distance along the normal from the channel's outer wall to its inner one (or to the axis).
fn channel_width_mm(
    contact: &Contact,
    channel: usize,
    field: &Field,
    grid_mm: f64,
    aperture: &Aperture,
) -> f64 {
    let target = channel as f64;
    let step = 0.25 * grid_mm;
    let reach = REACH_SHARE * aperture.major_mm();
    let at = |t: f64| field.at(contact.point + contact.normal * t);
    let (mut t, mut last) = (grid_mm, at(grid_mm));
    let slope = (last - (target - 1.0)).max(0.0) / grid_mm;
    let rise_min = SLOPE_SHARE_MIN * slope * step;
    // The rise of the last two steps.
    let mut rises = [slope * step; 2];
    while last < target && t < reach {
        let v = at(t + step);
        if v >= target {
            return t + step * (target - last) / (v - last);
        }
        if v < last + rise_min {
            // The rise ended within the last step: where it would have been at its own slope.
            let share = (rises[1] / rises[0].max(1e-12)).clamp(0.0, 1.0);
            return t - step * (1.0 - share);
        }
        rises = [rises[1], v - last];
        (t, last) = (t + step, v);
    }
    t
}

/// Drops runs that are too short for a pass. If that would drop all of a piece (a room that the
/// aperture enters but can hardly move in), its longest run stays: whether it covers anything that
/// others do not is checked once all exist ([`drop_idle`]).
fn drop_stubs(found: &mut Vec<LayerPass>, channel: usize, aperture: &Aperture) {
    let is_long = |pass: &LayerPass| {
        let open_min_mm = RUN_SHARE_MIN * aperture.major_mm();
        pass.length_mm() > if pass.closed { 0.0 } else { open_min_mm }
    };
    if channel == 1 && !found.iter().any(is_long) {
        let longest = |p: &LayerPass, q: &LayerPass| p.length_mm().total_cmp(&q.length_mm());
        let longest = found.drain(..).max_by(longest);
        found.extend(longest.filter(|pass| pass.placements.len() > 1));
        return;
    }
    found.retain(is_long);
}

/// Shortest open run of a channel against a: a shorter one would deposit a blot on its neighbours.
const RUN_SHARE_MIN: f64 = 2.0;

/// A single run on the axis: the aperture spans the passage.
fn single_passes(run: &SingleRun, walls: &EdgeIndex, settings: &PassSettings) -> Vec<LayerPass> {
    let placements = settings.placements(&run.contacts, run.closed, walls);
    feasible_runs(placements, run.closed, &settings.aperture)
        .into_iter()
        .map(|(placements, closed)| LayerPass {
            kind: PassKind::OnePass,
            channel: 0,
            closed,
            placements,
            then: Vec::new(),
        })
        .filter(|pass| pass.length_mm() > 0.5 * settings.aperture.minor_mm())
        .collect()
}

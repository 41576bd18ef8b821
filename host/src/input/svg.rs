//! SVG: the filled shapes of a page, curves flattened.
//!
//! usvg resolves styles, uses, units, transforms and the view box to CSS pixels (96 to the inch);
//! here they become mm from the page's lower left corner with y up, so that a part is printed as
//! displayed. With a unit given, one user unit of the page (of its viewBox) is that long. Each path
//! is a shape of its own with its fill rule. What a viewer does not show (clear, hidden, beside its clip
//! path) is left out and counted. Colours decide only which remedy an overlap has. Arcs and circles arrive
//! as cubics that are within 0.03 % of their radius (usvg); flattening adds at most the stated tolerance.
//! Not covered: strokes, text (turn both into paths), images, clips that cut a shape, masks, filters.

use super::names::shortened;
use super::outline::{Drawing, RawRing, Rule, Shape};
use super::{POINTS_MAX, ReadOptions};
use crate::geometry::{Point2, Vector2};
use crate::input::error;
use crate::text::refusal::{Refusal, refusal};
use svgtypes::{Align, AspectRatio, ViewBox};
use usvg::tiny_skia_path::PathSegment;
use usvg::{Fill, Group, Node, Paint, Path, Rect, Stroke, roxmltree};

/// Millimetres in a CSS pixel.
const MM_PER_PX: f64 = 25.4 / 96.0;
/// Most chords of one curve, against absurd scales.
const CHORDS_MAX: f64 = 10_000.0;
/// Most nested groups: usvg itself stops at 1024, this keeps the walk's stack small.
const DEPTH_MAX: usize = 256;
/// Least opacity that shows: half a step of the 255 that screens have.
const OPACITY_MIN: f32 = 0.5 / 255.0;
/// How far a shape may reach beyond its clip path uncut, px: rounding of usvg's f32.
const CLIP_PX: f32 = 1e-3;

/// How a viewer shows a group's contents.
#[derive(Clone, Copy)]
struct Seen {
    opacity: f32,
    is_clipped_off: bool,
}

struct Reader {
    height_px: f64,
    /// Millimetres in a pixel, across and up; the two differ where a page is stretched.
    mm_per_px: Vector2,
    flatten_px: f64,
    /// Strokes are read, and not fills.
    centre_lines: bool,
    points: usize,
    shapes: Vec<Shape>,
    /// What has a stroke alone; of centre lines what has none.
    strokes: Vec<String>,
    hidden: usize,
    clips: usize,
    beside_page: usize,
    page_px: Rect,
}

/// Reads the filled shapes of a page.
pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<Drawing, Refusal> {
    let syntax = |problem: String| error::syntax("SVG", &problem);
    let text = std::str::from_utf8(bytes).map_err(|error| syntax(error.to_string()))?;
    let xml = roxmltree::Document::parse_with_options(
        text,
        roxmltree::ParsingOptions {
            allow_dtd: true,
            ..Default::default()
        },
    )
    .map_err(|error| syntax(error.to_string()))?;
    let tree = usvg::Tree::from_xmltree(&xml, &usvg::Options::default())
        .map_err(|error| syntax(error.to_string()))?;
    let px_per_unit = px_per_unit(xml.root_element(), tree.size());
    let mm_per_px = match options.units {
        Some(units) => px_per_unit.map(|px| units.mm() / px),
        None => Vector2::repeat(MM_PER_PX),
    };
    let mut reader = Reader {
        height_px: f64::from(tree.size().height()),
        mm_per_px,
        flatten_px: options.flatten_mm / (mm_per_px.max() * options.scale),
        centre_lines: options.centre_lines,
        points: 0,
        shapes: Vec::new(),
        strokes: Vec::new(),
        hidden: not_displayed(&xml, &tree),
        clips: 0,
        beside_page: 0,
        page_px: tree.size().to_non_zero_rect(0.0, 0.0).to_rect(),
    };
    let seen = Seen {
        opacity: 1.0,
        is_clipped_off: false,
    };
    reader.group(tree.root(), seen, 0)?;
    if let (true, Some(first)) = (reader.shapes.is_empty(), reader.strokes.first()) {
        let (count, first) = (reader.strokes.len(), first.clone());
        return Err(match options.centre_lines {
            true => error::no_lines(&first),
            false => refusal!(
                "{count} shapes have a stroke but no fill (the first: {first}): lines have no \
                 inside; print them as beads with --centre-lines, give them a fill, or turn \
                 strokes into paths in the drawing program"
            ),
        });
    }
    let mut left_out = unsupported_elements(&xml);
    left_out.splice(0..0, reader.hidden_note());
    if reader.shapes.is_empty() && !left_out.is_empty() {
        return Err(error::nothing_filled(&left_out.join("; ")));
    }
    let mut notes = reader.notes();
    notes.extend(left_out);
    let unit_mm = px_per_unit.component_mul(&mm_per_px) * options.scale;
    let page = Vector2::new(tree.size().width().into(), tree.size().height().into());
    let page_mm = page.component_mul(&mm_per_px) * options.scale;
    notes.push(size_note(&xml, options, unit_mm, page_mm));
    Ok(Drawing {
        name: title(&xml),
        shapes: reader.shapes,
        notes,
    })
}

impl Reader {
    fn group(&mut self, group: &Group, mut seen: Seen, depth: usize) -> Result<(), Refusal> {
        if depth > DEPTH_MAX {
            return Err(error::syntax(
                "SVG",
                &format!("groups are nested more than {DEPTH_MAX} deep"),
            ));
        }
        seen.opacity *= group.opacity().get();
        let part = group
            .clip_path()
            .map_or(Clip::Whole, |clip| clipped(group, clip));
        seen.is_clipped_off |= matches!(part, Clip::Nothing);
        self.clips += usize::from(matches!(part, Clip::Part) || group.mask().is_some());
        for node in group.children() {
            match node {
                Node::Group(inner) => self.group(inner, seen, depth + 1)?,
                Node::Path(path) => self.path(path, seen)?,
                Node::Image(_) | Node::Text(_) => {}
            }
        }
        Ok(())
    }

    fn path(&mut self, path: &Path, seen: Seen) -> Result<(), Refusal> {
        let number = self.shapes.len() + self.strokes.len() + self.hidden;
        let what = match path.id() {
            "" => format!("shape {number}"),
            id => format!("shape {number} (id '{}')", shortened(id)),
        };
        let is_shown = |paint: &Paint, opacity: f32| {
            let shown = seen.opacity * opacity * opacity_max(paint);
            path.is_visible() && !seen.is_clipped_off && shown >= OPACITY_MIN
        };
        let by_fill = |fill: &&Fill| is_shown(fill.paint(), fill.opacity().get());
        let by_stroke = |stroke: &&Stroke| is_shown(stroke.paint(), stroke.opacity().get());
        let (fill, stroke) = (path.fill().filter(by_fill), path.stroke().filter(by_stroke));
        let paint = match self.centre_lines {
            true => stroke.map(Stroke::paint),
            false => fill.map(Fill::paint),
        };
        let Some(paint) = paint else {
            match stroke.is_some() || fill.is_some() {
                true => self.strokes.push(what),
                false => self.hidden += 1,
            }
            return Ok(());
        };
        let is_beside = gap_px(path.abs_bounding_box(), self.page_px) > 0.0;
        self.beside_page += usize::from(is_beside);
        let colour = match paint {
            Paint::Color(c) => format!("#{:02x}{:02x}{:02x}", c.red, c.green, c.blue),
            _ => "a pattern".to_string(),
        };
        let rings = self.rings(path, &what)?;
        let rule = match fill.map(Fill::rule) {
            Some(usvg::FillRule::EvenOdd) => Rule::EvenOdd,
            _ => Rule::NonZero,
        };
        self.shapes.push(Shape {
            what,
            rings,
            rule,
            colour: Some(colour),
        });
        Ok(())
    }

    /// The path's contours in mm (before `--scale`), y up.
    fn rings(&mut self, path: &Path, what: &str) -> Result<Vec<RawRing>, Refusal> {
        let t = path.abs_transform();
        let [sx, ky, kx, sy, tx, ty] = [t.sx, t.ky, t.kx, t.sy, t.tx, t.ty].map(f64::from);
        let to_px = |p: usvg::tiny_skia_path::Point| {
            let (x, y) = (f64::from(p.x), f64::from(p.y));
            Point2::new(sx * x + kx * y + tx, ky * x + sy * y + ty)
        };
        let mut rings: Vec<RawRing> = Vec::new();
        let mut current: Vec<Point2> = Vec::new();
        for segment in path.data().segments() {
            match segment {
                PathSegment::MoveTo(p) => {
                    self.finish(&mut rings, &mut current, what, false);
                    current.push(to_px(p));
                }
                PathSegment::LineTo(p) => current.push(to_px(p)),
                PathSegment::QuadTo(c, p) => {
                    let (c, p) = (to_px(c), to_px(p));
                    let start = current.last().copied().unwrap_or(p);
                    // The same curve as a cubic.
                    let (c1, c2) = (start + (c - start) * (2.0 / 3.0), p + (c - p) * (2.0 / 3.0));
                    self.cubic(&mut current, c1, c2, p);
                }
                PathSegment::CubicTo(c1, c2, p) => {
                    self.cubic(&mut current, to_px(c1), to_px(c2), to_px(p));
                }
                PathSegment::Close => self.finish(&mut rings, &mut current, what, true),
            }
            if self.points + current.len() > POINTS_MAX {
                return Err(error::too_many_points(self.points + current.len()));
            }
        }
        self.finish(&mut rings, &mut current, what, false);
        Ok(rings)
    }

    /// Appends a cubic's chords. With D the larger second difference of the control polygon, the
    /// second derivative is at most 6 D and a chord of 1/n strays at most 6 D / (8 n²).
    fn cubic(&self, current: &mut Vec<Point2>, c1: Point2, c2: Point2, end: Point2) {
        let start = current.last().copied().unwrap_or(end);
        let bend = ((start - c1) + (c2 - c1))
            .norm()
            .max(((c1 - c2) + (end - c2)).norm());
        let chords = (6.0 * bend / (8.0 * self.flatten_px)).sqrt().ceil();
        let chords = chords.clamp(1.0, CHORDS_MAX) as usize;
        for k in 1..chords {
            let t = k as f64 / chords as f64;
            let s = 1.0 - t;
            current.push(Point2::from(
                start.coords * (s * s * s)
                    + c1.coords * (3.0 * s * s * t)
                    + c2.coords * (3.0 * s * t * t)
                    + end.coords * (t * t * t),
            ));
        }
        current.push(end);
    }

    fn finish(
        &mut self,
        rings: &mut Vec<RawRing>,
        current: &mut Vec<Point2>,
        what: &str,
        closed: bool,
    ) {
        // A lone point is a pen move without a line.
        if current.len() > 1 {
            let points: Vec<Point2> = current
                .iter()
                .map(|p| Point2::new(p.x, self.height_px - p.y))
                .map(|p| Point2::from(p.coords.component_mul(&self.mm_per_px)))
                .collect();
            self.points += points.len();
            rings.push(RawRing {
                what: format!("{what}, contour {}", rings.len()),
                points,
                closed,
            });
        }
        current.clear();
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some(first) = self.strokes.first() {
            let count = self.strokes.len();
            notes.push(match self.centre_lines {
                true => format!(
                    "{count} shapes with a fill but no stroke were left out (the first: {first})"
                ),
                false => format!(
                    "{count} shapes with a stroke but no fill were left out (--centre-lines prints them; the first: \
                     {first})"
                ),
            });
        }
        if self.clips > 0 {
            notes.push(format!(
                "{} groups have a clip path, a mask or the frame of a symbol that cuts them, which was \
                 ignored",
                self.clips
            ));
        }
        if self.beside_page > 0 {
            notes.push(format!(
                "{} shapes are beside the page, where a browser does not show them",
                self.beside_page
            ));
        }
        notes
    }

    fn hidden_note(&self) -> Option<String> {
        let hidden = self.hidden;
        (hidden > 0).then(|| format!("{hidden} shapes that are not shown were left out"))
    }
}

/// What a clip path leaves of a group.
enum Clip {
    Whole,
    Part,
    Nothing,
}

/// What is left of a group, by boxes: a clip path that is no upright rectangle may cut whatever it touches.
fn clipped(group: &Group, clip: &usvg::ClipPath) -> Clip {
    let bounds = group.bounding_box();
    let Some(inside) = clip.root().bounding_box().transform(clip.transform()) else {
        return Clip::Part;
    };
    let is_within = inside.left() <= bounds.left() + CLIP_PX
        && inside.top() <= bounds.top() + CLIP_PX
        && inside.right() >= bounds.right() - CLIP_PX
        && inside.bottom() >= bounds.bottom() - CLIP_PX;
    match gap_px(bounds, inside) > 0.0 {
        true => Clip::Nothing,
        false if is_within && clip.clip_path().is_none() && is_rectangle(clip) => Clip::Whole,
        false => Clip::Part,
    }
}

/// True for one path of four corners on the corners of its box.
fn is_rectangle(clip: &usvg::ClipPath) -> bool {
    let [Node::Path(path)] = clip.root().children() else {
        return false;
    };
    let bounds = path.data().bounds();
    let is_corner = |p: usvg::tiny_skia_path::Point| {
        (p.x == bounds.left() || p.x == bounds.right())
            && (p.y == bounds.top() || p.y == bounds.bottom())
    };
    let is_side = |segment| match segment {
        PathSegment::MoveTo(p) | PathSegment::LineTo(p) => is_corner(p),
        PathSegment::Close => true,
        _ => false,
    };
    let t = path.abs_transform();
    (t.kx, t.ky) == (0.0, 0.0) && path.data().len() <= 6 && path.data().segments().all(is_side)
}

/// Distance of two boxes along the axis on which they are farther apart, px.
fn gap_px(a: Rect, b: Rect) -> f32 {
    let across = (a.left() - b.right()).max(b.left() - a.right());
    across.max((a.top() - b.bottom()).max(b.top() - a.bottom()))
}

/// Opacity where a paint covers most.
fn opacity_max(paint: &Paint) -> f32 {
    let stops = match paint {
        Paint::LinearGradient(gradient) => gradient.stops(),
        Paint::RadialGradient(gradient) => gradient.stops(),
        Paint::Color(_) | Paint::Pattern(_) => return 1.0,
    };
    let opacities = stops.iter().map(|stop| stop.opacity().get());
    opacities.fold(0.0, f32::max)
}

/// Number of shapes that `display` takes out of the tree: those that it has more where all are displayed.
fn not_displayed(xml: &roxmltree::Document, tree: &usvg::Tree) -> usize {
    fn paths(group: &Group) -> usize {
        let of = |node: &Node| match node {
            Node::Group(inner) => paths(inner),
            Node::Path(_) => 1,
            Node::Image(_) | Node::Text(_) => 0,
        };
        group.children().iter().map(of).sum()
    }
    if !xml.input_text().contains("display") {
        return 0;
    }
    let options = usvg::Options {
        style_sheet: Some("* { display: inline !important }".to_string()),
        ..usvg::Options::default()
    };
    let all = usvg::Tree::from_xmltree(xml, &options).map_or(0, |all| paths(all.root()));
    all.saturating_sub(paths(tree.root()))
}

/// Pixels in a user unit of the page, across and up, by its viewBox.
fn px_per_unit(root: roxmltree::Node, size: usvg::Size) -> Vector2 {
    let view = root.attribute("viewBox").map(str::parse::<ViewBox>);
    let Some(Ok(view)) = view else {
        return Vector2::repeat(1.0);
    };
    let stretched = Vector2::new(
        f64::from(size.width()) / view.w,
        f64::from(size.height()) / view.h,
    );
    let aspect = root.attribute("preserveAspectRatio").map(str::parse);
    let aspect: AspectRatio = aspect.and_then(Result::ok).unwrap_or_default();
    match (aspect.align, aspect.slice) {
        (Align::None, _) => stretched,
        (_, true) => Vector2::repeat(stretched.max()),
        (_, false) => Vector2::repeat(stretched.min()),
    }
}

/// The size assumed for a unit of the drawing, and the reason.
fn size_note(
    xml: &roxmltree::Document,
    options: &ReadOptions,
    unit_mm: Vector2,
    page_mm: Vector2,
) -> String {
    const LENGTHS: [&str; 6] = ["mm", "cm", "in", "pt", "pc", "Q"];
    let width = xml.root_element().attribute("width").unwrap_or_default();
    let is_length = LENGTHS.iter().any(|unit| width.trim().ends_with(unit));
    let why = match (options.units, is_length) {
        (Some(_), _) => "as --units says",
        (None, true) => "as its width says",
        (None, false) => "96 to the inch, since it gives no lengths: see --units",
    };
    let across = unit_mm.x;
    let up = match (unit_mm.y - across).abs() <= 1e-6 * across {
        true => String::new(),
        false => format!(" across and {:.6} mm up", unit_mm.y),
    };
    format!(
        "one unit of the SVG is {across:.6} mm{up} ({why}); its page is {:.3} x {:.3} mm",
        page_mm.x, page_mm.y
    )
}

/// Elements that draw something which is not read, and how many of each. Those in a library of parts
/// (`defs`), or in a group that its own attributes hide, draw nothing.
fn unsupported_elements(xml: &roxmltree::Document) -> Vec<String> {
    let is_hidden = |node: roxmltree::Node| {
        let style = node.attribute("style").unwrap_or_default().replace(' ', "");
        node.tag_name().name() == "defs"
            || node.attribute("display") == Some("none")
            || style.contains("display:none")
    };
    let count = |name: &str| {
        xml.descendants()
            .filter(|node| node.is_element() && node.tag_name().name() == name)
            .filter(|node| !node.ancestors().any(is_hidden))
            .count()
    };
    [
        ("text", "turn them into paths in the drawing program"),
        ("image", "only shapes can be printed"),
    ]
    .into_iter()
    .filter_map(|(name, advice)| match count(name) {
        0 => None,
        n => Some(format!("{n} <{name}> elements were ignored: {advice}")),
    })
    .collect()
}

fn title(xml: &roxmltree::Document) -> Option<String> {
    let title = xml
        .root_element()
        .children()
        .find(|node| node.tag_name().name() == "title")?;
    let text = title.text()?.trim();
    (!text.is_empty()).then(|| text.to_string())
}

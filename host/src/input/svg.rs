//! SVG: the filled shapes of a page, curves flattened.
//!
//! usvg resolves styles, uses, units, transforms and the view box to CSS pixels (96 to the inch);
//! here they become mm from the page's lower left corner with y up, so that a part is printed as
//! displayed. With a unit given, one user unit of the page (of its viewBox) is that long. Each path
//! is a shape of its own with its fill rule; colours are ignored. Arcs and circles arrive as cubics
//! that are within 0.03 % of their radius (usvg); flattening adds at most the stated tolerance. Not
//! covered: strokes, text (turn both into paths), images, clips, masks.

use super::names::shortened;
use super::outline::{Drawing, RawRing, Rule, Shape};
use super::{InputError, POINTS_MAX, ReadOptions};
use crate::geometry::{Point2, Vector2};
use svgtypes::{Align, AspectRatio, ViewBox};
use usvg::tiny_skia_path::PathSegment;
use usvg::{Group, Node, Path, roxmltree};

/// Millimetres in a CSS pixel.
const MM_PER_PX: f64 = 25.4 / 96.0;
/// Most chords of one curve, against absurd scales.
const CHORDS_MAX: f64 = 10_000.0;
/// Most nested groups: usvg itself stops at 1024, this keeps the walk's stack small.
const DEPTH_MAX: usize = 256;

struct Reader {
    height_px: f64,
    /// Millimetres in a pixel, across and up; the two differ where a page is stretched.
    mm_per_px: Vector2,
    flatten_px: f64,
    points: usize,
    shapes: Vec<Shape>,
    strokes: Vec<String>,
    hidden: usize,
    clips: usize,
}

/// Reads the filled shapes of a page.
pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<Drawing, InputError> {
    let syntax = |problem: String| InputError::Syntax {
        format: "SVG",
        problem,
    };
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
        points: 0,
        shapes: Vec::new(),
        strokes: Vec::new(),
        hidden: 0,
        clips: 0,
    };
    reader.group(tree.root(), 0)?;
    if let (true, Some(first)) = (reader.shapes.is_empty(), reader.strokes.first()) {
        return Err(InputError::OnlyStrokes {
            count: reader.strokes.len(),
            first: first.clone(),
        });
    }
    let left_out = unsupported_elements(&xml);
    if reader.shapes.is_empty() && !left_out.is_empty() {
        return Err(InputError::NothingFilled {
            left_out: left_out.join("; "),
        });
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
    fn group(&mut self, group: &Group, depth: usize) -> Result<(), InputError> {
        if depth > DEPTH_MAX {
            return Err(InputError::Syntax {
                format: "SVG",
                problem: format!("groups are nested more than {DEPTH_MAX} deep"),
            });
        }
        if group.clip_path().is_some() || group.mask().is_some() {
            self.clips += 1;
        }
        for node in group.children() {
            match node {
                Node::Group(inner) => self.group(inner, depth + 1)?,
                Node::Path(path) => self.path(path)?,
                Node::Image(_) | Node::Text(_) => {}
            }
        }
        Ok(())
    }

    fn path(&mut self, path: &Path) -> Result<(), InputError> {
        let number = self.shapes.len() + self.strokes.len() + self.hidden;
        let what = match path.id() {
            "" => format!("shape {number}"),
            id => format!("shape {number} (id '{}')", shortened(id)),
        };
        if !path.is_visible() {
            self.hidden += 1;
            return Ok(());
        }
        let Some(fill) = path.fill() else {
            self.strokes.push(what);
            return Ok(());
        };
        let rings = self.rings(path, &what)?;
        let rule = match fill.rule() {
            usvg::FillRule::NonZero => Rule::NonZero,
            usvg::FillRule::EvenOdd => Rule::EvenOdd,
        };
        self.shapes.push(Shape { what, rings, rule });
        Ok(())
    }

    /// The path's contours in mm (before `--scale`), y up.
    fn rings(&mut self, path: &Path, what: &str) -> Result<Vec<RawRing>, InputError> {
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
                return Err(InputError::TooManyPoints {
                    points: self.points + current.len(),
                });
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
            notes.push(format!(
                "{} shapes with a stroke but no fill were left out (the first: {first}): lines have \
                 no inside",
                self.strokes.len()
            ));
        }
        if self.hidden > 0 {
            notes.push(format!("{} hidden shapes were ignored", self.hidden));
        }
        if self.clips > 0 {
            notes.push(format!(
                "{} groups have a clip path or a mask, which was ignored",
                self.clips
            ));
        }
        notes
    }
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

/// Elements that draw something which is not read, and how many of each.
fn unsupported_elements(xml: &roxmltree::Document) -> Vec<String> {
    let count = |name: &str| {
        xml.descendants()
            .filter(|node| node.is_element() && node.tag_name().name() == name)
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

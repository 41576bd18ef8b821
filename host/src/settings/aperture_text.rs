//! Apertures as the user writes them, full sizes in mm as nozzles are sold: `ellipse:LxW`, `circle:D`, `stadium:LxW` (a
//! slot), `rect:LxWxR` (R: corner radius) and `polygon:FILE`.
//!
//! A polygon's file is read where files are read; what comes here is its text in place of its
//! name: `polygon:[[x, y], ...]`, corners in mm about the tool's axis. That is also how machine
//! files inside jobs keep it, so that a job stands on its own.

use crate::geometry::Vector2;
use crate::geometry::aperture::Aperture;
use crate::geometry::rounded_polygon::{Kind, RoundedPolygon};
use crate::text::near_name::near_name;
use crate::text::refusal::{Refusal, refusal};

/// The name of the file that a description refers to; `None` where it stands on its own.
pub fn file_of_aperture(text: &str) -> Option<&str> {
    let (kind, file) = text.split_once(':')?;
    let file = file.trim();
    (kind.trim() == "polygon" && !file.is_empty() && !file.starts_with(['[', '{'])).then_some(file)
}

/// Reads a description; a polygon's file must have been put in place of its name.
pub fn parse_aperture(text: &str) -> Result<Aperture, Refusal> {
    let form = || no_form(text);
    let (kind, rest) = text.split_once(':').ok_or_else(form)?;
    match kind.trim() {
        "circle" => {
            let [diameter_mm] = sizes(text, rest)?;
            Ok(circle(diameter_mm / 2.0))
        }
        "ellipse" => {
            let [length_mm, width_mm] = sizes(text, rest)?;
            in_order(text, "ellipse", length_mm, width_mm)?;
            Ok(Aperture::Ellipse {
                major_mm: length_mm / 2.0,
                minor_mm: width_mm / 2.0,
            })
        }
        "stadium" => {
            let [length_mm, width_mm] = sizes(text, rest)?;
            in_order(text, "stadium", length_mm, width_mm)?;
            if is_same(length_mm, width_mm) {
                return Ok(circle(width_mm / 2.0));
            }
            let slot = RoundedPolygon::stadium(length_mm, width_mm);
            Ok(Aperture::Rounded(slot))
        }
        "rect" => {
            let (before, radius) = rest.rsplit_once(['x', 'X']).ok_or_else(form)?;
            let [length_mm, width_mm] = sizes(text, before)?;
            in_order(text, "rect", length_mm, width_mm)?;
            rectangle(text, length_mm, width_mm, radius.trim())
        }
        "polygon" => {
            let shape = RoundedPolygon::polygon(&corners(rest)?);
            let shape = shape.map_err(|error| refusal!("aperture polygon: {error}"))?;
            Ok(Aperture::Rounded(shape))
        }
        _ => Err(form()),
    }
}

/// `N` sizes with an x between them.
fn sizes<const N: usize>(text: &str, sizes: &str) -> Result<[f64; N], Refusal> {
    let mut numbers = [0.0; N];
    let mut parts = sizes.split(['x', 'X']);
    for number in &mut numbers {
        let size = parts.next().ok_or_else(|| no_form(text))?.trim();
        *number = match size.parse::<f64>() {
            Ok(value) if value.is_finite() && value > 0.0 => value,
            _ => return Err(no_size(text, size)),
        };
    }
    match parts.next() {
        None => Ok(numbers),
        Some(_) => Err(no_form(text)),
    }
}

fn in_order(text: &str, kind: &str, major: f64, minor: f64) -> Result<(), Refusal> {
    if major >= minor {
        return Ok(());
    }
    Err(refusal!(
        "aperture '{text}': the first size lies along tool X and must not be the smaller one; \
         write {kind}:{minor}x{major}"
    ))
}

fn no_form(text: &str) -> Refusal {
    refusal!(
        "aperture '{text}': write ellipse:LxW, circle:D, stadium:LxW (full sizes in mm), rect:LxWxR (with \
         the corner radius) or polygon:FILE"
    )
}

fn no_size(text: &str, size: &str) -> Refusal {
    refusal!("aperture '{text}': '{size}' is not a size in mm greater than 0, as in 0.4")
}

/// Equal but for rounding.
fn is_same(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
}

fn circle(radius_mm: f64) -> Aperture {
    Aperture::Ellipse {
        major_mm: radius_mm,
        minor_mm: radius_mm,
    }
}

/// A rectangle, or the slot or circle that a corner radius of half the width makes of it.
fn rectangle(text: &str, length_mm: f64, width_mm: f64, radius: &str) -> Result<Aperture, Refusal> {
    let radius_mm = match radius.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => value,
        _ => return Err(no_size(text, radius)),
    };
    let full = is_same(2.0 * radius_mm, width_mm);
    if 2.0 * radius_mm > width_mm && !full {
        return Err(refusal!(
            "aperture '{text}': the corner radius {radius_mm} is more than half the width {width_mm}"
        ));
    }
    Ok(match (full, is_same(length_mm, width_mm)) {
        (true, true) => circle(width_mm / 2.0),
        (true, false) => Aperture::Rounded(RoundedPolygon::stadium(length_mm, width_mm)),
        _ => Aperture::Rounded(RoundedPolygon::rectangle(length_mm, width_mm, radius_mm)),
    })
}

/// Corners of a polygon's text: a list of them, or an outline as the inputs have it.
fn corners(text: &str) -> Result<Vec<Vector2>, Refusal> {
    let refused = |problem: String| {
        refusal!(
            "aperture polygon: {problem}; write a list of corners in mm about the tool's axis, \
             [[x, y], ...], or {{\"units\": \"mm\", \"exterior\": [[x, y], ...]}}"
        )
    };
    let value: serde_json::Value =
        serde_json::from_str(text.trim()).map_err(|error| refused(error.to_string()))?;
    let keys = value
        .as_object()
        .into_iter()
        .flat_map(|object| object.keys());
    for key in keys {
        if let Some(near) = near_name(key, &["exterior", "units", "holes", "name"]) {
            return Err(refused(format!(
                "the key '{key}' is not known: is '{near}' meant?"
            )));
        }
    }
    let holes = value.get("holes").and_then(|holes| holes.as_array());
    if holes.is_some_and(|holes| !holes.is_empty()) {
        return Err(refused("an aperture has no holes".to_string()));
    }
    let list = match value.get("exterior") {
        Some(list) => {
            let unit = value.get("units").and_then(|u| u.as_str());
            if unit.is_some_and(|u| u != "mm") {
                return Err(refused("its units must be mm".to_string()));
            }
            list.clone()
        }
        None => value,
    };
    let points: Vec<[f64; 2]> =
        serde_json::from_value(list).map_err(|error| refused(error.to_string()))?;
    if points
        .iter()
        .flatten()
        .any(|v| !v.is_finite() || v.abs() > 1e4)
    {
        return Err(refused("a corner is beyond all sizes".to_string()));
    }
    Ok(points.into_iter().map(Vector2::from).collect())
}

/// A nozzle and what it lays, in words: "nozzle ellipse 1.2 x 0.4 mm, beads of 0.4 to 1.2 mm".
pub fn nozzle_text(aperture: &Aperture) -> String {
    let text = aperture_words(aperture);
    let full_mm = |half_mm: f64| (2e2 * half_mm).round() / 1e2;
    let [narrow, wide] = [aperture.minor_mm(), aperture.major_mm()].map(full_mm);
    match narrow == wide {
        true => format!("nozzle {text}, beads of {wide} mm"),
        false => format!("nozzle {text}, beads of {narrow} to {wide} mm"),
    }
}

/// A nozzle as tables and verdicts have it: "ellipse 1.2 x 0.4 mm".
pub fn aperture_words(aperture: &Aperture) -> String {
    let size = |mm: f64| (1e4 * mm).round() / 1e4;
    match aperture {
        Aperture::Ellipse { major_mm, minor_mm } if major_mm == minor_mm => {
            format!("circle {} mm", size(2.0 * major_mm))
        }
        Aperture::Ellipse { major_mm, minor_mm } => {
            let [length, width] = [major_mm, minor_mm].map(|half_mm| size(2.0 * half_mm));
            format!("ellipse {length} x {width} mm")
        }
        Aperture::Rounded(shape) => match shape.kind() {
            Kind::Stadium([length, width]) => {
                format!("stadium {} x {} mm", size(length), size(width))
            }
            Kind::Rectangle([length, width, radius]) => {
                let corners = match size(radius) {
                    0.0 => String::new(),
                    radius => format!(" with corners of {radius} mm"),
                };
                format!("rectangle {} x {} mm{corners}", size(length), size(width))
            }
            Kind::Polygon => format!("polygon of {} corners", shape.corners().len()),
        },
    }
}

/// The same of an option's text, which is shown as it is where it is none.
pub fn words_of(text: &str) -> String {
    parse_aperture(text).map_or_else(|_| text.to_string(), |aperture| aperture_words(&aperture))
}

/// The text by full sizes of one by semi-axes, as machine files had ellipses and circles before their format 2.
pub(super) fn from_semi_axes(text: &str) -> Option<String> {
    let (kind, rest) = text.split_once(':')?;
    let is_halved = ["ellipse", "circle"].contains(&kind.trim());
    let sizes = rest
        .split(['x', 'X'])
        .map(|size| size.trim().parse::<f64>());
    let sizes: Vec<f64> = sizes.collect::<Result<_, _>>().ok()?;
    let doubled: Vec<String> = sizes.iter().map(|size| (2.0 * size).to_string()).collect();
    is_halved.then(|| format!("{}:{}", kind.trim(), doubled.join("x")))
}

/// Writes what [`parse_aperture`] reads, a polygon with its corners.
pub fn aperture_text(aperture: &Aperture) -> String {
    match aperture {
        Aperture::Ellipse { major_mm, minor_mm } if major_mm == minor_mm => {
            format!("circle:{}", 2.0 * major_mm)
        }
        Aperture::Ellipse { major_mm, minor_mm } => {
            format!("ellipse:{}x{}", 2.0 * major_mm, 2.0 * minor_mm)
        }
        Aperture::Rounded(shape) => match shape.kind() {
            Kind::Stadium([length, width]) => format!("stadium:{length}x{width}"),
            Kind::Rectangle([length, width, radius]) => format!("rect:{length}x{width}x{radius}"),
            Kind::Polygon => {
                let corners = shape.corners().iter();
                let corners: Vec<String> = corners.map(|c| format!("[{}, {}]", c.x, c.y)).collect();
                format!("polygon:[{}]", corners.join(", "))
            }
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: the widest and the narrowest bead are those of the shape. Method: full sizes by hand.
    #[test]
    fn a_nozzle_says_its_beads() {
        for (text, expected) in [
            (
                "ellipse:1.2x0.4",
                "nozzle ellipse 1.2 x 0.4 mm, beads of 0.4 to 1.2 mm",
            ),
            ("circle:0.4", "nozzle circle 0.4 mm, beads of 0.4 mm"),
            // Along its diagonal: hypot(38, 18) + 2.
            (
                "rect:40x20x1",
                "nozzle rectangle 40 x 20 mm with corners of 1 mm, beads of 20 to 44.05 mm",
            ),
        ] {
            assert_eq!(nozzle_text(&parse_aperture(text).expect(text)), expected);
        }
    }

    #[test]
    fn what_is_written_reads_back() {
        for text in [
            "ellipse:0.6x0.2",
            "circle:0.4",
            "ellipse:12x3.25",
            "stadium:1.2x0.4",
            "rect:1.2x0.4x0.1",
            "rect:1.2x0.4x0",
            "polygon:[[-0.3, -0.2], [0.6, 0], [-0.3, 0.2]]",
        ] {
            let aperture = parse_aperture(text).expect(text);
            assert_eq!(aperture_text(&aperture), text);
        }
        assert_eq!(
            parse_aperture("ellipse:0.6X0.2"),
            parse_aperture(" ellipse: 0.6 x 0.2 ")
        );
        let named =
            r#"polygon:{"units":"mm","exterior":[[-0.3,-0.2],[0.6,0],[-0.3,0.2]],"holes":[]}"#;
        assert_eq!(
            parse_aperture(named),
            parse_aperture("polygon:[[-0.3, -0.2], [0.6, 0], [-0.3, 0.2]]")
        );
    }

    #[test]
    fn round_shapes_are_what_they_are() {
        for (text, same) in [
            ("stadium:0.8x0.8", "circle:0.8"),
            ("rect:0.8x0.8x0.4", "circle:0.8"),
            ("rect:1.2x0.4x0.2", "stadium:1.2x0.4"),
        ] {
            assert_eq!(parse_aperture(text), parse_aperture(same), "{text}");
        }
    }

    #[test]
    fn a_polygon_may_be_in_a_file() {
        assert_eq!(file_of_aperture("polygon: a/b.json"), Some("a/b.json"));
        for text in [
            "polygon:[[1,2]]",
            "polygon:{\"a\":1}",
            "polygon:",
            "circle:1",
            "x",
        ] {
            assert_eq!(file_of_aperture(text), None, "{text}");
        }
    }

    #[test]
    fn refusals_name_the_fault() {
        for (text, part) in [
            ("0.6x0.2", "write ellipse:LxW"),
            ("ellipse:0.6", "write ellipse:LxW"),
            ("ellipse:0.2x0.6", "write ellipse:0.6x0.2"),
            ("ellipse:0.6x0", "'0' is not a size"),
            ("ellipse:0.6xnan", "'nan' is not a size"),
            ("circle:-1", "'-1' is not a size"),
            ("stadium:1x3", "write stadium:3x1"),
            ("stadium:3x1x1", "polygon:FILE"),
            ("rect:3x1", "polygon:FILE"),
            ("rect:3x1x0.6", "0.6 is more than half the width 1"),
            ("rect:3x1x-1", "'-1' is not a size"),
            ("polygon:[[0,0],[1,0]]", "2 corners"),
            ("polygon:[[0,0],[1]]", "write a list of corners"),
            (
                "polygon:[[1,0],[2,0],[2,1]]",
                "the tool's axis (0, 0) is not inside",
            ),
            (
                "polygon:{\"unit\":\"in\",\"exterior\":[[0,0],[1,0],[1,1]]}",
                "'units' meant",
            ),
            (
                "polygon:{\"exterior\":[[-1,-1],[1,-1],[0,1]],\"holes\":[[[0,0]]]}",
                "no holes",
            ),
            ("star:3", "write ellipse:LxW"),
        ] {
            let message = parse_aperture(text).expect_err(text).to_string();
            assert!(message.contains(part), "{text}: {message}");
        }
    }
}

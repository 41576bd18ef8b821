//! Times of several nozzles as bars, and a layer of each below.
//!
//! In: labels, seconds, finished pictures. Out: one SVG. The pictures are embedded unchanged.

use super::canvas::white_page;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use svg::Document;
use svg::node::element::{Image, Rectangle, Text};

const WIDTH_PX: f64 = 960.0;
const MARGIN_PX: f64 = 24.0;
const BAR_PX: f64 = 22.0;
const ROW_PX: f64 = 34.0;
const LABEL_PX: f64 = 190.0;
const LAYER_HEIGHT_PX: f64 = 320.0;
const COLOURS: [&str; 2] = ["#0f766e", "#94a3b8"];

/// One nozzle.
pub struct Bar<'a> {
    /// Its label.
    pub label: &'a str,
    /// Duration of the print; `None` if it cannot be printed.
    pub seconds: Option<f64>,
    /// An SVG document.
    pub layer: Option<&'a str>,
}

fn text(x: f64, y: f64, size: f64, words: &str) -> Text {
    Text::new(words)
        .set("x", format!("{x:.1}"))
        .set("y", format!("{y:.1}"))
        .set("font-size", size)
        .set("font-family", "sans-serif")
        .set("fill", "#111827")
}

/// Draws the bars, the shortest time in colour.
pub fn draw(title: &str, bars: &[Bar]) -> String {
    let longest_s = bars
        .iter()
        .filter_map(|bar| bar.seconds)
        .fold(0.0, f64::max);
    let shortest_s = bars
        .iter()
        .filter_map(|bar| bar.seconds)
        .fold(f64::INFINITY, f64::min);
    let layers: Vec<&Bar> = bars.iter().filter(|bar| bar.layer.is_some()).collect();
    let bars_end = MARGIN_PX + 30.0 + ROW_PX * bars.len() as f64;
    let layers_px = if layers.is_empty() {
        0.0
    } else {
        LAYER_HEIGHT_PX + 30.0
    };
    let height = bars_end + layers_px + MARGIN_PX;
    let mut document = Document::new()
        .set("viewBox", format!("0 0 {WIDTH_PX:.0} {height:.0}"))
        .set("width", format!("{WIDTH_PX:.0}"))
        .add(white_page())
        .add(text(MARGIN_PX, MARGIN_PX + 8.0, 18.0, title));
    let room = WIDTH_PX - 2.0 * MARGIN_PX - LABEL_PX - 90.0;
    for (number, bar) in bars.iter().enumerate() {
        let y = MARGIN_PX + 24.0 + ROW_PX * number as f64;
        document = document.add(text(MARGIN_PX, y + 16.0, 14.0, bar.label));
        let x = MARGIN_PX + LABEL_PX;
        let Some(seconds) = bar.seconds else {
            document = document.add(text(x, y + 16.0, 14.0, "cannot be printed with it"));
            continue;
        };
        let width = room * seconds / longest_s.max(f64::MIN_POSITIVE);
        let colour = COLOURS[usize::from(seconds > shortest_s)];
        let shape = Rectangle::new()
            .set("x", format!("{x:.1}"))
            .set("y", format!("{y:.1}"))
            .set("width", format!("{width:.1}"))
            .set("height", BAR_PX)
            .set("fill", colour);
        document = document.add(shape);
        document = document.add(text(
            x + width + 8.0,
            y + 16.0,
            14.0,
            &format!("{seconds:.1} s"),
        ));
    }
    let column = (WIDTH_PX - 2.0 * MARGIN_PX) / layers.len().max(1) as f64;
    for (number, bar) in layers.iter().enumerate() {
        let encoded = STANDARD.encode(bar.layer.unwrap_or_default());
        let image = Image::new()
            .set("x", format!("{:.1}", MARGIN_PX + column * number as f64))
            .set("y", format!("{:.1}", bars_end + 20.0))
            .set("width", format!("{:.1}", column - 8.0))
            .set("height", LAYER_HEIGHT_PX)
            .set("preserveAspectRatio", "xMinYMin")
            .set("href", format!("data:image/svg+xml;base64,{encoded}"));
        document = document.add(image);
    }
    document.to_string() + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: bars are as long as their times, and a nozzle without one says so. Method: two times, 1 to 4.
    #[test]
    fn bars_are_as_long_as_their_times() {
        let bar = |label, seconds| Bar {
            label,
            seconds,
            layer: Some("<svg/>"),
        };
        let drawn = draw(
            "part",
            &[bar("a", Some(5.0)), bar("b", Some(20.0)), bar("c", None)],
        );
        let widths: Vec<f64> = drawn
            .split("<rect ")
            .filter(|rest| rest.contains("height=\"22\""))
            .filter_map(|rest| {
                rest.split("width=\"")
                    .nth(1)?
                    .split('"')
                    .next()?
                    .parse()
                    .ok()
            })
            .collect();
        assert_eq!(widths.len(), 2, "{drawn}");
        assert!((widths[1] / widths[0] - 4.0).abs() < 0.01, "{widths:?}");
        assert!(drawn.contains("cannot be printed"));
        assert_eq!(drawn.matches("<image").count(), 3);
    }
}

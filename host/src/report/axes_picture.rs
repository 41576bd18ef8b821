//! Free tool axes as a map of the half sphere, Z in the middle, 90° at the rim.
//!
//! In: which axes of a grid are free, marked axes. Out: one SVG; distances from the middle are
//! tilts.

use super::canvas::white_page;
use svg::Document;
use svg::node::element::{Circle, Line, Path, Text};

const SIZE_PX: f64 = 560.0;
const RADIUS_PX: f64 = 240.0;
const CENTRE_PX: [f64; 2] = [280.0, 290.0];
const FREE: &str = "#ccfbf1";
const HELD: &str = "#b91c1c";

/// A marked axis: tilt and direction, rad.
pub struct MarkedAxis {
    /// Where.
    pub at_rad: [f64; 2],
    /// Its label.
    pub label: &'static str,
    /// Its colour.
    pub colour: &'static str,
}

fn place([tilt_rad, around_rad]: [f64; 2]) -> [f64; 2] {
    let out = RADIUS_PX * tilt_rad / std::f64::consts::FRAC_PI_2;
    // X to the right, Y upwards.
    [
        CENTRE_PX[0] + out * around_rad.cos(),
        CENTRE_PX[1] - out * around_rad.sin(),
    ]
}

/// The axes that are not free, each as a field of the map.
fn held_path(free: &[bool], sectors: usize) -> String {
    let rings = free.len() / sectors.max(1);
    let mut held = String::new();
    for (index, _) in free.iter().enumerate().filter(|(_, is_free)| !**is_free) {
        let (ring, sector) = (index / sectors, index % sectors);
        let corner = |ring: usize, sector: usize| {
            let tilt_rad = std::f64::consts::FRAC_PI_2 * ring as f64 / rings as f64;
            let around_rad = std::f64::consts::TAU * sector as f64 / sectors as f64;
            let [x, y] = place([tilt_rad, around_rad]);
            format!("{x:.1} {y:.1}")
        };
        held += &format!(
            "M{}L{}L{}L{}Z",
            corner(ring, sector),
            corner(ring + 1, sector),
            corner(ring + 1, sector + 1),
            corner(ring, sector + 1)
        );
    }
    held
}

/// Draws `free`, ring by ring from the middle, each of this many sectors from X towards Y.
pub fn draw(title: &str, free: &[bool], sectors: usize, marks: &[MarkedAxis]) -> String {
    let held = held_path(free, sectors);
    let circle = |radius_px: f64| {
        Circle::new()
            .set("cx", CENTRE_PX[0])
            .set("cy", CENTRE_PX[1])
            .set("r", format!("{radius_px:.1}"))
    };
    let mut document = Document::new()
        .set("viewBox", format!("0 0 {SIZE_PX} {SIZE_PX}"))
        .set("width", format!("{SIZE_PX}"))
        .add(white_page())
        .add(circle(RADIUS_PX).set("fill", FREE))
        .add(Path::new().set("d", held).set("fill", HELD));
    for tilt_deg in [30, 60, 90] {
        let radius_px = RADIUS_PX * f64::from(tilt_deg) / 90.0;
        document = document
            .add(
                circle(radius_px)
                    .set("fill", "none")
                    .set("stroke", "#64748b"),
            )
            .add(words(
                [CENTRE_PX[0] + 3.0, CENTRE_PX[1] - radius_px - 3.0],
                &format!("{tilt_deg}°"),
            ));
    }
    document = document
        .add(words([20.0, 24.0], title))
        .add(words(
            [CENTRE_PX[0] + RADIUS_PX + 6.0, CENTRE_PX[1] + 4.0],
            "X",
        ))
        .add(words(
            [CENTRE_PX[0] + 22.0, CENTRE_PX[1] - RADIUS_PX - 3.0],
            "Y",
        ));
    for mark in marks {
        let [x, y] = place(mark.at_rad);
        for [dx, dy] in [[7.0, 0.0], [0.0, 7.0]] {
            document = document.add(
                Line::new()
                    .set("x1", format!("{:.1}", x - dx))
                    .set("x2", format!("{:.1}", x + dx))
                    .set("y1", format!("{:.1}", y - dy))
                    .set("y2", format!("{:.1}", y + dy))
                    .set("stroke", mark.colour)
                    .set("stroke-width", 3),
            );
        }
        let label = words([x + 9.0, y - 6.0], mark.label)
            .set("fill", mark.colour)
            .set("stroke", "#ffffff")
            .set("stroke-width", 4)
            .set("paint-order", "stroke");
        document = document.add(label);
    }
    document.to_string() + "\n"
}

fn words([x, y]: [f64; 2], text: &str) -> Text {
    Text::new(text)
        .set("x", format!("{x:.1}"))
        .set("y", format!("{y:.1}"))
        .set("font-size", 14)
        .set("font-family", "sans-serif")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goal: what is held is drawn, and nothing else, and marks stand where their tilt is. Method: four axes.
    #[test]
    fn held_axes_are_drawn() {
        let mark = MarkedAxis {
            at_rad: [std::f64::consts::FRAC_PI_4, 0.0],
            label: "here",
            colour: "#000000",
        };
        let picture = draw("a", &[true, true, false, true], 4, &[mark]);
        assert_eq!(picture.matches('Z').count(), 1, "{picture}");
        // Half of the way from the middle to the rim.
        assert!(
            picture.contains("x1=\"393.0\"") && picture.contains("x2=\"407.0\""),
            "{picture}"
        );
    }
}

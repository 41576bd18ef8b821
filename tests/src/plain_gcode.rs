//! A reading of printers' G-code that shares nothing with Headway's: straight moves of G0, G1 and G92, split at
//! blanks.
//!
//! In: text, and how E is meant at its start. Out: length of what moves in the plane while E grows (mm), the
//! filament of those moves (mm), how many layer marks stand before them. Leaves out everything else; panics on
//! what it does not know.

use std::collections::BTreeSet;

/// What was read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plain {
    /// Length of the beads.
    pub print_mm: f64,
    /// Filament in them.
    pub filament_mm: f64,
    /// Marks of layers with a bead.
    pub layers: usize,
}

/// How E is meant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Meant {
    /// Relative from the first line on.
    pub e_relative: bool,
    /// G91 is E's too.
    pub g91_is_of_e: bool,
    /// G90 and G91 take M83 back, as Marlin 2 has it.
    pub g90_forgets: bool,
}

/// Reads a text.
///
/// # Panics
/// Where a number is none.
pub fn plain(text: &str, meant: Meant) -> Plain {
    let mut found = Plain::default();
    let (mut place, mut origin, mut e_now) = ([0.0; 3], [0.0; 3], 0.0);
    let (mut relative, mut e_relative) = (false, meant.e_relative);
    let (mut layer, mut layers) = (0usize, BTreeSet::new());
    for line in text.lines() {
        let code = line.split(';').next().unwrap_or("");
        if line.starts_with(";LAYER:") || line.starts_with(";LAYER_CHANGE") {
            layer += 1;
        }
        let words: Vec<&str> = code.split_whitespace().collect();
        let number = |letter: &str| {
            let word = words.iter().skip(1).find(|word| word.starts_with(letter));
            word.map(|word| word[1..].parse::<f64>().expect("a number"))
        };
        match words.first().copied() {
            Some("G90" | "G91") => {
                relative = words[0] == "G91";
                if meant.g90_forgets {
                    e_relative = relative;
                }
            }
            Some("M82") => e_relative = false,
            Some("M83") => e_relative = true,
            Some("G92") => {
                for (axis, letter) in ["X", "Y", "Z"].into_iter().enumerate() {
                    origin[axis] = number(letter).map_or(origin[axis], |to| place[axis] - to);
                }
                e_now = number("E").unwrap_or(e_now);
            }
            Some("G28") => (place, origin) = ([0.0; 3], [0.0; 3]),
            Some("G0" | "G1") => {
                let mut to = place;
                for (axis, letter) in ["X", "Y", "Z"].into_iter().enumerate() {
                    if let Some(given) = number(letter) {
                        to[axis] = given + if relative { place[axis] } else { origin[axis] };
                    }
                }
                let is_step = e_relative || (relative && meant.g91_is_of_e);
                let fed = number("E").map_or(0.0, |e| if is_step { e } else { e - e_now });
                e_now += fed;
                let way: f64 = (0..3).map(|axis| (to[axis] - place[axis]).powi(2)).sum();
                if fed > 0.0 && way > 0.0 {
                    found.print_mm += way.sqrt();
                    found.filament_mm += fed;
                    layers.insert(layer);
                }
                place = to;
            }
            _ => {}
        }
    }
    found.layers = layers.len();
    found
}

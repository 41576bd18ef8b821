//! The figures in one line of plain words.
//!
//! In: [`Figures`]. Out: a sentence or several: how long, how much, how well covered, what holds the
//! motion back, what went wrong. What is not known is not spoken of.

use crate::report::figures::Figures;

/// Time at no limit counts as one by this name.
const NONE: &str = "none";

/// The line.
pub fn verdict(figures: &Figures) -> String {
    let parts = [
        objections(figures),
        faults(figures),
        time(figures),
        coverage(figures),
        limit(figures),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join(" ")
}

/// The first figures, a name and a value with its unit each.
pub fn tiles(figures: &Figures) -> Vec<(&'static str, String)> {
    let tiles = [
        ("Time", figures.print_s.map(duration)),
        (
            "Material",
            figures.volume_mm3.map(|v| format!("{v:.1} mm³")),
        ),
        ("Covered", figures.covered_pct.map(|v| format!("{v:.1} %"))),
        (
            "Printed path",
            figures.print_mm.map(|v| format!("{v:.0} mm")),
        ),
        ("Passes", figures.passes.map(|v| v.to_string())),
        ("Layers", figures.layers.map(|v| v.to_string())),
    ];
    let known = tiles.into_iter();
    known
        .filter_map(|(what, value)| Some((what, value?)))
        .collect()
}

fn objections(figures: &Figures) -> Option<String> {
    let lines = figures.objections.iter().flatten();
    let sentences: Vec<String> = lines.map(|line| format!("{line}.")).collect();
    (!sentences.is_empty()).then(|| sentences.join(" "))
}

fn faults(figures: &Figures) -> Option<String> {
    let faults = figures.faults.filter(|&faults| faults > 0)?;
    Some(format!("The controller stopped with {faults} fault(s)."))
}

fn time(figures: &Figures) -> Option<String> {
    let time = duration(figures.print_s?);
    let material = figures.volume_mm3.map_or(String::new(), |volume| {
        format!(" with {volume:.1} mm³ of material")
    });
    let passes = match figures.passes {
        Some(1) => " in one pass".to_string(),
        Some(passes) => format!(" in {passes} passes"),
        None => String::new(),
    };
    Some(format!("Takes {time}{material}{passes}."))
}

fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 100.0 => format!("{s:.1} s"),
        s if s < 6000.0 => format!("{:.0} min {:02.0} s", (s / 60.0).floor(), s % 60.0),
        s => format!(
            "{:.0} h {:02.0} min",
            (s / 3600.0).floor(),
            (s % 3600.0) / 60.0
        ),
    }
}

fn coverage(figures: &Figures) -> Option<String> {
    let covered = figures.covered_pct?;
    let open = match figures.open_largest_mm2 {
        Some(open) if open > 0.0 => format!("; the largest place left open has {open:.2} mm²"),
        Some(_) => "; nothing is left open".to_string(),
        None => String::new(),
    };
    Some(format!("Covers {covered:.1} % of the outline{open}."))
}

fn limit(figures: &Figures) -> Option<String> {
    let shares = figures.time_share_by_limit.as_ref()?.iter();
    let named = shares.filter(|(limit, _)| *limit != NONE);
    let (limit, share) = named.max_by(|a, b| a.1.total_cmp(b.1))?;
    let limit = limit.replace('_', " ");
    Some(format!(
        "{:.0} % of the printing time is spent at the limit of {limit}.",
        100.0 * share
    ))
}

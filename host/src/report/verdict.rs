//! The figures in a few lines of plain words: the beginning and the end of every report on a job.
//!
//! In: [`Figures`], and reasons that are not in a figure. Out: lines in a fixed order, on terminal, page and in
//! `--json`: every reason not to start the job, then its time and the comparison, material, accuracy of the
//! steps, what limits it, what stays uncovered. Unknown values are omitted.

use crate::report::figures::{Figures, UnevenFigures, VerdictFigures};

/// Time at no limit counts as one by this name.
const NONE: &str = "none";
/// Volumes are told in litres from here on, mm³: those of concrete and other large nozzles.
const LITRE_MM3: f64 = 1e6;
/// Reasons that a terminal shows; the last of them represents the rest.
const REASONS_SHOWN: usize = 3;
/// An area of which lines cover less than this counts as hollow.
const HOLLOW_PCT: f64 = 2.0;

/// The verdict; `more` are reasons that are not in a figure, `is_cold` if neither machine file nor input contain
/// heat.
pub fn verdict(figures: &Figures, more: &[String], is_cold: bool) -> VerdictFigures {
    let objections = figures.objections.iter().flatten().cloned();
    let reasons: Vec<String> = objections
        .chain(faults(figures))
        .chain(figures.uneven_places.iter().flatten().filter_map(uneven))
        .chain(more.iter().cloned())
        .collect();
    let lines = [
        time(figures),
        material(figures, is_cold),
        steps(figures),
        laid(figures),
        limit(figures),
        joined([open(figures), left_out(figures)]),
    ];
    VerdictFigures {
        reasons,
        lines: lines.into_iter().flatten().collect(),
    }
}

/// Lines of a terminal: of many reasons the first ones.
pub fn terminal_lines(verdict: &VerdictFigures) -> Vec<String> {
    let reasons = &verdict.reasons;
    let mut lines = match reasons.len() {
        0 => vec!["Nothing was found against starting it.".to_string()],
        count if count <= REASONS_SHOWN => reasons.clone(),
        count => {
            let shown = &reasons[..REASONS_SHOWN - 1];
            let rest = count - shown.len();
            let rest = format!("and {rest} more reasons not to start it (--figures shows them)");
            shown.iter().cloned().chain([rest]).collect()
        }
    };
    lines.extend(verdict.lines.iter().cloned());
    lines
}

/// The sentences of a page.
pub fn page_text(figures: &Figures) -> String {
    let made = || verdict(figures, &[], false);
    let VerdictFigures { reasons, lines } = figures.verdict.clone().unwrap_or_else(made);
    let reasons = reasons.iter().map(|reason| format!("{reason}."));
    reasons.chain(lines).collect::<Vec<_>>().join(" ")
}

/// The first figures, a name and a value with its unit each.
pub fn tiles(figures: &Figures) -> Vec<(&'static str, String)> {
    let tiles = [
        ("Time", figures.print_s.map(duration)),
        (
            "Material",
            figures.volume_mm3.map(|v| format!("{v:.1} mm³")),
        ),
        match figures.solid_covered_pct {
            Some(v) => ("Solid area covered", Some(format!("{v:.1} %"))),
            None => ("Covered", figures.covered_pct.map(|v| format!("{v:.1} %"))),
        },
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

/// A failed simulation that was not reported as an objection.
fn faults(figures: &Figures) -> Option<String> {
    let faults = figures.faults.filter(|&faults| faults > 0)?;
    let is_told = figures.objections.iter().flatten();
    let is_told = is_told.into_iter().any(|line| line.starts_with("FAULT"));
    (!is_told).then(|| format!("FAULT: the controller stopped with {faults} fault(s)"))
}

/// What is uneven about a bead. Speed that falls at no limit is none: machines that turn the part slow down between two.
fn uneven(found: &UnevenFigures) -> Option<String> {
    let worst = found.worst;
    let what = match found.what.as_str() {
        "spin" => format!(
            "SPINS: the nozzle turns by up to {worst:.0}° more than the path within a bead's width"
        ),
        "thin" => format!(
            "THIN: the bead has as little as {worst:.2} of its cross-section before and behind"
        ),
        "swollen" => format!(
            "SWELLS: the bead has up to {worst:.1} times its cross-section before and behind"
        ),
        _ => return None,
    };
    let (x, y, z, layer) = (found.x_mm, found.y_mm, found.z_mm, found.layer + 1);
    let places = match found.places {
        1 => "in one place".to_string(),
        places => format!("in {places} places, the worst"),
    };
    Some(format!(
        "{what}, {places} near ({x:.1}, {y:.1}, {z:.1}) on layer {layer}"
    ))
}

fn time(figures: &Figures) -> Option<String> {
    let print_s = figures.print_s?;
    let time = duration(print_s);
    let passes = match figures.passes {
        Some(1) => " in one pass".to_string(),
        Some(passes) => format!(" in {passes} passes"),
        None => String::new(),
    };
    let against = figures.against.as_ref().map(|of| match of.print_s {
        Some(other_s) => format!(
            ", {:.2} of the {} with {}",
            print_s / other_s,
            duration(other_s),
            of.aperture
        ),
        None => format!("; it cannot be printed with {}", of.aperture),
    });
    let slicer = figures.slicer_estimate_s.map(|other_s| {
        format!(
            ", {:.2} of the {} that its slicer estimates",
            print_s / other_s,
            duration(other_s)
        )
    });
    let against = against.or(slicer).unwrap_or_default();
    Some(format!("Takes {time}{passes}{against}."))
}

/// Sentences in one line.
fn joined(sentences: [Option<String>; 2]) -> Option<String> {
    let known: Vec<String> = sentences.into_iter().flatten().collect();
    (!known.is_empty()).then(|| known.join(" "))
}

fn material(figures: &Figures, is_cold: bool) -> Option<String> {
    let volume_mm3 = figures.volume_mm3?;
    let mass = figures.mass_g.map(|mass_g| format!(", {mass_g:.2} g"));
    let filament = figures.filament_mm;
    let filament = filament.map(|mm| format!(", {:.2} m of filament", mm * 1e-3));
    let layers = figures.layers.map(|layers| format!(" in {layers} layers"));
    let [mass, filament, layers] = [mass, filament, layers].map(Option::unwrap_or_default);
    let heat = match is_cold {
        true => "; nothing is heated: the machine file has no [material]",
        false => "",
    };
    let volume = match figures.print_s {
        Some(print_s) if volume_mm3 >= LITRE_MM3 => {
            let litres = volume_mm3 / LITRE_MM3;
            let rate = 60.0 * litres / print_s.max(1e-9);
            format!("{litres:.2} l of material, on average {rate:.2} l/min")
        }
        _ => format!("{volume_mm3:.1} mm³ of material"),
    };
    Some(format!("Lays {volume}{mass}{filament}{layers}{heat}."))
}

fn steps(figures: &Figures) -> Option<String> {
    let tip_um = figures.tip_error_um_max?;
    Some(format!(
        "The simulated steps stay within {tip_um:.1} µm of the plan."
    ))
}

/// What a known material lays.
fn laid(figures: &Figures) -> Option<String> {
    let arrives = 100.0 + figures.laid_error_pct?;
    let mean = figures.bead_area_error_pct_mean.unwrap_or_default();
    let worst = figures.bead_area_worst.as_ref().map(|found| {
        let (worst, x, y, layer) = (found.worst, found.x_mm, found.y_mm, found.layer + 1);
        format!("; beads are off by {mean:.1} % in the mean, at worst {worst:+.1} % near ({x:.1}, {y:.1}) on layer {layer}")
    });
    Some(format!(
        "Of the material {arrives:.1} % arrives{}.",
        worst.unwrap_or_default()
    ))
}

/// A time for people.
pub fn duration(seconds: f64) -> String {
    // Rounded once, so that no 60 seconds and no 60 minutes are left over.
    let whole = seconds.round() as u64;
    let minutes = (seconds / 60.0).round() as u64;
    match seconds {
        s if s < 100.0 => format!("{s:.1} s"),
        s if s < 6000.0 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", minutes / 60, minutes % 60),
    }
}

fn open(figures: &Figures) -> Option<String> {
    let covered = figures.covered_pct?;
    let open = match figures.open_largest_mm2 {
        Some(open) if open > 0.0 => format!("; the largest place left open has {open:.2} mm²"),
        Some(_) => "; nothing is left open".to_string(),
        None => String::new(),
    };
    let Some((mm2, solid_pct)) = figures.sparse_mm2.zip(figures.solid_covered_pct) else {
        return Some(format!("Covers {covered:.1} % of the outline{open}."));
    };
    let open = open.replace("nothing", "nothing else");
    // The beads around a hollow area cover a little of it.
    let lines = match figures.sparse_covered_pct {
        Some(pct) if pct >= HOLLOW_PCT => format!("a sparse infill, which covers {pct:.0} % of it"),
        _ => "hollow on purpose".to_string(),
    };
    let summed = figures.layers.map_or("", |_| ", summed over the layers,");
    Some(format!(
        "Covers {solid_pct:.1} % of what is to be solid{open}. {mm2:.0} mm² inside{summed} are {lines}."
    ))
}

/// The parts that are not printed as drawn.
fn left_out(figures: &Figures) -> Option<String> {
    let unreachable = figures.unreachable_mm.filter(|mm| *mm > 0.0);
    let regions = figures.left_out_places.as_ref().map_or(0, Vec::len);
    let hanging = figures.overhang_mm2.filter(|mm2| *mm2 > 0.0);
    let parts = [
        unreachable.map(|mm| format!("{mm:.1} mm of the boundary are out of the nozzle's reach")),
        (regions > 0).then(|| match regions {
            1 => "1 region is not printed".to_string(),
            _ => format!("{regions} regions are not printed"),
        }),
        hanging.map(|mm2| format!("{mm2:.1} mm² hang over nothing")),
    ];
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    (!parts.is_empty()).then(|| format!("Left out: {}.", parts.join(", ")))
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

#[cfg(test)]
mod tests {
    //! Goal: the verdict has its order, whatever is known, and fits a terminal. Method: figures by hand.
    use super::*;
    use crate::report::figures::AgainstFigures;

    #[test]
    fn reasons_come_first_and_a_terminal_shows_few_of_many() {
        let mut figures = Figures {
            print_s: Some(3599.7),
            passes: Some(3),
            volume_mm3: Some(12.34),
            mass_g: Some(0.5),
            covered_pct: Some(99.5),
            open_largest_mm2: Some(0.0),
            unreachable_mm: Some(2.0),
            overhang_mm2: Some(3.0),
            tip_error_um_max: Some(9.2),
            time_share_by_limit: Some([("joint_c".to_string(), 0.5)].into()),
            against: Some(AgainstFigures {
                aperture: "circle 0.8 mm".to_string(),
                print_s: Some(7199.4),
            }),
            ..Figures::default()
        };
        let good = verdict(&figures, &[], true);
        assert!(good.reasons.is_empty());
        assert_eq!(
            terminal_lines(&good),
            [
                "Nothing was found against starting it.",
                "Takes 60 min 00 s in 3 passes, 0.50 of the 2 h 00 min with circle 0.8 mm.",
                "Lays 12.3 mm³ of material, 0.50 g; nothing is heated: the machine file has no [material].",
                "The simulated steps stay within 9.2 µm of the plan.",
                "50 % of the printing time is spent at the limit of joint c.",
                "Covers 99.5 % of the outline; nothing is left open. Left out: 2.0 mm of the boundary are out of the nozzle's reach, 3.0 mm² hang over nothing.",
            ]
        );
        let large = Figures {
            volume_mm3: Some(12.5e6),
            print_s: Some(600.0),
            ..Figures::default()
        };
        assert_eq!(
            verdict(&large, &[], false).lines[1],
            "Lays 12.50 l of material, on average 1.25 l/min."
        );
        let sparse = Figures {
            sparse_mm2: Some(250.4),
            sparse_covered_pct: Some(29.4),
            solid_covered_pct: Some(99.44),
            covered_pct: Some(65.9),
            open_largest_mm2: Some(0.0),
            layers: Some(3),
            ..Figures::default()
        };
        assert_eq!(
            verdict(&sparse, &[], true).lines,
            [
                "Covers 99.4 % of what is to be solid; nothing else is left open. 250 mm² inside, summed over \
                 the layers, are a sparse infill, which covers 29 % of it."
            ]
        );
        figures.objections = Some((0..7).map(|n| format!("RANGE: {n}")).collect());
        figures.faults = Some(1);
        let bad = verdict(&figures, &["COLD: nothing heats".to_string()], true);
        assert_eq!(bad.reasons.len(), 9);
        assert_eq!(
            bad.reasons.last().map(String::as_str),
            Some("COLD: nothing heats")
        );
        let lines = terminal_lines(&bad);
        assert_eq!(lines[..2], ["RANGE: 0", "RANGE: 1"]);
        assert!(lines[2].starts_with("and 7 more reasons"), "{lines:?}");
        // A terminal has twelve lines: two notes and how many more, and the job's line and its nozzle's after a
        // plan, which has no steps.
        let of_steps = 1;
        assert!(lines.len() - of_steps + 3 + 2 <= 12, "{lines:?}");
        assert!(page_text(&figures).starts_with("RANGE: 0. RANGE: 1. "));
        assert!(verdict(&Figures::default(), &[], true).lines.is_empty());
    }
}

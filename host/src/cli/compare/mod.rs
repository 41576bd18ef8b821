//! `headway compare`: the same part with several nozzles, side by side.
//!
//! In: an input, apertures, limits of the heading axis. Out: a table, JSON or a picture of time, ground and material of
//! each; the speed of the heading axis at which turning no longer pays.

mod sliced;

use crate::cli::args::compare::{CompareArgs, HeadingAxis};
use crate::cli::args::{PartArgs, SettingsArgs};
use crate::cli::error::CliError;
use crate::cli::plan::planned;
use crate::cli::reading::load;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::result_kind::PICTURE;
use crate::pipeline::page::pictures;
use crate::pipeline::planned::Planned;
use crate::report::compare_picture::{self, Bar};
use crate::report::figures::Figures;
use crate::report::plan_picture;
use crate::settings::Quality;
use crate::settings::aperture_text::words_of;
use clap::ValueEnum;
use serde::Serialize;
use sliced::SlicedFile;
use std::fmt::Write;
use std::ops::RangeInclusive;

/// Slowest heading axis that is tried, against the given one.
const SLOWEST: f64 = 1.0 / 64.0;
/// About the most nozzles that a picture of a layer draws.
const PLACED_MAX: usize = 700;
/// Density of the material that is printed most, g/cm³.
const PLA_G_CM3: f64 = 1.24;
/// Densities that are taken, as in a machine file.
const DENSITIES: RangeInclusive<f64> = 0.001..=30.0;
/// Shells that are taken.
const SHELLS_MM: RangeInclusive<f64> = 0.01..=1000.0;
/// Of a wall: what a shell may be thinner by, as roundings of its size are.
const SHELL_SLACK: f64 = 0.05;
/// Parts whose masses differ by more are hardly the same.
const MASS_RATIO: f64 = 1.05;
/// Halvings of the range of speeds: the last is 1.07 times the one before.
const HALVINGS: usize = 6;

/// What a nozzle does with the part.
#[derive(Clone, Debug, Default, Serialize)]
struct Row {
    aperture: String,
    /// The slicer's file whose lines these are.
    #[serde(skip_serializing_if = "Option::is_none")]
    sliced: Option<String>,
    /// What its slicer estimates, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    slicer_estimate_s: Option<f64>,
    /// Duration of the job, s.
    print_s: Option<f64>,
    /// Boundary that cannot be touched, mm.
    unreachable_mm: Option<f64>,
    /// Ground that is to be filled and stays open, over all layers, mm².
    open_mm2: Option<f64>,
    flow_interruptions: Option<u64>,
    /// By --density, the machine file's `[material]`, or the density of PLA.
    mass_g: Option<f64>,
    volume_mm3: Option<f64>,
    /// What the heading axis was planned with; none where no joint turns the nozzle.
    heading_speed_max_deg_s: Option<f64>,
    heading_acceleration_max_deg_s2: Option<f64>,
    /// Why it cannot be printed with this nozzle.
    #[serde(skip_serializing_if = "Option::is_none")]
    refused: Option<String>,
    /// No density was given.
    #[serde(skip)]
    is_pla: bool,
    #[serde(skip)]
    is_round: bool,
    #[serde(skip)]
    picture: Option<String>,
}

impl Row {
    /// What the row is of.
    fn label(&self) -> String {
        match &self.sliced {
            Some(name) => format!("{name}, {}", words_of(&self.aperture)),
            None => words_of(&self.aperture),
        }
    }
}

pub(crate) fn run(args: &CompareArgs, console: &Console) -> Result<(), CliError> {
    let apertures = &args.asked.settings.aperture;
    if apertures.len() + usize::from(args.sliced.is_some()) < 2 || apertures.is_empty() {
        return Err(CliError::Usage(
            "compare needs --aperture at least twice, once for each nozzle, or once beside --sliced"
                .to_string(),
        ));
    }
    let file = args
        .picture
        .as_ref()
        .map(|path| path.file(PICTURE, console));
    let file = file.transpose()?;
    if let Some(density) = args.density.filter(|of| !DENSITIES.contains(of)) {
        return Err(CliError::Usage(format!(
            "--density {density}: write 0.001 to 30 g/cm³"
        )));
    }
    if let Some(shell_mm) = args.shell.filter(|of| !SHELLS_MM.contains(of)) {
        return Err(CliError::Usage(format!(
            "--shell {shell_mm}: write 0.01 to 1000 mm"
        )));
    }
    let axis = HeadingAxis {
        speed_max_rad_s: args.heading_speed.map(f64::to_radians),
        acceleration_max_rad_s2: args.heading_acceleration.map(f64::to_radians),
        slower: 1.0,
    };
    let rows = planned_rows(args, axis, console)?;
    if rows.iter().all(|row| row.refused.is_some()) {
        let reasons = rows.iter().filter_map(|row| row.refused.as_deref());
        return Err(CliError::Job(reasons.collect::<Vec<_>>().join("\n")));
    }
    let break_even = match args.break_even {
        true => Some(break_even(args, axis, &rows, console)?),
        false => None,
    };
    if let Some(file) = &file {
        file.write(picture(args, &rows).as_bytes())?;
    }
    match args.json {
        true => {
            let text = serde_json::to_string_pretty(&rows).unwrap_or_default();
            break_even.iter().for_each(|line| console.say(line));
            console.result(&(text + "\n"))
        }
        false => console
            .result(&(below_table(&rows, args) + &break_even.map_or(String::new(), |l| l + "\n"))),
    }
}

/// Plans with each nozzle, and the slicer's file. The row of each is printed when it is there: what is ended with Ctrl-C keeps
/// those above.
fn planned_rows(
    args: &CompareArgs,
    axis: HeadingAxis,
    console: &Console,
) -> Result<Vec<Row>, CliError> {
    let apertures = &args.asked.settings.aperture;
    let sliced = args
        .sliced
        .as_ref()
        .map(|path| SlicedFile::read(path, console));
    let sliced = sliced.transpose()?;
    let names = apertures.iter().map(|aperture| words_of(aperture));
    let of_file = |file: &SlicedFile| format!("{}, {}", file.name(), words_of(&file.aperture));
    let names: Vec<String> = names.chain(sliced.as_ref().map(of_file)).collect();
    let widest = names.iter().map(|name| name.chars().count()).max();
    let width = widest.unwrap_or(0).max("nozzle".len());
    let mut rows: Vec<Row> = Vec::new();
    if !args.json {
        console.result(&table_head(width))?;
    }
    for (number, name) in names.iter().enumerate() {
        console.say(&format!("with {name} ({} of {}):", number + 1, names.len()));
        let row = match (apertures.get(number), &sliced) {
            (Some(aperture), _) => {
                let asked = of_nozzle(args, aperture, axis)?;
                match plan_with(args, &asked, console)? {
                    Ok(planned) => row(args, aperture, &planned),
                    Err(refused) => Row {
                        aperture: aperture.clone(),
                        refused: Some(refused),
                        ..Row::default()
                    },
                }
            }
            (None, Some(sliced)) => {
                let planned = sliced.planned(args, axis, console)?;
                Row {
                    sliced: Some(sliced.name()),
                    slicer_estimate_s: planned.figures.slicer_estimate_s,
                    ..row(args, &sliced.aperture, &planned)
                }
            }
            (None, None) => continue,
        };
        let first_s = rows.iter().find_map(|row| row.print_s);
        if !args.json {
            console.result(&table_row(&row, first_s.or(row.print_s), width))?;
        }
        rows.push(row);
    }
    Ok(rows)
}

/// What is asked for with one of the nozzles: fast where nothing asks for another quality, and with as many walls as --shell
/// needs.
fn of_nozzle(args: &CompareArgs, aperture: &str, axis: HeadingAxis) -> Result<PartArgs, CliError> {
    let mut asked = args.asked.clone();
    let settings = &mut asked.settings;
    settings.aperture = vec![aperture.to_string()];
    settings.heading_axis = Some(axis);
    settings.is_draft = true;
    if let Some(shell_mm) = args.shell {
        // Lines inside need walls to be inside of.
        settings.options.walls = Some(1);
        let widest_mm = 2.0 * load::settings(settings)?.aperture.major_mm();
        settings.options.walls = Some((shell_mm / widest_mm - SHELL_SLACK).ceil().max(1.0) as u32);
    }
    Ok(asked)
}

/// Plans with one nozzle; why the part cannot be printed with it is no error. Options that are wrong are wrong for all.
fn plan_with(
    args: &CompareArgs,
    asked: &PartArgs,
    console: &Console,
) -> Result<Result<Planned, String>, CliError> {
    match planned::from_input(&args.input, asked, &[], None, console) {
        Ok(planned) => Ok(Ok(planned)),
        Err(error) if !error.is_of_part() => Err(error),
        Err(error) => Ok(Err(error.to_string())),
    }
}

fn row(args: &CompareArgs, aperture: &str, planned: &Planned) -> Row {
    let figures = &planned.figures;
    let picture = args.picture.is_some();
    let heading = planned.settings.heading_joint();
    Row {
        aperture: aperture.to_string(),
        sliced: None,
        slicer_estimate_s: None,
        print_s: figures.print_s,
        unreachable_mm: figures.unreachable_mm,
        open_mm2: open_mm2(figures),
        flow_interruptions: figures.flow_interruptions,
        mass_g: figures
            .volume_mm3
            .map(|mm3| mm3 * 1e-3 * density(args, planned)),
        volume_mm3: figures.volume_mm3,
        heading_speed_max_deg_s: heading.map(|of| of.speed_max.to_degrees()),
        heading_acceleration_max_deg_s2: heading.map(|of| of.acceleration_max.to_degrees()),
        refused: None,
        is_pla: planned
            .settings
            .material
            .and_then(|of| of.density_g_cm3)
            .is_none(),
        is_round: planned.settings.aperture.is_round(),
        picture: picture.then(|| layer_picture(aperture, planned)),
    }
}

/// g/cm³.
fn density(args: &CompareArgs, planned: &Planned) -> f64 {
    let of_material = planned.settings.material.and_then(|of| of.density_g_cm3);
    args.density.or(of_material).unwrap_or(PLA_G_CM3)
}

/// Ground that nothing covers but should, over all layers; `area_mm2` is that of one.
fn open_mm2(figures: &Figures) -> Option<f64> {
    let all_mm2 = figures.area_mm2? * figures.layers.unwrap_or(1) as f64;
    let sparse = figures.sparse_mm2.zip(figures.solid_covered_pct);
    let (solid_mm2, covered_pct) = match sparse {
        Some((sparse_mm2, covered_pct)) => (all_mm2 - sparse_mm2, covered_pct),
        None => (all_mm2, figures.covered_pct?),
    };
    Some((solid_mm2 * (100.0 - covered_pct) / 100.0).max(0.0))
}

fn layer_picture(aperture: &str, planned: &Planned) -> String {
    let layer = planned.stream.layers() / 2;
    let mut picture = pictures::plan_picture(aperture, planned, layer);
    // Several stand in one file, side by side: a medial axis and every nozzle would only blacken them.
    picture.axis.clear();
    let placed: usize = picture.passes.iter().map(|of| of.placements.len()).sum();
    let every = placed.div_ceil(PLACED_MAX).max(1);
    for pass in &mut picture.passes {
        pass.placements = thinned(&pass.placements, every);
        pass.speeds_mm_s = thinned(&pass.speeds_mm_s, every);
    }
    plan_picture::draw(&picture)
}

/// Every so many, and the last.
fn thinned<T: Clone>(of: &[T], every: usize) -> Vec<T> {
    let last = of.len().saturating_sub(1);
    let kept = of.iter().enumerate();
    let kept = kept.filter(|(number, _)| number % every == 0 || *number == last);
    kept.map(|(_, item)| item.clone()).collect()
}

fn picture(args: &CompareArgs, rows: &[Row]) -> String {
    let labels: Vec<String> = rows.iter().map(Row::label).collect();
    let bars = rows.iter().zip(&labels).flat_map(|(row, label)| {
        let own = Bar {
            label,
            seconds: row.print_s,
            layer: row.picture.as_deref(),
        };
        let estimate = row.slicer_estimate_s.map(|seconds| Bar {
            label: "its slicer's estimate",
            seconds: Some(seconds),
            layer: None,
        });
        [Some(own), estimate].into_iter().flatten()
    });
    let name = args.input.file_stem().unwrap_or_default().to_string_lossy();
    compare_picture::draw(&name, &bars.collect::<Vec<_>>())
}

/// The first line of the table.
fn table_head(width: usize) -> String {
    format!(
        "{:width$}  {:>9}  {:>5}  {:>9}  {:>14}  {:>13}  {:>7}\n",
        "nozzle", "time s", "ratio", "open mm²", "unreachable mm", "interruptions", "mass g"
    )
}

/// A row, its time against the first's.
fn table_row(row: &Row, first_s: Option<f64>, width: usize) -> String {
    let number = |value: Option<f64>, digits: usize| {
        value.map_or("-".to_string(), |value| format!("{value:.digits$}"))
    };
    let ratio = row.print_s.zip(first_s).map(|(own, first)| own / first);
    let interruptions = row.flow_interruptions.map(|count| count as f64);
    let mut text = format!(
        "{:width$}  {:>9}  {:>5}  {:>9}  {:>14}  {:>13}  {:>7}\n",
        row.label(),
        number(row.print_s, 1),
        number(ratio, 2),
        number(row.open_mm2, 2),
        number(row.unreachable_mm, 1),
        number(interruptions, 0),
        number(row.mass_g, 2),
    );
    if let Some(reason) = &row.refused {
        let _ = writeln!(text, "  cannot be printed with it: {reason}");
    }
    if let Some(seconds) = row.slicer_estimate_s {
        let _ = writeln!(text, "  its slicer estimates {seconds:.1} s");
    }
    text
}

/// What the words of the table mean, and what all rows have in common.
fn below_table(rows: &[Row], args: &CompareArgs) -> String {
    let mut text = String::from(
        "ratio: to the first time; open: solid area that stays uncovered; unreachable: boundary that the nozzle cannot touch; \
         interruptions: stops of the flow between beads\n",
    );
    let quality = args.asked.settings.options.quality.unwrap_or(Quality::Fast);
    let name = quality.to_possible_value();
    let name = name.as_ref().map_or("", |value| value.get_name());
    if rows.iter().any(|row| row.sliced.is_none()) {
        let more = match quality {
            Quality::Fast => "; `plan` is standard by itself, --quality standard compares so",
            _ => "",
        };
        let _ = writeln!(text, "planned with --quality {name}{more}");
    }
    let masses = rows.iter().filter_map(|row| row.mass_g);
    let [least, most] = masses.fold([f64::INFINITY, 0.0], |[least, most]: [f64; 2], mass| {
        [least.min(mass), most.max(mass)]
    });
    if most > MASS_RATIO * least {
        let pct = 100.0 * (most / least - 1.0);
        let how = match args.shell {
            Some(_) => "",
            None => {
                ": two walls of one nozzle are not two of another; --shell MM gives all the same shell"
            }
        };
        let _ = writeln!(text, "the parts differ by {pct:.0} % in mass{how}");
    }
    if let Some(line) = heading_line(rows, args) {
        text += &line;
    }
    if args.density.is_none() && rows.iter().any(|row| row.is_pla) {
        let _ = writeln!(
            text,
            "mass at {PLA_G_CM3} g/cm³ (PLA); --density, or [material] of the machine file, says another"
        );
    }
    text
}

/// What the heading axis was planned with, and where that is from.
fn heading_line(rows: &[Row], args: &CompareArgs) -> Option<String> {
    let limits = |row: &Row| {
        Some((
            row.heading_speed_max_deg_s?,
            row.heading_acceleration_max_deg_s2?,
        ))
    };
    let (speed, acceleration) = rows.iter().find_map(limits)?;
    let of_machine = SettingsArgs {
        aperture: Vec::new(),
        ..args.asked.settings.clone()
    };
    let motor = load::settings(&of_machine).ok();
    let motor = motor.and_then(|settings| settings.heading_motor);
    let source = match (args.heading_speed.or(args.heading_acceleration), motor) {
        (Some(_), _) => "as given".to_string(),
        (None, Some(motor)) => format!(
            "the lesser of the joint's limits and its motor's, {:.0}°/s² with a gear of {}; a gear of {:.2} accelerates most",
            motor.acceleration_max_rad_s2().to_degrees(),
            motor.gear_ratio,
            motor.fastest_ratio(),
        ),
        (None, None) => {
            "the machine's; [drivers.c] or --heading-speed says what your motor reaches".to_string()
        }
    };
    Some(format!(
        "heading axis: {speed:.0}°/s and {acceleration:.0}°/s² ({source})\n"
    ))
}

/// The heading axis at which the first nozzle that turns takes as long as the fastest round one.
fn break_even(
    args: &CompareArgs,
    axis: HeadingAxis,
    rows: &[Row],
    console: &Console,
) -> Result<String, CliError> {
    let round = rows.iter().filter(|row| row.is_round);
    let round = round.filter_map(|row| Some((row.print_s?, words_of(&row.aperture))));
    let round = round.min_by(|a, b| a.0.total_cmp(&b.0));
    let turned = rows
        .iter()
        .find(|row| !row.is_round && row.print_s.is_some());
    let (Some((round_s, round)), Some(turned)) = (round, turned) else {
        return Ok("break-even: needs a round nozzle and one that is not".to_string());
    };
    let turned_s = |slower: f64| -> Result<f64, CliError> {
        let axis = HeadingAxis { slower, ..axis };
        let asked = of_nozzle(args, &turned.aperture, axis)?;
        console.say(&format!(
            "with {} and {slower:.2} of the heading axis:",
            words_of(&turned.aperture)
        ));
        let planned = plan_with(args, &asked, console)?.ok();
        let print_s = planned.and_then(|planned| planned.figures.print_s);
        Ok(print_s.unwrap_or(f64::INFINITY))
    };
    let settings = load::settings(&of_nozzle(args, &turned.aperture, axis)?.settings)?;
    let of_axis = |slower: f64| {
        let joint = settings.heading_joint();
        joint.map_or("the heading axis".to_string(), |joint| {
            let limits = [joint.speed_max, joint.acceleration_max];
            let [speed, acceleration] = limits.map(|max| (max * slower).to_degrees());
            format!("a heading axis of {speed:.0}°/s and {acceleration:.0}°/s²")
        })
    };
    let aperture = words_of(&turned.aperture);
    if turned.print_s.unwrap_or(f64::INFINITY) >= round_s {
        let axis = of_axis(1.0);
        return Ok(format!(
            "break-even: with {axis} {aperture} already takes longer than {round}"
        ));
    }
    if turned_s(SLOWEST)? < round_s {
        let axis = of_axis(SLOWEST);
        return Ok(format!(
            "break-even: even with {axis} {aperture} is faster than {round}"
        ));
    }
    // Log of the factor: faster at the high end, slower at the low one.
    let (mut low, mut high) = (SLOWEST.ln(), 0.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match turned_s(middle.exp())? < round_s {
            true => high = middle,
            false => low = middle,
        }
    }
    let axis = of_axis(high.exp());
    Ok(format!(
        "break-even: {aperture} takes longer than {round} with less than {axis}"
    ))
}

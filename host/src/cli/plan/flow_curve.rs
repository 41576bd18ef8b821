//! `headway calibrate flow --weights`: what slugs weighed -> `flow_loss`, on the terminal and in a machine file.
//!
//! In: a table with the columns `mm3_s` and `g`, the settings by which the slugs were extruded. Out: the curve's points
//! with their errors, the rows that are doubted, the key; with `--write` the machine file with it, the old one beside
//! it. Leaves out the fit (`calibration/flow_curve.rs`).

use super::calibrate::pattern_error;
use crate::calibration::{FlowFit, Weight, fitted};
use crate::cli::args::calibrate::CalibrateArgs;
use crate::cli::error::CliError;
use crate::cli::reading::{load, machine_keys};
use crate::cli::terminal::console::Console;
use crate::settings::Settings;
use crate::text::short_number::Short;
use serde_json::json;
use std::path::Path;

const KEY: &str = "flow_loss";

pub(super) fn run(
    file: &Path,
    settings: &Settings,
    args: &CalibrateArgs,
    console: &Console,
) -> Result<(), CliError> {
    let weights = weights(&load::read_text(file)?)
        .map_err(|problem| CliError::Job(format!("{}: {problem}", file.display())))?;
    let fit = fitted(&weights, settings).map_err(pattern_error)?;
    let value = value(&fit);
    let kept = args
        .write
        .as_deref()
        .map(|path| machine_keys::put(path, &[("extruder", KEY, value.clone())]))
        .transpose()?;
    if args.json {
        return console.result(&as_json(&fit, &value));
    }
    let mut text = as_text(&fit, &value);
    if let (Some(path), Some(kept)) = (&args.write, kept) {
        text += &format!(
            "{}: {KEY} is written, the file before it is {}\n",
            path.display(),
            kept.display()
        );
    }
    console.result(&text)
}

/// Rows under a head that names the columns, in any order.
fn weights(text: &str) -> Result<Vec<Weight>, String> {
    let mut rows = text
        .lines()
        .zip(1..)
        .filter(|(line, _)| !line.trim().is_empty());
    let cells = |line: &str| -> Vec<String> {
        line.split([',', ';', '\t'])
            .map(|cell| cell.trim().to_string())
            .collect()
    };
    let (head, _) = rows
        .next()
        .ok_or("it is empty: write the head `mm3_s,g` and a row for each slug")?;
    let head = cells(head);
    let column = |name: &str| {
        let found = head.iter().position(|cell| cell == name);
        found.ok_or_else(|| format!("line 1: no column `{name}`: the head is `mm3_s,g`"))
    };
    let (rate, weight) = (column("mm3_s")?, column("g")?);
    rows.map(|(line, number)| {
        let cells = cells(line);
        let number_in = |column: usize| {
            let cell = cells.get(column).map_or("", String::as_str);
            cell.parse::<f64>()
                .map_err(|_| format!("line {number}: `{cell}` is no number"))
        };
        Ok(Weight {
            line: number,
            mm3_s: number_in(rate)?,
            g: number_in(weight)?,
        })
    })
    .collect()
}

/// The key's, with as many digits as are told apart.
fn value(fit: &FlowFit) -> String {
    let point = |flow: f64, share: f64| {
        format!(
            "[{}, {}]",
            Short((flow * 1e3).round() / 1e3),
            Short((share * 1e4).round() / 1e4)
        )
    };
    let points: Vec<String> = fit
        .points
        .iter()
        .map(|of| point(of.mm3_s, of.share))
        .collect();
    format!("[{}]", points.join(", "))
}

fn as_text(fit: &FlowFit, value: &str) -> String {
    let mut text = format!("{:>10}  {:>12}  {:>10}\n", "mm³/s", "lost %", "+- %");
    for point in &fit.points {
        text += &format!(
            "{:>10.2}  {:>12.2}  {:>10.2}\n",
            point.mm3_s,
            100.0 * point.share,
            100.0 * point.error
        );
    }
    text += &format!(
        "weights about the curve: {:.2} % (standard deviation)\n",
        100.0 * fit.deviation
    );
    for (weight, off) in &fit.doubted {
        text += &format!(
            "doubted: line {}, {} g at {} mm³/s is {:+.1} % of the flow off the others, and left out: weigh it again\n",
            weight.line,
            Short(weight.g),
            Short(weight.mm3_s),
            100.0 * off
        );
    }
    text + &format!(
        "change: [extruder] {KEY} = {value}\nThey hold for the machine file by which the slugs were extruded.\n"
    )
}

fn as_json(fit: &FlowFit, value: &str) -> String {
    let points = fit
        .points
        .iter()
        .map(|point| json!({ "mm3_s": point.mm3_s, "share": point.share, "error": point.error }));
    let doubted = fit.doubted.iter().map(|(weight, off)| {
        json!({ "line": weight.line, "mm3_s": weight.mm3_s, "g": weight.g, "off": off })
    });
    let table = json!({
        "pattern": "flow",
        "points": points.collect::<Vec<_>>(),
        "deviation": fit.deviation,
        "doubted": doubted.collect::<Vec<_>>(),
        KEY: value.parse::<toml::Value>().ok(),
    });
    format!("{table:#}\n")
}

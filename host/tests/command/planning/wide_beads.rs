//! Goal: what users of clay, concrete and pellets look at is right: how evenly a bead lies in curves, how long layers
//! take, that a pump's start and stop are its own, that a vase is printed without a rest. Method: the binary on rings
//! whose radii, volumes and heights are known by hand; poses of the job's own table.

use crate::rig::{Table, example, folder, headway, object, path, stderr, succeeded};
use serde_json::{Map, Value};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// A ring between two rounded rectangles, 1 x 0.8 m outside, a wall of 40 mm; the path's radius in its corners is 130 mm.
fn wall(folder: &Path) -> PathBuf {
    let rounded = |[w, h, r]: [f64; 3]| -> Vec<[f64; 2]> {
        let corners = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
        let arcs = corners.iter().enumerate().flat_map(|(quarter, [x, y])| {
            (0..=24).map(move |i| {
                let angle = TAU / 4.0 * (quarter as f64 + f64::from(i) / 24.0);
                [
                    x * (w / 2.0 - r) + r * angle.cos(),
                    y * (h / 2.0 - r) + r * angle.sin(),
                ]
            })
        });
        arcs.collect()
    };
    let outline = serde_json::json!({
        "units": "mm",
        "exterior": rounded([1000.0, 800.0, 150.0]),
        "holes": [rounded([920.0, 720.0, 110.0])],
    });
    let file = folder.join("wall.json");
    std::fs::write(&file, outline.to_string()).expect("written");
    file
}

/// A tube of 6 mm with a wall of 0.8 mm: one bead of the built-in nozzle.
fn tube(folder: &Path) -> PathBuf {
    let circle = |r: f64| -> Vec<[f64; 2]> {
        let angles = (0..120).map(|i| TAU * f64::from(i) / 120.0);
        angles.map(|a| [r * a.cos(), r * a.sin()]).collect()
    };
    let outline = serde_json::json!({
        "units": "mm", "exterior": circle(6.4), "holes": [circle(5.6)],
    });
    let file = folder.join("tube.json");
    std::fs::write(&file, outline.to_string()).expect("written");
    file
}

fn concrete() -> String {
    example("machines/concrete.toml")
}

fn figures(arguments: &[&str]) -> Map<String, Value> {
    object(&headway(arguments))
}

fn number(figures: &Map<String, Value>, key: &str) -> f64 {
    figures[key].as_f64().expect(key)
}

/// Rows of a job's table: time s, x, y, z mm, flow mm³/s, state.
fn rows(job: &Path, every_ms: &str) -> Vec<([f64; 5], String)> {
    let export = ["export", path(job), "--to", "csv", "--every-ms", every_ms];
    let table = Table::of(&succeeded(&headway(&export)));
    let columns = ["t_s", "x_mm", "y_mm", "z_mm", "flow_mm3_s"].map(|name| table.column(name));
    let states = table.texts("state").into_iter().enumerate();
    let row =
        |(at, state): (usize, &str)| ([0, 1, 2, 3, 4].map(|k| columns[k][at]), state.to_string());
    states.map(row).collect()
}

/// A job that is only looked at by its figures.
fn spare(folder: &Path) -> PathBuf {
    folder.join("spare.hwj")
}

/// Goal: the ratio is (R + w/2) / (R - w/2), its place in a corner, and a bound that the wall has room for is kept without
/// a slower print. Method: by hand 150 / 110 = 1.364 on the mean line; the bead fills the wall, so that no path has less
/// in its corners; the bound of 1.5 is kept within 4 %, which is what the fitted segments waver by within their tolerance
/// of 0.1 mm, on all but 16 mm of 3.2 m.
#[test]
fn a_curve_gets_more_on_its_outside() {
    let folder = folder("outer-inner");
    let (input, machine) = (wall(&folder), concrete());
    let plan = [
        "plan",
        path(&input),
        "-m",
        &machine,
        "--pass",
        "one",
        "--json",
    ];
    let spare = spare(&folder);
    let plan = [&plan[..], &["-o", path(&spare)]].concat();
    let free = figures(&plan);
    let free_ratio = number(&free, "outer_inner_ratio_max");
    assert!((1.36..2.0).contains(&free_ratio), "{free_ratio}");
    let at = free["outer_inner_ratio_at_mm"].as_array().expect("a place");
    let [x, y] = [0, 1].map(|axis| at[axis].as_f64().expect("a number").abs());
    assert!(x > 345.0 && y > 245.0, "{x} {y}");
    assert!(!free.contains_key("outer_inner_over_mm"));
    let bound = figures(&[&plan[..], &["--max-outer-inner-ratio", "1.5"]].concat());
    assert!(number(&bound, "outer_inner_ratio_max") < 1.56);
    assert!(number(&bound, "outer_inner_over_mm") < 16.0);
    assert!(number(&bound, "print_s") < 1.02 * number(&free, "print_s"));
}

/// Goal: a bound that cannot be kept is reported with its place, first, and refuses the job only where that is asked for.
/// Method: 1.2 on the same wall, whose corners have 1.36.
#[test]
fn curves_that_stay_too_tight_are_reported() {
    let folder = folder("tight-curves");
    let (input, machine) = (wall(&folder), concrete());
    let job = folder.join("wall.hwj");
    let plan = [
        "plan",
        path(&input),
        "-m",
        &machine,
        "--pass",
        "one",
        "--max-outer-inner-ratio",
        "1.2",
        "-o",
        path(&job),
    ];
    let planned = headway(&plan);
    let text = succeeded(&planned);
    assert!(text.starts_with("TIGHT CURVES: "), "{text}");
    assert!(job.exists());
    std::fs::remove_file(&job).expect("removed");
    let refused = headway(&[&plan[..], &["--refuse", "curves"]].concat());
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        stderr(&refused).contains("outer_inner_ratio_max = 1.2"),
        "{}",
        stderr(&refused)
    );
    assert!(!job.exists());
}

/// Goal: layers over the time that keeps joints warm are counted, named, and refused on request. Method: three layers of
/// some 37 s each; a bound of 20 s and one of 200 s.
#[test]
fn layers_that_take_too_long_are_reported() {
    let folder = folder("cold-joints");
    let (input, machine) = (wall(&folder), concrete());
    let plan = [
        "plan",
        path(&input),
        "-m",
        &machine,
        "--pass",
        "one",
        "--layers",
        "3",
    ];
    let spare = spare(&folder);
    let plan = [&plan[..], &["-o", path(&spare)]].concat();
    let late = headway(&[&plan[..], &["--max-layer-time", "20", "--json"]].concat());
    let late = object(&late);
    assert_eq!(late["late_layers"], 3);
    let longest_s = number(&late, "layer_time_longest_s");
    assert!((20.0..60.0).contains(&longest_s), "{longest_s}");
    let reasons = late["objections"].to_string();
    assert!(reasons.contains("COLD JOINTS: 3 of 3 layers"), "{reasons}");
    let refused = headway(
        &[
            &plan[..],
            &["--max-layer-time", "20", "--refuse", "layer-time"],
        ]
        .concat(),
    );
    assert_eq!(refused.status.code(), Some(1));
    let fine = figures(
        &[
            &plan[..],
            &[
                "--max-layer-time",
                "200",
                "--refuse",
                "layer-time",
                "--json",
            ],
        ]
        .concat(),
    );
    assert_eq!(fine["late_layers"], 0);
    let crossed = "layer_height_mm = 12\nlayer_time_min_s = 50\nlayer_time_max_s = 20";
    let text = std::fs::read_to_string(concrete()).expect("a machine");
    let file = folder.join("crossed.toml");
    std::fs::write(&file, text.replace("layer_height_mm = 12", crossed)).expect("written");
    let crossed = headway(&[
        "plan",
        path(&input),
        "-m",
        path(&file),
        "-o",
        path(&folder.join("x.hwj")),
    ]);
    assert_eq!(crossed.status.code(), Some(1));
    assert!(
        stderr(&crossed).contains("below print.layer_time_min_s"),
        "{}",
        stderr(&crossed)
    );
}

/// Goal: a pump that runs on is stopped before the bead's end and started before its begin, and all that is laid is what
/// the bead takes. Method: start and stop of 60 mm on the wall: the same volume within 0.3 % (the end of a loop lies over
/// its begin and takes less); hardly any flow on the last 24 mm of the bead, flow 100 mm before; primes beside it are refused.
#[test]
fn a_pump_runs_on() {
    let folder = folder("pump");
    let input = wall(&folder);
    let text = std::fs::read_to_string(concrete()).expect("a machine");
    let pumped = text.replace(
        "prime_lead_s = 0.02",
        "prime_lead_s = 0.02\npump_start_mm = 60\npump_stop_mm = 60",
    );
    let file = folder.join("pump.toml");
    std::fs::write(&file, &pumped).expect("written");
    let job = folder.join("wall.hwj");
    let machine = concrete();
    let with = |machine: &str| {
        figures(&[
            "plan",
            path(&input),
            "-m",
            machine,
            "--pass",
            "one",
            "-o",
            path(&job),
            "--json",
        ])
    };
    let plain = number(&with(&machine), "volume_mm3");
    let both = number(&with(path(&file)), "volume_mm3");
    assert!((both / plain - 1.0).abs() < 3e-3, "{both} {plain}");
    let printed: Vec<[f64; 5]> = rows(&job, "5")
        .into_iter()
        .filter(|(_, s)| s == "print")
        .map(|(r, _)| r)
        .collect();
    let [_, x, y, ..] = printed[printed.len() - 1];
    let off = |row: &&[f64; 5]| (row[1] - x).hypot(row[2] - y);
    let last = printed.iter().rev().take(400).collect::<Vec<_>>();
    let end = last.iter().filter(|row| off(row) < 24.0).map(|row| row[4]);
    // A hundredth of the flow: by so much the fit of the segments ripples.
    assert!(end.fold(0.0, f64::max) < 700.0);
    let before = last
        .iter()
        .filter(|row| (100.0..130.0).contains(&off(row)))
        .map(|row| row[4]);
    assert!(before.fold(f64::INFINITY, f64::min) > 1000.0);
    std::fs::write(&file, pumped.replace("prime_mm3 = 0", "prime_mm3 = 100")).expect("written");
    let refused = headway(&[
        "plan",
        path(&input),
        "-m",
        path(&file),
        "-o",
        path(&folder.join("x.hwj")),
    ]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        stderr(&refused).contains("pump_start_mm"),
        "{}",
        stderr(&refused)
    );
}

/// Goal: layers of one closed bead are one rise without a rest, as thick as a layer all along but for the begin, and take
/// less time. Method: a tube of 8 layers of 0.2 mm. Between the first bead and the last nothing but beads; the tip never
/// sinks; from the third loop on it is 0.2 mm above where it was a turn before, and at most that below; volume by hand:
/// loops of 0.625, 0.875 and then 1 times a layer's, 7.5 for 8.
#[test]
fn a_vase_rises_without_a_rest() {
    let folder = folder("vase");
    let (input, job) = (tube(&folder), folder.join("tube.hwj"));
    let plan = [
        "plan",
        path(&input),
        "--layers",
        "8",
        "--layer-height",
        "0.2",
        "--pass",
        "one",
        "-o",
        path(&job),
        "--json",
    ];
    let flat = figures(&plan);
    let vase = figures(&[&plan[..], &["--vase"]].concat());
    let volumes = [&flat, &vase].map(|f| number(f, "volume_mm3"));
    assert!(
        (volumes[1] / volumes[0] - 7.5 / 8.0).abs() < 2e-3,
        "{volumes:?}"
    );
    let times = [&flat, &vase].map(|f| number(f, "print_s"));
    assert!(times[1] < 0.93 * times[0], "{times:?}");
    assert_eq!(vase["flow_interruptions"], 0);
    assert_eq!(vase["by_layer"].as_array().map(Vec::len), Some(8));
    let table = rows(&job, "2");
    let prints = |(_, state): &&([f64; 5], String)| state == "print";
    let first = table.iter().position(|row| prints(&row)).expect("a bead");
    let last = table.iter().rposition(|row| prints(&row)).expect("a bead");
    assert!(table[first..=last].iter().all(|row| prints(&row)));
    let beads: Vec<[f64; 5]> = table[first..=last].iter().map(|(row, _)| *row).collect();
    assert!(beads.windows(2).all(|pair| pair[1][3] >= pair[0][3] - 2e-4));
    let bed_mm = beads[0][3] - 0.05;
    assert!((beads[beads.len() - 1][3] - bed_mm - 1.6).abs() < 1e-3);
    // Height over the angle, turned by turned.
    let mut turned = 0.0;
    let mut angles = vec![0.0];
    for pair in beads.windows(2) {
        let [a, b] = [0, 1].map(|i| pair[i][2].atan2(pair[i][1]));
        turned += (b - a + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
        angles.push(turned);
    }
    assert!((turned.abs() / TAU - 8.0).abs() < 0.2, "{turned}");
    for (index, angle) in angles.iter().enumerate() {
        let below = angles
            .iter()
            .position(|other| other.abs() >= angle.abs() - TAU);
        let Some(below) = below.filter(|_| angle.abs() > 1.02 * TAU) else {
            continue;
        };
        let apart_mm = beads[index][3] - beads[below][3];
        let least_mm = if angle.abs() > 2.02 * TAU {
            0.195
        } else {
            0.145
        };
        assert!((least_mm..0.205).contains(&apart_mm), "{angle} {apart_mm}");
    }
}

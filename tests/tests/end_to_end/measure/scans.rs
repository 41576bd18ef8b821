//! Goal: a scan tells what is wrong with a machine, and how well. Method: a layer of a machine that is wrong by known amounts,
//! scanned by the independent model of `headway_tests::scanner`, against what the library finds.

use headway::api::{self, Job, Machine, Options, Part, Reading, Scale};
use headway_tests::scanner::{Scanner, Truth, csv, scan};

fn job_of(part: &str) -> Job {
    let path = format!("{}/../examples/{part}.json", env!("CARGO_MANIFEST_DIR"));
    planned(&std::fs::read(path).expect("an example"))
}

fn planned(outline: &[u8]) -> Job {
    let part = Part::from_bytes("part", "json", outline, &Reading::default());
    let options = Options::default();
    api::plan(&part.expect("a part"), &Machine::default(), &options).expect("a job")
}

fn scanned(job: &Job, truth: &Truth, scanner: &Scanner) -> Vec<[f64; 3]> {
    let file = headway::job::file::read(&mut std::io::Cursor::new(job.bytes())).expect("a file");
    let stream = file.stream().expect("a stream");
    scan(&stream, file.header.transform.offset_mm, 0, truth, scanner)
}

/// The errors of all values are within those that are required.
fn tells(part: &str) {
    let job = job_of(part);
    let as_file = Truth::of(&headway::settings::Settings::default());
    let truth = Truth {
        flow: 0.96,
        wider_mm: 0.03,
        centre_mm: [0.06, -0.04],
        heading_rad: 2f64.to_radians(),
        lag_s: as_file.advance_s + 0.02,
        start_mm3: 0.02,
        stop_mm3: -0.01,
        ..as_file
    };
    let points = scanned(&job, &truth, &Scanner::default());
    let found = job.measure(csv(&points).as_bytes(), &Scale::MM, None);
    let found = found.expect("a scan of this job");
    println!("{part}: {:?}", found.registration);
    for estimate in &found.estimates {
        println!(
            "{} {:?} +- {:.4}",
            estimate.name, estimate.value, estimate.error
        );
    }
    for (name, expected, within) in [
        ("flow_factor", truth.flow, 0.005 * truth.flow),
        ("width_mm", truth.wider_mm, 0.02),
        ("nozzle_x_mm", truth.centre_mm[0], 0.015),
        ("nozzle_y_mm", truth.centre_mm[1], 0.015),
        ("heading_zero_deg", 2.0, 0.3),
        ("lag_s", truth.lag_s, 0.1 * truth.lag_s),
    ] {
        let value = found.value(name).expect(name);
        assert!((value - expected).abs() < within, "{part}: {name} {value}");
    }
}

#[test]
fn a_scan_tells_what_is_wrong_with_a_machine() {
    tells("letter");
}

#[test]
#[ignore = "three more parts of the same take half a minute"]
fn scans_of_other_parts_tell_it_as_well() {
    for part in ["gear", "u-part", "bracket"] {
        tells(part);
    }
}

/// Goal: what is no scan of the layer is refused with a reason. Method: an empty scan, one of no numbers, one of a bare bed, one
/// that is mirrored, one of another job.
#[test]
fn other_scans_are_refused() {
    let job = job_of("letter");
    let bed: String = (0..10_000)
        .map(|k| format!("{},{},0\n", k % 100, k / 100))
        .collect();
    let coarse = Scanner {
        spacing_mm: 0.12,
        ..Scanner::default()
    };
    let truth = Truth::of(&headway::settings::Settings::default());
    let points = scanned(&job, &truth, &coarse);
    let mirrored: Vec<[f64; 3]> = points.iter().map(|[x, y, z]| [-x, *y, *z]).collect();
    let other = planned(br#"{"units":"mm","exterior":[[0,0],[12,0],[12,5],[0,5]]}"#);
    for (text, told) in [
        (String::new(), "no points"),
        ("nan,nan,nan\n".repeat(100), "no points"),
        (bed, "above its bed"),
        (csv(&mirrored), "mirrored"),
        (csv(&scanned(&other, &truth, &coarse)), "does not fit"),
    ] {
        let refused = job.measure(text.as_bytes(), &Scale::MM, None);
        let refused = refused.expect_err("no scan of it").to_string();
        assert!(refused.contains(told), "{refused}");
    }
}

/// Rows of a scan over and over, so many that no memory holds them.
struct Repeated {
    rows: Vec<u8>,
    at: usize,
    left: u64,
}

impl std::io::Read for Repeated {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let length = into
            .len()
            .min(self.rows.len() - self.at)
            .min(self.left as usize);
        into[..length].copy_from_slice(&self.rows[self.at..self.at + length]);
        self.at = (self.at + length) % self.rows.len();
        self.left -= length as u64;
        Ok(length)
    }
}

/// Goal: a hundred million points are read in a minute and a gigabyte. Method: a scan's rows again and again, by the clock of a
/// release build; memory by the high-water mark of the process.
#[test]
#[ignore = "reads three gigabytes: `cargo test --release`, by itself"]
fn a_hundred_million_points_are_read() {
    let job = job_of("letter");
    let truth = Truth::of(&headway::settings::Settings::default());
    let points = scanned(&job, &truth, &Scanner::default());
    let rows = csv(&points).split_off("x,y,z\n".len()).into_bytes();
    let left = rows.len() as u64 * (100_000_000 / points.len() as u64 + 1);
    let rows = Repeated { rows, at: 0, left };
    let begun = std::time::Instant::now();
    let found = job.measure(std::io::BufReader::new(rows), &Scale::MM, None);
    let seconds = begun.elapsed().as_secs_f64();
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status
        .lines()
        .find(|line| line.starts_with("VmHWM"))
        .unwrap_or("");
    println!("{seconds:.1} s, {peak}");
    assert!(found.expect("a scan").points >= 100_000_000 && seconds < 60.0);
}

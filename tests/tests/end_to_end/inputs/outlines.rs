//! Goal: real slices are taken as they are, faulty ones refused with the place, and the examples
//! are what they say. Method: every file of the reference data (where it is there) and of
//! `examples/`, through the library's reader.

use headway::geometry::polygon::Region;
use headway::input::{Format, Loaded, ReadOptions, Units, read};
use headway::settings::machine_file;
use headway::text::refusal::Refusal;
use headway_tests::folders::files;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");
const REFERENCE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");

fn load(path: &Path, options: &ReadOptions) -> Result<Loaded, Refusal> {
    let bytes = std::fs::read(path).expect("file");
    let format = Format::of_ending(path).expect("ending");
    read(&bytes, "test", format, options)
}

fn says_valid(path: &Path) -> bool {
    let text = std::fs::read_to_string(path).expect("file");
    let value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    value["valid"].as_bool().expect("valid flag")
}

fn area_mm2(loaded: &Loaded) -> f64 {
    loaded.target.regions.iter().map(Region::area_mm2).sum()
}

#[test]
fn slices_are_taken_or_refused_as_they_are_marked() {
    let mut refused = 0;
    let paths = files(PathBuf::from(REFERENCE).join("slices"), "json");
    for path in &paths {
        let name = path.display();
        match (says_valid(path), load(path, &ReadOptions::default())) {
            (true, Ok(loaded)) => assert!(area_mm2(&loaded) > 0.0, "{name}"),
            (false, Err(error)) => {
                refused += 1;
                let message = error.to_string();
                // The place: "(x, y) mm".
                assert!(
                    message.contains(") mm") && message.contains('('),
                    "{name}: {message}"
                );
                let repair = ReadOptions {
                    repair: true,
                    ..ReadOptions::default()
                };
                let mended = load(path, &repair).expect("repair");
                assert!(
                    mended.notes.iter().any(|n| n.starts_with("repaired")),
                    "{name}"
                );
            }
            (true, Err(error)) => panic!("{name} is valid, but refused: {error}"),
            (false, Ok(_)) => panic!("{name} is not valid, but taken"),
        }
    }
    assert!(paths.is_empty() || refused == 2, "{refused} refused");
}

/// The awkward polygons, scaled to 100 mm: taken exactly where they are marked valid; all others
/// refused; and `--repair` leaves either a valid outline or a refusal, never a panic.
#[test]
fn awkward_polygons_are_judged_right() {
    for path in files(PathBuf::from(REFERENCE).join("polygons"), "json") {
        let text = std::fs::read_to_string(&path).expect("file");
        let value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let numbers = |axis: usize| {
            let points = value["exterior"].as_array().expect("exterior").iter();
            points.map(move |p| p[axis].as_f64().expect("number"))
        };
        let span = (0..2).map(|axis| {
            let low = numbers(axis).fold(f64::MAX, f64::min);
            numbers(axis).fold(f64::MIN, f64::max) - low
        });
        let options = ReadOptions {
            units: Some(Units::Mm),
            scale: 100.0 / span.fold(0.0, f64::max),
            ..ReadOptions::default()
        };
        let found = load(&path, &options);
        assert_eq!(
            found.is_ok(),
            says_valid(&path),
            "{}: {found:?}",
            path.display()
        );
        let repair = ReadOptions {
            repair: true,
            ..options
        };
        if let Ok(mended) = load(&path, &repair) {
            assert!(area_mm2(&mended) > 0.0, "{}", path.display());
        }
        // Their own units are not lengths.
        let message = load(&path, &ReadOptions::default())
            .expect_err("unit")
            .to_string();
        assert!(message.contains("are not known"), "{message}");
    }
}

#[test]
fn examples_have_the_area_they_were_drawn_with() {
    // mm², from the drawing: exact where it is made of straight lines, else to 0.1 %.
    let expected = [
        ("taper.json", 1, 74.0, 1e-9),
        ("thin-web.json", 1, 247.0, 1e-9),
        ("letter.svg", 2, 104.33, 1e-3),
        ("washers.geojson", 3, 161.14, 1e-3),
        ("u-part.json", 1, 198.55, 1e-3),
        ("bracket.json", 1, 270.16, 1e-3),
        ("gear.json", 1, 210.09, 1e-3),
        ("letter.json", 1, 158.91, 1e-3),
        ("dome-ring.json", 1, 691.15, 1e-3),
        // 3 mm inwards of r = 60 + 3 cos 5t, 382.82 mm long; 40 mm about 10,585 mm of straights and quarter circles.
        ("pot.json", 1, 1120.18, 1e-3),
        ("wall.json", 1, 423_398.0, 1e-3),
    ];
    for (name, regions, area, tolerance) in expected {
        let path = PathBuf::from(EXAMPLES).join(name);
        let loaded = load(&path, &ReadOptions::default()).expect(name);
        assert_eq!(loaded.target.regions.len(), regions, "{name}");
        let found = area_mm2(&loaded);
        assert!((found / area - 1.0).abs() < tolerance, "{name}: {found}");
        // An SVG tells how large its units came out; nothing else is noted.
        let notes = loaded.notes.iter();
        let notes: Vec<&String> = notes
            .filter(|note| !note.starts_with("one unit of the SVG"))
            .collect();
        assert!(notes.is_empty(), "{name}: {notes:?}");
    }
    let there = ["json", "svg", "geojson"]
        .map(|ending| files(Path::new(EXAMPLES), ending).len())
        .iter()
        .sum::<usize>();
    assert_eq!(there, expected.len(), "an example is not tested here");
}

#[test]
fn example_machines_are_in_order() {
    let machines = files(PathBuf::from(EXAMPLES).join("machines"), "toml");
    assert!(machines.len() >= 2, "{machines:?}");
    for path in machines {
        let text = std::fs::read_to_string(&path).expect("file");
        if let Err(error) = machine_file::from_toml(&text) {
            panic!("{}: {error}", path.display());
        }
    }
}

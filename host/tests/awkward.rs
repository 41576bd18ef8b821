//! Goal: plausible but awkward machines and inputs are printed, or refused with what is wrong and what
//! to do, in bounded time and never in silence. Method: the command itself; every case here was once
//! handled badly.

mod rig;

use rig::{example, folder, headway, object, path, stderr, succeeded};

/// Goal: a nozzle that cannot turn for ever prints parts that turn further than it can; the one that
/// cannot take every heading is refused with what it needs. Method: stops about the built-in machine's
/// nozzle, the steps of the simulated firmware.
#[test]
fn a_nozzle_with_stops_turns_back() {
    let folder = folder("stops");
    let machine = folder.join("stops.toml");
    let new = succeeded(&headway(&["machine", "new"]));
    let with_stops = |stop_deg: u32| {
        let range = format!("position_min_deg = -{stop_deg}\nposition_max_deg = {stop_deg}\n");
        let turn = "steps_per_turn = 9600\n";
        assert!(new.contains(turn));
        let text = new.replace(turn, &format!("{turn}{range}"));
        std::fs::write(&machine, text).expect("file");
        headway(&[
            "simulate",
            &example("u-part.json"),
            "-m",
            path(&machine),
            "--json",
        ])
    };
    let whole = object(&headway(&["simulate", &example("u-part.json"), "--json"]));
    assert_eq!(whole["passes"], 1);
    let figures = object(&with_stops(180));
    assert_eq!(figures["faults"], 0);
    assert!(figures["passes"].as_u64() > Some(2), "{figures:?}");
    let covered = |figures: &serde_json::Map<String, serde_json::Value>| {
        figures["covered_pct"].as_f64().expect("a share")
    };
    assert!((covered(&figures) - covered(&whole)).abs() < 0.05);
    let refused = with_stops(80);
    assert_eq!(refused.status.code(), Some(1));
    let said = stderr(&refused);
    assert!(
        said.contains("joint c") && said.contains("80.000°"),
        "{said}"
    );
    assert!(said.contains("half a turn"), "{said}");
}

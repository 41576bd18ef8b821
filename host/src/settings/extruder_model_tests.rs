//! Goal: a material's file is read as it is written, and what it cannot mean is refused with key or line. Method: one file
//! with everything, then one change each.

use super::*;

const FILE: &str = "format = 1\n\n[extruder]\nflow_loss = [[4, 0.04], [8.5, 0.25]]\nlag_s = 0.12\n\
    drift = { share = 0.15, layers = 20 }\nslip = { flow_mm3_s = 12, share = 0.5 }\n";

#[test]
fn a_file_is_read_as_it_is_written() {
    let model = ExtruderModel::from_toml(FILE).expect("a model");
    assert_eq!(model.flow_loss.as_slice(), [[4.0, 0.04], [8.5, 0.25]]);
    assert_eq!(model.lag_s, 0.12);
    assert_eq!(
        model.drift.map(|drift| (drift.share, drift.layers)),
        Some((0.15, 20))
    );
    assert_eq!(
        model.slip.map(|slip| (slip.flow_mm3_s, slip.share)),
        Some((12.0, 0.5))
    );
    let plain = ExtruderModel::from_toml("format = 1\n[extruder]\n");
    assert_eq!(plain, Ok(ExtruderModel::default()));
}

#[test]
fn what_a_file_cannot_mean_is_refused_with_its_place() {
    for (from, to, part) in [
        ("format = 1", "format = 2", "format: 2 is not one"),
        ("format = 1", "", "the key `format` is missing"),
        (
            "lag_s = 0.12",
            "lags_s = 0.12",
            "line 5: lags_s = 0.12\n  unknown key `lags_s`: is `lag_s` meant?",
        ),
        ("lag_s = 0.12", "lag_s = nan", "extruder.lag_s is"),
        (
            "lag_s = 0.12",
            "lag_s = -1",
            "extruder.lag_s is -1, but must be at least 0",
        ),
        ("lag_s = 0.12", "lag_s = \"a\"", "line 5: "),
        ("[4, 0.04]", "[4, nan]", "extruder.flow_loss: point 1"),
        ("[4, 0.04]", "[9, 0.04]", "extruder.flow_loss: point 2"),
        (
            "share = 0.15",
            "share = 0.95",
            "extruder.drift.share is 0.95",
        ),
        ("share = 0.15", "share = nan", "extruder.drift.share is"),
        ("layers = 20", "layers = 0", "extruder.drift.layers is 0"),
        ("layers = 20", "layer = 20", "line 6: "),
        ("share = 0.5", "share = 1.5", "extruder.slip.share is 1.5"),
        (
            "flow_mm3_s = 12",
            "flow_mm3_s = 0",
            "extruder.slip.flow_mm3_s is 0",
        ),
        (
            "flow_mm3_s = 12",
            "flow_mm3_s = inf",
            "extruder.slip.flow_mm3_s is",
        ),
    ] {
        assert!(FILE.contains(from), "{from}");
        let refused = ExtruderModel::from_toml(&FILE.replace(from, to));
        let refused = refused.expect_err(to).to_string();
        assert!(refused.contains(part), "{to}: {refused}");
    }
}

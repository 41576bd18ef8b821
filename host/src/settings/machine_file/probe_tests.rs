//! Goal: a probe is read and written back as it is, gives Z its place where Z is homed by it, and what
//! cannot be is refused. Method: the built-in machine's file with groups more.
use super::tests::{assert_refused, planar_with as read};
use super::{from_toml, to_toml};
use crate::settings::Settings;
use crate::settings::probe::ProbeSettings;

const ALL: &str = "[probe]\noffset_x_mm = -24.5\noffset_y_mm = 12\nz_offset_mm = 1.85\nfast_mm_s = 6\n\
                   slow_mm_s = 2\nback_off_mm = 1.5\nlift_mm = 4\nsamples = 3\ntolerance_mm = 0.01\n";

#[test]
fn a_probe_reads_back() {
    let settings = read(ALL).expect("a machine");
    let probe = settings.probe.expect("given");
    assert_eq!(probe.offset_mm, [-24.5, 12.0]);
    assert_eq!((probe.z_offset_mm, probe.samples), (1.85, 3));
    assert_eq!(from_toml(&to_toml(&settings)).expect("again"), settings);
    let usual = read("[probe]\n").expect("a machine").probe;
    assert_eq!(usual, Some(ProbeSettings::default()));
    assert_eq!(read("").expect("a machine").probe, None);
    // A plan does not depend on it.
    assert_eq!(settings.machine.hash(), Settings::planar().machine.hash());
}

#[test]
fn z_that_is_homed_by_the_probe_is_as_high_as_the_nozzle_is_then() {
    let place = |more: &str| {
        let settings = read(&format!("{ALL}{more}")).expect("a machine");
        assert_eq!(from_toml(&to_toml(&settings)).expect("again"), settings);
        let z = settings.switches.expect("given").joints[0];
        (z.position_natural, z.guards)
    };
    // Pressed in the first layers: it must not stop them.
    assert_eq!(place("[switches.z]\nend = \"min\"\n"), (1.85, false));
    let said = "[switches.z]\nend = \"min\"\nposition_mm = 0.5\nguards = true\n";
    assert_eq!(place(said), (0.5, true));
    // At the other end, or with a switch of its own, Z is where that is.
    let top = Settings::planar().machine.joints[2].position_max;
    assert_eq!(place("[switches.z]\nend = \"max\"\n"), (top, true));
    let own = "[wiring]\nprobe_input = 7\n[switches.z]\nend = \"min\"\n";
    let bottom = Settings::planar().machine.joints[2].position_min;
    assert_eq!(place(own), (bottom, true));
}

#[test]
fn a_probe_that_cannot_be_is_refused() {
    let cases = [
        ("-24.5", "-501", "probe.offset_x_mm is -501"),
        ("= 12", "= nan", "probe.offset_y_mm is NaN"),
        ("1.85", "30", "probe.z_offset_mm is 30"),
        ("fast_mm_s = 6", "fast_mm_s = 21", "probe.fast_mm_s is 21"),
        ("slow_mm_s = 2", "slow_mm_s = 0", "probe.slow_mm_s is 0"),
        ("back_off_mm = 1.5", "back_off_mm = 0", "probe.back_off_mm"),
        ("lift_mm = 4", "lift_mm = 1", "probe.lift_mm is 1"),
        ("samples = 3", "samples = 0", "probe.samples is 0"),
        ("0.01", "0", "probe.tolerance_mm is 0"),
        ("samples", "touches", "unknown key"),
    ];
    assert_refused(ALL, &cases);
}

/// Goal: a pump's output is read and written back as it is, and what it cannot be is refused with its key. Method: a group with
/// all keys, one of them wrong or left out.
#[test]
fn a_pump_reads_back_and_is_checked() {
    let all = "[pump]\noutput = \"ao_pump\"\nkind = \"analog\"\nmm3_s_per_unit = 40\nlag_s = 0.3\nstart_lead_s = 0.4\n\
               stop_lead_s = 0.25\nrate_min_mm3_s = 5\nrate_max_mm3_s = 400\n";
    let settings = read(all).expect(all);
    let pump = settings.pump.clone().expect("given");
    assert_eq!((pump.output.as_str(), pump.start_lead_s), ("ao_pump", 0.4));
    let text = to_toml(&settings);
    for line in all.lines() {
        assert!(
            text.lines().any(|written| written == line),
            "{line}: {text}"
        );
    }
    assert_eq!(from_toml(&text), Ok(settings));
    assert_refused(
        all,
        &[
            (
                "mm3_s_per_unit = 40\n",
                "",
                "an analog output needs its scale",
            ),
            ("= 400", "= 4", "rate_max_mm3_s is not above"),
            ("lag_s = 0.3", "lag_s = -1", "pump.lag_s"),
            (
                "mm3_s_per_unit = 40",
                "mm3_s_per_unit = 0",
                "pump.mm3_s_per_unit",
            ),
            ("\"analog\"", "\"pwm\"", "digital"),
            ("output = \"ao_pump\"\n", "", "output"),
        ],
    );
}

/// Goal: bounds and gains of corrections are read and written back as they are. Method: a group with all keys; the command's
/// tests have what is refused.
#[test]
fn corrections_read_back() {
    let all = "[measure]\ncontroller = \"pressure\"\nflow_range = [0.9, 1.3]\nflow_change_per_s = 0.01\nsilent_s = 5\n\
               height_noise_mm = 0.1\nrecovery_layers = 2\npressure = 12.5\npressure_gain_per_s = 0.02\n";
    let settings = read(all).expect(all);
    let measure = settings.measure.clone().expect("given");
    assert_eq!(
        (measure.flow_range, measure.pressure),
        ([0.9, 1.3], Some(12.5))
    );
    let text = to_toml(&settings);
    for line in all.lines() {
        assert!(
            text.lines().any(|written| written == line),
            "{line}: {text}"
        );
    }
    assert_eq!(from_toml(&text), Ok(settings));
}

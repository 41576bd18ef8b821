//! Goal: passes cut for a nozzle with stops lay little ground twice and leave next to none open.
//! Method: shipped parts on the built-in machine, and on one whose nozzle stops after half a turn either
//! way; what both leave by the oracle of `headway_tests::layer_oracle`, headings by the stream's knots.

use headway::input::Target;
use headway::plan_target;
use headway::settings::Settings;
use headway_protocol::units::CHANNEL_HEADING;
use headway_tests::layer_oracle::{LayerFindings, print_poses, sweep};
use headway_tests::outlines::{example, region};
use std::f64::consts::PI;

#[test]
fn cuts_lay_little_twice_and_leave_nothing_open() {
    for name in ["gear", "thin-web"] {
        let rings = example(name);
        let target = Target {
            name: name.to_string(),
            regions: vec![region(&rings)],
        };
        let planned = |stop_rad: f64| {
            let mut settings = Settings::default();
            let nozzle = &mut settings.machine.joints[3];
            (nozzle.position_min, nozzle.position_max) = (-stop_rad, stop_rad);
            let plan = plan_target(&target, &settings).expect("a plan");
            let headings = plan.stream.knots.iter().map(|k| k.control[CHANNEL_HEADING]);
            let most_rad = 1e-6 * f64::from(headings.map(i32::abs).max().expect("knots"));
            assert!(most_rad < stop_rad, "{most_rad} {stop_rad}");
            let offset = [plan.transform.offset_mm[0], plan.transform.offset_mm[1]];
            let axes = [settings.aperture.major_mm(), settings.aperture.minor_mm()];
            let poses = print_poses(&plan.stream, offset, 0.03);
            let found = sweep(&rings, &poses, axes, 0.02);
            (plan.figures.passes, found, settings.aperture.area_mm2())
        };
        let (passes_free, free, _) = planned(1e4);
        let (passes, cut, aperture_mm2) = planned(PI);
        println!("{name}: {passes_free} passes, {free:?}; {passes} passes, {cut:?}");
        let cuts = passes as f64 - passes_free as f64;
        // Headings that turn no more than they must need few: 4 on the gear.
        assert!(cuts >= 3.0, "{name}: {cuts}");
        // Two pieces that meet at a placement lay all of the aperture twice. Their ends move apart until what they
        // leave open outweighs it: 0.03 of the aperture is laid twice a cut, and with half of that 0.12 is lost.
        let lost_mm2 = |found: &LayerFindings, twice_share: f64| {
            found.area_mm2 * (100.0 - found.covered_pct + twice_share * found.overlap_pct) / 100.0
        };
        let twice_mm2 = (cut.overlap_pct - free.overlap_pct) / 100.0 * cut.area_mm2 / cuts;
        assert!(twice_mm2 < 0.1 * aperture_mm2, "{name}: {twice_mm2}");
        let a_cut_mm2 = (lost_mm2(&cut, 0.5) - lost_mm2(&free, 0.5)) / cuts;
        assert!(a_cut_mm2 < 0.15 * aperture_mm2, "{name}: {a_cut_mm2}");
        assert!(cut.outside_depth_mm < 0.002, "{name}");
    }
}

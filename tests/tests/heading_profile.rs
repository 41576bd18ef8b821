//! Goal: headings chosen along the pass print much faster than headings chosen point by point, and
//! cover no less. Method: the shipped parts on a machine with a slow heading axis, planned both ways;
//! coverage by the oracle of `headway_tests::layer_oracle`, over all of them by area.

use headway::input::Target;
use headway::plan_target;
use headway::settings::{HeadingProfile, Settings};
use headway_tests::layer_oracle::{print_poses, sweep};
use headway_tests::outlines::{example, region};

const PARTS: [&str; 6] = ["bracket", "gear", "letter", "taper", "thin-web", "u-part"];

/// What parts take together, and what is covered and covered again of their area.
#[derive(Debug, Default)]
struct Findings {
    print_s: f64,
    area_mm2: f64,
    covered_mm2: f64,
    overlap_mm2: f64,
}

fn planned(heading_profile: HeadingProfile) -> Findings {
    let mut sum = Findings::default();
    for name in PARTS {
        let rings = example(name);
        let target = Target {
            name: name.to_string(),
            regions: vec![region(&rings)],
        };
        let mut settings = Settings {
            heading_profile,
            ..Settings::default()
        };
        let nozzle = &mut settings.machine.joints[3];
        nozzle.speed_max = 200.0_f64.to_radians();
        nozzle.acceleration_max = 1000.0_f64.to_radians();
        nozzle.jerk_max = 1e5_f64.to_radians();
        let plan = plan_target(&target, &settings).expect("a plan");
        let offset = [plan.transform.offset_mm[0], plan.transform.offset_mm[1]];
        let axes = [settings.aperture.major_mm(), settings.aperture.minor_mm()];
        let poses = print_poses(&plan.stream, offset, 0.03);
        let found = sweep(&rings, &poses, axes, 0.02);
        println!(
            "{name} {heading_profile:?}: {:.1} s {found:?}",
            plan.figures.print_s
        );
        sum.print_s += plan.figures.print_s;
        sum.area_mm2 += found.area_mm2;
        sum.covered_mm2 += found.area_mm2 * found.covered_pct / 100.0;
        sum.overlap_mm2 += found.area_mm2 * found.overlap_pct / 100.0;
    }
    sum
}

#[test]
fn the_corridor_prints_faster_and_covers_no_less() {
    let pointwise = planned(HeadingProfile::Pointwise);
    let corridor = planned(HeadingProfile::Corridor);
    println!("{pointwise:?} {corridor:?}");
    assert!(corridor.print_s < 0.7 * pointwise.print_s);
    let slack_mm2 = 5e-4 * corridor.area_mm2;
    assert!(corridor.covered_mm2 > pointwise.covered_mm2 - slack_mm2);
    assert!(corridor.overlap_mm2 < pointwise.overlap_mm2 + slack_mm2);
}

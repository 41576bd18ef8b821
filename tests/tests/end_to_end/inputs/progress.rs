//! The planner tells how far it is, and neither who listens nor the number of threads changes what
//! it plans.

use headway::input::Target;
use headway::plan::progress::Stage;
use headway::settings::Settings;
use headway::{Plan, plan_target, plan_target_around};
use headway_tests::outlines::{example, region};
use std::sync::Mutex;

/// Two parts beside each other.
fn target() -> Target {
    let mut far = example("taper");
    for point in far.iter_mut().flatten() {
        point[0] += 60.0;
    }
    Target {
        name: "two".to_string(),
        regions: vec![region(&example("letter")), region(&far)],
    }
}

fn with_threads(threads: usize, work: impl FnOnce() -> Plan + Send) -> Plan {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build().expect("threads").install(work)
}

/// Goal: every stage comes once and in order, begins with 0 of its total and ends with all of it,
/// one step at a time; regions and moves are what is counted. Method: a listener that keeps
/// everything it is told, with four threads; the plan beside one of a single thread that nobody
/// listens to.
#[test]
fn stages_come_in_order_and_reach_their_totals() {
    let (target, settings) = (target(), Settings::default());
    let told = Mutex::new(Vec::new());
    let tell = |stage: Stage, done: usize, total: usize| {
        told.lock().expect("a list").push((stage, done, total));
    };
    let plan = with_threads(4, || {
        plan_target_around(&target, &[], &settings, &tell).expect("a plan")
    });
    let told = told.into_inner().expect("a list");
    let stages: Vec<&[(Stage, usize, usize)]> = told.chunk_by(|a, b| a.0 == b.0).collect();
    let order: Vec<Stage> = stages.iter().map(|calls| calls[0].0).collect();
    assert_eq!(order, Stage::ALL);
    for calls in stages {
        let (stage, _, total) = calls[0];
        let expected = match stage {
            Stage::Segments => plan.route.moves.len(),
            _ => target.regions.len(),
        };
        assert_eq!(total, expected, "{stage:?}");
        let counts: Vec<usize> = calls.iter().map(|call| call.1).collect();
        assert_eq!(counts, Vec::from_iter(0..=total), "{stage:?}");
    }
    let alone = with_threads(1, || plan_target(&target, &settings).expect("a plan"));
    assert_eq!(plan.stream, alone.stream);
    assert_eq!(plan.figures, alone.figures);
}

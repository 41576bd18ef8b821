//! Tells how far planning is and stops it.
//!
//! `cargo run --example watch_and_stop`

use headway::api::{Error, Machine, Options, Part, plan_watched};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Plans up to a number of steps; how many were told.
pub fn run(steps_max: usize) -> (usize, Result<f64, Error>) {
    let told = AtomicUsize::new(0);
    let planned = planned(&|stage, done, total| {
        println!("{stage}: {done} of {total}");
        match told.fetch_add(1, Ordering::Relaxed) + 1 {
            told if told >= steps_max => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    });
    (told.into_inner(), planned)
}

fn planned(watch: &(dyn Fn(&str, usize, usize) -> ControlFlow<()> + Sync)) -> Result<f64, Error> {
    let square = vec![[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0]];
    let part = Part::from_polygons("square", &[vec![square]])?;
    let job = plan_watched(&part, &Machine::default(), &Options::default(), &|step| {
        watch(step.stage, step.done, step.total)
    })?;
    Ok(job.duration_s())
}

#[allow(dead_code)]
fn main() {
    println!("{:?}", run(5));
    println!("{:?}", run(usize::MAX));
}

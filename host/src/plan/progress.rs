//! Progress of planning, for the caller.
//!
//! The planner reports to a [`Progress`]; the caller decides how to use it (a bar, a log, nothing).
//! The plan does not depend on it. Stages come in the order of [`Stage`], each from 0 to its total;
//! calls are sequential, from any thread.
//!
//! In: counts of steps done. Out: calls with a stage, done and total. Not covered: time.

use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// A stage of planning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Regions cleaned.
    Contour,
    /// Medial axes found, by region.
    Axis,
    /// Passes made, joined and optimised, by region.
    Passes,
    /// Moves of the route timed and fitted.
    Segments,
    /// Figures measured, by region.
    Figures,
}

impl Stage {
    /// All of them, in order.
    pub const ALL: [Stage; 5] = [
        Stage::Contour,
        Stage::Axis,
        Stage::Passes,
        Stage::Segments,
        Stage::Figures,
    ];

    /// A word or two for display.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Contour => "contours",
            Stage::Axis => "medial axes",
            Stage::Passes => "passes and headings",
            Stage::Segments => "segments",
            Stage::Figures => "figures",
        }
    }
}

/// The receiver of the progress has stopped planning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped on request")]
pub struct Stopped;

/// A receiver of progress.
pub trait Progress: Sync {
    /// `done` of `total` steps of a stage are done.
    fn at(&self, stage: Stage, done: usize, total: usize);

    /// Planning is to end at its next step.
    fn stops(&self) -> bool {
        false
    }

    /// `done` of `total` layers of a part are planned; the stages begin again for the next ones.
    fn layers(&self, done: usize, total: usize) {
        let _ = (done, total);
    }
}

/// Nobody.
impl Progress for () {
    fn at(&self, _: Stage, _: usize, _: usize) {}
}

/// Any function of stage, steps done and steps in all.
impl<F: Fn(Stage, usize, usize) + Sync> Progress for F {
    fn at(&self, stage: Stage, done: usize, total: usize) {
        self(stage, done, total);
    }
}

/// Counts the steps of one stage.
pub struct Steps<'a> {
    progress: &'a dyn Progress,
    stage: Stage,
    total: usize,
    done: Mutex<usize>,
}

impl<'a> Steps<'a> {
    /// Begins a stage of `total` steps.
    pub fn begin(progress: &'a dyn Progress, stage: Stage, total: usize) -> Steps<'a> {
        progress.at(stage, 0, total);
        Steps {
            progress,
            stage,
            total,
            done: Mutex::new(0),
        }
    }

    /// Does the work of one step and reports it as done, unless planning is to end.
    ///
    /// # Errors
    /// [`Stopped`].
    pub fn step<T>(&self, work: impl FnOnce() -> T) -> Result<T, Stopped> {
        self.check()?;
        let made = work();
        self.done();
        self.check()?;
        Ok(made)
    }

    /// Fails where planning is to end.
    fn check(&self) -> Result<(), Stopped> {
        match self.progress.stops() {
            true => Err(Stopped),
            false => Ok(()),
        }
    }

    /// One more is done. Reported under the lock, so that counts never decrease.
    pub fn done(&self) {
        let mut done = self.done.lock().unwrap_or_else(PoisonError::into_inner);
        *done += 1;
        self.progress.at(self.stage, *done, self.total);
    }
}

/// Items processed in parallel: enough for any number of threads if they are small; a large one
/// keeps all threads busy, so that not all of them have to be in memory at once.
pub const SIDE_BY_SIDE: usize = 64;

/// One step for each item, some side by side, up to the first that fails.
///
/// # Errors
/// That of the item, or [`Stopped`].
pub fn step_each<T: Send, U: Send, E: Send + From<Stopped>>(
    progress: &dyn Progress,
    stage: Stage,
    items: Vec<T>,
    work: impl Fn(T) -> Result<U, E> + Sync,
) -> Result<Vec<U>, E> {
    let steps = Steps::begin(progress, stage, items.len());
    let mut made = Vec::with_capacity(items.len());
    let mut items = items.into_iter();
    loop {
        let some: Vec<T> = items.by_ref().take(SIDE_BY_SIDE).collect();
        if some.is_empty() {
            return Ok(made);
        }
        let some = some.into_par_iter().map(|item| {
            steps
                .step(|| work(item))
                .unwrap_or_else(|stopped| Err(stopped.into()))
        });
        // The first of those that fail, whichever was first.
        let some: Vec<Result<U, E>> = some.collect();
        for item in some {
            made.push(item?);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq)]
    enum Failed {
        At(usize),
        Stopped,
    }

    impl From<Stopped> for Failed {
        fn from(_: Stopped) -> Failed {
            Failed::Stopped
        }
    }

    /// Says stop once so many steps are done.
    struct StopsAt(usize, Mutex<usize>);

    impl Progress for StopsAt {
        fn at(&self, _: Stage, done: usize, _: usize) {
            *self.1.lock().unwrap() = done;
        }

        fn stops(&self) -> bool {
            *self.1.lock().unwrap() >= self.0
        }
    }

    /// Goal: no item is begun once planning is to end. Method: a thousand items of which each is counted, and a stop
    /// after five: beside them only those that other threads had begun.
    #[test]
    fn a_stop_ends_the_stage() {
        let (tell, worked) = (StopsAt(5, Mutex::new(0)), Mutex::new(0));
        let made = step_each(&tell, Stage::Axis, (0..1000).collect(), |n: usize| {
            *worked.lock().unwrap() += 1;
            Ok::<usize, Failed>(n)
        });
        assert_eq!(made, Err(Failed::Stopped));
        let most = 5 + rayon::current_num_threads();
        assert!((5..=most).contains(&*worked.lock().unwrap()));
    }

    /// Goal: counts rise by one from 0 to the total, whatever the threads. Method: a thousand steps
    /// from all of them.
    #[test]
    fn counts_rise_to_their_total() {
        let told = Mutex::new(Vec::new());
        let tell = |stage: Stage, done: usize, total: usize| {
            told.lock().unwrap().push((stage, done, total));
        };
        let steps = Steps::begin(&tell, Stage::Segments, 1000);
        (0..1000)
            .into_par_iter()
            .for_each(|_| steps.step(|| ()).unwrap());
        let expected: Vec<_> = (0..=1000).map(|n| (Stage::Segments, n, 1000)).collect();
        assert_eq!(*told.lock().unwrap(), expected);
    }

    /// Goal: a failing item ends the stage soon, and it is the first of those that fail that is told.
    /// Method: a thousand items, of which the third and all behind it fail.
    #[test]
    fn a_failure_ends_the_stage() {
        let told = Mutex::new(0);
        let tell = |_: Stage, done: usize, _: usize| *told.lock().unwrap() = done;
        let items: Vec<usize> = (1..=1000).collect();
        let made = step_each(&tell, Stage::Axis, items, |n| match n >= 3 {
            true => Err(Failed::At(n)),
            false => Ok(n),
        });
        assert_eq!(
            (made, *told.lock().unwrap()),
            (Err(Failed::At(3)), SIDE_BY_SIDE)
        );
        let all = step_each(&tell, Stage::Axis, (0..1000).collect(), Ok::<usize, Failed>);
        assert_eq!(all, Ok((0..1000).collect()));
    }
}

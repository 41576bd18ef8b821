//! Planning in a thread, watched by whoever called.
//!
//! In: part, machine file's text, options, a function for progress. Out: a job, or an exception: of the
//! planner, of the function, of a signal. Left early, the thread ends at its next step by itself; its
//! result is dropped.

use crate::options::options;
use crate::{Job, Part, exception};
use headway::api::{self, Error, Machine, Step, plan_watched};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Longest time between two looks for signals.
const LOOK: Duration = Duration::from_millis(20);

/// What comes from the thread.
enum News {
    Step(Step),
    End(Box<Result<api::Job, Error>>),
}

/// Stops the thread when whoever called is gone.
struct Stop(Arc<AtomicBool>);

impl Drop for Stop {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Plans; `progress(stage, done, total)` is called in the calling thread.
#[pyfunction]
pub fn plan(
    py: Python<'_>,
    part: &Part,
    machine: Option<&str>,
    given: &Bound<'_, PyDict>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Job> {
    let machine = machine.map_or(Ok(Machine::default()), Machine::from_toml);
    let machine = machine.map_err(exception)?;
    let options = options(given)?;
    let part = part.0.clone();
    let stopped = Arc::new(AtomicBool::new(false));
    let _stop = Stop(stopped.clone());
    let (tell, news) = channel();
    let is_told = progress.is_some();
    let work = move || {
        let watch = |step: Step| {
            if is_told {
                // Nobody listens any more only where it is stopped as well.
                let _ = tell.send(News::Step(step));
            }
            match stopped.load(Ordering::Relaxed) {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        };
        let planned = plan_watched(&part, &machine, &options, &watch);
        let _ = tell.send(News::End(Box::new(planned)));
    };
    let thread = std::thread::Builder::new().name("headway planning".to_string());
    let spawned = thread.spawn(work);
    spawned.map_err(|error| PyRuntimeError::new_err(format!("no thread to plan in: {error}")))?;
    until_end(py, &Mutex::new(news), progress)
}

fn until_end(
    py: Python<'_>,
    news: &Mutex<Receiver<News>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Job> {
    loop {
        let came = py.detach(|| {
            let news = news.lock().unwrap_or_else(PoisonError::into_inner);
            news.recv_timeout(LOOK)
        });
        py.check_signals()?;
        match came {
            Ok(News::Step(step)) => {
                if let Some(progress) = &progress {
                    progress.call1(py, (step.stage, step.done, step.total))?;
                }
            }
            Ok(News::End(planned)) => return planned.map(Job).map_err(exception),
            Err(RecvTimeoutError::Timeout) => {}
            // The thread has gone without a result: it panicked.
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err(
                    "a fault of the planner, not of the input: please report it with the part",
                ));
            }
        }
    }
}

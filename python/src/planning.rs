//! Planning in a thread, watched by whoever called.
//!
//! In: part, machine file's text, options, a function for progress. Out: a job, or an exception: of the
//! planner, of the function, of a signal. Left early, the thread ends at its next step by itself; its
//! result is dropped.

use crate::blocks::Folder;
use crate::options::options;
use crate::{Job, Part, exception};
use headway::api::{self, Cache, Error, Machine, Step, plan_cached, plan_watched};
use pyo3::exceptions::{PyOSError, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Longest time between two looks for signals.
const LOOK: Duration = Duration::from_millis(20);

/// What comes from the thread.
enum News<T> {
    Step(Step),
    End(Box<Result<T, Error>>),
}

/// Folder of planned blocks, and the program that plans.
type Kept = (PathBuf, String);

/// Stops the thread when whoever called is gone.
struct Stop(Arc<AtomicBool>);

impl Drop for Stop {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Plans; `progress(stage, done, total)` is called in the calling thread. `kept`: a folder of planned blocks, and the
/// program that plans.
#[pyfunction]
pub fn plan(
    py: Python<'_>,
    part: &Part,
    machine: Option<&str>,
    given: &Bound<'_, PyDict>,
    progress: Option<Py<PyAny>>,
    kept: Option<Kept>,
) -> PyResult<Job> {
    let (part, machine, options) = (part.0.clone(), read_machine(machine)?, options(given)?);
    let kept = kept.map(opened).transpose()?;
    let work = move |watch: Watch<'_>| match kept {
        None => plan_watched(&part, &machine, &options, watch),
        Some((mut store, program)) => {
            let cache = Cache {
                store: &mut store,
                program: &program,
            };
            plan_cached(&part, &machine, &options, cache, watch)
        }
    };
    in_thread(py, work, progress).map(Job)
}

/// A block: its number, first and last layer, from 1, and whether it was kept before.
type Block = (usize, u32, u32, bool);

/// Plans a share of a mesh's blocks: its blocks, and the number of all.
#[pyfunction]
pub fn plan_shard(
    py: Python<'_>,
    part: &Part,
    machine: Option<&str>,
    given: &Bound<'_, PyDict>,
    progress: Option<Py<PyAny>>,
    kept: Kept,
    shard: [usize; 2],
) -> PyResult<(Vec<Block>, usize)> {
    let (part, machine, options) = (part.0.clone(), read_machine(machine)?, options(given)?);
    let (mut store, program) = opened(kept)?;
    let work = move |watch: Watch<'_>| {
        let cache = Cache {
            store: &mut store,
            program: &program,
        };
        api::plan_shard(&part, &machine, &options, shard, cache, watch)
    };
    let planned = in_thread(py, work, progress)?;
    let own = planned.own.iter();
    let own = own.map(|block| {
        let [first, last] = block.layers;
        (block.number, first, last, block.was_known)
    });
    Ok((own.collect(), planned.blocks))
}

fn read_machine(text: Option<&str>) -> PyResult<Machine> {
    let machine = text.map_or(Ok(Machine::default()), Machine::from_toml);
    machine.map_err(exception)
}

fn opened((folder, program): Kept) -> PyResult<(Folder, String)> {
    let opened = Folder::open(&folder);
    let opened =
        opened.map_err(|problem| PyOSError::new_err(format!("{}: {problem}", folder.display())))?;
    Ok((opened, program))
}

/// Hears of each step, and stops with `Break`.
type Watch<'a> = &'a (dyn Fn(Step) -> ControlFlow<()> + Sync);

/// The result of `work` in a thread of its own.
fn in_thread<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(Watch<'_>) -> Result<T, Error> + Send + 'static,
    progress: Option<Py<PyAny>>,
) -> PyResult<T> {
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
        let planned = work(&watch);
        let _ = tell.send(News::End(Box::new(planned)));
    };
    let thread = std::thread::Builder::new().name("headway planning".to_string());
    let spawned = thread.spawn(work);
    spawned.map_err(|error| PyRuntimeError::new_err(format!("no thread to plan in: {error}")))?;
    until_end(py, &Mutex::new(news), progress)
}

fn until_end<T: Send>(
    py: Python<'_>,
    news: &Mutex<Receiver<News<T>>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<T> {
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
            Ok(News::End(planned)) => return planned.map_err(exception),
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

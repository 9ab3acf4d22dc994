//! Long computations on a separate thread.
//!
//! The waiting Python thread reports progress and handles Ctrl-C.

use std::mem::take;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use gonio_app::AppError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{fault, raise};

/// Interval at which signals are checked and progress is reported.
const POLL: Duration = Duration::from_millis(50);

/// Callbacks during the work. Either may raise, which ends the work.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Listeners {
    /// Called with the name of a stage and the fraction of it that is done.
    progress: Option<Py<PyAny>>,
    /// Called whenever signals are checked.
    poll: Option<Py<PyAny>>,
}

/// State shared by both threads.
#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    /// Events not yet reported: the latest of each stage.
    events: Mutex<Vec<(&'static str, f64)>>,
}

/// Handle of the worker: reports progress and stops the work on request.
#[derive(Clone)]
pub(crate) struct Reporter(Arc<Shared>);

/// Payload with which a worker unwinds on a request to stop.
struct Stopped;

impl Reporter {
    /// Reports that a fraction (0..=1) of a stage is done; unwinds on a request to stop.
    pub(crate) fn at(&self, stage: &'static str, fraction: f64) {
        if self.0.stop.load(Ordering::Relaxed) {
            resume_unwind(Box::new(Stopped));
        }
        if let Ok(mut events) = self.0.events.lock() {
            match events.last_mut().filter(|(last, _)| *last == stage) {
                // Several threads report: the fraction of a stage never decreases.
                Some((_, at)) => *at = at.max(fraction),
                None => events.push((stage, fraction)),
            }
        }
    }
}

/// Thread pool of all computations; `None` means Rayon's global pool with one thread per core.
static POOL: Mutex<Option<Arc<ThreadPool>>> = Mutex::new(None);

/// Sets the number of threads of all later computations; `None` means one per core.
#[pyfunction]
#[pyo3(signature = (count))]
pub(crate) fn set_threads(py: Python<'_>, count: Option<usize>) -> PyResult<()> {
    let pool = count.map(|count| ThreadPoolBuilder::new().num_threads(count).build().map(Arc::new)).transpose();
    let pool = pool.map_err(|error| raise(&AppError::of("threads", error), py))?;
    *POOL.lock().unwrap_or_else(PoisonError::into_inner) = pool;
    Ok(())
}

/// Runs the job while other Python threads run.
///
/// If Ctrl-C or an exception of a listener ends the wait before the job, the worker stops at its
/// next report.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    listeners: Listeners,
    job: impl FnOnce(&Reporter) -> Result<T, AppError> + Send + 'static,
) -> PyResult<T> {
    let shared = Arc::new(Shared::default());
    let reporter = Reporter(shared.clone());
    let (sender, mut receiver) = mpsc::channel();
    let pool = POOL.lock().unwrap_or_else(PoisonError::into_inner).clone();
    thread::Builder::new().name("gonio".to_owned()).spawn(move || {
        let work = || catch_unwind(AssertUnwindSafe(|| job(&reporter)));
        let done = match pool {
            Some(pool) => pool.install(work),
            None => work(),
        };
        // After an interruption, the receiver no longer exists.
        let _ = sender.send(done);
    })?;
    loop {
        // The receiver moves into the closure and back, since it cannot be shared between threads.
        let (back, got) = py.detach(move || {
            let got = receiver.recv_timeout(POLL);
            (receiver, got)
        });
        receiver = back;
        if let Err(exception) = listeners.tell(py, &shared) {
            shared.stop.store(true, Ordering::Relaxed);
            return Err(exception);
        }
        match got {
            Err(RecvTimeoutError::Timeout) => (),
            Ok(Ok(result)) => return result.map_err(|problem| raise(&problem, py)),
            Ok(Err(_)) | Err(RecvTimeoutError::Disconnected) => return Err(fault()),
        }
    }
}

impl Listeners {
    /// Returns listeners without callbacks; Ctrl-C still works.
    pub(crate) fn none() -> Self {
        Self { progress: None, poll: None }
    }

    fn tell(&self, py: Python<'_>, shared: &Shared) -> PyResult<()> {
        py.check_signals()?;
        if let Some(poll) = &self.poll {
            poll.call0(py)?;
        }
        let events = shared.events.lock().map(|mut events| take(&mut *events)).unwrap_or_default();
        if let Some(progress) = &self.progress {
            for event in events {
                progress.call1(py, event)?;
            }
        }
        Ok(())
    }
}

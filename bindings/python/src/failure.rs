//! How does an error of the engine reach Python, and how does a long call stay interruptible?
//!
//! Every error becomes an exception of `chronotope.Error` with `kind`, `path`, `place` and `help`.
//! A panic, which would be a fault of ours, becomes one of kind `internal` and never pyo3's
//! `PanicException`, which `except Exception` does not catch.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use chronotope::{Error, ErrorKind};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

/// How often a long call looks whether somebody has pressed Ctrl-C.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// What a method of this module fails with.
#[derive(Debug)]
pub(crate) enum Failure {
    Engine(Box<Error>),
    Python(PyErr),
    /// A panic, and what it said.
    Internal(String),
}

pub(crate) type Result<T, E = Failure> = std::result::Result<T, E>;

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Engine(Box::new(error))
    }
}

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Self {
        Self::Python(error)
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        Python::attach(|py| match failure {
            Failure::Python(error) => error,
            Failure::Engine(error) => exception(py, &error),
            Failure::Internal(said) => raised(
                py,
                "internal",
                &format!("this is a fault of chronotope: {said}"),
                None,
                None,
                Some("please report it with what you called"),
            ),
        })
    }
}

impl Failure {
    /// The same failure of one of several arguments: `images[3]`.
    pub(crate) fn at(self, place: impl Into<String>) -> Self {
        match self {
            Self::Engine(error) => Self::Engine(Box::new(error.with_place(place))),
            other => other,
        }
    }
}

/// The exception that says what `error` says.
pub(crate) fn exception(py: Python<'_>, error: &Error) -> PyErr {
    if error.kind() == ErrorKind::Interrupted {
        return PyKeyboardInterrupt::new_err(error.to_string());
    }
    let path = error.path().map(|path| path.display().to_string());
    raised(
        py,
        error.kind().name(),
        error.message(),
        path.as_deref(),
        error.place(),
        error.help(),
    )
}

/// An error of a kind that only this module has.
pub(crate) fn of_kind(py: Python<'_>, kind: &str, message: &str, help: &str) -> Failure {
    Failure::Python(raised(py, kind, message, None, None, Some(help)))
}

fn raised(
    py: Python<'_>,
    kind: &str,
    message: &str,
    path: Option<&str>,
    place: Option<&str>,
    help: Option<&str>,
) -> PyErr {
    static MAKE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let make = MAKE.get_or_try_init(py, || {
        let module = py.import("chronotope._errors")?;
        module.getattr("error_of_kind").map(Bound::unbind)
    });
    let made = make.and_then(|make| make.bind(py).call1((kind, message, path, place, help)));
    made.map_or_else(|error| error, PyErr::from_value)
}

fn said(panic: &(dyn Any + Send)) -> Failure {
    let text = (panic.downcast_ref::<&str>().map(|text| (*text).to_owned()))
        .or_else(|| panic.downcast_ref::<String>().cloned());
    Failure::Internal(text.unwrap_or_else(|| "a panic".to_owned()))
}

/// Works without the interpreter's lock.
pub(crate) fn detached<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> chronotope::Result<T> + Send,
) -> Result<T> {
    match py.detach(|| catch_unwind(AssertUnwindSafe(work))) {
        Ok(done) => Ok(done?),
        Err(panic) => Err(said(&*panic)),
    }
}

/// [`detached`] for what has its own kind of failure.
pub(crate) fn detached_with<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T> + Send,
) -> Result<T> {
    match py.detach(|| catch_unwind(AssertUnwindSafe(work))) {
        Ok(done) => done,
        Err(panic) => Err(said(&*panic)),
    }
}

/// Works on another thread, so that Ctrl-C ends the wait at once; what was begun then ends by
/// itself, and nobody sees its result. For work that changes nothing outside of memory.
pub(crate) fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> chronotope::Result<T> + Send + 'static,
) -> Result<T> {
    let (send, mut receive) = mpsc::sync_channel(1);
    let spawned = std::thread::Builder::new()
        .name("chronotope".into())
        .spawn(move || send.send(catch_unwind(AssertUnwindSafe(work))));
    spawned.map_err(|cause| Error::new(ErrorKind::Io, format!("no thread: {cause}")))?;
    loop {
        let waited;
        (waited, receive) = py.detach(move || (receive.recv_timeout(LOOK_EVERY), receive));
        match waited {
            Ok(Ok(done)) => return Ok(done?),
            Ok(Err(panic)) => return Err(said(&*panic)),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Failure::Internal("a thread has ended".into()));
            }
        }
    }
}

/// Whether somebody has pressed Ctrl-C; for work without the interpreter's lock.
#[allow(
    clippy::redundant_closure_for_method_calls,
    reason = "the method is not general enough in its lifetime to be handed over by name"
)]
pub(crate) fn check_interrupt() -> Result<()> {
    Python::attach(|py| py.check_signals())?;
    Ok(())
}

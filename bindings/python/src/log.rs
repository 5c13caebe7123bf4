//! Where does what the engine has to say go?
//!
//! To Python's `logging`, by the logger `chronotope`. Levels are looked up there, so that nothing is
//! put together that nobody reads.

use std::fmt::Write as _;

use pyo3::prelude::*;
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Level, Metadata, Subscriber};

/// Hands events to `logging`.
struct Logging;

struct Text(String);

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        // Writing to a string does not fail.
        let _ = if field.name() == "message" {
            write!(self.0, "{value:?}")
        } else {
            write!(self.0, " {}={value:?}", field.name())
        };
    }
}

/// The level's number in `logging`.
fn number(level: Level) -> u8 {
    match level {
        Level::ERROR => 40,
        Level::WARN => 30,
        Level::INFO => 20,
        Level::DEBUG => 10,
        Level::TRACE => 5,
    }
}

impl Subscriber for Logging {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        *metadata.level() <= Level::DEBUG
    }

    fn new_span(&self, _span: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _span: &Id, _values: &Record<'_>) {}

    fn record_follows_from(&self, _span: &Id, _follows: &Id) {}

    fn event(&self, event: &Event<'_>) {
        let level = number(*event.metadata().level());
        let log = |py: Python<'_>| -> PyResult<()> {
            let is_loaded = py.import("sys")?.getattr("modules")?.contains("logging")?;
            // Nobody has asked to be told: by default `logging` shows warnings, and nothing less.
            if !is_loaded && level < number(Level::WARN) {
                return Ok(());
            }
            let logger = py
                .import("logging")?
                .call_method1("getLogger", ("chronotope",))?;
            if !logger.call_method1("isEnabledFor", (level,))?.is_truthy()? {
                return Ok(());
            }
            let mut text = Text(String::new());
            event.record(&mut text);
            logger.call_method1("log", (level, "%s", text.0.trim_start()))?;
            Ok(())
        };
        // While the interpreter ends there is nobody to tell.
        if let Some(Err(error)) = Python::try_attach(log) {
            Python::attach(|py| error.write_unraisable(py, None));
        }
    }

    fn enter(&self, _span: &Id) {}

    fn exit(&self, _span: &Id) {}
}

/// Listens from now on.
pub(crate) fn listen() {
    // Only another subscriber in this process could make it fail.
    let _ = tracing::subscriber::set_global_default(Logging);
}

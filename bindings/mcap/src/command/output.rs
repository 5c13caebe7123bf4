//! Where do results go?

use std::fmt::Display;
use std::io::{self, Write};

use anyhow::Result;
use chronotope::error::printable;
use serde::Serialize;

/// Lines of text or JSON on stdout.
pub(crate) struct Output(Box<dyn Write>);

impl Output {
    pub(crate) fn stdout() -> Self {
        Self(Box::new(io::stdout().lock()))
    }

    /// One line, or several without the last line's end. Names in it may come from outside, so
    /// nothing of it reaches a terminal that this would obey; only the ends of lines do.
    pub(crate) fn line(&mut self, text: impl Display) -> Result<()> {
        let text = text.to_string();
        let lines: Vec<_> = text.split('\n').map(printable).collect();
        Ok(writeln!(self.0, "{}", lines.join("\n"))?)
    }

    /// One line of JSON, which escapes control characters itself.
    pub(crate) fn json(&mut self, value: &impl Serialize) -> Result<()> {
        Ok(writeln!(self.0, "{}", serde_json::to_string(value)?)?)
    }
}

/// Whether the reader of stdout has gone.
pub(crate) fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .downcast_ref::<io::Error>()
        .is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
}

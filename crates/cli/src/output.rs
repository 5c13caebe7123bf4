//! Where do results go?

use std::fmt::Display;
use std::io::{self, Write};

use anyhow::Result;
use serde::Serialize;

use chronotope::map::Summary;

/// Lines of text or JSON on stdout, or on stderr where stdout carries a trace.
pub(super) struct Output(Box<dyn Write>);

impl Output {
    pub(super) fn stdout() -> Self {
        Self(Box::new(io::stdout().lock()))
    }

    pub(super) fn stderr() -> Self {
        Self(Box::new(io::stderr()))
    }

    /// A new file, for a trace.
    pub(super) fn file(path: &std::path::Path) -> Result<Self> {
        let file =
            std::fs::File::create(path).map_err(|cause| chronotope::Error::io(path, cause))?;
        Ok(Self(Box::new(io::LineWriter::new(file))))
    }

    /// One line, or several without the last line's end.
    pub(super) fn line(&mut self, text: impl Display) -> Result<()> {
        Ok(writeln!(self.0, "{text}")?)
    }

    /// One line of JSON.
    pub(super) fn json(&mut self, value: &impl Serialize) -> Result<()> {
        self.line(serde_json::to_string(value)?)
    }
}

/// Whether the reader of stdout has gone.
pub(super) fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .downcast_ref::<io::Error>()
        .is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
}

/// What a map holds, in words; a remark on the visits stands behind their number.
pub(super) fn contents(summary: &Summary, remark: impl Display) -> String {
    format!(
        "{} places, {} visits{remark}, {} features",
        summary.num_places, summary.num_visits, summary.num_features
    )
}

/// Bytes in hexadecimal.
pub(super) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

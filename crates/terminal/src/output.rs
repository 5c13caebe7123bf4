//! Where do results go?

use std::fmt::Display;
use std::io::{self, Write};
use std::path::Path;

use anyhow::Result;
use fremen::error::printable;
use fremen::file::{OutputFile, OutputKind};
use serde::Serialize;

use chronotope::map::Summary;

/// A file of traces, as `localize --trace` writes it.
const TRACE: OutputKind = OutputKind {
    noun: "a trace",
    begins: b"{\"schema_version\":",
};

/// Lines of text or JSON on stdout, or on stderr where stdout carries a trace.
pub struct Output(Box<dyn Write>);

impl std::fmt::Debug for Output {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Output")
    }
}

impl Output {
    /// Lines on stdout, which nobody else may write to meanwhile.
    pub fn stdout() -> Self {
        Self(Box::new(io::stdout().lock()))
    }

    /// Lines on stderr.
    pub fn stderr() -> Self {
        Self(Box::new(io::stderr()))
    }

    /// A file of traces, in place of an earlier one; it can be followed while it is written.
    pub fn trace(path: &Path, inputs: &[&Path]) -> Result<Self> {
        let mut file = OutputFile::replace(path, TRACE, inputs)?;
        file.publish()?;
        Ok(Self(Box::new(Followed(file))))
    }

    /// One line, or several without the last line's end. Names in it may come from outside, so
    /// nothing of it reaches a terminal that this would obey; only the ends of lines do.
    pub fn line(&mut self, text: impl Display) -> Result<()> {
        let text = text.to_string();
        let lines: Vec<_> = text.split('\n').map(printable).collect();
        Ok(writeln!(self.0, "{}", lines.join("\n"))?)
    }

    /// One line that ends in CR LF, as calendars have them; without control characters, which it must
    /// not have.
    pub fn raw_line(&mut self, text: &str) -> Result<()> {
        Ok(write!(self.0, "{text}\r\n")?)
    }

    /// One line of JSON, which escapes control characters itself.
    pub fn json(&mut self, value: &impl Serialize) -> Result<()> {
        Ok(writeln!(self.0, "{}", serde_json::to_string(value)?)?)
    }
}

/// What is written to it is in the file at once.
struct Followed(OutputFile);

impl Write for Followed {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let num_written = self.0.write(bytes)?;
        if bytes[..num_written].ends_with(b"\n") {
            self.0.flush()?;
        }
        Ok(num_written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// Whether the reader of stdout has gone.
pub fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .downcast_ref::<io::Error>()
        .is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
}

/// What a map holds, in words; a remark on the visits stands behind their number.
pub fn contents(summary: &Summary, remark: impl Display) -> String {
    format!(
        "{} places, {} visits{remark}, {} features",
        summary.num_places, summary.num_visits, summary.num_features
    )
}

/// Bytes in hexadecimal.
pub fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

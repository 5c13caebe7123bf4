//! What failed, where, and what helps?
//!
//! One boxed [`Error`] serves the whole crate. It has a [`kind`](Error::kind) to branch on, and a
//! message for people that names the file, the place in it and the remedy, each added by the layer
//! that knows it. "Not located" is no error but a decision of `localize`.

use std::fmt;
use std::path::{Path, PathBuf};

/// The result type of every fallible function of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What sort of thing failed; more kinds may be added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The operating system refused to read or write.
    Io,
    /// A file is not what its name or header says.
    Format,
    /// Stored bytes do not match their checksum.
    Checksum,
    /// An option, argument or configuration value cannot be used.
    Config,
    /// Sizes of two things that belong together differ.
    Shape,
    /// A time is missing, malformed or outside the supported range.
    Time,
    /// An image cannot be decoded or is unfit for the extractor.
    Image,
    /// The caller asked to stop; everything acknowledged so far is kept.
    Interrupted,
}

/// An error with its kind, place and remedy.
///
/// Shown as `FILE: PLACE: MESSAGE (help: REMEDY)`, with the parts that are known.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Error(Box<Inner>);

#[derive(Debug)]
struct Inner {
    kind: ErrorKind,
    message: String,
    path: Option<PathBuf>,
    place: Option<String>,
    help: Option<String>,
}

impl Error {
    /// An error of `kind` that says `message`.
    pub fn new(kind: ErrorKind, message: impl Into<String>) -> Self {
        Self(Box::new(Inner {
            kind,
            message: message.into(),
            path: None,
            place: None,
            help: None,
        }))
    }

    /// An [`ErrorKind::Io`] error for `path`.
    pub fn io(path: impl AsRef<Path>, source: &std::io::Error) -> Self {
        Self::new(ErrorKind::Io, source.to_string()).with_path(path)
    }

    /// Names the file, unless a deeper layer has done so.
    #[must_use]
    pub fn with_path(mut self, path: impl AsRef<Path>) -> Self {
        self.0
            .path
            .get_or_insert_with(|| path.as_ref().to_path_buf());
        self
    }

    /// Names the place inside the file (`line 7`, `table visit, row 3`), unless already named.
    #[must_use]
    pub fn with_place(mut self, place: impl Into<String>) -> Self {
        self.0.place.get_or_insert_with(|| place.into());
        self
    }

    /// Says what the user can do about it, unless already said.
    #[must_use]
    pub fn with_help(mut self, help: impl Into<String>) -> Self {
        self.0.help.get_or_insert_with(|| help.into());
        self
    }

    /// The sort of failure.
    pub fn kind(&self) -> ErrorKind {
        self.0.kind
    }

    /// The file concerned, where one is.
    pub fn path(&self) -> Option<&Path> {
        self.0.path.as_deref()
    }
}

impl fmt::Display for Inner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(path) = &self.path {
            write!(f, "{}: ", path.display())?;
        }
        if let Some(place) = &self.place {
            write!(f, "{place}: ")?;
        }
        f.write_str(&self.message)?;
        if let Some(help) = &self.help {
            write!(f, " (help: {help})")?;
        }
        Ok(())
    }
}

/// The line that a CSV record begins on, counted from 1.
///
/// The reader notes where it began to look, which is before the empty lines and comments that it passed
/// over.
pub fn line_of_record(text: &[u8], record: &csv::StringRecord, comment: Option<u8>) -> u64 {
    let Some(position) = record.position() else {
        return 1;
    };
    let rest = text.get(position.byte() as usize..).unwrap_or_default();
    let passed = rest
        .split_inclusive(|&byte| byte == b'\n')
        .take_while(|line| {
            (comment.is_some() && line.first().copied() == comment)
                || line.iter().all(|byte| b"\r\n".contains(byte))
        });
    position.line() + passed.count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shows_file_place_message_and_remedy_in_this_order() {
        let error = Error::new(ErrorKind::Time, "bad time `x`")
            .with_place("line 7")
            .with_path("index.csv")
            .with_path("a layer above must not overwrite this")
            .with_help("write RFC 3339");
        assert_eq!(
            error.to_string(),
            "index.csv: line 7: bad time `x` (help: write RFC 3339)"
        );
        assert_eq!(error.kind(), ErrorKind::Time);
    }
}

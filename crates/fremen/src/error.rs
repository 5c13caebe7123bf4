//! What failed, where, and what helps?
//!
//! One boxed [`Error`] serves this crate and all that are built on it. It has a
//! [`kind`](Error::kind) to branch on, and a message for people that names the file, the place in
//! it and the remedy, each added by the layer that knows it.

use std::borrow::Cow;
use std::error::Error as StdError;
use std::fmt;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// The result type of every fallible function.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What sort of thing failed; more kinds may be added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The operating system refused to read or write.
    Io,
    /// A file is not what its name or header says, cannot be decoded, or holds what cannot be used.
    Format,
    /// Stored bytes do not match their checksum.
    Checksum,
    /// An option, argument or configuration value cannot be used.
    Config,
    /// Sizes of two things that belong together differ.
    Shape,
    /// A time is missing, malformed or outside the supported range.
    Time,
    /// What was named is not there: a file, a place, a generation, a visit.
    NotFound,
    /// What was to be added is there already: a file, a visit.
    AlreadyExists,
    /// Somebody else was faster; the same call may succeed after what it works on was read again.
    Conflict,
    /// The caller interrupted it; everything acknowledged so far is kept.
    Interrupted,
}

impl ErrorKind {
    /// Every kind.
    pub const ALL: [Self; 10] = [
        Self::Io,
        Self::Format,
        Self::Checksum,
        Self::Config,
        Self::Shape,
        Self::Time,
        Self::NotFound,
        Self::AlreadyExists,
        Self::Conflict,
        Self::Interrupted,
    ];

    /// The name used in logs and by bindings to other languages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Io => "io",
            Self::Format => "format",
            Self::Checksum => "checksum",
            Self::Config => "config",
            Self::Shape => "shape",
            Self::Time => "time",
            Self::NotFound => "not-found",
            Self::AlreadyExists => "already-exists",
            Self::Conflict => "conflict",
            Self::Interrupted => "interrupted",
        }
    }
}

impl fmt::Display for ErrorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// An error with its kind, place and remedy.
///
/// Shown as `FILE: PLACE: MESSAGE (help: REMEDY)`, with the parts that are known. That text is
/// complete: it already says what the [`source`](StdError::source) says, which is there to be
/// branched on.
#[derive(Debug)]
pub struct Error(Box<Inner>);

#[derive(Debug)]
struct Inner {
    kind: ErrorKind,
    message: String,
    path: Option<PathBuf>,
    place: Option<String>,
    help: Option<String>,
    source: Option<Box<dyn StdError + Send + Sync>>,
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
            source: None,
        }))
    }

    /// What the operating system said of `path`: [`ErrorKind::NotFound`],
    /// [`ErrorKind::AlreadyExists`] or [`ErrorKind::Io`].
    pub fn io(path: impl AsRef<Path>, cause: io::Error) -> Self {
        let kind = match cause.kind() {
            io::ErrorKind::NotFound => ErrorKind::NotFound,
            io::ErrorKind::AlreadyExists => ErrorKind::AlreadyExists,
            _ => ErrorKind::Io,
        };
        Self::new(kind, cause.to_string())
            .with_path(path)
            .with_source(cause)
    }

    /// Names the file, unless a deeper layer has done so.
    #[must_use]
    pub fn with_path(mut self, path: impl AsRef<Path>) -> Self {
        self.0
            .path
            .get_or_insert_with(|| path.as_ref().to_path_buf());
        self
    }

    /// Leaves the file out, where whoever shows the error names it already.
    #[must_use]
    pub fn without_path(mut self) -> Self {
        self.0.path = None;
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

    /// Keeps the error of a library below, unless one is kept already.
    #[must_use]
    pub fn with_source(mut self, source: impl Into<Box<dyn StdError + Send + Sync>>) -> Self {
        self.0.source.get_or_insert_with(|| source.into());
        self
    }

    /// The sort of failure.
    pub fn kind(&self) -> ErrorKind {
        self.0.kind
    }

    /// What failed, without file, place and remedy.
    pub fn message(&self) -> &str {
        &self.0.message
    }

    /// The file concerned, where one is.
    pub fn path(&self) -> Option<&Path> {
        self.0.path.as_deref()
    }

    /// The place inside the file, where one is known: `line 7`.
    pub fn place(&self) -> Option<&str> {
        self.0.place.as_deref()
    }

    /// What the user can do about it, where something is known.
    pub fn help(&self) -> Option<&str> {
        self.0.help.as_deref()
    }
}

impl StdError for Error {
    fn source(&self) -> Option<&(dyn StdError + 'static)> {
        self.0.source.as_deref().map(|source| source as _)
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let inner = &self.0;
        if let Some(path) = &inner.path {
            write!(f, "{}: ", printable(&path.to_string_lossy()))?;
        }
        if let Some(place) = &inner.place {
            write!(f, "{}: ", printable(place))?;
        }
        f.write_str(&printable(&inner.message))?;
        if let Some(help) = &inner.help {
            write!(f, " (help: {})", printable(help))?;
        }
        Ok(())
    }
}

/// The text with what a terminal would obey instead of showing it, or show in another order or not
/// at all, written as Rust writes it (`\u{1b}`): names come from outside.
pub fn printable(text: &str) -> Cow<'_, str> {
    let is_hidden = |c: char| {
        c.is_control()
            || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}'
                | '\u{2060}'..='\u{2069}' | '\u{feff}')
    };
    if !text.contains(is_hidden) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_hidden(c) {
            shown.extend(c.escape_default());
        } else {
            shown.push(c);
        }
    }
    Cow::Owned(shown)
}

/// What an error and its causes say, from the outermost inwards, as one line.
///
/// Stops at the first [`Error`], whose text says what its source says already. For programs that
/// wrap errors of this crate in others (such as `anyhow`'s).
pub fn describe(error: &(dyn StdError + 'static)) -> String {
    let mut parts = Vec::new();
    let mut next = Some(error);
    while let Some(cause) = next {
        parts.push(cause.to_string());
        next = (!cause.is::<Error>()).then(|| cause.source()).flatten();
    }
    parts.join(": ")
}

/// What `work` gives; of a panic in it, `error` makes an error from what was said. For libraries that
/// panic on files which are damaged; what `work` has touched is not to be used after one.
pub fn catching<T>(
    work: impl FnOnce() -> Result<T>,
    error: impl FnOnce(&str) -> Error,
) -> Result<T> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let text = (panic.downcast_ref::<String>().map(String::as_str))
            .or_else(|| panic.downcast_ref::<&str>().copied());
        Err(error(text.unwrap_or("no reason given")))
    })
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
        assert_eq!(error.message(), "bad time `x`");
        assert_eq!(error.path(), Some(Path::new("index.csv")));
        assert_eq!(error.place(), Some("line 7"));
        assert_eq!(error.help(), Some("write RFC 3339"));
        assert!(error.source().is_none());
    }

    #[test]
    fn an_error_of_the_system_can_be_branched_on_by_kind_and_by_source() {
        let path = Path::new("/no such folder/door.csv");
        let cause = std::fs::read(path).expect_err("there is none");
        let error = Error::io(path, cause);
        assert_eq!(error.kind(), ErrorKind::NotFound);
        let source = error.source().and_then(|it| it.downcast_ref::<io::Error>());
        assert_eq!(source.map(io::Error::kind), Some(io::ErrorKind::NotFound));
        assert_eq!(describe(&error), error.to_string());
        let full = Error::io(path, io::Error::from(io::ErrorKind::StorageFull));
        assert_eq!(full.kind(), ErrorKind::Io);
    }

    #[test]
    fn names_from_outside_do_nothing_to_a_terminal() {
        let error = Error::new(ErrorKind::Format, "no \u{1b}[2Jimage")
            .with_path("a\nerror: b\u{202e}gpj.exe")
            .with_place("place `\u{200b}`");
        let shown = error.to_string();
        assert_eq!(
            shown,
            "a\\nerror: b\\u{202e}gpj.exe: place `\\u{200b}`: no \\u{1b}[2Jimage"
        );
        assert!(matches!(printable("Příkopy 7 \u{1f333}"), Cow::Borrowed(_)));
    }

    #[test]
    fn kinds_have_names_of_their_own() {
        let names: std::collections::BTreeSet<_> = ErrorKind::ALL.map(ErrorKind::name).into();
        assert_eq!(names.len(), ErrorKind::ALL.len());
    }

    #[test]
    fn errors_go_from_thread_to_thread() {
        fn check<T: Send + Sync + 'static>() {}
        check::<Error>();
    }

    #[test]
    fn a_panic_is_an_error_with_its_words() {
        let refused = |text: &str| Error::new(ErrorKind::Format, format!("no table: {text}"));
        let number = std::hint::black_box(7);
        let works: [fn(usize) -> Result<usize>; 4] = [
            |number| panic!("row {number}"),
            |_| panic!("plain"),
            |number| Ok([1, 2][number]),
            |_| std::panic::panic_any(3),
        ];
        let said = works.map(|work| catching(|| work(number), refused).unwrap_err().to_string());
        assert_eq!(said[0], "no table: row 7");
        assert_eq!(said[1], "no table: plain");
        assert!(said[2].contains("out of bounds"), "{}", said[2]);
        assert_eq!(said[3], "no table: no reason given");
        assert_eq!(catching(|| Ok(number), refused).unwrap(), 7);
    }
}

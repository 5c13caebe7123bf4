//! What went wrong, and how does C learn of it?

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use engine::{Error, ErrorKind, Result};

/// How a call ended. Values never change their meaning; new ones may be added.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChronotopeStatus {
    /// It did what it should.
    Ok = 0,
    /// A file or the disk.
    Io = 1,
    /// A file that is not what it should be.
    Format = 2,
    /// A file that was changed or damaged.
    Checksum = 3,
    /// Settings that cannot be.
    Config = 4,
    /// An image of the wrong size, or fewer bytes than its size needs.
    Shape = 5,
    /// A time that is missing or impossible.
    Time = 6,
    /// Something that is not there.
    NotFound = 7,
    /// Something that is there already.
    AlreadyExists = 8,
    /// Another process was faster; try again.
    Conflict = 9,
    /// Stopped on request.
    Interrupted = 10,
    /// An argument that no caller may give: NULL, or an index beyond the end.
    Argument = 11,
    /// A fault of this library: it was caught, and what it was working on should be freed.
    Panic = 12,
    /// Anything that this version has no word for.
    Other = 13,
}

impl ChronotopeStatus {
    fn of(kind: ErrorKind) -> Self {
        match kind {
            ErrorKind::Io => Self::Io,
            ErrorKind::Format => Self::Format,
            ErrorKind::Checksum => Self::Checksum,
            ErrorKind::Config => Self::Config,
            ErrorKind::Shape => Self::Shape,
            ErrorKind::Time => Self::Time,
            ErrorKind::NotFound => Self::NotFound,
            ErrorKind::AlreadyExists => Self::AlreadyExists,
            ErrorKind::Conflict => Self::Conflict,
            ErrorKind::Interrupted => Self::Interrupted,
            _ => Self::Other,
        }
    }
}

/// Why a call fails.
pub(crate) enum Failure {
    Engine(Error),
    Argument(&'static str),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Engine(error)
    }
}

/// What a thread's last failure was.
struct Last {
    status: ChronotopeStatus,
    message: CString,
    path: Option<CString>,
    place: Option<CString>,
    help: Option<CString>,
}

thread_local! {
    static LAST: RefCell<Option<Last>> = const { RefCell::new(None) };
}

/// Text without the zeros that C would stop at.
pub(crate) fn c_text(text: &str) -> CString {
    CString::new(text.replace('\0', "\u{fffd}")).unwrap_or_default()
}

/// Does `call` and remembers how it failed; no panic leaves it.
pub(crate) fn guarded(call: impl FnOnce() -> Result<(), Failure>) -> ChronotopeStatus {
    let last = match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(())) => return ChronotopeStatus::Ok,
        Ok(Err(Failure::Argument(message))) => Last {
            status: ChronotopeStatus::Argument,
            message: c_text(message),
            path: None,
            place: None,
            help: None,
        },
        Ok(Err(Failure::Engine(error))) => Last {
            status: ChronotopeStatus::of(error.kind()),
            message: c_text(error.message()),
            path: error.path().map(|path| c_text(&path.to_string_lossy())),
            place: error.place().map(c_text),
            help: error.help().map(c_text),
        },
        Err(cause) => Last {
            status: ChronotopeStatus::Panic,
            message: c_text(&format!(
                "a fault in the library: {}",
                words_of(cause.as_ref())
            )),
            path: None,
            place: None,
            help: Some(c_text(
                "report it with what was called; free the handle that was used",
            )),
        },
    };
    let status = last.status;
    // At the end of a thread there is nobody left to ask.
    let _ = LAST.try_with(|it| it.replace(Some(last)));
    status
}

fn words_of(cause: &(dyn Any + Send)) -> String {
    match (cause.downcast_ref::<&str>(), cause.downcast_ref::<String>()) {
        (Some(words), _) => (*words).to_owned(),
        (_, Some(words)) => words.clone(),
        _ => "without words".into(),
    }
}

/// Gives a handle up: what is freed is never used again, so that a fault in it matters no more.
pub(crate) fn freed<T>(handle: *mut T) {
    if !handle.is_null() {
        // SAFETY: the caller gives back, once, what `boxed` gave out.
        let owned = unsafe { Box::from_raw(handle) };
        let _ = catch_unwind(AssertUnwindSafe(move || drop(owned)));
    }
}

/// Gives a handle out.
pub(crate) fn boxed<T>(out: *mut *mut T, value: T) -> Result<(), Failure> {
    if out.is_null() {
        return Err(Failure::Argument("the pointer for the handle is NULL"));
    }
    // SAFETY: it is not null, and the caller says that it can be written.
    unsafe { *out = Box::into_raw(Box::new(value)) };
    Ok(())
}

/// A handle that is only read.
pub(crate) fn shared<'a, T>(handle: *const T) -> Result<&'a T, Failure> {
    // SAFETY: it is null or, so the caller says, one of ours that nobody frees or changes meanwhile.
    unsafe { handle.as_ref() }.ok_or(Failure::Argument("a handle is NULL"))
}

/// A handle that is changed, by one thread at a time.
pub(crate) fn unique<'a, T>(handle: *mut T) -> Result<&'a mut T, Failure> {
    // SAFETY: it is null or, so the caller says, one of ours that nobody else uses meanwhile.
    unsafe { handle.as_mut() }.ok_or(Failure::Argument("a handle is NULL"))
}

/// Where a result goes.
pub(crate) fn written<T>(out: *mut T, value: T) -> Result<(), Failure> {
    if out.is_null() {
        return Err(Failure::Argument("the pointer for the result is NULL"));
    }
    // SAFETY: it is not null, and the caller says that it can be written.
    unsafe { out.write(value) };
    Ok(())
}

/// A text of the caller.
pub(crate) fn text<'a>(text: *const c_char) -> Result<&'a str, Failure> {
    if text.is_null() {
        return Err(Failure::Argument("a text is NULL"));
    }
    // SAFETY: it is not null, and the caller says that it ends in a zero.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str()
        .map_err(|_| Failure::Argument("a text is no UTF-8"))
}

/// The number of the binary interface: a program that was compiled for another number must not go
/// on. Any thread.
#[unsafe(no_mangle)]
pub extern "C" fn chronotope_abi_version() -> u32 {
    1
}

/// The version of the library, as text. Any thread; never freed.
#[unsafe(no_mangle)]
pub extern "C" fn chronotope_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

fn of_last(part: impl FnOnce(&Last) -> Option<&CString>) -> *const c_char {
    LAST.try_with(|it| {
        let last = it.borrow();
        (last.as_ref().and_then(part)).map_or(std::ptr::null(), |text| text.as_ptr())
    })
    .unwrap_or(std::ptr::null())
}

/// The status of this thread's last call that failed; OK if none has.
#[unsafe(no_mangle)]
pub extern "C" fn chronotope_error_status() -> ChronotopeStatus {
    LAST.try_with(|it| it.borrow().as_ref().map(|last| last.status))
        .ok()
        .flatten()
        .unwrap_or(ChronotopeStatus::Ok)
}

/// What went wrong in this thread's last call that failed; NULL if none has. Until the next one
/// fails.
#[unsafe(no_mangle)]
pub extern "C" fn chronotope_error_message() -> *const c_char {
    of_last(|last| Some(&last.message))
}

/// The file that was wrong, or NULL; as `chronotope_error_message`.
#[unsafe(no_mangle)]
pub extern "C" fn chronotope_error_path() -> *const c_char {
    of_last(|last| last.path.as_ref())
}

/// The place in it, or NULL; as `chronotope_error_message`.
#[unsafe(no_mangle)]
pub extern "C" fn chronotope_error_place() -> *const c_char {
    of_last(|last| last.place.as_ref())
}

/// What helps, or NULL; as `chronotope_error_message`.
#[unsafe(no_mangle)]
pub extern "C" fn chronotope_error_help() -> *const c_char {
    of_last(|last| last.help.as_ref())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(text: *const c_char) -> String {
        assert!(!text.is_null());
        // SAFETY: it is one of the library's own texts.
        let text = unsafe { CStr::from_ptr(text) };
        text.to_string_lossy().into_owned()
    }

    #[test]
    fn a_panic_becomes_a_status() {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(|_| {}));
        let status = guarded(|| panic!("injected {}", 7));
        std::panic::set_hook(before);
        assert_eq!(status, ChronotopeStatus::Panic);
        assert_eq!(chronotope_error_status(), ChronotopeStatus::Panic);
        assert!(said(chronotope_error_message()).contains("injected 7"));
    }

    #[test]
    fn an_error_keeps_its_parts_for_its_thread() {
        let error = Error::new(ErrorKind::Checksum, "bad \0 byte")
            .with_path("a.map")
            .with_place("row 3")
            .with_help("copy it again");
        assert_eq!(guarded(|| Err(error.into())), ChronotopeStatus::Checksum);
        assert_eq!(said(chronotope_error_message()), "bad \u{fffd} byte");
        assert_eq!(said(chronotope_error_path()), "a.map");
        assert_eq!(said(chronotope_error_place()), "row 3");
        assert_eq!(said(chronotope_error_help()), "copy it again");
        let other = std::thread::spawn(|| chronotope_error_message().is_null());
        assert!(other.join().expect("no panic"));
        // What succeeds leaves it as it was.
        assert_eq!(guarded(|| Ok(())), ChronotopeStatus::Ok);
        assert_eq!(chronotope_error_status(), ChronotopeStatus::Checksum);
    }

    #[test]
    fn null_is_a_status() {
        assert!(boxed(std::ptr::null_mut(), 1).is_err());
        assert!(shared::<u8>(std::ptr::null()).is_err() && text(std::ptr::null()).is_err());
        freed::<u8>(std::ptr::null_mut());
    }
}

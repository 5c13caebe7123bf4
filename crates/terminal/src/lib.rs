//! How do the commands of this project begin, speak, stop and end?
//!
//! `chronotope`, `chronotope-bags` and the ROS 2 node say the same things in the same words: results
//! go to stdout, diagnostics to stderr ([`note!`]), Ctrl-C loses nothing ([`interrupt`]), and the
//! exit code tells how it went ([`Outcome`]).
//!
//! ```no_run
//! use std::process::ExitCode;
//!
//! use chronotope_terminal::{Outcome, Output, begin, end};
//!
//! fn main() -> ExitCode {
//!     end(begin(0).and_then(|()| {
//!         Output::stdout().line("done")?;
//!         Ok(Outcome::Good)
//!     }))
//! }
//! ```
//!
//! Not for the library: it does not print.

pub mod arguments;
pub mod command;
pub mod config;
pub mod interrupt;
pub mod outcome;
pub mod output;
pub mod reading;
pub mod yaml;

#[doc(hidden)]
pub use chronotope::error::printable;
pub use command::{begin, end};
pub use outcome::Outcome;
pub use output::Output;

/// One line on stderr: names in it come from outside, so nothing of it reaches a terminal that this
/// would obey. Where nothing can be written there (a full disk, nobody who reads) nothing is said.
#[macro_export]
macro_rules! note {
    ($($words:tt)*) => {{
        let line = format!($($words)*);
        let line = $crate::printable(&line);
        let _ = std::io::Write::write_fmt(&mut std::io::stderr(), format_args!("{line}\n"));
    }};
}

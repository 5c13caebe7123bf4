//! How did a command end that did not fail?

use std::process::ExitCode;

use crate::interrupt;

/// How a command ended that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Located, or done.
    Good,
    /// Unknown or ambiguous, or problems were found.
    Doubtful,
    /// An error was printed already; what could be done was.
    Failed,
    /// Stopped on request.
    Interrupted,
}

impl Outcome {
    /// Good, unless problems were found.
    pub fn of_check(is_clean: bool) -> Self {
        if is_clean { Self::Good } else { Self::Doubtful }
    }
}

impl From<Outcome> for ExitCode {
    fn from(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Good => Self::SUCCESS,
            Outcome::Doubtful => Self::from(1),
            Outcome::Failed => Self::from(2),
            Outcome::Interrupted => Self::from(interrupt::EXIT_CODE),
        }
    }
}

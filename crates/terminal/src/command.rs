//! How does a command begin, and how does it end?

use std::io::IsTerminal;
use std::process::ExitCode;

use anyhow::{Context, Result};

use chronotope::error::describe;
use chronotope::simd::Kernel;

use crate::note;
use crate::outcome::Outcome;
use crate::output;

/// Begins a command: its log goes to stderr (warnings; with a verbosity of 1 more, of 2 all), its
/// threads start, and `CHRONOTOPE_KERNEL` is looked at.
///
/// Fails if the system starts no more threads or no kernel has this name.
pub fn begin(verbosity: u8) -> Result<()> {
    log_to_stderr(verbosity);
    // Started here, where a system that gives no more threads can be spoken of.
    (rayon::ThreadPoolBuilder::new().build_global()).context(
        "the system starts no more threads (help: end other programs, or set \
         RAYON_NUM_THREADS=1)",
    )?;
    let kernel = Kernel::from_env()?;
    tracing::debug!(kernel = kernel.name(), "matching");
    Ok(())
}

/// The exit code of a command that ended so; says what failed.
pub fn end(result: Result<Outcome>) -> ExitCode {
    match result {
        Ok(outcome) => outcome.into(),
        // The reader has seen enough (`| head`).
        Err(error) if output::is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            note!("error: {}", describe(error.as_ref()));
            Outcome::Failed.into()
        }
    }
}

fn log_to_stderr(verbosity: u8) {
    let level = match verbosity {
        0 => "warn",
        1 => "info",
        _ => "debug",
    };
    // Only a second subscriber in this process could make it fail.
    let _ = tracing_subscriber::fmt()
        // The middleware of a node warns of whoever has left.
        .with_env_filter(tracing_subscriber::EnvFilter::new(format!(
            "{level},rustdds=error"
        )))
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr)
        .without_time()
        .with_target(false)
        .try_init();
}

//! How far has a long run come?
//!
//! In a terminal a bar moves. Where stderr is a file or a pipe, a line is printed every few
//! seconds, so that a log shows that work goes on.

use std::io::{IsTerminal as _, stderr};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Between two lines.
const PAUSE: Duration = Duration::from_secs(5);

/// A number of steps, of which some are done; shown until it is dropped.
#[derive(Debug)]
pub(crate) enum Progress {
    /// In a terminal.
    Bar(ProgressBar),
    /// In a file or a pipe.
    Lines {
        /// Steps that are done.
        done: Arc<AtomicUsize>,
        /// Ends the lines when it is dropped.
        _end: Sender<()>,
    },
}

impl Progress {
    /// Nothing of `len` steps is done yet.
    pub(crate) fn new(len: usize, what: &'static str) -> Self {
        if stderr().is_terminal() {
            let style = ProgressStyle::with_template("{msg:>12} {bar:40} {pos}/{len} {eta} left")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            let bar = ProgressBar::new(len as u64).with_style(style);
            return Self::Bar(bar.with_message(what));
        }
        let done = Arc::new(AtomicUsize::new(0));
        let (end, ended) = channel();
        let shown = Arc::clone(&done);
        let start = Instant::now();
        std::thread::spawn(move || {
            while ended.recv_timeout(PAUSE) == Err(RecvTimeoutError::Timeout) {
                let done = shown.load(Ordering::Relaxed);
                eprintln!("{}", line(what, done, len, start.elapsed()));
            }
        });
        Self::Lines { done, _end: end }
    }

    /// One step more is done.
    pub(crate) fn inc(&self) {
        match self {
            Self::Bar(bar) => bar.inc(1),
            Self::Lines { done, .. } => {
                done.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

/// What is done, and how long the rest will take at this pace.
fn line(what: &str, done: usize, len: usize, elapsed: Duration) -> String {
    let left = match done {
        0 => String::new(),
        done => {
            let left_s = elapsed.as_secs_f64() / done as f64 * len.saturating_sub(done) as f64;
            format!(", about {left_s:.0} s left")
        }
    };
    format!(
        "{what}: {done} of {len} after {} s{left}",
        elapsed.as_secs()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_what_is_done_and_what_is_left() {
        let after = |done, s| line("synthetic", done, 8, Duration::from_secs(s));
        assert_eq!(after(0, 5), "synthetic: 0 of 8 after 5 s");
        assert_eq!(
            after(2, 10),
            "synthetic: 2 of 8 after 10 s, about 30 s left"
        );
    }

    #[test]
    fn steps_are_counted_from_any_thread() {
        let progress = Progress::new(4, "test");
        std::thread::scope(|threads| {
            for _ in 0..4 {
                threads.spawn(|| progress.inc());
            }
        });
        match &progress {
            Progress::Bar(bar) => assert_eq!(bar.position(), 4),
            Progress::Lines { done, .. } => assert_eq!(done.load(Ordering::Relaxed), 4),
        }
    }
}

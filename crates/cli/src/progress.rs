//! How far is it?

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Shorter work has no bar.
const PATIENCE: Duration = Duration::from_secs(2);

/// A bar on stderr, if that is a terminal and the work takes long.
pub(super) struct Progress {
    bar: ProgressBar,
    start: Instant,
    is_shown: AtomicBool,
}

impl Progress {
    /// `verb` says what is done to `total` images.
    pub(super) fn new(verb: &'static str, total: usize) -> Self {
        let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::hidden());
        if let Ok(style) =
            ProgressStyle::with_template("{msg} [{wide_bar}] {pos}/{len} images, {eta} left")
        {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_message(verb);
        Self {
            bar,
            start: Instant::now(),
            is_shown: AtomicBool::new(false),
        }
    }

    /// So many are done; may be called from several threads, in any order.
    pub(super) fn reach(&self, done: usize) {
        if self.start.elapsed() >= PATIENCE
            && std::io::stderr().is_terminal()
            && !self.is_shown.swap(true, Ordering::Relaxed)
        {
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
        if done as u64 > self.bar.position() {
            self.bar.set_position(done as u64);
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

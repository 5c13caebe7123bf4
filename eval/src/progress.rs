//! How far has a long run come?

use indicatif::{ProgressBar, ProgressStyle};

/// A bar on stderr, hidden where that is no terminal.
pub(crate) fn progress(len: usize, what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:>12} {bar:40} {pos}/{len} {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(len as u64)
        .with_style(style)
        .with_message(what)
}

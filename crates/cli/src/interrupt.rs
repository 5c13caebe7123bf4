//! Shall the process stop?
//!
//! The first Ctrl-C (or SIGTERM, or SIGHUP) raises a flag, which long work looks at between images;
//! the second one ends the process at once. Both are safe for a map: commits are atomic.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};

/// What shells call a process that SIGINT ended.
pub(super) const EXIT_CODE: u8 = 130;

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// From now on Ctrl-C only raises the flag.
pub(super) fn watch() -> Result<()> {
    ctrlc::set_handler(|| {
        if REQUESTED.swap(true, Ordering::SeqCst) {
            std::process::exit(i32::from(EXIT_CODE));
        }
        eprintln!("stopping after the images in hand; Ctrl-C again stops at once");
    })
    .context("cannot watch for Ctrl-C")
}

/// Whether Ctrl-C was pressed.
pub(super) fn is_requested() -> bool {
    REQUESTED.load(Ordering::SeqCst)
}

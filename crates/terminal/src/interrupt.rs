//! Shall the process stop?
//!
//! The first Ctrl-C (or SIGTERM, or SIGHUP) raises a flag, which long work looks at between images;
//! where that takes longer than a service manager waits, or at the second one, the process ends at
//! once. All of this is safe for a map: commits are atomic, and what was not committed is learnt
//! again by the same command.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, Result};

use crate::note;

/// What shells call a process that SIGINT ended.
pub const EXIT_CODE: u8 = 130;

/// How long the images in hand may take.
const MOST_PATIENCE: Duration = Duration::from_millis(1_500);

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// From now on Ctrl-C raises the flag, and ends the process only if nobody looks at it.
pub fn watch() -> Result<()> {
    ctrlc::set_handler(|| {
        if REQUESTED.swap(true, Ordering::SeqCst) {
            std::process::exit(i32::from(EXIT_CODE));
        }
        note!("stopping after the images in hand; Ctrl-C again stops at once");
        // Whatever the process waits for: a slow disk, another writer, a large image.
        std::thread::spawn(|| {
            std::thread::sleep(MOST_PATIENCE);
            note!("stopped; to go on, give the same command again");
            std::process::exit(i32::from(EXIT_CODE));
        });
    })
    .context("cannot watch for Ctrl-C")
}

/// Whether Ctrl-C was pressed.
pub fn is_requested() -> bool {
    REQUESTED.load(Ordering::SeqCst)
}

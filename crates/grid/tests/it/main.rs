//! What must hold of grids, whatever they are made of.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "a test that cannot prepare itself has failed"
)]

mod cells;
mod compress;
mod exchange;
mod experiment;
mod file;
mod history;
mod lifelong;
mod localize;
mod temporal;
mod twin;

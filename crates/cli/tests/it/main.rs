//! The one integration-test binary.
#![allow(clippy::unwrap_used, clippy::expect_used)] // reason: a test that cannot prepare itself has failed.

mod cli;
mod cli_spectrum;

//! Is what a fleet learns exact, and is every bad table named?
#![allow(clippy::unwrap_used, clippy::expect_used)] // reason: a test that cannot prepare itself has failed.

mod bad_tables;
mod fixture;
mod learning;
mod tables;

//! The one integration-test binary.
#![allow(clippy::unwrap_used, clippy::expect_used)] // reason: a test that cannot prepare itself has failed.

mod online;
mod series;
mod spectrum;
mod visibility;
mod visibility_series;
mod visibility_suite;

//! The one integration-test binary.
#![allow(clippy::unwrap_used, clippy::expect_used)] // reason: a test that cannot prepare itself has failed.

mod bad_input;
mod coin;
mod future;
mod plans;
mod real_data;
mod tours;
mod worlds;

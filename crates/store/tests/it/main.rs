//! The integration tests of this crate: one program.
#![allow(
    clippy::expect_used,
    reason = "these functions all belong to tests, which clippy cannot see here"
)]

mod cells;
mod counts;
mod journals;
mod rows;

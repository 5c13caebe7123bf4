//! The one integration-test binary.

mod spectrum;
mod visibility;
mod visibility_suite;

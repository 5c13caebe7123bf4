//! The one integration-test binary.

mod spectrum;
mod visibility;
mod visibility_series;
mod visibility_suite;

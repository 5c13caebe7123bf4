//! The one integration-test binary.

mod spectrum;
mod visibility;

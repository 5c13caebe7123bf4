//! The one integration-test binary.

mod visibility;
mod dataset;
mod map;

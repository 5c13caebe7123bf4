//! The one integration-test binary.

mod dataset;
mod map;
mod visibility;

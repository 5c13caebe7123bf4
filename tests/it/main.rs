//! The one integration-test binary.

mod dataset;
mod feature;
mod map;
mod visibility;

//! The one integration-test binary.

mod dataset;
mod map;
mod matching;
mod spectrum;
mod synthetic;
mod visibility;

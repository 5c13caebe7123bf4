//! The one integration-test binary.

mod architecture;
mod dataset;
mod feature;
mod map;
mod matching;
mod spectrum;
mod synthetic;
mod visibility;

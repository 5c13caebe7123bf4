//! The one integration-test binary.

mod cli;
mod dataset;
mod feature;
mod map;
mod matching;
mod spectrum;
mod synthetic;
mod visibility;

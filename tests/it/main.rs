//! The one integration-test binary.
mod matching;

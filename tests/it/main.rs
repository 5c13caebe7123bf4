//! The one integration-test binary.

mod dataset;

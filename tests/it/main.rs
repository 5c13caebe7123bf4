//! The one integration-test binary.

mod feature;

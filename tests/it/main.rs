//! The one integration-test binary.

mod map;

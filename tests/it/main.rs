//! The one integration-test binary.

mod visibility;

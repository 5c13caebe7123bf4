//! The one integration-test binary.

mod synthetic;

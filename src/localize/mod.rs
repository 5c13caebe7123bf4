//! Room localize.

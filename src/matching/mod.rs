//! Room matching.

//! Room learn.

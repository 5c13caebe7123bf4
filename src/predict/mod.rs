//! Room predict.

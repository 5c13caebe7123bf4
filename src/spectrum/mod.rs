//! Room spectrum.

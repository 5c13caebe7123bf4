//! The kernels of the library and nothing else, so that they compile for a machine without its C libraries.
#![allow(dead_code)] // reason: most of the error type serves other rooms.

#[path = "../../src/error.rs"]
pub mod error;
#[path = "../../src/simd/mod.rs"]
pub mod simd;

pub use error::{Error, ErrorKind, Result};

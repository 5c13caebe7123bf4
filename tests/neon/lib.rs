//! The kernels of the library and nothing else, so that they compile for a machine without its C
//! libraries.
#![allow(dead_code)] // reason: the rooms that search and sum with them are left out.

#[path = "../../src/simd/mod.rs"]
pub mod simd;
#[cfg(test)]
mod twin;

//! Can any bytes in place of a series of states make the library panic?
#![no_main]

use libfuzzer_sys::fuzz_target;

#[allow(dead_code, reason = "shared by all targets")]
#[path = "../../tests/it/untrusted.rs"]
mod untrusted;

fuzz_target!(|bytes: &[u8]| untrusted::series(bytes));

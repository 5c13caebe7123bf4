//! Can any bytes in place of a fitted model make the library panic or predict what is no probability?
#![no_main]

use libfuzzer_sys::fuzz_target;

#[allow(dead_code, reason = "shared by all targets")]
#[path = "../../tests/it/untrusted.rs"]
mod untrusted;

fuzz_target!(|bytes: &[u8]| untrusted::visibility_model(bytes));

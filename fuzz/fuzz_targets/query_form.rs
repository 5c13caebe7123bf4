//! Can any bytes in place of a query form make the library panic, or a sound map unusable?
#![no_main]

use libfuzzer_sys::fuzz_target;

#[allow(dead_code, reason = "shared by all targets")]
#[path = "../../tests/it/untrusted.rs"]
mod untrusted;

fuzz_target!(|bytes: &[u8]| untrusted::query_form(bytes));

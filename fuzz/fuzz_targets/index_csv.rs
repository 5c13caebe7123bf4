//! Can any bytes in place of the index.csv of a dataset make the library panic?
#![no_main]

use libfuzzer_sys::fuzz_target;

#[allow(dead_code, reason = "shared by all targets")]
#[path = "../../tests/it/untrusted.rs"]
mod untrusted;

fuzz_target!(|bytes: &[u8]| untrusted::index_csv(bytes));

//! Can any bytes in place of a robot's bag make the library panic?
#![no_main]

use libfuzzer_sys::fuzz_target;

#[allow(dead_code, reason = "shared with the tests of bindings/mcap")]
#[path = "../../bindings/mcap/tests/untrusted.rs"]
mod untrusted;

fuzz_target!(|bytes: &[u8]| untrusted::bag(bytes));

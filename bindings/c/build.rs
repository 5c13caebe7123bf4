//! Gives the shared library the name that programs ask the loader for: one for every ABI.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|os| os == "linux") {
        // The number is that of `chronotope_abi_version`.
        println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libchronotope.so.1");
    }
}

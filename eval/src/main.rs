//! The command `chronotope-eval`; see `chronotope-eval --help`.

fn main() {}

//! The command `chronotope`; see `chronotope --help`.

fn main() {}

//! The command `chronotope-eval` with its feature `dashboard`, for the tests to compare with.

use std::process::ExitCode;

fn main() -> ExitCode {
    chronotope_eval::command::main()
}

//! The command `chronotope-eval`.

use std::process::ExitCode;

fn main() -> ExitCode {
    chronotope_eval::command::main()
}

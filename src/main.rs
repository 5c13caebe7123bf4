//! The command `chronotope`; see `chronotope --help`.

fn main() -> std::process::ExitCode {
    chronotope::cli::run()
}

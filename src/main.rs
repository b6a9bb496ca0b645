//! The `starloop` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    starloop::cli::main()
}

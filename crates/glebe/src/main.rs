//! The command line.

use std::process::ExitCode;

fn main() -> ExitCode {
    glebe::cli::main()
}

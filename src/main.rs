//! Arguments in, exit code out.

use std::process::ExitCode;

fn main() -> ExitCode {
    carl_pipe::cli::main(std::env::args_os().collect(), carl_pipe::stage::registry())
}

//! Arguments in, exit code out.

use std::{ffi::OsString, process::ExitCode};

fn main() -> ExitCode {
    let argv: Vec<OsString> = std::env::args_os().collect();
    carl_pipe::cli::main(&argv, carl_pipe::stage::registry()).into()
}

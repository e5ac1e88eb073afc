//! Finds `carl-view`, the program that shows recordings in Rerun.
//!
//! It is a package of its own, because the Rerun SDK alone takes ten minutes to build.

use std::{
    env,
    ffi::OsStr,
    os::unix::fs::PermissionsExt as _,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use super::exit::{Error, Exit};

const NAME: &str = "carl-view";

/// The version of carl-pipe. `carl-view` must have the same one.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The path of `carl-view`: in the folder of the running program, or else on the PATH.
///
/// # Errors
/// If there is no such program, it cannot be started, or it has another version. The error names the command that
/// builds it.
pub(crate) fn find() -> Result<PathBuf, Error> {
    let beside = env::current_exe().ok().and_then(|program| program.parent().map(Path::to_owned));
    let build = build_command(beside.as_deref());
    let path = env::var_os("PATH").unwrap_or_default();
    let program =
        beside.into_iter().chain(env::split_paths(&path)).map(|folder| folder.join(NAME)).find(|file| is_program(file));
    let Some(program) = program else {
        let text = format!("the view needs the program `{NAME}`, which is neither beside `carl-pipe` nor on the PATH");
        return Err(Error::new(Exit::Store, text).help(format!("build it with `{build}`")));
    };
    check_version(&program)
        .map_err(|text| Error::new(Exit::Store, text).help(format!("build it again with `{build}`")))?;
    Ok(program)
}

/// True for a file that somebody may execute.
pub(super) fn is_program(file: &Path) -> bool {
    file.metadata().is_ok_and(|metadata| metadata.is_file() && metadata.permissions().mode() & 0o111 != 0)
}

/// Refuses a program of another version, which may read events and recordings differently.
fn check_version(program: &Path) -> Result<(), String> {
    let output = Command::new(program).arg("--version").stdin(Stdio::null()).output();
    let output = output.map_err(|error| format!("cannot start {}: {error}", program.display()))?;
    let answer = String::from_utf8_lossy(&output.stdout);
    let answer = answer.trim();
    if answer == format!("{NAME} {VERSION}") {
        return Ok(());
    }
    let found = answer.strip_prefix(NAME).map_or("unknown", str::trim);
    Err(format!("{} has version {found}, but `carl-pipe` has version {VERSION}", program.display()))
}

/// The command that puts `carl-view` beside a program in this folder: a folder of cargo's, or one with installed
/// programs.
fn build_command(folder: Option<&Path>) -> &'static str {
    match folder.and_then(Path::file_name).and_then(OsStr::to_str) {
        Some("release") => "cargo build --release -p carl-view",
        Some("debug") => "cargo build -p carl-view",
        _ => "cargo install --path view",
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::build_command;

    #[test]
    fn the_build_command_puts_the_view_beside_the_program() {
        let command = |folder: &str| build_command(Some(Path::new(folder)));
        assert_eq!(command("/src/target/release"), "cargo build --release -p carl-view");
        assert_eq!(command("/src/target/debug"), "cargo build -p carl-view");
        assert_eq!(command("/home/me/.cargo/bin"), "cargo install --path view");
    }
}

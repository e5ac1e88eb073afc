//! The program as a user runs it, in a folder of its own.

use std::{
    path::PathBuf,
    process::{Command, Stdio},
};

use super::cli::Ended;

/// A folder with pipelines and a store.
pub struct Desk {
    pub folder: tempfile::TempDir,
}

impl Desk {
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_carl-pipe"));
        command.args(words).env_remove("CARL_ARTIFACTS").current_dir(self.folder.path()).stdin(Stdio::null());
        command
    }

    pub fn call(&self, words: &[&str]) -> Ended {
        Ended::of(self.command(words).output().unwrap())
    }
}

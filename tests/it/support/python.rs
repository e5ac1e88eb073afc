//! What tests need that read our files in Python.

use std::process::Command;

/// Whether Python has these modules, as in `numpy, mcap`. Where it lacks one, says what to install; in CI that is a failure.
pub fn python_has(modules: &str) -> bool {
    let import = Command::new("python3").args(["-c", &format!("import {modules}")]).output();
    let has = import.is_ok_and(|output| output.status.success());
    if !has {
        assert!(std::env::var_os("CI").is_none(), "CI installs tests/python/requirements.txt");
        eprintln!("skipped: `pip install -r tests/python/requirements.txt` first");
    }
    has
}

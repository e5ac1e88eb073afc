//! Tells the program the commit that it is built from, for manifests. No key and no result holds it.
//!
//! Only in release builds: in others every commit would cost a build. A folder without git has no commit.

use std::{env, process::Command};

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if env::var("PROFILE").as_deref() != Ok("release") {
        return;
    }
    for file in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--git-path", file]) {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    // A change of these is a build anyway, and may make the commit a dirty one.
    let sources = ["src", "Cargo.toml", "Cargo.lock"];
    sources.iter().for_each(|path| println!("cargo::rerun-if-changed={path}"));
    let Some(commit) = git(&["rev-parse", "HEAD"]) else { return };
    let status: Vec<&str> = ["status", "--porcelain", "--"].into_iter().chain(sources).collect();
    let dirty = if git(&status).is_some_and(|changes| changes.is_empty()) { "" } else { "-dirty" };
    println!("cargo::rustc-env=CARL_COMMIT={commit}{dirty}");
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    String::from_utf8(output.stdout).ok().map(|text| text.trim().to_owned())
}

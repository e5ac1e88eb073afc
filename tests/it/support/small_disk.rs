//! A small file system of its own, where this machine lets a test mount one.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

/// A file system in memory; dropping it takes it away.
pub struct SmallDisk {
    pub path: PathBuf,
}

impl SmallDisk {
    /// A disk of so many KiB in a new folder; `None` where it cannot be mounted.
    pub fn mount(path: &Path, kib: u64) -> Option<Self> {
        fs::create_dir(path).unwrap();
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &format!("size={kib}k"), "tmpfs"]).arg(path);
        mount.output().is_ok_and(|it| it.status.success()).then(|| Self { path: path.to_owned() })
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.path).output();
    }
}

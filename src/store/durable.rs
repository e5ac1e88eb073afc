//! Files that appear whole or not at all, and stay through a power cut once they have appeared.

#![allow(
    clippy::disallowed_methods,
    reason = "wall times are kept beside a run and name its folder; no key and no result holds one"
)]

use std::{
    fs::{self, File, OpenOptions},
    io::{self, Write as _},
    os::unix::fs::PermissionsExt as _,
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

use anyhow::Context as _;
use rustix::fs::{CWD, RenameFlags, renameat_with};

/// A file not yet under its name; removed if it never gets one.
#[derive(Debug)]
pub(super) struct Temporary {
    path: PathBuf,
    file: File,
    is_placed: bool,
}

impl Temporary {
    /// Writes bytes to a new file in `folder`; they are not yet safe from a power cut.
    pub(super) fn write(folder: &Path, bytes: &[u8]) -> anyhow::Result<Self> {
        let path = fresh_name(folder);
        let context = || format!("cannot write {} ({} bytes)", path.display(), bytes.len());
        let file = OpenOptions::new().write(true).create_new(true).open(&path).with_context(context)?;
        let mut temporary = Self { path: path.clone(), file, is_placed: false };
        temporary.file.write_all(bytes).with_context(context)?;
        Ok(temporary)
    }

    /// Takes over a file that someone else wrote, in the same file system.
    pub(super) fn adopt(path: &Path) -> anyhow::Result<Self> {
        let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
        Ok(Self { path: path.to_owned(), file, is_placed: false })
    }

    /// Makes the bytes safe and the file read-only.
    pub(super) fn seal(&self) -> anyhow::Result<()> {
        let sealed = self.file.set_permissions(fs::Permissions::from_mode(0o444)).and_then(|()| self.file.sync_all());
        sealed.with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Gives the file its name; false if the name was taken.
    pub(super) fn place(mut self, name: &Path) -> anyhow::Result<bool> {
        let placed = match renameat_with(CWD, &self.path, CWD, name, RenameFlags::NOREPLACE) {
            Ok(()) => Ok(true),
            Err(rustix::io::Errno::EXIST) => return Ok(false),
            // A file system without renameat2 (NFS): a link does not replace either.
            Err(rustix::io::Errno::INVAL | rustix::io::Errno::NOSYS) => match fs::hard_link(&self.path, name) {
                Ok(()) => fs::remove_file(&self.path).map(|()| true),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => return Ok(false),
                Err(error) => Err(error),
            },
            Err(error) => Err(error.into()),
        };
        self.is_placed = placed.is_ok();
        placed.with_context(|| format!("cannot write {}", name.display()))
    }

    /// Gives the file its name, in place of what had it.
    pub(super) fn replace(mut self, name: &Path) -> anyhow::Result<()> {
        fs::rename(&self.path, name).with_context(|| format!("cannot write {}", name.display()))?;
        self.is_placed = true;
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if !self.is_placed {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// A name in `folder` that nobody else has.
pub(super) fn fresh_name(folder: &Path) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let nanos =
        std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0, |since| since.subsec_nanos());
    folder.join(format!("{}-{}-{nanos}.tmp", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed)))
}

/// Replaces a small file whole; `durable` also makes it safe from a power cut.
///
/// # Errors
/// What the system says, with the path.
pub fn replace(path: &Path, bytes: &[u8], durable: bool) -> anyhow::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let temporary = Temporary::write(folder, bytes)?;
    if durable {
        temporary.file.sync_all().with_context(|| format!("cannot write {}", path.display()))?;
    }
    temporary.replace(path)?;
    if durable { sync_folder(folder) } else { Ok(()) }
}

/// Makes the names in a folder safe from a power cut.
///
/// # Errors
/// What the system says, with the path.
pub fn sync_folder(folder: &Path) -> anyhow::Result<()> {
    File::open(folder)
        .and_then(|folder| folder.sync_all())
        .with_context(|| format!("cannot write {}", folder.display()))
}

/// Makes a folder whose name survives a power cut.
pub(super) fn make_folder(folder: &Path) -> anyhow::Result<()> {
    match fs::create_dir(folder) {
        Ok(()) => sync_folder(folder.parent().unwrap_or(Path::new("."))),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        Err(error) => Err(error).with_context(|| format!("cannot make {}", folder.display())),
    }
}

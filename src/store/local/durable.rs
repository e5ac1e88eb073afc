//! Files that appear whole or not at all, and survive a power cut once they have appeared.

use std::{
    fs::{self, File},
    io::{self, Write as _},
    os::unix::fs::PermissionsExt as _,
    path::{Path, PathBuf},
};

use tempfile::{Builder, NamedTempFile, TempPath};

use crate::{
    digest::Digest,
    failpoint::failpoint,
    store::{Result, error::OrIo as _},
};

/// How the names of temporary files begin. Only files with such names are ever swept.
pub(super) const OWN_PREFIX: &str = "carl-tmp-";

/// The temporary files and folders of this program in a folder, such as what [`replace_file`] left when it was killed.
pub fn own_items(folder: &Path) -> impl Iterator<Item = PathBuf> + use<> {
    let items = fs::read_dir(folder).into_iter().flatten().flatten();
    let is_own = |item: &fs::DirEntry| item.file_name().as_encoded_bytes().starts_with(OWN_PREFIX.as_bytes());
    items.filter(is_own).map(|item| item.path())
}

/// A file that does not have its final name yet. It is removed if it never gets one.
#[derive(Debug)]
pub(super) struct Temporary(NamedTempFile);

impl Temporary {
    /// Writes bytes in parts to a new file in `folder`. They do not survive a power cut yet.
    pub(super) fn write(folder: &Path, parts: &[impl AsRef<[u8]>]) -> Result<Self> {
        let bytes = || parts.iter().map(|part| part.as_ref().len()).sum::<usize>();
        let context = || format!("cannot write in {} ({} bytes)", folder.display(), bytes());
        let mut file = fresh_file(folder, "").or_io(context)?;
        // The error of the file itself. The library's error would name the path a second time.
        let written = parts.iter().try_for_each(|part| file.as_file_mut().write_all(part.as_ref()));
        failpoint!("write temporary", written).or_io(context)?;
        Ok(Self(file))
    }

    /// Takes over the file at `path`. A file in another file system is copied to `folder` first.
    pub(super) fn take_over(path: &Path, folder: &Path) -> Result<Self> {
        let context = || format!("cannot take over {}", path.display());
        if Self::is_on_other_device(path, folder).or_io(context)? {
            let mut copy = fresh_file(folder, "").or_io(context)?;
            io::copy(&mut File::open(path).or_io(context)?, &mut copy).or_io(context)?;
            fs::remove_file(path).or_io(context)?;
            return Ok(Self(copy));
        }
        let file = failpoint!("take over", File::open(path)).or_io(context)?;
        let path = TempPath::try_from_path(path).or_io(context)?;
        Ok(Self(NamedTempFile::from_parts(file, path)))
    }

    fn is_on_other_device(path: &Path, folder: &Path) -> io::Result<bool> {
        use std::os::unix::fs::MetadataExt as _;
        Ok(fs::metadata(path)?.dev() != fs::metadata(folder)?.dev())
    }

    /// The digest of the bytes.
    pub(super) fn digest(&self) -> Result<Digest> {
        let digest = File::open(self.0.path()).and_then(Digest::of_reader);
        digest.or_io(|| format!("cannot read {}", self.0.path().display()))
    }

    /// Makes the file read-only and its bytes safe from a power cut.
    pub(super) fn seal(&self) -> Result<()> {
        let file = self.0.as_file();
        // Some network and FAT file systems refuse rights. The bytes are verified by their digest in any case.
        _ = file.set_permissions(fs::Permissions::from_mode(0o444));
        self.sync(self.0.path())
    }

    /// Makes the bytes safe from a power cut; `name` is what an error calls the file.
    fn sync(&self, name: &Path) -> Result<()> {
        failpoint!("sync file", self.0.as_file().sync_all()).or_io(|| format!("cannot write {}", name.display()))
    }

    /// Gives the file its name; returns false, and removes the file, where another file has that name.
    pub(super) fn place(self, name: &Path) -> Result<bool> {
        match failpoint!("place file", self.0.persist_noclobber(name).map_err(|error| error.error)) {
            Ok(_) => Ok(true),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(false),
            Err(error) => Err(error).or_io(|| format!("cannot write {}", name.display())),
        }
    }

    /// Gives the file its name, in place of the file that has it.
    pub(super) fn replace(self, name: &Path) -> Result<()> {
        let placed = failpoint!("replace file", self.0.persist(name).map_err(|error| error.error));
        placed.map(|_| ()).or_io(|| format!("cannot write {}", name.display()))
    }
}

/// A new file in `folder` whose name no other file has; `suffix` ends the name.
fn fresh_file(folder: &Path, suffix: &str) -> io::Result<NamedTempFile> {
    // The umask narrows these rights, as for any other file of the user.
    let rights = fs::Permissions::from_mode(0o666);
    failpoint!(
        "make temporary",
        Builder::new().prefix(OWN_PREFIX).suffix(suffix).permissions(rights).tempfile_in(folder)
    )
}

/// Moves a file to a fresh name in `folder`; the name ends in the file's own.
pub(super) fn move_aside(path: &Path, folder: &Path) -> io::Result<PathBuf> {
    let name = path.file_name().map_or_else(String::new, |name| format!("-{}", name.to_string_lossy()));
    let place = fresh_file(folder, &name)?.into_temp_path();
    failpoint!("move aside", fs::rename(path, &place))?;
    place.keep().map_err(|error| error.error)
}

/// Replaces a small file whole; `durable` also makes it safe from a power cut.
///
/// # Errors
/// The system refused an operation.
pub fn replace_file(path: &Path, bytes: &[u8], durable: bool) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let temporary = Temporary::write(folder, &[bytes])?;
    if durable {
        temporary.sync(path)?;
    }
    temporary.replace(path)?;
    if durable { sync_folder(folder) } else { Ok(()) }
}

/// Makes the names in a folder safe from a power cut, where the file system can do so. `carl-pipe doctor` says whether.
///
/// # Errors
/// The system refused an operation.
pub fn sync_folder(folder: &Path) -> Result<()> {
    match failpoint!("sync folder", File::open(folder).and_then(|folder| folder.sync_all())) {
        Err(error) if !cannot_sync_folders(&error) => Err(error).or_io(|| format!("cannot write {}", folder.display())),
        _ => Ok(()),
    }
}

/// Whether a file system refuses to sync folders at all. A full or failing disk gives other errors.
fn cannot_sync_folders(error: &io::Error) -> bool {
    use io::ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    const EBADF: i32 = 9;
    matches!(error.kind(), InvalidInput | PermissionDenied | Unsupported) || error.raw_os_error() == Some(EBADF)
}

/// Makes a folder whose name survives a power cut.
pub(super) fn make_folder(folder: &Path) -> Result<()> {
    match failpoint!("make folder", fs::create_dir(folder)) {
        Ok(()) => sync_folder(folder.parent().unwrap_or(Path::new("."))),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        Err(error) => Err(error).or_io(|| format!("cannot make {}", folder.display())),
    }
}

//! Does the file system of the store keep what the store relies on? Each question is tried in a temporary folder.

use std::{
    fs::{self, File, Permissions, TryLockError},
    io::{self, ErrorKind, Write as _},
    os::unix::fs::{PermissionsExt as _, symlink},
    path::Path,
};

use super::Finding;
use crate::cli::out;

/// Below this many bytes of free space, runs will soon fail.
const LITTLE_SPACE: u64 = 1_000_000_000;
const NO_SPACE: u64 = 50_000_000;

/// Tries everything in the new folder `folder`, and removes it.
pub(super) fn look(folder: &Path, findings: &mut Vec<Finding>) {
    if let Err(error) = fs::create_dir(folder) {
        let text = format!("cannot write in {}: {error}", folder.parent().unwrap_or(folder).display());
        let help = "runs need to write here; other verbs do not";
        findings.push(Finding::problem("writing", out::tidy(&text), help));
        return;
    }
    findings.push(writing(folder));
    findings.push(locks(folder));
    findings.push(renaming(folder));
    findings.push(folder_sync(folder));
    findings.push(rights(folder));
    findings.push(links(folder));
    findings.push(space(folder));
    let _ = fs::remove_dir_all(folder);
}

fn failed(error: &io::Error) -> String {
    out::tidy(&error.to_string())
}

fn writing(folder: &Path) -> Finding {
    let path = folder.join("written");
    let write = || {
        let mut file = File::create(&path)?;
        file.write_all(&[7; 1 << 16])?;
        file.sync_all()
    };
    match write().and_then(|()| fs::read(&path)) {
        Ok(bytes) if bytes == [7; 1 << 16] => Finding::ok("writing", "files can be written and synced"),
        Ok(_) => Finding::problem("writing", "a file reads otherwise than it was written", "use another disk"),
        Err(error) => Finding::problem("writing", failed(&error), "free some space or use another disk"),
    }
}

/// Two holders of one lock would work on the same key.
fn locks(folder: &Path) -> Finding {
    const HELP: &str = "use a local disk, or let only one process use the store at a time";
    let path = folder.join("lock");
    let open = || File::options().write(true).create(true).truncate(false).open(&path);
    let lock = || -> Result<Result<(), TryLockError>, io::Error> {
        let first = open()?;
        first.lock()?;
        Ok(open()?.try_lock())
    };
    match lock() {
        Ok(Err(TryLockError::WouldBlock)) => Finding::ok("locks", "a locked file is locked for others"),
        Ok(Ok(())) => Finding::problem("locks", "a locked file can be locked again", HELP),
        Ok(Err(TryLockError::Error(error))) | Err(error) => Finding::problem("locks", failed(&error), HELP),
    }
}

/// The first result of a key counts because its file is never replaced.
fn renaming(folder: &Path) -> Finding {
    let place = || -> io::Result<bool> {
        let taken = folder.join("taken");
        fs::write(&taken, "first")?;
        let second = tempfile::NamedTempFile::new_in(folder)?;
        match second.persist_noclobber(&taken) {
            Ok(_) => Ok(false),
            Err(error) if error.error.kind() == ErrorKind::AlreadyExists => Ok(fs::read(&taken)? == b"first"),
            Err(error) => Err(error.error),
        }
    };
    match place() {
        Ok(true) => Finding::ok("renaming", "a file is renamed without replacing another"),
        Ok(false) => Finding::problem("renaming", "a file that must stay was replaced", "use another disk"),
        Err(error) => Finding::problem("renaming", failed(&error), "use another disk"),
    }
}

fn folder_sync(folder: &Path) -> Finding {
    match File::open(folder).and_then(|folder| folder.sync_all()) {
        Ok(()) => Finding::ok("folders", "a folder can be synced"),
        Err(error) => Finding::warning(
            "folders",
            format!("a folder cannot be synced: {}", failed(&error)),
            "a power cut may take the newest results; the same command makes them again",
        ),
    }
}

fn rights(folder: &Path) -> Finding {
    let path = folder.join("read-only");
    let set = || {
        fs::write(&path, "")?;
        fs::set_permissions(&path, Permissions::from_mode(0o444))?;
        Ok(fs::metadata(&path)?.permissions().mode() & 0o777)
    };
    let help = "results can be changed by hand here; `carl-pipe verify` finds such changes";
    match set() {
        Ok(0o444) => Finding::ok("rights", "results are made read-only"),
        Ok(mode) => Finding::warning("rights", format!("a read-only file has the rights {mode:o}"), help),
        Err(error) => {
            Finding::warning("rights", format!("rights cannot be set: {}", io::Error::to_string(&error)), help)
        }
    }
}

fn links(folder: &Path) -> Finding {
    let link = || {
        fs::write(folder.join("target"), "target")?;
        symlink("target", folder.join("link"))?;
        fs::read(folder.join("link"))
    };
    match link() {
        Ok(bytes) if bytes == b"target" => Finding::ok("links", "links lead to files"),
        Ok(_) => Finding::warning("links", "a link leads elsewhere", NO_LINKS),
        Err(error) => Finding::warning("links", format!("links cannot be made: {}", failed(&error)), NO_LINKS),
    }
}

const NO_LINKS: &str = "the folders of runs have no links; `carl-pipe show RUN NODE` prints the paths of files";

fn space(folder: &Path) -> Finding {
    match rustix::fs::statvfs(folder) {
        Ok(state) => {
            let free = state.f_bavail.saturating_mul(state.f_frsize);
            let text = format!("{} are free", out::bytes(free));
            let help = "`carl-pipe gc` removes old results";
            match free {
                ..NO_SPACE => Finding::problem("space", text, help),
                NO_SPACE..LITTLE_SPACE => Finding::warning("space", text, help),
                _ => Finding::ok("space", text),
            }
        }
        Err(error) => Finding::warning("space", format!("unknown: {error}"), "look at it with `df`"),
    }
}

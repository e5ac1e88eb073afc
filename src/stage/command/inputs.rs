//! The inputs of a program: copies of the files of artifacts, which it must not change.

use std::{
    fs::{self, Metadata, Permissions},
    io,
    os::unix::fs::{MetadataExt as _, PermissionsExt as _},
    path::{Path, PathBuf},
};

use anyhow::{Context as _, ensure};

use super::outputs::is_plain;
use crate::{artifact::Files, stage::InputFiles, store::Content};

/// The inputs as the program finds them: a folder for each.
#[derive(Debug)]
pub(super) struct Given {
    folder: PathBuf,
    /// Every file and folder, and how it looked before the program started.
    before: Vec<(PathBuf, Look)>,
}

/// Tells an untouched file from a touched one without reading it.
type Look = (u64, i64, i64, u64);

impl Given {
    /// Copies the files of every input. One artifact lies in the folder of its input, several lie in `0`, `1`, … below it.
    pub(super) fn copy(inputs: &InputFiles<'_>, folder: &Path) -> anyhow::Result<Self> {
        fs::create_dir(folder)?;
        for (port, artifacts) in &inputs.by_port {
            for (number, files) in artifacts.iter().enumerate() {
                let place = folder.join(port);
                let place = if artifacts.len() > 1 { place.join(number.to_string()) } else { place };
                copy(files, &place).with_context(|| format!("cannot copy the input `{port}`"))?;
            }
        }
        let mut before = Vec::new();
        look(folder, &mut before)?;
        Ok(Self { folder: folder.to_owned(), before })
    }

    /// The folder of an input.
    pub(super) fn place(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Refuses inputs that the program changed.
    pub(super) fn must_be_unchanged(&self) -> anyhow::Result<()> {
        let mut after = Vec::new();
        look(&self.folder, &mut after)?;
        let others = self.before.iter().zip(&after).find(|(before, after)| before != after);
        let other = others.map(|(before, _)| &before.0).or_else(|| {
            let shorter = self.before.len().min(after.len());
            self.before.get(shorter).or(after.get(shorter)).map(|(path, _)| path)
        });
        let shown = other.map(|path| path.strip_prefix(&self.folder).unwrap_or(path).display().to_string());
        ensure!(shown.is_none(), "the program wrote into its inputs, at `{}`", shown.unwrap_or_default());
        Ok(())
    }
}

fn copy(files: &Files, folder: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(folder)?;
    for (name, content) in files.iter() {
        ensure!(is_plain(Path::new(name)), "the file name `{name}` leads out of its folder");
        let place = folder.join(name);
        place.parent().map_or(Ok(()), fs::create_dir_all)?;
        match content {
            Content::File(path) => _ = fs::copy(path, &place)?,
            content => _ = io::copy(&mut content.reader()?, &mut fs::File::create(&place)?)?,
        }
        fs::set_permissions(&place, Permissions::from_mode(0o444))?;
    }
    Ok(())
}

/// How everything below a folder looks, in the order of the names.
fn look(folder: &Path, found: &mut Vec<(PathBuf, Look)>) -> anyhow::Result<()> {
    let look_of = |meta: Metadata| (meta.size(), meta.ctime(), meta.ctime_nsec(), meta.ino());
    found.push((folder.to_owned(), look_of(fs::symlink_metadata(folder)?)));
    let mut items = fs::read_dir(folder)?.collect::<io::Result<Vec<_>>>()?;
    items.sort_by_key(fs::DirEntry::file_name);
    for item in items {
        if item.file_type()?.is_dir() {
            look(&item.path(), found)?;
        } else {
            found.push((item.path(), look_of(fs::symlink_metadata(item.path())?)));
        }
    }
    Ok(())
}

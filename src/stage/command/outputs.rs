//! What a program may write, and what it wrote.

use std::{
    collections::BTreeMap,
    fs,
    os::unix::fs::{FileTypeExt as _, MetadataExt as _},
    path::{Component, Path, PathBuf},
};

use anyhow::{Context as _, bail, ensure};

use crate::{artifact::Files, stage::Refusal, store::Content};

/// The outputs that a stage declares: by name a file, or a folder whose path ends in `/`.
#[derive(Debug)]
pub(super) struct Declaration<'a> {
    paths: &'a BTreeMap<String, String>,
}

impl<'a> Declaration<'a> {
    /// Checks the paths.
    ///
    /// # Errors
    /// A path that is not below the folder of outputs, or lies in another output.
    pub(super) fn new(paths: &'a BTreeMap<String, String>) -> Result<Self, Refusal> {
        for (name, path) in paths {
            let refuse = |why: String| Refusal::new(format!("outputs.{name}"), why);
            if !is_plain(Path::new(path.strip_suffix('/').unwrap_or(path))) {
                let help = "write a file such as `model.bin`, or a folder such as `plots/`";
                return Err(refuse(format!("is no path below the folder of outputs: `{path}`")).help(help));
            }
            let other = paths.iter().find(|(other, above)| {
                *other != name
                    && (above.ends_with('/') && path.starts_with(*above) || above.trim_end_matches('/') == path)
            });
            if let Some((other, _)) = other {
                return Err(refuse(format!("lies in the output `{other}`")));
            }
        }
        Ok(Self { paths })
    }

    /// Where the program writes an output.
    pub(super) fn place(&self, name: &str, folder: &Path) -> Option<PathBuf> {
        self.paths.get(name).map(|path| folder.join(path))
    }

    /// Makes the folders that outputs lie in.
    pub(super) fn make_folders(&self, folder: &Path) -> anyhow::Result<()> {
        for path in self.paths.values() {
            let path = folder.join(path);
            let made = if path.as_os_str().as_encoded_bytes().ends_with(b"/") { Some(&*path) } else { path.parent() };
            made.map_or(Ok(()), fs::create_dir_all)?;
        }
        Ok(())
    }

    /// The files that the program wrote. They stay where they are until the store takes them over.
    ///
    /// # Errors
    /// An output is missing, or something else was written.
    pub(super) fn collect(&self, folder: &Path) -> anyhow::Result<Files> {
        let mut found = Vec::new();
        walk(folder, "", &mut found)?;
        let undeclared: Vec<String> =
            found.iter().filter(|name| self.owner(name).is_none()).map(|name| format!("`{name}`")).collect();
        ensure!(
            undeclared.is_empty(),
            "the program wrote {}, which `outputs` does not declare",
            undeclared[..undeclared.len().min(5)].join(", ")
        );
        for (name, path) in self.paths {
            if !found.iter().any(|file| self.owner(file) == Some(name)) {
                bail!("the program ended with exit status 0 but did not write the output `{name}` (`{path}`)");
            }
        }
        Ok(found.into_iter().map(|name| (name.clone(), Content::File(folder.join(name)))).collect())
    }

    /// The output that a file belongs to.
    fn owner(&self, file: &str) -> Option<&'a String> {
        let owns = |path: &str| path == file || path.ends_with('/') && file.starts_with(path);
        self.paths.iter().find(|(_, path)| owns(path)).map(|(name, _)| name)
    }
}

/// Whether a path goes down from where it starts, and has a name.
pub(super) fn is_plain(path: &Path) -> bool {
    let text = path.to_str().unwrap_or_default();
    !text.is_empty()
        && !text.ends_with('/')
        && !text.contains("//")
        && !text.contains(char::is_control)
        && path.components().all(|part| matches!(part, Component::Normal(_)))
        && text.split('/').all(|part| part != ".")
}

/// The names of all files below a folder.
fn walk(folder: &Path, above: &str, found: &mut Vec<String>) -> anyhow::Result<()> {
    let cannot_list = || format!("cannot list {}", folder.display());
    let mut items =
        fs::read_dir(folder).with_context(cannot_list)?.collect::<Result<Vec<_>, _>>().with_context(cannot_list)?;
    items.sort_by_key(fs::DirEntry::file_name);
    for item in items {
        let shown = format!("{above}{}", item.file_name().display());
        let name = item.file_name().into_string().ok().filter(|name| !name.contains(char::is_control));
        let name = name.with_context(|| format!("the program wrote `{shown}`, whose name is not printable UTF-8"))?;
        let meta = fs::symlink_metadata(item.path()).with_context(|| format!("cannot read `{shown}`"))?;
        let kind = meta.file_type();
        if kind.is_dir() {
            walk(&item.path(), &format!("{above}{name}/"), found)?;
        } else if kind.is_symlink() {
            bail!("the output `{shown}` is a symbolic link; write the file itself");
        } else if kind.is_fifo() || kind.is_socket() || !kind.is_file() {
            bail!("the output `{shown}` is not a file but a pipe, a socket or a device");
        } else if meta.nlink() > 1 {
            bail!("the output `{shown}` has a second name (a hard link) by which it could still change; write a copy");
        } else {
            found.push(shown);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(paths: &[(&str, &str)]) -> Option<String> {
        let paths = paths.iter().map(|(name, path)| ((*name).to_owned(), (*path).to_owned())).collect();
        Declaration::new(&paths).err().map(|refusal| refusal.path.into_owned())
    }

    #[test]
    fn a_path_that_leaves_the_folder_or_another_output_is_refused() {
        assert_eq!(refusal(&[("a", "a.bin"), ("b", "b/c.bin"), ("plots", "plots/")]), None);
        for path in ["", "/", "/etc/passwd", "..", "../a", "a/../b", "./a", "a//b", "a/.", "a\n", "a/b//"] {
            assert_eq!(refusal(&[("a", path)]).as_deref(), Some("outputs.a"), "{path:?}");
        }
        assert_eq!(refusal(&[("all", "x/"), ("one", "x/y")]).as_deref(), Some("outputs.one"));
        assert_eq!(refusal(&[("one", "x"), ("two", "x")]).as_deref(), Some("outputs.one"));
        assert_eq!(refusal(&[("file", "x"), ("folder", "x/")]).as_deref(), Some("outputs.file"));
    }
}

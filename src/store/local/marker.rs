//! `store.json`, which says that a folder is a store. Nothing is ever written to a folder that holds files of others.

use std::{
    fs,
    io::{self, ErrorKind},
    path::Path,
};

use serde_json::{Value, json};

use super::durable::{OWN_PREFIX, make_folder, replace_file};
use crate::{
    failpoint::failpoint,
    store::{Error, Result, error::OrIo as _},
};

/// The layout of a store. Raise it when an older carl-pipe would misread a store.
const FORMAT: u64 = 1;

/// The folders of a store.
const FOLDERS: [&str; 5] = ["objects", "keys", "locks", "tmp", "bad"];

/// What a folder is to a store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// A store of this format.
    Store,
    /// Nothing is there yet, or an empty folder.
    Free,
}

/// Says whether a folder is a store or free for one. Reads only.
///
/// # Errors
/// [`Error::NotAStore`] where the folder is neither, [`Error::OtherFormat`], or the system refused an operation.
pub(super) fn look(root: &Path) -> Result<Place> {
    let marker = root.join("store.json");
    match failpoint!("read marker", fs::read(&marker)) {
        Ok(text) => check(root, &text).map(|()| Place::Store),
        Err(error) if error.kind() == ErrorKind::NotFound => look_inside(root),
        Err(error) if error.kind() == ErrorKind::NotADirectory => Err(not_a_store(root, "it is a file")),
        Err(error) => Err(error).or_io(|| format!("cannot read {}", marker.display())),
    }
}

/// Whether a folder without `store.json` is empty or absent.
fn look_inside(root: &Path) -> Result<Place> {
    let items = match fs::read_dir(root) {
        Ok(items) => items,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Place::Free),
        Err(error) if error.kind() == ErrorKind::NotADirectory => return Err(not_a_store(root, "it is a file")),
        Err(error) => return Err(error).or_io(|| format!("cannot read {}", root.display())),
    };
    for item in items {
        let name = item.or_io(|| format!("cannot read {}", root.display()))?.file_name();
        // Another process may make the store right now. A fresh file system has a folder `lost+found`. The source tree
        // has a page about the store.
        let is_free = name.as_encoded_bytes().starts_with(OWN_PREFIX.as_bytes())
            || name == "lost+found"
            || (name == "README.md" && is_our_page(&root.join(&name)));
        // The other process may have finished since `store.json` was looked for.
        if !is_free && !root.join("store.json").exists() {
            return Err(not_a_store(root, "it has files but no store.json"));
        }
    }
    Ok(Place::Free)
}

/// Makes a store in a free folder, or the missing folders of a store: copying tools drop empty folders.
pub(super) fn make(root: &Path, place: Place) -> Result<()> {
    if place == Place::Free {
        fs::create_dir_all(root).or_io(|| format!("cannot make {}", root.display()))?;
        let text = format!("{}\n", json!({"store": "carl-pipe", "format": FORMAT}));
        replace_file(&root.join("store.json"), text.as_bytes(), true)?;
    }
    FOLDERS.iter().try_for_each(|folder| make_folder(&root.join(folder)))
}

fn is_our_page(path: &Path) -> bool {
    let title = include_str!("../../../artifacts/README.md").lines().next();
    fs::read_to_string(path).is_ok_and(|text| text.lines().next() == title)
}

fn check(root: &Path, text: &[u8]) -> Result<()> {
    let json: Value = serde_json::from_slice(text)
        .map_err(io::Error::other)
        .map_err(|_| not_a_store(root, "its store.json is damaged"))?;
    match (json["store"].as_str(), json["format"].as_u64()) {
        (Some("carl-pipe"), Some(FORMAT)) => Ok(()),
        (Some("carl-pipe"), Some(found)) => {
            Err(Error::OtherFormat { folder: root.to_owned(), found, supported: FORMAT })
        }
        _ => Err(not_a_store(root, "its store.json is damaged, or another program's")),
    }
}

fn not_a_store(root: &Path, why: &'static str) -> Error {
    Error::NotAStore { folder: root.to_owned(), why }
}

//! Is the folder a store, and how much does it hold?

use std::{fs, path::Path};

use super::Finding;
use crate::{
    cli::out,
    store::{Error, LocalStore, ResultStore as _},
};

/// Looks at the store. `None` where there is none that can be opened.
pub(super) fn look(root: &Path, findings: &mut Vec<Finding>) -> Option<LocalStore> {
    let shown = root.display();
    let store = match LocalStore::open_to_read(root) {
        Ok(store) => store,
        Err(error) => {
            let help = match &error {
                Error::Busy(_) => "wait until the other process ends",
                Error::NotAStore { .. } | Error::OtherFormat { .. } => "give another folder with `--artifacts`",
                Error::Unusable { .. } | Error::Io { .. } => "look at the rights of the folder",
            };
            findings.push(Finding::problem("store", format!("{:#}", anyhow::Error::from(error)), help));
            return None;
        }
    };
    if !root.join("store.json").exists() {
        let text = format!("there is none in {shown} yet");
        findings.push(Finding::warning("store", text, "`carl-pipe run PIPELINE` makes it"));
        return None;
    }
    let inventory = store.inventory();
    let size = |path| fs::symlink_metadata(path).map_or(0, |meta| meta.len());
    let bytes: u64 = inventory.objects.iter().filter_map(|object| store.path_of(*object)).map(size).sum();
    let (results, objects, bytes) = (inventory.keys.len(), inventory.objects.len(), out::bytes(bytes));
    findings.push(Finding::ok("store", format!("{shown} has {results} results in {objects} files, {bytes}")));
    for (folder, why) in inventory.unlisted {
        let text = format!("cannot read {}: {}", folder.display(), out::tidy(&why.to_string()));
        findings.push(Finding::problem("store", text, "look at the rights of the folder"));
    }
    bad(root, findings);
    Some(store)
}

/// Damaged files that were set aside.
fn bad(root: &Path, findings: &mut Vec<Finding>) {
    let count = fs::read_dir(root.join("bad")).map_or(0, Iterator::count);
    if count > 0 {
        let text = format!("{count} damaged files were set aside in {}", root.join("bad").display());
        let help = "`carl-pipe verify` says whether something is missing; `carl-pipe gc` removes these files";
        findings.push(Finding::warning("store", text, help));
    }
}

//! A finished node of a run that a user names, and its files.

use super::{
    Global,
    exit::{Error, Exit},
};
use crate::{
    diag::nearest,
    node_name::without_member,
    report::outcomes::is_done,
    run::{manifest::Manifest, node::NodeRecord},
    store::{Files, ResultStore},
};

/// The node with this name, or the last finished node of the stage with this name.
pub(super) fn finished<'a>(manifest: &'a Manifest, name: &str) -> Result<&'a NodeRecord, Error> {
    let is_of_stage = |node: &&NodeRecord| node.about.stage == name || without_member(&node.about.stage) == name;
    let named =
        manifest.node(name).or_else(|| manifest.nodes.iter().rev().filter(|node| is_done(node)).find(is_of_stage));
    let Some(node) = named else {
        let error = Error::usage(format!("run {} has no finished node `{name}`", manifest.run));
        let names = manifest.nodes.iter().flat_map(|node| [node.about.name.as_str(), node.about.stage.as_str()]);
        return Err(match nearest(name, names) {
            Some(name) => error.help(format!("did you mean `{name}`?")),
            None => error.help(format!("`carl-pipe show {}` lists its nodes", manifest.run)),
        });
    };
    if !is_done(node) {
        return Err(Error::usage(format!("`{name}` of run {} has no result", manifest.run)));
    }
    Ok(node)
}

/// The verified files of a node.
pub(super) fn files(global: &Global, node: &NodeRecord) -> Result<Files, Error> {
    let store = global.store_to_read()?;
    let unreadable = |why: &str| {
        Error::new(Exit::Store, format!("cannot read the output of `{}`: {why}", node.about.name))
            .help("run the pipeline again; only what is missing runs")
    };
    let entry = node.outcome.key.map_or(Ok(None), |key| store.entry(key))?;
    let entry =
        entry.filter(|entry| Some(entry.output) == node.outcome.output).ok_or_else(|| unreadable("it is gone"))?;
    store.load(&entry).map_err(|error| unreadable(&error.to_string()))
}

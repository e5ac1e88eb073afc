//! A suite: several pipelines as one graph, each with seeds, values and labels of its own.
//!
//! Every node's name begins with its member, and nodes with equal keys run once. A mistake is shown where it was
//! written: in the suite, in the file of a member, or in the file that a member extends.

mod known_paths;
mod parsed;

use super::{
    extends::{Document, extended},
    files::{Beside, File, Files},
    single::{Additions, graph_of},
};
use crate::{
    diag::{Diagnostic, Span},
    pipeline::{
        graph::node::{Graph, Member},
        limits::MAX_NODES,
        syntax::{
            arguments::{Argument, Overrides},
            document::document,
            path::PathValue,
            tree::{Key, Table},
        },
    },
    stage::Kind,
};
use known_paths::{KnownPaths, no_such_stage, of_member, unmatched};
use parsed::{ParsedMember, ParsedSuite};

/// A member with its file.
struct Loaded<'a> {
    parsed: &'a ParsedMember,
    file: File,
    document: Document,
}

/// Loads the members of a suite and joins their graphs.
pub(super) fn load(
    table: Table,
    file: &File,
    overrides: &Overrides,
    kinds: &'static [Kind],
    files: &mut Files<'_>,
    mut mistakes: Vec<Diagnostic>,
) -> Result<Graph, Vec<Diagnostic>> {
    let suite = parsed::suite(table, &file.start(), &mut mistakes);
    let arguments = Argument::all(overrides, &mut files.sources);
    let members: Vec<Option<Loaded<'_>>> =
        suite.members.iter().map(|parsed| loaded(parsed, files, &mut mistakes)).collect();
    let known: Vec<KnownPaths> =
        members.iter().map(|member| KnownPaths::of(member.as_ref().map(|it| &it.document.table))).collect();
    check_paths(&suite, &arguments, &known, &mut mistakes);
    let names: Vec<&str> = suite.members.iter().map(|member| member.name.as_str()).collect();
    let mut graph = Graph { name: suite.name.clone(), description: suite.description.clone(), ..Graph::default() };
    for (member, known) in members.into_iter().zip(&known) {
        let Some(Loaded { parsed, file, document }) = member else { continue };
        let own: Vec<Argument> =
            arguments.iter().filter_map(|one| of_member(one, &parsed.name, &names, known)).collect();
        let additions = additions(parsed, &suite.set, &own, known);
        let outside = Beside { file: &file, outside: files.outside };
        match graph_of(document, additions, &own, &files.sources, (kinds, &outside), Vec::new()) {
            Ok(loaded) => join(&mut graph, &parsed.name, &file, loaded),
            Err(wrong) => mistakes.extend(wrong),
        }
    }
    if graph.nodes.len() > MAX_NODES {
        let count = graph.nodes.len();
        let message = format!("the suite has too many nodes: {count}, where {MAX_NODES} are allowed");
        mistakes.push(Diagnostic::general(message));
    }
    if mistakes.is_empty() { Ok(graph) } else { Err(mistakes) }
}

/// Reads a member's file and its base.
fn loaded<'a>(parsed: &'a ParsedMember, files: &mut Files<'_>, mistakes: &mut Vec<Diagnostic>) -> Option<Loaded<'a>> {
    let Key { text: path, span } = parsed.pipeline.as_ref()?;
    let read = files.read(path);
    let read = read.map_err(|why| mistakes.push(Diagnostic::at(span.clone(), format!("cannot read `{path}`: {why}"))));
    let file = read.ok()?;
    let table = document(&file.bytes, file.base, mistakes)?;
    if table.contains("suite") {
        let mistake = Diagnostic::at(span.clone(), format!("`{}` is a suite itself", file.path));
        mistakes.push(mistake.help("name its pipelines here"));
        return None;
    }
    let document = extended(table, &file, files, mistakes)?;
    Some(Loaded { parsed, file, document })
}

/// Refuses paths of arguments and of `set` that concern no member.
fn check_paths(suite: &ParsedSuite, arguments: &[Argument], known: &[KnownPaths], mistakes: &mut Vec<Diagnostic>) {
    let names: Vec<&str> = suite.members.iter().map(|member| member.name.as_str()).collect();
    mistakes.extend(arguments.iter().filter_map(|argument| unmatched(argument, &names, known)));
    let concerns_none = |value: &&PathValue| !known.iter().any(|known| known.has(&value.name()));
    let head = |value: &PathValue| -> (Span, String) { (value.keys[0].span.clone(), value.keys[0].text.clone()) };
    for (span, name) in suite.set.iter().filter(concerns_none).map(head) {
        mistakes.push(no_such_stage(span, &name, &[], known));
    }
}

/// What the suite adds to a member. What a member sets itself comes after what the suite sets for all, and arguments
/// replace both.
fn additions(member: &ParsedMember, shared: &[PathValue], arguments: &[Argument], known: &KnownPaths) -> Additions {
    let shared = shared.iter().filter(|value| known.has(&value.name()));
    let shared = shared.filter(|value| member.set.iter().all(|own| own.name() != value.name()));
    let is_swept = |value: &&PathValue| arguments.iter().any(|one| one.is_sweep && one.path() == value.name());
    let set = shared.chain(&member.set).filter(|value| !is_swept(value)).cloned().collect();
    let seeds = member.seeds.clone().filter(|_| arguments.iter().all(|argument| argument.path() != "seed"));
    Additions { seeds, set, labels: member.labels.clone() }
}

/// Appends a member's graph.
fn join(graph: &mut Graph, name: &str, file: &File, loaded: Graph) {
    let (offset, number) = (graph.nodes.len(), graph.members.len());
    graph.members.extend(loaded.members.into_iter().map(|member| Member {
        name: name.to_owned(),
        file: file.path.clone(),
        text: file.text(),
        ..member
    }));
    graph.nodes.extend(loaded.nodes.into_iter().map(|mut node| {
        node.name = format!("{name}/{}", node.name);
        node.stage = format!("{name}/{}", node.stage);
        node.member = number;
        node.inputs.iter_mut().flat_map(|(_, sources)| sources).for_each(|source| *source += offset);
        node
    }));
}

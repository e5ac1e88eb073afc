//! A suite: several pipelines as one graph, each with seeds, values and labels of its own.
//!
//! Every node stands behind its member's name, and nodes with equal keys run once. Mistakes stand where they were
//! written, in the suite or in the file of a member, all of them at once.

use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use super::{
    Addition, Graph, Member, Overrides, Reader, graph_of, matrix,
    overrides::{Argument, Sweep},
    parse::{check_name, check_schema, document, table_of, text_of, typed},
    tree::{Key, Tree, refuse_infinite_in, shifted},
    wording::{instead, what},
};
use crate::{
    diag::{Diagnostic, Diagnostics, Sources, Span},
    stage::Kind,
};

/// What a suite may hold at its top level.
const KEYS: [&str; 6] = ["schema", "name", "description", "seeds", "set", "suite"];
/// What a `[suite.name]` may hold.
const MEMBER_KEYS: [&str; 4] = ["pipeline", "seeds", "set", "labels"];

/// One `[suite.name]`, with places in the text of the suite.
#[derive(Debug)]
struct MemberDraft<'i> {
    name: String,
    pipeline: Option<(String, Span)>,
    seeds: Option<(Key<'i>, Tree<'i>)>,
    set: Assigned<'i>,
    labels: DeTable<'i>,
}

/// What a `set` sets: the keys of each path, and its value.
type Assigned<'i> = Vec<(Vec<Key<'i>>, Tree<'i>)>;

fn path_of(keys: &[Key<'_>]) -> String {
    keys.iter().map(|key| key.get_ref().as_ref()).collect::<Vec<&str>>().join(".")
}

/// What the top level of a suite says.
#[derive(Debug)]
struct Top<'i> {
    name: String,
    description: String,
    /// For all members that have the stage.
    set: Assigned<'i>,
    drafts: Vec<MemberDraft<'i>>,
}

/// A member's file, read.
struct MemberFile {
    shown: String,
    bytes: Vec<u8>,
}

/// Loads the members of a suite and joins their graphs.
pub(super) fn load(
    mut table: DeTable<'_>,
    sources: &Sources,
    path: &str,
    overrides: &Overrides,
    kinds: &'static [Kind],
    read: Reader<'_>,
) -> Result<Graph, Diagnostics> {
    let mut mistakes = Vec::new();
    let Top { name, description, set, drafts } = top_level(&mut table, &mut mistakes);
    let files: Vec<_> = drafts.iter().map(|draft| file_of(draft, read, &mut mistakes)).collect();
    let stages: Vec<Heads> = files.iter().map(|file| Heads::of(file.as_ref())).collect();
    let names: Vec<&str> = drafts.iter().map(|draft| draft.name.as_str()).collect();
    mistakes.extend(sources.texts().skip(1).filter_map(|it| nobodys(&Argument::read(it), &names, &stages)));
    let unreached = set.iter().filter(|(keys, _)| !stages.iter().any(|heads| heads.has(&path_of(keys))));
    mistakes.extend(unreached.map(|(keys, _)| no_such_stage(keys[0].span(), keys[0].get_ref(), &[], &stages)));
    let suite_text = sources.texts().next().map_or("", |(_, text)| text);
    let mut graph = Graph { name, description, members: Vec::new(), nodes: Vec::new() };
    let mut wrong = Vec::new();
    for ((draft, file), heads) in drafts.iter().zip(files).zip(&stages) {
        let Some(file) = file else { continue };
        let around = Around { suite: (path, suite_text), set: &set, overrides, names: &names, heads };
        match member(draft, &file, &around, kinds) {
            Ok(loaded) => join(&mut graph, draft, file, loaded),
            Err(mistakes) => wrong.push(mistakes),
        }
    }
    if graph.nodes.len() > matrix::MAX_NODES {
        let most = matrix::MAX_NODES;
        mistakes.push(Diagnostic::general(format!(
            "the suite has too many nodes: {}, where {most} are allowed",
            graph.nodes.len()
        )));
    }
    if mistakes.is_empty() && wrong.is_empty() {
        return Ok(graph);
    }
    wrong.insert(0, Diagnostics::new(sources.clone(), mistakes));
    Err(Diagnostics::join(wrong))
}

fn file_of(draft: &MemberDraft<'_>, read: Reader<'_>, mistakes: &mut Vec<Diagnostic>) -> Option<MemberFile> {
    let (pipeline, span) = draft.pipeline.as_ref()?;
    match read(pipeline) {
        Ok((shown, bytes)) => Some(MemberFile { shown, bytes }),
        Err(why) => {
            mistakes.push(Diagnostic::at(span.clone(), format!("cannot read `{pipeline}`: {why}")));
            None
        }
    }
}

/// Reads the top level: name, description, and the members with their own seeds or those of the suite.
fn top_level<'i>(table: &mut DeTable<'i>, mistakes: &mut Vec<Diagnostic>) -> Top<'i> {
    refuse_infinite_in(table, mistakes);
    for key in table.keys().filter(|key| !KEYS.contains(&key.get_ref().as_ref())) {
        let mistake = Diagnostic::at(key.span(), format!("a suite has no `{}`", key.get_ref()));
        mistakes.push(match key.get_ref().as_ref() {
            "stages" | "loop" | "task" | "matrix" | "preset" => mistake.help("write it in the file of a pipeline"),
            "seed" => mistake.help("write `seeds = \"0..5\"`"),
            name => mistake.help(instead(name, "a suite has", KEYS)),
        });
    }
    check_schema(table.remove("schema"), mistakes);
    let name = text_of(table.remove("name"), "name", mistakes);
    if let Some((name, span)) = &name {
        check_name(name, span, "suite", mistakes);
    }
    let description = text_of(table.remove("description"), "description", mistakes);
    let seeds = table.remove_entry("seeds");
    let set = assigned(table.remove("set"), mistakes);
    let members = table_of(table.remove("suite"), "suite", mistakes).map(|(table, _)| table).unwrap_or_default();
    if members.is_empty() {
        let mistake = Diagnostic::at(0..0, "the suite has no pipelines");
        mistakes.push(mistake.help("write `[suite.name]` with `pipeline = \"file.toml\"`"));
    }
    let mut drafts = Vec::new();
    for (key, value) in members {
        check_name(key.get_ref(), &key.span(), "member of a suite", mistakes);
        if let Some((table, _)) = table_of(Some(value), key.get_ref(), mistakes) {
            drafts.push(member_draft(&key, table, seeds.as_ref(), mistakes));
        }
    }
    Top { name: name.unwrap_or_default().0, description: description.unwrap_or_default().0, set, drafts }
}

fn assigned<'i>(set: Option<Tree<'i>>, mistakes: &mut Vec<Diagnostic>) -> Assigned<'i> {
    let mut flat = Vec::new();
    let table = table_of(set, "set", mistakes).map(|(table, _)| table).unwrap_or_default();
    matrix::flatten(&[], table, &mut flat);
    flat
}

fn member_draft<'i>(
    key: &Key<'i>,
    mut table: DeTable<'i>,
    seeds: Option<&(Key<'i>, Tree<'i>)>,
    mistakes: &mut Vec<Diagnostic>,
) -> MemberDraft<'i> {
    for key in table.keys().filter(|key| !MEMBER_KEYS.contains(&key.get_ref().as_ref())) {
        let name = key.get_ref().as_ref();
        let mistake = Diagnostic::at(key.span(), format!("a member of a suite has no `{name}`"));
        mistakes.push(mistake.help(instead(name, "a member has", MEMBER_KEYS)));
    }
    let pipeline = table.remove("pipeline");
    if pipeline.is_none() {
        let mistake = Diagnostic::at(key.span(), format!("`{}` names no pipeline", key.get_ref()));
        mistakes.push(mistake.help("write `pipeline = \"file.toml\"`, a path from the folder of the suite"));
    }
    let span = pipeline.as_ref().map_or(0..0, Spanned::span);
    let set = assigned(table.remove("set"), mistakes);
    let labels = table_of(table.remove("labels"), "labels", mistakes).map(|(it, _)| it).unwrap_or_default();
    MemberDraft {
        name: key.get_ref().to_string(),
        pipeline: typed::<String>(pipeline, "pipeline", mistakes).map(|path| (path, span)),
        seeds: table.remove_entry("seeds").or_else(|| seeds.cloned()),
        set,
        labels,
    }
}

/// What a path of `-S` may begin with in a member.
#[derive(Debug, Default)]
struct Heads {
    stages: Vec<String>,
    has_loop: bool,
    /// The file cannot be read, which is reported.
    is_unknown: bool,
}

impl Heads {
    fn of(file: Option<&MemberFile>) -> Self {
        let text = file.map(|file| String::from_utf8_lossy(&file.bytes));
        let Some(table) = text.as_ref().and_then(|text| DeTable::parse(text).ok()) else {
            return Self { is_unknown: true, ..Self::default() };
        };
        let stages = table.get_ref().get("stages").and_then(|stages| stages.get_ref().as_table());
        let stages = stages.map_or_else(Vec::new, |table| table.keys().map(|key| key.get_ref().to_string()).collect());
        Self { stages, has_loop: table.get_ref().contains_key("loop"), is_unknown: false }
    }

    fn has(&self, path: &str) -> bool {
        let head = path.split('.').next().unwrap_or_default();
        let is_stage = self.stages.iter().any(|stage| stage == head);
        is_stage
            || self.is_unknown
            || matches!(head, "seed" | "preset" | "task")
            || (self.has_loop && matches!(head, "rounds" | "loop"))
    }
}

/// The member that an argument names before its path, and what it says there.
fn named<'a, 'i>(argument: &Argument<'i>, names: &[&'a str]) -> Option<(&'a str, Argument<'i>)> {
    let (head, rest) = argument.assignment.split_once(['.', '/'])?;
    let name = names.iter().find(|name| **name == head)?;
    Some((name, Argument { assignment: rest, base: argument.base + head.len() + 1, ..*argument }))
}

/// The mistake of an argument that concerns no member.
fn nobodys(argument: &Argument<'_>, names: &[&str], all: &[Heads]) -> Option<Diagnostic> {
    let path = argument.path();
    // What is no assignment at all is reported by whoever reads it.
    let is_malformed = path.is_empty() || !argument.assignment.contains('=');
    if is_malformed || named(argument, names).is_some() || all.iter().any(|heads| heads.has(path)) {
        return None;
    }
    let head = path.split('.').next().unwrap_or_default();
    let at = argument.base + (argument.assignment.len() - argument.assignment.trim_start().len());
    Some(no_such_stage(at..at + head.len(), head, names, all))
}

fn no_such_stage(span: Span, head: &str, names: &[&str], all: &[Heads]) -> Diagnostic {
    let stages = all.iter().flat_map(|heads| heads.stages.iter().map(String::as_str));
    let mut known: Vec<&str> = stages.chain(names.iter().copied()).chain(["seed", "preset", "task"]).collect();
    known.sort_unstable();
    known.dedup();
    let mistake = Diagnostic::at(span, format!("no pipeline of the suite has a stage `{head}`"));
    mistake.help(instead(head, "a path begins with one of", known))
}

/// What a member is loaded with.
struct Around<'a> {
    suite: (&'a str, &'a str),
    set: &'a Assigned<'a>,
    overrides: &'a Overrides,
    names: &'a [&'a str],
    heads: &'a Heads,
}

fn member(
    draft: &MemberDraft<'_>,
    file: &MemberFile,
    around: &Around<'_>,
    kinds: &'static [Kind],
) -> Result<Graph, Diagnostics> {
    let mut sources = Sources::default();
    sources.add(&file.shown, String::from_utf8_lossy(&file.bytes));
    let base = sources.add(around.suite.0, around.suite.1);
    for argument in around.overrides.shown() {
        sources.add("<command line>", argument);
    }
    let loaded = document(&file.bytes, &sources).and_then(|document| {
        if document.contains_key("suite") {
            let span = draft.pipeline.as_ref().map_or(0..0, |(_, span)| span.start + base..span.end + base);
            let mistake = Diagnostic::at(span, format!("`{}` is a suite itself", file.shown));
            return Err(vec![mistake.help("name its pipelines here")]);
        }
        let arguments: Vec<Argument<'_>> = sources.texts().skip(2).filter_map(|it| own(it, draft, around)).collect();
        graph_of(document, &sources, &arguments, addition(draft, around, base, &arguments), kinds)
    });
    loaded.map_err(|mistakes| Diagnostics::new(sources, mistakes))
}

/// An argument as it concerns a member.
fn own<'i>(text: (usize, &'i str), draft: &MemberDraft<'_>, around: &Around<'_>) -> Option<Argument<'i>> {
    let argument = Argument::read(text);
    match named(&argument, around.names) {
        Some((name, rest)) => (name == draft.name).then_some(rest),
        None if !argument.assignment.contains('=') || argument.path().is_empty() => Some(argument),
        None => around.heads.has(argument.path()).then_some(argument),
    }
}

/// What the suite says, with its places moved to where its text lies among the member's sources.
fn addition<'i>(draft: &MemberDraft<'i>, around: &Around<'i>, base: usize, arguments: &[Argument<'_>]) -> Addition<'i> {
    let place = |keys: &[Key<'i>], value: &Tree<'i>| {
        let key = |key: &Key<'i>| Spanned::new(key.span().start + base..key.span().end + base, key.get_ref().clone());
        (keys.iter().map(key).collect::<Vec<_>>(), shifted(value.clone(), base))
    };
    // What a member sets itself, it sets last.
    let shared = around.set.iter().filter(|(keys, _)| around.heads.has(&path_of(keys)));
    let shared = shared.filter(|(keys, _)| draft.set.iter().all(|(own, _)| path_of(own) != path_of(keys)));
    let mut set: Vec<_> = shared.chain(&draft.set).map(|(keys, value)| place(keys, value)).collect();
    // Axes of the command line win: what they vary is not set.
    set.retain(|(keys, _)| !arguments.iter().any(|argument| argument.is_sweep && argument.path() == path_of(keys)));
    let labels = shifted(Spanned::new(0..0, DeValue::Table(draft.labels.clone())), base);
    let labels = match labels.into_inner() {
        DeValue::Table(table) => table,
        other => unreachable!("a table became {}", what(&other)),
    };
    // Seeds of the command line replace those of the suite.
    let seeds = draft.seeds.as_ref().filter(|_| arguments.iter().all(|argument| argument.path() != "seed"));
    let seeds = seeds.map(|(key, values)| {
        let span = key.span();
        let axis = Spanned::new(span.start + base..span.end + base, "seed".into());
        Sweep { axis, values: shifted(values.clone(), base) }
    });
    Addition { seeds, set, labels }
}

/// Appends a member's graph.
fn join(graph: &mut Graph, draft: &MemberDraft<'_>, file: MemberFile, loaded: Graph) {
    let (offset, number) = (graph.nodes.len(), graph.members.len());
    graph.members.extend(loaded.members.into_iter().map(|member| Member {
        name: draft.name.clone(),
        file: file.shown.clone(),
        text: String::from_utf8_lossy(&file.bytes).into_owned(),
        ..member
    }));
    graph.nodes.extend(loaded.nodes.into_iter().map(|mut node| {
        node.name = format!("{}/{}", draft.name, node.name);
        node.stage = format!("{}/{}", draft.name, node.stage);
        node.member = number;
        node.inputs.iter_mut().flat_map(|(_, sources)| sources).for_each(|source| *source += offset);
        node
    }));
}

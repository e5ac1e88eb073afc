//! The documents say what is true: every link leads somewhere, every named item exists, every metric is explained.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

/// The longest decision, in words.
const DECISION_WORDS: usize = 250;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All files below a folder whose names end with `.EXTENSION`, in order.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())) {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path, extension));
        } else if path.extension().is_some_and(|it| it == extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Every document of the project.
fn documents() -> Vec<PathBuf> {
    let top = fs::read_dir(root()).unwrap().map(|entry| entry.unwrap().path());
    let mut found: Vec<PathBuf> = top.filter(|path| path.extension().is_some_and(|it| it == "md")).collect();
    for folder in ["docs", "artifacts", "benches/peers"] {
        found.extend(files(&root().join(folder), "md").into_iter().filter(|path| !path.ends_with("target")));
    }
    found
}

#[test]
fn every_link_leads_to_a_file() {
    let mut broken = Vec::new();
    for document in documents() {
        let text = read(&document);
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let path = link.split('#').next().unwrap_or_default();
            let is_elsewhere = link.contains("://") || link.starts_with("mailto:") || path.is_empty();
            if !is_elsewhere && !document.parent().unwrap().join(path).exists() {
                broken.push(format!("{}: {link}", document.display()));
            }
        }
    }
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}

#[test]
fn every_decision_is_short() {
    for path in files(&root().join("docs/decisions"), "md") {
        let words = read(&path).split_whitespace().filter(|word| word.chars().any(char::is_alphanumeric)).count();
        let is_index = path.ends_with("README.md");
        assert!(is_index || words <= DECISION_WORDS, "{}: {words} words", path.display());
    }
}

/// The texts between backticks of a line of prose or a table.
fn code_spans(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter(|line| !line.starts_with("```")).flat_map(|line| line.split('`').skip(1).step_by(2))
}

/// `a::{b, c::d}` as `a::b` and `a::c::d`.
fn expanded(item: &str) -> Vec<String> {
    match item.split_once("::{") {
        Some((head, list)) => list.trim_end_matches('}').split(", ").map(|tail| format!("{head}::{tail}")).collect(),
        None => vec![item.to_owned()],
    }
}

/// Whether a file defines a name: an item, a field or a variant.
fn defines(text: &str, name: &str) -> bool {
    let is_end = |rest: &str| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_');
    let words = ["fn ", "struct ", "enum ", "trait ", "type ", "const ", "static ", "mod ", "macro_rules! "];
    words
        .iter()
        .any(|word| text.match_indices(&format!("{word}{name}")).any(|(at, found)| is_end(&text[at + found.len()..])))
        || text.lines().map(|line| line.trim().trim_start_matches("pub ").trim_start_matches("pub(super) ")).any(
            |line| {
                line.strip_prefix(name).is_some_and(|rest| {
                    rest.starts_with(':') || rest.starts_with(',') || rest.starts_with(" {") || rest.starts_with('(')
                })
            },
        )
}

/// The files of a module, and the names that remain of a path; none where its first part is no module.
fn module(path: &str) -> Option<(Vec<PathBuf>, Vec<&str>)> {
    let mut parts: Vec<&str> = path.split("::").collect();
    let mut place = root().join("src");
    let mut depth = 0;
    while depth < parts.len() {
        let next = place.join(parts[depth]);
        if !next.is_dir() && !next.with_extension("rs").is_file() {
            break;
        }
        (place, depth) = (next, depth + 1);
    }
    if depth == 0 {
        return None;
    }
    let mut found = if place.is_dir() { files(&place, "rs") } else { Vec::new() };
    found.extend(Some(place.with_extension("rs")).filter(|file| file.is_file()));
    Some((found, parts.split_off(depth)))
}

/// The items that a text names, each with whether it exists; none for a path whose first part is no module.
fn items(text: &str) -> impl Iterator<Item = (String, Option<bool>)> {
    let is_item =
        |span: &&str| span.contains("::") && span.chars().all(|c| c.is_alphanumeric() || "_:{}, ".contains(c));
    let items = code_spans(text).filter(is_item);
    items.flat_map(expanded).map(|item| {
        let exists = module(&item).map(|(files, names)| {
            let texts: Vec<String> = files.iter().map(|file| read(file)).collect();
            names.iter().all(|name| texts.iter().any(|text| defines(text, name)))
        });
        (item, exists)
    })
}

#[test]
fn every_item_that_the_paper_map_names_exists() {
    let text = read(&root().join("docs/paper-map.md"));
    let (found, missing): (Vec<_>, Vec<_>) = items(&text).partition(|(_, exists)| *exists == Some(true));
    assert!(found.len() > 40, "the map names only {} items", found.len());
    assert!(missing.is_empty(), "{missing:#?}");
}

#[test]
fn every_item_that_another_document_names_exists() {
    let mut missing = Vec::new();
    for document in documents().iter().filter(|path| !path.ends_with("CHANGELOG.md")) {
        let text = read(document);
        let wrong = items(&text).filter(|(_, exists)| *exists == Some(false)).map(|(item, _)| item);
        missing.extend(wrong.map(|item| format!("{}: {item}", document.display())));
    }
    assert!(missing.is_empty(), "\n{}", missing.join("\n"));
}

#[test]
fn every_pipeline_that_a_document_names_exists() {
    let shipped: BTreeSet<String> = files(&root().join("pipelines"), "toml")
        .iter()
        .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    let mut missing = Vec::new();
    for document in documents() {
        for word in read(&document).split(|c: char| !(c.is_alphanumeric() || "_/.".contains(c))) {
            let Some(name) = word.strip_prefix("pipelines/").filter(|name| name.ends_with(".toml")) else { continue };
            if !shipped.contains(name) && !["TASK_ALGORITHM.toml", "NAME.toml"].contains(&name) {
                missing.push(format!("{}: {word}", document.display()));
            }
        }
    }
    assert!(missing.is_empty(), "\n{}", missing.join("\n"));
}

/// The names of what a stage records: the first string of each pair of a curve, and the names of key metrics.
fn recorded() -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for path in files(&root().join("src/stage"), "rs") {
        let text = read(&path);
        for part in text.split("metric(\"").skip(1) {
            names.insert(part.split('"').next().unwrap().to_owned());
        }
        for part in text.split("(\"").skip(1) {
            let (name, rest) = part.split_once('"').unwrap();
            let is_curve = ["terms.", "spread.", "weights.", "percent", "policy_alone", "kl", "effective", "mean"];
            if rest.strip_prefix(", ").is_some_and(|value| is_curve.iter().any(|it| value.starts_with(it))) {
                names.insert(name.to_owned());
            }
        }
    }
    names
}

#[test]
fn every_recorded_metric_is_explained() {
    let text = read(&root().join("docs/metrics.md"));
    let explained: BTreeSet<&str> = code_spans(&text).collect();
    let names = recorded();
    assert!(names.len() > 30, "only {} names were found: {names:?}", names.len());
    let missing: Vec<&String> = names.iter().filter(|name| !explained.contains(name.as_str())).collect();
    assert!(missing.is_empty(), "docs/metrics.md does not explain {missing:?}");
}

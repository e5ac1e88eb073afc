//! Who may use whom, read off the sources: the table below is the architecture, and ARCHITECTURE.md explains it.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

/// A layer, what it may use, and why where that is not plain.
const TABLE: &[(&str, &[(&str, &str)])] = &[
    ("digest", &[]),
    ("failpoint", &[]),
    ("store", &[("digest", "keys and contents"), ("failpoint", "faults that tests want")]),
    ("node_name", &[]),
    ("program", &[]),
    ("diag", &[]),
    ("record", &[("failpoint", "faults that tests want")]),
    ("num", &[]),
    ("nn", &[("num", "random weights, portable math, vectors, threads")]),
    ("child", &[]),
    ("python", &[("child", "an interpreter that is asked")]),
    (
        "env",
        &[
            ("num", "random starts, goals and noise; portable math"),
            ("child", "an environment in another process"),
            ("python", "the versions of its packages"),
            ("digest", "the content of its program"),
        ],
    ),
    ("lce", &[("num", "random weights and noise"), ("nn", "networks")]),
    (
        "solar",
        &[
            ("num", "random weights and noise, vectors"),
            ("nn", "optimisers, binary images"),
            ("lce", "encoder and decoder"),
        ],
    ),
    (
        "control",
        &[
            ("num", "random actions, batches and episodes"),
            ("nn", "networks"),
            ("lce", "policies act on codes, and SAC rolls the learned dynamics out"),
            ("solar", "a policy of SOLAR's controller"),
            ("env", "simulators for `episodes` and `oracle`, and only there"),
        ],
    ),
    (
        "artifact",
        &[
            ("store", "the files of an artifact"),
            ("num", "a summary holds statistics"),
            ("nn", "optimisers and arenas lie on disk"),
            ("lce", "a model is an artifact"),
            ("solar", "models and controllers of SOLAR are artifacts"),
            ("control", "agents and settings of iLQR are artifacts, and an evaluation names its rule"),
            ("env", "an evaluation names its starts"),
        ],
    ),
    ("arrays", &[("artifact", "safetensors files"), ("store", "what a file holds")]),
    ("onnx", &[("nn", "layers and patches"), ("lce", "the encoder"), ("control", "the actor")]),
    (
        "stage",
        &[
            ("arrays", "data of other programs"),
            ("diag", "the symmetry that was probably meant"),
            ("digest", "the content of files that parameters name"),
            ("program", "a user's own program as a stage"),
            ("store", "outputs that lie in files"),
            ("artifact", "what goes in and comes out"),
            ("lce", "training of the representation"),
            ("solar", "training and control of SOLAR"),
            ("control", "training and running of policies"),
            ("env", "data, evaluation and the map probe"),
            ("nn", "optimisers and noise"),
            ("num", "named streams, statistics, threads"),
            ("record", "curves, pictures and maps"),
        ],
    ),
    (
        "pipeline",
        &[
            ("diag", "mistakes with their place"),
            ("digest", "the content of files that a node names"),
            ("env", "the `[task]` table"),
            ("num", "a node's stream and platform"),
            ("node_name", "names of nodes"),
            ("stage", "kinds: their ports, parameters and presets"),
        ],
    ),
    (
        "run",
        &[
            ("pipeline", "the graph"),
            ("stage", "what a node does"),
            ("store", "keys and what nodes made"),
            ("digest", "keys and contents"),
            ("node_name", "names of nodes"),
            ("record", "a node's recording"),
            ("failpoint", "faults that tests want"),
            ("num", "a node's stream, its platform and its share of the cores"),
            ("env", "a manifest holds the task"),
        ],
    ),
    (
        "report",
        &[
            ("run", "manifests"),
            ("store", "metrics within artifacts"),
            ("pipeline", "members and their labels"),
            ("stage", "headline metrics of kinds"),
            ("artifact", "latent maps"),
            ("env", "ceilings of tasks"),
            ("num", "statistics"),
            ("digest", "recipes"),
            ("node_name", "stages of nodes"),
        ],
    ),
    (
        "cli",
        &[
            ("arrays", ""),
            ("onnx", ""),
            ("python", "the versions of packages"),
            ("report", ""),
            ("run", ""),
            ("store", ""),
            ("pipeline", ""),
            ("stage", ""),
            ("artifact", ""),
            ("control", ""),
            ("lce", ""),
            ("env", ""),
            ("record", ""),
            ("nn", ""),
            ("num", ""),
            ("digest", ""),
            ("node_name", ""),
            ("diag", ""),
        ],
    ),
];

/// What learns: it gets pictures, actions and codes, and a true state cannot reach it.
const LEARNING: &[&str] = &[
    "lce",
    "solar",
    "control",
    "artifact/transitions.rs",
    "artifact/trajectories.rs",
    "artifact/solar.rs",
    "artifact/lce_model.rs",
    "artifact/agent.rs",
    "nn",
];

/// What moves the world, among files that learn.
const ACTING: &[&str] = &["control/episodes.rs", "control/oracle.rs"];

/// Declares what a policy sees. It names the true state, which only files of [`ACTING`] read.
const CONTRACT: &str = "control/policy.rs";

/// What holds true states, or leads to them.
const HIDDEN: [&str; 8] =
    ["System", "Simulator", "Snapshot", "UnfinishedEpisode", "MapProbe", "LatentMap", "Evaluation", "Collected"];

/// Stages that learn. Of the task they may ask the widths of networks, and lay its defaults over their presets.
const LEARNING_STAGES: &[&str] = &[
    "stage/train_lce.rs",
    "stage/train_lce/attempt.rs",
    "stage/train_lce/checks.rs",
    "stage/train_lce/curves.rs",
    "stage/train_lce/new_model.rs",
    "stage/train_lce/objective.rs",
    "stage/train_lce/presets.rs",
    "stage/train_lce/state.rs",
    "stage/train_lce/steps.rs",
    "stage/train_lce/terms.rs",
    "stage/train_lce/params.rs",
    "stage/train_sac.rs",
    "stage/train_sac/state.rs",
    "stage/train_solar.rs",
    "stage/train_solar/params.rs",
    "stage/train_solar/state.rs",
    "stage/distill_policy.rs",
    "stage/distill_policy/state.rs",
];

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// All `.rs` files under a file or folder, in order.
fn files(under: &Path) -> Vec<PathBuf> {
    if under.is_file() {
        return vec![under.to_owned()];
    }
    let entries = fs::read_dir(under).unwrap_or_else(|error| panic!("{}: {error}", under.display()));
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let is_source = |path: &PathBuf| path.is_dir() || path.extension().is_some_and(|extension| extension == "rs");
    paths.into_iter().filter(is_source).flat_map(|path| files(&path)).collect()
}

/// The words and signs of a file, without comments and the insides of strings.
fn tokens(path: &Path) -> Vec<String> {
    let text = fs::read_to_string(path).unwrap();
    let mut chars = text.chars().peekable();
    let mut tokens = Vec::new();
    while let Some(c) = chars.next() {
        if c == '/' && chars.peek() == Some(&'/') {
            while chars.next_if(|&c| c != '\n').is_some() {}
        } else if c == '"' {
            while let Some(c) = chars.next_if(|&c| c != '"') {
                if c == '\\' {
                    chars.next();
                }
            }
            chars.next();
        } else if c == '\'' {
            // A character, or a lifetime, which reads as a word.
            let mut ahead = chars.clone();
            let first = ahead.next();
            if first == Some('\\') || ahead.next() == Some('\'') {
                let mut escaped = false;
                for c in chars.by_ref() {
                    if c == '\'' && !escaped {
                        break;
                    }
                    escaped = c == '\\' && !escaped;
                }
            }
        } else if c.is_alphanumeric() || c == '_' {
            let mut word = String::from(c);
            while let Some(c) = chars.next_if(|&c| c.is_alphanumeric() || c == '_') {
                word.push(c);
            }
            if matches!(word.as_str(), "r" | "br") && matches!(chars.peek(), Some('"' | '#')) {
                skip_raw_string(&mut chars);
            } else {
                tokens.push(word);
            }
        } else if !c.is_whitespace() {
            tokens.push(c.into());
        }
    }
    tokens
}

/// Goes past `#"…"#` with any number of hashes.
fn skip_raw_string(chars: &mut std::iter::Peekable<std::str::Chars<'_>>) {
    let mut hashes = 0;
    while chars.next_if_eq(&'#').is_some() {
        hashes += 1;
    }
    if chars.next_if_eq(&'"').is_none() {
        return; // a raw word such as `r#type`
    }
    loop {
        let Some(c) = chars.next() else { return };
        if c == '"' && (0..hashes).all(|_| chars.next_if_eq(&'#').is_some()) {
            return;
        }
    }
}

fn is(tokens: &[String], at: usize, want: &str) -> bool {
    tokens.get(at).is_some_and(|token| token == want)
}

fn is_path_sign(tokens: &[String], at: usize) -> bool {
    is(tokens, at, ":") && is(tokens, at + 1, ":")
}

/// The paths that begin at `at`, cut after two steps: `a::b`, or one for every member of a `{…}`.
fn paths(tokens: &[String], at: usize) -> (Vec<Vec<String>>, usize) {
    if is(tokens, at, "{") {
        let (mut found, mut at) = (Vec::new(), at + 1);
        while at < tokens.len() && !is(tokens, at, "}") {
            let (more, end) = paths(tokens, at);
            found.extend(more);
            // Past `as name` to the next member.
            at = end;
            while at < tokens.len() && !is(tokens, at, ",") && !is(tokens, at, "}") {
                at += 1;
            }
            at += usize::from(is(tokens, at, ","));
        }
        return (found, at + 1);
    }
    let word = tokens.get(at).cloned().unwrap_or_default();
    if is_path_sign(tokens, at + 1) {
        let (rest, end) = paths(tokens, at + 3);
        let join = |rest: Vec<String>| std::iter::once(word.clone()).chain(rest).take(2).collect();
        return (rest.into_iter().map(join).collect(), end);
    }
    (vec![vec![word]], at + 1)
}

/// What a file names after `crate::`.
fn uses(tokens: &[String]) -> Vec<Vec<String>> {
    (0..tokens.len())
        .filter(|&at| is(tokens, at, "crate") && is_path_sign(tokens, at + 1))
        .flat_map(|at| paths(tokens, at + 3).0)
        .collect()
}

/// The layer of a file, and its path for messages.
fn layer(path: &Path) -> (String, String) {
    let inside = path.strip_prefix(source()).unwrap();
    let first = inside.components().next().unwrap().as_os_str().to_string_lossy();
    (first.trim_end_matches(".rs").to_owned(), inside.display().to_string())
}

#[test]
fn every_use_is_in_the_table() {
    let table: BTreeMap<&str, BTreeSet<&str>> =
        TABLE.iter().map(|(layer, may)| (*layer, may.iter().map(|(other, _)| *other).collect())).collect();
    let mut wrong = Vec::new();
    for path in files(&source()) {
        let (layer, shown) = layer(&path);
        if layer == "main" || layer == "lib" {
            continue;
        }
        let Some(may) = table.get(layer.as_str()) else {
            wrong.push(format!("{shown}: layer `{layer}` is not in the table"));
            continue;
        };
        for used in uses(&tokens(&path)) {
            let other = used[0].as_str();
            if other != layer && !may.contains(other) {
                wrong.push(format!("{shown}: `{layer}` must not use `{}`", used.join("::")));
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn the_table_allows_nothing_that_is_not_used() {
    let mut used = BTreeSet::new();
    for path in files(&source()) {
        let (layer, _) = layer(&path);
        used.extend(uses(&tokens(&path)).into_iter().map(|path| (layer.clone(), path[0].clone())));
    }
    for (layer, may) in TABLE.iter().filter(|(layer, _)| *layer != "cli") {
        for (other, why) in *may {
            assert!(
                used.contains(&((*layer).to_owned(), (*other).to_owned())),
                "`{layer}` does not use `{other}`: {why}"
            );
        }
    }
}

#[test]
fn layers_have_no_circle() {
    let mut below: BTreeSet<&str> = BTreeSet::new();
    for (layer, may) in TABLE {
        for (other, _) in *may {
            assert!(below.contains(other), "`{layer}` uses `{other}`, which the table names later");
        }
        below.insert(layer);
    }
}

#[test]
fn no_path_climbs_out_of_its_layer_by_super() {
    for path in files(&source()) {
        let inside = path.strip_prefix(source()).unwrap();
        let mut depth = inside.components().count();
        depth -= usize::from(inside.ends_with("mod.rs") && depth > 1);
        let tokens = tokens(&path);
        // One more level inside `mod tests`.
        let tests = tokens.windows(2).position(|two| two[0] == "mod" && two[1] == "tests").unwrap_or(tokens.len());
        let mut at = 0;
        while at < tokens.len() {
            let mut chain = 0;
            while is(&tokens, at + 3 * chain, "super") && is_path_sign(&tokens, at + 3 * chain + 1) {
                chain += 1;
            }
            assert!(chain < depth + usize::from(at > tests), "{}: write `crate::` here", inside.display());
            at += 3 * chain + 1;
        }
    }
}

/// Whether a file names `word`; where `is_module`, only as a module, because a parameter has the same name.
fn names(tokens: &[String], word: &str, is_module: bool) -> bool {
    (0..tokens.len()).any(|at| is(tokens, at, word) && (!is_module || is_path_sign(tokens, at + 1)))
}

/// `control` may use environments, but what learns in it may not; nor may the rest of what learns.
#[test]
fn training_cannot_see_states() {
    for path in LEARNING.iter().flat_map(|path| files(&source().join(path))) {
        let (_, shown) = layer(&path);
        if ACTING.contains(&shown.as_str()) {
            continue;
        }
        let tokens = tokens(&path);
        for word in HIDDEN.iter().chain(&["env", "Task"]) {
            assert!(!names(&tokens, word, false), "{shown} names `{word}`");
        }
        assert!(!names(&tokens, "episodes", true), "{shown} names `episodes`");
        assert!(shown == "control/mod.rs" || !names(&tokens, "OraclePolicy", false), "{shown} names `OraclePolicy`");
        assert_eq!(shown == CONTRACT, names(&tokens, "true_state", false), "{shown}: only the contract names it");
    }
    for path in LEARNING_STAGES {
        let tokens = tokens(&source().join(path));
        for word in HIDDEN.iter().chain(&["system", "map_states", "OraclePolicy"]) {
            assert!(!names(&tokens, word, false), "{path} names `{word}`");
        }
        assert!(!names(&tokens, "episodes", true), "{path} names `episodes`");
        let opens = tokens.windows(2).any(|two| two[0] == "." && two[1] == "open");
        assert!(!opens, "{path} opens something by a method, as a task opens a simulator");
        assert!(uses(&tokens).iter().all(|used| used[0] != "env"), "{path} uses `env`");
        for at in (0..tokens.len()).filter(|&at| is(&tokens, at, "task")) {
            let asks_for_widths =
                at >= 4 && tokens[at - 4..at].concat() == "network_sizes(cx." && is(&tokens, at + 1, ")");
            assert!(asks_for_widths, "{path} takes more of the task than the widths of networks");
        }
        the_probe_only_records(path, &tokens);
    }
}

/// The probe holds true states: a stage that learns may let it record, and drops the answer.
fn the_probe_only_records(path: &str, tokens: &[String]) {
    for at in (0..tokens.len()).filter(|&at| is(tokens, at, "map_probe")) {
        assert_eq!(tokens[at - 5..at].concat(), "letprobe=cx.", "{path}: call it `probe`");
        assert_eq!(tokens[at + 1..at + 4].concat(), "();", "{path}: call it `probe`");
    }
    for at in (1..tokens.len()).filter(|&at| is(tokens, at, "probe") && !is(tokens, at - 1, "let")) {
        assert_eq!(tokens[at + 1..at + 3].concat(), ".record", "{path} asks the probe");
        let end = (at..tokens.len()).find(|&end| is(tokens, end, ")")).unwrap();
        let is_statement = is(tokens, end + 1, ";") && ["{", "}", ";"].contains(&tokens[at - 1].as_str());
        assert!(is_statement, "{path} uses the probe's answer");
    }
}

/// The standard library's differ between machines, and a state decides which pixels are lit.
#[test]
fn sines_and_powers_of_environments_are_portable() {
    let of_the_machine = ["sin", "cos", "sin_cos", "tan", "atan2", "exp", "ln", "powf", "powi", "hypot"];
    for path in files(&source().join("env")) {
        let tokens = tokens(&path);
        for at in (1..tokens.len()).filter(|&at| of_the_machine.contains(&tokens[at].as_str())) {
            assert!(!is(&tokens, at - 1, "."), "{}: write `libm::{}`", path.display(), tokens[at]);
        }
    }
}

#[test]
fn transitions_hold_no_states() {
    let tokens = tokens(&source().join("artifact/transitions.rs"));
    assert!(!tokens.iter().any(|token| token.contains("state")), "transitions are pictures and actions");
}

#[test]
fn the_reader_of_uses_finds_groups_and_inner_groups() {
    let text =
        ["use", "crate", ":", ":", "{", "a", ":", ":", "{", "b", ",", "c", ":", ":", "d", "}", ",", "e", "}", ";"];
    let tokens: Vec<String> = text.iter().map(|word| (*word).to_owned()).collect();
    let found: Vec<String> = uses(&tokens).iter().map(|path| path.join("::")).collect();
    assert_eq!(found, ["a::b", "a::c", "e"]);
}

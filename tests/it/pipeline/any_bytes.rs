//! Reading any file with any argument ends in a graph or in mistakes, never in a panic.

use std::collections::BTreeSet;

use crate::support::{
    mutated::{corpus, modestly, mutation},
    pipeline::{ONLINE, kinds, overrides},
};
use carl_pipe::{
    diag::Diagnostics,
    pipeline::{Graph, Source, dag_mermaid, dag_text, load, load_with},
    stage::{Arity, NothingOutside},
};
use proptest::prelude::*;

/// Loads a file.
fn read(bytes: &[u8], set: &[&str], sweep: &[&str]) {
    hold(load(&Source::new("p.toml", bytes), &overrides(set, sweep), kinds()));
}

/// Loads a file that extends `base`.
fn read_extending(base: &[u8]) {
    let file = "schema = 1\nextends = \"p.toml\"\nname = \"above\"\n[stages.represent]\nfirst.epochs = 3\n[matrix]\nseed = [1]\n";
    let base = |_: &str| Ok(Source::new("p.toml", base));
    hold(load_with(&Source::new("above.toml", file), &overrides(&[], &[]), kinds(), &base, &NothingOutside));
}

/// Checks the promises of a graph, or renders the mistakes: a wrong place would panic there.
fn hold(loaded: Result<Graph, Diagnostics>) {
    match loaded {
        Ok(graph) => hold_promises(&graph),
        Err(mistakes) => {
            assert!(!mistakes.list().is_empty());
            assert!(mistakes.render(false).contains("error"));
            mistakes.render(true);
            mistakes.to_json();
        }
    }
}

/// Checks what every graph promises.
fn hold_promises(graph: &Graph) {
    let names: BTreeSet<&str> = graph.nodes.iter().map(|node| node.name.as_str()).collect();
    assert_eq!(names.len(), graph.nodes.len(), "names are unique");
    for (at, node) in graph.nodes.iter().enumerate() {
        assert_eq!(node.inputs.len(), node.kind.ports.len());
        for (port, givers) in &node.inputs {
            let fits = match port.arity {
                Arity::One => givers.len() == 1,
                Arity::Optional => givers.len() <= 1,
                Arity::Many => !givers.is_empty(),
            };
            assert!(fits, "{} {}", node.name, port.name);
            assert!(givers.iter().all(|giver| *giver < at && graph.nodes[*giver].kind.gives(port.artifact)));
        }
        let refusals = (node.kind.check)(&node.params, &node.task).expect("explicit parameters are read");
        assert_eq!(refusals, []);
    }
    dag_text(graph);
    dag_mermaid(graph);
}

const SPARE: &[&str] = &[
    "@prev",
    "@sofar",
    "@last",
    "@all",
    "@3",
    "[*]",
    "\"",
    "'",
    "\"\"\"",
    "[",
    "]",
    "{",
    "}",
    "=",
    "=",
    ",",
    ".",
    "\n",
    "-1",
    "0",
    "1e999",
    "nan",
    "true",
    "\"0..3\"",
    "[matrix]\n",
    "[stages.x]\n",
    "[stages]\n",
    "[[stages]]\n",
    "loop = true\n",
    "loop = { from = 99 }\n",
    "first = {}\n",
    "kind = \"evaluate\"\n",
    "seed",
    "represent",
    "lambda",
    "task",
    "ü",
    "\u{0}",
    "\r\n",
    "\u{feff}",
    "\\",
    "#",
    "1979-05-27",
    "9223372036854775808",
    "rounds = 100000\n",
    "rounds = 4294967295\n",
];

/// A valid file with pieces taken out, doubled, put in or exchanged.
fn mutated() -> impl Strategy<Value = Vec<u8>> {
    let change = (0..ONLINE.len(), 0_usize..40, 0..SPARE.len(), 0_u8..4);
    prop::collection::vec(change, 1..6).prop_map(|changes| {
        let mut text = ONLINE.as_bytes().to_vec();
        for (at, length, spare, how) in changes {
            let at = at.min(text.len());
            let end = (at + length).min(text.len());
            let piece = match how {
                0 => Vec::new(),
                1 => [&text[at..end], &text[at..end]].concat(),
                2 => [SPARE[spare].as_bytes(), &text[at..end]].concat(),
                _ => SPARE[spare].as_bytes().to_vec(),
            };
            text.splice(at..end, piece);
        }
        text
    })
}

/// A valid file with the lines of which some are taken out, doubled or exchanged.
fn shuffled() -> impl Strategy<Value = Vec<u8>> {
    let lines: Vec<&str> = ONLINE.lines().collect();
    let count = lines.len();
    prop::collection::vec((0..count, 0..count, 0_u8..3), 1..5).prop_map(move |changes| {
        let mut lines = lines.clone();
        for (one, other, how) in changes {
            let (one, other) = (one.min(lines.len() - 1), other.min(lines.len() - 1));
            match how {
                0 => lines.swap(one, other),
                1 => lines.insert(one, lines[other]),
                _ => _ = (lines.len() > 1).then(|| lines.remove(one)),
            }
        }
        lines.join("\n").into_bytes()
    })
}

/// A valid file in which some words take the place of others, so that it stays TOML.
fn reworded() -> impl Strategy<Value = Vec<u8>> {
    let mut words: Vec<&str> = ONLINE.split(|c: char| !(c.is_alphanumeric() || "_@".contains(c))).collect();
    words.retain(|word| !word.is_empty());
    words.extend(["-1", "nan", "1.5", "[]", "{}", "\"\"", "represent@3[*]", "0..3"]);
    let count = words.len();
    prop::collection::vec((0..count, 0..count), 1..6).prop_map(move |changes| {
        let mut text = ONLINE.to_owned();
        for (from, to) in changes {
            text = text.replacen(words[from], words[to], 1 + to % 3);
        }
        text.into_bytes()
    })
}

fn argument() -> impl Strategy<Value = String> {
    let piece = prop_oneof![
        prop::sample::select(SPARE).prop_map(str::to_owned),
        prop::sample::select(&["represent", "epochs", "seed", "=", ".", "first", "preset", "0..3", "1,2", " "][..])
            .prop_map(str::to_owned),
        any::<char>().prop_map(String::from),
    ];
    prop::collection::vec(piece, 0..6).prop_map(|pieces| pieces.concat())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_file_with_any_change(mutation in mutation()) {
        let (_, bytes) = mutation.of_corpus("pipelines");
        read(&bytes, &[], &[]);
    }

    #[test]
    fn arbitrary_bytes(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        read(&bytes, &[], &[]);
    }

    #[test]
    fn a_file_with_pieces_changed(bytes in mutated()) {
        read(&bytes, &[], &[]);
    }

    #[test]
    fn a_base_with_pieces_changed(bytes in mutated()) {
        read_extending(&bytes);
    }

    #[test]
    fn a_file_with_lines_changed(bytes in shuffled()) {
        read(&bytes, &["represent.epochs=3"], &["seed=0..2"]);
    }

    #[test]
    fn a_file_with_words_changed(bytes in reworded()) {
        read(&bytes, &[], &["represent.lambda.consistency=7,11"]);
    }

    #[test]
    fn arguments(set in argument(), sweep in argument()) {
        read(ONLINE.as_bytes(), &[&set], &[&sweep]);
    }
}

#[test]
fn the_corpus_is_read_or_refused() {
    for (path, bytes, is_whole) in corpus("pipelines") {
        let loaded = modestly(&bytes, |bytes| load(&Source::new("p.toml", bytes), &overrides(&[], &[]), kinds()));
        assert_eq!(loaded.is_ok(), is_whole, "{}", path.display());
        hold(loaded);
    }
}

#[test]
fn nesting_without_end() {
    let deep = 100_000;
    read(format!("a = {}", "[".repeat(deep)).as_bytes(), &[], &[]);
    read(format!("a = {}", "{a=".repeat(deep)).as_bytes(), &[], &[]);
    read(format!("{}x = 1", "a.".repeat(deep)).as_bytes(), &[], &[]);
    read(format!("[{}x]", "a.".repeat(deep)).as_bytes(), &[], &[]);
    read(
        ONLINE.as_bytes(),
        &[&format!("represent.{}x=1", "a.".repeat(deep))],
        &[&format!("represent.{}x=1", "a.".repeat(deep))],
    );
}

#[test]
fn more_than_can_be_unrolled() {
    read(ONLINE.replace("rounds = 17", "rounds = 4294967295").as_bytes(), &[], &[]);
    read(ONLINE.replace("rounds = 17", "rounds = 12000").as_bytes(), &[], &[]);
    read(
        ONLINE.as_bytes(),
        &[],
        &["seed=0..90000", "represent.lambda.consistency=0..90000", "task.noise=0..90000", "represent.epochs=0..90000"],
    );
}

//! A pipeline as text or as a Mermaid flowchart: one entry for each stage, or one for each node.

use std::fmt::Write as _;

use super::wrap::wrap;
use crate::pipeline::graph::node::{Graph, Node, NodeId};

/// A stage with all of its nodes.
struct Folded<'a> {
    name: &'a str,
    nodes: Vec<&'a Node>,
}

/// The stages in the order in which they first run.
fn fold(graph: &Graph) -> Vec<Folded<'_>> {
    let mut stages: Vec<Folded<'_>> = Vec::new();
    for node in &graph.nodes {
        match stages.iter_mut().find(|stage| stage.name == node.stage) {
            Some(stage) => stage.nodes.push(node),
            None => stages.push(Folded { name: &node.stage, nodes: vec![node] }),
        }
    }
    stages
}

impl Folded<'_> {
    /// A node of the last round: its inputs show best what the stage takes, since `@sofar` means many rounds there.
    fn typical(&self) -> Option<&Node> {
        self.nodes.iter().copied().max_by_key(|node| (node.round, std::cmp::Reverse(&node.name)))
    }

    fn rounds(&self) -> Option<(u32, u32)> {
        let rounds = || self.nodes.iter().filter_map(|node| node.round);
        Some((rounds().min()?, rounds().max()?))
    }

    /// `rounds 1 to 16, 25 points`, or nothing for a single node.
    fn extent(&self) -> String {
        let mut parts = Vec::new();
        match self.rounds() {
            Some((first, last)) if first < last => parts.push(format!("rounds {first} to {last}")),
            Some((first, _)) => parts.push(format!("round {first}")),
            None => {}
        }
        let last = self.typical().and_then(|node| node.round);
        let points = self.nodes.iter().filter(|node| node.round == last).count();
        if points > 1 {
            parts.push(format!("{points} points"));
        }
        parts.join(", ")
    }
}

/// The results connected to a port, as a pipeline file writes them.
struct Shown<'a> {
    stage: &'a str,
    /// `@prev`, `@sofar[*]`, or empty.
    selector: String,
}

/// The references that mean these nodes.
fn references<'a>(graph: &'a Graph, node: &Node, upstream: &[NodeId]) -> Vec<Shown<'a>> {
    let mut stages: Vec<(&str, Vec<&Node>)> = Vec::new();
    for one in upstream.iter().map(|id| &graph.nodes[*id]) {
        match stages.iter_mut().find(|(stage, _)| *stage == one.stage) {
            Some((_, nodes)) => nodes.push(one),
            None => stages.push((&one.stage, vec![one])),
        }
    }
    stages.into_iter().map(|(stage, nodes)| Shown { stage, selector: selector(node, &nodes) }).collect()
}

/// The selector by which `node` means the nodes of one stage.
fn selector(node: &Node, upstream: &[&Node]) -> String {
    let mut rounds: Vec<Option<u32>> = upstream.iter().map(|one| one.round).collect();
    rounds.dedup();
    let star = if upstream.len() > rounds.len() { "[*]" } else { "" };
    let rounds = match (node.round, rounds.as_slice()) {
        (_, [None]) => String::new(),
        (Some(round), [Some(from)]) if *from == round => String::new(),
        (Some(round), [Some(from)]) if from + 1 == round => "@prev".to_owned(),
        (None, [Some(_)]) if upstream[0].is_last => "@last".to_owned(),
        (_, [Some(from)]) => format!("@{from}"),
        (Some(_), _) => "@sofar".to_owned(),
        (None, _) => "@all".to_owned(),
    };
    rounds + star
}

/// The pipeline by stage.
pub fn dag_text(graph: &Graph) -> String {
    let stages = fold(graph);
    let mut text = heading(graph, stages.len());
    let width = widest(stages.iter().map(|stage| stage.name));
    for stage in &stages {
        let Some(node) = stage.typical() else { continue };
        let line = format!("{:width$}  {}  {}", stage.name, node.kind.name, stage.extent());
        _ = writeln!(text, "\n{}", line.trim_end());
        let taken = node.inputs.iter().filter(|(_, upstream)| !upstream.is_empty());
        let lines: Vec<(&str, Vec<String>)> = taken
            .map(|(port, upstream)| {
                let shown = references(graph, node, upstream).into_iter();
                (port.name, shown.map(|Shown { stage, selector }| format!("{stage}{selector}")).collect())
            })
            .collect();
        write_inputs(&mut text, &lines);
    }
    text
}

/// The pipeline node by node.
pub fn dag_text_expanded(graph: &Graph) -> String {
    let mut text = heading(graph, fold(graph).len());
    for node in &graph.nodes {
        _ = writeln!(text, "\n{}  {}", node.name, node.kind.name);
        let taken = node.inputs.iter().filter(|(_, upstream)| !upstream.is_empty());
        let lines: Vec<(&str, Vec<String>)> = taken
            .map(|(port, upstream)| (port.name, upstream.iter().map(|id| graph.nodes[*id].name.clone()).collect()))
            .collect();
        write_inputs(&mut text, &lines);
    }
    text
}

fn heading(graph: &Graph, stages: usize) -> String {
    let mut text = graph.name.clone();
    if !graph.description.is_empty() {
        text = wrap(&format!("{}: {}", graph.name, graph.description), 0);
    }
    let nodes = graph.nodes.len();
    let plural = |count: usize, word: &str| if count == 1 { format!("1 {word}") } else { format!("{count} {word}s") };
    format!("{text}\n{}, {}\n", plural(stages, "stage"), plural(nodes, "node"))
}

fn widest<'a>(names: impl Iterator<Item = &'a str>) -> usize {
    names.map(str::len).max().unwrap_or(0)
}

fn write_inputs(text: &mut String, lines: &[(&str, Vec<String>)]) {
    let width = widest(lines.iter().map(|(port, _)| *port));
    for (port, upstream) in lines {
        let line = format!("  {port:width$} <- {}", upstream.join(", "));
        _ = writeln!(text, "{}", wrap(&line, width + 6));
    }
}

/// The pipeline by stage as a Mermaid flowchart. Edges carry the rounds that they take from, the loop is a box.
pub fn dag_mermaid(graph: &Graph) -> String {
    let stages = fold(graph);
    let mut text = "flowchart LR\n".to_owned();
    let (in_loop, outside): (Vec<usize>, Vec<usize>) = (0..stages.len()).partition(|at| stages[*at].rounds().is_some());
    outside.iter().for_each(|at| text.push_str(&mermaid_box(*at, &stages[*at], "  ")));
    if !in_loop.is_empty() {
        text.push_str("  subgraph loop\n");
        in_loop.iter().for_each(|at| text.push_str(&mermaid_box(*at, &stages[*at], "    ")));
        text.push_str("  end\n");
    }
    for (at, stage) in stages.iter().enumerate() {
        for (from, selector) in stage.typical().map_or_else(Vec::new, |node| edges(at, node, &stages, graph)) {
            let arrow = if selector == "@prev" { "-.->" } else { "-->" };
            let label = if selector.is_empty() { selector } else { format!("|\"{selector}\"|") };
            _ = writeln!(text, "  s{from} {arrow}{label} s{at}");
        }
    }
    text
}

fn mermaid_box(at: usize, stage: &Folded<'_>, indent: &str) -> String {
    let kind = stage.typical().map_or("", |node| node.kind.name);
    let extent = stage.extent();
    let extent = if extent.is_empty() { extent } else { format!("<br/>{extent}") };
    format!("{indent}s{at}[\"{}<br/>{kind}{extent}\"]\n", stage.name)
}

/// The stages that a node of stage `at` takes from, each with its selector and none twice.
fn edges(at: usize, node: &Node, stages: &[Folded<'_>], graph: &Graph) -> Vec<(usize, String)> {
    let mut edges = Vec::new();
    for (_, upstream) in &node.inputs {
        for Shown { stage, selector } in references(graph, node, upstream) {
            let from = stages.iter().position(|known| known.name == stage).unwrap_or(at);
            if !edges.contains(&(from, selector.clone())) {
                edges.push((from, selector));
            }
        }
    }
    edges
}

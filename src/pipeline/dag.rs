//! A pipeline as text or as a Mermaid flowchart: by stage, with rounds and points folded together, or node by node.

use std::fmt::Write as _;

use super::{Graph, Node, NodeId, wording::wrap};

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
    /// The node that shows best what the stage takes: of the last round, where `@sofar` means many.
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

/// What a port is connected to, as a pipeline file writes it: stage and selector.
fn references<'a>(graph: &'a Graph, taker: &Node, givers: &[NodeId]) -> Vec<(&'a str, String)> {
    let mut stages: Vec<(&str, Vec<&Node>)> = Vec::new();
    for giver in givers.iter().map(|giver| &graph.nodes[*giver]) {
        match stages.iter_mut().find(|(stage, _)| *stage == giver.stage) {
            Some((_, nodes)) => nodes.push(giver),
            None => stages.push((&giver.stage, vec![giver])),
        }
    }
    stages.into_iter().map(|(stage, nodes)| (stage, selector(taker, &nodes))).collect()
}

fn selector(taker: &Node, givers: &[&Node]) -> String {
    let mut rounds: Vec<Option<u32>> = givers.iter().map(|giver| giver.round).collect();
    rounds.dedup();
    let star = if givers.len() > rounds.len() { "[*]" } else { "" };
    let which = match (taker.round, rounds.as_slice()) {
        (_, [None]) => String::new(),
        (Some(round), [Some(giver)]) if *giver == round => String::new(),
        (Some(round), [Some(giver)]) if giver + 1 == round => "@prev".to_owned(),
        (None, [Some(_)]) if givers[0].is_last => "@last".to_owned(),
        (_, [Some(giver)]) => format!("@{giver}"),
        (Some(_), _) => "@sofar".to_owned(),
        (None, _) => "@all".to_owned(),
    };
    which + star
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
        let taken = node.inputs.iter().filter(|(_, givers)| !givers.is_empty());
        let lines: Vec<(&str, Vec<String>)> = taken
            .map(|(port, givers)| {
                let shown = references(graph, node, givers).into_iter().map(|(stage, which)| format!("{stage}{which}"));
                (port.name, shown.collect())
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
        let taken = node.inputs.iter().filter(|(_, givers)| !givers.is_empty());
        let lines: Vec<(&str, Vec<String>)> = taken
            .map(|(port, givers)| (port.name, givers.iter().map(|giver| graph.nodes[*giver].name.clone()).collect()))
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
    for (port, givers) in lines {
        let line = format!("  {port:width$} <- {}", givers.join(", "));
        _ = writeln!(text, "{}", wrap(&line, width + 6));
    }
}

/// The pipeline by stage as a Mermaid flowchart: edges carry the rounds they take from, the loop is a box.
pub fn dag_mermaid(graph: &Graph) -> String {
    let stages = fold(graph);
    let mut text = "flowchart LR\n".to_owned();
    let declare = |text: &mut String, at: usize, indent: &str| {
        let stage = &stages[at];
        let kind = stage.typical().map_or("", |node| node.kind.name);
        let extent = stage.extent();
        let extent = if extent.is_empty() { extent } else { format!("<br/>{extent}") };
        _ = writeln!(text, "{indent}s{at}[\"{}<br/>{kind}{extent}\"]", stage.name);
    };
    let (in_loop, outside): (Vec<usize>, Vec<usize>) = (0..stages.len()).partition(|at| stages[*at].rounds().is_some());
    outside.iter().for_each(|at| declare(&mut text, *at, "  "));
    if !in_loop.is_empty() {
        text.push_str("  subgraph loop\n");
        in_loop.iter().for_each(|at| declare(&mut text, *at, "    "));
        text.push_str("  end\n");
    }
    for (at, stage) in stages.iter().enumerate() {
        let Some(node) = stage.typical() else { continue };
        let mut edges: Vec<(usize, String)> = Vec::new();
        for (_, givers) in &node.inputs {
            for (giver, which) in references(graph, node, givers) {
                let from = stages.iter().position(|stage| stage.name == giver).unwrap_or(at);
                if !edges.contains(&(from, which.clone())) {
                    edges.push((from, which));
                }
            }
        }
        for (from, which) in edges {
            let arrow = if which == "@prev" { "-.->" } else { "-->" };
            let label = if which.is_empty() { which } else { format!("|\"{which}\"|") };
            _ = writeln!(text, "  s{from} {arrow}{label} s{at}");
        }
    }
    text
}

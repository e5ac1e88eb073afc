//! The messages of events, which every display of progress shows.

use crate::{
    cli::out::{self, duration},
    node_name::NodeName,
    run::events::{Event, NodeState},
};

/// How much to print about each node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Detail {
    /// Headline metrics, failures and warnings: for runs of many nodes.
    Low,
    /// Also each node that ran.
    Medium,
    /// Also cached nodes and all metrics.
    High,
}

/// Runs with more nodes than this have low detail.
const MANY_NODES: usize = 100;

/// Makes the messages.
pub(super) struct Messages {
    /// The headline metrics of all kinds of stages.
    pub(super) headlines: Vec<&'static str>,
    /// True for high detail.
    pub(super) verbose: bool,
}

impl Messages {
    /// The detail for a run of this many nodes.
    pub(super) fn detail(&self, nodes: usize) -> Detail {
        match self.verbose {
            true => Detail::High,
            false if nodes > MANY_NODES => Detail::Low,
            false => Detail::Medium,
        }
    }

    /// The message of an event, if it has one at this detail.
    pub(super) fn of(&self, event: &Event, detail: Detail) -> Option<String> {
        match event {
            Event::RunStarted { run, pipeline, seed, nodes, .. } => {
                let seed = seed.map_or_else(String::new, |seed| format!(", seed {seed}"));
                let run = out::dim(&format!("({run})"));
                Some(format!("{} {pipeline}: {nodes} nodes{seed} {run}", out::bold("run")))
            }
            Event::Metric { node, round, name, value } if self.headlines.contains(&name.as_str()) => {
                Some(format!("{}  {name} {}", place(node, *round), out::bold(&out::number(*value))))
            }
            Event::Metric { node, name, value, .. } if detail == Detail::High => {
                Some(format!("{node}  {name} {}", out::number(*value)))
            }
            Event::Say { node, text } => Some(format!("{node}: {text}")),
            Event::Warning { node, text } => {
                let node = node.as_ref().map_or_else(String::new, |node| format!("{node}: "));
                Some(format!("{} {node}{}", out::yellow("warning:"), out::tidy(text)))
            }
            Event::NodeFinished { node, state, secs, .. } => {
                end(*state, *secs, detail).map(|end| format!("{node}  {end}"))
            }
            _ => None,
        }
    }
}

/// How a node ended.
fn end(state: NodeState, secs: f64, detail: Detail) -> Option<String> {
    match state {
        NodeState::Ran if detail == Detail::Low => None,
        NodeState::Ran => Some(format!("{} in {}", out::green("ran"), duration(secs))),
        NodeState::Cached if detail == Detail::High => Some(out::dim("cached")),
        NodeState::Failed => Some(format!("{} after {}", out::red("failed"), duration(secs))),
        NodeState::Stopped => Some(format!("{} after {}", out::yellow("stopped"), duration(secs))),
        NodeState::Cached | NodeState::Pending => None,
    }
}

/// Where a headline was measured: member of the suite, round, stage and point of the matrix. `evaluate` is the usual
/// stage, so its name is left out where the round is shown.
fn place(node: &str, round: Option<u32>) -> String {
    let Ok(name) = node.parse::<NodeName>() else { return node.to_owned() };
    let mut place = match round {
        Some(round) if name.stage == "evaluate" => format!("round {round}"),
        Some(round) => format!("round {round} {}", name.stage),
        None => name.stage.clone(),
    };
    if let Some(member) = &name.member {
        place = format!("{member} {place}");
    }
    if !name.point.is_empty() {
        place.push_str(&format!(" [{}]", name.point_text()));
    }
    place
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_place_names_member_round_stage_and_point() {
        let place = super::place;
        assert_eq!(place("evaluate@3", Some(3)), "round 3");
        assert_eq!(place("deployed@3[seed=1]", Some(3)), "round 3 deployed [seed=1]");
        assert_eq!(place("planar/evaluate", None), "planar evaluate");
    }
}

//! Models that may be pooled: one pipeline by one recipe, a model for each seed.

use std::collections::{BTreeMap, BTreeSet};

use crate::{cli::exit::Error, num::stats::Summary, report::outcomes::Outcome, store::Store};

/// One pipeline by one recipe, over its seeds.
#[derive(Debug)]
pub(crate) struct Series {
    /// One outcome for each seed, in the order of seeds.
    pub(crate) outcomes: Vec<Outcome>,
    /// The metric of each.
    pub(crate) values: Vec<f64>,
    pub(crate) summary: Summary,
    /// What tells it apart from others that share its cell.
    pub(crate) aside: String,
}

/// Pools outcomes, given newest run first, over seeds or not; those without the metric are left out.
pub(crate) fn pooled(
    outcomes: Vec<Outcome>,
    metric: &str,
    over_seeds: bool,
    store: &Store,
) -> Result<Vec<Series>, Error> {
    let mut groups: Vec<(Identity, BTreeMap<u64, Outcome>)> = Vec::new();
    for outcome in outcomes {
        let seed = (!over_seeds).then_some(outcome.seed);
        let identity = Identity { seed, ..Identity::of(&outcome) };
        let at = groups.iter().position(|(known, _)| *known == identity).unwrap_or_else(|| {
            groups.push((identity, BTreeMap::new()));
            groups.len() - 1
        });
        // The same seed of the same recipe is the same model: the newest run counts.
        groups[at].1.entry(outcome.seed).or_insert(outcome);
    }
    let mut all = Vec::new();
    for (_, by_seed) in groups {
        let (mut own, mut values) = (Vec::new(), Vec::new());
        for outcome in by_seed.into_values() {
            if let Some(value) = outcome.metric(metric, store)? {
                own.push(outcome);
                values.push(value);
            }
        }
        if let Some(summary) = Summary::of(&values) {
            all.push(Series { outcomes: own, values, summary, aside: String::new() });
        }
    }
    Ok(all)
}

/// What models of one series share.
#[derive(Debug, PartialEq)]
struct Identity {
    pipeline: String,
    labels: BTreeMap<String, String>,
    stage: String,
    round: Option<u32>,
    recipe: crate::digest::Digest,
    /// Where seeds are not pooled.
    seed: Option<u64>,
}

impl Identity {
    fn of(outcome: &Outcome) -> Self {
        Self {
            pipeline: outcome.member.pipeline.clone(),
            labels: outcome.member.labels.clone(),
            stage: outcome.stage.clone(),
            round: outcome.round,
            recipe: outcome.recipe,
            seed: None,
        }
    }
}

impl Series {
    pub(crate) fn first(&self) -> &Outcome {
        &self.outcomes[0]
    }

    /// Another metric of the same models.
    pub(crate) fn summary_of(&self, metric: &str, store: &Store) -> Result<Option<Summary>, Error> {
        let mut values = Vec::new();
        for outcome in &self.outcomes {
            values.extend(outcome.metric(metric, store)?);
        }
        Ok(Summary::of(&values).filter(|summary| summary.n == self.outcomes.len()))
    }

    /// `0 to 4`, or `0, 2, 5`.
    pub(crate) fn seeds(&self) -> String {
        let seeds: Vec<u64> = self.outcomes.iter().map(|outcome| outcome.seed).collect();
        match seeds[..] {
            [first, .., last] if last - first + 1 == seeds.len() as u64 && seeds.len() > 2 => {
                format!("{first} to {last}")
            }
            _ => seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", "),
        }
    }

    /// The number of samples, or the least and the most.
    pub(crate) fn samples(&self) -> [u64; 2] {
        let all = || self.outcomes.iter().map(|outcome| outcome.samples);
        [all().min().unwrap_or(0), all().max().unwrap_or(0)]
    }

    /// The commits that made it.
    pub(crate) fn commits(&self) -> String {
        let commits: BTreeSet<&str> = self.outcomes.iter().filter_map(|it| it.commit.as_deref()).collect();
        commits.into_iter().map(short).collect::<Vec<_>>().join(", ")
    }

    /// Mean %-goal of the best possible controller, if it was measured under the protocol of these evaluations.
    pub(crate) fn ceiling(&self) -> Option<f64> {
        self.first().ceiling
    }

    pub(crate) fn label(&self, name: &str) -> Option<&str> {
        self.first().member.labels.get(name).map(String::as_str)
    }
}

/// The first ten digits of a commit, and whether files differed.
fn short(commit: &str) -> String {
    let (digits, rest) = commit.split_once('-').map_or((commit, ""), |(digits, _)| (digits, "-dirty"));
    format!("{}{rest}", digits.get(..10).unwrap_or(digits))
}

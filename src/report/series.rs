//! Series: one stage of one pipeline by one recipe, with one model for each seed.

use std::collections::{BTreeMap, BTreeSet};

use super::{groups::grouped, outcomes::Outcome};
use crate::{
    digest::Digest,
    num::stats::{Estimate, Summary},
    store::ResultStore,
};

/// Models that differ by their seeds alone, with their values of one metric.
#[derive(Debug, Clone)]
pub struct Series {
    /// One outcome for each seed, in the order of seeds. There is at least one.
    pub outcomes: Vec<Outcome>,
    /// The metric of each outcome.
    pub values: Vec<f64>,
}

/// Pools outcomes over their seeds, or keeps every seed apart. Outcomes come newest run first: where several runs have
/// the same seed of the same recipe, the newest counts. Outcomes without the metric are left out.
///
/// # Errors
/// The store cannot be read.
pub fn pooled(
    outcomes: Vec<Outcome>,
    metric: &str,
    over_seeds: bool,
    store: &dyn ResultStore,
) -> anyhow::Result<Vec<Series>> {
    let mut all = Vec::new();
    for (_, group) in grouped(outcomes, |outcome| Identity::of(outcome, over_seeds)) {
        let mut by_seed = BTreeMap::new();
        for outcome in group {
            by_seed.entry(outcome.seed).or_insert(outcome);
        }
        let (mut own, mut values) = (Vec::new(), Vec::new());
        for outcome in by_seed.into_values() {
            if let Some(value) = outcome.metric(metric, store)? {
                own.push(outcome);
                values.push(value);
            }
        }
        if !own.is_empty() {
            all.push(Series { outcomes: own, values });
        }
    }
    Ok(all)
}

/// What the models of one series share.
#[derive(Debug, PartialEq)]
struct Identity {
    pipeline: String,
    labels: BTreeMap<String, String>,
    stage: String,
    round: Option<u32>,
    recipe: Digest,
    /// Where seeds are kept apart.
    seed: Option<u64>,
}

impl Identity {
    fn of(outcome: &Outcome, over_seeds: bool) -> Self {
        Self {
            pipeline: outcome.member.pipeline.clone(),
            labels: outcome.member.labels.clone(),
            stage: outcome.stage.clone(),
            round: outcome.round,
            recipe: outcome.recipe,
            seed: (!over_seeds).then_some(outcome.seed),
        }
    }
}

/// The least and the greatest number of samples of a series.
#[derive(Debug, Clone, Copy)]
pub struct SampleRange {
    /// The least.
    pub least: u64,
    /// The greatest.
    pub most: u64,
}

impl Series {
    /// Any outcome, for what all outcomes share.
    pub fn first(&self) -> &Outcome {
        &self.outcomes[0]
    }

    /// All statistics of the values.
    pub fn summary(&self) -> Summary {
        Summary::of(&self.values).expect("a series has a model")
    }

    /// The mean of the values and its standard error.
    pub fn estimate(&self) -> Estimate {
        Estimate::of(&self.values)
    }

    /// The mean of another metric of the same models; `None` where a model lacks it.
    ///
    /// # Errors
    /// The store cannot be read.
    pub fn mean_of(&self, metric: &str, store: &dyn ResultStore) -> anyhow::Result<Option<f64>> {
        let mut values = Vec::new();
        for outcome in &self.outcomes {
            values.extend(outcome.metric(metric, store)?);
        }
        Ok((values.len() == self.outcomes.len()).then(|| Estimate::of(&values).mean))
    }

    /// The seeds as text: `0 to 4`, or `0, 2, 5`.
    pub fn seeds(&self) -> String {
        let seeds: Vec<u64> = self.outcomes.iter().map(|outcome| outcome.seed).collect();
        match seeds[..] {
            [first, .., last] if last - first + 1 == seeds.len() as u64 && seeds.len() > 2 => {
                format!("{first} to {last}")
            }
            _ => seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", "),
        }
    }

    /// The number of samples that models were trained on.
    pub fn samples(&self) -> SampleRange {
        let all = || self.outcomes.iter().map(|outcome| outcome.samples);
        SampleRange { least: all().min().unwrap_or(0), most: all().max().unwrap_or(0) }
    }

    /// The commits of the program that made the models, shortened.
    pub fn commits(&self) -> String {
        let commits: BTreeSet<&str> = self.outcomes.iter().filter_map(|it| it.commit.as_deref()).collect();
        commits.into_iter().map(short).collect::<Vec<_>>().join(", ")
    }

    /// See [`Outcome::ceiling`].
    pub fn ceiling(&self) -> Option<f64> {
        self.first().ceiling
    }

    /// A label of the pipeline, such as `paper`.
    pub fn label(&self, name: &str) -> Option<&str> {
        self.first().member.labels.get(name).map(String::as_str)
    }
}

/// The first ten digits of a commit, with `-dirty` where files differed from it.
fn short(commit: &str) -> String {
    let (digits, rest) = commit.split_once('-').map_or((commit, ""), |(digits, _)| (digits, "-dirty"));
    format!("{}{rest}", digits.get(..10).unwrap_or(digits))
}

//! Learning curves by number of samples: several pipelines of one task in one chart. Points are the rounds of online
//! pipelines and the sizes of the data of offline ones.

use std::collections::BTreeMap;

use super::{BandPoint, CEILING, Chart, Mark, Stroke};
use crate::{
    digest::Digest,
    num::stats::{Summary, mean},
    report::{
        groups::grouped,
        numbers::number,
        outcomes::{Outcome, point_text},
        point::without_samples,
        table::field,
        tell_apart::suffixes,
    },
};

const COLOURS: [&str; 8] = ["#1f5fa8", "#c8641c", "#2c7a4b", "#8a3a8f", "#b23a48", "#5b5b9b", "#7a6a1f", "#2a8a8f"];

/// What a band around a mean shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Band {
    /// The standard error of the mean.
    StandardError,
    /// The 95 % bootstrap interval over models.
    Interval,
}

/// One pipeline of one task.
struct Curve<'a> {
    /// An outcome, for what all outcomes of the curve share.
    first: &'a Outcome,
    /// The point of the matrix, without numbers of samples.
    point: Vec<(String, String)>,
    identity: Digest,
    /// Values by number of samples, then by seed.
    values: BTreeMap<u64, BTreeMap<u64, f64>>,
}

/// The chart of each task, by the name of the task. Outcomes come newest run first: where several runs have the same
/// seed at the same number of samples, the newest counts.
pub fn by_samples(outcomes: &[Outcome], band: Band) -> BTreeMap<String, String> {
    let measured = outcomes.iter().filter(|outcome| outcome.metrics.contains_key(outcome.headline));
    let tasks = grouped(measured, |outcome| outcome.task_name());
    tasks.into_iter().map(|(task, own)| (task.clone(), draw(&task, &curves(own), band))).collect()
}

fn curves(outcomes: Vec<&Outcome>) -> Vec<Curve<'_>> {
    let identity = |outcome: &&Outcome| {
        let point = without_samples(outcome.point.clone());
        let labels = &outcome.member.labels;
        Digest::of_json(&serde_json::json!([outcome.family, outcome.member.pipeline, labels, outcome.stage, point]))
    };
    grouped(outcomes, identity).into_iter().map(|(identity, own)| Curve::of(identity, &own)).collect()
}

/// Names of curves: the algorithm, and what tells equal names apart.
fn names<'a>(curves: &[Curve<'a>]) -> Vec<String> {
    let algorithm = |curve: &Curve<'a>| field(curve.first, "algorithm");
    let parts: [&dyn Fn(&Curve<'a>) -> String; 4] = [
        &|curve| curve.first.stage.clone(),
        &|curve| curve.first.member.pipeline.clone(),
        &|curve| point_text(&curve.point),
        &|curve| curve.identity.short(),
    ];
    let suffixes = suffixes(curves, algorithm, &parts);
    curves.iter().zip(suffixes).map(|(curve, suffix)| algorithm(curve) + &suffix).collect()
}

impl<'a> Curve<'a> {
    fn of(identity: Digest, outcomes: &[&'a Outcome]) -> Self {
        let first = outcomes[0];
        let mut values: BTreeMap<u64, BTreeMap<u64, f64>> = BTreeMap::new();
        for outcome in outcomes {
            let value = outcome.metrics[outcome.headline];
            values.entry(outcome.samples).or_default().entry(outcome.seed).or_insert(value);
        }
        Self { first, point: without_samples(first.point.clone()), identity, values }
    }

    /// The number of models where it is greatest.
    fn models(&self) -> usize {
        self.values.values().map(BTreeMap::len).max().unwrap_or(0)
    }

    fn means(&self) -> Vec<[f64; 2]> {
        self.values.iter().map(|(samples, by_seed)| [*samples as f64, mean(&values(by_seed))]).collect()
    }

    fn band(&self, band: Band) -> Vec<BandPoint> {
        let point = |(samples, by_seed): (&u64, &BTreeMap<u64, f64>)| {
            let summary = Summary::of(&values(by_seed))?;
            let error = summary.standard_error.unwrap_or(0.0);
            let [low, high] = match (band, summary.ci95) {
                (Band::Interval, Some(interval)) => interval,
                _ => [summary.mean - error, summary.mean + error],
            };
            Some(BandPoint { x: *samples as f64, low, high })
        };
        self.values.iter().filter_map(point).collect()
    }
}

fn values(by_seed: &BTreeMap<u64, f64>) -> Vec<f64> {
    by_seed.values().copied().collect()
}

/// Draws the curves of a task.
fn draw(task: &str, curves: &[Curve<'_>], band: Band) -> String {
    let mut marks = Vec::new();
    let ceiling = curves.iter().find_map(|curve| curve.first.ceiling);
    let name = |y| format!("best possible controller {y:.1}");
    marks.extend(ceiling.map(|y| Mark::Level { y, stroke: Stroke::new(CEILING, 1.2), name: name(y) }));
    for (at, (curve, name)) in curves.iter().zip(names(curves)).enumerate() {
        let colour = COLOURS[at % COLOURS.len()];
        marks.push(Mark::Band { points: curve.band(band), colour, name: None });
        let points = curve.means();
        let last = points.last().map_or(f64::NAN, |[_, y]| *y);
        let count = curve.models();
        let models = if count == 1 { "1 seed".to_owned() } else { format!("{count} seeds") };
        let name = Some(format!("{name}: {} ({models})", number(last)));
        marks.push(Mark::Line { points, stroke: Stroke::new(colour, 2.4), has_dots: true, name });
        let stroke = Stroke::new(colour, 1.2).dashed("1.5 3");
        let paper = |y| Mark::Level { y, stroke, name: format!("the paper's mean {y:.1}") };
        marks.extend(curve.first.paper().map(paper));
    }
    let words = match band {
        Band::StandardError => "bands: mean ± standard error",
        Band::Interval => "bands: 95 % bootstrap interval",
    };
    if curves.iter().any(|curve| curve.models() > 1) {
        marks.push(Mark::Note(words.to_owned()));
    }
    let (y_label, y_limits) = super::vertical(curves[0].first.headline);
    let what = if y_limits.is_some() { "time at the goal" } else { curves[0].first.headline };
    let title = format!("{task}: {what} by samples");
    Chart { title, x_label: "samples", y_label, x_ticks: 7, y_limits, size: [548.0, 326.0], legend: 310.0, marks }
        .draw()
}

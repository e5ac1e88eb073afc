//! The learning curve of one pipeline: its headline metric by round.

use std::collections::BTreeMap;

use super::{BandPoint, CEILING, Chart, Mark, Stroke};
use crate::{
    num::stats::{mean, standard_error},
    report::{groups::grouped, outcomes::Outcome},
};

const MEAN: &str = "#1f5fa8";
const ALONE: &str = "#c8641c";
const PAPER: &str = "#666";

/// The values of a metric by round, each in the order of models.
type ByRound = BTreeMap<u32, Vec<f64>>;

/// Draws the outcomes of a pipeline's rounds. There is at least one.
pub fn by_round(pipeline: &str, outcomes: &[Outcome]) -> String {
    let first = &outcomes[0];
    let models = grouped(outcomes, |it| (it.seed, it.point.clone()));
    let word = if outcomes.iter().all(|it| it.point.is_empty()) { "seed" } else { "point" };
    let count = models.len();
    let goal = rounds(outcomes, first.headline);
    let mut marks = Vec::new();
    marks.extend(band(&goal, count));
    if count >= 3 {
        marks.extend(models.iter().enumerate().map(|(at, (_, own))| {
            let points = means(&rounds(own.iter().copied(), first.headline));
            let name = (at == 0).then(|| format!("each {word}"));
            Mark::Line { points, stroke: Stroke::new(MEAN, 1.0).faint(), has_dots: false, name }
        }));
    }
    if first.headline == "percent_goal" {
        let points = means(&rounds(outcomes, "policy_alone"));
        let name = if count > 1 { "policy alone, mean" } else { "policy alone" };
        let stroke = Stroke::new(ALONE, 1.8).dashed("6 4");
        let line = Mark::Line { points, stroke, has_dots: false, name: Some(name.to_owned()) };
        marks.extend(Some(line).filter(|line| !line.xs().is_empty()));
    }
    let name = if count > 1 { "mean as deployed" } else { "as deployed" };
    let stroke = Stroke::new(MEAN, 2.4);
    marks.push(Mark::Line { points: means(&goal), stroke, has_dots: true, name: Some(name.to_owned()) });
    let ceiling = |y| Mark::Level { y, stroke: Stroke::new(CEILING, 1.2), name: format!("ceiling {y:.1}") };
    marks.extend(first.ceiling.map(ceiling));
    let paper = Stroke::new(PAPER, 1.2).dashed("1.5 3");
    marks.extend(first.paper().map(|y| Mark::Level { y, stroke: paper, name: format!("paper's mean {y:.1}") }));
    let title = format!("{pipeline}, {count} {word}{}", if count == 1 { "" } else { "s" });
    let (y_label, y_limits) = super::vertical(first.headline);
    Chart { title, x_label: "round", y_label, x_ticks: 10, y_limits, size: [540.0, 300.0], legend: 190.0, marks }.draw()
}

fn rounds<'a>(outcomes: impl IntoIterator<Item = &'a Outcome>, metric: &str) -> ByRound {
    let mut all = ByRound::new();
    for outcome in outcomes {
        if let (Some(round), Some(value)) = (outcome.round, outcome.metrics.get(metric)) {
            all.entry(round).or_default().push(*value);
        }
    }
    all
}

fn means(all: &ByRound) -> Vec<[f64; 2]> {
    all.iter().map(|(round, values)| [f64::from(*round), mean(values)]).collect()
}

/// The band around the mean: standard errors, or the range of two models.
fn band(goal: &ByRound, models: usize) -> Option<Mark> {
    if models < 2 {
        return None;
    }
    let ends = |values: &[f64]| match models {
        2 => [f64::min, f64::max].map(|pick| values.iter().copied().fold(values[0], pick)),
        _ => [-1.0, 1.0].map(|sign| mean(values) + sign * standard_error(values)),
    };
    let point = |(round, values): (&u32, &Vec<f64>)| {
        let [low, high] = ends(values);
        BandPoint { x: f64::from(*round), low, high }
    };
    let name = if models == 2 { "min to max" } else { "mean ± s.e." };
    Some(Mark::Band { points: goal.iter().map(point).collect(), colour: MEAN, name: Some(name.to_owned()) })
}

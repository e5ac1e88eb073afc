//! The learning curve: share of time at the goal over rounds.

use std::collections::BTreeMap;

use super::svg::{INK, Picture};
use crate::{
    num::stats::{mean, standard_error},
    run::manifest::NodeRecord,
};

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 400.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = WIDTH - 122.0;
const TOP: f64 = 74.0;
const BOTTOM: f64 = HEIGHT - 52.0;
/// Height of a line of text.
const LINE: f64 = 14.0;

const MEAN: &str = "#1f5fa8";
const ALONE: &str = "#c8641c";
const PAPER: &str = "#666";
const CEILING: &str = "#2c7a4b";

/// The values of a metric, by round and then in the order of points.
type ByRound = BTreeMap<u32, Vec<f64>>;

/// Where rounds and per cents lie on the sheet.
struct Axes {
    rounds: [f64; 2],
    percent: [f64; 2],
}

impl Axes {
    fn place(&self, round: f64, percent: f64) -> [f64; 2] {
        let share = |[low, high]: [f64; 2], value: f64| if high > low { (value - low) / (high - low) } else { 0.5 };
        // The first and the last round keep clear of the frame.
        let inset = 14.0;
        let x = LEFT + inset + share(self.rounds, round) * (RIGHT - LEFT - 2.0 * inset);
        [x, BOTTOM - share(self.percent, percent) * (BOTTOM - TOP)]
    }

    fn line(&self, values: impl Iterator<Item = (u32, f64)>) -> Vec<[f64; 2]> {
        values.map(|(round, value)| self.place(f64::from(round), value)).collect()
    }
}

/// Draws the evaluations of a run; there is at least one. `paper` is the paper's mean.
pub(super) fn draw(pipeline: &str, evaluations: &[&NodeRecord], paper: Option<f64>) -> String {
    let goal = by_round(evaluations, "percent_goal");
    let alone = by_round(evaluations, "policy_alone");
    let mut points: Vec<&[(String, String)]> = evaluations.iter().map(|node| &node.point[..]).collect();
    points.sort_unstable();
    points.dedup();
    let environment = evaluations[0].task.open();
    let marks = [
        (environment.ceiling(), "ceiling", CEILING, "stroke-width=\"1.2\""),
        (paper, "paper's mean", PAPER, "stroke-width=\"1.2\" stroke-dasharray=\"1.5 3\""),
    ];
    let values = goal.values().chain(alone.values()).flatten().copied().chain(marks.iter().filter_map(|mark| mark.0));
    let axes = axes(&goal, values);
    let mut picture = Picture::new(WIDTH, HEIGHT);
    let title = format!("{pipeline}, {}", count(&points));
    picture.text([LEFT, 28.0], "font-size=\"16\" font-weight=\"bold\"", &title);
    frame(&mut picture, &axes, &goal);
    let mut free = f64::MIN;
    for (value, name, colour, style) in marks {
        let Some(value) = value else { continue };
        let [_, y] = axes.place(0.0, value);
        picture.line(&[[LEFT, y], [RIGHT, y]], &format!("stroke=\"{colour}\" {style}"));
        // The paper's mean lies below the ceiling, sometimes by less than a line of text.
        let label = (y + 4.0).max(free);
        picture.text([RIGHT + 6.0, label], &format!("fill=\"{colour}\""), &format!("{name} {value:.1}"));
        free = label + LINE;
    }
    let band = band(&mut picture, &axes, &goal, points.len());
    if points.len() >= 3 {
        for point in &points {
            let own: Vec<_> = evaluations.iter().filter(|node| node.point == *point).copied().collect();
            let line = axes.line(means(&by_round(&own, "percent_goal")));
            picture.line(&line, &format!("stroke=\"{MEAN}\" stroke-width=\"1\" stroke-opacity=\".35\""));
        }
    }
    picture.line(&axes.line(means(&alone)), &alone_style());
    let mean = axes.line(means(&goal));
    picture.line(&mean, &mean_style());
    for &place in &mean {
        picture.dot(place, &format!("fill=\"{MEAN}\""));
    }
    legend(&mut picture, points.len(), band, !alone.is_empty(), is_seeds(&points));
    picture.end()
}

fn mean_style() -> String {
    format!("stroke=\"{MEAN}\" stroke-width=\"2.4\" stroke-linejoin=\"round\"")
}

fn alone_style() -> String {
    format!("stroke=\"{ALONE}\" stroke-width=\"1.8\" stroke-dasharray=\"6 4\" stroke-linejoin=\"round\"")
}

fn by_round(nodes: &[&NodeRecord], metric: &str) -> ByRound {
    let mut all = ByRound::new();
    for node in nodes {
        if let (Some(round), Some(value)) = (node.round, node.metrics.get(metric)) {
            all.entry(round).or_default().push(*value);
        }
    }
    all
}

fn means(all: &ByRound) -> impl Iterator<Item = (u32, f64)> {
    all.iter().map(|(round, values)| (*round, mean(values)))
}

fn is_seeds(points: &[&[(String, String)]]) -> bool {
    points.iter().all(|point| point.iter().all(|(path, _)| path == "seed"))
}

fn count(points: &[&[(String, String)]]) -> String {
    let word = if is_seeds(points) { "seed" } else { "point" };
    format!("{} {word}{}", points.len(), if points.len() == 1 { "" } else { "s" })
}

/// Axes that hold all values, with tens at both ends.
fn axes(goal: &ByRound, values: impl Iterator<Item = f64>) -> Axes {
    let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)));
    let first = goal.first_key_value().map_or(0, |(round, _)| *round);
    let last = goal.last_key_value().map_or(0, |(round, _)| *round);
    let percent = [((low - 1.0) / 10.0).floor() * 10.0, ((high + 1.0) / 10.0).ceil() * 10.0];
    Axes { rounds: [f64::from(first), f64::from(last)], percent: percent.map(|value| value.clamp(0.0, 100.0)) }
}

/// The grid, ticks and labels.
fn frame(picture: &mut Picture, axes: &Axes, goal: &ByRound) {
    let [low, high] = axes.percent;
    let step = if high - low > 60.0 { 20 } else { 10 };
    for percent in (low as u32..=high as u32).filter(|percent| percent % step == 0) {
        let [_, y] = axes.place(0.0, f64::from(percent));
        picture.line(&[[LEFT, y], [RIGHT, y]], "stroke=\"#e8e8e8\"");
        picture.text([LEFT - 9.0, y + 4.0], "text-anchor=\"end\"", &percent.to_string());
    }
    let (first, last) = (axes.rounds[0] as u32, axes.rounds[1] as u32);
    // A label at every second round, or at fewer where they would touch.
    let every = [2, 5, 10, 20, 50, 100].into_iter().find(|every| (last - first) / every <= 20).unwrap_or(1000);
    for &round in goal.keys() {
        let [x, _] = axes.place(f64::from(round), low);
        let is_labelled = round % every == 0 || first == last;
        if is_labelled || every == 2 {
            let length = if is_labelled { 5.0 } else { 3.0 };
            picture.line(&[[x, BOTTOM], [x, BOTTOM + length]], &format!("stroke=\"{INK}\""));
        }
        if is_labelled {
            picture.text([x, BOTTOM + 19.0], "text-anchor=\"middle\"", &round.to_string());
        }
    }
    picture.line(&[[LEFT, TOP], [LEFT, BOTTOM], [RIGHT, BOTTOM]], &format!("stroke=\"{INK}\""));
    picture.text([f64::midpoint(LEFT, RIGHT), HEIGHT - 12.0], "text-anchor=\"middle\" font-size=\"13\"", "round");
    let middle = f64::midpoint(TOP, BOTTOM);
    let turned = format!("text-anchor=\"middle\" font-size=\"13\" transform=\"rotate(-90 18 {middle:.1})\"");
    picture.text([18.0, middle], &turned, "states at the goal, %");
}

/// Draws the band around the mean, if there are points enough for one; returns what it is.
fn band(picture: &mut Picture, axes: &Axes, goal: &ByRound, points: usize) -> Option<&'static str> {
    let ends = |values: &[f64]| match points {
        2 => [f64::min, f64::max].map(|pick| values.iter().copied().fold(values[0], pick)),
        _ => [-1.0, 1.0].map(|sign| mean(values) + sign * standard_error(values)),
    };
    if points < 2 {
        return None;
    }
    let side = |at: usize| goal.iter().map(move |(round, values)| (*round, ends(values)[at]));
    let mut outline = axes.line(side(0));
    outline.extend(axes.line(side(1)).into_iter().rev());
    picture.area(&outline, &format!("fill=\"{MEAN}\" fill-opacity=\".18\""));
    Some(if points == 2 { "min to max" } else { "mean ± s.e." })
}

/// What lines and bands mean, in a row below the title.
fn legend(picture: &mut Picture, points: usize, band: Option<&str>, has_alone: bool, is_seeds: bool) {
    let y = 52.0;
    let mut x = LEFT;
    let mut entry = |picture: &mut Picture, style: &str, words: &str| {
        picture.line(&[[x, y], [x + 24.0, y]], style);
        picture.text([x + 30.0, y + 4.0], "", words);
        x += 30.0 + 6.6 * words.chars().count() as f64 + 18.0;
    };
    entry(picture, &mean_style(), if points > 1 { "mean as deployed" } else { "as deployed" });
    if let Some(words) = band {
        entry(picture, &format!("stroke=\"{MEAN}\" stroke-width=\"11\" stroke-opacity=\".18\""), words);
    }
    if points >= 3 {
        let words = if is_seeds { "each seed" } else { "each point" };
        entry(picture, &format!("stroke=\"{MEAN}\" stroke-width=\"1\" stroke-opacity=\".35\""), words);
    }
    if has_alone {
        entry(picture, &alone_style(), if points > 1 { "policy alone, mean" } else { "policy alone" });
    }
}

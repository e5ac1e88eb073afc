//! Learning curves by samples: several pipelines of one task in one picture, rounds of online ones and sizes of data
//! of offline ones, each with its band over models, the paper's mean and the best possible controller.

use std::collections::BTreeMap;

use super::{
    Band,
    svg::{INK, Picture},
};
use crate::{
    cli::table::{grid::field, render},
    num::stats,
    report::outcomes::{Outcome, without_samples},
};

const WIDTH: f64 = 920.0;
const HEIGHT: f64 = 430.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = WIDTH - 310.0;
const TOP: f64 = 52.0;
const BOTTOM: f64 = HEIGHT - 52.0;
const INSET: f64 = 14.0;

const COLOURS: [&str; 8] = ["#1f5fa8", "#c8641c", "#2c7a4b", "#8a3a8f", "#b23a48", "#5b5b9b", "#7a6a1f", "#2a8a8f"];
const CEILING: &str = "#444";

/// One pipeline of one task.
#[derive(Debug)]
pub(super) struct Curve {
    name: String,
    paper: Option<f64>,
    ceiling: Option<f64>,
    stage: String,
    pipeline: String,
    /// The other axes of its matrix.
    aside: String,
    identity: crate::digest::Digest,
    /// By number of samples, by seed.
    values: BTreeMap<u64, BTreeMap<u64, f64>>,
}

/// The curves of each task, by the name of the task. Outcomes come newest run first.
pub(super) fn curves(outcomes: &[Outcome]) -> BTreeMap<String, Vec<Curve>> {
    let mut tasks: BTreeMap<String, Vec<Curve>> = BTreeMap::new();
    for outcome in outcomes {
        let Some(value) = outcome.metrics.get("percent_goal") else { continue };
        let point = without_samples(outcome.point.clone());
        let identity =
            serde_json::json!([outcome.family, outcome.member.pipeline, outcome.member.labels, outcome.stage, point]);
        let identity = crate::digest::Digest::of_json(&identity);
        let all = tasks.entry(outcome.task_name()).or_default();
        let at = all.iter().position(|curve| curve.identity == identity).unwrap_or_else(|| {
            all.push(Curve::of(outcome, &point, identity));
            all.len() - 1
        });
        all[at].values.entry(outcome.samples).or_default().entry(outcome.seed).or_insert(*value);
    }
    for all in tasks.values_mut() {
        tell_apart(all);
    }
    tasks
}

impl Curve {
    fn of(outcome: &Outcome, point: &[(String, String)], identity: crate::digest::Digest) -> Self {
        Self {
            name: field(outcome, "algorithm"),
            paper: super::paper(&outcome.member),
            ceiling: outcome.ceiling,
            stage: outcome.stage.clone(),
            pipeline: outcome.member.pipeline.clone(),
            aside: point.iter().map(|(axis, value)| format!("{axis}={value}")).collect::<Vec<_>>().join(" "),
            identity,
            values: BTreeMap::new(),
        }
    }

    /// How many models there are where there are most.
    fn models(&self) -> usize {
        self.values.values().map(BTreeMap::len).max().unwrap_or(0)
    }

    /// Samples, mean, and the ends of the band.
    fn points(&self, band: Band) -> Vec<(f64, f64, [f64; 2])> {
        let point = |(samples, by_seed): (&u64, &BTreeMap<u64, f64>)| {
            let values: Vec<f64> = by_seed.values().copied().collect();
            let mean = stats::mean(&values);
            let ends = match band {
                _ if values.len() < 2 => [mean; 2],
                Band::Se => [-1.0, 1.0].map(|sign| mean + sign * stats::standard_error(&values)),
                Band::Ci => stats::interval(&values),
            };
            (*samples as f64, mean, ends)
        };
        self.values.iter().map(point).collect()
    }
}

/// Adds to the names of curves what tells equal ones apart.
fn tell_apart(curves: &mut [Curve]) {
    let parts: [fn(&Curve) -> String; 4] = [
        |curve| curve.stage.clone(),
        |curve| curve.pipeline.clone(),
        |curve| curve.aside.clone(),
        |curve| curve.identity.short(),
    ];
    for part in parts {
        let names: Vec<String> = curves.iter().map(|curve| curve.name.clone()).collect();
        let values: Vec<String> = curves.iter().map(part).collect();
        for at in 0..curves.len() {
            let is_rival = |other: &usize| *other != at && names[*other] == names[at];
            if (0..curves.len()).filter(is_rival).any(|other| values[other] != values[at]) && !values[at].is_empty() {
                curves[at].name = format!("{}, {}", names[at], values[at]);
            }
        }
    }
}

/// Draws the curves of a task.
pub(super) fn draw(task: &str, curves: &[Curve], band: Band) -> String {
    let lines: Vec<_> = curves.iter().map(|curve| curve.points(band)).collect();
    let ceiling = curves.iter().find_map(|curve| curve.ceiling);
    let marks = curves.iter().filter_map(|curve| curve.paper).chain(ceiling);
    let sheet = Sheet::over(&lines, marks);
    let mut picture = Picture::new(WIDTH, HEIGHT);
    picture.text(
        [LEFT, 28.0],
        "font-size=\"16\" font-weight=\"bold\"",
        &format!("{task}: time at the goal by samples"),
    );
    sheet.frame(&mut picture);
    let mut legend = Legend { y: TOP + 6.0 };
    if let Some(ceiling) = ceiling {
        let [_, y] = sheet.place(0.0, ceiling);
        let style = format!("stroke=\"{CEILING}\" stroke-width=\"1.2\"");
        picture.line(&[[LEFT, y], [RIGHT, y]], &style);
        legend.entry(&mut picture, &style, &format!("best possible controller {ceiling:.1}"));
    }
    for (at, (curve, points)) in curves.iter().zip(&lines).enumerate() {
        let colour = COLOURS[at % COLOURS.len()];
        line(&mut picture, &sheet, points, colour);
        let last = points.last().map_or(f64::NAN, |point| point.1);
        let count = curve.models();
        let models = if count == 1 { "1 seed".to_owned() } else { format!("{count} seeds") };
        let words = format!("{}: {} ({models})", curve.name, render::number(last));
        legend.entry(&mut picture, &format!("stroke=\"{colour}\" stroke-width=\"2.4\""), &words);
        if let Some(paper) = curve.paper {
            let style = format!("stroke=\"{colour}\" stroke-width=\"1.2\" stroke-dasharray=\"1.5 3\"");
            let [_, y] = sheet.place(0.0, paper);
            picture.line(&[[LEFT, y], [RIGHT, y]], &style);
            legend.entry(&mut picture, &style, &format!("the paper's mean {paper:.1}"));
        }
    }
    let words = if band == Band::Se { "bands: mean ± standard error" } else { "bands: 95 % bootstrap interval" };
    if curves.iter().any(|curve| curve.models() > 1) {
        picture.text([RIGHT + 16.0, legend.y + 8.0], &format!("fill=\"{INK}\""), words);
    }
    picture.end()
}

/// A band, a line and its dots; a single point has its band as a bar.
fn line(picture: &mut Picture, sheet: &Sheet, points: &[(f64, f64, [f64; 2])], colour: &str) {
    let side = |end: usize| points.iter().map(move |(x, _, ends)| sheet.place(*x, ends[end]));
    if let [only] = points {
        let ends = only.2.map(|end| sheet.place(only.0, end));
        picture.line(&ends, &format!("stroke=\"{colour}\" stroke-width=\"5\" stroke-opacity=\".3\""));
    } else {
        let outline: Vec<[f64; 2]> = side(0).chain(side(1).collect::<Vec<_>>().into_iter().rev()).collect();
        picture.area(&outline, &format!("fill=\"{colour}\" fill-opacity=\".16\""));
    }
    let mean: Vec<[f64; 2]> = points.iter().map(|(x, mean, _)| sheet.place(*x, *mean)).collect();
    picture.line(&mean, &format!("stroke=\"{colour}\" stroke-width=\"2.4\" stroke-linejoin=\"round\""));
    mean.iter().for_each(|place| picture.dot(*place, &format!("fill=\"{colour}\"")));
}

/// What lines mean, one below the other, to the right of the sheet.
struct Legend {
    y: f64,
}

impl Legend {
    fn entry(&mut self, picture: &mut Picture, style: &str, words: &str) {
        let x = RIGHT + 16.0;
        picture.line(&[[x, self.y], [x + 20.0, self.y]], style);
        // Long names go on below.
        let mut rest = words;
        while !rest.is_empty() {
            const FITS: usize = 34;
            let is_long = rest.chars().count() > FITS;
            let end = rest.char_indices().nth(FITS).filter(|_| is_long).map_or(rest.len(), |(at, _)| at);
            let end = if is_long { rest[..end].rfind(' ').unwrap_or(end) } else { end };
            picture.text([x + 26.0, self.y + 4.0], "", rest[..end].trim());
            rest = rest[end..].trim_start();
            self.y += 17.0;
        }
    }
}

/// Where samples and per cents lie.
struct Sheet {
    samples: [f64; 2],
    percent: [f64; 2],
}

impl Sheet {
    fn over(lines: &[Vec<(f64, f64, [f64; 2])>], marks: impl Iterator<Item = f64>) -> Self {
        let points = || lines.iter().flatten();
        let span = |values: &mut dyn Iterator<Item = f64>| {
            values.fold([f64::MAX, f64::MIN], |[low, high], value| [low.min(value), high.max(value)])
        };
        let [low, high] = span(&mut points().flat_map(|(_, mean, ends)| [*mean, ends[0], ends[1]]).chain(marks));
        let percent = [((low - 1.0) / 10.0).floor() * 10.0, ((high + 1.0) / 10.0).ceil() * 10.0];
        Self { samples: span(&mut points().map(|point| point.0)), percent: percent.map(|it| it.clamp(0.0, 100.0)) }
    }

    fn place(&self, samples: f64, percent: f64) -> [f64; 2] {
        let share = |[low, high]: [f64; 2], value: f64| if high > low { (value - low) / (high - low) } else { 0.5 };
        let x = LEFT + INSET + share(self.samples, samples) * (RIGHT - LEFT - 2.0 * INSET);
        [x, BOTTOM - share(self.percent, percent) * (BOTTOM - TOP)]
    }

    /// The grid, ticks and labels.
    fn frame(&self, picture: &mut Picture) {
        let [low, high] = self.percent;
        let step = if high - low > 60.0 { 20 } else { 10 };
        for percent in (low as u32..=high as u32).filter(|percent| percent % step == 0) {
            let [_, y] = self.place(0.0, f64::from(percent));
            picture.line(&[[LEFT, y], [RIGHT, y]], "stroke=\"#e8e8e8\"");
            picture.text([LEFT - 9.0, y + 4.0], "text-anchor=\"end\"", &percent.to_string());
        }
        for samples in ticks(self.samples) {
            let [x, _] = self.place(samples, low);
            picture.line(&[[x, BOTTOM], [x, BOTTOM + 5.0]], &format!("stroke=\"{INK}\""));
            picture.text([x, BOTTOM + 19.0], "text-anchor=\"middle\"", &format!("{samples:.0}"));
        }
        picture.line(&[[LEFT, TOP], [LEFT, BOTTOM], [RIGHT, BOTTOM]], &format!("stroke=\"{INK}\""));
        let middle = [f64::midpoint(LEFT, RIGHT), f64::midpoint(TOP, BOTTOM)];
        picture.text([middle[0], HEIGHT - 12.0], "text-anchor=\"middle\" font-size=\"13\"", "samples");
        let turned = format!("text-anchor=\"middle\" font-size=\"13\" transform=\"rotate(-90 18 {:.1})\"", middle[1]);
        picture.text([18.0, middle[1]], &turned, "states at the goal, %");
    }
}

/// Round numbers within a range, at most eight; the only number where there is one.
fn ticks([low, high]: [f64; 2]) -> Vec<f64> {
    if high <= low {
        return vec![low];
    }
    let steps = (0..9).flat_map(|power| [1.0, 2.0, 5.0].map(|digit| digit * f64::from(10_u32.pow(power))));
    let step = steps.into_iter().find(|step| (high - low) / step <= 7.0).unwrap_or(high - low);
    let first = (low / step).ceil() as u64;
    (first..).map(|at| at as f64 * step).take_while(|tick| *tick <= high).collect()
}

#[cfg(test)]
mod tests {
    use super::ticks;

    #[test]
    fn ticks_are_round_and_few() {
        assert_eq!(ticks([2048.0, 3072.0]), [2200.0, 2400.0, 2600.0, 2800.0, 3000.0]);
        assert_eq!(ticks([5000.0, 5000.0]), [5000.0]);
        assert_eq!(ticks([500.0, 5000.0]), [1000.0, 2000.0, 3000.0, 4000.0, 5000.0]);
    }
}

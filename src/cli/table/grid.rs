//! Series in rows and columns: by task, pipeline, a label, an axis of the matrix, the round or the number of samples.

use std::collections::BTreeSet;

use super::series::Series;
use crate::{
    cli::{exit::Error, file::nearest},
    report::outcomes::Outcome,
};

/// Names that rows and columns may always have.
const FIELDS: [&str; 8] = ["task", "algorithm", "pipeline", "member", "stage", "round", "samples", "seed"];

/// A table: names of rows and columns, and what lies in each cell.
#[derive(Debug)]
pub(crate) struct Grid {
    pub(crate) rows: Vec<String>,
    pub(crate) cols: Vec<String>,
    /// Row, column, series; at most one to a cell.
    pub(crate) cells: Vec<(usize, usize, Series)>,
}

impl Grid {
    /// Lays series out. Two that would share a cell get rows or columns of their own: nothing unlike is
    /// pooled.
    pub(crate) fn new(mut series: Vec<Series>, rows: &str, cols: &str) -> Result<Self, Error> {
        check(&series, rows)?;
        check(&series, cols)?;
        tell_apart(&mut series, rows, cols);
        let in_rows = aside_in_rows(rows, cols);
        let mut keyed: Vec<(String, String, Series)> = series
            .into_iter()
            .map(|it| {
                let (mut row, mut col) = (field(it.first(), rows), field(it.first(), cols));
                if in_rows { &mut row } else { &mut col }.push_str(&it.aside);
                (row, col, it)
            })
            .collect();
        keyed.sort_by_key(|it| order(rows, &it.0));
        let row_names = distinct(keyed.iter().map(|it| it.0.clone()));
        let mut col_names = distinct(keyed.iter().map(|it| it.1.clone()));
        if ["samples", "round", "seed", "task"].contains(&cols) {
            col_names.sort_by_key(|name| order(cols, name));
        }
        let place = |names: &[String], name: &str| names.iter().position(|it| it == name).unwrap_or(0);
        let cells = keyed.into_iter().map(|(row, col, it)| (place(&row_names, &row), place(&col_names, &col), it));
        let cells = cells.collect();
        Ok(Self { rows: row_names, cols: col_names, cells })
    }

    pub(crate) fn cell(&self, row: usize, col: usize) -> Option<&Series> {
        self.cells.iter().find(|it| (it.0, it.1) == (row, col)).map(|it| &it.2)
    }
}

/// What a row or column is called for an outcome.
pub(crate) fn field(outcome: &Outcome, name: &str) -> String {
    let label = || outcome.member.labels.get(name).cloned();
    let axis = || outcome.point.iter().find(|(axis, _)| axis == name).map(|(_, value)| value.clone());
    match name {
        "task" => outcome.task_name(),
        "pipeline" => outcome.member.pipeline.clone(),
        "member" => outcome.member.name.clone(),
        "stage" => outcome.stage.clone(),
        "round" => outcome.round.map_or_else(String::new, |round| round.to_string()),
        "samples" => outcome.samples.to_string(),
        "seed" => outcome.seed.to_string(),
        // A pipeline that does not say its algorithm stands for itself.
        "algorithm" => label().unwrap_or_else(|| outcome.member.pipeline.clone()),
        _ => label().or_else(axis).unwrap_or_default(),
    }
}

/// Tasks in the paper's order, numbers by size, all else as it came.
fn order(field: &str, name: &str) -> (u64, u64) {
    let tasks = ["planar", "swing_up", "cart_pole", "three_pole"];
    let number = || name.split(',').next().and_then(|it| it.parse().ok()).unwrap_or(u64::MAX);
    match field {
        "task" => (tasks.iter().position(|task| name.starts_with(task)).unwrap_or(tasks.len()) as u64, 0),
        "samples" | "round" | "seed" => (0, number()),
        _ => (0, 0),
    }
}

fn distinct(names: impl Iterator<Item = String>) -> Vec<String> {
    let mut known = Vec::new();
    for name in names {
        if !known.contains(&name) {
            known.push(name);
        }
    }
    known
}

fn check(series: &[Series], name: &str) -> Result<(), Error> {
    let outcomes = || series.iter().flat_map(|it| &it.outcomes);
    let labels = outcomes().flat_map(|it| it.member.labels.keys().map(String::as_str));
    let axes = outcomes().flat_map(|it| it.point.iter().map(|(axis, _)| axis.as_str()));
    let known: BTreeSet<&str> = FIELDS.into_iter().chain(labels).chain(axes).collect();
    if known.contains(name) {
        return Ok(());
    }
    let error = Error::usage(format!("nothing in these runs is called `{name}`"));
    Err(match nearest(name, known.iter().copied()) {
        Some(near) => error.help(format!("did you mean `{near}`?")),
        None => error.help(format!("there are {}", known.into_iter().collect::<Vec<_>>().join(", "))),
    })
}

/// Names what tells apart the series that would share a cell, part by part until nothing is left to tell.
fn tell_apart(series: &mut [Series], rows: &str, cols: &str) {
    let place = |it: &Series| (field(it.first(), rows), field(it.first(), cols), it.aside.clone());
    let other_labels = |it: &Outcome| {
        let others =
            it.member.labels.iter().filter(|(name, _)| !["algorithm", "paper", rows, cols].contains(&name.as_str()));
        others.map(|(_, value)| value.as_str()).collect::<Vec<_>>().join(" ")
    };
    let parts: [&dyn Fn(&Outcome) -> String; 8] = [
        &|it| it.stage.clone(),
        &other_labels,
        &|it| it.member.pipeline.clone(),
        &|it| it.point.iter().map(|(axis, value)| format!("{axis}={value}")).collect::<Vec<_>>().join(" "),
        &|it| field(it, "algorithm"),
        &|it| it.member.name.clone(),
        &|it| format!("run {}", it.run),
        &|it| it.recipe.short(),
    ];
    for part in parts {
        let places: Vec<_> = series.iter().map(place).collect();
        let words: Vec<String> = series.iter().map(|it| part(it.first())).collect();
        for at in 0..series.len() {
            let differs = |other: usize| places[other] == places[at] && words[other] != words[at];
            if !words[at].is_empty() && (0..series.len()).any(differs) {
                series[at].aside.push_str(&format!(", {}", words[at]));
            }
        }
    }
}

/// Whether what tells series apart is said in their rows; rows of tasks and numbers stay as they are.
fn aside_in_rows(rows: &str, cols: &str) -> bool {
    let is_plain = |name: &str| ["task", "round", "samples", "seed"].contains(&name);
    !is_plain(rows) || is_plain(cols)
}

//! Series in rows and columns: by task, pipeline, label, axis of the matrix, round or number of samples.

use std::collections::BTreeSet;

use crate::{
    env::registry,
    report::{
        outcomes::{Outcome, point_text},
        series::Series,
        tell_apart::suffixes,
    },
};

/// Fields that every table may have as rows or columns.
const FIELDS: [&str; 8] = ["task", "algorithm", "pipeline", "member", "stage", "round", "samples", "seed"];

/// A table: the names of rows and columns, and the series in its cells.
#[derive(Debug)]
pub struct Grid {
    /// Names of rows.
    pub rows: Vec<String>,
    /// Names of columns.
    pub cols: Vec<String>,
    /// The cells that hold a series.
    pub cells: Vec<Cell>,
}

/// One series at its place. No two cells share a place.
#[derive(Debug)]
pub struct Cell {
    /// The index of the row.
    pub row: usize,
    /// The index of the column.
    pub col: usize,
    /// The series.
    pub series: Series,
}

/// A name for rows or columns that no series has.
#[derive(Debug, thiserror::Error)]
#[error("nothing in these runs is called `{name}`")]
pub struct UnknownField {
    /// The name.
    pub name: String,
    /// The names that would be known.
    pub known: Vec<String>,
}

/// A series with the names of its row and its column.
struct Named {
    row: String,
    col: String,
    series: Series,
}

impl Grid {
    /// Lays series out. Two series that would share a cell get rows or columns of their own; they are never pooled.
    ///
    /// # Errors
    /// The name of rows or of columns is unknown.
    pub fn new(series: Vec<Series>, rows: &str, cols: &str) -> Result<Self, UnknownField> {
        check(&series, rows)?;
        check(&series, cols)?;
        let mut named = named(series, rows, cols);
        named.sort_by_key(|it| order(rows, &it.row));
        let row_names = distinct(named.iter().map(|it| &it.row));
        let mut col_names = distinct(named.iter().map(|it| &it.col));
        if ["samples", "round", "seed", "task"].contains(&cols) {
            col_names.sort_by_key(|name| order(cols, name));
        }
        let place = |names: &[String], name: &str| names.iter().position(|it| it == name).unwrap_or(0);
        let cells = named.into_iter().map(|it| Cell {
            row: place(&row_names, &it.row),
            col: place(&col_names, &it.col),
            series: it.series,
        });
        let cells = cells.collect();
        Ok(Self { rows: row_names, cols: col_names, cells })
    }

    /// The series at a place.
    pub fn at(&self, row: usize, col: usize) -> Option<&Series> {
        self.cells.iter().find(|cell| (cell.row, cell.col) == (row, col)).map(|cell| &cell.series)
    }
}

/// The value of a field of an outcome; empty where it has none.
pub fn field(outcome: &Outcome, name: &str) -> String {
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
        // A pipeline without this label is an algorithm of its own.
        "algorithm" => label().unwrap_or_else(|| outcome.member.pipeline.clone()),
        _ => label().or_else(axis).unwrap_or_default(),
    }
}

/// Names the place of every series. Where several would share a place, what differs is added to the name of the row, or
/// to the name of the column where rows are tasks or numbers.
fn named(series: Vec<Series>, rows: &str, cols: &str) -> Vec<Named> {
    let other_labels = |it: &Series| {
        let labels = it.first().member.labels.iter();
        let others =
            labels.filter(|(name, _)| !["algorithm", "paper", "additions", rows, cols].contains(&name.as_str()));
        others.map(|(_, value)| value.as_str()).collect::<Vec<_>>().join(" ")
    };
    let parts: [&dyn Fn(&Series) -> String; 8] = [
        &|it| it.first().stage.clone(),
        &other_labels,
        &|it| it.first().member.pipeline.clone(),
        &|it| point_text(&it.first().point),
        &|it| field(it.first(), "algorithm"),
        &|it| it.first().member.name.clone(),
        &|it| format!("run {}", it.first().run),
        &|it| it.first().recipe.short(),
    ];
    let place = |it: &Series| (field(it.first(), rows), field(it.first(), cols));
    let suffixes = suffixes(&series, place, &parts);
    let is_plain = |name: &str| ["task", "round", "samples", "seed"].contains(&name);
    let in_rows = !is_plain(rows) || is_plain(cols);
    let name = |(series, suffix): (Series, String)| {
        let (mut row, mut col) = (field(series.first(), rows), field(series.first(), cols));
        if in_rows { &mut row } else { &mut col }.push_str(&suffix);
        Named { row, col, series }
    };
    series.into_iter().zip(suffixes).map(name).collect()
}

/// A sort key: tasks in the paper's order, numbers by size, all else in the order in which it comes.
fn order(field: &str, name: &str) -> u64 {
    let number = || name.split(',').next().and_then(|it| it.parse().ok()).unwrap_or(u64::MAX);
    match field {
        "task" => registry().iter().position(|task| name.starts_with(task.name)).map_or(u64::MAX, |at| at as u64),
        "samples" | "round" | "seed" => number(),
        _ => 0,
    }
}

fn distinct<'a>(names: impl Iterator<Item = &'a String>) -> Vec<String> {
    let mut known: Vec<String> = Vec::new();
    for name in names {
        if !known.contains(name) {
            known.push(name.clone());
        }
    }
    known
}

fn check(series: &[Series], name: &str) -> Result<(), UnknownField> {
    let outcomes = || series.iter().flat_map(|it| &it.outcomes);
    let labels = outcomes().flat_map(|it| it.member.labels.keys().map(String::as_str));
    let axes = outcomes().flat_map(|it| it.point.iter().map(|(axis, _)| axis.as_str()));
    let known: BTreeSet<&str> = FIELDS.into_iter().chain(labels).chain(axes).collect();
    if known.contains(name) {
        return Ok(());
    }
    Err(UnknownField { name: name.to_owned(), known: known.into_iter().map(str::to_owned).collect() })
}

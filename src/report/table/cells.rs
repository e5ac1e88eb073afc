//! A table as rows of text cells: one cell for each series, or Markdown.

use super::{About, Grid};
use crate::report::numbers::mean;

/// A table as text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rows {
    /// The names of the columns.
    pub header: Vec<String>,
    /// The rows, each as wide as the header.
    pub body: Vec<Vec<String>>,
}

impl Rows {
    /// A Markdown table.
    pub fn markdown(&self) -> String {
        let line = |row: &Vec<String>| {
            let cells: Vec<String> = row.iter().map(|cell| cell.trim().replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let rule = format!("|{}\n", "---|".repeat(self.header.len()));
        [line(&self.header), rule].into_iter().chain(self.body.iter().map(line)).collect()
    }
}

/// The means of a grid. The paper's numbers stand below ours, where a pipeline is labelled with them.
pub fn short(grid: &Grid, about: About<'_>) -> Rows {
    let header = std::iter::once(about.rows.to_owned()).chain(grid.cols.iter().cloned()).collect();
    let mut body = Vec::new();
    for (row, name) in grid.rows.iter().enumerate() {
        let cells = || (0..grid.cols.len()).map(|col| grid.at(row, col));
        let means = cells().map(|cell| cell.map_or_else(String::new, |it| mean(it.estimate())));
        body.push(std::iter::once(name.clone()).chain(means).collect());
        let papers = cells().map(|cell| cell.and_then(|it| it.label("paper")).unwrap_or_default().to_owned());
        let papers: Vec<String> = papers.collect();
        if about.is_percent_goal() && papers.iter().any(|paper| !paper.is_empty()) {
            body.push(std::iter::once("  the paper's".to_owned()).chain(papers).collect());
        }
    }
    Rows { header, body }
}

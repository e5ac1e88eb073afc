//! The headline of a run: whatever metric its final stages declare, where they differ by their seeds alone.

use carl_pipe::{
    report::headline::{Headline, headline},
    run::{execute::Report, manifest::Manifest},
};
use serde_json::json;

use crate::support::run::{Bench, chain, graph, kinds};

fn of(report: &Report) -> Option<Headline> {
    headline(&Manifest::read(&report.path).unwrap(), kinds())
}

#[test]
fn a_run_has_the_headline_that_its_kind_declares() {
    let bench = Bench::new();
    let (report, _) = bench.run(&graph(&[("a", json!({"plus": 7}), &[])]));
    assert_eq!(of(&report), Some(Headline { metric: "total", mean: 7.0, models: 1 }));
}

#[test]
fn stages_that_measure_unlike_things_have_no_mean() {
    let bench = Bench::new();
    assert_eq!(of(&bench.run(&chain(1)).0), None);
}

#[test]
fn seeds_of_one_stage_are_averaged() {
    let bench = Bench::new();
    let mut seeds = graph(&[("a", json!({"plus": 7}), &[]), ("b", json!({"plus": 8}), &[])]);
    for (node, seed) in seeds.nodes.iter_mut().zip(["0", "1"]) {
        node.stage = "measure".to_owned();
        node.point = vec![("seed".to_owned(), seed.to_owned())];
    }
    assert_eq!(of(&bench.run(&seeds).0), Some(Headline { metric: "total", mean: 7.5, models: 2 }));
    seeds.nodes[1].point.push(("a.plus".to_owned(), "8".to_owned()));
    assert_eq!(of(&bench.run(&seeds).0), None);
}

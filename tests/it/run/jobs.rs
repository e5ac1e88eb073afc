//! A job is plain data: another process can read it and gets the same result.

use std::{fs, sync::atomic::AtomicBool};

use crate::support::run::{Bench, chain, damage, graph, kind, record};
use carl_pipe::{
    run::{
        events::Events,
        execute::{JobOutcome, RunContext, Worker},
        job::{Job, JobInput},
    },
    store::{Entry, ResultStore as _},
};
use serde_json::json;

/// A store that has the output of `a`, and the job of `b` in the text of JSON.
fn written_job(bench: &Bench) -> (Entry, String) {
    let (report, _) = bench.run(&graph(&[("a", json!({"plus": 1}), &[])]));
    let key = record(&report, "a").outcome.key.unwrap();
    let input = bench.store.entry(key).unwrap().unwrap();
    let job = Job::of(&chain(1).nodes[1], vec![vec![JobInput::from(&input)]], 2);
    (input, serde_json::to_string(&job).unwrap())
}

fn perform(bench: &Bench, job: &Job) -> JobOutcome {
    let run_dir = bench.path("elsewhere");
    fs::create_dir_all(run_dir.join("live")).unwrap();
    let (events, stop) = (Events::create(&run_dir, &()).unwrap(), AtomicBool::new(false));
    let kinds = [kind("add").unwrap()];
    let context = RunContext {
        store: &bench.store,
        kinds: &kinds,
        run: "elsewhere",
        run_dir: &run_dir,
        events: &events,
        stop: &stop,
    };
    Worker::new(context, 2).perform(job)
}

#[test]
fn a_job_that_was_written_down_gives_the_same_key_and_digest() {
    let (here, there) = (Bench::new(), Bench::new());
    let (report, _) = here.run(&chain(1));
    let (_, text) = written_job(&there);
    let job: Job = serde_json::from_str(&text).unwrap();
    assert_eq!(serde_json::to_string(&job).unwrap(), text);
    let JobOutcome::Published(published) = perform(&there, &job) else { panic!("not published") };
    let expected = &record(&report, "b").outcome;
    assert_eq!((Some(published.entry.key_digest), Some(published.entry.output)), (expected.key, expected.output));
    assert_eq!(published.entry.recording.map(|recording| recording.messages), expected.recording);
}

#[test]
fn a_damaged_input_names_the_key_that_made_it() {
    let bench = Bench::new();
    let (input, text) = written_job(&bench);
    damage(&bench.store.path_of(input.files[0].object).unwrap());
    let outcome = perform(&bench, &serde_json::from_str(&text).unwrap());
    let JobOutcome::DamagedInput { made_by, problem } = outcome else { panic!("{outcome:?}") };
    assert_eq!((made_by, problem.as_str()), (input.key_digest, "its number.txt is damaged"));
}

#[test]
fn a_job_of_an_unknown_version_fails_and_publishes_nothing() {
    let bench = Bench::new();
    let (_, text) = written_job(&bench);
    let mut job: Job = serde_json::from_str(&text).unwrap();
    job.work.version = 7;
    let outcome = perform(&bench, &job);
    let JobOutcome::Failed(failure) = outcome else { panic!("{outcome:?}") };
    assert_eq!(failure.text(), "this carl-pipe has no kind `add` of version 7");
    assert!(bench.store.entry(job.key().digest).unwrap().is_none());
}

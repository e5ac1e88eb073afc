//! The view of a whole run as a Rerun file.
//!
//! To look at it: `CARL_SAMPLE=sample cargo test -p carl-view rerun_file`, then `rerun sample/run.rrd`.

#![allow(clippy::disallowed_methods, reason = "tests wait and measure")]

use std::{cell::RefCell, path::PathBuf, time::Instant};

use carl_pipe::cli::Sink;
use carl_view::{RerunViewer, ViewHost, Viewer as _, open};

use crate::sample_run;

/// Keeps what the view says.
#[derive(Default)]
struct Notes(RefCell<Vec<String>>);

impl ViewHost for Notes {
    fn should_stop(&self) -> bool {
        false
    }
    fn run_is_alive(&self) -> bool {
        false
    }
    fn note(&self, text: &str) {
        self.0.borrow_mut().push(text.to_owned());
    }
}

#[test]
fn a_run_becomes_a_rerun_file() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = std::env::var_os("CARL_SAMPLE").map_or(temporary.path().to_owned(), PathBuf::from);
    sample_run::write_run(&folder, 30);
    let (notes, path) = (Notes::default(), folder.join("run.rrd"));
    let mut viewer = RerunViewer::open(&Sink::Save { path: path.clone() }, &notes).unwrap();
    open(&[folder], &mut viewer, &notes).unwrap();
    viewer.close(&notes).unwrap();
    assert!(notes.0.borrow()[0].starts_with("wrote "), "{:?}", notes.0);
    assert!(std::fs::metadata(path).unwrap().len() > 100_000);
}

#[test]
fn a_dead_address_is_an_error_at_once() {
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let started = Instant::now();
    let sink: Sink = format!("connect=127.0.0.1:{port}").parse().unwrap();
    let error = RerunViewer::open(&sink, &Notes::default()).unwrap_err();
    assert!(error.to_string().contains("pip install rerun-sdk==0.36.3"), "{error}");
    assert!(started.elapsed().as_secs() < 5);
}

#[test]
fn a_file_that_cannot_be_written_is_named_with_its_cause() {
    let sink = Sink::Save { path: PathBuf::from("/nowhere/run.rrd") };
    let error = RerunViewer::open(&sink, &Notes::default()).unwrap_err();
    assert_eq!(format!("{error:#}"), "cannot write /nowhere/run.rrd: No such file or directory (os error 2)");
}

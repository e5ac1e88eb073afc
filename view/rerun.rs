//! The Rerun view of a whole run, as a file.
//!
//! To look at it: `CARL_SAMPLE=sample cargo test --test record_rerun`, then `rerun sample/run.rrd`.

#![allow(clippy::disallowed_methods, reason = "tests wait and measure")]
#![cfg(feature = "rerun")]

use crate::support::recording;
use std::{cell::RefCell, path::PathBuf, time::Instant};

use carl_pipe::record::{Sink, Watcher, follow, open};

#[derive(Default)]
struct Quiet(RefCell<Vec<String>>);

impl Watcher for Quiet {
    fn stop(&self) -> bool {
        false
    }
    fn alive(&self) -> bool {
        false
    }
    fn say(&self, text: &str) {
        self.0.borrow_mut().push(text.to_owned());
    }
}

#[test]
fn a_run_becomes_a_rerun_file() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = std::env::var_os("CARL_SAMPLE").map_or(temporary.path().to_owned(), PathBuf::from);
    recording::write_run(&folder, 30);
    let (quiet, path) = (Quiet::default(), folder.join("run.rrd"));
    open(&[folder], &Sink::Save { path: path.clone() }, &quiet).unwrap();
    assert!(quiet.0.borrow()[0].starts_with("wrote "), "{:?}", quiet.0);
    assert!(std::fs::metadata(path).unwrap().len() > 100_000);
}

#[test]
fn a_dead_address_is_an_error_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let started = Instant::now();
    let sink: Sink = format!("connect=127.0.0.1:{port}").parse().unwrap();
    let error = follow(folder.path(), &sink, &Quiet::default()).unwrap_err();
    assert!(error.to_string().contains("pip install rerun-sdk==0.36.3"), "{error}");
    assert!(started.elapsed().as_secs() < 5);
}

//! The program as a process, and what it finds in a store.

use std::{cell::Cell, ffi::OsString, fs, fs::OpenOptions, path::Path, process::Command};

use carl_pipe::{cli, record::Message, stage};
use carl_view::{Position, ViewHost, Viewer, open};

fn carl_view(words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_carl-view"));
    command.args(words);
    command
}

#[test]
fn help_that_cannot_be_written_is_exit_code_4_and_a_closed_pipe_is_fine() {
    for word in ["--help", "--version"] {
        let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
        let lost = carl_view(&[word]).stdout(full).output().unwrap();
        let err = String::from_utf8(lost.stderr).unwrap();
        assert_eq!(lost.status.code(), Some(4), "{err}");
        assert!(err.contains("error: cannot write to standard output: No space left on device"), "{err}");
        let closed =
            Command::new("sh").args(["-c", "\"$0\" \"$1\" | :", env!("CARGO_BIN_EXE_carl-view"), word]).output();
        assert_eq!(closed.unwrap().stderr, b"");
    }
    assert_eq!(carl_view(&["--rerun", "nowhere"]).output().unwrap().status.code(), Some(2));
}

/// Counts what it is shown.
#[derive(Default)]
struct Count(Cell<usize>);

impl Viewer for Count {
    fn title(&mut self, _: &str) -> anyhow::Result<()> {
        Ok(())
    }
    fn show(&mut self, _: &Position, _: &Message) -> anyhow::Result<()> {
        self.0.set(self.0.get() + 1);
        Ok(())
    }
    fn close(&mut self, _: &dyn ViewHost) -> anyhow::Result<()> {
        Ok(())
    }
}

struct Quiet;

impl ViewHost for Quiet {
    fn should_stop(&self) -> bool {
        false
    }
    fn run_is_alive(&self) -> bool {
        false
    }
    fn note(&self, text: &str) {
        panic!("{text}");
    }
}

fn shown(run_dir: &Path) -> usize {
    let mut count = Count::default();
    open(&[run_dir.to_owned()], &mut count, &Quiet).unwrap();
    count.0.get()
}

#[test]
fn a_recording_that_the_run_leads_to_no_more_is_found_in_the_store() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("p.toml");
    let text = "schema = 1\nname = \"p\"\n[task]\nenv = \"planar\"\n[stages.evaluate]\nkind = \"evaluate\"\n\
                controller = \"oracle\"\nepisodes = 1\n";
    fs::write(&file, text).unwrap();
    let store = folder.path().join("store");
    let words = ["carl-pipe".as_ref(), "run".as_ref(), file.as_os_str(), "-q".as_ref(), "--artifacts".as_ref()];
    let argv: Vec<OsString> = words.into_iter().chain([store.as_os_str()]).map(OsString::from).collect();
    assert_eq!(cli::main(&argv, stage::registry()), 0);
    let run_dir = store.join("runs/latest");
    let whole = shown(&run_dir);
    fs::remove_file(run_dir.join("evaluate.mcap")).unwrap();
    assert_eq!(shown(&run_dir), whole);
    assert!(whole > 5);
}

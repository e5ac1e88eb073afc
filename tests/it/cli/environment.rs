//! The program in bad surroundings: output that cannot be written, signals that are ignored, terminals that can do
//! little, texts that hold control characters, folders that are gone.

use std::{
    ffi::OsString,
    fs::{self, File, OpenOptions},
    io::{BufRead as _, BufReader},
    os::unix::ffi::OsStringExt as _,
    path::Path,
    process::{Child, Command, Stdio},
};

use crate::support::cli::{Ended, Toy, on_terminal, stop_signal};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;

/// The real program in a folder with the smoke pipeline.
fn carl_pipe(folder: &Path, words: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_carl-pipe"));
    command.args(words.split_whitespace()).current_dir(folder).env_remove("CARL_ARTIFACTS").stdin(Stdio::null());
    command
}

fn smoke() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::copy("pipelines/smoke.toml", folder.path().join("smoke.toml")).unwrap();
    folder
}

fn full_disk() -> File {
    OpenOptions::new().write(true).open("/dev/full").unwrap()
}

#[test]
fn output_that_cannot_be_written_is_exit_code_4_for_every_verb() {
    let folder = smoke();
    let lost = |words: &str| {
        let output = carl_pipe(folder.path(), words).stdout(full_disk()).output().unwrap();
        let err = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(4), "{words}: {err}");
        assert!(err.contains("error: cannot write to standard output: No space left on device"), "{words}: {err}");
    };
    lost("run smoke.toml");
    // The nodes are finished all the same.
    let again = carl_pipe(folder.path(), "run smoke.toml --json").output().unwrap();
    assert_eq!(Ended::of(again).json()["executed"], json!(0));
    for words in [
        "run smoke.toml --json",
        "run smoke.toml -n",
        "status smoke.toml",
        "status smoke.toml -S seed=7 --json",
        "why smoke.toml evaluate@0",
        "dag smoke.toml",
        "stages",
        "stages --json",
        "log",
        "show latest",
        "table latest",
        "table latest --format csv",
        "compare latest latest",
        "plot latest -o pictures",
        "replay latest -q",
        "gc -n",
        "verify",
        "doctor",
        "du",
        "pin latest",
        "completions bash",
        "--help",
        "run --help",
        "--version",
    ] {
        lost(words);
    }
}

#[test]
fn a_reader_that_closes_the_pipe_is_no_failure() {
    let folder = smoke();
    let mut child = carl_pipe(folder.path(), "stages").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(0), &b""[..]));
}

/// A command that a shell starts after `before`.
fn in_shell(before: &str, command: &Command) -> Command {
    let mut shell = Command::new("sh");
    shell.arg("-c").arg(format!("{before}; exec \"$0\" \"$@\"")).arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => shell.env(name, value),
            None => shell.env_remove(name),
        };
    }
    shell.current_dir(command.get_current_dir().unwrap()).stdin(Stdio::null());
    shell.stdout(Stdio::piped()).stderr(Stdio::piped());
    shell
}

/// Sends a signal to a run once it works on `learn@1`, and waits for its end.
fn signalled(mut child: Child, signal: Signal) -> (Option<i32>, serde_json::Value) {
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    lines.find(|line| line.contains(r#""event":"progress","node":"learn@1""#)).unwrap();
    kill_process(Pid::from_child(&child), signal).unwrap();
    let last = serde_json::from_str(&lines.last().unwrap()).unwrap();
    (child.wait().unwrap().code(), last)
}

#[test]
fn a_signal_that_is_ignored_at_the_start_stays_ignored() {
    let toy = Toy::new();
    let command = toy.command("run toy.toml -S learn.steps=60 --json");
    let (code, end) = signalled(in_shell("trap '' HUP", &command).spawn().unwrap(), Signal::HUP);
    assert_eq!((code, &end["state"]), (Some(0), &json!("finished")));
    let command = toy.command("run toy.toml -S learn.steps=61 --json");
    let (code, end) = signalled(in_shell(":", &command).spawn().unwrap(), stop_signal());
    assert_eq!((code, &end["state"]), (Some(130), &json!("interrupted")));
}

#[test]
fn a_terminal_that_can_do_nothing_gets_lines_without_colours() {
    let toy = Toy::new();
    let on_terminal = |set: &[(&str, &str)], words: &str| {
        let output = on_terminal(&toy.command(words)).envs(set.iter().copied()).output();
        output.ok().map(|output| String::from_utf8_lossy(&output.stdout).into_owned())
    };
    let Some(usual) = on_terminal(&[("TERM", "xterm")], "run toy.toml -S learn.steps=50") else {
        eprintln!("skipped: there is no `script`");
        return;
    };
    assert!(usual.contains('\u{1b}'), "{usual}");
    let dumb = on_terminal(&[("TERM", "dumb")], "run toy.toml -S learn.steps=51");
    let dumb = dumb.unwrap();
    assert!(!dumb.contains('\u{1b}') && dumb.contains("learn@1  ran in "), "{dumb}");
    for set in [("NO_COLOR", "1"), ("CLICOLOR", "0")] {
        let plain = on_terminal(&[("TERM", "xterm"), set], "log").unwrap();
        assert!(!plain.contains('\u{1b}') && plain.contains("finished"), "{plain}");
    }
}

/// A pipeline whose every free text holds control characters.
const HOSTILE: &str = r#"schema = 1
name = "hostile"
description = "cleared\u001B[2J\u009B31m and\nbroken \u202Eback\u0007"

[task]
env = "planar"

[labels]
algorithm = "red\u001B[31m\nrow\u202E"
paper = "1\t2\u0000"

[stages.data]
kind = "toy_number"

[stages.evaluate]
kind = "toy_evaluate"
inputs = { number = "data" }

[stages.bad]
kind = "toy_number"
fail = "\u001B]0;title\u0007\nboom"
"#;

fn assert_harmless(words: &str, text: &str) {
    let hidden = text.chars().find(|c| carl_pipe::diag::is_hidden(*c) && *c != '\n');
    assert_eq!(hidden, None, "{words}: {text:?}");
}

#[test]
fn control_characters_of_texts_never_reach_a_terminal() {
    let toy = Toy::new();
    fs::write(toy.path("hostile.toml"), HOSTILE).unwrap();
    let mut out_of_table = String::new();
    for words in [
        "run hostile.toml -k --color always",
        "run hostile.toml -k --json --note \u{1b}[31mred\u{9b}\u{202e}",
        "run hostile.toml -k -v --progress plain",
        "status hostile.toml",
        "why hostile.toml data -v",
        "dag hostile.toml --expand",
        "show latest -v",
        "log -v",
        "log --json",
        "du",
        "verify",
        "doctor",
        "table latest",
        "table latest --format markdown",
        "table latest --format json",
        "table latest --format csv",
        "compare latest latest",
    ] {
        let ended = toy.run(words);
        let expected = if words.starts_with("run") { [1, 1] } else { [0, 10] };
        assert!(expected.contains(&ended.code.unwrap()), "{words}: {ended:?}");
        if words.ends_with("--format json") {
            serde_json::from_str::<serde_json::Value>(&ended.out).unwrap();
        }
        if words == "table latest" {
            out_of_table.clone_from(&ended.out);
        }
        let without_styles = |text: &str| anstream::adapter::strip_str(text).to_string();
        let shown = if words.contains("always") { without_styles(&ended.out) } else { ended.out };
        assert_harmless(words, &shown);
        assert_harmless(words, &without_styles(&ended.err));
    }
    assert_eq!(out_of_table.lines().count(), 3, "{out_of_table}");
    // What a user types comes back in messages.
    let typed = Command::new(env!("CARGO_BIN_EXE_carl-pipe")).args(["show", "\u{1b}[31mx\n"]).output().unwrap();
    assert_harmless("show", std::str::from_utf8(&typed.stderr).unwrap());
    let typed = Command::new(env!("CARGO_BIN_EXE_carl-pipe")).arg("\u{1b}[2J\u{9b}").output().unwrap();
    assert_harmless("clap", std::str::from_utf8(&typed.stderr).unwrap());
}

#[test]
fn a_folder_in_the_way_of_latest_is_a_warning() {
    let toy = Toy::new();
    toy.run("run toy.toml data");
    fs::remove_file(toy.path("artifacts/runs/latest")).unwrap();
    fs::create_dir_all(toy.path("artifacts/runs/latest/kept")).unwrap();
    let ended = toy.run("run toy.toml --json");
    assert_eq!((ended.code, &ended.json()["executed"]), (Some(0), &json!(6)), "{ended:?}");
    assert_eq!(ended.err.matches("warning:").count(), 1, "{ended:?}");
    assert!(ended.err.contains("cannot point artifacts/runs/latest to 20"), "{ended:?}");
    assert!(toy.path("artifacts/runs/latest/kept").exists());
}

#[test]
fn strange_surroundings_give_errors_and_no_panic() {
    let folder = smoke();
    let ends_well = |mut command: Command| {
        let output = command.output().unwrap();
        let err = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code().is_some_and(|code| code <= 10), "{command:?}: {err}");
        assert!(!err.contains("panicked") && !err.contains("mistake in carl-pipe"), "{command:?}: {err}");
    };
    for verb in
        ["log", "show", "status smoke.toml", "run smoke.toml -n", "gc -n", "table", "plot", "view", "run x.toml"]
    {
        ends_well(in_shell("mkdir gone && cd gone && rmdir ../gone", &carl_pipe(folder.path(), verb)));
        let mut homeless = carl_pipe(folder.path(), verb);
        homeless.env_clear();
        ends_well(homeless);
        let mut foreign = carl_pipe(folder.path(), verb);
        foreign.arg(OsString::from_vec(b"\xff\xfe".to_vec()));
        ends_well(foreign);
        let mut foreign = carl_pipe(folder.path(), verb);
        foreign.arg("--artifacts").arg(OsString::from_vec(b"store-\xff".to_vec()));
        ends_well(foreign);
        for closed in ["exec >&-", "exec 2>&-", "exec >&- 2>&- <&-"] {
            ends_well(in_shell(closed, &carl_pipe(folder.path(), verb)));
        }
    }
}

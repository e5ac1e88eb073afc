//! `carl-pipe` finds `carl-view`, checks its version and starts it. A script stands in for `carl-view`.

use std::{fs, os::unix::fs::PermissionsExt as _};

use crate::support::cli::{Ended, Toy};

/// Runs the toy program with a folder on the PATH whose `carl-view` is this shell script; `None` for no such program.
fn run(toy: &Toy, words: &str, script: Option<&str>) -> Ended {
    let folder = toy.path("bin");
    fs::create_dir_all(&folder).unwrap();
    if let Some(script) = script {
        let program = folder.join("carl-view");
        fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    }
    Ended::of(toy.command(words).env("PATH", &folder).output().unwrap())
}

/// A `carl-view` of this version that does `action` when it is asked to show something.
fn view_that(action: &str) -> String {
    format!("[ \"$1\" = --version ] && echo carl-view {} && exit 0\n{action}", carl_pipe::cli::VERSION)
}

#[test]
fn a_missing_view_is_an_error_that_names_the_command_to_build_it() {
    let toy = Toy::new();
    let ended = run(&toy, "run toy.toml --rerun spawn", None);
    assert_eq!(ended.code, Some(4), "{ended:?}");
    assert!(ended.err.contains("`carl-view`, which is neither beside `carl-pipe` nor on the PATH"), "{}", ended.err);
    assert!(ended.err.contains("help: build it with `cargo install --path view`"), "{}", ended.err);
    assert_eq!(fs::read_dir(toy.path("artifacts/runs")).map_or(0, Iterator::count), 0, "a run began");
    assert_eq!(run(&toy, "run toy.toml --quiet", None).code, Some(0));
    let ended = run(&toy, "view latest", None);
    assert_eq!(ended.code, Some(4), "{ended:?}");
    assert!(ended.err.contains("help: build it with"), "{}", ended.err);
}

#[test]
fn a_view_of_another_version_is_refused_before_the_run_begins() {
    let toy = Toy::new();
    let ended = run(&toy, "run toy.toml --rerun spawn", Some("echo carl-view 0.0.7"));
    assert_eq!(ended.code, Some(4), "{ended:?}");
    let text = format!("has version 0.0.7, but `carl-pipe` has version {}", carl_pipe::cli::VERSION);
    assert!(ended.err.contains(&text), "{}", ended.err);
    assert!(ended.err.contains("help: build it again with"), "{}", ended.err);
}

#[test]
fn a_live_view_that_dies_is_one_warning() {
    let toy = Toy::new();
    let script = view_that("echo error: no screen >&2; exit 4");
    let ended = run(&toy, "run toy.toml --rerun save=x.rrd --progress plain", Some(&script));
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(ended.err.matches("warning:").count(), 1, "{}", ended.err);
    assert!(ended.err.contains("the live view ended: no screen; the run goes on"), "{}", ended.err);
}

#[test]
fn a_run_starts_a_view_that_follows_it() {
    let toy = Toy::new();
    let script = view_that("echo \"$*\" > seen");
    let ended = run(&toy, "run toy.toml --rerun save=x.rrd --quiet", Some(&script));
    assert_eq!((ended.code, ended.err.as_str()), (Some(0), ""), "{ended:?}");
    let latest = fs::read_link(toy.path("artifacts/runs/latest")).unwrap();
    let arguments = format!("--rerun save=x.rrd --follow -- artifacts/runs/{}\n", latest.display());
    assert_eq!(fs::read_to_string(toy.path("seen")).unwrap(), arguments);
}

#[test]
fn the_view_verb_passes_its_arguments_on_and_keeps_the_exit_code() {
    let toy = Toy::new();
    toy.run("run toy.toml --quiet");
    fs::copy(toy.path("artifacts/runs/latest/learn@1.mcap"), toy.path("a.mcap")).unwrap();
    let script = view_that("echo \"$*\"; exit 9");
    let ended = run(&toy, "view a.mcap --rerun connect=desk", Some(&script));
    assert_eq!((ended.code, ended.out.as_str()), (Some(9), "--rerun connect=rerun+http://desk:9876/proxy -- a.mcap\n"));
    let ended = run(&toy, "view --follow --rerun serve=80", Some(&script));
    assert_eq!(ended.code, Some(9));
    assert!(ended.out.starts_with("--rerun serve=80 --follow -- artifacts/runs/"), "{}", ended.out);
}

#[test]
fn mistakes_in_the_arguments_of_view_are_found_before_it_starts() {
    let toy = Toy::new();
    toy.run("run toy.toml --quiet");
    let script = view_that("echo started");
    for (words, mistake) in [
        ("view latest --rerun spwan", "`spwan` is none of"),
        ("view nonesuch", "no run is called `nonesuch`"),
        ("view latest latest --follow", "`--follow` takes one run"),
    ] {
        let ended = run(&toy, words, Some(&script));
        assert_eq!((ended.code, ended.out.as_str()), (Some(2), ""), "{ended:?}");
        assert!(ended.err.contains(mistake), "{}", ended.err);
    }
}

#[test]
fn a_file_that_is_no_recording_is_named_before_the_view_starts() {
    let toy = Toy::new();
    toy.run("run toy.toml --quiet");
    let recording = toy.path("artifacts/runs/latest/learn@1.mcap");
    let bytes = fs::read(&recording).unwrap();
    let script = view_that("echo started");
    fs::write(toy.path("text.mcap"), "this is no recording").unwrap();
    fs::write(toy.path("empty.mcap"), "").unwrap();
    fs::write(toy.path("begun.mcap"), &bytes[..8]).unwrap();
    let mut damaged = bytes.clone();
    for at in 300..bytes.len() - 40 {
        damaged[at] ^= 0x55;
    }
    fs::write(toy.path("damaged.mcap"), damaged).unwrap();
    let foreign = fs::File::create(toy.path("foreign.mcap")).unwrap();
    let mut writer = mcap::Writer::new(std::io::BufWriter::new(foreign)).unwrap();
    let schema = writer.add_schema("other.Type", "jsonschema", b"{}").unwrap();
    let channel_id = writer.add_channel(schema, "/other", "json", &Default::default()).unwrap();
    let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    drop(writer);
    for (file, why) in [
        ("text", "it is not an MCAP file"),
        ("empty", "it is not an MCAP file"),
        ("begun", "it holds no message"),
        ("damaged", "it is a damaged recording: "),
        ("foreign", "it is an MCAP file without carl-pipe's schemas"),
    ] {
        let ended = run(&toy, &format!("view {file}.mcap"), Some(&script));
        assert_eq!((ended.code, ended.out.as_str()), (Some(2), ""), "{ended:?}");
        assert!(ended.err.contains(&format!("cannot show {file}.mcap: {why}")), "{}", ended.err);
    }
    // Where some can be shown, the view starts; it names the others.
    let ended = run(&toy, "view text.mcap artifacts/runs/latest/learn@1.mcap", Some(&script));
    assert_eq!((ended.code, ended.out.as_str()), (Some(0), "started\n"), "{ended:?}");
    let ended = run(&toy, "view text.mcap --follow", Some(&script));
    assert!(ended.err.contains("`--follow` takes one run"), "{ended:?}");
}

#[test]
fn an_output_that_is_an_input_is_refused() {
    let toy = Toy::new();
    toy.run("run toy.toml --quiet");
    let script = view_that("echo started");
    let latest = "artifacts/runs/latest";
    std::os::unix::fs::symlink("toy.toml", toy.path("soft")).unwrap();
    fs::hard_link(toy.path("toy.toml"), toy.path("hard")).unwrap();
    std::os::unix::fs::symlink(format!("{latest}/learn@1.mcap"), toy.path("percent_goal.svg")).unwrap();
    let before = fs::read(toy.path("percent_goal.svg")).unwrap();
    for words in [
        "run toy.toml --rerun save=toy.toml".to_owned(),
        "run toy.toml --rerun save=soft".to_owned(),
        "run toy.toml --rerun save=hard".to_owned(),
        format!("view latest --rerun save={latest}/manifest.json"),
        format!("view latest --rerun save={latest}/learn@1.mcap"),
        format!("view {latest}/learn@1.mcap --rerun save=./{latest}/../latest/learn@1.mcap"),
        "plot latest".to_owned(),
    ] {
        let ended = run(&toy, &words, Some(&script));
        assert_eq!((ended.code, ended.out.as_str()), (Some(2), ""), "{words}: {ended:?}");
        assert!(ended.err.contains("; choose another output"), "{words}: {ended:?}");
    }
    assert_eq!(fs::read(toy.path("percent_goal.svg")).unwrap(), before);
    assert!(fs::read_to_string(toy.path("toy.toml")).unwrap().starts_with("schema = 1"));
}

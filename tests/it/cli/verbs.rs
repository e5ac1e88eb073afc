//! What each verb says and with which exit code it ends.

use crate::support::cli;
use std::{
    fs,
    io::{BufRead as _, BufReader},
    process::Stdio,
};

use crate::support::cli::{Ended, Toy, assert_snapshot};
use serde_json::{Value, json};

#[test]
fn a_run_ends_with_one_json_object_and_the_second_run_is_cached() {
    let toy = Toy::new();
    let first = toy.run("run toy.toml --json");
    assert_eq!((first.code, first.err.as_str()), (Some(0), ""), "{first:?}");
    let json = first.json();
    assert_eq!((&json["executed"], &json["cached"], &json["failed"]), (&json!(7), &json!(0), &json!(0)));
    assert_eq!(json["percent_goal"], json["nodes"]["evaluate@2"]["figures"]["percent_goal"]);
    let second = toy.run("run toy.toml --json").json();
    assert_eq!((&second["executed"], &second["cached"]), (&json!(0), &json!(7)));
    assert_eq!(cli::digests(&json), cli::digests(&second));
    assert!(cli::digests(&json).values().all(|(output, recording)| output.is_string() && recording.is_string()));
    // Every line before the last is an event of the same stream that lies in the run's folder.
    let events: Vec<Value> = first.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(events[0]["event"], "run_started");
    assert_eq!(events[events.len() - 2]["event"], "run_finished");
}

#[test]
fn raising_the_number_of_rounds_runs_only_the_new_ones() {
    let toy = Toy::new();
    toy.run("run toy.toml");
    let more = toy.run("run toy.toml -S rounds=5 --json").json();
    assert_eq!((&more["executed"], &more["cached"]), (&json!(4), &json!(7)));
}

#[test]
fn a_sweep_shares_what_its_axis_cannot_reach() {
    let toy = Toy::new();
    let report = toy.run("run toy.toml --sweep evaluate.plus=1,2 --json").json();
    assert_eq!(report["executed"], json!(1 + 3 + 6));
}

#[test]
fn a_dry_run_names_each_reason_and_runs_nothing() {
    let toy = Toy::new();
    let dry = toy.run("run toy.toml -n");
    assert_eq!(dry.code, Some(0));
    assert_snapshot("dry_run_first", &dry.out);
    toy.run("run toy.toml");
    assert_snapshot("dry_run_cached", &toy.run("run toy.toml -n").out);
    assert_snapshot("dry_run_changed", &toy.run("run toy.toml -n -S learn.plus=7").out);
}

#[test]
fn status_tells_stale_by_its_exit_code() {
    let toy = Toy::new();
    assert_eq!(toy.run("status toy.toml").code, Some(10));
    toy.run("run toy.toml");
    let fresh = toy.run("status toy.toml");
    assert_eq!((fresh.code, fresh.out.as_str()), (Some(0), "toy: all 7 nodes are up to date\n"));
    let stale = toy.run("status toy.toml -S data.plus=6 --json");
    assert_eq!(stale.code, Some(10));
    assert_eq!(stale.json()["nodes"]["data"]["changes"][0], json!({"path": "plus", "old": 5.0, "new": 6.0}));
}

#[test]
fn why_names_the_old_value_and_the_new() {
    let toy = Toy::new();
    toy.run("run toy.toml");
    let why = toy.run("why toy.toml learn@0 -S learn.plus=7");
    assert_eq!(why.out.lines().next(), Some("learn@0: plus 0 -> 7"));
    let json = toy.run("why toy.toml learn@0 -S learn.plus=7 --json").json();
    assert_eq!(json["reason"]["changes"][0]["path"], "plus");
    assert!(toy.run("why toy.toml learn@1").out.starts_with("learn@1 is up to date: run 2"));
}

#[test]
fn targets_take_what_they_need() {
    let toy = Toy::new();
    let report = toy.run("run toy.toml evaluate@1 --json").json();
    let names: Vec<_> = report["nodes"].as_object().unwrap().keys().cloned().collect();
    assert_eq!(names, ["data", "learn@0", "learn@1", "evaluate@1"]);
}

#[test]
fn plain_output_reads_well() {
    let toy = Toy::new();
    let ended = toy.run("run toy.toml -j1");
    assert_eq!(ended.code, Some(0));
    assert_snapshot("run_stderr", &masked(&ended.err));
    assert_snapshot("run_stdout", &masked(&ended.out));
    assert_snapshot("run_cached_stdout", &masked(&toy.run("run toy.toml").out));
}

/// Leaves out what differs from run to run: ids and times.
fn masked(text: &str) -> String {
    let mut lines = Vec::new();
    for line in text.lines() {
        let words: Vec<String> = line
            .split(' ')
            .map(|word| {
                let is_id = |part: &str| part.len() == 24 && part.starts_with("20") && part.matches('-').count() == 3;
                let inner = word.trim_matches(|c| matches!(c, '(' | ')'));
                match inner.split('/').find(|part| is_id(part)) {
                    Some(id) => word.replace(id, "RUN"),
                    None => word.to_owned(),
                }
            })
            .collect();
        let mut line = words.join(" ");
        for unit in [" ms", " s"] {
            if let Some(at) = line.find(unit)
                && let Some(start) = line[..at].rfind(' ')
                && line[start + 1..at].parse::<f64>().is_ok()
            {
                line = format!("{} TIME{}", &line[..start], &line[at + unit.len()..]);
            }
        }
        // Times of other lengths move the columns.
        while line.contains("TIME   ") {
            line = line.replace("TIME   ", "TIME  ");
        }
        lines.push(line);
    }
    lines.join("\n") + "\n"
}

#[test]
fn a_failing_stage_is_exit_code_1_and_names_its_cause() {
    let toy = Toy::new();
    let ended = toy.run("run toy.toml --progress none -S evaluate.fail=broken");
    assert_eq!(ended.code, Some(1));
    assert!(
        ended.err.contains("error: evaluate@0 (toy_evaluate) failed: broken\n  = its recording until the failure: "),
        "{}",
        ended.err
    );
    assert!(ended.err.contains("finished nodes are kept; the same command continues from there"), "{}", ended.err);
    assert_eq!(toy.run("run toy.toml -k -S evaluate.fail=broken --json").json()["failed"], json!(3));
}

#[test]
fn mistakes_have_their_exit_codes_and_their_help() {
    let toy = Toy::new();
    let code = |words: &str| toy.run(words).code;
    assert_eq!((code("runn toy.toml"), code("run"), code("run missing.toml")), (Some(2), Some(2), Some(2)));
    assert_snapshot("unknown_verb", &toy.run("runn toy.toml").err);
    assert_snapshot("unknown_target", &toy.run("run toy.toml evalute").err);
    assert_snapshot("missing_file", &toy.run("run missing.toml").err);
    assert_snapshot("unknown_sink", &toy.run("run toy.toml --rerun spwan").err);
    let broken = toy.run("run toy.toml -S learn.pluss=1");
    assert_eq!(broken.code, Some(3));
    assert!(broken.err.contains("pluss"), "{}", broken.err);
    let mistakes = toy.run("run toy.toml -S learn.pluss=1 --json").json();
    assert!(mistakes["mistakes"][0]["message"].as_str().unwrap().contains("pluss"), "{mistakes}");
    fs::write(toy.path("artifacts"), "in the way").unwrap();
    let blocked = toy.run("run toy.toml");
    assert_eq!(blocked.code, Some(4));
    assert_snapshot("store_in_the_way", &blocked.err);
}

#[test]
fn help_reads_well() {
    let toy = Toy::new();
    assert_snapshot("help", &toy.run("--help").out);
    assert_snapshot("help_run", &toy.run("run --help").out);
}

#[test]
fn a_replay_compares_every_output_and_recording() {
    let toy = Toy::new();
    toy.run("run toy.toml");
    let replay = toy.run("replay latest --json");
    assert_eq!((replay.code, &replay.json()["equal"]), (Some(0), &json!(7)), "{replay:?}");
    // A run whose manifest says otherwise differs, and the first such node is named.
    let manifest = toy.path("artifacts/runs/latest/manifest.json");
    let text = fs::read_to_string(&manifest).unwrap();
    let mut json: Value = serde_json::from_str(&text).unwrap();
    json["nodes"][1]["recording"] = json["nodes"][0]["recording"].clone();
    fs::write(&manifest, json.to_string()).unwrap();
    let damaged = toy.run("replay");
    assert_eq!(damaged.code, Some(4));
    assert!(damaged.err.contains("manifest.json is damaged"), "{}", damaged.err);
    // As an older carl-pipe would have written it, without a digest of its own text.
    json.as_object_mut().unwrap().remove("check");
    json["format"] = json!(1);
    fs::write(&manifest, json.to_string()).unwrap();
    let replay = toy.run("replay");
    assert_eq!(replay.code, Some(6));
    assert!(replay.out.starts_with("differs: recording of learn@0: was b3:"), "{}", replay.out);
    assert_eq!(fs::read_dir(toy.path("artifacts/tmp")).unwrap().count(), 0);
}

#[test]
fn every_verb_that_runs_nodes_takes_the_same_numbers_of_jobs() {
    let toy = Toy::new();
    for verb in ["run toy.toml", "replay latest", "verify --repair"] {
        assert_eq!(toy.run(&format!("{verb} --jobs auto")).code, Some(0), "{verb}");
        let ended = Ended::of(toy.command(verb).env("CARL_JOBS", "auto").output().unwrap());
        assert_eq!(ended.code, Some(0), "{verb}: {ended:?}");
        let none = toy.run(&format!("{verb} --jobs 0"));
        assert_eq!(none.code, Some(2), "{verb}");
        assert!(none.err.contains("must be a number above 0, or `auto`"), "{verb}: {}", none.err);
    }
}

#[test]
fn ctrl_c_stops_at_the_next_step_and_the_same_command_goes_on() {
    let toy = Toy::new();
    let words = "run toy.toml -S learn.steps=100 --json";
    let mut child = toy.command(words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    lines.find(|line| line.as_ref().unwrap().contains(r#""event":"progress","node":"learn@1""#)).unwrap().unwrap();
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, cli::stop_signal()).unwrap();
    let last: Value = serde_json::from_str(&lines.map(Result::unwrap).last().unwrap()).unwrap();
    let ended = Ended::of(child.wait_with_output().unwrap());
    assert_eq!((ended.code, &last["state"]), (Some(130), &json!("interrupted")));
    assert!(ended.err.contains("continue with `carl-pipe run toy.toml -S learn.steps=100 --json`"), "{}", ended.err);
    let again = toy.run(words).json();
    assert_eq!(again["cached"].as_u64().unwrap() + again["executed"].as_u64().unwrap(), 7);
    assert!(again["cached"].as_u64().unwrap() >= 2);
}

#[test]
fn log_show_and_gc_know_the_runs() {
    let toy = Toy::new();
    toy.run("run toy.toml");
    toy.run("run toy.toml -S data.plus=6");
    let log = toy.run("log --json");
    assert_eq!(log.out.lines().count(), 2);
    let newest: Value = serde_json::from_str(log.out.lines().next().unwrap()).unwrap();
    assert_eq!((&newest["state"], &newest["executed"]), (&json!("finished"), &json!(7)));
    let show = toy.run("show latest learn@1");
    assert!(
        show.out.contains("  value.json  artifacts/objects/") && show.out.contains("  recording   artifacts/objects/"),
        "{}",
        show.out
    );
    let gc = toy.run("gc --keep 1 --json --yes").json();
    assert_eq!(gc["removed"]["entries"], json!(7));
    assert_eq!(toy.run("run toy.toml -S data.plus=6 --json").json()["cached"], json!(7));
}

#[test]
fn colours_are_used_only_where_they_are_wanted() {
    let toy = Toy::new();
    toy.run("run toy.toml");
    let is_coloured = |words: &str, set: &[(&str, &str)]| {
        let output = toy.command(words).envs(set.iter().copied()).output().unwrap();
        Ended::of(output).out.contains('\u{1b}')
    };
    assert!(!is_coloured("log", &[]), "a pipe is no terminal");
    assert!(is_coloured("log --color always", &[]));
    assert!(is_coloured("log", &[("CARL_COLOR", "always")]));
    assert!(is_coloured("log", &[("CLICOLOR_FORCE", "1")]));
    assert!(!is_coloured("log", &[("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1")]));
    assert!(!is_coloured("log --color never", &[("CLICOLOR_FORCE", "1")]));
    let mistake = toy.command("run toy.toml -S learn.pluss=1 --color always").output().unwrap();
    assert!(Ended::of(mistake).err.contains('\u{1b}'));
}

#[test]
fn a_folder_of_runs_that_cannot_be_read_is_an_error_of_the_system() {
    let toy = Toy::new();
    fs::create_dir(toy.path("artifacts")).unwrap();
    fs::write(toy.path("artifacts/runs"), "in the way").unwrap();
    assert_eq!((toy.run("show").code, toy.run("log").code), (Some(4), Some(4)));
    assert_eq!(Toy::new().run("show").code, Some(2));
}

#[test]
fn completions_are_written_for_every_shell() {
    let toy = Toy::new();
    for shell in ["bash", "zsh", "fish", "powershell"] {
        assert!(toy.run(&format!("completions {shell}")).out.contains("carl-pipe"), "{shell}");
    }
}

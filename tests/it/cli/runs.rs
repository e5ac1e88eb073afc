//! What a user does with runs that have ended: list, name, keep, measure and remove them.

use std::{
    fs,
    io::{Read as _, Write as _},
    path::Path,
    process::Stdio,
};

use crate::support::cli::{Toy, assert_snapshot, on_terminal};
use serde_json::{Value, json};

/// The ids of the runs, newest first.
fn ids(toy: &Toy) -> Vec<String> {
    log(toy).iter().map(|run| run["run"].as_str().unwrap().to_owned()).collect()
}

fn log(toy: &Toy) -> Vec<Value> {
    toy.run("log --json").out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Two runs that share the node `data`.
fn two_runs() -> Toy {
    let toy = Toy::new();
    toy.run("run toy.toml");
    toy.run("run toy.toml -S learn.plus=2 --sweep evaluate.plus=0,1");
    toy
}

#[test]
fn gc_removes_nothing_unasked() {
    let toy = two_runs();
    let refused = toy.run("gc --keep 1");
    assert_eq!(refused.code, Some(2));
    assert!(refused.out.starts_with("to remove: "), "{refused:?}");
    assert!(refused.out.contains("  toy  1 run  6 results  "), "{refused:?}");
    assert!(refused.err.contains("help: `carl-pipe gc --yes` removes without asking"), "{refused:?}");
    let dry = toy.run("gc --keep 1 --dry-run --json").json();
    assert_eq!((&dry["dry_run"], &dry["removed"]["entries"]), (&json!(true), &json!(6)));
    assert_eq!(toy.run("run toy.toml --json").json()["cached"], json!(7), "both left everything as it was");
    assert_eq!(toy.run("gc").code, Some(0), "nothing to remove needs no answer");
}

/// The screen after these keys answer the question of `gc`, and the exit code; `None` where no terminal can be had.
fn answered(toy: &Toy, keys: &[u8]) -> Option<(String, Option<i32>)> {
    let mut terminal = on_terminal(&toy.command("gc --keep 1"));
    let mut child = terminal.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().ok()?;
    let (mut keyboard, mut display) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    let mut screen = Vec::new();
    while !screen.ends_with(b"remove? [y/N]\r\n") {
        let mut byte = [0];
        display.read_exact(&mut byte).unwrap_or_else(|_| panic!("no question: {}", String::from_utf8_lossy(&screen)));
        screen.extend(byte);
    }
    keyboard.write_all(keys).unwrap();
    display.read_to_end(&mut screen).unwrap();
    Some((String::from_utf8_lossy(&screen).into_owned(), child.wait().unwrap().code()))
}

#[test]
fn gc_does_on_a_terminal_what_it_is_told() {
    let (ctrl_c, ctrl_d) = (b"\x03", b"\x04");
    let toy = two_runs();
    for (keys, code) in [(&b"n\n"[..], 0), (b"\n", 0), (b"maybe y\n", 0), (ctrl_d, 0), (ctrl_c, 130)] {
        let Some((screen, ended)) = answered(&toy, keys) else {
            eprintln!("skipped: there is no `script`");
            return;
        };
        assert_eq!((ended, ids(&toy).len()), (Some(code), 2), "{keys:?}: {screen}");
        assert_eq!(toy.run("verify").code, Some(0));
    }
    for yes in [&b"y\n"[..], b"YES\n"] {
        let toy = two_runs();
        let (screen, ended) = answered(&toy, yes).unwrap();
        assert_eq!((ended, ids(&toy).len()), (Some(0), 1), "{screen}");
        assert!(screen.contains("removed"), "{screen}");
    }
}

#[test]
fn gc_drops_one_run_by_name() {
    let toy = two_runs();
    let [newest, oldest] = ids(&toy).try_into().unwrap();
    toy.run(&format!("pin {oldest}"));
    let pinned = toy.run("gc --drop latest~1 --yes");
    assert_eq!(pinned.code, Some(2));
    assert!(pinned.err.contains(&format!("error: run {oldest} has a pin or a tag")), "{pinned:?}");
    toy.run("unpin latest~1");
    let dropped = toy.run("gc --drop latest~1 --yes --json").json();
    assert_eq!((&dropped["removed"]["runs"][0]["run"], &dropped["removed"]["entries"]), (&json!(oldest), &json!(6)));
    assert_eq!(ids(&toy), [newest]);
    assert_eq!(toy.run("gc --drop latest --keep 3").code, Some(2));
}

#[test]
fn a_damaged_manifest_is_told_and_blocks_nothing() {
    let toy = two_runs();
    let [newest, oldest] = ids(&toy).try_into().unwrap();
    let path = toy.path(&format!("artifacts/runs/{oldest}/manifest.json"));
    let mut bytes = fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&path, bytes).unwrap();
    let listed = toy.run("log");
    assert_eq!(listed.out.lines().count(), 3, "{listed:?}");
    assert!(
        listed.out.lines().nth(2).unwrap().starts_with(&format!("{oldest}  toy       unreadable  damaged manifest")),
        "{listed:?}"
    );
    let shown = toy.run(&format!("show {oldest}"));
    assert_eq!(shown.code, Some(4));
    assert!(shown.err.contains("manifest.json is damaged: ") && shown.err.contains("help: "), "{shown:?}");
    let gc = toy.run("gc --keep 1");
    assert_eq!(gc.code, Some(0), "{gc:?}");
    assert!(
        gc.out.contains(&format!("  {oldest}  toy  damaged manifest: kept with the results that it may name (7)")),
        "{gc:?}"
    );
    assert!(gc.err.contains(&format!("help: `carl-pipe gc --drop {oldest}` removes it")), "{gc:?}");
    assert_eq!(toy.run(&format!("gc --drop {oldest} --yes")).code, Some(0));
    assert_eq!(ids(&toy), [newest]);
}

#[test]
fn a_run_is_found_by_every_name_that_it_has() {
    let toy = two_runs();
    let [newest, oldest] = ids(&toy).try_into().unwrap();
    assert_eq!(toy.run("tag latest~1 base").out, format!("{oldest} is now `base`\n"));
    let shown = |name: &str| toy.run(&format!("show {name} --json")).json()["run"].as_str().map(str::to_owned);
    for name in ["base", "toy~1", "latest~1", &oldest[..oldest.len() - 1]] {
        assert_eq!(shown(name), Some(oldest.clone()), "{name}");
    }
    for name in ["latest", "toy", "latest~0"] {
        assert_eq!(shown(name), Some(newest.clone()), "{name}");
    }
    for words in ["table base", "compare base toy", "replay base", "gc --drop toy --dry-run"] {
        assert_eq!(toy.run(words).code, Some(0), "{words}");
    }
    let near = toy.run("show bsae");
    assert_eq!(
        (near.code, near.err.as_str()),
        (Some(2), "error: no run is called `bsae`\n  = help: did you mean `base`? `carl-pipe log` lists the runs\n")
    );
    assert!(toy.run("show nothing").err.contains("help: runs are called `latest`, `base`, `toy`, `20"));
    assert!(toy.run("show 20").err.contains("error: 2 runs begin with `20`"));
    // A tag belongs to one run.
    assert_eq!(toy.run("tag latest base").out, format!("{newest} is now `base`, and {oldest} is no more\n"));
    assert_eq!(shown("base"), Some(newest));
    toy.run("tag base --remove");
    assert_eq!(toy.run("show base").code, Some(2));
    for word in ["latest", "20261122", "20261122-074808-704-6c0d", "toy", "a/b", "-x", "_x"] {
        let refused = toy.run(&format!("tag latest -- {word}"));
        assert_eq!(refused.code, Some(2), "{word}: {refused:?}");
        assert!(refused.err.contains("cannot be a tag"), "{word}: {refused:?}");
    }
}

#[test]
fn the_log_tells_what_a_run_was_for_and_what_it_reached() {
    let toy = Toy::new();
    toy.run("run toy.toml -S learn.plus=2 --sweep seed=0..3 --note first");
    toy.run("run toy.toml -k -S evaluate.fail=broken");
    toy.run("pin latest~1 --note for-the-paper");
    toy.run("tag latest~1 best");
    let [failed, swept] = log(&toy).try_into().unwrap();
    assert_eq!(
        (&failed["state"], &failed["headline"], &failed["note"]),
        (&json!("failed"), &json!(null), &json!(null))
    );
    assert_eq!(swept["headline"]["metric"], json!("percent_goal"));
    assert_eq!((&swept["headline"]["models"], &swept["seeds"]), (&json!(3), &json!([0, 1, 2])));
    assert_eq!(
        (&swept["pinned"], &swept["tags"], &swept["note"]),
        (&json!(true), &json!(["best"]), &json!("for-the-paper"))
    );
    assert_eq!(swept["changes"], json!(["learn.plus=2", "seed=0..3"]));
    let text = toy.run("log").out;
    let row = text.lines().nth(2).unwrap();
    for part in
        ["  finished  percent_goal ", "  0-2   21 ran  ", "  learn.plus=2 seed=0..3  pinned #best  for-the-paper"]
    {
        assert!(row.contains(part), "no `{part}` in\n{text}");
    }
    assert!(text.lines().nth(1).unwrap().contains("3 ran, 1 cached of 7"), "{text}");
}

#[test]
fn du_counts_every_byte_once() {
    let toy = two_runs();
    let du = toy.run("du --json").json();
    let files = |folder: &str| bytes(&toy.path(&format!("artifacts/{folder}")));
    assert_eq!(du["total"]["results"], json!(files("objects")));
    let numbers = fs::metadata(toy.path("artifacts/runs/numbers")).unwrap().len();
    assert_eq!(du["total"]["run_folders"], json!(files("runs") - numbers));
    let runs = du["pipelines"][0]["runs"].as_array().unwrap();
    let own: u64 = runs.iter().map(|run| run["own_bytes"].as_u64().unwrap()).sum();
    let shared = runs[0]["shared_bytes"].as_u64().unwrap();
    assert!(shared > 0, "both runs use the output of `data`");
    assert_eq!(runs[1]["shared_bytes"], json!(shared));
    assert_eq!(json!(own + shared), du["total"]["bytes"]);
    assert_eq!(
        (&du["pipelines"][0]["own_bytes"], &du["pipelines"][0]["shared_bytes"]),
        (&du["total"]["bytes"], &json!(0))
    );
    // What only a run needs is what its removal frees.
    let freed = toy.run("gc --drop latest~1 --yes --json").json();
    assert_eq!(freed["removed"]["bytes"], runs[1]["own_bytes"]);
    assert_eq!(toy.run("du --json").json()["total"]["bytes"], freed["kept"]["bytes"]);
}

/// The bytes of the files below a folder.
fn bytes(folder: &Path) -> u64 {
    let items = fs::read_dir(folder).unwrap().map(|item| item.unwrap());
    let size = |item: fs::DirEntry| match item.metadata().unwrap() {
        meta if meta.is_dir() => bytes(&item.path()),
        meta if meta.is_file() => meta.len(),
        _ => 0,
    };
    items.map(size).sum()
}

#[test]
fn why_compares_with_the_nearest_run_not_with_the_newest() {
    let toy = Toy::new();
    toy.run("run toy.toml");
    toy.run("run toy.toml -S learn.plus=9 -S data.plus=6");
    let [_, oldest] = ids(&toy).try_into().unwrap();
    let why = toy.run("why toy.toml learn@0 -S learn.plus=1");
    assert_eq!(why.out, format!("learn@0: plus 0 -> 1\n  since run {oldest}\n"));
    let status = toy.run("status toy.toml -S learn.plus=9 -S data.plus=7 --json").json();
    assert_eq!(status["nodes"]["data"]["changes"].as_array().unwrap().len(), 1);
    assert_eq!(status["nodes"]["learn@0"]["changes"], json!([]), "a run had this parameter");
}

#[test]
fn help_of_the_verbs_for_runs_reads_well() {
    let toy = Toy::new();
    assert_snapshot("help_gc", &toy.run("gc --help").out);
    assert_snapshot("help_tag", &toy.run("tag --help").out);
}

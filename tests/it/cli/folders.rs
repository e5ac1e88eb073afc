//! A folder is a store only where its `store.json` says so. Nothing of anybody else's is touched.

use std::{
    collections::BTreeMap,
    fs,
    os::unix::fs::MetadataExt as _,
    path::{Path, PathBuf},
    process::Stdio,
};

use crate::support::cli::{Ended, Toy};

/// Every file and folder below a folder, with the inode, the time of the last change and the bytes.
fn everything(folder: &Path) -> BTreeMap<PathBuf, (u64, i64, i64, Vec<u8>)> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for item in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let (path, meta) = (item.path(), item.metadata().unwrap());
            let bytes = if meta.is_file() { fs::read(&path).unwrap() } else { Vec::new() };
            found.insert(path.clone(), (meta.ino(), meta.ctime(), meta.ctime_nsec(), bytes));
            if meta.is_dir() {
                open.push(path);
            }
        }
    }
    found
}

/// Commands that run something, and commands that only read, with the exit code of the latter where there is no store.
const RUNNING: [&str; 3] = ["run toy.toml", "gc --keep 0", "replay"];
const READING: [&str; 8] = [
    "status toy.toml",
    "why toy.toml evaluate",
    "run toy.toml -n",
    "log",
    "show latest",
    "table latest",
    "compare latest latest",
    "plot latest -o figures",
];

/// Folders of others, as names and contents of files.
fn foreign() -> Vec<Vec<(&'static str, &'static str)>> {
    let hex = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcd";
    let object: &'static str = format!("objects/ab/{hex}").leak();
    vec![
        vec![("mine", "")],
        vec![("tmp/mine", "kept")],
        vec![(".git/HEAD", "ref"), ("objects/ab/0123456789abcdef0123456789abcdef012345", "loose"), ("HEAD", "")],
        vec![(object, "like ours"), ("tmp/carl-tmp-x", ""), ("runs/20260101-000000-000-0000/manifest.json", "{}")],
        vec![("store.json", "")],
        vec![("store.json", "{\"store\":\"carl-pipe\",\"for"), ("tmp/carl-tmp-x", "half")],
        vec![("store.json", "{\"store\":\"shop\",\"format\":1}"), ("tmp/carl-tmp-x", "theirs")],
        vec![("store.json", "{\"format\":1}")],
        vec![("store.json", "[1]")],
        vec![("store.json", "{\"store\":\"carl-pipe\",\"format\":99}"), ("keys/ab/x.json", "newer")],
        vec![("README.md", "# my notes")],
    ]
}

#[test]
fn a_folder_of_others_stays_as_it_is_whatever_the_verb() {
    for files in foreign() {
        let toy = Toy::new();
        let folder = toy.path("p");
        for (name, text) in &files {
            fs::create_dir_all(folder.join(name).parent().unwrap()).unwrap();
            fs::write(folder.join(name), text).unwrap();
        }
        let before = everything(&folder);
        for verb in RUNNING.iter().chain(&READING) {
            let ended = toy.run(&format!("--artifacts p {verb}"));
            assert_eq!(everything(&folder), before, "{verb} changed {files:?}: {ended:?}");
            // What reads runs alone may say that there are none.
            assert!(*verb == "log" || ended.code.is_some_and(|code| [2, 4].contains(&code)), "{verb}: {ended:?}");
        }
        let ended = toy.run("--artifacts p run toy.toml");
        assert_eq!(ended.code, Some(4), "{ended:?}");
        assert!(ended.err.contains("p is"), "{}", ended.err);
    }
}

#[test]
fn a_file_in_place_of_a_store_is_named() {
    let toy = Toy::new();
    let ended = toy.run("--artifacts toy.toml run toy.toml");
    assert_eq!(ended.code, Some(4));
    assert!(ended.err.contains("toy.toml is not a store of carl-pipe: it is a file"), "{}", ended.err);
}

#[test]
fn reading_verbs_make_nothing_where_there_is_no_store() {
    for empty in [false, true] {
        let toy = Toy::new();
        if empty {
            fs::create_dir(toy.path("p")).unwrap();
        }
        for verb in READING {
            let ended = toy.run(&format!("--artifacts p {verb}"));
            assert_eq!(everything(&toy.path("p")), BTreeMap::new(), "{verb}");
            assert_eq!(toy.path("p").exists(), empty, "{verb}");
            assert!(!ended.err.contains("panicked"), "{verb}: {}", ended.err);
        }
        assert_eq!(toy.run("--artifacts p status toy.toml").code, Some(10), "all nodes are stale");
        assert_eq!(toy.run("--artifacts p gc").code, Some(4), "there is nothing to clean");
        assert_eq!(toy.path("p").exists(), empty);
        assert_eq!(toy.run("--artifacts p run toy.toml").code, Some(0), "an empty folder becomes a store");
    }
}

#[test]
fn reading_verbs_change_nothing_in_a_store() {
    let toy = Toy::new();
    assert_eq!(toy.run("run toy.toml").code, Some(0));
    let damaged = fs::read_dir(toy.path("artifacts/objects")).unwrap().flatten().next().unwrap().path();
    let damaged = fs::read_dir(damaged).unwrap().flatten().next().unwrap().path();
    fs::remove_file(&damaged).unwrap();
    fs::write(&damaged, "damaged").unwrap();
    fs::write(toy.path("artifacts/tmp/carl-tmp-left"), "half").unwrap();
    fs::remove_dir(toy.path("artifacts/locks")).unwrap();
    let before = everything(&toy.path("artifacts"));
    for verb in READING {
        toy.run(verb);
        assert_eq!(everything(&toy.path("artifacts")), before, "{verb}");
    }
}

#[test]
fn a_store_without_its_empty_folders_is_completed() {
    let toy = Toy::new();
    assert_eq!(toy.run("run toy.toml").code, Some(0));
    for folder in ["tmp", "locks", "bad"] {
        fs::remove_dir(toy.path("artifacts").join(folder)).unwrap();
    }
    let again = toy.run("run toy.toml --json");
    assert_eq!((again.code, &again.json()["cached"]), (Some(0), &7.into()));
    for folder in ["keys", "objects"] {
        fs::remove_dir_all(toy.path("artifacts").join(folder)).unwrap();
    }
    let again = toy.run("run toy.toml --json");
    assert_eq!((again.code, &again.json()["executed"]), (Some(0), &7.into()));
}

#[test]
fn files_of_others_in_a_store_outlive_every_cleaning() {
    let toy = Toy::new();
    toy.run("run toy.toml");
    let own = ["objects/mine", "objects/ab/mine", "keys/ab/mine.json", "locks/mine", "bad/mine", "tmp/mine"];
    for name in own {
        let path = toy.path("artifacts").join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "kept").unwrap();
    }
    let left = ["tmp/carl-tmp-1", "bad/carl-tmp-2", "runs/latest/carl-tmp-3"];
    left.iter().for_each(|name| fs::write(toy.path("artifacts").join(name), "left").unwrap());
    std::os::unix::fs::symlink("nowhere", toy.path("artifacts/runs/.latest-dead")).unwrap();
    toy.run("run toy.toml -S data.plus=9");
    assert!(fs::symlink_metadata(toy.path("artifacts/runs/.latest-dead")).is_err());
    for _ in 0..2 {
        let ended = toy.run("gc --keep 1 --yes");
        assert_eq!(ended.code, Some(0), "{ended:?}");
    }
    for name in own {
        assert_eq!(fs::read(toy.path("artifacts").join(name)).unwrap(), b"kept", "{name}");
    }
    assert!(left.iter().all(|name| !toy.path("artifacts").join(name).exists()));
}

#[test]
fn a_process_that_stopped_with_a_lock_is_named() {
    use rustix::process::{Pid, Signal, kill_process};
    let toy = Toy::new();
    let slow = "run toy.toml data -S data.steps=300 --json";
    let mut holder = toy.command(slow).stdout(Stdio::piped()).spawn().unwrap();
    let mut said = String::new();
    let mut lines = std::io::BufReader::new(holder.stdout.take().unwrap());
    while !said.contains("progress") {
        said.clear();
        assert_ne!(std::io::BufRead::read_line(&mut lines, &mut said).unwrap(), 0, "it ended early");
    }
    kill_process(Pid::from_child(&holder), Signal::STOP).unwrap();
    let mut waiting = toy.command(slow).stdout(Stdio::piped()).spawn().unwrap();
    let mut heard = std::io::BufReader::new(waiting.stdout.take().unwrap());
    let mut line = String::new();
    while !line.contains("works on this node") {
        line.clear();
        assert_ne!(std::io::BufRead::read_line(&mut heard, &mut line).unwrap(), 0, "it says nothing");
    }
    let pid = holder.id();
    assert!(line.contains(&format!("process {pid} (started")) && line.contains("stopped"), "{line}");
    let busy = toy.run("gc");
    assert_eq!(busy.code, Some(7));
    assert!(busy.err.contains(&format!("process {pid} (started")), "{}", busy.err);
    kill_process(Pid::from_child(&holder), Signal::CONT).unwrap();
    drop((lines, heard));
    for mut child in [holder, waiting] {
        child.kill().unwrap();
        child.wait().unwrap();
    }
    assert_eq!(Ended::of(toy.command("run toy.toml").output().unwrap()).code, Some(0));
}

//! `carl-pipe doctor`: a line for each thing, and nothing is left behind.

use std::{collections::BTreeSet, fs, path::Path, path::PathBuf, process::Command};

use crate::support::cli::{Ended, Toy};

/// Every path below a folder.
fn all(folder: &Path) -> BTreeSet<PathBuf> {
    let mut found = BTreeSet::new();
    for item in fs::read_dir(folder).into_iter().flatten().flatten() {
        found.insert(item.path());
        if item.file_type().unwrap().is_dir() {
            found.extend(all(&item.path()));
        }
    }
    found
}

fn levels(ended: &Ended) -> Vec<(String, String)> {
    let json = ended.json();
    let findings = json["findings"].as_array().unwrap();
    let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
    findings.iter().map(|it| (text(&it["about"]), text(&it["level"]))).collect()
}

#[test]
fn a_good_place_has_no_problem_and_stays_as_it_was() {
    let toy = Toy::new();
    toy.run("run toy.toml");
    let before = all(toy.folder.path());
    let ended = toy.run("doctor");
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(all(toy.folder.path()), before);
    let about = |line: &str| line.split_whitespace().nth(1).unwrap().to_owned();
    let lines = ended.out.lines().filter(|line| !line.starts_with(' '));
    let told: Vec<String> = lines.map(about).collect();
    let expected = [
        "store",
        "writing",
        "locks",
        "renaming",
        "folders",
        "rights",
        "links",
        "space",
        "clock",
        "carl-pipe",
        "carl-view",
        "viewer",
        "processor",
        "memory",
    ];
    assert_eq!(told, expected, "{}", ended.out);
    assert!(ended.out.contains("artifacts has 7 results in "), "{}", ended.out);
    // Whatever is not well has its help in the next line.
    for (line, next) in ended.out.lines().zip(ended.out.lines().skip(1)) {
        let is_well = line.starts_with("ok") || line.starts_with(' ');
        assert_eq!(!is_well, next.trim_start().starts_with("= "), "{line}\n{next}");
    }
}

#[test]
fn a_place_without_a_store_is_left_without_one() {
    let toy = Toy::new();
    let ended = toy.run("doctor --json");
    assert_eq!((ended.code, toy.path("artifacts").exists()), (Some(0), false), "{ended:?}");
    assert!(levels(&ended).contains(&("store".to_owned(), "warning".to_owned())), "{ended:?}");
}

#[test]
fn a_folder_of_others_and_a_full_disk_are_problems() {
    let toy = Toy::new();
    fs::create_dir(toy.path("artifacts")).unwrap();
    fs::write(toy.path("artifacts/mine.txt"), "mine").unwrap();
    let ended = toy.run("doctor --json");
    assert_eq!(ended.code, Some(4), "{ended:?}");
    assert!(levels(&ended).contains(&("store".to_owned(), "problem".to_owned())), "{ended:?}");

    let small = toy.path("small");
    fs::create_dir(&small).unwrap();
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=2m", "tmpfs"]).arg(&small).status();
    if !mounted.is_ok_and(|it| it.success()) {
        eprintln!("skipped: may not mount a small file system");
        return;
    }
    toy.run("--artifacts small run toy.toml");
    let ended = toy.run("--artifacts small doctor --json");
    Command::new("umount").arg(&small).status().unwrap();
    assert_eq!(ended.code, Some(4), "{ended:?}");
    assert!(levels(&ended).contains(&("space".to_owned(), "problem".to_owned())), "{ended:?}");
}

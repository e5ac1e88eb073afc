//! `carl-pipe plot` draws a real run of the smoke pipeline, and says what a run lacks.

use std::{fs, path::Path, process::Command};

use crate::support::cli::Toy;

/// The real program, with a store in `folder`.
fn carl_pipe(folder: &Path, words: &str) -> (Option<i32>, String, String) {
    let ended = Command::new(env!("CARGO_BIN_EXE_carl-pipe"))
        .args(words.split_whitespace())
        .arg("--artifacts")
        .arg(folder.join("store"))
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (ended.status.code(), text(ended.stdout), text(ended.stderr))
}

/// Every tag is closed by its like, in order.
fn assert_well_formed(svg: &str) {
    let mut open = Vec::new();
    for tag in svg.split('<').skip(1) {
        let (tag, words) = tag.split_once('>').expect("a tag ends");
        assert!(!words.contains('>') && tag.matches('"').count() % 2 == 0, "{tag}");
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name));
        } else if !tag.ends_with('/') {
            open.push(tag.split_whitespace().next().unwrap());
        }
    }
    assert!(open.is_empty(), "{open:?} stay open");
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
}

#[test]
fn a_run_is_drawn_as_a_curve_and_a_strip_of_maps() {
    let folder = tempfile::tempdir().unwrap();
    let pipeline = folder.path().join("labelled.toml");
    let smoke = fs::read_to_string("pipelines/smoke.toml").unwrap();
    fs::write(&pipeline, smoke + "\n[labels]\npaper = \"12.5 ± 1\"\n").unwrap();
    let ran = carl_pipe(folder.path(), &format!("run {} --sweep seed=0,1,2 -q", pipeline.display()));
    assert_eq!(ran.0, Some(0), "{ran:?}");
    let pictures = folder.path().join("new/figures");
    let plotted = carl_pipe(folder.path(), &format!("plot latest --point seed=2 -o {}", pictures.display()));
    assert_eq!(plotted.0, Some(0), "{plotted:?}");
    assert_eq!(plotted.1.lines().count(), 2);

    let curve = fs::read_to_string(pictures.join("percent_goal.svg")).unwrap();
    assert_well_formed(&curve);
    for words in [
        "smoke, 3 seeds",
        "round",
        "mean ± s.e.",
        "each seed",
        "policy alone, mean",
        "paper's mean 12.5",
        "ceiling 78.9",
    ] {
        assert!(curve.contains(&format!(">{words}</text>")), "{words}");
    }

    let strip = fs::read_to_string(pictures.join("latent_map.svg")).unwrap();
    assert_well_formed(&strip);
    assert_eq!((strip.matches("class=\"panel\"").count(), strip.matches(">R² ").count()), (3, 3));
    for words in ["round 0", "round 1", "round 2"] {
        assert!(strip.contains(&format!(">{words}</text>")), "{words}");
    }
    assert!(strip.contains("smoke, seed 2"));

    let lost = carl_pipe(folder.path(), &format!("plot --point seed=9 -o {}", pictures.display()));
    assert_eq!(lost.0, Some(2));
    assert!(
        lost.2.contains("no latent map of `seed=9`") && lost.2.contains("`seed=0`, `seed=1`, `seed=2`"),
        "{lost:?}"
    );
}

#[test]
fn a_run_without_maps_still_gives_its_curve_and_names_what_is_missing() {
    let toy = Toy::new();
    toy.run("run toy.toml");
    let plotted = toy.run("plot");
    assert_eq!((plotted.code, plotted.out.as_str()), (Some(2), "./percent_goal.svg\n"), "{plotted:?}");
    assert!(plotted.err.contains("has no latent map of a round, which latent_map.svg shows"), "{plotted:?}");
    assert_well_formed(&fs::read_to_string(toy.path("percent_goal.svg")).unwrap());
    toy.run("run toy.toml learn");
    let plotted = toy.run("plot");
    assert_eq!((plotted.code, plotted.out.as_str()), (Some(2), ""), "{plotted:?}");
    assert!(plotted.err.contains("has neither an evaluation nor a latent map"), "{plotted:?}");
}

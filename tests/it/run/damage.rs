//! Random damage to the entries, outputs, recordings and manifests of a store: nothing wrong is served, and the next run
//! makes all but the manifest again.
//!
//! `DAMAGES` is the number of damaged files.

use std::{
    fs,
    os::unix::fs::PermissionsExt as _,
    path::{Path, PathBuf},
};

use crate::support::run::{Bench, graph};
use carl_pipe::run::{
    events::RunState,
    execute::{Options, Report},
    manifest::Manifest,
    plan::Force,
    verify::verify,
};
use rand::{RngExt as _, SeedableRng as _, rngs::ChaCha12Rng};
use serde_json::json;

fn damages() -> usize {
    std::env::var("DAMAGES").ok().and_then(|text| text.parse().ok()).unwrap_or(40)
}

/// Every file two levels below `keys` and `objects`, in order, and the manifest of a run.
fn kept_files(root: &Path, run_dir: &Path) -> Vec<PathBuf> {
    let below = |folder: PathBuf| fs::read_dir(folder).into_iter().flatten().flatten().map(|item| item.path());
    let folders = ["keys", "objects"].into_iter().flat_map(|folder| below(root.join(folder)));
    let mut files: Vec<PathBuf> = folders.flat_map(below).collect();
    files.push(run_dir.join("manifest.json"));
    files.sort();
    files
}

/// Damages a file, in place or as a new file, and says how.
fn damage(path: &Path, random: &mut ChaCha12Rng) -> &'static str {
    let mut bytes = fs::read(path).unwrap();
    let at = random.random_range(0..bytes.len());
    let what = match random.random_range(0..5) {
        0 => {
            bytes[at] ^= 1 << random.random_range(0..8);
            "a flipped bit"
        }
        1 => {
            bytes.truncate(at);
            "a cut end"
        }
        2 => {
            bytes.extend((0..=random.random_range(0..100)).map(|_| random.random::<u8>()));
            "more bytes"
        }
        3 => {
            bytes = vec![0; bytes.len()];
            "zeros"
        }
        _ => {
            fs::remove_file(path).unwrap();
            return "a missing file";
        }
    };
    if random.random() {
        fs::set_permissions(path, fs::Permissions::from_mode(0o644)).unwrap();
    } else {
        fs::remove_file(path).unwrap();
    }
    fs::write(path, bytes).unwrap();
    what
}

/// The output and the recording of every node.
fn made(report: &Report) -> Vec<(String, Option<String>, Option<String>)> {
    let text = |digest: Option<carl_pipe::digest::Digest>| digest.map(|digest| digest.to_string());
    let row = |node: &carl_pipe::run::node::NodeRecord| {
        (node.about.name.clone(), text(node.outcome.output), text(node.outcome.recording))
    };
    report.manifest.nodes.iter().map(row).collect()
}

#[test]
fn random_damage_is_never_served_and_the_next_run_repairs_it() {
    let bench = Bench::new();
    let ballast = |plus: i64| json!({ "plus": plus, "ballast": 3000 + plus });
    let wide: &[&str] = &["a", "b", "c", "d"];
    let graph = graph(&[
        ("a", ballast(1), &[]),
        ("b", ballast(2), &["a"]),
        ("c", ballast(3), &["a"]),
        ("d", ballast(4), &["b", "c"]),
        ("sum", ballast(5), wide),
    ]);
    let (first, _) = bench.run(&graph);
    let (whole, mut last) = (made(&first), first.path);
    let options = Options { force: Force::Unrecorded, ..Options::default() };
    let mut random = ChaCha12Rng::seed_from_u64(3);
    for _ in 0..damages() {
        let files = kept_files(bench.store.root(), &last);
        let path = &files[random.random_range(0..files.len())];
        let what = format!("{} of {}", damage(path, &mut random), path.display());
        assert_eq!(Manifest::read(&last).is_err(), path.starts_with(&last), "after {what}");
        let (report, _) = bench.run_with(&graph, &options);
        assert_eq!((report.state, made(&report)), (RunState::Finished, whole.clone()), "after {what}");
        let found = verify(&bench.store, std::slice::from_ref(&report.path), false);
        assert!(found.problems.is_empty(), "after {what}: {:?}", found.problems);
        fs::remove_dir_all(std::mem::replace(&mut last, report.path)).unwrap();
    }
}

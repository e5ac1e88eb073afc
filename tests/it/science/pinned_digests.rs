//! What every kind of stage makes from tiny inputs, pinned by kind version: a change of results cannot pass unseen,
//! because the store would go on serving the old ones.

use crate::support::stages;
use std::collections::BTreeSet;

use carl_pipe::stage;

/// (artifact of the tiny chain, its kind, the kind's version, the digest's first 16 digits). On failure raise the
/// versions that the message names and paste its lines.
const PINNED: &[(&str, &str, u32, &str)] = &[
    ("bootstrap", "generate_data", 2, "6226fbac14da9ea5"),
    ("model", "train_lce", 3, "9320fa6ddb00e128"),
    ("agent", "train_sac", 2, "e07b5d8bdf457106"),
    ("collected", "collect", 1, "9f1103bca6c57d85"),
    ("next_model", "train_lce", 3, "10d55ab89ef00595"),
    ("guided_model", "train_lce", 3, "fbb7d66ccd2309bc"),
    ("amortized_model", "train_lce", 3, "58f0c982bc614b11"),
    ("distilled", "distill_policy", 1, "9c2dd8093a7145fc"),
    ("next_agent", "train_sac", 2, "0475572a0c9ea4c8"),
    ("evaluation", "evaluate", 1, "f6ce16218a838441"),
    ("ilqr", "control_ilqr", 2, "7db2007a91ed92e1"),
    ("planned", "evaluate", 1, "a13a6c3e6a9009cb"),
    ("map", "export_latent_map", 3, "267f17275bcb5402"),
    ("summary", "summarize", 1, "18deb0c19efd064b"),
    ("trajectories", "generate_trajectories", 1, "1553d97c882fe52f"),
    ("solar_model", "train_solar", 1, "f9eebeea7fb57d0a"),
    ("solar_controller", "control_solar", 1, "ed4d1181b594706f"),
    ("solar_evaluation", "evaluate", 1, "4c144eb1f4b82591"),
];

#[test]
fn the_results_of_every_kind_are_those_of_its_version() {
    let chain = stages::Chain::run();
    let (mut changed, mut wrong) = (BTreeSet::new(), Vec::new());
    for (name, kind, inputs, files) in chain.all() {
        let version = stage::kind(kind).expect("a kind").version;
        let digest = &stages::digest(files).hex()[..16];
        if PINNED.contains(&(name, kind, version, digest)) {
            continue;
        }
        changed.insert(name);
        let line = format!("(\"{name}\", \"{kind}\", {version}, \"{digest}\"),");
        let fed = inputs.iter().find(|input| changed.contains(*input));
        let was_raised = !PINNED.iter().any(|pinned| pinned.1 == kind && pinned.2 == version);
        wrong.push(match fed {
            Some(input) => format!("`{name}` follows the change of `{input}`: pin {line}"),
            None if was_raised => format!("{kind} has a new version: pin {line}"),
            None => format!("results of {kind} changed: raise its VERSION and pin {digest}, as in {line}"),
        });
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_kind_is_pinned() {
    let pinned: BTreeSet<_> = PINNED.iter().map(|pinned| pinned.1).collect();
    let mut kinds: BTreeSet<_> = stage::registry().iter().map(|kind| kind.name).collect();
    // What these two make is what a program or a file of the user says. Tests of their own check it.
    assert!(kinds.remove("command") && kinds.remove("import_data"));
    assert_eq!(pinned, kinds);
}

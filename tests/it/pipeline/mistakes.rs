//! Every mistake a pipeline file or an argument can hold, as the user sees it: compared with `tests/it/pipeline/mistakes/`.
//!
//! `UPDATE_SNAPSHOTS=1 cargo test --test it pipeline::mistakes` writes those files anew; read the difference before you commit.

use std::{fmt::Write as _, fs, path::Path};

use crate::support::pipeline::{ONLINE, kinds, overrides};
use carl_pipe::{
    pipeline::{Overrides, Source, load},
    stage,
};

fn rendered(bytes: &[u8], overrides: &Overrides) -> String {
    match load(&Source::new("p.toml", bytes), overrides, kinds()) {
        Ok(graph) => panic!("{} nodes and no mistake", graph.nodes.len()),
        Err(mistakes) => mistakes.render(false),
    }
}

/// Compares with the file called `topic`, case by case under their names.
fn expect(topic: &str, cases: &[(&str, String)]) {
    let mut text = String::new();
    for (name, rendered) in cases {
        _ = writeln!(text, "## {name}\n{}", rendered);
    }
    let path = Path::new("tests/it/pipeline/mistakes").join(format!("{topic}.txt"));
    if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
        fs::create_dir_all("tests/it/pipeline/mistakes").unwrap();
        fs::write(&path, &text).unwrap();
    }
    let expected = fs::read_to_string(&path).unwrap_or_default();
    assert!(text == expected, "{} differs; now it is:\n{text}", path.display());
}

/// The online pipeline, changed.
fn changed(from: &str, to: &str) -> String {
    assert!(ONLINE.contains(from), "{from}");
    rendered(ONLINE.replacen(from, to, 1).as_bytes(), &Overrides::default())
}

fn added(text: &str) -> String {
    rendered(format!("{ONLINE}{text}").as_bytes(), &Overrides::default())
}

fn argued(set: &[&str], sweep: &[&str]) -> String {
    rendered(ONLINE.as_bytes(), &overrides(set, sweep))
}

#[test]
fn a_file_that_is_no_pipeline() {
    let bytes = |bytes: &[u8]| rendered(bytes, &Overrides::default());
    expect(
        "file",
        &[
            ("empty", bytes(b"")),
            ("blank", bytes(b" \n\n")),
            ("only a comment", bytes(b"# hello\n")),
            ("not UTF-8", bytes(b"schema = 1\nname = \"\xff\"\n")),
            ("no value", bytes(b"schema = 1\nname =\n")),
            ("a key twice", bytes(b"schema = 1\nschema = 1\n")),
            ("a stage twice", bytes(b"[stages.a]\nkind = \"x\"\n[stages.a]\n")),
            ("an open string", bytes(b"name = \"abc\n")),
        ],
    );
}

#[test]
fn the_top_level() {
    expect(
        "top_level",
        &[
            ("unknown key", changed("seed = 0", "sede = 0")),
            ("stage outside of stages", added("\n[summary]\nkind = \"summarize\"\n")),
            ("no schema", changed("schema = 1\n", "")),
            ("newer schema", changed("schema = 1", "schema = 2")),
            ("schema of the wrong type", changed("schema = 1", "schema = \"1\"")),
            ("no name", changed("name = \"planar_online\"\n", "")),
            ("a name with a space", changed("planar_online", "planar online")),
            ("name of the wrong type", changed("\"planar_online\"", "3")),
            ("negative seed", changed("seed = 0", "seed = -1")),
            ("seed of the wrong type", changed("seed = 0", "seed = \"0\"")),
            ("unknown preset", changed("\"recipe\"", "\"recipes\"")),
            ("no rounds", changed("rounds = 17", "")),
            ("zero rounds", changed("rounds = 17", "rounds = 0")),
            ("rounds of the wrong type", changed("rounds = 17", "rounds = \"many\"")),
            ("unknown key of the loop", changed("rounds = 17", "rounds = 17\nround = 3")),
            ("no loop", changed("[loop]\nrounds = 17\n", "")),
            ("stages of the wrong type", rendered(b"schema = 1\nname = \"a\"\nstages = 3\n", &Overrides::default())),
            ("task without env", changed("env = \"planar\"", "")),
            ("no task", changed("[task]\nenv = \"planar\"", "")),
            ("unknown env", changed("env = \"planar\"", "env = \"planer\"")),
            ("unknown option of the task", changed("env = \"planar\"", "env = \"planar\"\nnois = 0.1")),
            ("option of the wrong type", changed("env = \"planar\"", "env = \"planar\"\nnoise = \"loud\"")),
            ("option of another task", changed("env = \"planar\"", "env = \"planar\"\ntorque = 1.0")),
            ("options out of range", changed("env = \"planar\"", "env = \"swing_up\"\nnoise = -1\nstep = 3.0")),
        ],
    );
}

#[test]
fn stages() {
    let name = |name: &str| changed("[stages.map]", &format!("[stages.{name}]"));
    expect(
        "stages",
        &[
            ("unknown kind", changed("\"train_lce\"", "\"train_lec\"")),
            ("unknown kind unlike any", changed("\"train_lce\"", "\"bake_bread\"")),
            ("no kind", changed("kind = \"train_lce\"", "")),
            ("kind of the wrong type", changed("kind = \"train_lce\"", "kind = 3")),
            ("empty name", name("\"\"")),
            ("name with @", name("\"map@3\"")),
            ("name with a bracket", name("\"map[1]\"")),
            ("name with a dot", name("\"map.x\"")),
            ("name with a space", name("\"a map\"")),
            ("reserved name", name("seed")),
            ("loop of the wrong type", changed("loop = { from = 1 }", "loop = 1")),
            ("unknown key of a stage's loop", changed("loop = { from = 1 }", "loop = { start = 1 }")),
            ("first outside of the loop", changed("samples = 1024", "samples = 1024\nfirst = { samples = 3 }")),
            ("empty stream", changed("samples = 1024", "samples = 1024\nstream = \"\"")),
            ("no stage", rendered(b"schema = 1\nname = \"a\"\n[task]\nenv = \"planar\"\n", &Overrides::default())),
        ],
    );
}

#[test]
fn parameters() {
    expect(
        "parameters",
        &[
            ("unknown parameter", changed("epochs = 15", "epoch = 15")),
            ("unknown nested parameter", changed("epochs = 15", "lambda.consistensy = 15")),
            ("unknown parameter in first", changed("{ epochs = 400 }", "{ epoch = 400 }")),
            ("wrong type", changed("epochs = 15", "epochs = \"15\"")),
            ("fraction for a whole number", changed("epochs = 15", "epochs = 1.5")),
            ("negative for a whole number", changed("epochs = 15", "epochs = -15")),
            ("nested wrong type", changed("epochs = 15", "lambda = { curvature = true }")),
            ("number for a table", changed("epochs = 15", "lambda = 3")),
            ("unknown choice", changed("\"carl\"", "\"karl\"")),
            ("nan", changed("epochs = 15", "learning_rate = nan")),
            ("inf", changed("epochs = 15", "lambda.curvature = -inf")),
            ("too large for a float", changed("epochs = 15", "learning_rate = 1e999")),
            ("too large for an integer", changed("epochs = 15", "epochs = 99999999999999999999999")),
            ("out of range", changed("epochs = 15", "learning_rate = 0")),
            ("nested out of range", changed("epochs = 15", "lambda.consistency = -1")),
            ("out of range in first", changed("{ epochs = 400 }", "{ learning_rate = -0.5 }")),
            ("out of range by default", changed("epochs = 15", "epochs = 666")),
            (
                "several",
                changed("epochs = 15", "epoch = 15\nlearning_rate = \"fast\"\nlambda = { x = 1, consistency = 0 }"),
            ),
        ],
    );
}

/// Of the real kinds, since the names come from the task.
#[test]
fn symmetries() {
    let of = |env: &str, train_lce: &str, train_sac: &str| {
        let text = format!(
            "schema = 1\nname = \"a\"\n[task]\nenv = \"{env}\"\n\n[stages.data]\nkind = \"generate_data\"\n\n\
             [stages.map]\nkind = \"train_lce\"\n{train_lce}\ninputs = {{ transitions = \"data\" }}\n\n\
             [stages.control]\nkind = \"train_sac\"\n{train_sac}\n\
             inputs = {{ transitions = \"data\", model = \"map\" }}\n"
        );
        match load(&Source::new("p.toml", text), &Overrides::default(), stage::registry()) {
            Ok(_) => "no mistake\n".to_owned(),
            Err(mistakes) => mistakes.render(false),
        }
    };
    let both = "symmetries = { mirror = 0.5, shift = 0.3 }";
    expect(
        "symmetries",
        &[
            ("right", of("cart_pole", both, both)),
            ("unknown", of("cart_pole", "symmetries = { miror = 0.5 }", "symmetries.rotation = 1")),
            ("of another task", of("swing_up", both, both)),
            ("of a task without any", of("planar", "symmetries.mirror = 0.5", "")),
            ("no share", of("cart_pole", "symmetries = { mirror = 1.5, shift = -0.1 }", "symmetries.shift = 2")),
            ("wrong type", of("cart_pole", "symmetries.mirror = true", "symmetries = [\"mirror\"]")),
            ("copies", of("cart_pole", "symmetric_copies = 0", "symmetric_copies = 101")),
            ("with L_reg", of("cart_pole", "symmetries.mirror = 0.5\nlambda.regularizer = 0.1", "")),
            ("without effect on L_reg", of("swing_up", "symmetries.mirror = 0\nlambda.regularizer = 0.1", "")),
        ],
    );
}

#[test]
fn inputs() {
    let warm = |to: &str| changed("warm_start = \"represent@prev\"", to);
    expect(
        "inputs",
        &[
            ("unknown input", warm("warm_stat = \"represent@prev\"")),
            ("unknown stage", warm("warm_start = \"represnet@prev\"")),
            ("wrong artifact", warm("warm_start = \"control@prev\"")),
            ("artifact nobody gives", changed("[stages.map]", "[stages.s]\nkind = \"summarize\"\n[stages.map]")),
            ("required input left out", changed("agent = \"control\" }\nepisodes", "}\nepisodes")),
            ("wrong type", warm("warm_start = 3")),
            ("wrong type in a list", warm("warm_start = [true]")),
            ("no name", warm("warm_start = \"@prev\"")),
            ("unknown selector", warm("warm_start = \"represent@previous\"")),
            ("a point of the matrix", warm("warm_start = \"represent@prev[seed=2]\"")),
            ("empty list for a required input", changed("[\"bootstrap\", \"collect@sofar\"]", "[]")),
            ("same round of itself", warm("warm_start = \"represent\"")),
            (
                "required round that does not exist",
                changed(
                    "model = \"represent\", agent = \"control\"",
                    "model = \"represent@prev\", agent = \"control\"",
                ),
            ),
            ("round beyond the loop", warm("warm_start = \"represent@17\"")),
            ("round of a stage outside of the loop", changed("\"bootstrap\"", "\"bootstrap@prev\"")),
            ("last inside of the loop", warm("warm_start = \"represent@last\"")),
            ("all inside of the loop", changed("collect@sofar", "collect@all")),
            ("many into one", changed("model = \"represent\", agent", "model = \"represent@sofar\", agent")),
            ("the same twice", changed("\"collect@sofar\"", "\"collect@sofar\", \"collect\"")),
            (
                "no round from outside",
                added("[stages.s]\nkind = \"summarize\"\ninputs = { evaluations = \"evaluate\" }\n"),
            ),
            (
                "prev from outside",
                added("[stages.s]\nkind = \"summarize\"\ninputs = { evaluations = \"evaluate@prev\" }\n"),
            ),
            (
                "a star into one",
                added(
                    "[stages.m]\nkind = \"export_latent_map\"\ninputs = { model = \"represent@last[*]\" }\n[matrix]\nseed = [1, 2]\n",
                ),
            ),
            ("inputs of the wrong type", changed("{ model = \"represent\", agent = \"control\" }", "\"represent\"")),
        ],
    );
}

#[test]
fn circles_and_shared_randomness() {
    let twice = "[stages.more]\nkind = \"generate_data\"\nsamples = 10\n";
    expect(
        "circles",
        &[
            ("two stages", changed("agent = \"control@prev\"", "agent = \"control\"")),
            (
                "itself and two",
                changed(
                    "{ model = \"represent@prev\", agent = \"control@prev\" }",
                    "{ model = \"represent\", agent = \"control\" }",
                ),
            ),
            (
                "the same randomness twice",
                rendered(
                    format!("{}{twice}", ONLINE.replacen("\"bootstrap\", ", "\"bootstrap\", \"more\", ", 1)).as_bytes(),
                    &Overrides::default(),
                ),
            ),
        ],
    );
}

#[test]
fn the_matrix() {
    let matrix = |text: &str| added(&format!("\n[matrix]\n{text}\n"));
    expect(
        "matrix",
        &[
            ("unknown stage", matrix("\"represnt.epochs\" = [1]")),
            ("unknown parameter", matrix("\"represent.lambda.consistensy\" = [1, 2]")),
            ("unknown parameter dotted", matrix("represent.epoch = [1, 2]")),
            ("a stage", matrix("represent = [1]")),
            ("inputs", matrix("\"represent.inputs.model\" = [\"a\"]")),
            ("unknown option of the task", matrix("\"task.nois\" = [1, 2]")),
            ("task", matrix("task = [1]")),
            ("first outside of the loop", matrix("\"bootstrap.first.samples\" = [1]")),
            ("wrong type of a value", matrix("\"represent.epochs\" = [1, \"two\"]")),
            ("value out of range", matrix("\"represent.learning_rate\" = [0.1, -1]")),
            ("nan", matrix("\"represent.learning_rate\" = [0.1, nan]")),
            ("twice by two spellings", matrix("\"represent.epochs\" = [1]\nrepresent.epochs = [2]")),
            ("a value twice", matrix("\"represent.lambda.curvature\" = [1, 1.0]")),
            ("no list", matrix("seed = 3")),
            ("no range", matrix("seed = \"all\"")),
            ("empty range", matrix("seed = \"5..5\"")),
            ("inclusive range", matrix("seed = \"0..=5\"")),
            ("huge range", matrix("seed = \"0..99999999\"")),
            ("empty list", matrix("seed = []")),
            ("negative seed", matrix("seed = [-1]")),
            ("unknown preset", matrix("preset = [\"paper\", \"ours\"]")),
            ("a list as a value", matrix("seed = [[1]]")),
            ("a text that is no name", matrix("\"represent.objective\" = [\"a b\"]")),
            ("explosion", matrix("seed = \"0..1000\"\n\"represent.epochs\" = \"1..1000\"")),
            ("wrong type", rendered(format!("matrix = 3\n{ONLINE}").as_bytes(), &Overrides::default())),
        ],
    );
}

#[test]
fn arguments() {
    expect(
        "arguments",
        &[
            ("no value", argued(&["represent.epochs"], &[])),
            ("empty value", argued(&["represent.epochs="], &[])),
            ("no path", argued(&["=3"], &[])),
            ("empty part", argued(&["represent..epochs=3"], &[])),
            ("unknown stage", argued(&["represnt.epochs=3"], &[])),
            ("unknown parameter", argued(&["represent.epoch=3"], &[])),
            ("wrong type", argued(&["represent.epochs=abc"], &[])),
            ("out of range", argued(&["represent.lambda.consistency=-3"], &[])),
            ("a stage", argued(&["represent=3"], &[])),
            ("below a number", argued(&["represent.epochs.x=3"], &[])),
            ("rounds", argued(&["rounds=0"], &[])),
            ("seed", argued(&["seed=x"], &[])),
            ("several", argued(&["seed=x", "represent.epoch=3"], &["task.nois=1,2"])),
            ("sweep without values", argued(&[], &["seed="])),
            ("sweep of nothing", argued(&[], &["sede=1,2"])),
            ("sweep twice", argued(&[], &["seed=1,2", "seed=3"])),
            ("empty range", argued(&[], &["seed=3..3"])),
            ("wrong type in a sweep", argued(&[], &["represent.epochs=1,x"])),
            ("a parameter that is an axis", argued(&["represent.epochs=3"], &["represent.epochs=1,2"])),
            (
                "seed that is an axis",
                rendered(format!("{ONLINE}\n[matrix]\nseed = [1]\n").as_bytes(), &overrides(&["seed=3"], &[])),
            ),
        ],
    );
}

#[test]
fn all_mistakes_of_a_file_appear_at_once_in_their_order() {
    let text = ONLINE
        .replace("seed = 0", "seed = -1")
        .replace("noise", "nois")
        .replace("\"train_sac\"", "\"train_sack\"")
        .replace("epochs = 15", "epoch = 15")
        .replace("agent = \"control@prev\" }", "agent = \"represent\" }")
        .replace("episodes = 10", "episodes = 1.5");
    expect("all_at_once", &[("six", rendered(text.as_bytes(), &overrides(&["represent.epochs=abc"], &[])))]);
}

#[test]
fn programs_read_line_and_column() {
    let text = ONLINE.replace("epochs = 15", "epoch = 15");
    let mistakes = load(&Source::new("p.toml", text), &Overrides::default(), kinds()).unwrap_err();
    assert_eq!(
        mistakes.to_json(),
        serde_json::json!([{
            "message": "`train_lce` has no parameter `epoch`", "source": "p.toml",
            "line": 28, "column": 1, "end_line": 28, "end_column": 6,
            "label": "unknown", "help": "did you mean `epochs`?",
        }])
    );
}

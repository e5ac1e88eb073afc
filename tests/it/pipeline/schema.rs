//! The schema for editors takes all shipped files and sees the mistakes that it can see.
//!
//! Needs `pip install -r tests/python/requirements.txt`; without it the test says so and passes.

use std::{path::Path, process::Command};

use crate::support::python::python_has;
use carl_pipe::{pipeline::schema, stage::registry};

/// Checks files, and texts with one mistake each, against a schema. Prints what goes wrong.
const SCRIPT: &str = r#"
import json, pathlib, sys, tomllib, jsonschema
schema = json.loads(pathlib.Path(sys.argv[1]).read_text())
jsonschema.Draft201909Validator.check_schema(schema)
validator = jsonschema.Draft201909Validator(schema)
for path in sys.argv[2:]:
    for error in validator.iter_errors(tomllib.loads(pathlib.Path(path).read_text())):
        print(path, error.json_path, error.message[:200])
head = 'schema = 1\nname = "x"\n[task]\nenv = "planar"\n[stages.a]\n'
wrong = ['kind = "train_lc"', 'kind = "train_lce"\nepoch = 3', 'kind = "train_lce"\nepochs = "three"',
    'kind = "train_lce"\ninputs = { transition = "b" }', 'kind = "command"\nargv = "true"', 'kind = "evaluate"\nstart = "nowhere"']
for text in wrong:
    if not list(validator.iter_errors(tomllib.loads(head + text))):
        print("not seen:", text)
"#;

#[test]
fn the_schema_takes_every_shipped_file_and_sees_mistakes() {
    if !python_has("jsonschema, tomllib") {
        return;
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let files = std::fs::read_dir(root.join("pipelines")).unwrap().map(|item| item.unwrap().path());
    let mut files: Vec<_> = files.filter(|path| path.extension().is_some_and(|it| it == "toml")).collect();
    files.push(root.join("examples/command/pipeline.toml"));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("schema.json");
    std::fs::write(&path, schema(registry()).to_string()).unwrap();
    let output = Command::new("python3").args(["-c", SCRIPT]).arg(&path).args(&files).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.is_empty(), "{said}");
}

//! A recording opens in Python without us: every message is decoded by the schemas that the file itself carries.
//!
//! Needs `pip install -r tests/python/requirements.txt`; without it the test says so and passes.

use crate::support::{python::python_has, recording};
use std::{path::Path, process::Command};

#[test]
fn python_decodes_every_message() {
    if !python_has("mcap, mcap_protobuf") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    recording::write_run(folder.path(), 5);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/read_mcap.py");
    let files = ["represent@0.mcap", "control@0.mcap", "evaluate@0.mcap"].map(|file| folder.path().join(file));
    let output = Command::new("python3").arg(script).args(files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let expected = "\
1 /evaluate/obstacles foxglove.PointCloud ['radius', 'x', 'y', 'z']
1 /evaluate/percent_goal carl.scalars.EvaluatePercentGoal ['percent_goal', 'policy_alone', 'paper', 'ceiling']
10 /evaluate/trajectory carl.Trajectory [41]
12 /latent/map foxglove.PointCloud ['alpha', 'blue', 'col', 'green', 'red', 'row', 'x', 'y', 'z']
12 /latent/map/goals foxglove.PointCloud ['alpha', 'blue', 'green', 'red', 'x', 'y', 'z']
12 /latent/map/quality carl.scalars.LatentMapQuality ['quality']
1 /log foxglove.Log ['the latent map keeps the shape of the true space']
12 /picture/observation foxglove.RawImage [40, 40]
12 /picture/prediction foxglove.RawImage [40, 40]
12 /picture/reconstruction foxglove.RawImage [40, 40]
600 /train/lce carl.scalars.TrainLce ['total', 'prediction', 'consistency', 'curvature', 'noise']
300 /train/sac carl.scalars.TrainSac ['critic', 'actor', 'temperature', 'entropy']
";
    let seen = String::from_utf8(output.stdout).unwrap();
    assert_eq!(seen, expected);
}

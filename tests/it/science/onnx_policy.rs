//! An exported policy gives our actions in a runtime of somebody else.
//!
//! Needs `pip install -r tests/python/requirements.txt`; without it the test says so and passes.

use std::{fs, path::Path, process::Command};

use crate::support::python::python_has;
use carl_pipe::{
    arrays::{Dtype, NpzWriter},
    control::{Agent, agent::Whitening},
    lce::{Differences, ImageNetworks, LceModel, SharedFrames, Sizes},
    nn::binary_images::{Likelihood, PooledPatches},
    num::{rng::Rng, sampling},
    onnx,
    stage::network_sizes,
};
use rand::SeedableRng as _;

/// The networks of all tasks, and one of each kind that they leave out.
fn sizes() -> Vec<(String, Sizes, (usize, usize))> {
    let mut all = Vec::new();
    for env in ["planar", "swing_up", "cart_pole", "three_pole"] {
        let task: carl_pipe::env::Task = serde_json::from_value(serde_json::json!({ "env": env })).unwrap();
        all.push((env.to_owned(), network_sizes(&task), task.spec().frames.observation()));
    }
    let pixels = 2 * 16 * 24;
    let base = Sizes { pixels, latent: 3, encoder: [60, 20], decoder: [20, 60], ..all[0].1.clone() };
    let patches = PooledPatches { columns: 24, side: 4 };
    let shaded = Sizes { shades: Some(Likelihood::default()), ..base.clone() };
    all.push(("shades".to_owned(), shaded, (32, 24)));
    let conv = ImageNetworks::Convolutional { frames: 2, rows: 16, columns: 24 };
    all.push(("patches".to_owned(), Sizes { images: ImageNetworks::Patches(patches), ..base.clone() }, (32, 24)));
    all.push(("convolutional".to_owned(), Sizes { images: conv, ..base.clone() }, (32, 24)));
    let forms =
        [Differences::None, Differences::Scaled { scale: 3.0 }, Differences::Mixed { scale: 3.0, coordinates: 2 }];
    for differences in forms {
        let frames = SharedFrames { read: patches, predicted: patches, coordinates: 2, differences };
        let images = ImageNetworks::SharedFrames(frames);
        let sizes = Sizes { images, latent: frames.latent(), ..base.clone() };
        all.push((format!("shared frames, {differences:?}"), sizes, (32, 24)));
    }
    // The large ones of the tasks come last.
    all.rotate_left(4);
    all
}

/// Runs a policy in onnxruntime: `policy.onnx` and `pictures.npz` in a folder give the actions as JSON.
const SCRIPT: &str = r#"
import json, sys, numpy as np, onnxruntime
folder = sys.argv[1]
session = onnxruntime.InferenceSession(folder + "/policy.onnx", providers=["CPUExecutionProvider"])
data = np.load(folder + "/pictures.npz")
(one,) = session.run(["action"], {"observation": data["observations"], "goal": data["goals"][:1]})
(each,) = session.run(["action"], {"observation": data["observations"][:len(data["goals"])], "goal": data["goals"]})
print(json.dumps([one.ravel().tolist(), each.ravel().tolist()]))
"#;

#[test]
fn onnxruntime_gives_our_actions_within_a_hundred_thousandth() {
    if !python_has("numpy, onnxruntime") {
        return;
    }
    for (name, sizes, picture) in sizes() {
        let mut rng = Rng::seed_from_u64(7);
        let (count, own_goals) = (1000, 20);
        let has_shades = sizes.shades.is_some();
        let mut draw = |count: usize, one_in: usize| -> Vec<u8> {
            let shade = |rng: &mut Rng| if has_shades { sampling::index(rng, 256) as u8 } else { 255 };
            let pixels = 0..count * sizes.pixels;
            pixels.map(|_| if sampling::index(&mut rng, one_in) == 0 { shade(&mut rng) } else { 0 }).collect()
        };
        let (observations, goals) = (draw(count, 40), draw(own_goals, 60));
        let background: Vec<u8> = draw(1, 2).iter().map(|&pixel| u8::from(pixel != 0)).collect();
        let model: LceModel = LceModel::new(sizes.clone(), background, &mut rng);
        let n = sizes.latent;
        let whitening = Whitening { mean: vec![0.1; n], inverse: (0..n).map(|k| 1.0 + k as f32).collect() };
        let agent = Agent::new(n, sizes.action, Some(whitening), 0.0, &mut rng);
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("policy.onnx"), onnx::export(&model, &agent, picture, &[]).unwrap()).unwrap();
        let mut npz = NpzWriter::new(fs::File::create(folder.path().join("pictures.npz")).unwrap());
        for (name, count, bytes) in [("observations", count, &observations), ("goals", own_goals, &goals)] {
            npz.add(name, Dtype::U8, &[count, picture.0, picture.1], bytes).unwrap();
        }
        npz.finish().unwrap();
        let codes = model.encode_means(&model.pictures(&observations));
        let goals = model.encode_means(&model.pictures(&goals));
        let one: Vec<f32> = goals[..n].iter().copied().cycle().take(count * n).collect();
        let ours = [agent.act(&codes, &one, None), agent.act(&codes[..own_goals * n], &goals, None)];
        let furthest = furthest(folder.path(), &ours);
        eprintln!("{name}: {furthest:e}");
        assert!(furthest < 1e-5, "{name}: {furthest:e}");
    }
}

/// The largest difference between our actions and those of onnxruntime.
fn furthest(folder: &Path, ours: &[Vec<f32>; 2]) -> f64 {
    let output = Command::new("python3").args(["-c", SCRIPT]).arg(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let theirs: [Vec<f64>; 2] = serde_json::from_slice(&output.stdout).unwrap();
    let mut furthest: f64 = 0.0;
    for (ours, theirs) in ours.iter().zip(&theirs) {
        assert_eq!(ours.len(), theirs.len());
        let spread = ours.iter().fold(0.0_f32, |most, action| most.max(action.abs()));
        assert!(spread > 1e-4, "all actions are about 0");
        for (ours, theirs) in ours.iter().zip(theirs) {
            furthest = furthest.max((f64::from(*ours) - theirs).abs());
        }
    }
    furthest
}

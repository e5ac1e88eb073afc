//! Dynamics and pictures of an independent implementation of the tasks, reproduced: every pixel, and states to the bit
//! or as close as other sines and cosines allow.
//!
//! Data: `CARL_GOLDEN` (default `tests/golden`); counts and sizes are taken from the files.

use std::path::PathBuf;

use carl_pipe::env::{System, Task};
use rand::SeedableRng;
use serde_json::{Value, json};

/// A task as its files call it, with the options it was made with, and the largest difference of a next state.
struct Golden {
    name: &'static str,
    task: Value,
    tolerance: f64,
}

fn all() -> [Golden; 4] {
    let [planar, pendulum, cart_pole, three_pole] = [
        json!({ "env": "planar" }),
        json!({ "env": "swing_up", "step": 0.02, "torque": 1.0 }),
        json!({ "env": "cart_pole", "step": 0.02 }),
        json!({ "env": "three_pole" }),
    ];
    [
        Golden { name: "planar", task: planar, tolerance: 0.0 },
        Golden { name: "swing_up", task: pendulum, tolerance: 1e-13 },
        Golden { name: "cart_pole", task: cart_pole, tolerance: 1e-13 },
        // Its inertia is inverted in another way there, and errors grow in a step.
        Golden { name: "three_pole", task: three_pole, tolerance: 1e-8 },
    ]
}

fn open(mut task: Value, tuple: &Value) -> Box<dyn System> {
    if let Some(torque) = tuple.get("torque") {
        task["torque"] = torque.clone();
    }
    let task: Task = serde_json::from_value(task).expect("a task");
    assert_eq!(task.check(), []);
    task.system().expect("equations")
}

fn path(file: &str) -> PathBuf {
    std::env::var_os("CARL_GOLDEN").map_or_else(|| PathBuf::from("tests/golden"), PathBuf::from).join(file)
}

fn read(file: &str) -> Vec<u8> {
    std::fs::read(path(file)).unwrap_or_else(|e| panic!("{}: {e}", path(file).display()))
}

impl Golden {
    /// The objects of a list of the file; there are some.
    fn list(&self, of: &str) -> Vec<Value> {
        let file: Value = serde_json::from_slice(&read(&format!("{}.json", self.name))).expect("JSON");
        let list = file[of].as_array().unwrap_or_else(|| panic!("no list `{of}`"));
        assert!(!list.is_empty());
        list.clone()
    }

    /// The frames of the file, with their height and width.
    fn frames(&self) -> (Vec<Vec<u8>>, (usize, usize)) {
        let bytes = read(&format!("{}_frames.npy", self.name));
        let file = npyz::NpyFile::new(&bytes[..]).expect("an npy file");
        let [count, height, width] = *file.shape() else { panic!("frames of shape {:?}", file.shape()) };
        let pixels = file.into_vec::<u8>().expect("uint8");
        let frames: Vec<_> = pixels.chunks((height * width) as usize).map(<[u8]>::to_vec).collect();
        assert_eq!(frames.len(), count as usize);
        (frames, (height as usize, width as usize))
    }
}

fn numbers(value: &Value, name: &str) -> Vec<f64> {
    let list = value[name].as_array().unwrap_or_else(|| panic!("no list `{name}`"));
    list.iter().map(|x| x.as_f64().expect("a number")).collect()
}

/// The number in the name of a frame, such as `planar_frame_07.png`.
fn frame_number(render: &Value) -> usize {
    let name = render["file"].as_str().expect("a name");
    let digits: String = name.chars().filter(char::is_ascii_digit).collect();
    digits.parse().unwrap_or_else(|_| panic!("no number in `{name}`"))
}

#[test]
fn golden_next_states_are_reproduced() {
    let mut rng = SeedableRng::seed_from_u64(0);
    for golden in all() {
        let mut largest = 0.0_f64;
        for (i, tuple) in golden.list("tuples").iter().enumerate() {
            let env = open(golden.task.clone(), tuple);
            let (s, u, want) = (numbers(tuple, "s"), numbers(tuple, "u"), numbers(tuple, "s_next"));
            let got = env.step(&s, &u, &mut rng);
            assert_eq!(got.len(), want.len());
            let off = got.iter().zip(&want).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let told = format!("{} {i} ({}): {s:?} and {u:?} give {got:?}, not {want:?}", golden.name, tuple["kind"]);
            assert!(off <= golden.tolerance, "{told}, {off:e} off");
            largest = largest.max(off);
        }
        println!("{}: at most {largest:e} off", golden.name);
    }
}

#[test]
fn golden_frames_are_equal_in_every_pixel() {
    for golden in all() {
        let env = open(golden.task.clone(), &Value::Null);
        let (frames, (height, width)) = golden.frames();
        assert_eq!((env.frames().height, env.frames().width), (height, width));
        for render in golden.list("renders") {
            let (file, state) = (frame_number(&render), numbers(&render, "s"));
            // What was there does not matter.
            let mut frame = vec![77; height * width];
            env.render(&state, &mut frame);
            if let Some(at) = frame.iter().zip(&frames[file]).position(|(a, b)| a != b) {
                let (row, column) = (at / width, at % width);
                panic!("{} {file} of {state:?} differs first at row {row}, column {column}", golden.name);
            }
            let lit = frame.iter().filter(|&&p| p == 255).count();
            assert_eq!(Some(lit as u64), render["lit"].as_u64(), "lit pixels of {} {file}", golden.name);
        }
    }
}

//! Dynamics and pictures of an independent implementation of the planar system, reproduced to the bit.
//!
//! Data: `CARL_GOLDEN` (default `tests/golden`); counts and sizes are taken from the files.

use std::path::PathBuf;

use carl_pipe::env::{Environment as _, Planar};
use serde_json::Value;

fn path(file: &str) -> PathBuf {
    std::env::var_os("CARL_GOLDEN").map_or_else(|| PathBuf::from("tests/golden"), PathBuf::from).join(file)
}

fn read(file: &str) -> Vec<u8> {
    std::fs::read(path(file)).unwrap_or_else(|e| panic!("{}: {e}", path(file).display()))
}

fn planar_json() -> Value {
    serde_json::from_slice(&read("planar.json")).expect("JSON")
}

fn list<'a>(value: &'a Value, name: &str) -> &'a [Value] {
    value[name].as_array().unwrap_or_else(|| panic!("no list `{name}`"))
}

fn numbers(value: &Value, name: &str) -> Vec<f64> {
    list(value, name).iter().map(|x| x.as_f64().expect("a number")).collect()
}

/// The pictures of the file, with their height and width.
fn frames() -> (Vec<Vec<u8>>, [usize; 2]) {
    let bytes = read("planar_frames.npy");
    let file = npyz::NpyFile::new(&bytes[..]).expect("an npy file");
    let [count, height, width] = *file.shape() else { panic!("pictures of shape {:?}", file.shape()) };
    let pixels = file.into_vec::<u8>().expect("uint8");
    let frames: Vec<_> = pixels.chunks((height * width) as usize).map(<[u8]>::to_vec).collect();
    assert_eq!(frames.len(), count as usize);
    (frames, [height as usize, width as usize])
}

/// The number in the name of a picture, such as `planar_frame_07.png`.
fn frame_number(render: &Value) -> usize {
    let name = render["file"].as_str().expect("a name");
    let digits: String = name.chars().filter(char::is_ascii_digit).collect();
    digits.parse().unwrap_or_else(|_| panic!("no number in `{name}`"))
}

#[test]
fn golden_planar_next_states_are_equal_to_the_bit() {
    let golden = planar_json();
    let tuples = list(&golden, "tuples");
    assert!(!tuples.is_empty());
    for (i, tuple) in tuples.iter().enumerate() {
        let (s, u, want) = (numbers(tuple, "s"), numbers(tuple, "u"), numbers(tuple, "s_next"));
        let got = Planar::dynamics(&s, &u);
        let same = got.len() == want.len() && got.iter().zip(&want).all(|(a, b)| a.to_bits() == b.to_bits());
        assert!(same, "tuple {i} ({}): {s:?} and {u:?} give {got:?}, not {want:?}", tuple["kind"]);
    }
}

#[test]
fn golden_planar_the_environment_steps_as_its_dynamics_do() {
    let golden = planar_json();
    let planar = Planar { noise: 0.0 };
    let mut rng = rand::SeedableRng::seed_from_u64(0);
    for tuple in list(&golden, "tuples") {
        let next = planar.step(&numbers(tuple, "s"), &numbers(tuple, "u"), &mut rng);
        assert_eq!(next, numbers(tuple, "s_next"));
    }
}

#[test]
fn golden_planar_pictures_are_equal_in_every_pixel() {
    let golden = planar_json();
    let (frames, [height, width]) = frames();
    let planar = Planar { noise: 0.0 };
    assert_eq!(planar.picture_size(), (height, width));
    let renders = list(&golden, "renders");
    assert!(!renders.is_empty());
    for render in renders {
        let file = frame_number(render);
        let state = numbers(render, "s");
        let picture = planar.picture(&state);
        let wrong = picture.iter().zip(&frames[file]).position(|(a, b)| a != b);
        if let Some(at) = wrong {
            panic!("picture {file} of {state:?} differs first at row {}, column {}", at / width, at % width);
        }
        let lit = picture.iter().filter(|&&p| p == 255).count();
        assert_eq!(Some(lit as u64), render["lit"].as_u64(), "lit pixels of picture {file}");
    }
}

#[test]
fn golden_planar_drawing_does_not_depend_on_what_was_there() {
    let golden = planar_json();
    let planar = Planar { noise: 0.0 };
    for render in list(&golden, "renders") {
        let state = numbers(render, "s");
        let mut picture = vec![77; planar.picture(&state).len()];
        planar.render(&state, &mut picture);
        assert_eq!(picture, planar.picture(&state));
    }
}

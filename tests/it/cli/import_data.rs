//! Data of other programs come in as transitions, or with an error that says what is wrong with them.

use std::fs;

use crate::support::{cli::Ended, desk::Desk};
use carl_pipe::arrays::{Dtype, NpzWriter};

/// Pixels of a picture of `planar`.
const PIXELS: usize = 40 * 40;

impl Desk {
    /// Imports a file, with more parameters, into the task `planar` or another one.
    fn import(&self, env: &str, file: &str, rest: &str) -> Ended {
        let text = format!(
            "schema = 1\nname = \"x\"\n[task]\nenv = \"{env}\"\n[stages.data]\nkind = \"import_data\"\nfile = \"{file}\"\n{rest}\n"
        );
        fs::write(self.path("x.toml"), text).unwrap();
        self.call(&["run", "x.toml", "--json", "--quiet"])
    }

    fn npz(&self, name: &str, arrays: &[(&str, Dtype, &[usize], &[u8])]) {
        let mut npz = NpzWriter::new(fs::File::create(self.path(name)).unwrap());
        arrays.iter().for_each(|(name, dtype, shape, bytes)| npz.add(name, *dtype, shape, bytes).unwrap());
        npz.finish().unwrap();
    }
}

fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// Pictures of one white pixel each.
fn pictures(count: usize, pixels: usize) -> Vec<u8> {
    (0..count).flat_map(|at| (0..pixels).map(move |pixel| if pixel == at { 255 } else { 0 })).collect()
}

#[test]
fn what_was_exported_is_imported_as_the_same_bytes() {
    let desk = Desk::new();
    let made =
        "schema = 1\nname = \"m\"\n[task]\nenv = \"planar\"\n[stages.made]\nkind = \"generate_data\"\nsamples = 6\n";
    fs::write(desk.path("m.toml"), made).unwrap();
    let first = desk.call(&["run", "m.toml", "--json", "--quiet"]).json();
    let exported = desk.call(&["export", "latest", "made", "-o", "made.npz"]);
    assert_eq!(exported.code, Some(0), "{exported:?}");
    assert!(exported.out.contains("observations uint8 [6, 40, 40]"), "{}", exported.out);
    let object = fs::canonicalize(desk.path("artifacts/runs/latest/made.transitions.safetensors")).unwrap();
    fs::copy(object, desk.path("made.safetensors")).unwrap();
    for file in ["made.npz", "made.safetensors"] {
        let again = desk.import("planar", file, "");
        assert_eq!(again.code, Some(0), "{again:?}");
        assert_eq!(again.json()["nodes"]["data"]["digest"], first["nodes"]["made"]["digest"], "{file}");
    }
    let wrong = desk.call(&["export", "latest", "mad", "-o", "x.npz"]);
    assert_eq!(wrong.code, Some(2), "{wrong:?}");
}

#[test]
fn steps_of_episodes_become_transitions_that_cross_no_end() {
    let desk = Desk::new();
    let actions = floats(&[0.0; 10]);
    let ends = [0, 0, 1, 0, 0];
    desk.npz(
        "x.npz",
        &[
            ("observations", Dtype::U8, &[5, 40, 40], &pictures(5, PIXELS)),
            ("actions", Dtype::F32, &[5, 2], &actions),
            ("terminals", Dtype::Bool, &[5], &ends),
        ],
    );
    let ended = desk.import("planar", "x.npz", "");
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let exported = desk.call(&["export", "latest", "data", "-o", "out.npz"]);
    // Steps 0, 1 and 3: the picture after step 2 is of another episode, and after step 4 there is none.
    assert!(exported.out.contains("observations uint8 [3, 40, 40]"), "{}", exported.out);
}

#[test]
fn single_frames_are_stacked_within_their_episode() {
    let desk = Desk::new();
    let each = 48 * 48;
    desk.npz(
        "x.npz",
        &[
            ("observations", Dtype::U8, &[4, 48, 48, 1], &pictures(4, each)),
            ("actions", Dtype::F32, &[3], &floats(&[0.5, -0.5, 0.0])),
        ],
    );
    let ended = desk.import("swing_up", "x.npz", "");
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let object = fs::read(desk.path("artifacts/runs/latest/data.transitions.safetensors")).unwrap();
    // The header, then tensors by type and name: actions and goals come before observations in the order of numbers.
    let exported = desk.call(&["export", "latest", "data", "-o", "out.npz"]);
    assert!(exported.out.contains("observations uint8 [3, 96, 48]"), "{}", exported.out);
    let white = |bytes: &[u8]| bytes.iter().filter(|&&byte| byte == 255).count();
    assert!(white(&object) >= 2 * 2 * 3);
}

#[test]
fn a_folder_of_png_files_is_imported() {
    let desk = Desk::new();
    fs::create_dir(desk.path("pictures")).unwrap();
    for (name, grey) in [("a.png", 0_u8), ("b.png", 200)] {
        let file = fs::File::create(desk.path("pictures").join(name)).unwrap();
        let mut encoder = png::Encoder::new(file, 40, 40);
        encoder.set_color(png::ColorType::Rgb);
        encoder.write_header().unwrap().write_image_data(&[grey; 3 * PIXELS]).unwrap();
    }
    let table = "before, after, action_0, action_1\na.png, b.png, 1.5, -2\nb.png,a.png,0,0\n";
    fs::write(desk.path("pictures/actions.csv"), table).unwrap();
    let ended = desk.import("planar", "pictures", "threshold = 128\naction_limit = [2.0]");
    assert_eq!(ended.code, Some(0), "{ended:?}");
    fs::write(desk.path("pictures/actions.csv"), table.replace("1.5", "1.0")).unwrap();
    let again = desk.import("planar", "pictures", "threshold = 128\naction_limit = [2.0]");
    assert_eq!(again.json()["executed"], 1, "the content of the folder is in the key");
}

#[test]
fn data_that_do_not_fit_are_refused_by_name() {
    let desk = Desk::new();
    let (two, actions) = (pictures(2, PIXELS), floats(&[0.0; 4]));
    let grey = [7_u8; 2 * PIXELS];
    let halves = floats(&[2.0; 2 * PIXELS]);
    type Arrays<'a> = Vec<(&'a str, Dtype, &'a [usize], &'a [u8])>;
    let observations: (&str, Dtype, &[usize], &[u8]) = ("observations", Dtype::U8, &[2, 40, 40], &two);
    let good: (&str, Dtype, &[usize], &[u8]) = ("actions", Dtype::F32, &[2, 2], &actions);
    let (far, not_finite) = (floats(&[0.0, 0.0, 3.0, 0.0]), floats(&[0.0, f32::NAN, 0.0, 0.0]));
    let cases: Vec<(Arrays<'_>, &str, &str)> = vec![
        (vec![good], "", "no array `observations`; the file has `actions`"),
        (vec![observations], "", "no array `actions`; the file has `observations`"),
        (
            vec![("observations", Dtype::U8, &[2, 1600], &two), good],
            "",
            "the shape is [2, 1600], but the task has pictures of 40 x 40",
        ),
        (
            vec![("observations", Dtype::U8, &[2, 40, 40], &grey), good],
            "",
            "picture 0 has a pixel of 7, but pixels are 0 or 255",
        ),
        (
            vec![("observations", Dtype::F32, &[2, 40, 40], &halves), good],
            "",
            "number 2 at index 0 is no pixel: float32 lie in 0..1",
        ),
        (
            vec![observations, ("actions", Dtype::F32, &[4], &actions)],
            "",
            "the shape is [4], but the task has actions of 2 components",
        ),
        (
            vec![observations, ("actions", Dtype::F32, &[2, 2], &far)],
            "",
            "number 3 at index 1 is beyond its limit of 1",
        ),
        (
            vec![observations, ("actions", Dtype::F32, &[2, 2], &not_finite)],
            "",
            "number NaN at index 0 is beyond its limit",
        ),
        (vec![observations, good], "action_limit = [1.0, 1.0, 1.0]", "`action_limit` has 3 numbers for actions of 2"),
        (
            vec![observations, good, ("ends", Dtype::Bool, &[1], &[1])],
            "",
            "an array of ends has 1 numbers for 2 actions",
        ),
        (
            vec![observations, good, ("goal_index", Dtype::U8, &[2], &[0, 99])],
            "names.next_observations = \"observations\"",
            "no goal from 0 to",
        ),
        (vec![observations, good], "names.ends = []\nnames.observations = \"pixels\"", "no array `pixels`"),
    ];
    for (arrays, rest, error) in cases {
        desk.npz("x.npz", &arrays);
        let ended = desk.import("planar", "x.npz", rest);
        assert_eq!(ended.code, Some(1), "{error}: {ended:?}");
        assert!(ended.err.contains("cannot import `x.npz`") && ended.err.contains(error), "{error}: {}", ended.err);
    }
    fs::write(desk.path("y.npz"), "no archive").unwrap();
    assert!(desk.import("planar", "y.npz", "").err.contains("not a ZIP archive"));
    for (file, error) in [("z.npz", "cannot be read: No such file"), ("z.csv", "`file` has an unknown ending")] {
        let ended = desk.import("planar", file, "");
        assert_eq!(ended.code, Some(3), "{ended:?}");
        assert!(ended.err.contains(error) && ended.err.contains("x.toml:7:8"), "{}", ended.err);
    }
}

#[test]
fn a_first_pipeline_is_written_once_and_can_be_run() {
    let desk = Desk::new();
    for start in ["planar_online", "gymnasium", "command"] {
        let written = desk.call(&["init", start, "--from", start]);
        assert_eq!(written.code, Some(0), "{written:?}");
        let file = format!("{start}/pipeline.toml");
        assert!(written.out.contains(&format!("next: carl-pipe run {file}")), "{}", written.out);
        // The others need packages of Python.
        if start == "planar_online" {
            assert_eq!(desk.call(&["run", &file, "--dry-run"]).code, Some(0));
        }
        let again = desk.call(&["init", start, "--from", start]);
        assert!(again.code == Some(2) && again.err.contains("exists already"), "{again:?}");
    }
}

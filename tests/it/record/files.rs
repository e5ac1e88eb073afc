//! Recordings as files: the same messages give the same bytes, and whatever is left of a file can be read.

use std::{fs, os::unix::fs::FileExt as _, path::Path, time::Duration};

use carl_pipe::record::{
    At, Finished, Frame, Level, MapFrame, Message, NodeInfo, Polled, Reader, Recorder, TrajectoryFrame,
};

fn node() -> NodeInfo {
    NodeInfo { node: "represent@2".into(), kind: "train_lce".into(), key: "b3:0123".into(), round: 2 }
}

/// Records a bit of everything; waits in between, so that flushes by the clock fall elsewhere.
fn record(recorder: &mut Recorder, steps: u64, wait: Duration) {
    let at = |step| At::new(2, (step / 10) as u32, step);
    recorder.obstacles("/evaluate/obstacles", at(0), &[[15.5, 5.5, 2.5]]);
    for step in 0..steps {
        let loss = 1000.0 / (step + 1) as f64;
        recorder.scalars("/train/lce", at(step), &[("total", loss), ("curvature", loss * 1e-3)]);
        if step % 10 == 0 {
            let latents = [[0.5, -1.0, 0.0], [step as f32, 2.0, 0.0]];
            let map = MapFrame {
                positions: &[[0.0, 0.25], [1.0, 0.5]],
                latents: &latents,
                goals: &[[1.0, 2.0, 3.0]],
                quality: 0.75,
            };
            recorder.latent_map("/latent/map", at(step), &map);
            recorder.picture("/picture/observation", at(step), 2, 3, &[0, 1, 2, 253, 254, step as u8]);
            let episode = TrajectoryFrame {
                episode: 3,
                path: &[[5.0, 6.0], [7.0, 8.0]],
                goal: [30.0, 31.0],
                radius: 5.0,
                percent_goal: 68.03,
            };
            recorder.trajectory("/evaluate/trajectory", at(step), &episode);
            recorder.log(at(step), Level::Warning, "loss grew");
            std::thread::sleep(wait);
        }
    }
}

fn recording(folder: &Path, name: &str, steps: u64, wait: Duration) -> Finished {
    let mut recorder = Recorder::create(&folder.join(format!("live/{name}.mcap")), &node());
    record(&mut recorder, steps, wait);
    recorder.finish(&folder.join(format!("{name}.mcap")))
}

/// Every message that can be read, and whether the file is finished.
fn read(path: &Path) -> (Vec<Message>, bool) {
    let mut reader = Reader::open(path).unwrap();
    let mut messages = Vec::new();
    loop {
        match reader.poll() {
            Ok(Polled::Message(raw)) => messages.push(Message::decode(&raw).unwrap().unwrap()),
            Ok(Polled::Metadata(_)) => {}
            Ok(Polled::Waiting) => return (messages, false),
            Ok(Polled::End) => {
                assert_eq!(reader.node(), Some(&node()));
                return (messages, true);
            }
            Err(error) => panic!("{error:#}"),
        }
    }
}

#[test]
fn equal_messages_give_equal_bytes_whenever_they_were_flushed() {
    let folder = tempfile::tempdir().unwrap();
    let fast = recording(folder.path(), "fast", 50, Duration::ZERO);
    let slow = recording(folder.path(), "slow", 50, Duration::from_millis(250));
    assert_eq!((&fast.warning, &slow.warning), (&None, &None));
    assert!(fast.messages_digest.is_some() && fast.file_digest.is_some());
    assert_eq!(fast.messages_digest, slow.messages_digest);
    assert_eq!(fast.file_digest, slow.file_digest);
    let bytes = fs::read(fast.path.unwrap()).unwrap();
    assert!(bytes == fs::read(slow.path.unwrap()).unwrap());
    assert_eq!(fast.file_digest.unwrap(), *blake3::hash(&bytes).as_bytes());
    assert!(!folder.path().join("live/fast.mcap").exists());
}

#[test]
fn other_messages_give_another_digest() {
    let folder = tempfile::tempdir().unwrap();
    let short = recording(folder.path(), "short", 5, Duration::ZERO);
    let long = recording(folder.path(), "long", 6, Duration::ZERO);
    assert_ne!(short.messages_digest, long.messages_digest);
}

#[test]
fn frames_come_back_as_they_were_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let (messages, finished) = read(&recording(folder.path(), "all", 11, Duration::ZERO).path.unwrap());
    assert!(finished);
    let of = |topic: &str| messages.iter().filter(|m| m.topic == topic).map(|m| (m.at, &m.frame)).collect::<Vec<_>>();
    let last = At::new(2, 1, 10);

    let names: std::sync::Arc<[String]> = ["total".to_owned(), "curvature".to_owned()].into();
    let loss = 1000.0 / 11.0;
    assert_eq!(of("/train/lce")[10], (last, &Frame::Scalars { names, values: vec![loss, loss * 1e-3] }));
    let map = Frame::LatentMap {
        positions: vec![[0.0, 0.25], [1.0, 0.5]],
        latents: vec![[0.5, -1.0, 0.0], [10.0, 2.0, 0.0]],
        colours: vec![[98, 74, 179, 255], [140, 185, 100, 255]],
    };
    assert_eq!(of("/latent/map")[1], (last, &map));
    assert_eq!(of("/latent/map/goals")[1], (last, &Frame::Goals(vec![[1.0, 2.0, 3.0]])));
    let quality = Frame::Scalars { names: ["quality".to_owned()].into(), values: vec![0.75] };
    assert_eq!(of("/latent/map/quality")[1], (last, &quality));
    let picture = Frame::Picture { height: 2, width: 3, bytes: vec![0, 1, 2, 253, 254, 10] };
    assert_eq!(of("/picture/observation")[1], (last, &picture));
    assert_eq!(of("/evaluate/obstacles"), [(At::new(2, 0, 0), &Frame::Obstacles(vec![[15.5, 5.5, 2.5]]))]);
    let episode = Frame::Trajectory {
        episode: 3,
        path: vec![[5.0, 6.0], [7.0, 8.0]],
        goal: [30.0, 31.0],
        radius: 5.0,
        percent_goal: 68.03,
    };
    assert_eq!(of("/evaluate/trajectory")[1], (last, &episode));
    assert_eq!(of("/log")[1], (last, &Frame::Log { level: Level::Warning, text: "loss grew".into() }));
}

#[test]
fn a_recording_cut_anywhere_gives_what_came_before() {
    let folder = tempfile::tempdir().unwrap();
    let path = recording(folder.path(), "whole", 3, Duration::ZERO).path.unwrap();
    let (whole, _) = read(&path);
    let file = fs::OpenOptions::new().write(true).open(&path).unwrap();
    let mut most = whole.len();
    for length in (0..file.metadata().unwrap().len()).rev() {
        file.set_len(length).unwrap();
        let (messages, finished) = read(&path);
        assert!(!finished && messages == whole[..messages.len()], "cut after {length} bytes");
        assert!(messages.len() <= most, "a shorter file gave more messages at {length} bytes");
        most = messages.len();
    }
    assert_eq!(most, 0);
}

#[test]
fn a_damaged_recording_is_an_error_not_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = recording(folder.path(), "whole", 3, Duration::ZERO).path.unwrap();
    let bytes = fs::read(&path).unwrap();
    let file = fs::OpenOptions::new().write(true).open(&path).unwrap();
    for (place, byte) in bytes.iter().enumerate() {
        file.write_all_at(&[byte ^ 0x55], place as u64).unwrap();
        let mut reader = Reader::open(&path).unwrap();
        // Whatever the outcome, it comes.
        while let Ok(Polled::Message(_) | Polled::Metadata(_)) = reader.poll() {}
        file.write_all_at(&[*byte], place as u64).unwrap();
    }
}

#[test]
fn a_follower_sees_messages_while_the_node_works() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("live.mcap");
    let mut recorder = Recorder::create(&path, &node());
    let mut reader = Reader::open(&path).unwrap();
    assert!(matches!(reader.poll(), Ok(Polled::Metadata(_))));
    assert!(matches!(reader.poll(), Ok(Polled::Waiting)));
    recorder.scalars("/train/lce", At::new(0, 0, 0), &[("total", 1.0)]);
    std::thread::sleep(Duration::from_millis(450));
    recorder.scalars("/train/lce", At::new(0, 0, 1), &[("total", 2.0)]);
    assert!(matches!(reader.poll(), Ok(Polled::Message(_))));
    assert!(matches!(reader.poll(), Ok(Polled::Message(_))));
    assert!(matches!(reader.poll(), Ok(Polled::Waiting)));
}

#[test]
fn an_unwritable_place_gives_one_warning_and_a_recorder_that_is_off() {
    let folder = tempfile::tempdir().unwrap();
    let blocked = folder.path().join("file");
    fs::write(&blocked, "").unwrap();
    let mut recorder = Recorder::create(&blocked.join("live.mcap"), &node());
    record(&mut recorder, 20, Duration::ZERO);
    assert!(recorder.take_warning().unwrap().starts_with("cannot record to "));
    assert_eq!(recorder.take_warning(), None);
    let finished = recorder.finish(&folder.path().join("canonical.mcap"));
    assert!(finished.path.is_none() && finished.file_digest.is_none() && finished.warning.is_none());
}

#[test]
fn a_full_disk_turns_the_recorder_off() {
    if !Path::new("/dev/full").exists() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::create(&folder.path().join("live.mcap"), &node());
    record(&mut recorder, 20, Duration::ZERO);
    let finished = recorder.finish(Path::new("/dev/full"));
    assert!(finished.path.is_none());
    assert!(finished.warning.unwrap().contains("/dev/full"));

    let mut recorder = Recorder::create(Path::new("/dev/full"), &node());
    record(&mut recorder, 20, Duration::ZERO);
    assert!(recorder.take_warning().unwrap().contains("/dev/full"));
}

#[test]
fn a_picture_of_the_wrong_size_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::create(&folder.path().join("live.mcap"), &node());
    recorder.picture("/picture/observation", At::default(), 2, 2, &[0]);
    let finished = recorder.finish(&folder.path().join("canonical.mcap"));
    assert!(finished.warning.unwrap().contains("1 bytes, which is not 2x2"));
    assert!(read(&finished.path.unwrap()).0.is_empty());
}

#[test]
fn a_recorder_that_is_off_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::off();
    record(&mut recorder, 3, Duration::ZERO);
    let canonical = folder.path().join("canonical.mcap");
    let finished = recorder.finish(&canonical);
    assert!(finished.path.is_none() && finished.warning.is_none() && !canonical.exists());
}

#[test]
fn a_recorder_moves_between_threads() {
    let recorder = Recorder::off();
    std::thread::spawn(move || recorder.spent()).join().unwrap();
}

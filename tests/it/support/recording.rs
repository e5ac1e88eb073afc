//! A made-up run with every kind of message, for tests that look at recordings from outside.

#![allow(clippy::disallowed_methods, reason = "made-up curves; nothing is compared bit by bit")]

use std::{fs, io::Write as _, path::Path};

use carl_pipe::record::{At, Level, MapFrame, NodeInfo, Recorder, TrajectoryFrame, topic};

/// Writes `events.jsonl` and the recordings of four rounds.
pub fn write_run(folder: &Path, points_per_side: usize) {
    fs::create_dir_all(folder).unwrap();
    let mut events = fs::File::create(folder.join("events.jsonl")).unwrap();
    let mut say = |line: String| writeln!(events, "{line}").unwrap();
    say(r#"{"event":"run_started","pipeline":"planar_sample","seed":7,"host":"ignored"}"#.to_owned());
    for round in 0..4 {
        for kind in ["represent", "control", "evaluate"] {
            let node = format!("{kind}@{round}");
            say(format!(
                r#"{{"event":"node_started","node":"{node}","kind":"{kind}","round":{round},"recording":"live/{node}.mcap"}}"#
            ));
            let info = NodeInfo { node: node.clone(), kind: kind.into(), key: format!("b3:{round:04}"), round };
            let mut recorder = Recorder::create(&folder.join(format!("live/{node}.mcap")), &info);
            match kind {
                "represent" => represent(&mut recorder, round, points_per_side),
                "control" => control(&mut recorder, round),
                _ => evaluate(&mut recorder, round),
            }
            let finished = recorder.finish(&folder.join(format!("{node}.mcap")));
            assert_eq!(finished.warning, None);
            let state = if round == 0 { "cached" } else { "ran" };
            say(format!(
                r#"{{"event":"node_finished","node":"{node}","kind":"{kind}","round":{round},"state":"{state}","secs":1.5,"recording":"{node}.mcap"}}"#
            ));
        }
        say(format!(
            r#"{{"event":"figure","node":"evaluate@{round}","name":"percent_goal","value":{}}}"#,
            40 + 9 * round
        ));
    }
    say(r#"{"event":"run_finished","secs":12.0}"#.to_owned());
}

fn represent(recorder: &mut Recorder, round: u32, side: usize) {
    let steps = if round == 0 { 600 } else { 200 };
    for step in 0..steps {
        let at = At::new(round, (step / 50) as u32, step);
        let decay = (-(step as f64) / 80.0).exp() + 0.3 / f64::from(round + 1) + 0.03 * (step as f64 * 1.7).sin();
        let values = [
            ("total", 260.0 * decay + 90.0),
            ("prediction", 200.0 * decay + 70.0),
            ("consistency", 60.0 * decay + 18.0),
            ("curvature", 2.5 * decay),
            ("noise", 0.4 * decay),
        ];
        recorder.scalars(topic::TRAIN_LCE, at, &values);
        if step % 50 == 0 {
            map(recorder, at, side, (f64::from(round) + step as f64 / steps as f64 + 0.2).min(2.0) as f32 / 2.0);
            pictures(recorder, at);
        }
    }
    recorder.log(At::new(round, 0, steps), Level::Info, "the latent map keeps the shape of the true space");
}

/// A grid of true positions, folded at first, flat in the end.
fn map(recorder: &mut Recorder, at: At, side: usize, progress: f32) {
    let place = |row: f32, col: f32| {
        let (u, v) = (row - 0.5, col - 0.5);
        let fold = (1.0 - progress) * (6.0 * u + 2.0 * v).sin();
        [3.0 * u * progress + fold * v, 3.0 * v + 1.5 * (1.0 - progress) * (5.0 * u).cos() * u, 0.0]
    };
    let share = |i: usize| i as f32 / (side - 1).max(1) as f32;
    let positions: Vec<_> = (0..side * side).map(|i| [share(i / side), share(i % side)]).collect();
    let latents: Vec<_> = positions.iter().map(|&[row, col]| place(row, col)).collect();
    let goals = [[0.85, 0.85], [0.15, 0.9], [0.9, 0.2]].map(|[row, col]: [f32; 2]| place(row, col));
    let frame =
        MapFrame { positions: &positions, latents: &latents, goals: &goals, quality: f64::from(0.5 + 0.5 * progress) };
    recorder.latent_map(topic::LATENT_MAP, at, &frame);
}

fn pictures(recorder: &mut Recorder, at: At) {
    let (row, col) = (8 + (at.step / 25) as i32 % 24, 6 + (at.step / 40) as i32 % 28);
    let draw = |blur: i32, shift: i32| -> Vec<u8> {
        let mut grey = vec![0; 1600];
        for (i, pixel) in grey.iter_mut().enumerate() {
            let (r, c) = (i as i32 / 40, i as i32 % 40);
            let obstacle =
                [(8, 28), (20, 10), (20, 30), (32, 18)].iter().any(|(a, b)| (r - a).pow(2) + (c - b).pow(2) < 7);
            let distance = (r - row).abs().max((c - col - shift).abs());
            *pixel = if obstacle { 140 } else { (255 - (distance - 2).max(0) * 255 / blur.max(1)).max(0) as u8 };
        }
        grey
    };
    recorder.picture(topic::PICTURE_OBSERVATION, at, 40, 40, &draw(1, 0));
    recorder.picture(topic::PICTURE_RECONSTRUCTION, at, 40, 40, &draw(3, 0));
    recorder.picture(topic::PICTURE_PREDICTION, at, 40, 40, &draw(4, 2));
}

fn control(recorder: &mut Recorder, round: u32) {
    for step in 0..300 {
        let t = step as f64 / 300.0;
        let values = [
            ("critic", 4.0 * (1.0 - t) + 0.5 + 0.2 * (step as f64).sin()),
            ("actor", -8.0 * t - f64::from(round)),
            ("temperature", 0.02 + 0.2 * (1.0 - t)),
            ("entropy", 1.0 - 2.0 * t),
        ];
        recorder.scalars(topic::TRAIN_SAC, At::new(round, 0, step), &values);
    }
}

fn evaluate(recorder: &mut Recorder, round: u32) {
    let obstacles = [[8.0, 28.0, 2.5], [20.0, 10.0, 2.5], [20.0, 30.0, 2.5], [32.0, 18.0, 2.5]];
    recorder.obstacles(topic::OBSTACLES, At::new(round, 0, 0), &obstacles);
    let goals = [[34.0, 34.0], [6.0, 36.0], [36.0, 8.0]];
    for episode in 0..10_u32 {
        let goal = goals[episode as usize % 3];
        let start = [3.0 + episode as f32 * 0.4, 7.0 - episode as f32 * 0.35];
        let reach = (0.55 + 0.15 * round as f32).min(1.0);
        let path: Vec<[f32; 2]> = (0..41)
            .map(|step| {
                let t = (step as f32 / 25.0).min(1.0) * reach;
                let bend = 6.0 * (1.0 - reach) * (t * 5.0 + episode as f32).sin();
                [start[0] + (goal[0] - start[0]) * t + bend, start[1] + (goal[1] - start[1]) * t - bend * 0.5]
            })
            .collect();
        let percent_goal = f64::from(36 + round * 10);
        let frame = TrajectoryFrame { episode, path: &path, goal, radius: 5.0, percent_goal };
        recorder.trajectory(topic::TRAJECTORY, At::new(round, 0, u64::from(episode)), &frame);
    }
    let value = 40.0 + 9.0 * f64::from(round);
    let values = [("percent_goal", value), ("policy_alone", value - 5.0), ("paper", 68.03), ("ceiling", 78.87)];
    recorder.scalars(topic::PERCENT_GOAL, At::new(round, 0, 9), &values);
}

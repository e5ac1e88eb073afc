//! The recorder that stages write to: it never fails, never panics and never changes a run.
//!
//! The first error turns it off and leaves one warning, which the engine takes.

#![allow(
    clippy::disallowed_methods,
    reason = "wall time paces flushes and measures the cost of recording; recordings hold logical time only"
)]

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use prost::{
    Message as _,
    encoding::{WireType, encode_key},
};

use super::{
    canonical,
    live::{LiveFile, Shape},
    schema,
    time::At,
    wire,
};

/// Whose recording it is.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct NodeInfo {
    /// The node's name, such as `represent@0`.
    pub node: String,
    /// Its stage kind.
    pub kind: String,
    /// Its key.
    pub key: String,
    /// The round of the loop; 0 outside of one.
    pub round: u32,
}

/// How much a sentence matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// For whoever looks for the cause of something.
    Debug,
    /// For everybody.
    Info,
    /// Something looks wrong.
    Warning,
    /// Something is wrong.
    Error,
}

/// Where known states lie in latent space.
#[derive(Debug, Clone, Copy)]
pub struct MapFrame<'a> {
    /// True positions as row and column, both in 0..=1: they give the colours.
    pub positions: &'a [[f32; 2]],
    /// The latents of the same states; two-dimensional ones padded with 0.
    pub latents: &'a [[f32; 3]],
    /// The latents of the goals.
    pub goals: &'a [[f32; 3]],
    /// How well the map keeps the shape of the true space, higher is better; recorded as `TOPIC/quality`.
    pub quality: f64,
}

/// One episode of an evaluation in true space.
#[derive(Debug, Clone, Copy)]
pub struct TrajectoryFrame<'a> {
    /// Which episode of the evaluation.
    pub episode: u32,
    /// The states, as row (drawn downwards) and column (drawn rightwards).
    pub path: &'a [[f32; 2]],
    /// The goal, likewise.
    pub goal: [f32; 2],
    /// How near the goal counts as reached.
    pub radius: f32,
    /// Share of the states within the radius, in percent.
    pub percent_goal: f64,
}

/// Writes a node's recording.
#[derive(Default)]
pub struct Recorder {
    open: Option<Box<Open>>,
    warning: Option<String>,
    spent: Duration,
}

struct Open {
    path: PathBuf,
    kind: String,
    file: LiveFile,
    /// Reused from map to map.
    cloud: wire::PointCloud,
}

/// What is left of a recorder when its node has finished.
#[derive(Debug)]
pub struct Finished {
    /// blake3 over the messages alone (topic, schema, time, payload, in order).
    pub messages_digest: Option<[u8; 32]>,
    /// blake3 over the bytes of the file.
    pub file_digest: Option<[u8; 32]>,
    /// The canonical file; none if recording was off or failed.
    pub path: Option<PathBuf>,
    /// Time spent on recording.
    pub spent: Duration,
    /// What went wrong, if something did.
    pub warning: Option<String>,
}

impl std::fmt::Debug for Recorder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let path = self.open.as_ref().map(|open| &open.path);
        f.debug_struct("Recorder").field("path", &path).field("warning", &self.warning).finish_non_exhaustive()
    }
}

impl Recorder {
    /// Records nothing.
    pub fn off() -> Recorder {
        Recorder::default()
    }

    /// Starts a recording in a new file at `path`.
    pub fn create(path: &Path, node: &NodeInfo) -> Recorder {
        let started = Instant::now();
        let mut recorder = Recorder::off();
        match LiveFile::create(path, node) {
            Ok(file) => {
                let (path, kind) = (path.to_owned(), node.kind.clone());
                recorder.open = Some(Box::new(Open { path, kind, file, cloud: wire::PointCloud::default() }));
            }
            Err(error) => recorder.fail(path, &error),
        }
        recorder.spent = started.elapsed();
        recorder
    }

    /// Named values at one time, such as the terms of a loss. Names are protobuf field names: letters, digits and `_`.
    pub fn scalars(&mut self, topic: &str, at: At, values: &[(&'static str, f64)]) {
        self.record(|open| {
            let same = |shape: &Shape| match shape {
                Shape::Scalars(names) => names.iter().eq(values.iter().map(|(name, _)| name)),
                _ => false,
            };
            let channel = open.file.channel(topic, same, || {
                let names: Vec<_> = values.iter().map(|&(name, _)| name).collect();
                let schema = schema::scalars(topic, &names);
                (Shape::Scalars(names), schema)
            })?;
            let payload = &mut open.file.payload;
            payload.clear();
            let At { round, epoch, step } = at;
            let head = wire::ScalarsHead { timestamp: Some(at.timestamp()), round, epoch, step };
            head.encode(payload)?;
            for (number, (_, value)) in (wire::FIRST_VALUE..).zip(values) {
                encode_key(number, WireType::SixtyFourBit, payload);
                payload.extend_from_slice(&value.to_le_bytes());
            }
            Ok(open.file.write(channel, at)?)
        });
    }

    /// Where known states and the goals lie in latent space: three topics, `TOPIC`, `TOPIC/goals` and `TOPIC/quality`.
    pub fn latent_map(&mut self, topic: &str, at: At, map: &MapFrame<'_>) {
        self.record(|open| {
            let points = map.latents.iter().zip(map.positions);
            open.cloud(topic, at, &LATENT_FIELDS, points, |(latent, position), data| {
                put_floats(data, latent);
                data.extend_from_slice(&colour(*position));
                put_floats(data, position);
            })?;
            open.cloud(&format!("{topic}/goals"), at, &LATENT_FIELDS[..7], map.goals.iter(), |goal, data| {
                put_floats(data, goal);
                data.extend_from_slice(&GOAL_COLOUR);
            })
        });
        self.scalars(&format!("{topic}/quality"), at, &[("quality", map.quality)]);
    }

    /// The obstacles of the true space, each as row, column and radius.
    pub fn obstacles(&mut self, topic: &str, at: At, circles: &[[f32; 3]]) {
        self.record(|open| {
            open.cloud(topic, at, &OBSTACLE_FIELDS, circles.iter(), |&[row, col, radius], data| {
                put_floats(data, &[col, row, 0.0, radius]);
            })
        });
    }

    /// A grey picture, row by row, 0 black.
    pub fn picture(&mut self, topic: &str, at: At, height: u32, width: u32, grey: &[u8]) {
        if u64::from(height) * u64::from(width) != grey.len() as u64 {
            let sentence = format!("picture `{topic}` has {} bytes, which is not {height}x{width}", grey.len());
            self.warning.get_or_insert(sentence);
            return;
        }
        self.record(|open| {
            let channel = open.file.channel(topic, |s| *s == Shape::Image, || (Shape::Image, schema::raw_image()))?;
            let image = wire::RawImage {
                timestamp: Some(at.timestamp()),
                width,
                height,
                encoding: "mono8".to_owned(),
                step: width,
                data: grey.to_vec(),
                frame_id: ROOT_FRAME.to_owned(),
                at_round: at.round,
                at_epoch: at.epoch,
                at_step: at.step,
            };
            open.write_message(channel, at, &image)
        });
    }

    /// One evaluated episode in true space.
    pub fn trajectory(&mut self, topic: &str, at: At, episode: &TrajectoryFrame<'_>) {
        self.record(|open| {
            let make = || (Shape::Trajectory, schema::trajectory());
            let channel = open.file.channel(topic, |s| *s == Shape::Trajectory, make)?;
            let trajectory = wire::Trajectory {
                timestamp: Some(at.timestamp()),
                round: at.round,
                epoch: at.epoch,
                step: at.step,
                episode: episode.episode,
                row: episode.path.iter().map(|state| state[0]).collect(),
                col: episode.path.iter().map(|state| state[1]).collect(),
                goal_row: episode.goal[0],
                goal_col: episode.goal[1],
                radius: episode.radius,
                percent_goal: episode.percent_goal,
            };
            open.write_message(channel, at, &trajectory)
        });
    }

    /// A sentence, on the topic `/log`.
    pub fn log(&mut self, at: At, level: Level, text: &str) {
        self.record(|open| {
            let channel = open.file.channel("/log", |s| *s == Shape::Log, || (Shape::Log, schema::log()))?;
            let log = wire::Log {
                timestamp: Some(at.timestamp()),
                level: level.to_wire(),
                message: text.to_owned(),
                name: open.kind.clone(),
                round: at.round,
                epoch: at.epoch,
                step: at.step,
            };
            open.write_message(channel, at, &log)
        });
    }

    /// Time spent inside the recorder so far.
    pub fn spent(&self) -> Duration {
        self.spent
    }

    /// What went wrong, once.
    pub fn take_warning(&mut self) -> Option<String> {
        self.warning.take()
    }

    /// Rewrites the live file to `canonical`, the same bytes for the same messages whenever they were flushed, and
    /// removes the live file.
    pub fn finish(mut self, canonical: &Path) -> Finished {
        let started = Instant::now();
        let mut written = None;
        if let Some(mut open) = self.open.take() {
            let live = open.path.clone();
            let flushed = open.file.flush().map_err(anyhow::Error::new);
            drop(open);
            match flushed.and_then(|()| canonical::rewrite(&live, canonical)) {
                Ok(digests) => {
                    written = Some(digests);
                    // A live file that cannot be removed is read by nobody.
                    let _ = std::fs::remove_file(&live);
                }
                Err(error) => self.fail(canonical, &*error),
            }
        }
        Finished {
            path: written.map(|_| canonical.to_owned()),
            messages_digest: written.map(|digests| digests.messages),
            file_digest: written.map(|digests| digests.file),
            spent: self.spent + started.elapsed(),
            warning: self.warning,
        }
    }

    /// Runs one recording call; its error is the last.
    fn record(&mut self, call: impl FnOnce(&mut Open) -> anyhow::Result<()>) {
        let Some(open) = &mut self.open else { return };
        let started = Instant::now();
        let outcome = call(open).and_then(|()| Ok(open.file.flush_if_due(started)?));
        if let Err(error) = outcome
            && let Some(open) = self.open.take()
        {
            self.fail(&open.path, &*error);
        }
        self.spent += started.elapsed();
    }

    fn fail(&mut self, path: &Path, error: &(dyn std::error::Error + 'static)) {
        let sentence = format!("cannot record to {}: {error}; the run goes on without this recording", path.display());
        self.warning.get_or_insert(sentence);
    }
}

/// The frame that Rerun draws without being told where it lies; Foxglove takes any.
const ROOT_FRAME: &str = "tf#/";
const GOAL_COLOUR: [u8; 4] = [255, 255, 255, 255];

type Fields = [(&'static str, i32)];
const LATENT_FIELDS: [(&str, i32); 9] = [
    ("x", wire::FLOAT32),
    ("y", wire::FLOAT32),
    ("z", wire::FLOAT32),
    ("red", wire::UINT8),
    ("green", wire::UINT8),
    ("blue", wire::UINT8),
    ("alpha", wire::UINT8),
    ("row", wire::FLOAT32),
    ("col", wire::FLOAT32),
];
const OBSTACLE_FIELDS: [(&str, i32); 4] =
    [("x", wire::FLOAT32), ("y", wire::FLOAT32), ("z", wire::FLOAT32), ("radius", wire::FLOAT32)];

impl Open {
    fn cloud<P>(
        &mut self,
        topic: &str,
        at: At,
        fields: &'static Fields,
        points: impl Iterator<Item = P>,
        put: impl Fn(P, &mut Vec<u8>),
    ) -> anyhow::Result<()> {
        let channel = self.file.channel(topic, |s| *s == Shape::Cloud, || (Shape::Cloud, schema::point_cloud()))?;
        let cloud = &mut self.cloud;
        cloud.timestamp = Some(at.timestamp());
        ROOT_FRAME.clone_into(&mut cloud.frame_id);
        cloud.pose = Some(wire::NO_POSE);
        (cloud.round, cloud.epoch, cloud.step) = (at.round, at.epoch, at.step);
        cloud.point_stride = 0;
        cloud.fields.clear();
        for &(name, r#type) in fields {
            let name = name.to_owned();
            cloud.fields.push(wire::PackedElementField { name, offset: cloud.point_stride, r#type });
            cloud.point_stride += if r#type == wire::UINT8 { 1 } else { 4 };
        }
        cloud.data.clear();
        points.for_each(|point| put(point, &mut cloud.data));
        self.file.payload.clear();
        self.cloud.encode(&mut self.file.payload)?;
        Ok(self.file.write(channel, at)?)
    }

    fn write_message(&mut self, channel: usize, at: At, message: &impl prost::Message) -> anyhow::Result<()> {
        self.file.payload.clear();
        message.encode(&mut self.file.payload)?;
        Ok(self.file.write(channel, at)?)
    }
}

fn put_floats(data: &mut Vec<u8>, values: &[f32]) {
    values.iter().for_each(|value| data.extend_from_slice(&value.to_le_bytes()));
}

/// The colour of a true position: each corner of the space has one, and they blend in between.
fn colour([row, col]: [f32; 2]) -> [u8; 4] {
    const CORNERS: [[[f32; 3]; 2]; 2] =
        [[[58.0, 76.0, 192.0], [220.0, 70.0, 140.0]], [[30.0, 170.0, 140.0], [250.0, 200.0, 60.0]]];
    let (down, right) = (row.clamp(0.0, 1.0), col.clamp(0.0, 1.0));
    let mut rgba = [255; 4];
    for (channel, value) in rgba.iter_mut().take(3).enumerate() {
        let [top, bottom] = CORNERS.map(|[left, other]| left[channel] + (other[channel] - left[channel]) * right);
        *value = (top + (bottom - top) * down) as u8;
    }
    rgba
}

impl Level {
    fn to_wire(self) -> i32 {
        match self {
            Level::Debug => 1,
            Level::Info => 2,
            Level::Warning => 3,
            Level::Error => 4,
        }
    }

    pub(super) fn from_wire(level: i32) -> Level {
        match level {
            1 => Level::Debug,
            3 => Level::Warning,
            4.. => Level::Error,
            _ => Level::Info,
        }
    }
}

//! Encodes what a stage records as protobuf messages of a live file.

use prost::{
    Message as _,
    encoding::{WireType, encode_key},
};

use super::{
    colour,
    frame::{Level, MapFrame, TrajectoryFrame},
    live::{ChannelIndex, LiveFile, Shape},
    schema::{self, Schema},
    time::At,
    wire,
};

/// The root frame of Rerun, in which it draws without a transform. Foxglove accepts any frame.
const ROOT_FRAME: &str = "tf#/";

/// A named value of a point, and its number type.
type PointField = (&'static str, i32);

const GOAL_FIELDS: [PointField; 7] = [
    ("x", wire::FLOAT32),
    ("y", wire::FLOAT32),
    ("z", wire::FLOAT32),
    ("red", wire::UINT8),
    ("green", wire::UINT8),
    ("blue", wire::UINT8),
    ("alpha", wire::UINT8),
];
/// A latent, its colour, and the true position behind it.
const LATENT_FIELDS: [PointField; 9] = [
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
const OBSTACLE_FIELDS: [PointField; 4] =
    [("x", wire::FLOAT32), ("y", wire::FLOAT32), ("z", wire::FLOAT32), ("radius", wire::FLOAT32)];

/// Writes typed messages to a live file.
pub(super) struct Encoder {
    pub(super) file: LiveFile,
    /// The stage kind, which the log names as the source.
    kind: String,
    /// Reused from cloud to cloud.
    cloud: wire::PointCloud,
}

impl Encoder {
    pub(super) fn new(file: LiveFile, kind: String) -> Encoder {
        Encoder { file, kind, cloud: wire::PointCloud::default() }
    }

    pub(super) fn scalars(&mut self, topic: &str, at: At, values: &[(&'static str, f64)]) -> anyhow::Result<()> {
        let is_same = |shape: &Shape| match shape {
            Shape::Scalars(names) => names.iter().eq(values.iter().map(|(name, _)| name)),
            _ => false,
        };
        let channel = self.file.channel(topic, is_same, || {
            let names: Vec<_> = values.iter().map(|&(name, _)| name).collect();
            let schema = schema::scalars(topic, &names);
            (Shape::Scalars(names), schema)
        })?;
        let payload = &mut self.file.payload;
        payload.clear();
        let At { round, epoch, step } = at;
        wire::ScalarsHead { timestamp: Some(at.timestamp()), round, epoch, step }.encode(payload)?;
        for (number, (_, value)) in (wire::FIRST_VALUE..).zip(values) {
            encode_key(number, WireType::SixtyFourBit, payload);
            payload.extend_from_slice(&value.to_le_bytes());
        }
        Ok(self.file.write(channel, at)?)
    }

    /// Writes the latents to `topic` and the goals to `topic/goals`.
    pub(super) fn latent_map(&mut self, topic: &str, at: At, map: &MapFrame<'_>) -> anyhow::Result<()> {
        let points = map.latents.iter().zip(map.positions);
        self.cloud(topic, at, &LATENT_FIELDS, points, |(latent, position), data| {
            put_floats(data, latent);
            data.extend_from_slice(&colour::of_position(*position));
            put_floats(data, position);
        })?;
        self.cloud(&format!("{topic}/goals"), at, &GOAL_FIELDS, map.goals.iter(), |goal, data| {
            put_floats(data, goal);
            data.extend_from_slice(&colour::GOAL);
        })
    }

    pub(super) fn obstacles(&mut self, topic: &str, at: At, circles: &[[f32; 3]]) -> anyhow::Result<()> {
        self.cloud(topic, at, &OBSTACLE_FIELDS, circles.iter(), |&[row, col, radius], data| {
            put_floats(data, &[col, row, 0.0, radius]);
        })
    }

    pub(super) fn picture(&mut self, topic: &str, at: At, height: u32, width: u32, bytes: &[u8]) -> anyhow::Result<()> {
        let is_grey = u64::from(height) * u64::from(width) == bytes.len() as u64;
        let (encoding, step) = if is_grey { ("mono8", width) } else { ("rgb8", 3 * width) };
        let channel = self.channel(topic, Shape::Image, schema::raw_image)?;
        let image = wire::RawImage {
            timestamp: Some(at.timestamp()),
            width,
            height,
            encoding: encoding.to_owned(),
            step,
            data: bytes.to_vec(),
            frame_id: ROOT_FRAME.to_owned(),
            at_round: at.round,
            at_epoch: at.epoch,
            at_step: at.step,
        };
        self.message(channel, at, &image)
    }

    pub(super) fn trajectory(&mut self, topic: &str, at: At, episode: &TrajectoryFrame<'_>) -> anyhow::Result<()> {
        let channel = self.channel(topic, Shape::Trajectory, schema::trajectory)?;
        let [goal_row, goal_col] = episode.goal;
        let trajectory = wire::Trajectory {
            timestamp: Some(at.timestamp()),
            round: at.round,
            epoch: at.epoch,
            step: at.step,
            episode: episode.episode,
            row: episode.path.iter().map(|&[row, _]| row).collect(),
            col: episode.path.iter().map(|&[_, col]| col).collect(),
            goal_row,
            goal_col,
            radius: episode.radius,
            percent_goal: episode.percent_goal,
        };
        self.message(channel, at, &trajectory)
    }

    pub(super) fn log(&mut self, at: At, level: Level, text: &str) -> anyhow::Result<()> {
        let channel = self.channel("/log", Shape::Log, schema::log)?;
        let log = wire::Log {
            timestamp: Some(at.timestamp()),
            level: level.to_wire(),
            message: text.to_owned(),
            name: self.kind.clone(),
            round: at.round,
            epoch: at.epoch,
            step: at.step,
        };
        self.message(channel, at, &log)
    }

    /// Writes points with these fields; `put` appends the bytes of one point.
    fn cloud<P>(
        &mut self,
        topic: &str,
        at: At,
        fields: &'static [PointField],
        points: impl Iterator<Item = P>,
        put: impl Fn(P, &mut Vec<u8>),
    ) -> anyhow::Result<()> {
        let channel = self.channel(topic, Shape::Cloud, schema::point_cloud)?;
        let cloud = &mut self.cloud;
        cloud.timestamp = Some(at.timestamp());
        ROOT_FRAME.clone_into(&mut cloud.frame_id);
        cloud.pose = Some(wire::IDENTITY_POSE);
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

    /// The channel of a topic with a shape that has one schema only.
    fn channel(&mut self, topic: &str, shape: Shape, schema: fn() -> Schema) -> mcap::McapResult<ChannelIndex> {
        self.file.channel(topic, |other| *other == shape, || (shape.clone(), schema()))
    }

    fn message(&mut self, channel: ChannelIndex, at: At, message: &impl prost::Message) -> anyhow::Result<()> {
        self.file.payload.clear();
        message.encode(&mut self.file.payload)?;
        Ok(self.file.write(channel, at)?)
    }
}

fn put_floats(data: &mut Vec<u8>, values: &[f32]) {
    values.iter().for_each(|value| data.extend_from_slice(&value.to_le_bytes()));
}

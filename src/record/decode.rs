//! Decodes the messages of a recording.

use anyhow::{Context as _, bail};
use prost::Message as _;

use super::{
    frame::{Frame, Level, Message},
    reader::RawMessage,
    schema,
    time::At,
    wire,
};

impl Message {
    /// Decodes a message; `None` if the program does not know its type.
    ///
    /// # Errors
    /// If the message is damaged.
    pub fn decode(raw: &RawMessage<'_>) -> anyhow::Result<Option<Message>> {
        let decoded = match raw.channel.schema.as_str() {
            schema::POINT_CLOUD => cloud(raw.data),
            schema::RAW_IMAGE => picture(raw.data),
            schema::LOG => log(raw.data),
            schema::TRAJECTORY => trajectory(raw.data),
            name if name.starts_with(schema::SCALARS) => scalars(raw),
            _ => return Ok(None),
        };
        let topic = &raw.channel.topic;
        let (at, frame) = decoded.with_context(|| format!("cannot decode message {} of `{topic}`", raw.sequence))?;
        Ok(Some(Message { topic: topic.clone(), at, frame }))
    }
}

fn scalars(raw: &RawMessage<'_>) -> anyhow::Result<(At, Frame)> {
    let head = wire::ScalarsHead::decode(raw.data)?;
    let names = raw.channel.value_names.clone();
    let mut values = vec![0.0; names.len()];
    // The recorder writes the values last, each as a key and eight bytes.
    let width = |number: u32| prost::encoding::key_len(number) + 8;
    let length = (wire::FIRST_VALUE..).take(values.len()).map(width).sum::<usize>();
    let Some(start) = raw.data.len().checked_sub(length) else { bail!("the message is too short") };
    let mut rest = &raw.data[start..];
    for (number, value) in (wire::FIRST_VALUE..).zip(&mut values) {
        let (key, wire_type) = prost::encoding::decode_key(&mut rest)?;
        let (Some((bytes, after)), true, prost::encoding::WireType::SixtyFourBit) =
            (rest.split_first_chunk::<8>(), key == number, wire_type)
        else {
            bail!("value {number} is missing");
        };
        *value = f64::from_le_bytes(*bytes);
        rest = after;
    }
    Ok((At::new(head.round, head.epoch, head.step), Frame::Scalars { names, values }))
}

/// Decodes a latent map, obstacles or goals. The fields of the points tell which of these a cloud is.
fn cloud(data: &[u8]) -> anyhow::Result<(At, Frame)> {
    let cloud = wire::PointCloud::decode(data)?;
    let offset = |name: &str| cloud.fields.iter().find(|field| field.name == name).map(|field| field.offset as usize);
    let points = || cloud.data.chunks_exact((cloud.point_stride as usize).max(1));
    let frame = if let (Some(row), Some(col), Some(red)) = (offset("row"), offset("col"), offset("red")) {
        let (mut positions, mut latents, mut colours) = (Vec::new(), Vec::new(), Vec::new());
        for point in points() {
            positions.push([float(point, row)?, float(point, col)?]);
            latents.push(xyz(point)?);
            colours.push(*point.get(red..).and_then(<[u8]>::first_chunk).context("a colour is missing")?);
        }
        Frame::LatentMap { positions, latents, colours }
    } else if let Some(radius) = offset("radius") {
        let circle = |point: &[u8]| xyz(point).and_then(|[x, y, _]| Ok([y, x, float(point, radius)?]));
        Frame::Obstacles(points().map(circle).collect::<anyhow::Result<_>>()?)
    } else {
        Frame::Goals(points().map(xyz).collect::<anyhow::Result<_>>()?)
    };
    Ok((At::new(cloud.round, cloud.epoch, cloud.step), frame))
}

fn xyz(point: &[u8]) -> anyhow::Result<[f32; 3]> {
    Ok([float(point, 0)?, float(point, 4)?, float(point, 8)?])
}

fn float(point: &[u8], offset: usize) -> anyhow::Result<f32> {
    let bytes = point.get(offset..).and_then(<[u8]>::first_chunk).context("a coordinate is missing")?;
    Ok(f32::from_le_bytes(*bytes))
}

fn picture(data: &[u8]) -> anyhow::Result<(At, Frame)> {
    let image = wire::RawImage::decode(data)?;
    let (height, width, bytes) = (image.height, image.width, image.data);
    let pixels = u64::from(height) * u64::from(width);
    let wanted = match image.encoding.as_str() {
        "mono8" => Some(pixels),
        "rgb8" => pixels.checked_mul(3),
        _ => None,
    };
    if wanted != Some(bytes.len() as u64) {
        bail!("the picture is not {height}x{width} grey or coloured pixels");
    }
    Ok((At::new(image.at_round, image.at_epoch, image.at_step), Frame::Picture { height, width, bytes }))
}

fn log(data: &[u8]) -> anyhow::Result<(At, Frame)> {
    let log = wire::Log::decode(data)?;
    let frame = Frame::Log { level: Level::from_wire(log.level), text: log.message };
    Ok((At::new(log.round, log.epoch, log.step), frame))
}

fn trajectory(data: &[u8]) -> anyhow::Result<(At, Frame)> {
    let t = wire::Trajectory::decode(data)?;
    let frame = Frame::Trajectory {
        episode: t.episode,
        path: t.row.iter().zip(&t.col).map(|(&row, &col)| [row, col]).collect(),
        goal: [t.goal_row, t.goal_col],
        radius: t.radius,
        percent_goal: t.percent_goal,
    };
    Ok((At::new(t.round, t.epoch, t.step), frame))
}

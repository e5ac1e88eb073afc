//! The protobuf schemas that a recording carries. Each is a complete descriptor set, so that any reader can decode the
//! messages without this program.

use prost::Message as _;
use prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet, field_descriptor_proto::Type,
};

use super::{
    descriptor::{
        TIMESTAMP, at_fields, descriptor_set, field, message, names, of_enum, of_message, packed_element_field, pose,
        quaternion, repeated, vector3,
    },
    wire::FIRST_VALUE,
};

/// A message type, with the descriptors of all types that it uses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Schema {
    /// Full name, such as `foxglove.PointCloud`.
    pub(super) name: String,
    /// An encoded `FileDescriptorSet`, imports first.
    pub(super) data: Vec<u8>,
}

pub(super) const POINT_CLOUD: &str = "foxglove.PointCloud";
pub(super) const RAW_IMAGE: &str = "foxglove.RawImage";
pub(super) const LOG: &str = "foxglove.Log";
pub(super) const TRAJECTORY: &str = "carl.Trajectory";
/// The package of scalars messages; each topic has a message type in it.
pub(super) const SCALARS: &str = "carl.scalars.";

/// A cloud of points with named values.
pub(super) fn point_cloud() -> Schema {
    let mut cloud = message("PointCloud");
    cloud.field = vec![
        of_message("timestamp", 1, TIMESTAMP),
        field("frame_id", 2, Type::String),
        of_message("pose", 3, ".foxglove.Pose"),
        field("point_stride", 4, Type::Fixed32),
        repeated(of_message("fields", 5, ".foxglove.PackedElementField")),
        field("data", 6, Type::Bytes),
    ];
    cloud.field.extend(at_fields(["round", "epoch", "step"], 1001));
    let imports = [vector3(), quaternion(), pose(), packed_element_field()];
    schema(POINT_CLOUD, cloud, imports, &["foxglove/Pose.proto", "foxglove/PackedElementField.proto"])
}

/// A picture, grey or coloured.
pub(super) fn raw_image() -> Schema {
    let mut image = message("RawImage");
    image.field = vec![
        of_message("timestamp", 1, TIMESTAMP),
        field("width", 2, Type::Fixed32),
        field("height", 3, Type::Fixed32),
        field("encoding", 4, Type::String),
        field("step", 5, Type::Fixed32),
        field("data", 6, Type::Bytes),
        field("frame_id", 7, Type::String),
    ];
    // The field name `step` is taken: it is the length of a row.
    image.field.extend(at_fields(["at_round", "at_epoch", "at_step"], 1001));
    schema(RAW_IMAGE, image, [], &[])
}

/// A text with a level.
pub(super) fn log() -> Schema {
    let mut log = message("Log");
    log.enum_type = vec![names("Level", &["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"])];
    log.field = vec![
        of_message("timestamp", 1, TIMESTAMP),
        of_enum("level", 2, ".foxglove.Log.Level"),
        field("message", 3, Type::String),
        field("name", 4, Type::String),
        field("file", 5, Type::String),
        field("line", 6, Type::Fixed32),
    ];
    log.field.extend(at_fields(["round", "epoch", "step"], 1001));
    schema(LOG, log, [], &[])
}

/// One evaluated episode in true space.
pub(super) fn trajectory() -> Schema {
    let mut trajectory = message("Trajectory");
    trajectory.field = vec![of_message("timestamp", 1, TIMESTAMP)];
    trajectory.field.extend(at_fields(["round", "epoch", "step"], 2));
    trajectory.field.extend([
        field("episode", 5, Type::Uint32),
        repeated(field("row", 6, Type::Float)),
        repeated(field("col", 7, Type::Float)),
        field("goal_row", 8, Type::Float),
        field("goal_col", 9, Type::Float),
        field("radius", 10, Type::Float),
        field("percent_goal", 11, Type::Double),
    ]);
    schema(TRAJECTORY, trajectory, [], &[])
}

/// One value per name. The message type of the topic `/train/lce` is `carl.scalars.TrainLce`.
pub(super) fn scalars(topic: &str, value_names: &[&str]) -> Schema {
    let name: String = topic.split(|c: char| !c.is_ascii_alphanumeric()).map(capitalised).collect();
    let mut scalars = message(if name.is_empty() { "Unnamed" } else { &name });
    scalars.field = vec![of_message("timestamp", 1, TIMESTAMP)];
    scalars.field.extend(at_fields(["round", "epoch", "step"], 2));
    for (number, name) in (FIRST_VALUE..).zip(value_names) {
        let name = unused_identifier(name, &scalars.field);
        scalars.field.push(field(&name, number as i32, Type::Double));
    }
    let full_name = format!("{SCALARS}{}", scalars.name());
    schema(&full_name, scalars, [], &[])
}

/// The value names of a scalars schema, in the order of their field numbers from [`FIRST_VALUE`] on.
pub(super) fn value_names(schema: &[u8]) -> Option<Vec<String>> {
    let files = FileDescriptorSet::decode(schema).ok()?;
    let message = files.file.last()?.message_type.first()?;
    let values = message.field.iter().filter(|field| field.number() >= FIRST_VALUE as i32);
    Some(values.map(|field| field.name().to_owned()).collect())
}

fn capitalised(word: &str) -> String {
    let (first, rest) = word.split_at(word.len().min(1));
    first.to_ascii_uppercase() + rest
}

/// The name as a valid protobuf identifier that no other field has.
fn unused_identifier(name: &str, taken: &[FieldDescriptorProto]) -> String {
    let mut name = name.replace(|c: char| !c.is_ascii_alphanumeric(), "_");
    if !name.starts_with(|c: char| c.is_ascii_alphabetic()) {
        name.insert_str(0, "v_");
    }
    while taken.iter().any(|field| field.name() == name) {
        name.push('_');
    }
    name
}

fn schema<const N: usize>(
    full_name: &str,
    message: DescriptorProto,
    imports: [FileDescriptorProto; N],
    import_paths: &[&str],
) -> Schema {
    let package = full_name.rsplit_once('.').map_or("", |(package, _)| package);
    Schema { name: full_name.to_owned(), data: descriptor_set(package, message, imports, import_paths).encode_to_vec() }
}

#[cfg(test)]
mod tests {
    use super::{scalars, value_names};

    #[test]
    fn value_names_become_distinct_identifiers() {
        let schema = scalars("/train/lce", &["total", "kl/post", "step", "2d", "kl post"]);
        assert_eq!(schema.name, "carl.scalars.TrainLce");
        assert_eq!(value_names(&schema.data).unwrap(), ["total", "kl_post", "step_", "v_2d", "kl_post_"]);
    }
}

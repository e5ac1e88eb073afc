//! Protobuf schemas as MCAP carries them: complete descriptor sets, so that every reader decodes without us.

use prost::Message as _;
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto, FileDescriptorProto,
    FileDescriptorSet,
    field_descriptor_proto::{Label, Type},
};

use super::wire::FIRST_VALUE;

/// A message type and the descriptors of everything it is made of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Schema {
    /// Full name, such as `foxglove.PointCloud`.
    pub name: String,
    /// An encoded `FileDescriptorSet`, imports first.
    pub data: Vec<u8>,
}

pub(super) const POINT_CLOUD: &str = "foxglove.PointCloud";
pub(super) const RAW_IMAGE: &str = "foxglove.RawImage";
pub(super) const LOG: &str = "foxglove.Log";
pub(super) const TRAJECTORY: &str = "carl.Trajectory";
/// Packages `carl.scalars.*` hold one message per topic.
pub(super) const SCALARS: &str = "carl.scalars.";

const TIMESTAMP: &str = ".google.protobuf.Timestamp";

/// Points with named values each.
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
    set(POINT_CLOUD, cloud, imports, &["foxglove/Pose.proto", "foxglove/PackedElementField.proto"])
}

/// A grey picture.
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
    // An image's `step` is the length of a row.
    image.field.extend(at_fields(["at_round", "at_epoch", "at_step"], 1001));
    set(RAW_IMAGE, image, [], &[])
}

/// A sentence with a level.
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
    set(LOG, log, [], &[])
}

/// One episode in true space.
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
    set(TRAJECTORY, trajectory, [], &[])
}

/// One value per name; `/train/lce` becomes `carl.scalars.TrainLce`.
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
    set(&full_name, scalars, [], &[])
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

/// A name that protobuf takes and that no field has yet.
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

fn set<const N: usize>(
    full_name: &str,
    message: DescriptorProto,
    imports: [FileDescriptorProto; N],
    direct: &[&str],
) -> Schema {
    let package = full_name.rsplit_once('.').map_or("", |(package, _)| package);
    let mut root = file(package, message);
    root.dependency = vec!["google/protobuf/timestamp.proto".to_owned()];
    root.dependency.extend(direct.iter().map(|&path| path.to_owned()));
    let mut files = vec![timestamp()];
    files.extend(imports);
    files.push(root);
    Schema { name: full_name.to_owned(), data: FileDescriptorSet { file: files }.encode_to_vec() }
}

fn file(package: &str, message: DescriptorProto) -> FileDescriptorProto {
    FileDescriptorProto {
        name: Some(format!("{}/{}.proto", package.replace('.', "/"), message.name())),
        package: Some(package.to_owned()),
        message_type: vec![message],
        syntax: Some("proto3".to_owned()),
        ..Default::default()
    }
}

fn timestamp() -> FileDescriptorProto {
    let mut timestamp = message("Timestamp");
    timestamp.field = vec![field("seconds", 1, Type::Int64), field("nanos", 2, Type::Int32)];
    let mut file = file("google.protobuf", timestamp);
    file.name = Some("google/protobuf/timestamp.proto".to_owned());
    file
}

fn vector3() -> FileDescriptorProto {
    let mut vector = message("Vector3");
    vector.field = vec![field("x", 1, Type::Double), field("y", 2, Type::Double), field("z", 3, Type::Double)];
    file("foxglove", vector)
}

fn quaternion() -> FileDescriptorProto {
    let mut quaternion = message("Quaternion");
    quaternion.field = ["x", "y", "z", "w"].into_iter().zip(1..).map(|(n, i)| field(n, i, Type::Double)).collect();
    file("foxglove", quaternion)
}

fn pose() -> FileDescriptorProto {
    let mut pose = message("Pose");
    pose.field =
        vec![of_message("position", 1, ".foxglove.Vector3"), of_message("orientation", 2, ".foxglove.Quaternion")];
    let mut file = file("foxglove", pose);
    file.dependency = vec!["foxglove/Vector3.proto".to_owned(), "foxglove/Quaternion.proto".to_owned()];
    file
}

fn packed_element_field() -> FileDescriptorProto {
    const TYPES: [&str; 9] = ["UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"];
    let mut packed = message("PackedElementField");
    packed.enum_type = vec![names("NumericType", &TYPES)];
    packed.field = vec![
        field("name", 1, Type::String),
        field("offset", 2, Type::Fixed32),
        of_enum("type", 3, ".foxglove.PackedElementField.NumericType"),
    ];
    file("foxglove", packed)
}

fn message(name: &str) -> DescriptorProto {
    DescriptorProto { name: Some(name.to_owned()), ..Default::default() }
}

fn names(name: &str, values: &[&str]) -> EnumDescriptorProto {
    let value = |(name, number): (&&str, i32)| EnumValueDescriptorProto {
        name: Some((*name).to_owned()),
        number: Some(number),
        options: None,
    };
    EnumDescriptorProto {
        name: Some(name.to_owned()),
        value: values.iter().zip(0..).map(value).collect(),
        ..Default::default()
    }
}

fn at_fields([round, epoch, step]: [&str; 3], first: i32) -> [FieldDescriptorProto; 3] {
    [field(round, first, Type::Uint32), field(epoch, first + 1, Type::Uint32), field(step, first + 2, Type::Uint64)]
}

fn field(name: &str, number: i32, r#type: Type) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        label: Some(Label::Optional as i32),
        r#type: Some(r#type as i32),
        ..Default::default()
    }
}

fn of_message(name: &str, number: i32, type_name: &str) -> FieldDescriptorProto {
    FieldDescriptorProto { type_name: Some(type_name.to_owned()), ..field(name, number, Type::Message) }
}

fn of_enum(name: &str, number: i32, type_name: &str) -> FieldDescriptorProto {
    FieldDescriptorProto { type_name: Some(type_name.to_owned()), ..field(name, number, Type::Enum) }
}

fn repeated(field: FieldDescriptorProto) -> FieldDescriptorProto {
    FieldDescriptorProto { label: Some(Label::Repeated as i32), ..field }
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

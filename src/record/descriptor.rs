//! Builds protobuf descriptors, and the descriptors of types that several schemas use.

use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto, FileDescriptorProto,
    FileDescriptorSet,
    field_descriptor_proto::{Label, Type},
};

/// The type of a time in a message.
pub(super) const TIMESTAMP: &str = ".google.protobuf.Timestamp";

/// The descriptors of a message in `package`: first the imported files, then the file of the message. The message
/// names the files `import_paths` itself; the other files are imports of these.
pub(super) fn descriptor_set<const N: usize>(
    package: &str,
    message: DescriptorProto,
    imports: [FileDescriptorProto; N],
    import_paths: &[&str],
) -> FileDescriptorSet {
    let mut root = file(package, message);
    root.dependency = vec!["google/protobuf/timestamp.proto".to_owned()];
    root.dependency.extend(import_paths.iter().map(|&path| path.to_owned()));
    let mut files = vec![timestamp()];
    files.extend(imports);
    files.push(root);
    FileDescriptorSet { file: files }
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

/// `foxglove/Vector3.proto`.
pub(super) fn vector3() -> FileDescriptorProto {
    let mut vector = message("Vector3");
    vector.field = vec![field("x", 1, Type::Double), field("y", 2, Type::Double), field("z", 3, Type::Double)];
    file("foxglove", vector)
}

/// `foxglove/Quaternion.proto`.
pub(super) fn quaternion() -> FileDescriptorProto {
    let mut quaternion = message("Quaternion");
    quaternion.field = ["x", "y", "z", "w"].into_iter().zip(1..).map(|(n, i)| field(n, i, Type::Double)).collect();
    file("foxglove", quaternion)
}

/// `foxglove/Pose.proto`.
pub(super) fn pose() -> FileDescriptorProto {
    let mut pose = message("Pose");
    pose.field =
        vec![of_message("position", 1, ".foxglove.Vector3"), of_message("orientation", 2, ".foxglove.Quaternion")];
    let mut file = file("foxglove", pose);
    file.dependency = vec!["foxglove/Vector3.proto".to_owned(), "foxglove/Quaternion.proto".to_owned()];
    file
}

/// `foxglove/PackedElementField.proto`.
pub(super) fn packed_element_field() -> FileDescriptorProto {
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

/// A message type without fields.
pub(super) fn message(name: &str) -> DescriptorProto {
    DescriptorProto { name: Some(name.to_owned()), ..Default::default() }
}

/// An enum whose values are numbered from 0.
pub(super) fn names(name: &str, values: &[&str]) -> EnumDescriptorProto {
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

/// The fields of a logical time, numbered from `first`.
pub(super) fn at_fields([round, epoch, step]: [&str; 3], first: i32) -> [FieldDescriptorProto; 3] {
    [field(round, first, Type::Uint32), field(epoch, first + 1, Type::Uint32), field(step, first + 2, Type::Uint64)]
}

/// A field of a basic type.
pub(super) fn field(name: &str, number: i32, r#type: Type) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        label: Some(Label::Optional as i32),
        r#type: Some(r#type as i32),
        ..Default::default()
    }
}

/// A field whose type is a message.
pub(super) fn of_message(name: &str, number: i32, type_name: &str) -> FieldDescriptorProto {
    FieldDescriptorProto { type_name: Some(type_name.to_owned()), ..field(name, number, Type::Message) }
}

/// A field whose type is an enum.
pub(super) fn of_enum(name: &str, number: i32, type_name: &str) -> FieldDescriptorProto {
    FieldDescriptorProto { type_name: Some(type_name.to_owned()), ..field(name, number, Type::Enum) }
}

/// The field as a list.
pub(super) fn repeated(field: FieldDescriptorProto) -> FieldDescriptorProto {
    FieldDescriptorProto { label: Some(Label::Repeated as i32), ..field }
}

//! The protobuf messages of a recording: Foxglove's types where one fits, and `carl.*` types otherwise.
//!
//! Foxglove's types have no fields for round, epoch and step, so fields 1001 to 1003 hold them. A reader that decodes
//! with the schema in the file shows these fields by name. A reader with Foxglove's schema built in skips them.

use prost_types::Timestamp;

/// `foxglove.PackedElementField`: name, offset and type of a value within a point.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct PackedElementField {
    #[prost(string, tag = "1")]
    pub name: String,
    #[prost(fixed32, tag = "2")]
    pub offset: u32,
    #[prost(int32, tag = "3")]
    pub r#type: i32,
}

/// `NumericType.UINT8`.
pub(super) const UINT8: i32 = 1;
/// `NumericType.FLOAT32`.
pub(super) const FLOAT32: i32 = 7;

/// `foxglove.Vector3`.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(super) struct Vector3 {
    #[prost(double, tag = "1")]
    pub x: f64,
    #[prost(double, tag = "2")]
    pub y: f64,
    #[prost(double, tag = "3")]
    pub z: f64,
}

/// `foxglove.Quaternion`.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(super) struct Quaternion {
    #[prost(double, tag = "1")]
    pub x: f64,
    #[prost(double, tag = "2")]
    pub y: f64,
    #[prost(double, tag = "3")]
    pub z: f64,
    #[prost(double, tag = "4")]
    pub w: f64,
}

/// `foxglove.Pose`.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub(super) struct Pose {
    #[prost(message, optional, tag = "1")]
    pub position: Option<Vector3>,
    #[prost(message, optional, tag = "2")]
    pub orientation: Option<Quaternion>,
}

/// The identity pose. Rerun's MCAP reader needs a pose in every cloud.
pub(super) const IDENTITY_POSE: Pose = Pose {
    position: Some(Vector3 { x: 0.0, y: 0.0, z: 0.0 }),
    orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
};

/// `foxglove.PointCloud`.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct PointCloud {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    pub frame_id: String,
    #[prost(message, optional, tag = "3")]
    pub pose: Option<Pose>,
    #[prost(fixed32, tag = "4")]
    pub point_stride: u32,
    #[prost(message, repeated, tag = "5")]
    pub fields: Vec<PackedElementField>,
    #[prost(bytes = "vec", tag = "6")]
    pub data: Vec<u8>,
    #[prost(uint32, tag = "1001")]
    pub round: u32,
    #[prost(uint32, tag = "1002")]
    pub epoch: u32,
    #[prost(uint64, tag = "1003")]
    pub step: u64,
}

/// `foxglove.RawImage`.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct RawImage {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(fixed32, tag = "2")]
    pub width: u32,
    #[prost(fixed32, tag = "3")]
    pub height: u32,
    #[prost(string, tag = "4")]
    pub encoding: String,
    /// Bytes of one row of pixels.
    #[prost(fixed32, tag = "5")]
    pub step: u32,
    #[prost(bytes = "vec", tag = "6")]
    pub data: Vec<u8>,
    #[prost(string, tag = "7")]
    pub frame_id: String,
    #[prost(uint32, tag = "1001")]
    pub at_round: u32,
    #[prost(uint32, tag = "1002")]
    pub at_epoch: u32,
    #[prost(uint64, tag = "1003")]
    pub at_step: u64,
}

/// `foxglove.Log`.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Log {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(int32, tag = "2")]
    pub level: i32,
    #[prost(string, tag = "3")]
    pub message: String,
    #[prost(string, tag = "4")]
    pub name: String,
    #[prost(uint32, tag = "1001")]
    pub round: u32,
    #[prost(uint32, tag = "1002")]
    pub epoch: u32,
    #[prost(uint64, tag = "1003")]
    pub step: u64,
}

/// `carl.Trajectory`: one evaluated episode in true space.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Trajectory {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(uint32, tag = "2")]
    pub round: u32,
    #[prost(uint32, tag = "3")]
    pub epoch: u32,
    #[prost(uint64, tag = "4")]
    pub step: u64,
    #[prost(uint32, tag = "5")]
    pub episode: u32,
    #[prost(float, repeated, tag = "6")]
    pub row: Vec<f32>,
    #[prost(float, repeated, tag = "7")]
    pub col: Vec<f32>,
    #[prost(float, tag = "8")]
    pub goal_row: f32,
    #[prost(float, tag = "9")]
    pub goal_col: f32,
    #[prost(float, tag = "10")]
    pub radius: f32,
    #[prost(double, tag = "11")]
    pub percent_goal: f64,
}

/// The first fields of every `carl.scalars.*` message. The values follow as doubles, from field [`FIRST_VALUE`] on.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct ScalarsHead {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(uint32, tag = "2")]
    pub round: u32,
    #[prost(uint32, tag = "3")]
    pub epoch: u32,
    #[prost(uint64, tag = "4")]
    pub step: u64,
}

/// Field number of the first value of a scalars message.
pub(super) const FIRST_VALUE: u32 = 10;

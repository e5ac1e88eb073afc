//! Recordings: one MCAP file for every node, with its curves, pictures, maps, episodes and log.
//!
//! A stage writes to the [`Recorder`]. Every view reads the file that the recorder leaves, so a live view and a later
//! one look the same. A recording never fails a run and never changes a result.

mod canonical;
mod colour;
mod decode;
mod descriptor;
mod encode;
mod fit;
mod frame;
mod live;
mod node_info;
mod reader;
mod recorder;
mod schema;
mod time;
pub mod topic;
mod wire;
mod writer;

pub use fit::{Unfit, check};
pub use frame::{Frame, Level, MapFrame, Message, TrajectoryFrame};
pub use node_info::NodeInfo;
pub use reader::{Channel, Polled, RawMessage, Reader};
pub use recorder::{Finished, Recorder};
pub use time::At;

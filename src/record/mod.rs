//! What a node did while it worked: an MCAP recording, and the Rerun view of it.
//!
//! A stage sees only the [`Recorder`]. The MCAP file it leaves is the record; every picture of it, live or next month,
//! comes from reading that file, so both look the same. Nothing here can fail or change a run.

mod canonical;
mod events;
mod follow;
mod frame;
mod live;
mod playback;
mod reader;
mod recorder;
mod schema;
mod screen;
mod sink;
mod story;
mod time;
pub mod topic;
mod wire;

pub use follow::{follow, follow_on, open, open_on};
pub use frame::{Frame, Message};
pub use reader::{Channel, Polled, RawMessage, Reader};
pub use recorder::{Finished, Level, MapFrame, NodeInfo, Recorder, TrajectoryFrame};
pub use screen::{Place, Screen, Watcher};
pub use sink::Sink;
pub use time::At;

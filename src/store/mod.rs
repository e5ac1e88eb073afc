//! Keeps results by the key that made them and bytes by their digest. Nothing here knows of pipelines or stages.
//!
//! [`ResultStore`] is the contract that the rest of the program uses; [`LocalStore`] keeps it in a folder.

mod contract;
mod entry;
mod error;
mod files;
mod holder;
mod key;
mod local;
pub(crate) mod sealed;

pub use contract::{KeyLock, Lookup, Published, ResultStore};
pub use entry::{Entry, FileRef, NewEntry, NewRecording, RecordingRef, Stat};
pub use error::{Error, Problem, Result};
pub use files::{Content, Files, ReadSeek};
pub use holder::Holder;
pub use key::Key;
pub use local::{Fault, Inventory, Kept, LocalStore, Removed, own_items, replace_file, sync_folder};

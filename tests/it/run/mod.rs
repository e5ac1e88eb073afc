//! The store, the cache and the runner, with toy kinds.

mod cache;
mod jobs;
mod runs;
mod store;
mod verify;

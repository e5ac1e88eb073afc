//! The store, the cache and the runner, with toy kinds.

mod any_bytes;
mod cache;
mod damage;
mod gc;
mod jobs;
mod runs;
mod store;
mod verify;

//! Recordings, and what others read in them.

mod any_bytes;
mod files;
mod python;

//! Recordings, and what others read in them.

mod files;
mod python;

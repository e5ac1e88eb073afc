//! Pipeline files: expansion, mistakes, suites, what ships.

mod any_bytes;
mod expand;
mod extends;
mod mistakes;
mod render;
mod schema;
mod shipped;
mod suite;

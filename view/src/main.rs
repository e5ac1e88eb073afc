//! The live view.

fn main() {}

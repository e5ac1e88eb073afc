//! First pass: text to a parsed pipeline, every part with its place. No name is looked up.

pub(crate) mod arguments;
pub(crate) mod document;
pub(crate) mod matrix;
pub(crate) mod parsed;
pub(crate) mod path;
pub(crate) mod reference;
mod stage;
pub(crate) mod top_level;
pub(crate) mod tree;
pub(crate) mod values;

//! Every test of the whole program but those that need a process of their own.

mod cli;
mod pipeline;
mod record;
mod run;
mod science;
mod support;

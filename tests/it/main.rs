//! Every test of the whole program but those that need a process of their own.

#[path = "../support/allocator.rs"]
mod allocator;
mod cli;
mod docs;
mod pipeline;
mod record;
mod report;
mod run;
mod science;
mod support;

/// The commands of `support::cli` start this test binary again with this test alone, which then becomes the program.
#[test]
fn the_program() {
    support::cli::be_the_program();
}

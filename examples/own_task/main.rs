//! A program of one's own: carl-pipe with one more task and one more kind of stage.
//!
//! `cargo run --example own_task -- run examples/own_task/pipeline.toml` runs its pipeline.

mod corridor;
mod count_lit;

use std::{ffi::OsString, process::ExitCode};

use carl_pipe::{cli, env, stage};

fn main() -> ExitCode {
    let argv: Vec<OsString> = std::env::args_os().collect();
    env::add_to_registry(&[&corridor::TASK]);
    cli::main(&argv, kinds()).into()
}

/// All kinds of stages.
fn kinds() -> &'static [stage::Kind] {
    stage::registry_with(vec![stage::Kind::of::<count_lit::CountLit>()])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A task without goals.
    static NOWHERE: env::TaskKind = env::TaskKind {
        name: "nowhere",
        world: env::World::Simulator {
            spec: |task| env::Spec { goals: 0, ..corridor::spec(task) },
            open: |_| anyhow::bail!("nobody opens it"),
        },
        ..corridor::TASK
    };

    /// One test, since tasks can be added once in a process.
    #[test]
    fn an_own_task_and_an_own_kind_run_in_a_pipeline() {
        env::add_to_registry(&[&NOWHERE, &corridor::TASK]);
        let (kinds, folder) = (kinds(), tempfile::tempdir().unwrap());
        let run = |more: &[&str]| {
            let words = ["carl-pipe", "run", "examples/own_task/pipeline.toml", "-q", "--artifacts"];
            let mut argv: Vec<OsString> = words.into_iter().map(OsString::from).collect();
            argv.push(folder.path().join("store").into_os_string());
            argv.extend(more.iter().map(OsString::from));
            cli::main(&argv, kinds)
        };
        assert_eq!(run(&[]), 0);
        assert_eq!(env::registry().last().map(|task| task.name), Some("corridor"), "it follows the built-in tasks");
        // The simulator does not draw states, and it has no controller on true states.
        assert_ne!(run(&["-S", "bootstrap.trajectory=1"]), 0);
        assert_ne!(run(&["-S", "evaluate.controller=oracle"]), 0);
        assert_eq!(run(&["-S", "task.env=nowhere"]), 3, "a task that cannot run is a mistake of the file");
    }
}

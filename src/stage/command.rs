//! Runs a program of the user as a stage: its inputs are folders that it may read, its outputs are files that it writes.
//!
//! The program works in a private folder that the store can take files over from, so an output of any size is moved and
//! never held in memory. Nothing is published unless the program ended by itself with exit status 0, wrote what it
//! declared and nothing else, and left its inputs and no process behind.

mod attempt;
mod events;
mod inputs;
mod outputs;
mod params;
mod places;
mod readers;

use serde_json::Value;

use super::{Declared, InputFiles, Kind, StageCx};
use crate::artifact::Files;
use attempt::{Attempt, Failed};
use params::Params;
use readers::reader;

/// The kind `command`. Raise its version when the same parameters and inputs would give other bytes.
pub(super) fn kind() -> Kind {
    let about = "runs a program of your own; the files that it writes are the output";
    Kind { declare: Some(declare), repeats: false, ..Kind::with::<Params>("command", 1, about, "files", run) }
}

/// What a stage declares: its inputs by name, and the type of its output.
fn declare(params: &Value, inputs: &[&str]) -> Declared {
    let gives = serde_json::from_value(params["gives"].clone()).unwrap_or_default();
    let reader = reader(gives);
    let params: Result<Params, _> = serde_json::from_value(params.clone());
    let refusals = params.map_or_else(|_| Vec::new(), |params| params.without_input(inputs));
    Declared { output: reader.artifact, readable_as: reader.readable_as, headline: reader.headline, refusals }
}

/// Runs the program, again after a failure as often as `retries` says.
fn run(params: &Value, inputs: &InputFiles<'_>, cx: &mut StageCx<'_>) -> anyhow::Result<Files> {
    let params: Params = serde_json::from_value(params.clone())?;
    let folder = cx.folder()?;
    let inputs = inputs::Given::copy(inputs, &folder.join("in"))?;
    for number in 0..=params.retries {
        let attempt = Attempt { params: &params, inputs: &inputs, folder: folder.join(format!("attempt-{number:03}")) };
        match attempt.run(cx) {
            Ok(files) => return Ok(files),
            Err(Failed { error, may_help: true }) if number < params.retries => {
                cx.say(&format!("attempt {} of {} failed: {error:#}", number + 1, params.retries + 1));
            }
            Err(Failed { error, .. }) => return Err(error),
        }
    }
    unreachable!("the last attempt returns")
}
